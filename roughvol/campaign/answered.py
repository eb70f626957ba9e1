"""The answer of an ensemble as stored variables, and in sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from roughvol.campaign.ensemble import Answer, Standing
from roughvol.store.answer import BOUNDS
from roughvol.store.variables import VARIABLES
from roughvol.study import levels_below

Values = dict[str, tuple[tuple[str, ...], Any]]


def variables(answer: Answer) -> Values:
    """Return what `store.answer.with_answer` stores of an answer: dimensions and values by name."""
    ensembles = answer.ensembles
    dimensions, levels = sorted(ensembles.dimensions), ensembles.levels
    states = list(dict.fromkeys(target.state.label for target in ensembles.targets))
    rounds = max(len(each) for each in answer.rounds.values())
    values: Values = {
        "ensemble_at": (("ensemble_at",), np.array(states, dtype=object)),
        "bound": (("bound",), np.array(BOUNDS, dtype=object)),
        "round": (("round",), np.arange(rounds)),
        "ensemble_samples": (("D", "m"), [ensembles.have(D) for D in dimensions]),
        "ensemble_sample_cost": (("D", "m"), [answer.standings[D][0].costs for D in dimensions]),
        "ensemble_cost": (("D",), [ensembles.cost(D) for D in dimensions]),
        "ensemble_plain_cost": (("D",), [max(one.plain_cost for one in answer.standings[D]) for D in dimensions]),
        "ensemble_round_cost": (
            ("D", "round"),
            [_padded([cost for cost, _ in answer.rounds[D]], rounds) for D in dimensions],
        ),
    }
    shape = {"D": len(dimensions), "m": len(levels), "ensemble_at": len(states), "bound": 2, "round": rounds}
    for row, D in enumerate(dimensions):
        for number, one in enumerate(answer.standings[D]):
            column = states.index(one.target.state.label)
            halves = _padded([each[number] for _, each in answer.rounds[D]], rounds)
            for suffix, value in (_of(one) | {"round_half_width": halves}).items():
                name = f"{one.target.stored}_{suffix}"
                dims = tuple(VARIABLES[name].dims.split())
                if name not in values:
                    values[name] = (dims, np.full([shape[dim] for dim in dims], np.nan))
                place = tuple({"D": row, "ensemble_at": column}.get(dim, slice(None)) for dim in dims)
                values[name][1][place] = value
    return values


def _of(one: Standing) -> dict[str, Any]:
    levels = range(len(one.costs))
    used = {link.level: float(link.samples) for link in one.mean.links}
    low, high = one.mean.value - one.mean.half_width, one.mean.value + one.mean.half_width
    return {
        "mean": one.mean.value,
        "interval": [low, high],
        "bias": one.weak.bias,
        "freedom": one.mean.freedom,
        "accuracy_asked": one.wanted,
        "step_error": one.between,
        "solver_error": one.solver,
        "level_mean": one.level_means,
        "level_variance": one.level_variances,
        "level_residual": one.residuals,
        "level_correlation": [math.nan, *one.correlations],
        "level_samples": [used.get(k, 0.0) for k in levels],
    }


def _padded(values: Sequence[float], length: int) -> list[float]:
    return [*values, *[math.nan] * (length - len(values))]


def sentences(answer: Answer) -> list[str]:
    """Return the answer: a line for each mean with its whole error, and for each D what it cost."""
    m = answer.ensembles.m
    lines = []
    for D, each in answer.standings.items():
        lines += [sentence(one, D, m) for one in each]
    for D, each in answer.standings.items():
        have = dict(zip(levels_below(m), answer.ensembles.have(D), strict=True))
        cost, plain = answer.ensembles.cost(D), max(one.plain_cost for one in each)
        unused = [level for level in range(len(have)) if not any(level in one.plan.levels for one in each)]
        text = (
            f"D = {D:g}: {', '.join(f'{n} samples at m = {level}' for level, n in have.items())}; "
            f"{duration(cost)} of one core by the cost model, plain Monte Carlo {duration(plain)}"
        )
        if plain <= cost:
            text += "; levels do not pay here"
        elif unused:
            text += f"; no use of m = {', '.join(str(list(have)[level]) for level in unused)}"
        lines.append(text)
        lines += [advice for one in each if (advice := _between_advice(one))]
    if answer.stopped:
        lines.append(answer.stopped)
    return list(dict.fromkeys(lines))


def sentence(one: Standing, D: float, m: int) -> str:
    """Return a mean and its whole error in one line."""
    symbol = VARIABLES[one.target.stored].symbol
    at = "the last step" if one.target.state.value is None else one.target.state.label.replace("=", " = ")
    if one.weak.converges:
        resolution = f"resolution {_share(one, one.weak.bias)}"
    else:
        resolution = f"resolution: does not converge with m, this is the value at m = {m}"
    solver = f"solver {_share(one, one.solver)} certified" if one.solver > 0.0 else "solver not certified"
    held = "" if one.holds else f"; asked for ± {one.target.accuracy}"
    return (
        f"mean {symbol} at {at}, D = {D:g}, m = {m}: {one.mean.value:.5g} ± {_share(one, one.mean.half_width)} "
        f"(seeds, 95 % t interval, {one.mean.freedom:.0f} degrees of freedom), {resolution}, "
        f"between steps {_share(one, one.between)}, {solver}{held}"
    )


BETWEEN = 0.1  # of the accuracy: the most that the interpolation between steps should take


def _between_advice(one: Standing) -> str:
    if one.between <= BETWEEN * one.wanted:
        return ""
    return f"the error between steps of {one.target.quantity} passes a tenth of the accuracy: take more sweep.steps"


def _share(one: Standing, value: float) -> str:
    """Return an error relative to the mean or absolute, as the accuracy is."""
    if not one.target.accuracy.relative:
        return f"{value:.2g}"
    return f"{100.0 * value / abs(one.mean.value):.2g} %" if one.mean.value else "inf %"


def standing(standings: Mapping[float, Sequence[Standing]]) -> str:
    """Return the mean that is farthest from its accuracy, for a line of progress."""
    D, one = max(
        ((D, one) for D, each in standings.items() for one in each),
        key=lambda pair: pair[1].mean.half_width / max(pair[1].wanted, 1e-300),
    )
    symbol = VARIABLES[one.target.stored].symbol
    return f"{symbol} at D = {D:g} ± {_share(one, one.mean.half_width)} of ± {one.target.accuracy}"


def duration(seconds: float) -> str:
    """Return a time as it is read."""
    for limit, unit, size in ((100.0, "s", 1.0), (6000.0, "min", 60.0), (3e5, "h", 3600.0)):
        if seconds < limit:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 86400.0:.3g} days"
