"""roughvol: the free volume between rough surfaces in elastic contact.

``roughvol.run("study.yaml")`` computes a study and returns its dataset; ``roughvol.open("study")`` opens it again.
``roughvol.press(heights, L="500 um", E="10 MPa", nu=0.5)`` presses a height map in memory. ``roughvol.plot`` draws a
dataset, ``roughvol.load`` reads a study. Doubts are warnings of the class `RoughvolWarning`.
The rooms, from the bottom up: `surfaces`, `study` and `contact`, `store` and `observables`, `campaign` and `report`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
