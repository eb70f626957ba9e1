"""The error of an answer against its cost: the mean V* over all surfaces, by seeds, m, steps and residual.

The answer is the mean of V* at one p*. The ladders of `tradeoff` have the errors of single surfaces. Here an ensemble
is sampled in memory. Its levels give the scatter over seeds and the distance between resolutions.

The total error of a setting is the sum of four parts, each relative to the mean: half-width of the 95 % interval over
seeds, resolution, steps, and solver. Each choice varies alone about `SEEDS` seeds on the finest m with the steps of the
study and the residual of `standard`. Costs are modelled seconds of one core (see `samples`). Those of other steps and
residuals are scaled by the measured times of the ladders.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from roughvol.campaign import ensemble, steps
from roughvol.campaign.estimates import MeanEstimate
from roughvol.campaign.one_case import HalfSpaces, arrays_of_case
from roughvol.observables.allocation import NORMAL
from roughvol.store.dataset import Arrays, Dataset
from roughvol.store.tradeoff_variables import ANSWER, CHOICES, PARTS
from roughvol.study import ACCURACY, Case, MadeSurface, Study, of_data

SEEDS = 100  # seeds of the setting about which each choice varies
SEED_COUNTS = (10, 30, 100, 300, 1000)
LEVELS = 4  # finest m compared
REQUEST = "2 %"  # accuracy of the sampled ensemble
DIMENSIONS = 3  # most D


def answerable(study: Study) -> bool:
    """Return whether the surfaces of a study have an ensemble, which those of height files have not.

    Parameters
    ----------
    study : Study
        The study of the ladders.

    Returns
    -------
    bool
        True for generated surfaces with one sweep in equal steps.
    """
    return isinstance(study.surface, MadeSurface) and study.sweep.legs[0].listed is None and study.ensemble is None


def with_answer(ladders: Dataset, study: Study) -> Dataset:
    """Return the dataset of the ladders with the errors and costs of the answer.

    Parameters
    ----------
    ladders : Dataset
        From `tradeoff.measure`.
    study : Study
        The same study; see `answerable`.

    Returns
    -------
    Dataset
        With the variables `store.tradeoff_variables.ANSWER`, relative errors and seconds.

    Raises
    ------
    StudyError
        If the sweep of a surface ends before the state of the others.
    """
    asked, pressure = _asked(study)
    assert isinstance(asked.surface, MadeSurface)
    compute = _in_memory()
    found = ensemble.estimate_means(asked, compute)
    rows = [_of_dimension(found, D, ladders, asked) for D in asked.surface.dimensions]
    result = ladders.assign_coords(
        answer_D=("answer_D", np.array(asked.surface.dimensions)),
        answer_choice=("answer_row", np.array([choice for choice, *_ in rows[0]], dtype=object)),
        answer_setting=("answer_row", np.array([setting for _, setting, *_ in rows[0]])),
    )
    for number, name in enumerate(("answer_cost", *PARTS)):
        values = [[row[2 + number] for row in of_D] for of_D in rows]
        result[name] = (("answer_D", "answer_row"), np.array(values, dtype=np.float64))
    for name, variable in ANSWER.items():
        result[name].attrs = {"units": variable.units, "long_name": variable.long_name, "symbol": variable.symbol}
    return result.assign_attrs(answer_at=f"pressure = {pressure:g}", answer_seeds=SEEDS)


def _asked(study: Study) -> tuple[Study, float]:
    """Return the ensemble of a study at half the smallest p* at the end of its sweep, rounded to one digit."""
    data = study.model_dump(mode="json")
    surface, name = data["surface"], "D" if "D" in data["surface"] else "H"
    dimensions = surface[name] if isinstance(surface[name], list) else [surface[name]]
    if len(dimensions) > DIMENSIONS:
        surface[name] = [dimensions[round(k)] for k in np.linspace(0, len(dimensions) - 1, DIMENSIONS)]
    size = "m" if "m" in surface else "n"
    surface[size] = max(surface[size]) if isinstance(surface[size], list) else surface[size]
    surface.pop("seeds", None)
    data |= {"ensemble": {"accuracy": {"free_volume": REQUEST}, "at": {"indentation": 1.0}}, "record": {}}
    first = of_data(data)
    half_spaces: HalfSpaces = {}
    ends = [float(arrays_of_case(case, half_spaces)["mean_pressure"][1].reshape(-1)[-1]) for case in first.cases()]
    half = 0.5 * min(ends)
    digit = 10.0 ** math.floor(math.log10(half))
    pressure = float(f"{math.floor(half / digit) * digit:.3g}")
    data["ensemble"]["at"] = {"pressure": pressure}
    return of_data(data), pressure


def _in_memory() -> ensemble.Compute:
    """Return a function that computes cases here, without files."""
    half_spaces: HalfSpaces = {}

    def compute(cases: Sequence[Case]) -> Mapping[str, Arrays]:
        return {case.id: arrays_of_case(case, half_spaces) for case in cases}

    return compute


def _of_dimension(found: ensemble.Answer, D: float, ladders: Dataset, study: Study) -> list[tuple[Any, ...]]:
    """Return choice, setting, cost and parts of the error, row by row."""
    (estimate,) = found.estimates[D]
    mean, levels = abs(estimate.mean.value), found.samples.levels
    spread, costs = [math.sqrt(v) / mean for v in estimate.level_variances], estimate.costs
    distances = _distances(estimate)
    between = _between_steps(study, ladders)
    solver, times = _of_solver(ladders, D, mean)
    standard, given = ACCURACY["standard"], int(study.sweep.steps)

    def row(choice: str, setting: float, level: int, seeds: float, slow: float, k: int, rtol: float) -> tuple[Any, ...]:
        seeds_error = NORMAL * spread[level] / math.sqrt(seeds)
        parts = (seeds_error, distances[level], between[k], solver[rtol])
        return choice, setting, slow * seeds * costs[level], *parts

    finest = len(levels) - 1
    rows = [row("seeds", n, finest, n, 1.0, given, standard) for n in SEED_COUNTS]
    rows += [
        row("m", levels[k], k, SEEDS, 1.0, given, standard) for k in range(max(0, finest + 1 - LEVELS), finest + 1)
    ]
    rows += [row("steps", k, finest, SEEDS, times["steps", k], k, standard) for k in between]
    rows += [row("rtol", rtol, finest, SEEDS, times["rtol", rtol], given, rtol) for rtol in solver]
    for number, (cost, (half_width, *_)) in enumerate(found.rounds[D]):
        parts = (half_width / mean, distances[finest], between[given], solver[standard])
        rows.append(("ensemble", number, cost, *parts))
    rounds = max(len(history) for history in found.rounds.values())
    missing = [("ensemble", number, *[math.nan] * 5) for number in range(len(found.rounds[D]), rounds)]
    return rows + missing


def _distances(estimate: MeanEstimate) -> list[float]:
    """Return the relative distance of each level from the limit in m; from the finest level without one."""
    means, bias = estimate.level_means, estimate.weak_error.bias
    remaining = bias if estimate.weak_error.converges else 0.0
    return [(abs(mean - means[-1]) + remaining) / abs(means[-1]) for mean in means]


def _between_steps(study: Study, ladders: Dataset) -> dict[int, float]:
    """Return the relative error between steps by their number, as many as the ladder has."""
    assert study.ensemble is not None
    numbers = sorted({int(k) for k in ladders["steps"].values[ladders["ladder"].values == "steps"]})
    request = float(study.ensemble.accuracy.named["free_volume"])
    return {k: request * steps.errors_of(study, k)[0] for k in numbers}


def _of_solver(ladders: Dataset, D: float, mean: float) -> tuple[dict[float, float], dict[tuple[str, float], float]]:
    """Return the relative error by residual, and the times over that of the setting of comparison."""
    one = ladders.isel(surface=np.flatnonzero(ladders["D"].values == D))
    tolerance = (one["ladder"].values == "tolerance") & (one["precision"].values == "mixed")
    rungs = np.flatnonzero(tolerance)
    rtols = [float(rtol) for rtol in one["rtol"].values[rungs]]
    seconds = one["seconds"].values.mean(axis=1)
    base = seconds[rungs[int(np.argmin(np.abs(np.log(np.array(rtols) / ACCURACY["standard"]))))]]
    errors = dict(zip(rtols, one["free_volume_error"].values[rungs].mean(axis=1) / mean, strict=True))
    errors = {_near(rtol): error for rtol, error in errors.items()}
    times = {("rtol", _near(rtol)): seconds[k] / base for rtol, k in zip(rtols, rungs, strict=True)}
    of_steps = np.flatnonzero(one["ladder"].values == "steps")
    most = seconds[of_steps[int(np.argmax(one["steps"].values[of_steps]))]]
    times |= {("steps", int(one["steps"].values[k])): seconds[k] / most for k in of_steps}
    return errors, times


def _near(rtol: float) -> float:
    """Return the named accuracy equal to a residual, else the residual."""
    return next((named for named in ACCURACY.values() if math.isclose(named, rtol, rel_tol=1e-9)), rtol)


def summary(ds: Dataset) -> str:
    """Return the parts of the error of the answer and the cheapest remedies, as lines of text.

    Parameters
    ----------
    ds : Dataset
        From `with_answer`.

    Returns
    -------
    str
        Two lines for each D.
    """
    lines = [f"error of the mean V* at {ds.attrs['answer_at']}, relative, and modelled seconds of one core"]
    for D in ds["answer_D"].values.tolist():
        one = ds.sel(answer_D=D)
        base = one.isel(answer_row=_rows(ds, "m")[-1])
        parts = ", ".join(f"{name.split('_')[1]} {100 * float(base[name]):.2g} %" for name in PARTS)
        m, seeds = int(base["answer_setting"]), int(ds.attrs["answer_seeds"])
        lines.append(f"D = {D:g}, m = {m}, {seeds} seeds: {parts}; {float(base['answer_cost']):.3g} s")
        ended = one.isel(answer_row=_rows(ds, "ensemble")).dropna("answer_row")
        last = ended.isel(answer_row=-1)
        interval, cost = 100 * float(last["answer_seeds_error"]), float(last["answer_cost"])
        lines.append(f"D = {D:g}, ensemble: seeds {interval:.2g} %, the rest as above; {cost:.3g} s")
    return "\n".join(lines)


def _rows(ds: Dataset, choice: str) -> Any:
    assert choice in CHOICES
    return np.flatnonzero(ds["answer_choice"].values == choice)
