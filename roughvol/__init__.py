"""roughvol: the free volume between rough surfaces in elastic contact.

``roughvol.run("study.yaml")`` computes a study and returns its dataset; ``roughvol.open("study")`` opens it again.
``roughvol.press(heights, L="500 um", E="10 MPa", nu=0.5)`` presses a height map in memory. ``roughvol.plot`` draws a
dataset, ``roughvol.load`` reads a study. ``roughvol.show``, ``compare``, ``card``, ``ask``, ``creep``, ``report_on``,
``check``, ``status``, ``runs``, ``tradeoff``, ``explain`` and ``licences`` answer as the commands do.
``ds.roughvol.at(pressure="0.5 MPa")`` has the numbers at a load. Doubts are warnings of the class `RoughvolWarning`.
The rooms, from the bottom up: `surfaces`, `study` and `contact`, `store` and `observables`, `campaign` and `report`,
`reproduction`.
"""

import importlib
from typing import Any

from roughvol.spellings import attach

_of_room, __dir__, __all__ = attach(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Import a public name on first use; functions that return a dataset bring its accessor ``ds.roughvol``."""
    if name in ("open", "press", "run"):
        importlib.import_module("roughvol.analysis.accessor")
    return _of_room(name)
