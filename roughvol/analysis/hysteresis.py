"""Effect of yield on the leak: up against down on a path, and elastic against plastic contact at equal pressure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from xarray import Dataset

from roughvol.analysis.at import between, place_of
from roughvol.analysis.average import average
from roughvol.analysis.leak import counted
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import Table, number, spread
from roughvol.analysis.units import sigma
from roughvol.study.values.state_kinds import slack
from roughvol.typing import Array

P = "mean_pressure"
QUANTITIES = ("flow_x", "flow_y", "free_volume", "contact_area_fraction")
SHARES = (0.25, 0.5, 0.75, 1.0)  # of the largest pressure that both have


@dataclass(frozen=True)
class Comparison:
    """Quantities of two runs of the same surfaces at equal pressures: elastic contact, and contact that yields."""

    elastic: str
    plastic: str
    rows: tuple[tuple[str, ...], ...]

    @property
    def title(self) -> str:
        """Title of its section."""
        return f"With yield ({self.plastic}) and without ({self.elastic})"


NOTE = (
    "At equal p* on the first leg, interpolated between steps. Means over surfaces, of leaks the median. The ratio is "
    "the geometric mean over surfaces with both values above zero."
)
HEAD = ("p*", "quantity", "elastic", "plastic", "elastic over plastic", "surfaces")


def hysteresis(group: Dataset, several: str = "") -> Iterator[Table]:
    """Yield the table of a path of surfaces along ``seed``: quantities at equal pressures on the legs up and down."""
    if "leg" not in group:
        return
    legs = np.unique(group["leg"].values).tolist()
    if len(legs) < 2:
        return
    curves = {leg: _leg(group, leg) for leg in legs}
    names = [name for name in QUANTITIES if all(name in c and bool(c[name].notnull().any()) for c in curves.values())]
    top = _top(curves.values())
    rows = []
    for share in SHARES:
        for name in names:
            values = [_at(curves[leg], name, share * top) for leg in legs]
            rows.append((number(share * top), _symbol(curves[legs[0]], name), *(_one(name, value) for value in values)))
    title = "On every leg of the path" + (f", {several}" if several else "")
    note = "At equal p*, interpolated between steps; over the surfaces that reach it the mean, of leaks the median."
    yield Table(title, ("p*", "quantity", *(f"leg {leg}" for leg in legs)), tuple(rows), note)


def comparisons(runs: Sequence[Run]) -> Iterator[Comparison]:
    """Yield every pair of runs that press the same surfaces, elastically and with yield, on their first legs."""
    pressed = [run for run in runs if P in run.dataset and "D" in run.dataset.dims]
    for plastic in (run for run in pressed if "plastic_volume" in run.dataset):
        for elastic in (run for run in pressed if "plastic_volume" not in run.dataset):
            if _same_surfaces(elastic, plastic) and (rows := tuple(_rows(elastic, plastic))):
                yield Comparison(elastic.name, plastic.name, rows)


def _same_surfaces(one: Run, other: Run) -> bool:
    """Return whether two runs press the same surfaces, with the same sides and kernel, and observe the same region."""
    unit = one.generated.length_unit if one.generated else None
    pressed = [
        (made.D, made.m, made.seeds, made.midpoint_law, made.sides, study.kernel(unit), study.record.region)
        for run in (one, other)
        if (made := run.generated) and (study := run.study)
    ]
    if len(pressed) < 2 or pressed[0] != pressed[1]:
        return False
    heights = [float(sigma(run.dataset).mean()) / run.L for run in (one, other)]
    return bool(np.isclose(heights[0], heights[1], rtol=1e-9))


def _rows(elastic: Run, plastic: Run) -> Iterator[tuple[str, ...]]:
    D, m = max(elastic.D), max(elastic.m)
    hard, soft = (_leg(counted(run.dataset).sel(D=D, m=m), 1) for run in (elastic, plastic))
    top = _top((hard, soft))
    for share in SHARES:
        for name in (name for name in QUANTITIES if name in soft and name in hard):
            first, second = _at(hard, name, share * top), _at(soft, name, share * top)
            both = np.isfinite(first) & np.isfinite(second)
            if not both.any():
                continue
            open_ = both & (first > 0.0) & (second > 0.0)
            ratio = np.exp(np.mean(np.log(first[open_] / second[open_]))) if open_.any() else np.nan
            means = _one(name, first[both]), _one(name, second[both])
            yield (
                number(share * top),
                _symbol(soft, name),
                *means,
                number(float(ratio)),
                f"{open_.sum()} of {both.sum()}",
            )


def _leg(group: Dataset, leg: int) -> Dataset:
    """Return the steps of one leg, all of them where there is one sweep, with the leak T* V*³ at a pressure drop."""
    if "transmissivity" in group:
        leak = group["transmissivity"] * group["free_volume"] ** 3
        group = group.assign(flow=leak.assign_attrs(symbol="leak along i, T_i* V*³"))
    group = spread(group)
    if "leg" not in group:
        return group
    steps = np.flatnonzero(group["leg"].values == leg)
    return group.isel(step=np.arange(max(steps[0] - 1, 0), steps[-1] + 1))  # from the state in which the leg begins


def _top(curves: Iterable[Dataset]) -> float:
    """Return the largest p* that all surfaces reach on all curves."""
    return min(float(np.nanmin(curve[P].max("step").values)) for curve in curves)


def _at(curve: Dataset, name: str, pressure: float) -> Array:
    """Return a quantity of every surface at a pressure, NaN where a surface does not reach it."""
    loads = curve[P].transpose("seed", "step").values
    places = [place_of(row, pressure, slack("pressure", pressure)) for row in loads]
    seeds = [seed for seed, place in enumerate(places) if place is not None]
    values = np.full(len(places), np.nan)
    if seeds:
        values[seeds] = between(curve, seeds, [place for place in places if place is not None])[name].values
    return values


def _one(name: str, values: Array) -> str:
    return number(average(name, values).value)


def _symbol(ds: Dataset, name: str) -> str:
    return str(ds[name].attrs.get("symbol", name))
