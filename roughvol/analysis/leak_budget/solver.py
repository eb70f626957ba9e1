"""The part of the solver: every gap is right to η, the closing load to the accuracy of its search."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from roughvol.analysis.average import average
from roughvol.analysis.leak import STATE, is_lifted
from roughvol.analysis.leak_budget.state import FLOW, Loaded, closing_of, flow_of, gap_of, leak_of, per_starred
from roughvol.analysis.parts import Part
from roughvol.analysis.tables import number
from roughvol.observables.coupling import ACCURACY, RTOL
from roughvol.observables.levels import CLOSING
from roughvol.observables.requests import flow_accuracy

ERROR = "transmissivity_error"
STEEPEST = 10.0  # largest power of the indentation with which p* rises


def solver_part(fine: Sequence[Loaded], axis: str) -> Part:
    """Return the part of the solver: the leak with all gaps η smaller, and η larger."""
    lifted, low, high = is_lifted(fine[0].table), list[float](), list[float]()
    for surface in fine:
        leak = surface.leak(axis)
        if not math.isfinite(leak):
            continue
        smaller, middle, larger = _flows(surface, axis)
        low.append(leak * smaller / middle if middle else 0.0)
        high.append(leak * larger / middle if middle else larger * per_starred(surface, axis))
    largest = max(_bound(surface, axis) for surface in fine)
    words = f"certified: every gap is right to η/σ = {largest:.1e}"
    if lifted:
        words = (
            f"estimated: contacts are solved to η/σ = {largest:.1e}, the fluid pressure to {ACCURACY:.0e} of the drop"
        )
    flows = max((float(surface.table[ERROR].max()) for surface in fine if ERROR in surface.table), default=0.0)
    if lifted and (study := fine[0].run.study) is not None:  # what the lifted flows were asked for; not stored
        flows = max(flows, flow_accuracy(study.record))
    words += f"; flows to {flows:.0e}" if flows > 0.0 else ""
    below, here, above = (average(FLOW, leaks).value for leaks in (low, [surface.leak(axis) for surface in fine], high))
    if not here > 0.0:
        at_most = f"; closed ways leak at most {number(above)} {fine[0].unit()}" if math.isfinite(above) else ""
        return Part("solver", math.inf, f"{words}{at_most}".strip())
    if not below > 0.0:
        return Part("solver", math.inf, f"{words}; the way may be closed")
    return Part("solver", (1.0 + flows) * max(above / here, here / below), words)


def solver_part_of_load(fine: Sequence[Loaded], axis: str) -> Part:
    """Return the part of the solver of the closing load."""
    found = [span for surface in fine for span in surface.closing[axis].spans]
    if not found or not all(span.closes for span in found):
        return Part("solver", math.nan, "the way does not close within the sweep" if found else "no way is followed")
    if all(span.open_up_to == span.closed_from for span in found):
        words = "" if leak_of(fine, axis).value > 0.0 else solver_part(fine, axis).words
        most = f"; {words}" if "leak at most" in words else ""
        return Part("solver", 1.0 + STEEPEST * CLOSING, f"solved, the indentation to {CLOSING:.0e}{most}")
    low, high = closing_of(fine, axis).bracket
    return Part("solver", math.sqrt(high / low) if low > 0.0 else math.inf, "between two steps of the sweep")


def _flows(surface: Loaded, axis: str) -> tuple[float, float, float]:
    """Return T* V*³ with all gaps η smaller, as they are, and η larger; elements in contact may be open by η."""
    gap, periodic = gap_of(surface.fields, surface.recorded, axis)
    if gap.size == 0:  # closed before the load
        return 0.0, 0.0, math.nan
    bound, flows = _bound(surface, axis), []
    for shift in (-bound, 0.0, bound):
        shifted = np.where(gap > 0.0, np.maximum(gap + shift, 0.0), max(shift, 0.0))
        flows.append(flow_of(shifted, axis, periodic=periodic))
    smaller, middle, larger = flows
    return smaller, middle, larger


def _bound(surface: Loaded, axis: str) -> float:
    """Return η/σ: the largest of the steps, and that to which a state between two steps is solved.

    Under fluid pressure P the gap is right to η and to the displacement of the error of P. The error is taken as a wave
    as long as the longer side: this side/(π E*) times its amplitude.
    """
    if not is_lifted(surface.table):
        return max(float(surface.table["residual"].max()), surface.run.rtol)
    study = surface.run.study
    assert study is not None
    assert study.record.fluid_pressure is not None
    state = surface.fields.sel({STATE: surface.recorded})
    solved, drop = min(RTOL, surface.run.rtol), math.nan
    if f"{STATE}_inlet" in state:  # a surface of the run reaches the state
        drop = float(state[f"{STATE}_inlet"] - state[f"{STATE}_outlet"])
    if study.record.fluid_pressure.coupling == "one-way" or not math.isfinite(drop):
        return solved
    names = ("fluid_leak_dry", "fluid_leak_one_way", "fluid_leak")
    dry, first, last = (float(state[name].sel(axis=axis)) for name in names)
    gain = max(1.0, abs((last - dry) / (first - dry))) if first != dry else 1.0
    longer = max(1.0, surface.fields.sizes["y"] / surface.fields.sizes["x"])  # over L
    return solved + gain * ACCURACY * drop * longer / math.pi
