"""The steps and searches of `roughvol/ensemble/cost.py` beside measured ones.

`python -m tests.bench.cost_rule [m …]`. Each row has the time of a step, without STEP, and of a search. It is in
convolutions of the grid, on one core, measured and by the rule. The last column is the whole case, by the rule over
measured. The last lines are shares of all cases.
"""

import sys
import time
from collections.abc import Callable
from typing import Any
from unittest import mock

from threadpoolctl import threadpool_limits

from roughvol.campaign import path
from roughvol.campaign.cost import seconds_per_convolution
from roughvol.campaign.one_case import Context, arrays_of_case
from roughvol.contact import loading
from roughvol.ensemble import cost
from roughvol.study import loads

ENDS = ("mean-plane", "{pressure: 0.1}", "{pressure: 0.5}", "{pressure: 2}", "{contact_area: 0.1}")
ENDS += ("{contact_area: 0.4}", "percolation", "{separation: -3}")
STEPS = (1, 4, 10, 30, 90)


def measure(text: str, context: Context) -> tuple[float, float, float, float]:
    """Return the seconds of the steps, of the search, and of the case, and its contact area."""
    taken = {"step": 0.0, "search": 0.0}

    def timed(name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*arguments: Any, **named: Any) -> Any:
            started = time.process_time()
            try:
                return work(*arguments, **named)
            finally:
                taken[name] += time.process_time() - started

        return wrapped

    case = loads(text).cases()[0]
    step, after = timed("step", loading._step), timed("search", path.Path.after)
    with mock.patch.object(loading, "_step", step), mock.patch.object(path.Path, "after", after):
        started = time.process_time()
        arrays = arrays_of_case(case, context)
        whole = time.process_time() - started
    return taken["step"], taken["search"], whole, float(arrays["contact_area_fraction"][1].max())


def main() -> int:
    """Measure and print."""
    context, ratios = Context(), list[float]()
    print("m  D    end                  steps  A*    rule   a step  rule   search  rule   case: rule over measured")
    for m in [int(text) for text in sys.argv[1:]] or [4, 5, 6, 7]:
        shape = (2**m + 1,) * 2
        convolution = seconds_per_convolution(shape)
        arrays_of_case(loads(f"surface: {{D: 2.2, m: {m}, seeds: 1}}").cases()[0], context)  # plans and tables
        for D, end, steps in ((D, end, steps) for D in (2.2, 2.6) for end in ENDS for steps in STEPS):
            text = f"surface: {{D: {D}, m: {m}, seeds: [1]}}\nsweep: {{steps: {steps}, to: {end}}}"
            case = loads(text).cases()[0]
            with threadpool_limits(1):
                stepped, searched, whole, area = measure(text, context)
            expected = cost.expected_area(case.sweep.target, case)
            rule = cost.convolutions_per_step(shape, case.solver.tolerance, expected, steps)
            settled = cost.seconds_per_step(shape, case.solver.tolerance, convolution, expected, cost.SETTLED)
            number = cost.CLOSING if end == "percolation" else cost.SEARCH * cost.searches(case.sweep, case)
            ratios.append(cost.expected_seconds(case, convolution) / (whole + cost.CASE))
            print(
                f"{m}  {D}  {end:20s} {steps:4d}  {area:.3f}  {expected:.3f}"
                f"  {(stepped / steps - cost.STEP) / convolution:6.1f} {rule:6.1f}"
                f"  {searched / convolution:6.0f} {number * settled / convolution:6.0f}"
                f"  {ratios[-1]:5.2f}",
                flush=True,
            )
    for factor in (1.5, 2.0):
        within = sum(1.0 / factor <= ratio <= factor for ratio in ratios)
        print(f"{within} of {len(ratios)} cases, {within / len(ratios):.0%}, within a factor of {factor:g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
