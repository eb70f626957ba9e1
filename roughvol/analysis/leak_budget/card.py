"""The card of one surface or of several: leaks and closing loads, each with its error, and the leak of the seal."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from roughvol.analysis import seal
from roughvol.analysis.at import state_at
from roughvol.analysis.average import average
from roughvol.analysis.closing import Closing, load_of
from roughvol.analysis.derived import derived, groups
from roughvol.analysis.leak import is_lifted
from roughvol.analysis.leak_budget.grid import NO_COARSER, Finer, grid_part, grid_part_of_load
from roughvol.analysis.leak_budget.levelling import Levelled, levelling_part, levelling_part_of_load
from roughvol.analysis.leak_budget.solver import solver_part, solver_part_of_load
from roughvol.analysis.leak_budget.state import (
    FLOW,
    SWEEP,
    Grids,
    Loaded,
    closing_of,
    comparable,
    flow_of,
    gap_of,
    leak_of,
    per_starred,
    surfaces_at_load,
)
from roughvol.analysis.leak_budget.window import absent_words, window_part, window_part_of_load
from roughvol.analysis.leak_card import Beside, Card, SealLeak, Way, by_factors
from roughvol.analysis.parts import Part, together
from roughvol.analysis.seal import Patch
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import number
from roughvol.errors import DatasetError, SurfaceError
from roughvol.observables.variables import AXES
from roughvol.observables.void import quarters
from roughvol.store.card_runs import CardRuns, Pressed
from roughvol.study.sections.seal import check_alike
from roughvol.typing import Array

Source = tuple[Callable[[str], Part], Callable[[str], Part]]
"""A source of error: its parts of the closing load and of the leak, by axis."""


def is_reached(fine: Pressed) -> bool:
    """Return whether the leak of a surface of a run is known at the load of a card."""
    return _has_leak(surfaces_at_load(fine))


def _has_leak(surfaces: Iterable[Loaded]) -> bool:
    return any(math.isfinite(surface.leak(axis)) for surface in surfaces for axis in AXES)


def check_reached(fine: Pressed) -> None:
    """Refuse a run without a surface that is pressed to the load of a card; the message has the loads of the run."""
    if not is_reached(fine):
        run = Run.of(SWEEP, fine.dataset)
        for _, group in groups(derived(run.dataset, run.study)):
            state_at(run, group, fine.level)  # raises, except beyond a sweep that ended closed
        message = f"{SWEEP} ends before {fine.level.label}, and the fluid may open the way again: press farther"
        raise DatasetError(message)


def card_of(runs: Sequence[CardRuns], name: str, load: str) -> Card:
    """Return the card of one surface or of several, from the runs of each height file or of generated surfaces."""
    fine = [surface for of_file in runs for surface in surfaces_at_load(of_file.fine)]
    if not _has_leak(fine):
        check_reached(runs[0].fine)
    coarser = [comparable(grids, fine) for grids in zip(*(of_file.coarser for of_file in runs), strict=False)]
    levels = [of_file.levelled for of_file in runs if of_file.levelled is not None]
    if coarser:
        grids = [surfaces for _, surfaces in coarser]
        finer = [Finer.of(surface, others) for surface, *others in zip(fine, *grids, strict=True)]
        of_grid: Source = partial(grid_part_of_load, fine, coarser, finer), partial(grid_part, fine, coarser, finer)
    else:
        none = NO_COARSER + ", or fills its period" * ("periodic" in fine[0].table.attrs)
        of_grid = _unknown("grid", next(filter(None, (of_file.no_coarser for of_file in runs)), none))
    of_solver = partial(solver_part_of_load, fine), partial(solver_part, fine)
    sources: list[Source] = [of_solver, of_grid, (partial(window_part_of_load, fine), partial(window_part, fine))]
    if len(levels) == len(runs):
        before = coarser[0][1] if coarser else comparable([of_file.before_levelling for of_file in runs], fine)[1]
        levelled = Levelled(levels[0].words, before, comparable(levels, fine)[1])
        sources.append((partial(levelling_part_of_load, levelled), partial(levelling_part, fine, levelled)))
    elif no_levelled := next(filter(None, (of_file.no_levelled for of_file in runs)), ""):
        sources.append(_unknown("levelling", no_levelled))
    ways = tuple(_way(fine, coarser, sources, axis) for axis in AXES)
    texts = (str(of_file.fine.dataset.attrs.get("warnings", "")) for of_file in runs)
    warnings = (line.strip() for text in texts for line in text.splitlines())
    return Card(
        title=name,
        load=load,
        surfaces=tuple(fine),
        pressure_unit=ways[0].closing.unit,
        length_unit=str(fine[0].run.dataset.attrs.get("length_unit", "")),
        ways=ways,
        beside=tuple(_beside(fine, ways)),
        lifted=is_lifted(fine[0].table),
        warnings=tuple(dict.fromkeys(filter(None, warnings))),
        seal=_seal(fine, ways),
    )


def _unknown(name: str, words: str) -> Source:
    """Return a source of error whose runs are missing."""
    part = Part(name, math.nan, words)
    return lambda axis: part, lambda axis: part


def _seal(fine: Sequence[Loaded], ways: Sequence[Way]) -> SealLeak | None:
    """Return the leak of the seal of a study, and where it closes; None without the section ``seal``."""
    patch = Patch.of(fine[0].run.study, fine[0].table)
    if patch is None:
        return None
    tables = [surface.table for surface in fine]
    check_alike([size for table in tables for size in seal.sizes_of(table)])
    patch = patch.of_each(tables)
    flow = next(way for way in ways if way.axis == patch.seal.flow)
    units = bool(flow.unit)
    isotropic = patch.is_isotropic(tables)
    leaks = patch.counted(np.array([[surface.leak(axis) for axis in AXES] for surface in fine]), isotropic=isotropic)
    loads = np.array([float(surface.table["Sq"][0]) * surface.number("mean_pressure") for surface in fine])
    one_load = np.fmax.reduce(loads) <= (1.0 + seal.ONE_LOAD) * np.fmin.reduce(loads) or not leaks.any()
    if not one_load:
        leaks[:] = math.nan
    maps = seal.known_of(patch.conductances(leaks, in_units=units))
    quadrants = patch.conductances(_of_quadrants(fine[0]), in_units=units) if len(fine) == 1 else None
    shared = [part for part in flow.parts if part.name != "window"] if flow.leak.value > 0.0 else []
    try:
        doubt = seal.doubt_of([seal.surface_of(surface.fields, patch.region) for surface in fine])
    except SurfaceError:  # a region of two rows
        doubt = seal.NO_ROLL_OFF
    closing, of_load = _closing_of_seal(fine, patch, flow, isotropic=isotropic, doubt=doubt)
    absent = absent_words(leaks[:, 0]) if len(maps) else ""
    doubt = doubt or absent
    leak, parts, words = seal.leak_of(patch, maps, quadrants, isotropic=isotropic, doubt=doubt, shared=shared)
    gas_leak, gas_unit = math.nan, fine[0].unit(name := f"gas_{FLOW}")
    if name in fine[0].table:
        gases = np.array([[surface.leak(axis, name) for axis in AXES] for surface in fine])
        gas_leak = seal.median(patch, gases, isotropic=isotropic) if one_load else math.nan
        gas = fine[0].table[name].attrs.get("gas", "the gas")
        throughput = f"{number(gas_leak, 3)} {gas_unit}{', the median of as many sheets' * (len(fine) > 1)}"
        if math.isfinite(gas_leak):
            of_liquid = "; its interval has the factors of the liquid" * math.isfinite(leak.high)
            words += (f"leak of {gas}: {throughput}{of_liquid}",)
    if leak.value == 0.0 and absent:  # the others may be open
        leak, parts, words = seal.Estimate(math.nan, math.nan, math.nan), (), ()
    gas_interval = by_factors(gas_leak, leak.value, (leak.low, leak.high))
    if leak.value == 0.0:
        parts = of_load
    if leak.value == 0.0 and not doubt:
        later = partial(_closed_seal, fine, patch, closing, isotropic=isotropic)
        leak = seal.Estimate(0.0, *later(FLOW, in_units=units))
        gas_interval = later(name, in_units=True) if name in fine[0].table else gas_interval
    return SealLeak(
        label=patch.seal.label,
        flow=patch.seal.flow,
        patches=patch.patches,
        leak=leak.value,
        interval=(leak.low, leak.high),
        unit=flow.unit,
        parts=parts,
        closing=closing.value,
        closing_interval=(closing.low, closing.high),
        load_unit=flow.closing.unit,
        words=words,
        closing_parts=of_load,
        gas_leak=gas_leak,
        gas_unit=gas_unit,
        gas_interval=gas_interval,
    )


def _closed_seal(
    fine: Sequence[Loaded], patch: Patch, closing: seal.Estimate, name: str, *, isotropic: bool, in_units: bool
) -> tuple[float, float]:
    """Return the interval of a flow through a closed seal: up to its flow if it closes at the far end of its loads."""
    later = math.log(closing.high / closing.value)
    flows = np.array([[surface.leak_if(axis, later, name) for axis in AXES] for surface in fine])
    most = seal.median(patch, flows, isotropic=isotropic, in_units=in_units)
    return 0.0 if math.isfinite(most) else math.nan, most


def _closing_of_seal(
    fine: Sequence[Loaded], patch: Patch, flow: Way, *, isotropic: bool, doubt: str
) -> tuple[seal.Estimate, tuple[Part, ...]]:
    """Return the closing load of a seal and the parts of its error; NaN under fluid pressure, or if a way is open."""
    along_axes = np.array([[surface.closing[axis].value for axis in AXES] for surface in fine])
    loads = patch.counted(along_axes, isotropic=isotropic)[:, np.newaxis, [AXES.index(axis) for axis in patch.axes]]
    several = len(fine) > 1
    turned = isotropic and several
    if is_lifted(fine[0].table) or not (loads > 0.0).all():
        return seal.Estimate(math.nan, math.nan, math.nan), ()
    closing = seal.closing_of(loads, patch.patches, isotropic=turned)
    parts = tuple(part for part in flow.closing.parts if part.name != "window" or not (several or doubt))
    smaller, larger = together(parts)
    if several or doubt:
        parts += (seal.window_of(closing, f"{len(fine)} surfaces", doubt),)
    if not several:
        closing = seal.Estimate(*[closing.value] * 3)
    return closing.with_factor(math.nan if doubt else larger, smaller), parts


def _of_quadrants(surface: Loaded) -> Array:
    """Return the leaks that the quadrants of a map would have as the map, shape (4, 2)."""
    leaks = []
    for axis in AXES:
        gap, _ = gap_of(surface.fields, surface.recorded, axis)
        flows = [flow_of(part, axis) for part in quarters(gap)] if gap.size else [0.0] * 4
        leaks.append(np.array(flows) * per_starred(surface, axis) if any(flows) else np.zeros(4))
    return np.stack(leaks, axis=1)


def _beside(fine: Sequence[Loaded], ways: Sequence[Way]) -> Iterator[Beside]:
    """Yield the leaks of the dry gap and of a gas."""
    dry = "leak of the dry gap, without fluid pressure"
    for name, words in ((f"{FLOW}_dry", dry), (f"gas_{FLOW}", "leak of"), (f"gas_{FLOW}_dry", dry)):
        leaks = [average(name, [surface.leak(axis, name) for surface in fine]) for axis in AXES]
        variable = fine[0].table.get(name)
        if any(math.isfinite(leak.value) for leak in leaks):
            gas = str(variable.attrs.get("gas", "")) if variable is not None else ""
            text = f"{words} {gas or 'the gas'}" if words == "leak of" else f"{words}, {gas}".removesuffix(", ")
            pairs = zip(leaks, ways, strict=True) if name == f"gas_{FLOW}" else ()
            intervals = [_of_gas(fine, leak.value, way) for leak, way in pairs]
            yield Beside(text, tuple(leaks), fine[0].unit(name), tuple(intervals))


def _way(fine: Sequence[Loaded], coarser: Grids, sources: Sequence[Source], axis: str) -> Way:
    """Return the leak along one axis with its closing, and the parts of their errors from the sources."""
    leak = leak_of(fine, axis)
    closing = replace(closing_of(fine, axis), parts=tuple(of_load(axis) for of_load, _ in sources))
    others = tuple((words, closing_of(surfaces, axis)) for words, surfaces in coarser)
    parts = tuple(of_leak(axis) for _, of_leak in sources) if leak.value > 0.0 else closing.parts
    count = sum(surface.leak(axis) > 0.0 for surface in fine)
    most = _at_most(fine, closing, axis) if leak.value == 0.0 else math.nan
    return Way(axis, leak, count, fine[0].unit(), closing, others, _last_open(fine, axis), parts, most)


def _at_most(fine: Sequence[Loaded], closing: Closing, axis: str, name: str = FLOW) -> float:
    """Return a flow of a closed way if it closes at the far end of the interval of its closing load."""
    leaks = [surface.leak_if(axis, math.log(closing.factor), name) for surface in fine]
    return average(name, leaks).value if np.isfinite(leaks).all() else math.nan


def _of_gas(fine: Sequence[Loaded], gas: float, way: Way) -> tuple[float, float]:
    """Return the interval of the leak of a gas along a way; of a closed way to the leak at the far end of its loads."""
    if way.leak.value > 0.0:
        return by_factors(gas, way.leak.value, way.interval)
    most = _at_most(fine, way.closing, way.axis, f"gas_{FLOW}") if way.leak.value == 0.0 else math.nan
    return 0.0 if math.isfinite(most) else math.nan, most


def _last_open(fine: Sequence[Loaded], axis: str) -> str:
    """Return the leak of the last open step of the only surface, where it is closed at the load."""
    table = fine[0].loading
    name = next((name for name in (FLOW, f"{FLOW}_dry") if name in table), "")
    if len(fine) > 1 or fine[0].leak(axis) != 0.0 or not name:
        return ""
    leaks = table[name].sel(axis=axis).values
    open_ = np.flatnonzero(leaks > 0.0)
    if not open_.size:
        return "closed at every step"
    leak, load = float(leaks[open_[-1]]), float(table[load_of(table)][open_[-1]])
    amount = f"{number(leak)} {fine[0].unit(name)}" + (" without fluid pressure" if name.endswith("_dry") else "")
    return f"at the last open step, {fine[0].closing[axis].load(load)}, it leaks {amount}"
