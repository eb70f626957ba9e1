"""Types of arrays that every room uses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, SupportsFloat

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]
Shape = tuple[int, int]
"""Rows and columns of a grid."""
Sides = Literal["free", "mirrored", "periodic"]
"""Beyond the sides of a surface: nothing, its mirror image, or its next period."""
Map = Callable[[NDArray[Any]], NDArray[Any]]
"""A linear map of vectors."""
Number = str | SupportsFloat
"""A number of Python or numpy, text with a unit as ``"10 MPa"``, or a quantity of pint."""
Load = str | Mapping[str, Any]
"""A state of a sweep, as ``"pressure=0.5 MPa, leg 2"`` or ``{"pressure": "0.5 MPa", "leg": 2}``."""
Loads = Load | Sequence[Load]
"""One load or several."""
Changes = str | Sequence[str] | Mapping[str, Any]
"""Other values of keys of a study, as ``{"surface.m": 6}`` or ``"surface.m=6"``."""
