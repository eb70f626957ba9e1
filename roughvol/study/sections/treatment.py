"""Treatment of measured heights before contact: keys of a study, and the resulting lattice.

The order is fixed. First a crop: heights outside have no effect. Then outliers, at the nodes of the instrument, before
block means or splines spread them. Then ``downsample`` and ``resample`` make the lattice. Its heights are levelled,
filled and filtered.

Lengths and shares become nodes here: equal nodes have one case id.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from roughvol.study.plain_data import number_text
from roughvol.study.python_data import refused
from roughvol.study.sections.height_file import Crop, HeightFile
from roughvol.study.values.units import Length, in_unit, unit_of
from roughvol.surfaces.body import Nodes, Resampling, Treatment

if TYPE_CHECKING:
    from roughvol.surfaces.files.description import Description

SQUARE = 1e-4  # relative difference of the sides of a square pixel: a tenth of a pixel over a thousand
MOST_OBLONG = 2.0  # largest ratio of the sides of a pixel for resampling
FEWEST = 3  # nodes along an axis
ROUNDING = 1e-9  # of a position over the length of its axis


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


def steps(treatment: Treatment, unit: str | None) -> list[str]:
    """Return the steps in words, in their order; lengths in the unit of the study."""
    texts = []
    if (crop := treatment.crop) is not None:
        texts.append("cropped to nodes {} to {} along x and {} to {} along y".format(*crop[0], *crop[1]))
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
    surface: HeightFile, descriptions: Sequence[Description], L: float, unit: str | None
) -> tuple[Treatment, float, tuple[int, int], list[float | None]]:
    """Return the treatment in nodes, the remaining length and nodes, and the pixel ratio of each file."""
    low_pass = None if surface.low_pass is None else in_unit_of_study(surface.low_pass, unit, "surface.low_pass")
    outliers = None if surface.outliers is None else (surface.outliers.sigma, surface.outliers.window)
    plain = Treatment(surface.level, surface.missing, low_pass, outliers=outliers)
    downsample, resample = surface.downsample, surface.resample
    changed = surface.crop is not None or downsample != 1 or resample != "none"
    lattices = []
    for body, description in zip(surface.bodies, descriptions, strict=True):
        nodes, lengths = description.shape, description.sides
        if lengths is None and resample != "none":
            raise refused(f"{body.file} does not give the sides of its pixels", _RESAMPLE)
        x, y = (1.0, 1.0) if lengths is None else (length / (n - 1) for length, n in zip(lengths, nodes, strict=True))
        pixel = L / (nodes[0] if surface.periodic else nodes[0] - 1)
        lattices.append(Lattice(nodes, (pixel, pixel * (y / x))))
        check_pixels(lattices[-1], resample, body.file, unit)
        if nodes != lattices[0].shape:
            first = f"{lattices[0].shape}, as in {surface.file}"
            raise refused(f"{body.file} has {nodes} nodes; allowed: {first}", "surface.against.file")
    if changed and surface.periodic and any(nodes % downsample for nodes in lattices[0].shape):
        rows, columns = lattices[0].shape
        period = f"a period of {rows} x {columns} nodes; allowed: {math.gcd(rows, columns)} and its divisors"
        raise refused(f"blocks of {downsample} x {downsample} nodes do not fill {period}", "surface.downsample")
    kept = nodes_kept(surface.crop, downsample, lattices[0], unit) if changed else None
    if kept is None and downsample == 1 and resample == "none":
        return plain, L, lattices[0].shape, [None] * len(descriptions)  # L exactly as without a crop
    left = after(lattices[0], kept, downsample, resample)
    treatment = replace(plain, crop=kept, downsample=downsample, resample=resample)
    ratios = [lattice.ratio if resample != "none" else None for lattice in lattices]
    return treatment, L if surface.periodic else left.L, left.shape, ratios


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
            left = f"{max(count, 0)} {'node' if downsample == 1 else 'mean'}{'s' * (count != 1)}"
            left += f" of {downsample} x {downsample} nodes" * (downsample != 1)
            raise refused(f"leaves {left} along {axis} of {nodes} nodes; allowed: at least {FEWEST}", key)
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
        raise refused(f"{sides}; allowed: one side up to {MOST_OBLONG:g} times the other", _RESAMPLE)
    if resample == "none" and abs(lattice.ratio - 1.0) > SQUARE:
        raise refused(f"missing: {sides}; allowed: square pixels, to {SQUARE:g}; give resample: square", _RESAMPLE)


_RESAMPLE = "surface.resample"


def in_unit_of_study(length: Length, unit: str | None, key: str) -> float:
    """Return a length of the treatment in the unit of the study; a plain number is in that unit."""
    if unit is None and unit_of(length):
        raise refused(f"has a unit ({length}) and L has none: give L with its unit, as L: 100 um", key)
    return float(in_unit(length, unit))


def _node(position: float, nodes: int, pixel: float, unit: str | None, key: str) -> float:
    """Return a position in nodes from the first."""
    if unit_of(position) is None:
        return position * (nodes - 1)
    node = in_unit_of_study(position, unit, key) / pixel
    if node > (nodes - 1) * (1.0 + ROUNDING):
        side = f"{pixel * (nodes - 1):.6g} {unit}, the side of the map"
        raise refused(f"reaches to {position}; allowed: up to {side}", key)
    return node
