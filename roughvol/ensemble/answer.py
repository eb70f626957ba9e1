"""The answer of an ensemble as stored variables, and in sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from roughvol.ensemble.design import Design, Estimates
from roughvol.ensemble.estimate import MeanEstimate
from roughvol.ensemble.samples import SampleTable
from roughvol.ensemble.step_error import StepErrors
from roughvol.ensemble.targets import PERCOLATION
from roughvol.observables.variables import DTYPES, MISSING, VARIABLES
from roughvol.study.values.durations import duration

Values = dict[str, tuple[tuple[str, ...], Any]]
DRY = "record.fluid_pressure lifts the gap; all means are those of the gap without fluid pressure"


def variables(design: Design) -> Values:
    """Return an answer as stored variables: dimensions and values by name."""
    table = design.table
    dimensions = sorted(table.dimensions)
    states = list(dict.fromkeys(target.state.label for target in table.targets))
    rounds = max(len(history) for history in design.rounds.values())
    sizes = {"D": len(dimensions), "m": len(table.levels), "ensemble_at": len(states), "bound": 2, "round": rounds}
    values: Values = {
        "ensemble_at": (("ensemble_at",), np.array(states, dtype=object)),
        "bound": (("bound",), np.array(["lower", "upper"], dtype=object)),
        "round": (("round",), np.arange(rounds)),
    }
    values |= _costs(design, dimensions, rounds)
    for row, D in enumerate(dimensions):
        for number, estimate in enumerate(design.estimates[D]):
            column = states.index(estimate.target.state.label)
            half_widths = _padded([history[number] for _, history in design.rounds[D]], rounds)
            for suffix, value in (_values_of(estimate) | {"round_half_width": half_widths}).items():
                name = f"{estimate.target.stored}_{suffix}"
                dims = tuple(VARIABLES[name].dims.split())
                if name not in values:
                    kind = VARIABLES[name].kind
                    values[name] = (dims, np.full([sizes[dim] for dim in dims], MISSING[kind], dtype=DTYPES[kind]))
                index = tuple({"D": row, "ensemble_at": column}.get(dim, slice(None)) for dim in dims)
                values[name][1][index] = value
    return values


def _costs(design: Design, dimensions: Sequence[float], rounds: int) -> Values:
    """Return the number of samples on each level, and the modelled costs."""
    table, estimates = design.table, design.estimates
    by_round = [_padded([cost for cost, _ in design.rounds[D]], rounds) for D in dimensions]
    return {
        "ensemble_samples": (("D", "m"), [table.counts(D) for D in dimensions]),
        "ensemble_surfaces": (("D",), [len(table.surfaces[D]) for D in dimensions]),
        "ensemble_sample_cost": (("D", "m"), [estimates[D][0].costs for D in dimensions]),
        "ensemble_cost": (("D",), [table.cost(D) for D in dimensions]),
        "ensemble_plain_cost": (("D",), [_plain_cost(estimates[D]) for D in dimensions]),
        "ensemble_round_cost": (("D", "round"), by_round),
    }


def _plain_cost(estimates: Sequence[MeanEstimate]) -> float:
    """Return the modelled seconds of plain Monte Carlo for all means at one D, from common samples."""
    return max(estimate.plain_cost for estimate in estimates)


def _values_of(estimate: MeanEstimate) -> dict[str, Any]:
    """Return the values of one mean by the suffix of their names."""
    mean = estimate.mean
    samples = {link.level: float(link.samples) for link in mean.links}
    return {
        "mean": mean.value,
        "interval": [mean.value - mean.half_width, mean.value + mean.half_width],
        "bias": estimate.bias,
        "freedom": mean.freedom,
        "accuracy_asked": estimate.requested,
        "step_error": estimate.interpolation_error,
        "step_error_high": not estimate.steps_suffice,
        "solver_error": estimate.solver_error,
        "level_mean": estimate.level_means,
        "level_variance": estimate.level_variances,
        "level_residual": estimate.residual_variances,
        "level_correlation": [math.nan, *estimate.correlations],
        "level_samples": [samples.get(level, 0.0) for level in range(len(estimate.costs))],
    }


def _padded(values: Sequence[float], length: int) -> list[float]:
    return [*values, *[math.nan] * (length - len(values))]


def sentences(design: Design) -> list[str]:
    """Return an answer in sentences: each mean with all its errors, then samples and costs for each D."""
    finest = design.table.finest
    lines = [_sentence(estimate, D, finest) for D, estimates in design.estimates.items() for estimate in estimates]
    for D, estimates in design.estimates.items():
        lines.append(_cost_sentence(D, design.table, estimates))
        lines += [_interpolation_remark(estimate) for estimate in estimates]
    study = design.table.study
    lines += [_steps_sentence(study.sweep.steps, design.steps), design.stopped]
    lines.append(DRY if study.record.fluid_pressure is not None else "")
    return list(dict.fromkeys(filter(None, lines)))


def progress(estimates: Estimates) -> str:
    """Return the mean with the largest half-width over its accuracy, for a line of progress."""
    D, worst = max(
        ((D, estimate) for D, row in estimates.items() for estimate in row),
        key=lambda pair: pair[1].mean.half_width / pair[1].target.half_width(pair[1].mean.value),
    )
    half_width, accuracy = _relative(worst, worst.mean.half_width), worst.target.accuracy
    return f"{worst.target.symbol} at D = {D:g} ± {half_width} of ± {accuracy}"


def _sentence(estimate: MeanEstimate, D: float, m: int) -> str:
    """Return a mean in one line: value, interval, and the errors by resolution, interpolation and solver."""
    target, mean = estimate.target, estimate.mean
    state = f" at {target.state.label.replace('=', ' = ')}"
    if target.state.value is None:
        state = "" if target.state == PERCOLATION else " at the last step"
    if estimate.converges:
        resolution = f"resolution {_relative(estimate, estimate.bias)}"
    elif len(estimate.level_means) == 1:
        resolution = "resolution: not known from one level"
    else:
        resolution = f"resolution: does not converge with m, this is the value at m = {m}"
    certified = estimate.solver_error > 0.0
    solver = f"solver {_relative(estimate, estimate.solver_error)} certified" if certified else "solver not certified"
    freedom = f"seeds, 95 % t interval, {mean.freedom:.0f} degrees of freedom"
    scatter = freedom if math.isfinite(mean.freedom) else "the same on all seeds"
    request = "" if estimate.reached else f"; asked for ± {target.accuracy}"
    return (
        f"mean {target.symbol}{state}, D = {D:g}, m = {m}: "
        f"{mean.value:.5g} ± {_relative(estimate, mean.half_width)} "
        f"({scatter}), {resolution}, "
        f"between steps {_relative(estimate, estimate.interpolation_error)}, {solver}{request}"
    )


def _cost_sentence(D: float, table: SampleTable, estimates: Sequence[MeanEstimate]) -> str:
    """Return the samples on each level and the modelled costs in one line."""
    levels, cost = table.levels, table.cost(D)
    samples = ", ".join(f"{number} samples at m = {m}" for m, number in zip(levels, table.counts(D), strict=True))
    samples += f", {len(table.surfaces[D])} surfaces without a solve"
    plain = _plain_cost(estimates)
    costs = f"{duration(cost)} of one core by the cost model, plain Monte Carlo {duration(plain)}"
    text = f"D = {D:g}: {samples}; {costs}"
    used = {level for estimate in estimates for level in estimate.plan.levels}
    unused = [str(m) for level, m in enumerate(levels) if level not in used]
    if plain <= cost:
        return f"{text}; levels do not pay here"
    return f"{text}; no use of m = {', '.join(unused)}" if unused else text


def _steps_sentence(number: int, steps: StepErrors) -> str:
    """Return the number of steps, and the origin of the errors between them, in one line."""
    origin = "nothing is interpolated between them"
    if steps.surfaces:
        origin = f"the errors between them are those of {steps.surfaces} trial surfaces with more steps"
    return f"{number} steps a sweep; {origin}"


def _interpolation_remark(estimate: MeanEstimate) -> str:
    if estimate.steps_suffice:
        return ""
    target = estimate.target
    return (
        f"the error between steps of {target.quantity} at {target.state.label}, "
        f"{_relative(estimate, estimate.interpolation_error)}, passes a tenth of the accuracy, {target.accuracy}: "
        "take more sweep.steps"
    )


def _relative(estimate: MeanEstimate, error: float) -> str:
    """Return an error relative to a mean other than 0 if the accuracy is relative, else as it is."""
    mean = abs(estimate.mean.value)
    if not estimate.target.accuracy.relative or not mean:
        return f"{error:.2g}"
    return f"{100.0 * error / mean:.2g} %"
