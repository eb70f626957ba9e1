"""Levels of a sweep: the step that first reaches one, the state between two steps, and the end of the sweep."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from roughvol.contact.bracket import Target
from roughvol.contact.loading import Compliance, Contact, Trials, sweep
from roughvol.contact.options import Options
from roughvol.contact.search import TARGETS, state_crossing, state_reaching
from roughvol.errors import ContactError
from roughvol.observables import void
from roughvol.observables.pressures import starred_hardness
from roughvol.observables.regions import State, window, within
from roughvol.study import STARRED, Case, Level, Scale, Select
from roughvol.study.values.state_kinds import REACHED, Starred, slack
from roughvol.study.values.units import unit_of
from roughvol.surfaces.surface import Surface

LAST = Level("last")
CLOSED = 1e-3  # share of the leak rate of a level below which ways count as closed in a search
ROUNDING = 1e-9  # relative; a state that misses a level by less reaches it
CLOSING = 1e-4  # relative accuracy of the indentation at which a way closes


def end_of(case: Case, target: Level | None = None) -> Callable[[Contact], bool] | None:
    """Return the condition of the last state of the first leg where this is the end of percolation; None elsewhere."""
    target = target or case.sweep.legs[0].target
    if not target.kind.startswith("percolation"):
        return None
    return lambda contact: void.stops_percolating(target.kind, within(contact, case))


def scale_of(case: Case, surface: Surface) -> Scale:
    """Return what turns numbers with units into starred ones of the whole surface, at the Sq of the study, if any."""
    area, Sq = surface.heights.size * surface.spacing**2, case.height or surface.Sq
    return Scale(case.E_star, surface.side, Sq, area, case.modulus_unit, case.length_unit, case.drive)


def starred(level: Level, case: Case, surface: Surface) -> Level:
    """Return a level with a unit as a starred number, which has the label of the level; other levels as they are."""
    if unit_of(level.value) is None:
        return level
    try:
        kind, value = scale_of(case, surface).starred(level.kind, level.value or 0.0)
    except ValueError as error:
        raise ContactError(str(error)) from error
    return Level(kind, Starred(value, level.label), level.leg)


def reached(
    level: Level, step: int, contact: State, case: Case, surface: Surface, before: Mapping[str, float] | None = None
) -> bool:
    """Return whether a state is at or beyond a level. The last step is at the end of the sweep by definition."""
    if level.leg is not None:
        return before is not None and crossed(level, step, contact, case, surface, before)
    if is_defined(level, step, case, surface):
        return True
    if level.value is None:
        return False
    at_end = step == case.sweep.legs[0].steps  # no later step of the leg is nearer: answers take it as the level
    near = slack(level.kind, level.value, REACHED if at_end else ROUNDING)
    if level.kind == "step":
        return step == level.value
    kind = STARRED[level.kind]
    found = float(getattr(contact, kind.stored))
    return found <= level.value + near if kind.falls else found >= level.value - near


def on_legs(asked: Iterable[Level], case: Case, surface: Surface) -> dict[str, Level]:
    """Return starred levels by label, kind by kind, on every leg of the path where the study asks for that."""
    kinds = [*Select.model_fields, LAST.kind]
    found = sorted((starred(level, case, surface) for level in asked), key=lambda level: kinds.index(level.kind))
    legs = range(2, len(case.sweep.legs) + 1) if case.record.all_legs else ()
    states = [level for level in found if level.value is not None and level.kind != "step"]
    found += [replace(level, leg=leg) for leg in legs for level in states]
    return {level.label: level for level in found}


def crossed(level: Level, step: int, contact: State, case: Case, surface: Surface, before: Mapping[str, float]) -> bool:
    """Return whether a level of a further leg lies between the state before and this one, or at one of them.

    A leg begins at the end of the leg before: a level there is of both legs.
    """
    number, place = places_of(case)[step - 1]
    if number + 1 != level.leg:
        return False
    if is_defined(level, step, case, surface):
        return True
    name, value = STARRED[level.kind].stored, level.value or 0.0
    one, other = before[name] - value, float(getattr(contact, name)) - value
    near = slack(level.kind, value)  # answers take the ends of the leg as the level
    at_begin, at_end = place == 0, place == case.sweep.legs[number].steps - 1
    return one * other <= 0.0 or (at_begin and abs(one) <= near) or (at_end and abs(other) <= near)


def is_defined(level: Level, step: int, case: Case, surface: Surface) -> bool:
    """Return whether a leg defines a level at a step, as its end or a listed state; "last" is the end of the last leg.

    The search for a listed state may end short of it, by less than answers see.
    """
    if level == LAST:
        return step == case.sweep.steps
    number, place = places_of(case)[step - 1]
    goal = case.sweep.legs[number].goal_of(place)
    return goal is not None and starred(goal, case, surface).same(replace(level, leg=None))


def places_of(case: Case) -> list[tuple[int, int]]:
    """Return the leg of each step of a path and the place of the step in the leg, both from 0 on."""
    return [(number, place) for number, leg in enumerate(case.sweep.legs) for place in range(leg.steps)]


def options_of(case: Case, surface: Surface) -> Options:
    """Return the options of the solver of a case."""
    solver, hardness = case.solver, starred_hardness(case, surface) if case.plastic else None
    return Options(solver.tolerance, solver.method, pressure_error=solver.pressure_error, hardness=hardness)


def target_of(level: Level, case: Case, surface: Surface) -> Target:
    """Return the quantity of a level that is searched for, with its value, in the region of the study.

    It is A*, p*, the volume closed since the first touch, 1 where no void percolates, or -log(Q/Q_0 + 10⁻³) of the leak
    rate Q asked to be Q_0, finite for closed ways.
    """
    kind, value = level.kind, level.value or 0.0
    if closed_way := end_of(case, level):
        return Target(closed_way, 1.0, elements=True, power=False)
    if kind.startswith("leak_rate"):
        axes = kind.removeprefix("leak_rate").strip("_") or "xy"

        def closing(contact: Contact) -> float:
            rates = void.leak_rates(within(contact, case))
            return -math.log(max(rates[axis] for axis in axes) / value + CLOSED)

        return Target(closing, -math.log(1.0 + CLOSED))
    depth = (surface.z_max - surface.mean_height) / surface.unit
    if kind == "free_volume":
        region = case.record.region
        mean = surface.mean_height if region is None else float(surface.heights[window(case, surface.shape)].mean())
        most = (surface.z_max - mean) / surface.unit
        return Target(lambda contact: most - float(within(contact, case).gap().mean()), most - value)
    if kind in ("indentation", "separation"):
        closed = value if kind == "indentation" else depth - value
        return Target(lambda contact: depth - float(contact.gap().mean()) + contact.plastic_volume, closed)
    stored, elements = TARGETS[kind], kind == "contact_area"
    return Target(lambda contact: float(getattr(within(contact, case), stored)), value, elements=elements)


class Between(NamedTuple):
    """The steps of a sweep around a level.

    `earlier` has `Contact.state` of one or two states before the level. `residual` is η/σ of the last of them. `after`
    is the first step at the level or beyond it.
    """

    case: Case
    surface: Surface
    half_space: Compliance
    earlier: list[Mapping[str, Any]]
    residual: float
    after: Contact


def at_level(level: Level, between: Between) -> Contact:
    """Return the state at a level between two steps, solved or searched for, and leave the sweep as it is."""
    case, surface, half_space, earlier, residual, after = between
    value = level.value or 0.0
    options = options_of(case, surface)
    options = _coarse(options) if level.kind.startswith("percolation") else options
    falls = bool(earlier) and after.approach < earlier[-1]["indentation"]
    if level.searched(endless=surface.endless):
        target = target_of(level, case, surface)
        target = replace(target, value=target.value * (1.0 + (ROUNDING if falls else -ROUNDING)))
        if falls and not target.measure(after) <= target.value:
            return after  # the end of a leg, which misses the level by less than answers see
        trials = Trials(surface, half_space, options, after=after.state())
        start = trials.known(earlier[-1], residual) if earlier else trials.untouched
        end, begun = trials.known(after.state(), after.residual), target.measure(start)
        if earlier and (begun <= target.value if falls else begun >= target.value):
            return start  # a leg that begins at the level
        if case.plastic or falls or start.approach < trials.untouched.approach:
            return state_crossing(trials, target, start, end, brink=False)
        trials.least = start if start.contact_area_fraction > 0.0 else None
        return state_reaching(trials, target, [end] if trials.least is None else [start, end])
    indentation = value if level.kind == "indentation" else after.indentation + after.separation - value
    if abs(indentation - after.indentation) <= ROUNDING * after.indentation:
        return after
    if earlier and abs(indentation - earlier[-1]["indentation"]) <= ROUNDING * indentation:
        return Trials(surface, half_space, options, after=earlier[-1]).known(earlier[-1], residual)
    return next(sweep(surface, half_space, [indentation], options, resume=earlier))


def closing(axis: str, step: int, between: Between) -> Contact | None:
    """Return the state in which the last way along an axis closes, as `at_level`; None where it is open at a step.

    A way that is open at the last step of the first leg is pressed on until it closes, and left open on a surface that
    yields: its pressures end at the hardness.
    """
    case, surface, half_space, *_, after = between
    level = Level(f"percolation-{axis}")
    if void.stops_percolating(level.kind, within(after, case)):
        return after if is_defined(level, step, case, surface) else at_level(level, between)
    if step < case.sweep.legs[0].steps or case.plastic:
        return None
    trials = Trials(surface, half_space, _coarse(options_of(case, surface)))
    trials.least = trials.known(after.state(), after.residual)
    return state_reaching(trials, target_of(level, case, surface), [trials.least], below=True)


def _coarse(options: Options) -> Options:
    """Return options that search for a closing."""
    return replace(options, search=replace(options.search, accuracy=CLOSING))


def before_touch(levels: Iterable[Level], case: Case, surface: Surface, half_space: Compliance) -> set[Level]:
    """Return the levels of the first leg that no state of contact has: those of a wider gap than the first touch."""
    some = [level for level in levels if level.kind in ("free_volume", "separation") and level.leg is None]
    untouched = Trials(surface, half_space, options_of(case, surface)).untouched if some else None
    return {level for level in some if untouched and (level.value or 0.0) >= _at_touch(level, case, surface, untouched)}


def _at_touch(level: Level, case: Case, surface: Surface, untouched: Contact) -> float:
    """Return the separation or the free volume at first touch, over σ."""
    separation = (surface.z_max - surface.mean_height) / surface.unit
    return separation if level.kind == "separation" else float(within(untouched, case).gap().mean())


def check_touch(level: Level, case: Case, surface: Surface, untouched: Contact) -> None:
    """Refuse a sweep to a free volume or a separation that is not below that of the first touch."""
    most = _at_touch(level, case, surface, untouched)
    if (level.value or 0.0) >= most:
        named = (case.sweep.has_units or case.record.has_units) and case.length_unit is not None
        length = f" = {most * (case.height or surface.unit):.6g} {case.length_unit}" if named else ""
        allowed = f"below {most:.6g} σ{length}, that of the first touch"
        message = f"{level.label} lies before the first touch; allowed: {allowed}"
        raise ContactError(message)
