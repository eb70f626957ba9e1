"""Read from a dataset, for figures: families of surfaces that share a curve, single surfaces.

Nothing is solved here, and nothing is drawn. A comparison of D is at the largest m (or the m nearest a wish), one of m
at the D nearest 2.3; a single case is that nearest to D = 2.3, m = 7 (`cases`). A study of files (dimension ``case``)
has its curves labelled by case.
"""

from __future__ import annotations

import functools
import operator
import os
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from xarray import DataArray, Dataset

from roughvol.observables.at_state import at_state
from roughvol.report.figures.cases import FINEST, SHOWN_D, nearest, nearest_surface
from roughvol.report.figures.style import Drawing, looks
from roughvol.typing import Array

Curve = tuple[Array, Array]


class Family(NamedTuple):
    """The surfaces that share a curve: its label, its D, m or place, its colour and marker, their data along seed."""

    label: str
    value: float
    look: dict[str, Any]
    data: Dataset

    @property
    def surfaces(self) -> int:
        """Number of surfaces."""
        return int(self.data.sizes["seed"])

    def along(self, axis: str) -> Family:
        """Return the family with its numbers along a direction."""
        return self._replace(data=self.data.sel(axis=axis))

    def source(self, surface: int | None = None) -> dict[str, object]:
        """Return the labels of the family, or of one of its surfaces: D, m, seed, or case, and the name of a curve."""
        found: dict[str, object] = {"curve": self.label}
        found |= {key: self.data[key].item() for key in ("D", "m", "case") if key in self.data.coords}
        one = 0 if self.surfaces == 1 else surface
        if one is not None and "seed" in self.data.coords:
            seed = self.data["seed"].values.tolist()[one]
            found |= {"case": seed} if isinstance(seed, str) else {"seed": seed}
            if self.surfaces > 1:
                found["curve"] = f"{self.label}, {seed if isinstance(seed, str) else f'seed {seed}'}"
        return found


def named(ax: Axes, lines: Sequence[Line2D], family: Family, surface: int | None = None, **more: object) -> None:
    """Note which family, or which of its surfaces, the points of lines are of, as in `Drawing.sources`."""
    fig = ax.get_figure()
    if isinstance(fig, Drawing):
        fig.sources = {**fig.sources, **dict.fromkeys(lines, family.source(surface) | more)}


def held(ds: Dataset, *variables: str) -> DataArray:
    """Return which cases hold a finite value of every one of the variables."""
    masks = [abs(ds[name]) < np.inf for name in variables]
    cases = ("D", "m", "seed", "case")
    return functools.reduce(operator.and_, [mask.any([dim for dim in mask.dims if dim not in cases]) for mask in masks])


def families(ds: Dataset, by: str, *variables: str, m: float = FINEST) -> tuple[list[Family], str]:
    """Return the families to compare in the order of `by`, and what they have in common, for the legend."""
    if "case" not in ds.dims:
        common, wish = ("D", SHOWN_D) if by == "m" else ("m", m)
        holding = ds[common].values[held(ds, *variables).any([by, "seed"]).values].tolist()
        ds = ds.sel({common: [nearest(holding, wish)]})
    return every_family(ds, *variables, by=by)


def every_family(ds: Dataset, *variables: str, by: str = "D") -> tuple[list[Family], str]:
    """Return the families of every D at every m, or of every file, and what they have in common, for the legend."""
    measured = "case" in ds.dims
    dims, ds = (["case"], ds.expand_dims("seed")) if measured else (["D", "m"], ds)
    mask = held(ds, *variables).transpose(*dims, "seed").values
    places = [dict(zip(dims, place, strict=True)) for place in np.argwhere(mask.any(axis=-1)).tolist()]
    differing = [dim for dim in dims if len({place[dim] for place in places}) > 1] or [by]
    members = []
    for place, look in zip(places, looks(len(places)), strict=True):
        seeds = mask[tuple(place.values())]
        data = ds.isel(place | ({} if seeds.all() else {"seed": np.flatnonzero(seeds)}))  # a list copies all fields
        if measured:
            members.append(Family(file_text(data["case"].item()), float(place["case"]), look, data))
        else:
            members.append(Family(_label(data, differing), float(data[differing[0]]), look, data))
    return members, "" if measured else _label(members[0].data, [dim for dim in dims if dim not in differing])


def _label(case: Dataset, dims: Sequence[str]) -> str:
    """Return D and m of a case as a label, as ``$D = 2.3$, $m = 7$``."""
    return ", ".join(f"${dim} = {case[dim].item():g}$" for dim in dims)


def single(ds: Dataset, *variables: str) -> tuple[Dataset, str]:
    """Return the case nearest to D = 2.3, m = 7 that holds the variables, and its name."""
    mask = held(ds, *variables)
    places = [dict(zip(mask.dims, place, strict=True)) for place in np.argwhere(mask.values).tolist()]
    numbers = [dim for dim in ("D", "m") if dim in mask.dims]
    surfaces = {}
    for k, place in enumerate(places):
        D, m = (float(ds[dim][place[dim]]) if dim in place else None for dim in ("D", "m"))
        surfaces[k] = D, m
    case = ds.isel(places[nearest_surface(surfaces)])
    return case, _label(case, numbers) or file_text(case["case"].item())


def file_text(name: str) -> str:
    """Return the name of a file as text: no formula, nor (leading underscore) left out of a legend, nor bytes."""
    return os.fsencode(name).decode("utf-8", "replace").replace("$", r"\$").lstrip("_")


def own(field: DataArray) -> DataArray:
    """Return a field (x along axis 0) without the nodes that only finer lattices of the dataset have."""
    return field.dropna("x", how="all").dropna("y", how="all").transpose("x", "y")


def curves(family: Family, x: str, y: str) -> list[Curve]:
    """Return y(x) of each surface at its computed states, in the order of x, falling if it falls under load."""
    every = (family.data[name].transpose("seed", ...).values for name in (x, y))
    pairs = [np.array(pair) for pair in zip(*every, strict=True)]
    finite = [pair[:, np.isfinite(pair).all(axis=0)] for pair in pairs]
    along = [-x if x.size and x[-1] < x[0] else x for x, _ in finite]
    orders = [np.argsort(x, kind="stable") for x in along]
    return [(pair[0][order], pair[1][order]) for pair, order in zip(finite, orders, strict=True)]


def mean_and_band(members: Sequence[Curve], points: int) -> tuple[Array, Array, Array]:
    """Return even points over the range that all curves reach, their mean there and their standard deviation.

    Between two steps a curve is the cubic of `at`.
    """
    low, high = max(x.min() for x, _ in members), min(x.max() for x, _ in members)
    abscissa = np.linspace(low, high, points if high > low else 0)
    rows = np.array([at_state(x, y, abscissa) for x, y in members])
    return abscissa, rows.mean(axis=0), rows.std(axis=0, ddof=1)


def several(counts: Iterable[int]) -> str:
    """Return the smallest and the largest number of surfaces beyond one, as 5-10, empty if there is none."""
    numbers = sorted(count for count in counts if count > 1)
    return "-".join(map(str, dict.fromkeys((numbers[0], numbers[-1])))) if numbers else ""
