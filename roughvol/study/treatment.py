"""What is done to measured heights before they are pressed: the keys of a study, and what they leave of the lattice.

The order is fixed. A crop comes first, so that nothing outside it counts. Outliers are looked for at the nodes of the
instrument, before block means or a spline would spread them. Then the lattice is made (``downsample``, ``resample``),
and only its heights are levelled, filled and filtered.

Lengths and shares are turned into nodes here, so that equal nodes have one case id however a study names them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NoReturn, Protocol

from pydantic import Field, field_validator

from roughvol.errors import Problem, StudyError
from roughvol.study.sections import Strict, refuse
from roughvol.study.units import In, Length, unit_of
from roughvol.study.yaml_text import number_text
from roughvol.surfaces.body import Levelling, Missing, Nodes, Resampling, Treatment
from roughvol.surfaces.length_units import factor

SQUARE = 1e-4  # by which the sides of a pixel may differ: a tenth of one over a thousand
MOST_OBLONG = 2.0  # ratio of the sides of a pixel up to which a map is resampled
FEWEST = 3  # nodes along an axis
ROUNDING = 1e-9  # of a position over the length of its axis

Place = Annotated[float, Field(ge=0), In("length")]


class Crop(Strict):
    """A rectangle of a measured map: by shares of its sides, or by lengths with a unit."""

    x: tuple[Place, Place] = Field(
        default=(0.0, 1.0),
        description="[from, to] along the first axis: shares 0 <= from < to <= 1, or lengths as [10 um, 30 um]",
    )
    y: tuple[Place, Place] = Field(
        default=(0.0, 1.0),
        description="[from, to] along the second axis: shares 0 <= from < to <= 1, or lengths as [10 um, 30 um]",
    )

    @field_validator("x", "y", mode="before")
    @classmethod
    def _two(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple) or len(value) != 2:
            refuse("must be two places, [from, to]")
        return tuple(value)

    @field_validator("x", "y")
    @classmethod
    def _alike(cls, value: tuple[float, float]) -> tuple[float, float]:
        units = [unit_of(place) for place in value]
        for place, unit in zip(value, units, strict=True):
            if unit is None and place > 1:
                refuse("{place} is no share of the side, 0 to 1; a length has a unit", place=number_text(place))
            if unit is None and any(units) and place not in (0.0, 1.0):
                refuse("{place} has no unit and the other place has one", place=number_text(place))
        if units[0] == units[1] and value[0] >= value[1]:
            refuse("must rise, from < to")
        return value


class Outliers(Strict):
    """Single heights that no surface has: far from the median of their neighbourhood."""

    sigma: Annotated[float, Field(ge=3, le=1000)] = Field(
        default=6.0, description="distance from the local median in robust standard deviations of the map, 3 to 1000"
    )
    window: Annotated[int, Field(ge=3, le=101)] = Field(
        default=5, description="nodes a side of the neighbourhood, odd, 3 to 101"
    )

    @field_validator("window")
    @classmethod
    def _odd(cls, value: int) -> int:
        if value % 2 == 0:
            refuse("must be odd, so that the node is in the middle")
        return value


@dataclass(frozen=True)
class Lattice:
    """Nodes of a map along x and y, and the side of its pixels along x and along y."""

    shape: tuple[int, int]
    pixel: tuple[float, float]

    @property
    def ratio(self) -> float:
        """Side of the pixels along y over that along x."""
        return self.pixel[1] / self.pixel[0]

    @property
    def L(self) -> float:
        """Length of the first axis."""
        return self.pixel[0] * (self.shape[0] - 1)


@dataclass(frozen=True)
class File:
    """One file of heights, and the lengths of its axes along x and along y where it gives them, in any one unit."""

    path: Path
    sides: tuple[float, float] | None


class Keys(Protocol):
    """The keys of the section ``surface`` that this module is about."""

    level: Levelling
    missing: Missing
    low_pass: Length | None
    crop: Crop | None
    outliers: Outliers | None
    downsample: int
    resample: Resampling


def steps(treatment: Treatment, unit: str | None) -> list[str]:
    """Return what is done, one sentence a step in the order of the steps; lengths in the unit of the study."""
    done = []
    if treatment.crop is not None:
        done.append(
            "cropped to nodes {} to {} along x and {} to {} along y".format(*treatment.crop[0], *treatment.crop[1])
        )
    if treatment.outliers is not None:
        sigma, window = treatment.outliers
        done.append(
            f"heights farther than {number_text(sigma)} robust deviations from the median of {window} x {window} "
            "nodes taken out" + (" and filled with the mean of their neighbours" * (treatment.missing == "refuse"))
        )
    if treatment.downsample != 1:
        done.append(f"means of {treatment.downsample} x {treatment.downsample} nodes taken")
    if treatment.resample != "none":
        done.append("heights interpolated onto square pixels of the finer spacing by cubic splines")
    if treatment.level != "none":
        done.append(f"least-squares {treatment.level} of the known heights taken off")
    if treatment.missing != "refuse":
        filling = {"nearest": "the nearest known one", "interpolate": "the mean of their neighbours"}[treatment.missing]
        done.append(f"missing heights filled with {filling}")
    if treatment.low_pass is not None:
        cut_off = f"{number_text(treatment.low_pass)} {unit or ''}".rstrip()
        done.append(
            f"waves shorter than {cut_off} taken off by the Gaussian filter of ISO 16610-61, "
            "its weights renormalised at the edges"
        )
    return done


def settled(
    surface: Keys, files: Sequence[File], shape: Callable[[int], tuple[int, int]], L: float, unit: str | None
) -> tuple[Treatment, float, list[float | None]]:
    """Return the treatment in nodes, the length that is left, and for each file the ratio of the sides of its pixels.

    Parameters
    ----------
    surface : Keys
        The section of the study.
    files : sequence of File
        The one file or the two.
    shape : callable
        Returns the nodes of a file, given its place in the sequence. It may have to read the file, so it is called
        only where the treatment changes the lattice, or the file gives the lengths of its axes.
    L : float
        Length of the first axis of the first file in the unit of the study.
    unit : str or None
        Unit of all lengths.

    Returns
    -------
    treatment : Treatment
        Treatment of each file, places as node numbers.
    L : float
        Length of the first axis of the lattice that is pressed.
    ratios : list of float or None
        Side of the pixels along y over that along x; None where they are not resampled.

    Raises
    ------
    StudyError
        If pixels are off square, a crop or block means leave too few nodes, or two files differ in their nodes.
    """
    low_pass = None if surface.low_pass is None else in_unit_of_study(surface.low_pass, unit, "surface.low_pass")
    outliers = None if surface.outliers is None else (surface.outliers.sigma, surface.outliers.window)
    plain = Treatment(surface.level, surface.missing, low_pass, outliers=outliers)
    changed = surface.crop is not None or surface.downsample != 1 or surface.resample != "none"
    lattices = []
    for place, file in enumerate(files):
        if file.sides is None and surface.resample != "none":
            wrong(f"{file.path} does not give the sides of its pixels", _RESAMPLE)
        if file.sides is None and not changed:
            continue
        nodes = shape(place)
        x, y = (1.0, 1.0) if file.sides is None else (file.sides[axis] / (nodes[axis] - 1) for axis in (0, 1))
        pixel = L / (nodes[0] - 1)
        lattices.append(Lattice(nodes, (pixel, pixel * (y / x))))
        check_pixels(lattices[-1], surface.resample, str(file.path), unit)
        if changed and nodes != lattices[0].shape:
            message = f"{file.path} has {nodes} nodes; allowed: {lattices[0].shape}, as {files[0].path} has"
            wrong(message, "surface.against.file")
    if not changed:
        return plain, L, [None] * len(files)
    kept = nodes_kept(surface.crop, surface.downsample, lattices[0], unit)
    if kept is None and surface.downsample == 1 and surface.resample == "none":
        return plain, L, [None] * len(files)  # L to the last bit, as without a crop
    left = after(lattices[0], kept, surface.downsample, surface.resample)
    treatment = replace(plain, crop=kept, downsample=surface.downsample, resample=surface.resample)
    ratios = [one.ratio if surface.resample != "none" else None for one in lattices]
    return treatment, left.L, ratios


def nodes_kept(crop: Crop | None, downsample: int, lattice: Lattice, unit: str | None) -> Nodes | None:
    """Return the first and the last node kept along each axis, None for all of them.

    Kept are nodes in the rectangle, its border included. Of these, the last ones that fill no block are left out.

    Raises
    ------
    StudyError
        If the rectangle reaches beyond the map, has lengths where the study has no unit, or too few nodes are kept.
    """
    kept = []
    for axis, nodes, pixel in zip(("x", "y"), lattice.shape, lattice.pixel, strict=True):
        places: tuple[float, float] = (0.0, 1.0) if crop is None else getattr(crop, axis)
        key = f"surface.crop.{axis}"
        start, end = (_node(place, nodes, pixel, unit, key) for place in places)
        first, last = math.ceil(start - ROUNDING * nodes), math.floor(end + ROUNDING * nodes)
        count = (last - first + 1) // downsample
        if count < FEWEST:
            key = key if downsample == 1 else "surface.downsample"
            blocks = "nodes" if downsample == 1 else f"means of {downsample} x {downsample} nodes"
            wrong(f"leaves {max(count, 0)} {blocks} along {axis} of {nodes} nodes; allowed: at least {FEWEST}", key)
        kept.append((first, first + count * downsample - 1))
    whole = all(pair == (0, nodes - 1) for pair, nodes in zip(kept, lattice.shape, strict=True))
    return None if whole else (kept[0], kept[1])


def after(lattice: Lattice, nodes: Nodes | None, downsample: int, resample: Resampling) -> Lattice:
    """Return the lattice that is left by a crop, block means and resampling, in this order."""
    rows, columns = lattice.shape if nodes is None else (last - first + 1 for first, last in nodes)
    rows, columns, (x, y), ratio = rows // downsample, columns // downsample, lattice.pixel, lattice.ratio
    x, y = x * downsample, y * downsample
    if resample == "square" and ratio > 1.0:
        columns, y = resampled_nodes(columns, ratio), x
    elif resample == "square":
        rows, x = resampled_nodes(rows, 1.0 / ratio), y
    return Lattice((rows, columns), (x, y))


def resampled_nodes(nodes: int, ratio: float) -> int:
    """Return how many nodes fit between the first and the last of an axis whose spacing is divided by a ratio."""
    return math.floor((nodes - 1) * ratio + ROUNDING * nodes) + 1


def check_pixels(lattice: Lattice, resample: Resampling, file: str, unit: str | None) -> None:
    """Refuse pixels that are off square, unless the study has them resampled and they are not too oblong.

    Raises
    ------
    StudyError
        With the sides of the pixels and what is allowed.
    """
    sides = f"{file} has pixels of {lattice.pixel[0]:.6g} by {lattice.pixel[1]:.6g} {unit or ''}".rstrip()
    if not 1.0 / MOST_OBLONG <= lattice.ratio <= MOST_OBLONG:
        wrong(f"{sides}; allowed: one side up to {MOST_OBLONG:g} times the other", _RESAMPLE)
    if resample == "none" and abs(lattice.ratio - 1.0) > SQUARE:
        wrong(f"missing: {sides}; allowed without it: square pixels, to {SQUARE:g}; give resample: square", _RESAMPLE)


_RESAMPLE = "surface.resample"


def in_unit_of_study(length: Length, unit: str | None, key: str) -> float:
    """Return a length of the treatment in the unit of the study; a plain number is in it already.

    Raises
    ------
    StudyError
        If it has a unit and the study has none.
    """
    own = unit_of(length)
    if own is None:
        return float(length)
    if unit is None:
        wrong(f"has a unit ({length}) and L has none: give both with theirs, as L: 100 um", key)
    return float(length) * factor(own, unit)


def _node(place: float, nodes: int, pixel: float, unit: str | None, key: str) -> float:
    """Return a place as a number of nodes from the first."""
    if unit_of(place) is None:
        return place * (nodes - 1)
    node = in_unit_of_study(place, unit, key) / pixel
    if node > (nodes - 1) * (1.0 + ROUNDING):
        wrong(f"reaches to {place}; allowed: up to {pixel * (nodes - 1):.6g} {unit}, the side of the map", key)
    return node


def wrong(message: str, key: str) -> NoReturn:
    """Raise a problem of one key."""
    raise StudyError([Problem(message, key)])
