"""Element volumes for figures: the state that a figure shows of them, their densities, and labels with units."""

from __future__ import annotations

from typing import Any

import numpy as np
from xarray import Dataset

from roughvol.analysis.units import sigma
from roughvol.gap.free_volume import element_volumes
from roughvol.report.figures.families import Curve, Family, own, single
from roughvol.report.figures.style import A, P, unit_text
from roughvol.reproduction.claims.evidence import paper_state
from roughvol.typing import Array, Mask

ENOUGH = 25  # elements in a bin of a density: a fifth of noise
PER_DECADE = 12  # bins on a logarithmic axis at most


def state(ds: Dataset, at: str, *variables: str) -> tuple[Dataset, str, str]:
    """Return the single case at its recorded state (along `at`) nearest to A* = 0.1, and both in words."""
    case, name = single(ds, *variables)
    chosen = paper_state(case, at)
    of_region = " in the region" * ("region" in ds.attrs)
    return chosen, name, rf"$A^{{\ast}} = {float(chosen[A]):.3f}$, $p^{{\ast}} = {float(chosen[P]):.2f}${of_region}"


def volumes(ds: Dataset) -> tuple[Dataset, Array, Mask, dict[str, Any], str]:
    """Return the one state, its v [length³] and contact, how their image lies in its axes, and the state in words."""
    case, name, words = state(ds, "field_at", "gap")
    gap = own(case["gap"])
    x, y, contact = gap["x"].values, gap["y"].values, gap.values == 0.0
    v = element_volumes(gap.values * float(sigma(case)), float(case["L"]) * x[1], contact)
    half = x[1] / 2  # a node is the centre of its element
    extent = (-half, x[-1] + half, -half, y[-1] + half)
    return case, v, contact, {"origin": "lower", "extent": extent, "interpolation": "none"}, f"{name}: {words}"


def densities(family: Family) -> tuple[Array, Array, float]:
    """Return edges of bins, f(v) of each surface on them, shape (surfaces, bins), and the number of elements counted.

    Several surfaces are brought to common bins through their cumulative, which keeps ∫ f dv = 1. The number of elements
    is read off the stored shares: the smallest that is not 0 is one element.
    """
    density = family.data["volume_density"].transpose("seed", "bin").values
    edges = family.data["volume_density_edges"].transpose("seed", "edge").values
    shares = density * np.diff(edges)
    elements = sum(1.0 / row[row > 0.0].min() for row in shares if (row > 0.0).any())
    bins = edges[0]
    if len(edges) > 1:
        bins = np.linspace(edges.min(), edges.max(), edges.shape[1])
        below = np.pad(np.cumsum(shares, axis=1), ((0, 0), (1, 0)))
        density = np.diff([np.interp(bins, *pair) for pair in zip(edges, below, strict=True)], axis=1) / np.diff(bins)
    return bins, density, float(elements)


def merged(edges: Array, density: Array, elements: float, *, log: bool = False) -> list[Curve]:
    """Return (v, f) of each surface on bins merged until each holds enough elements.

    Equal bins up to v_max fit neither few elements nor a logarithmic axis. With fewer elements than bins most hold 0, 1
    or 2 of them, and the density is a comb. On a logarithmic axis 40 of 50 bins crowd into the last decade, and the
    first ones are blocks. Neighbours are therefore joined from below, until all surfaces together have `ENOUGH`
    elements in the bin. Of few elements, n, the rule of Rice is enough: n^(2/3)/2. No bin is empty then, and the noise
    is about the same in all. With `log`, a bin is at least as wide as 1/12 of a decade. What is left at the upper end
    joins the last bin. Joining keeps ∫ f dv. A point is drawn at the middle of its bin.
    """
    shares = density * np.diff(edges)
    counts = shares.mean(axis=0) * elements
    least = min(ENOUGH, 0.5 * elements ** (2.0 / 3.0))
    kept, gathered = [0], 0.0
    for k, count in enumerate(counts, start=1):
        gathered += count
        wide = not log or edges[k] >= edges[kept[-1]] * 10.0 ** (1.0 / PER_DECADE)
        if wide and gathered >= least * (1.0 - 1e-9):
            kept.append(k)
            gathered = 0.0
    end = int(np.flatnonzero(counts > 0.0)[-1]) + 1 if (counts > 0.0).any() else len(counts)
    kept = [*kept[: max(len(kept) - 1, 1)], end] if gathered > 0.0 or len(kept) == 1 else kept
    bins = edges[kept]
    joined = np.add.reduceat(shares, kept[:-1], axis=1) / np.diff(bins)
    return [(0.5 * (bins[1:] + bins[:-1]), row) for row in joined]


def volume_unit(ds: Dataset) -> str:
    """Return the unit of an element volume, a height times an area, as it is printed."""
    along, up = (str(ds[name].attrs.get("units", "length")) if name in ds else "length" for name in ("L", "Sq"))
    return unit_text(f"{along}^3" if along == up else f"{up}*{along}^2")


def volume_label(ds: Dataset) -> str:
    """Return the label of an axis of element volumes."""
    return f"element volume $v$ [{volume_unit(ds)}]"


def density_label(ds: Dataset) -> str:
    """Return the label of an axis of their density."""
    unit = volume_unit(ds)
    inverse = unit.replace("³", "$^{-3}$") if " " not in unit else f"({unit})$^{{-1}}$"
    return f"probability density $f(v)$ [{inverse}]"
