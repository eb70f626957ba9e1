"""Types of arrays that every room uses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

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
