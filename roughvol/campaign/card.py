"""The runs behind a leak card: a study at one load, the same on coarser grids, and with another levelling.

Runs are compared at one nominal pressure where the load is a pressure or a force. At another kind of state they are
compared at its value, at ``last`` at the ends of their sweeps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from roughvol.campaign import execution
from roughvol.campaign.batch import OnEvent
from roughvol.campaign.case_surface import surface_of
from roughvol.campaign.checks import patch_sides
from roughvol.errors import CampaignError, Problem, StudyError, SurfaceError
from roughvol.store.card_runs import CardRuns, Pressed
from roughvol.store.run_folder import slug
from roughvol.study import HeightFile, Level, Quantity, Seal, SpectralSurface, Study, read, refused
from roughvol.study.values.units import text_of, unit_of
from roughvol.surfaces.waves import share_below

FINE = "finest grid"
COARSER = {2: "twice the spacing", 4: "four times the spacing"}
OTHER_LEVEL = {"none": "tilt", "mean": "tilt", "tilt": "quadratic", "quadratic": "tilt"}
RECORDED = ("record.transport.flux_at", "record.fields_at", "record.fluid_pressure.at")  # keys of the states of a card
ACCURACY = 1e-3  # of the flows of a card: its grid and its window change a leak far more
FEWEST_NODES = 30  # of a side at twice the spacing; of four times the spacing only slopes count


@dataclass(frozen=True)
class Planned:
    """A run of a card: its difference from the finest run in words, its study, and the state in this study."""

    words: str
    study: Study
    level: Level


@dataclass(frozen=True)
class Plan:
    """The runs of a card before they are computed, as `CardRuns`."""

    fine: Planned
    coarser: tuple[Planned, ...] = ()
    levelled: Planned | None = None


def surfaces_of(study: Study) -> dict[str, Study]:
    """Return the study of each height file by the name of the file; seeds stay together, without a name."""
    surface = study.surface
    if not isinstance(surface, HeightFile) or len(surface.each) == 1:
        return {"": study}
    files = [Path(scan.file) for scan in surface.each]
    return {file.name: study.changed(**{"surface.file": str(file), "surface.files": None}) for file in files}


def plan(study: Study, at: Level, together: Sequence[Level] = ()) -> Plan:
    """Return the runs of a card of one file, or of the seeds of one D and m; a level with a unit is that of all.

    The runs record the levels ``together``, of the kind of ``at``, too.
    """
    surface = study.surface
    problems = []
    if study.ensemble is not None:
        problems.append(Problem("a leak card takes seeds, and no ensemble", "ensemble"))
    if study.sweep.steps == 0:
        problems.append(Problem("a leak card needs a load: sweep.steps is 0", "sweep.steps"))
    if not isinstance(surface, HeightFile) and max(len(surface.dimensions), len(surface.m)) > 1:
        problems.append(Problem("a leak card is of one kind of surface; allowed: one D and one m", "surface"))
    if problems:
        raise StudyError(problems)
    if isinstance(surface, HeightFile) and surface_of(case := study.cases()[0]).Sq == 0.0:
        raise refused(f"{case.label} is flat once it is treated, Sq is 0; allowed: a map with roughness")
    if study.seal is not None:
        _check_seal(study, study.seal, at)
    levels = [_recordable(study, level) for level in (at, *together)]
    try:
        fine = Planned("", _changed(study, levels, {}, fine=True), levels[0])
    except StudyError as error:
        raise StudyError(_of_level(error, at)) from error
    coarser: list[Planned] = []
    for factor, words in COARSER.items():
        keys = _coarser(study, factor)
        if keys is None:
            continue
        try:
            coarser.append(_at_equal_pressure(study, levels, keys, words))
        except StudyError:  # a grid too coarse for the waves of the surface; the card says what is not known
            break
    levelled = None
    if isinstance(surface, HeightFile) and not surface.periodic:  # a tilted period is none
        other = OTHER_LEVEL[str(surface.level)]
        keys = {"level": other}
        words = f"level: {other}"
        if coarser:  # levelling is about long waves: a quarter of the elements shows what it changes
            keys |= _coarser(study, 2) or {}
            words += f" at {COARSER[2]}"
        levelled = _at_equal_pressure(study, levels, keys, words)
    return Plan(fine, tuple(coarser), levelled)


def loads_together(at: Level, loads: Sequence[Level]) -> list[Level]:
    """Return the loads that are recorded in the runs of a load: those of its kind, as pressures; ``last`` is alone."""
    return [at] if at.kind == "last" else [load for load in loads if load.kind == at.kind]


def _check_seal(study: Study, seal: Seal, at: Level) -> None:
    """Refuse a seal smaller than its patches, a load of the seal, and a fluid pressure that differs along the flow."""
    case = study.cases()[0]
    sides = patch_sides(case)
    seal.check(sides, case.length_unit)
    if words := seal.overload(at, sides, case.length_unit, study.material):
        raise refused(words)
    if study.record.fluid_pressure is not None and seal.patches(sides, case.length_unit)[0] > 1:
        message = "record.fluid_pressure lifts each patch by another pressure; allowed: a patch as wide as the seal"
        raise StudyError([Problem(f"is {seal.width}, several patches: {message}", "seal.width")])


def _recordable(study: Study, at: Level) -> Level:
    """Return a level as a study records it; refuse a leg that the sweep has not, and a level that is no load."""
    legs = study.sweep.legs
    if at.leg is not None and at.leg > len(legs):
        raise refused(f"{at.label}: the sweep has no leg {at.leg}; its last is leg {len(legs)}")
    if at.kind.startswith("leak_rate"):
        raise refused(f'{at.label} is a leak rate: roughvol ask --leak-rate "{at.value}" finds its pressure')
    if at.kind == "step":
        message = f"{at.label}: each grid has another load at a step; allowed: last, or a load as pressure=0.3"
        raise refused(message)
    if at.kind == "last" and (end := legs[(at.leg or len(legs)) - 1].target).kind.startswith("leak_rate"):
        message = f"{at.label}: the leg ends at a leak rate, {end.value}, and so on each grid; allowed: a load"
        raise refused(f"{message} as pressure=0.3")
    if at.kind == "last" and at.leg is not None:
        return Level("last") if at.leg == len(legs) else Level("step", sum(leg.steps for leg in legs[: at.leg]))
    return at if len(legs) > 1 else replace(at, leg=None)


def _of_level(error: StudyError, at: Level) -> list[Problem]:
    """Return the problems of a study; those of the states that a card records name its load, once."""
    found = {}
    for problem in error.problems:
        of_card = (problem.key or "").startswith(RECORDED)
        shown = Problem(f"{at.label}: {problem.message}") if of_card else problem
        found[shown.message] = shown
    return list(found.values())


def _coarser(study: Study, factor: int) -> dict[str, Any] | None:
    """Return the keys of the section ``surface`` for a coarser grid; None where it has too few nodes.

    Means over nodes take the place of a filter of waves that the coarser grid cannot hold.
    """
    surface = study.surface
    if isinstance(surface, HeightFile):
        case = study.cases()[0]
        finer, cut_off = surface_of(case), case.treatment.low_pass
        if min(finer.shape) // 2 < FEWEST_NODES:
            return None
        too_short = cut_off is not None and cut_off < 2.0 * factor * finer.spacing
        return {"downsample": surface.downsample * factor} | ({"low_pass": None} if too_short else {})
    m = surface.m[0] - factor // 2
    if 2 ** (surface.m[0] - 1) + 1 < FEWEST_NODES:
        return None
    return _held(surface, 2**m) if isinstance(surface, SpectralSurface) else {"m": m}


def _held(surface: SpectralSurface, n: int) -> dict[str, Any] | None:
    """Return the keys of the waves that a grid can hold; None of a plateau alone.

    The waves have their amplitudes, in the root mean square over the seeds.
    """
    whole, hurst = surface.spectrum, 3.0 - surface.dimensions[0]
    cut = min(whole.cut, n / 2.0)
    if cut <= whole.rolloff:
        return None
    shares = [share_below(whole, hurst, seed, cut) for seed in surface.seeds]
    share = math.sqrt(sum(share * share for share in shares) / len(shares))
    name = "Sq" if whole.slope is None else "slope"
    return {"n": n, "cut": cut, "shortest": None, name: getattr(whole, name) * share}


def _at_equal_pressure(study: Study, levels: Sequence[Level], keys: Mapping[str, Any], words: str) -> Planned:
    """Return the study with other surfaces, at the same nominal pressures p = p* E* Sq/L = F/A of the first surface."""
    unscaled = _changed(study, levels, keys)
    try:
        (steepness, area), (other, other_area) = map(_sizes, (study, unscaled))
    except SurfaceError:  # another levelling leaves too many outliers; its run has the reason
        return Planned(words, unscaled, levels[0])
    factors = {"pressure": steepness / other, "load": other_area / area}
    if levels[0].kind in factors:
        levels = [replace(level, value=_scaled(level.kind, level.value, factors)) for level in levels]
    return Planned(words, _changed(study, levels, keys, factors), levels[0])


def _sizes(study: Study) -> tuple[float, float]:
    """Return Sq/L of the first surface, and the area of its elements."""
    case = study.cases()[0]
    surface = surface_of(case)
    return (case.height or surface.unit) / surface.side, surface.heights.size * surface.spacing**2


def _changed(
    study: Study,
    levels: Sequence[Level],
    keys: Mapping[str, Any],
    factors: Mapping[str, float] | None = None,
    *,
    fine: bool = False,
) -> Study:
    """Return the study with the records of a card, other keys of its surface, and its loads times factors by kind.

    The levels, of one kind, are recorded. The factors are for the sweep and the fluid (`_scaled`). The finest run has
    the flow of the quadrants half way to the end of the first leg and at halvings of it, the gas, and the lifted gap.
    """
    data = study.model_dump(mode="json")
    recorded, legs = data["record"], study.sweep.legs
    values = [str(level.value) if isinstance(level.value, Quantity) else level.value for level in levels]
    distinct = sorted(set(values), key=str)
    wanted: Any = "last" if values[0] is None else {levels[0].kind: distinct if len(distinct) > 1 else values[0]}
    given = (recorded.get("transport") or {}).get("accuracy")
    transport: dict[str, Any] = {"percolation": "every-step", "constriction": "every-step", "flux_at": wanted}
    transport |= {"accuracy": given or ACCURACY, "closing": True, "transmissivity": "every-step"}
    if fine and len(study.cases()) == 1:  # the quadrants of the only surface stand for other windows
        steps = legs[0].steps
        halved = (steps >> k for k in range(1, steps.bit_length()))
        transport["quadrants"] = {"step": sorted({1, *halved})}
    gas = study.fluid is not None and fine  # the budget is that of the liquid
    if gas:
        transport["gas_flow"] = "every-step"
    left_out = ("critical_gap",) if gas else ("critical_gap", "gas_leak_rate")
    units = {name: unit for name, unit in (recorded.get("dimensional") or {}).items() if name not in left_out}
    record = {"region": recorded.get("region"), "dimensional": units or None, "all_legs": len(legs) > 1}
    record |= {"transport": transport, "fields_at": wanted}
    lift = recorded.get("fluid_pressure")
    factors = factors or {}
    if lift is not None:
        scaled = {name: _scaled("pressure", lift[name], factors) for name in ("inlet", "outlet")}
        record["fluid_pressure"] = {**lift, **scaled, "at": wanted, "fields": fine}
    if study.seal is not None and fine:
        record["heights"] = True  # they show a roll-off
    for leg in data["sweep"] if isinstance(data["sweep"], list) else [data["sweep"]]:
        for kind in factors:
            if isinstance(leg.get("to"), dict) and leg["to"].get(kind) is not None:
                leg["to"][kind] = text_of(_scaled(kind, leg["to"][kind], factors))
            if listed := leg.get(f"{kind}s"):
                leg[f"{kind}s"] = [text_of(_scaled(kind, load, factors)) for load in listed]
    of_surface = {f"surface.{name}": value for name, value in keys.items()}
    return study.changed(record=record, sweep=data["sweep"], fluid=data["fluid"] if gas else None, **of_surface)


def _scaled(kind: str, load: Any, factors: Mapping[str, float]) -> Any:
    """Return a starred pressure or a force times the factor of its kind; a pressure with a unit as it is."""
    factor = factors.get(kind, 1.0)
    if kind == "load":
        force = load if isinstance(load, Quantity) else read(load, "force")
        return Quantity(float(force) * factor, str(unit_of(force)))
    return load if unit_of(load) or isinstance(load, str) else load * factor


def compute(
    study: Study,
    at: Level,
    folder: Path,
    *,
    together: Sequence[Level] = (),
    jobs: int | None = None,
    fresh: bool = False,
    on_event: OnEvent = lambda progress: None,
    accept: Callable[[Pressed], None] = lambda fine: None,
) -> CardRuns:
    """Return the runs of a card, each in a folder inside ``folder``; finished runs are read.

    ``accept`` is called with the finest run before the others are computed; it may raise. The runs record all loads of
    `together`, by default the load of the card alone. A coarser run or another levelling may fail: the card then says
    so. Other arguments as in `plan` and `execution.run`.
    """
    planned = plan(study, at, together)
    loads = slug(" ".join(sorted({level.label for level in (at, *together)})))

    def pressed(grid: Planned) -> Pressed:
        inside = folder / loads / slug(grid.words or FINE)
        results = execution.run(grid.study, jobs=jobs, fresh=fresh, out=inside, on_event=on_event)
        return Pressed(grid.words, results, grid.level)

    fine = pressed(planned.fine)
    accept(fine)
    coarser, levelled, no_coarser, no_levelled = list[Pressed](), None, "", ""
    try:
        coarser.extend(map(pressed, planned.coarser))
    except (CampaignError, StudyError) as error:
        no_coarser = f"not computed at {planned.coarser[len(coarser)].words}: {str(error).splitlines()[-1]}"
    try:
        if planned.coarser and not coarser:  # the levelling is changed on its grid
            no_levelled = no_coarser if planned.levelled is not None else ""
        elif planned.levelled is not None:
            levelled = pressed(planned.levelled)
    except (CampaignError, StudyError) as error:
        no_levelled = f"not computed: {str(error).splitlines()[-1]}"
    return CardRuns(fine, tuple(coarser), levelled, no_coarser, no_levelled)
