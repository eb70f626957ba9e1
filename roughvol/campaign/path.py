"""The path of a sweep: the indentations of its legs, each from the state in which the leg before ends."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from roughvol.contact.crossing import state_crossing
from roughvol.contact.loading import Compliance, Trials
from roughvol.contact.search import first_indentation, indentation_for
from roughvol.errors import ContactError
from roughvol.observables.levels import end_of, measure_of, options_of, searched
from roughvol.observables.reduction import Reduction
from roughvol.study import Case, Level
from roughvol.surfaces import texture
from roughvol.surfaces.surface import Surface


def indentations(
    case: Case, surface: Surface, half_space: Compliance, reduced: Reduction, ends: list[float]
) -> Iterator[float]:
    """Yield the indentations of the steps that are left, leg by leg.

    Parameters
    ----------
    case : Case
        Its legs, solver, hardness and region.
    surface : Surface
        The whole surface.
    half_space : Compliance
        Of the shape of the surface.
    reduced : Reduction
        States so far; a leg goes on from the last one.
    ends : list of float
        Δ/σ at the ends of the legs begun so far. The end of each further leg is appended.

    Yields
    ------
    float
        Δ/σ [1]. On a periodic surface the approach Δ'/σ.

    Raises
    ------
    ContactError
        If a leg ends before first touch, has no length, or does not reach its end.
    ConvergenceError
        If a state of a search is not solved to the tolerance.
    """
    first = 0  # step at which the leg begins
    for number, leg in enumerate(case.sweep.legs):
        if number == len(ends):
            ends.append(_end(case, number, surface, half_space, reduced))
        begin = ends[number - 1] if number else 0.0
        if ends[number] == begin:
            message = f"leg {number + 1} has no length: the leg before ends at Δ/σ = {begin:.6g}, its end, too"
            raise ContactError(message)
        steps = begin + (ends[number] - begin) * np.arange(1, leg.steps + 1) / leg.steps
        yield from steps[max(0, reduced.steps - first) :]
        first += leg.steps


def _end(case: Case, number: int, surface: Surface, half_space: Compliance, reduced: Reduction) -> float:
    """Return Δ/σ at the end of a leg."""
    target = _level(case.sweep.legs[number].target, surface)
    if number == 0 and not case.plastic:
        return last_indentation(case, surface, half_space)
    if not (searched(target, surface) or target.kind.startswith("percolation")):
        end = _plane(target, surface)
        return end if number else _positive(end, target)
    options, (measure, value) = options_of(case, surface), measure_of(target, case, surface)
    states = reduced.states
    if not states:
        trials = Trials(surface, half_space, **options)
        return state_crossing(trials, measure, value, trials.untouched).approach
    last, before = states[-1], states[-2]["indentation"] if len(states) > 1 else -np.inf
    trials = Trials(surface, half_space, after=last, **options)
    start = trials.known(last, reduced.residual)
    falls, fell = value < measure(start), last["indentation"] < before
    if falls != fell:
        trials = Trials(surface, half_space, after=last, turned=True, **options)
        start = trials.known(last, reduced.residual)
    return state_crossing(trials, measure, value, start).approach


def last_indentation(case: Case, surface: Surface, half_space: Compliance) -> float:
    """Return Δ/σ at the end of the first leg: on a plane, at a value given, or where the search for one ends.

    Parameters
    ----------
    case : Case
        Its target, solver and region; the contact is elastic.
    surface : Surface
        The whole surface.
    half_space : Compliance
        Of the shape of the surface.

    Returns
    -------
    float
        Δ/σ [1].

    Raises
    ------
    ContactError
        If the sweep would end before first touch.
    """
    target = _level(case.sweep.legs[0].target, surface)
    rtol, method = min(case.solver.tolerance, case.solver.pressure_error or 1.0), case.solver.method
    predicate = end_of(case)
    if predicate is not None:
        return first_indentation(surface, half_space, predicate, rtol=rtol, method=method)
    if searched(target, surface):
        kind, value = target.kind, target.value or 0.0
        if kind in ("indentation", "separation"):
            _positive(_plane(target, surface), target)
            kind, value = "free_volume", value if kind == "separation" else _plane(Level("separation", value), surface)
        return indentation_for(surface, half_space, kind, value, rtol=rtol, method=method)
    return _positive(_plane(target, surface), target)


def _level(target: Level, surface: Surface) -> Level:
    """Return the level that a target is on a periodic surface, where no plane can pass the mean one.

    Raises
    ------
    ContactError
        If no state has this separation.
    """
    if not surface.periodic or target.kind not in ("indentation", "separation", "mean-plane", "summit-plane"):
        return target
    indentation, deepest = _plane(target, surface), _plane(Level("mean-plane"), surface)
    if indentation > deepest * (1.0 + 1e-12):
        message = (
            f"a sweep to {target.label} would end at Δ/σ = {indentation:.6g}; allowed on a periodic surface: up to "
            f"{deepest:.6g}, full contact"
        )
        raise ContactError(message)
    full = indentation >= deepest * (1.0 - 1e-12)
    return Level("contact_area", 1.0) if full else Level("indentation", indentation)


def _plane(target: Level, surface: Surface) -> float:
    """Return Δ/σ at an indentation, a separation or a plane of the virgin surface."""
    if target.kind == "indentation":
        return target.value or 0.0
    if target.kind == "summit-plane":
        return (surface.z_max - texture.summit_plane(surface.heights)) / surface.unit
    # d/σ = value; 0 on the mean plane
    return (surface.z_max - surface.mean_height) / surface.unit - (target.value or 0.0)


def _positive(end: float, target: Level) -> float:
    if not end > 0.0:
        message = f"a sweep to {target.label} would end at Δ/σ = {end:.6g}; allowed: beyond first touch, Δ/σ > 0"
        raise ContactError(message)
    return end
