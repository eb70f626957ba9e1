"""The record of a rough surface: heights on a square lattice, checked once.

Conventions: heights z are positive up, axis 0 is x and axis 1 is y, the nodes are δ = ``spacing`` apart on both axes.
"""

from __future__ import annotations

import contextlib
import math
import operator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import SupportsIndex, get_args

import numpy as np
from numpy.typing import ArrayLike

from roughvol.errors import RoughvolError, SurfaceError
from roughvol.spellings import arguments
from roughvol.typing import Array, Sides

SMALLEST_RANGE = 1e-290  # of heights that are not flat: below, their differences are denormal and Sq loses its digits
BEYOND: dict[Sides, str] = {
    "free": "nothing beyond them, so the rim carries more than the middle",
    "mirrored": "the surface and its mirror images make an endless plane",
    "periodic": "the periods of the surface make an endless plane",
}
"""What follows beyond the sides of a surface, in words."""


class Sided:
    """A record with the sides of a surface."""

    sides: Sides

    @property
    def periodic(self) -> bool:
        """Whether the surface is one period of a plane: opposite sides are joined."""
        return self.sides == "periodic"

    @property
    def endless(self) -> bool:
        """Whether the surface goes on beyond its sides, as a period or mirrored: it has no rim."""
        return self.sides != "free"


@arguments
@dataclass(frozen=True, eq=False)
class Surface(Sided):
    """A height field z on a lattice of spacing δ, checked once and read-only from then on.

    Attributes
    ----------
    heights : array_like, shape (rows, columns), both at least 3
        Heights z [length], positive up, finite. They are copied.
    spacing : float
        Distance δ of neighbouring nodes [length], the same on both axes, finite and positive.
    filled : int
        How many of the heights were not measured but filled in.
    outliers : int
        How many measured heights were taken out as outliers.
    peak_before : float, optional
        `peak` of the surface with its outliers, where outliers were looked for.
    sides : {"free", "mirrored", "periodic"}
        Beyond the sides: nothing, the mirror image at the outer edges of the elements, or the next period, without a
        repeated edge.

    Raises
    ------
    SurfaceError
        If the heights are not a real, finite 2-D array of at least 3 × 3 nodes. If their range is no float, or between
        0 and `SMALLEST_RANGE`. If δ is not finite and positive. If the sides are not known.

    See Also
    --------
    roughvol.surfaces.random_midpoint_displacement, roughvol.surfaces.power_law_surface : Return random surfaces.

    Examples
    --------
    >>> import numpy as np
    >>> from roughvol.surfaces import Surface
    >>> waves = Surface(np.cos(np.arange(8) * np.pi / 4) * np.ones((8, 1)), spacing=0.5, sides="periodic")
    >>> waves.side, round(waves.Sq, 4), round(waves.peak, 4)
    (4.0, 0.7071, 1.4142)
    """

    heights: Array
    spacing: float
    filled: int = 0
    outliers: int = 0
    peak_before: float | None = None
    sides: Sides = "free"

    def __post_init__(self) -> None:
        object.__setattr__(self, "heights", _checked_heights(self.heights))
        object.__setattr__(self, "spacing", positive("spacing", self.spacing))
        if self.sides not in get_args(Sides):
            raise SurfaceError(f"sides is {self.sides!r}; allowed: {', '.join(get_args(Sides))}")

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle through the constructor: a plain pickle would bring the heights back writable."""
        return (Surface, (self.heights, self.spacing, self.filled, self.outliers, self.peak_before, self.sides))

    @property
    def shape(self) -> tuple[int, int]:
        """Number of nodes along x and y."""
        rows, columns = self.heights.shape
        return rows, columns

    @property
    def intervals(self) -> tuple[int, int]:
        """Spacings along the sides: one less than the nodes, and as many on a periodic surface."""
        rows, columns = self.shape
        return intervals(rows, self.periodic), intervals(columns, self.periodic)

    @property
    def with_neighbours(self) -> Array:
        """Heights, with one line of the next period on each side of a periodic surface."""
        return with_neighbours(self.heights, self.periodic)

    @property
    def side(self) -> float:
        """Length of the first axis, L = δ (rows - 1), or the period δ rows [length]."""
        return self.spacing * self.intervals[0]

    @cached_property
    def z_max(self) -> float:
        """Highest height [length]: where a flat half space touches first."""
        return float(self.heights.max())

    @cached_property
    def z_min(self) -> float:
        """Lowest height [length]."""
        return float(self.heights.min())

    @cached_property
    def mean_height(self) -> float:
        """Height of the mean plane, z̄ = mean(z) [length]."""
        return self._moments[0]

    @cached_property
    def Sq(self) -> float:
        """Root mean square of the heights about their mean plane, Sq = √mean((z - z̄)²) [length] (ISO 25178-2).

        Heights of any scale are brought to unit range first, because the squares of 1e-250 underflow.
        """
        return self._moments[1]

    @property
    def unit(self) -> float:
        """Unit of dimensionless heights and gaps: Sq, or 1 if the surface is flat [length]."""
        return self.Sq or 1.0

    def scaled(self, Sq: float) -> Surface:
        """Return the surface with its heights multiplied so that their root mean square is ``Sq`` [length]."""
        if self.Sq == 0.0:
            raise SurfaceError("the surface is flat, Sq is 0: its heights have no scale")
        return replace(self, heights=self.heights * (positive("Sq", Sq) / self.Sq))

    @property
    def peak(self) -> float:
        """Highest point above the mean plane over Sq, (z_max - z̄)/Sq; NaN if the surface is flat."""
        return (self.z_max - self.mean_height) / self.Sq if self.Sq > 0.0 else math.nan

    @property
    def pit(self) -> float:
        """Lowest point above the mean plane over Sq, (z_min - z̄)/Sq, negative; NaN if the surface is flat."""
        return (self.z_min - self.mean_height) / self.Sq if self.Sq > 0.0 else math.nan

    @cached_property
    def _moments(self) -> tuple[float, float]:
        unit, exponent, mean_height = about_mean_plane(self.heights)
        return mean_height, math.ldexp(root_mean_square(unit), exponent)


def intervals(nodes: int, periodic: bool) -> int:
    """Return the spacings along an axis: one less than its nodes, and as many where the next period follows."""
    return nodes if periodic else nodes - 1


def with_neighbours(heights: Array, periodic: bool) -> Array:
    """Return heights with one line of the next period on each side; those of a patch unchanged."""
    return np.pad(heights, 1, mode="wrap") if periodic else heights


def about_mean_plane(heights: Array) -> tuple[Array, int, float]:
    """Return heights about their mean plane divided by 2^e, of range at most 1, then e, and the mean height."""
    top = float(heights.max())
    # A power of two, so that scaling is exact and Sq(2^k z) = 2^k Sq(z) to the last bit.
    exponent = math.frexp(top - float(heights.min()))[1]
    unit = np.ldexp(heights - top, -exponent)
    mean = float(unit.mean())
    unit -= mean
    return unit, exponent, top + math.ldexp(mean, exponent)


def root_mean_square(values: Array) -> float:
    """Return √mean(values²)."""
    return math.sqrt(float(np.mean(np.square(values))))


def _checked_heights(heights: ArrayLike) -> Array:
    """Return a read-only, C-contiguous copy of the heights, or refuse them with the reason."""
    masked = int(np.ma.count_masked(heights)) if isinstance(heights, np.ma.MaskedArray) else 0
    if masked:
        raise SurfaceError(f"heights must be known at every node, {masked} are masked")
    try:
        given = np.asarray(heights)
    except ValueError as error:  # rows of unequal length
        raise SurfaceError(f"heights must be a 2-D array of numbers: {error}") from error
    if given.dtype.kind not in "fiub" or given.ndim != 2 or min(given.shape) < 3:
        allowed = "real numbers, 2-D with at least 3 nodes per axis"
        raise SurfaceError(f"heights must be {allowed}, got {given.dtype} of shape {given.shape}")
    checked = np.array(given, dtype=np.float64, order="C")
    bad = ~np.isfinite(checked)
    if bad.any():
        row, column = np.argwhere(bad)[0].tolist()
        first = f"the first at [{row}, {column}] ({checked[row, column]})"
        raise SurfaceError(f"heights must be finite, got {int(bad.sum())} NaN or infinite out of {bad.size}, {first}")
    height_range = float(checked.max()) - float(checked.min())
    if not math.isfinite(height_range):
        raise SurfaceError(f"heights must have a finite range, got {checked.min():.3g} … {checked.max():.3g}")
    if 0.0 < height_range < SMALLEST_RANGE:
        message = f"the range of the heights is {height_range:.3g}; allowed: 0 (flat), or at least {SMALLEST_RANGE:g}"
        raise SurfaceError(message)
    checked.flags.writeable = False
    return checked


def real(name: str, value: float, refused: type[RoughvolError] = SurfaceError) -> float:
    """Return a value as a float, or refuse anything but a real number, text and complex numbers included."""
    with contextlib.suppress(TypeError, ValueError, OverflowError):
        if np.asarray(value).dtype.kind not in "SUc":
            return float(value)
    raise refused(f"{name} must be a number, got {value!r}")


def positive(name: str, value: float) -> float:
    """Return a value as a float, or refuse one that is not finite and positive."""
    number = real(name, value)
    if not (math.isfinite(number) and number > 0.0):
        raise SurfaceError(f"{name} must be finite and positive, got {value!r}")
    return number


def whole(name: str, value: SupportsIndex, lowest: int, highest: float = math.inf) -> int:
    """Return a whole number of Python or numpy as an integer, or refuse other values and those outside its interval."""
    with contextlib.suppress(TypeError):
        if lowest <= (number := operator.index(value)) <= highest:
            return number
    allowed = f"an integer >= {lowest}" if highest == math.inf else f"an integer in [{lowest}, {highest}]"
    raise SurfaceError(f"{name} must be {allowed}, got {value!r}")
