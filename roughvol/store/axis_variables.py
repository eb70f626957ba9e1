"""Coordinates of the axes that the lists of a study make."""

from __future__ import annotations

from roughvol.store.variable import Variable, rows

ROWS = rows(
    "study.axes.axes_of",
    E_star=Variable("E_star", "1", "contact modulus", "E*"),
    E=Variable("E", "1", "Young's modulus", "E"),
    nu=Variable("nu", "1", "Poisson's ratio", "ν"),
    hardness=Variable("hardness", "1", "hardness; infinite for elastic contact", "H"),
    low_pass=Variable("low_pass", "1", "cut-off wavelength of the low-pass filter; 0: no filter", "λ_c"),
    material=Variable("material", "1", "material", "material", "text"),
    level=Variable("level", "1", "surface subtracted from the heights", "level", "text"),
    to=Variable("to", "1", "last state of the sweep", "to", "text"),
    region=Variable("region", "1", "region observed", "region", "text"),
)
"""Rows of the table for the coordinates of all axes."""
