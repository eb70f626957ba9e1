"""Treatment of measured heights before contact: keys of a study, and the resulting lattice.

The order is fixed. First a crop: heights outside have no effect. Then outliers, at the nodes of the instrument, before
block means or splines spread them. Then ``downsample`` and ``resample`` make the lattice. Its heights are levelled,
filled and filtered.

Lengths and shares become nodes here: equal nodes have one case id.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NoReturn, Protocol

from pydantic import Field, field_validator

from roughvol.errors import Problem, StudyError
from roughvol.study.sections.strict import Strict
from roughvol.study.values.units import In, Length, unit_of
from roughvol.study.values.words import refuse
from roughvol.study.yaml_text import number_text
from roughvol.surfaces.body import Levelling, Missing, Nodes, Resampling, Treatment
from roughvol.surfaces.length_units import factor

SQUARE = 1e-4  # relative difference of the sides of a square pixel: a tenth of a pixel over a thousand
MOST_OBLONG = 2.0  # largest ratio of the sides of a pixel for resampling
FEWEST = 3  # nodes along an axis
ROUNDING = 1e-9  # of a position over the length of its axis

Position = Annotated[float, Field(ge=0), In("length")]


class Crop(Strict):
    """A rectangle of a measured map, as shares of its sides or lengths with a unit."""

    x: tuple[Position, Position] = Field(
        default=(0.0, 1.0),
        description="[from, to] along the first axis: shares 0 <= from < to <= 1, or lengths as [10 um, 30 um]",
    )
    y: tuple[Position, Position] = Field(
        default=(0.0, 1.0),
        description="[from, to] along the second axis: shares 0 <= from < to <= 1, or lengths as [10 um, 30 um]",
    )

    @field_validator("x", "y", mode="before")
    @classmethod
    def _two(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple) or len(value) != 2:
            refuse("must be two positions, [from, to]")
        return tuple(value)

    @field_validator("x", "y")
    @classmethod
    def _alike(cls, value: tuple[float, float]) -> tuple[float, float]:
        units = [unit_of(position) for position in value]
        for position, unit in zip(value, units, strict=True):
            number = number_text(position)
            if unit is None and position > 1:
                refuse("{number} is no share of the side, 0 to 1; a length has a unit", number=number)
            if unit is None and any(units) and position not in (0.0, 1.0):
                refuse("{number} has no unit and the other position has one", number=number)
        if units[0] == units[1] and value[0] >= value[1]:
            refuse("must rise, from < to")
        return value


class Outliers(Strict):
    """Single heights far from the median of their neighbourhood."""

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
            refuse("must be odd: the node is in the middle")
        return value


@dataclass(frozen=True)
class Lattice:
    """Nodes of a map and sides of its pixels, each along x and y."""

    shape: tuple[int, int]
    pixel: tuple[float, float]

    @property
    def ratio(self) -> float:
        """Pixel side along y over that along x."""
        return self.pixel[1] / self.pixel[0]

    @property
    def L(self) -> float:
        """Length of the first axis."""
        return self.pixel[0] * (self.shape[0] - 1)


@dataclass(frozen=True)
class File:
    """A height file, and the lengths of its axes x and y in any one unit; None without."""

    path: Path
    sides: tuple[float, float] | None


class Keys(Protocol):
    """Keys of the section ``surface`` for the treatment."""

    level: Levelling
    missing: Missing
    low_pass: Length | None
    crop: Crop | None
    outliers: Outliers | None
    downsample: int
    resample: Resampling


def steps(treatment: Treatment, unit: str | None) -> list[str]:
    """Return the steps in words, in their order; lengths in the unit of the study."""
    texts = []
    if treatment.crop is not None:
        texts.append(
            "cropped to nodes {} to {} along x and {} to {} along y".format(*treatment.crop[0], *treatment.crop[1])
        )
    if treatment.outliers is not None:
        sigma, window = treatment.outliers
        texts.append(
            f"heights farther than {number_text(sigma)} robust deviations from the median of {window} x {window} "
            "nodes removed" + (" and filled with the mean of their neighbours" * (treatment.missing == "refuse"))
        )
    if treatment.downsample != 1:
        texts.append(f"means of {treatment.downsample} x {treatment.downsample} nodes taken")
    if treatment.resample != "none":
        texts.append("heights interpolated onto square pixels of the finer spacing by cubic splines")
    if treatment.level != "none":
        texts.append(f"least-squares {treatment.level} of the known heights subtracted")
    if treatment.missing != "refuse":
        filling = {"nearest": "the nearest known one", "interpolate": "the mean of their neighbours"}[treatment.missing]
        texts.append(f"missing heights filled with {filling}")
    if treatment.low_pass is not None:
        cut_off = f"{number_text(treatment.low_pass)} {unit or ''}".rstrip()
        texts.append(
            f"waves shorter than {cut_off} removed by the Gaussian filter of ISO 16610-61, "
            "its weights renormalised at the edges"
        )
    return texts


def settled(
    surface: Keys, files: Sequence[File], shape: Callable[[int], tuple[int, int]], L: float, unit: str | None
) -> tuple[Treatment, float, list[float | None]]:
    """Return the treatment in nodes, the remaining length, and the pixel ratio of each file."""
    low_pass = None if surface.low_pass is None else in_unit_of_study(surface.low_pass, unit, "surface.low_pass")
    outliers = None if surface.outliers is None else (surface.outliers.sigma, surface.outliers.window)
    plain = Treatment(surface.level, surface.missing, low_pass, outliers=outliers)
    changed = surface.crop is not None or surface.downsample != 1 or surface.resample != "none"
    lattices = []
    for index, file in enumerate(files):
        if file.sides is None and surface.resample != "none":
            wrong(f"{file.path} does not give the sides of its pixels", _RESAMPLE)
        if file.sides is None and not changed:
            continue
        nodes = shape(index)
        x, y = (1.0, 1.0) if file.sides is None else (file.sides[axis] / (nodes[axis] - 1) for axis in (0, 1))
        pixel = L / (nodes[0] - 1)
        lattices.append(Lattice(nodes, (pixel, pixel * (y / x))))
        check_pixels(lattices[-1], surface.resample, str(file.path), unit)
        if changed and nodes != lattices[0].shape:
            message = f"{file.path} has {nodes} nodes; allowed: {lattices[0].shape}, as in {files[0].path}"
            wrong(message, "surface.against.file")
    if not changed:
        return plain, L, [None] * len(files)
    kept = nodes_kept(surface.crop, surface.downsample, lattices[0], unit)
    if kept is None and surface.downsample == 1 and surface.resample == "none":
        return plain, L, [None] * len(files)  # L exactly as without a crop
    left = after(lattices[0], kept, surface.downsample, surface.resample)
    treatment = replace(plain, crop=kept, downsample=surface.downsample, resample=surface.resample)
    ratios = [lattice.ratio if surface.resample != "none" else None for lattice in lattices]
    return treatment, left.L, ratios


def nodes_kept(crop: Crop | None, downsample: int, lattice: Lattice, unit: str | None) -> Nodes | None:
    """Return the first and the last node kept along each axis, None for all nodes.

    Nodes in the rectangle and on its border are kept, except the last ones that fill no block.
    """
    kept = []
    for axis, nodes, pixel in zip(("x", "y"), lattice.shape, lattice.pixel, strict=True):
        positions: tuple[float, float] = (0.0, 1.0) if crop is None else getattr(crop, axis)
        key = f"surface.crop.{axis}"
        start, end = (_node(position, nodes, pixel, unit, key) for position in positions)
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
    """Return the lattice after a crop, block means and resampling, in this order."""
    rows, columns = lattice.shape if nodes is None else (last - first + 1 for first, last in nodes)
    rows, columns, (x, y), ratio = rows // downsample, columns // downsample, lattice.pixel, lattice.ratio
    x, y = x * downsample, y * downsample
    if resample == "square" and ratio > 1.0:
        columns, y = resampled_nodes(columns, ratio), x
    elif resample == "square":
        rows, x = resampled_nodes(rows, 1.0 / ratio), y
    return Lattice((rows, columns), (x, y))


def resampled_nodes(nodes: int, ratio: float) -> int:
    """Return the number of nodes of an axis after division of its spacing by a ratio."""
    return math.floor((nodes - 1) * ratio + ROUNDING * nodes) + 1


def check_pixels(lattice: Lattice, resample: Resampling, file: str, unit: str | None) -> None:
    """Refuse pixels that are neither square nor resampled, and pixels too oblong to resample."""
    sides = f"{file} has pixels of {lattice.pixel[0]:.6g} by {lattice.pixel[1]:.6g} {unit or ''}".rstrip()
    if not 1.0 / MOST_OBLONG <= lattice.ratio <= MOST_OBLONG:
        wrong(f"{sides}; allowed: one side up to {MOST_OBLONG:g} times the other", _RESAMPLE)
    if resample == "none" and abs(lattice.ratio - 1.0) > SQUARE:
        wrong(f"missing: {sides}; allowed without it: square pixels, to {SQUARE:g}; give resample: square", _RESAMPLE)


_RESAMPLE = "surface.resample"


def in_unit_of_study(length: Length, unit: str | None, key: str) -> float:
    """Return a length of the treatment in the unit of the study; a plain number is in that unit."""
    own = unit_of(length)
    if own is None:
        return float(length)
    if unit is None:
        wrong(f"has a unit ({length}) and L has none: give L with its unit, as L: 100 um", key)
    return float(length) * factor(own, unit)


def _node(position: float, nodes: int, pixel: float, unit: str | None, key: str) -> float:
    """Return a position in nodes from the first."""
    if unit_of(position) is None:
        return position * (nodes - 1)
    node = in_unit_of_study(position, unit, key) / pixel
    if node > (nodes - 1) * (1.0 + ROUNDING):
        wrong(f"reaches to {position}; allowed: up to {pixel * (nodes - 1):.6g} {unit}, the side of the map", key)
    return node


def wrong(message: str, key: str) -> NoReturn:
    """Raise a problem of one key."""
    raise StudyError([Problem(message, key)])
