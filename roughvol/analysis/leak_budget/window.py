"""The part of the window: the t interval of the logarithms of several surfaces, or of the quadrants of the only map."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from roughvol.analysis.closing import load_of
from roughvol.analysis.leak import is_lifted
from roughvol.analysis.leak_budget.state import Loaded, flow_of, gap_of, part_of_surfaces
from roughvol.analysis.parts import Part
from roughvol.ensemble.multilevel import COVERAGE, half_width
from roughvol.observables.void import quarters
from roughvol.typing import Array

# standard error of the median of many normal numbers over that of their mean; of few numbers it is less
OF_MEDIAN = math.sqrt(0.5 * math.pi)
PERCENT = f"{100.0 * COVERAGE:.0f} %"  # of the intervals, in words
QUADRANTS = 1.2  # quadrants of a map share its long waves: python -m tests.bench.window_coverage


def window_part(fine: Sequence[Loaded], axis: str) -> Part:
    """Return the part of the window of the leak: surfaces among each other, or the quadrants of the only one.

    Where surfaces or quadrants are closed, it is the part of the closing load. It is not known where a surface is not
    pressed to the load: the others are no fair sample.
    """
    if len(fine) == 1:
        return _window_of_quadrants(fine[0], axis)
    values = np.array([surface.leak(axis) for surface in fine])
    if absent := absent_words(values):
        return Part("window", math.nan, absent)
    if (values > 0.0).all():
        wider = OF_MEDIAN if values.size > 2 else 1.0  # the median of two is their mean
        words = f"{PERCENT} interval of the median over {values.size} surfaces, of logarithms by t"
        return Part("window", math.exp(wider * _half(values)), words)
    closed = f"{np.count_nonzero(values == 0.0)} of {values.size} surfaces are closed"
    if not (of_loads := window_part_of_load(fine, axis)).known:
        return Part("window", math.inf, f"{closed}: other windows of the joint may be open")
    log = math.log(of_loads.factor)
    ends = [(surface.leak_if(axis, -log), surface.leak_if(axis, log)) for surface in fine]
    return part_of_surfaces("window", fine, ends, axis, f"{closed}: from the closing load, {of_loads.words}")


def absent_words(leaks: Array) -> str:
    """Return how many surfaces are not pressed to the load of their leaks; empty where all are."""
    absent = np.count_nonzero(np.isnan(leaks))
    return f"{absent} of {leaks.size} surfaces are not pressed to this load" if absent else ""


def _window_of_quadrants(surface: Loaded, axis: str) -> Part:
    """Return the part of the window of the leak of the only surface."""
    gap, periodic = gap_of(surface.fields, surface.recorded, axis)
    flows = np.array([flow_of(part, axis) for part in quarters(gap)])
    shut = f", {np.count_nonzero(flows == 0.0)} closed" if (flows == 0.0).any() else ""
    words = f"scatter of the leaks of the quadrants of the map{shut}, {PERCENT} by t, times {QUADRANTS}"
    if surface.leads and not is_lifted(surface.table):
        log = scatter_of_loads(surface, axis, flows / flow_of(gap, axis, periodic=periodic), surface.load)
        ends = surface.leak_if(axis, -log), surface.leak_if(axis, log)
        return part_of_surfaces("window", [surface], [ends], axis, words)
    if shut:
        return Part("window", math.inf, f"{words}: other windows of the joint may be open")
    return Part("window", math.exp(QUADRANTS * _half(flows)), words)


def scatter_of_loads(surface: Loaded, axis: str, ratios: Array, load: float) -> float:
    """Return the part of the window of loads, as a logarithm, from the leaks of quadrants over that of the map.

    Each quadrant has the load at which the map leaks as much; a closed quadrant has the closing load.
    """
    here = surface.leak_at(axis, load)
    return QUADRANTS * _half(np.array([surface.load_at(axis, here * ratio) for ratio in ratios]))


def window_part_of_load(fine: Sequence[Loaded], axis: str) -> Part:
    """Return the part of the window of the closing load: surfaces among each other, or the quadrants of the only one.

    The leaks of the quadrants are those at a light load: at the last recorded step with ways through the map and a
    quadrant.
    """
    if len(fine) > 1:
        loads = np.array([surface.closing[axis].value for surface in fine])
        if not np.isfinite(loads).all():
            return Part("window", math.inf, f"{np.count_nonzero(~np.isfinite(loads))} of {loads.size} do not close")
        words = f"{PERCENT} interval of the mean over {loads.size} surfaces, of logarithms by t"
        return Part("window", math.exp(_half(loads)), words)
    surface, table = fine[0], fine[0].loading
    starred = f"transmissivity{'_dry' if is_lifted(surface.table) else ''}"
    along = table["quadrant_flow"].sel(axis=axis).dropna("step", how="all") if "quadrant_flow" in table else None
    if along is None or not along.size:
        return Part("window", math.nan, "the flows of its quadrants are not stored")
    steps = table[[starred, "free_volume", load_of(table)]].sel(step=along["step"].values, axis=axis)
    flows = steps[starred].values * steps["free_volume"].values ** 3
    loads = steps[load_of(table)].values
    last = int(np.flatnonzero((flows > 0.0) & (along.values > 0.0).any(axis=1)).max(initial=-1))
    if last < 0:
        closed = "all quadrants are" if flows[0] > 0.0 else "the map is"
        return Part("window", math.nan, f"{closed} closed at {surface.closing[axis].load(float(loads[0]))}")
    load = float(loads[last])
    log = scatter_of_loads(surface, axis, along.values[last] / flows[last], load)
    if math.isnan(log):
        return Part("window", math.nan, f"the map is open at one step alone, {surface.closing[axis].load(load)}")
    at = f"the quadrants of the map at {surface.closing[axis].load(load)}"
    words = f"scatter of the leaks of {at}, {PERCENT} by t, times {QUADRANTS}, as loads of equal leak"
    return Part("window", math.exp(log), words)


def _half(values: Array) -> float:
    """Return the half-width of the interval of the mean logarithm."""
    return float(half_width(float(np.log(values).std(ddof=1)), values.size))
