"""The command `ask`: the pressure, modulus or Sq at which the leak falls to a value."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

import click

import roughvol
from roughvol.cli.options import BUDGET, JOBS, JSON, RUN, SET, at, command
from roughvol.cli.output import say, say_json, warn_of

if TYPE_CHECKING:
    from roughvol.analysis.read_off import Answer
    from roughvol.store import StoredRun
    from roughvol.store.dataset import Dataset

SOUGHT = {"pressure": "least pressure", "modulus": "largest modulus", "Sq": "largest Sq"}

NARROWS = {
    "solver": "a smaller solver.rtol narrows the interval most",
    "grid": "a map of finer spacing narrows the interval most: a smaller downsample, or a larger m",
    "window": "more maps of the joint narrow the interval most: surface.files, or more seeds",
    "levelling": "a map that shows the form of the face narrows the interval most",
}


@command
@RUN
@click.option("--leak-rate", metavar="VALUE", help="Largest leak, as '1e-3 mm^3/s'; a number has the unit of the run.")
@click.option("--closed", is_flag=True, help="No open way, in place of a leak rate.")
@click.option(
    "--for",
    "unknown",
    default="pressure",
    show_default=True,
    type=click.Choice(list(SOUGHT)),
    help="Quantity to find.",
)
@at(several=False)
@BUDGET
@JOBS
@JSON
@SET
def ask(
    run: str | None,
    leak_rate: str | None,
    closed: bool,
    unknown: Literal["pressure", "modulus", "Sq"],
    state: str | None,
    budget: bool,
    jobs: int | None,
    as_json: bool,
    changes: tuple[str, ...],
) -> None:
    """Find where the leak of RUN falls to a value.

    RUN is a folder, a study.nc, a study file, or a name under runs/ [default: the latest].

    The answer is read off the stored sweep: numbers depend on E* and Sq through p* alone. Of several surfaces the
    leakiest decides. The answer has the interval of the reading, and the command that narrows it or goes on. Nothing is
    solved, but for --budget: then the interval has the errors of solver, grid, window and levelling too. A modulus and
    an Sq are found at the pressure or load of --at.
    """
    if (leak_rate is None) == (not closed):
        raise click.UsageError("either --leak-rate VALUE or --closed")
    from roughvol.analysis.read_off import SOLVES_CLOSING, is_beyond

    found = roughvol.ask(run, leak_rate=leak_rate, unknown=unknown, at=state, budget=budget, jobs=jobs, changes=changes)
    warn_of(found.run.dataset)
    if as_json:
        say_json(found.plain())
        return
    wanted = "no open way" if closed else f"a leak up to {found.leak_rate}"
    say(f"{titled(found.run.name, found.run.dataset)}: {SOUGHT[unknown]} for {wanted}")
    for answer in found.answers:
        say(f"along {answer.axis}: {_words(answer, unknown, closed=closed)}")
        if answer.budget is not None:
            say(f"  {_of_budget(answer)}")
    beyond_loads = any(map(is_beyond, found.answers))
    errors = budget or not any(answer.found for answer in found.answers)  # without an answer no errors are missing
    for line in beyond(found.run, has_errors=errors):
        say(line)
    if (narrower := found.command()) and not (budget and not beyond_loads):
        longer = "A solved closing load answers" if SOLVES_CLOSING in found.narrower else "A longer sweep answers"
        say(f"{longer if beyond_loads else 'Solved states narrow the interval'}: {narrower}")


def titled(name: str, results: Dataset) -> str:
    """Return the name of a run, with its combination of lists and the leg that read-offs are from, of several."""
    from roughvol.analysis import read_off
    from roughvol.store.variants import parts_of

    return ", ".join(filter(None, (name, parts_of(results)[0].words, read_off.path_words(results))))


def beyond(run: StoredRun, *, has_errors: bool) -> Iterator[str]:
    """Yield how several height files count, and which errors of a leak a read-off does not have."""
    from roughvol.analysis import read_off
    from roughvol.store.variants import of_one_combination

    results = of_one_combination(run.dataset)
    yield from filter(None, (read_off.files_words(results), read_off.seal_words(results)))
    if not has_errors:
        card = f"; with them: --budget, or roughvol card {run.call}" if run.has_study else "."
        yield f"Errors of the grid and of the window are not in these numbers{card}"


def _of_budget(answer: Answer) -> str:
    """Return the parts of the error of an answer as factors, the largest first."""
    from roughvol.analysis import read_off
    from roughvol.analysis.tables import number

    parts = sorted(read_off.parts_of(answer), key=lambda part: -part.factor if part.known else -math.inf)
    factors = ", ".join(f"{part.name} {f'× {number(part.factor, 3)}' if part.known else 'unknown'}" for part in parts)
    of = "closing load" if answer.nominal.closing else "leak"
    if not parts:
        return f"errors of the {of}: unknown"
    why = [part.words for part in parts if not part.known] or [NARROWS[parts[0].name]]
    return f"errors of the {of}: {factors}; {'; '.join(why)}"


def _words(answer: Answer, unknown: str, *, closed: bool) -> str:
    """Return a read-off in words."""
    from roughvol.analysis.tables import rounded

    of_pressure = unknown == "pressure"
    first, last = (_load(answer, end, in_units=of_pressure) for end in (0, 1))
    if answer.between[0] == 0.0:
        steps = f"before the first known load, {last}"
    elif math.isfinite(answer.between[1]):
        steps = f"between the known loads {first} and {last}"
    else:
        steps = f"beyond {first}"
    of = f", for the leakiest of {answer.surfaces} surfaces ({answer.surface})" if answer.surfaces > 1 else ""
    unit = "" if answer.unit == "1" else f" {answer.unit}"
    name = {"pressure": "pressure" if unit else "p* =", "modulus": "modulus E* =", "Sq": "Sq"}[unknown]
    if answer.nominal.value == 0.0:
        every = f" on all {answer.surfaces} surfaces" if answer.surfaces > 1 else ""
        known = f"{'is closed' if closed else 'leaks less'}{every}"
        if of_pressure:
            least = _load(answer, 1, in_units=True, upwards=True)
            return f"any pressure of {least} or more: the first known load {known}; smaller loads are not known"
        most = f"{'E* = ' if unknown == 'modulus' else ''}{_rounded(answer.low, upwards=False)}{unit}"
        return f"any {unknown} up to {most}: the first known load, {last}, {known}; a larger {unknown} is not known"
    if not answer.found:
        return f"no {unknown} within the stored loads, up to {first}{of}"
    closes = ", where the last way closes" if answer.nominal.closing else ""
    between = f"{_rounded(answer.low, upwards=False)} to {_rounded(answer.high, upwards=True)}"
    if closes and answer.budget is None and answer.nominal.low < answer.steps[0]:
        steps = ""  # a seal closes between the steps of several patches
    by_itself = math.isclose(answer.nominal.high, answer.steps[1])  # no other surface ends the interval
    if closes and not closed and answer.budget is None and by_itself:
        # the patches of a seal are between two of their steps, so the interval may begin before the step of the seal
        begins = math.isclose(answer.nominal.low, answer.steps[0], rel_tol=1e-6)
        open_, closed_ = ("", "") if of_pressure else (f", {first},", f", {last}")  # the ends of the interval
        begin = f"from the last open step{open_} " if begins else ""
        closes, steps = "", f"{begin}to the closing of the last way{closed_}"
        text = f"{name} {between}{unit}"
    elif closes and answer.low < answer.value == answer.high:
        text = f"{name} {between}{unit}"
        steps = "" if (answer.low, answer.high) == answer.steps else steps
    else:
        value = rounded(answer.value, answer.low, answer.high, upwards=of_pressure)
        text = f"{name} {value}{unit}{_interval(answer, unknown, unit)}"
    text += closes
    if not of_pressure:
        scale = answer.times / answer.value
        times = rounded(answer.times, scale * answer.low, scale * answer.high, upwards=False)
        text += f", {times} times the {'E*' if unknown == 'modulus' else 'Sq'} of the study"
    return ", ".join(filter(None, (text, steps))) + of


def _rounded(value: float, *, upwards: bool | None = None) -> str:
    """Return a number in four digits: the nearest, or on one side."""
    from roughvol.analysis.tables import rounded

    return rounded(value, value, value, upwards=upwards)


def _load(answer: Answer, end: int, *, in_units: bool, upwards: bool | None = None) -> str:
    """Return a load beside an answer: a nominal pressure where the study has units, or p*."""
    if in_units and answer.load_unit != "1":
        return f"{_rounded(answer.steps[end], upwards=upwards)} {answer.load_unit}"
    return f"p* = {_rounded(answer.between[end], upwards=upwards)}"


def _interval(answer: Answer, unknown: str, unit: str) -> str:
    """Return the interval of an answer in words, rounded outwards; with errors its safe end."""
    from roughvol.analysis.tables import with_interval

    _, low, high = with_interval(answer.value, answer.low, answer.high)
    known = answer.low > 0.0, math.isfinite(answer.high)
    if not any(known):
        return ", its error is not known"
    words = {(True, True): f"{low} to {high}", (False, True): f"up to {high}", (True, False): f"{low} or more"}[known]
    safe, is_safe = (high, known[1]) if unknown == "pressure" else (low, known[0])
    if answer.budget is None or not is_safe:
        return f" ({words})" if answer.low < answer.high else ""
    return f" ({words}; {safe}{unit} with 95 %)"
