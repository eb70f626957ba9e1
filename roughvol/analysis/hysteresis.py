"""Effect of yield on the leak: up against down on a path, and elastic against plastic contact at equal pressure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from xarray import Dataset

from roughvol.analysis.at import state_at
from roughvol.analysis.average import average
from roughvol.analysis.derived import P, derived, groups
from roughvol.analysis.legs import along, legs_of
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import Table, number, spread
from roughvol.analysis.units import sigma
from roughvol.errors import DatasetError
from roughvol.study import Level

FLOW, VOLUME = "transmissivity", "free_volume"
QUANTITIES = (f"{FLOW}_x", f"{FLOW}_y", VOLUME, "contact_area_fraction")  # the flow is T* V*³
SHARES = (0.25, 0.5, 0.75, 1.0)  # of the largest pressure that all curves have

Curves = Sequence[tuple[Run, Dataset, int]]
"""Runs, each with a group of surfaces along ``seed``, and a leg."""


@dataclass(frozen=True)
class Comparison:
    """Quantities of two runs of the same surfaces at equal pressures: elastic contact, and contact that yields.

    ``surfaces`` is the D and the m of the surfaces in words; empty where the runs have one D and one m.
    """

    elastic: str
    plastic: str
    surfaces: str
    rows: tuple[tuple[str, ...], ...]

    @property
    def title(self) -> str:
        """Title of its section."""
        return ", ".join(filter(None, (f"With yield ({self.plastic}) and without ({self.elastic})", self.surfaces)))


NOTE = (
    "At equal p* on the first leg, interpolated between steps. Means over surfaces, of leaks the median. The ratio is "
    "the geometric mean over surfaces with both values above zero."
)
HEAD = ("p*", "quantity", "elastic", "plastic", "elastic over plastic", "surfaces")


def hysteresis(run: Run, group: Dataset, several: str = "") -> Iterator[Table]:
    """Yield the table of a path of surfaces along ``seed``: quantities at equal pressures on the legs up and down."""
    legs = legs_of(group)
    if len(legs) < 2:
        return
    rows = [
        (pressure, symbol, *(_one(name, values) for values in of_legs))
        for pressure, symbol, name, of_legs in _at_equal_pressures([(run, group, leg) for leg in legs])
    ]
    title = "On every leg of the path" + (f", {several}" if several else "")
    note = (
        "At equal p*, interpolated between steps. Means over the surfaces that have a number on every leg shown, of "
        "leaks the median."
    )
    yield Table(title, ("p*", "quantity", *(f"leg {leg}" for leg in legs)), tuple(rows), note)


def comparisons(runs: Sequence[Run]) -> Iterator[Comparison]:
    """Yield the pairs of runs that press the same midpoint surfaces, elastically and with yield, by D and m.

    The states are those of the first leg.
    """
    pressed = [run for run in runs if P in run.dataset and "D" in run.dataset.dims]
    for plastic in (run for run in pressed if "plastic_volume" in run.dataset):
        for elastic in (run for run in pressed if "plastic_volume" not in run.dataset):
            if _same_surfaces(elastic, plastic):
                yield from _by_group(elastic, plastic)


def _same_surfaces(one: Run, other: Run) -> bool:
    """Return whether two runs press the same surfaces, with the same sides and kernel, and observe the same region."""
    unit = one.generated.length_unit if one.generated else None
    pressed = [
        (made.D, made.m, made.seeds, made.midpoint_law, made.sides, study.kernel(unit), study.record.part)
        for run in (one, other)
        if (made := run.generated) and (study := run.study)
    ]
    if len(pressed) < 2 or pressed[0] != pressed[1]:
        return False
    heights = [float(sigma(run.dataset).mean()) / run.L for run in (one, other)]
    return bool(np.isclose(heights[0], heights[1], rtol=1e-9))


def _by_group(elastic: Run, plastic: Run) -> Iterator[Comparison]:
    """Yield the comparison of two runs at each D and m that both have, of the surfaces that both have."""
    hard, soft = (dict(groups(derived(run.dataset, run.study))) for run in (elastic, plastic))
    several = len(elastic.D) * len(elastic.m) > 1
    for name in (name for name in hard if name in soft):
        seeds = np.intersect1d(hard[name]["seed"], soft[name]["seed"])
        pair = [(run, some[name].sel(seed=seeds), 1) for run, some in ((elastic, hard), (plastic, soft))]
        if seeds.size and (rows := tuple(_rows(pair))):
            yield Comparison(elastic.name, plastic.name, name if several else "", rows)


def _rows(pair: Curves) -> Iterator[tuple[str, ...]]:
    """Yield the quantities of elastic contact and of contact that yields, and their ratio."""
    for pressure, symbol, name, both in _at_equal_pressures(pair):
        if not all(both):
            continue
        pairs = np.transpose(both)
        open_ = pairs[(pairs > 0.0).all(axis=1)]
        ratio = float(np.exp(np.mean(np.log(open_[:, 0] / open_[:, 1])))) if open_.size else np.nan
        yield pressure, symbol, *(_one(name, side) for side in both), number(ratio), f"{len(open_)} of {len(pairs)}"


def _at_equal_pressures(curves: Curves) -> Iterator[tuple[str, str, str, list[list[float]]]]:
    """Yield p*, symbol, name and numbers of each quantity, curve by curve, at shares of the largest common p*.

    The numbers are those of the surfaces that have a number on every curve with numbers, in the order of the seeds.
    """
    curves = [(run, _with_flow(group), leg) for run, group, leg in curves]
    steps = [along(spread(group), leg) for _, group, leg in curves]
    names = [name for name in QUANTITIES if all(name in ds and bool(ds[name].notnull().any()) for ds in steps)]
    top = min(float(np.nanmin(ds[P].max("step").values)) for ds in steps)  # that all surfaces reach
    for share in SHARES:
        states = [_at(run, group, leg, share * top) for run, group, leg in curves]
        for name in names:
            symbol = str(steps[0][name].attrs.get("symbol", name))
            yield number(share * top), symbol, name, _of_one_set([_by_seed(state, name) for state in states])


def _with_flow(group: Dataset) -> Dataset:
    """Return a group whose transmissivity is the leak at a pressure drop, T* V*³, at steps and recorded states."""
    flows = {}
    for at in ("", "flux_at_"):
        if f"{at}{FLOW}" in group:
            flow = group[f"{at}{FLOW}"] * group[f"{at}{VOLUME}"] ** 3
            flows[f"{at}{FLOW}"] = flow.assign_attrs(symbol="leak along i, T_i* V*³")
    return group.assign(flows)


def _at(run: Run, group: Dataset, leg: int, pressure: float) -> Dataset | None:
    """Return the numbers along ``seed`` of the surfaces that a leg brings to a pressure; None without one."""
    try:
        state = state_at(run, group, Level("pressure", pressure, leg if "leg" in group else None))
    except DatasetError:
        return None
    return spread(state.data)


def _by_seed(state: Dataset | None, name: str) -> dict[int, float]:
    """Return a quantity of each surface of a state, by its seed; a file has none."""
    if state is None:
        return {}
    seeds = state["seed"].values.tolist() if "seed" in state.coords else [0]
    return dict(zip(seeds, state[name].values.tolist(), strict=True))


def _of_one_set(curves: Sequence[dict[int, float]]) -> list[list[float]]:
    """Return the numbers, curve by curve, of the surfaces that have a number on every curve with numbers."""
    known = [{seed: value for seed, value in curve.items() if np.isfinite(value)} for curve in curves]
    shared = set.intersection(*found) if (found := [set(curve) for curve in known if curve]) else set()
    return [[curve[seed] for seed in sorted(shared)] if curve else [] for curve in known]


def _one(name: str, values: ArrayLike) -> str:
    return number(average(name, values).value)
