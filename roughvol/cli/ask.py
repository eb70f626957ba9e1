"""The command `ask`: the pressure, modulus or Sq at which the leak falls to a value."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

import roughvol
from roughvol.cli.options import JSON, RUN, SET, at, examples
from roughvol.cli.output import say, say_json

if TYPE_CHECKING:
    from roughvol.analysis.read_off import Answer
    from roughvol.store.dataset import Dataset

SOUGHT = {"pressure": "least pressure", "modulus": "largest modulus", "Sq": "largest Sq"}


@click.command(
    epilog=examples(
        'roughvol ask seal --leak-rate "1e-6 mm^3/s"                                the pressure needed',
        'roughvol ask seal --leak-rate "1e-6 mm^3/s" --for modulus --at pressure=0.05MPa',
        "roughvol ask seal --closed                                                 where the last way closes",
    )
)
@RUN
@click.option("--leak-rate", metavar="VALUE", help="Largest leak rate with its unit, as '1e-3 mm^3/s'.")
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
@JSON
@SET
def ask(
    run: str | None,
    leak_rate: str | None,
    closed: bool,
    unknown: str,
    state: str | None,
    as_json: bool,
    changes: tuple[str, ...],
) -> None:
    """Find where the leak of RUN falls to a value: RUN is a folder, a study.nc, a study file, or a name.

    The answer is read off the stored sweep: numbers depend on E* and Sq through p* alone. Nothing is solved. Of several
    surfaces the leakiest decides. The answer has the interval of the reading, and the command that narrows it.
    """
    if (leak_rate is None) == (not closed):
        raise click.UsageError("either --leak-rate VALUE or --closed")
    found = roughvol.ask(run, leak_rate=leak_rate, unknown=unknown, at=state, changes=changes)
    narrower = found.command(run or "", changes)
    if as_json:
        say_json(found.plain() | {"narrower": narrower or None})
        return
    wanted = "no open way" if closed else f"a leak up to {found.leak_rate}"
    say(f"{titled(found.run.name, found.run.dataset)}: {SOUGHT[unknown]} for {wanted}")
    for answer in found.answers:
        say(f"along {answer.axis}: {_words(answer, unknown, closed=closed)}")
    if any(answer.found for answer in found.answers):
        say(beyond(found.run.name, found.run.dataset))
    if narrower:
        say(f"Solved states narrow the interval: {narrower}")


def titled(name: str, results: Dataset) -> str:
    """Return the name of a run, with the leg that read-offs are from where it has several."""
    from roughvol.analysis import read_off

    return ", ".join(filter(None, (name, read_off.path_words(results))))


def beyond(name: str, results: Dataset) -> str:
    """Return how several height files count, and which errors of a leak a read-off does not have."""
    from roughvol.analysis import read_off

    errors = f"Errors of the grid and of the window are not in these numbers; their factors: roughvol card {name}"
    return "\n".join(filter(None, [read_off.files_words(results), read_off.seal_words(results), errors]))


def _words(answer: Answer, unknown: str, *, closed: bool) -> str:
    """Return a read-off in words."""
    from roughvol.analysis.tables import number, rounded

    low, high = (number(end) for end in answer.between)
    of = f", for the leakiest of {answer.surfaces} surfaces ({answer.surface})" if answer.surfaces > 1 else ""
    if answer.nominal.value == 0.0:
        first = "the first step is closed" if closed else "the first step leaks less"
        every = f" of all {answer.surfaces} surfaces" if answer.surfaces > 1 else ""
        return f"any {unknown} of p* = {high} or more: {first}{every}; smaller loads are not stored"
    if not answer.found:
        return f"no {unknown} within the stored loads, up to p* = {low}{of}"
    unit = "" if answer.unit == "1" else f" {answer.unit}"
    name = {"pressure": "pressure" if unit else "p* =", "modulus": "modulus E* =", "Sq": "Sq"}[unknown]
    if answer.nominal.closing:
        text = f"{name} {number(answer.low)} to {number(answer.high)}{unit}, where the last way closes"
    else:
        value, *ends = (rounded(one, answer.low, answer.high) for one in (answer.value, answer.low, answer.high))
        text = f"{name} {value}{unit} ({ends[0]} to {ends[1]})"
    if unknown != "pressure":
        text += f", {number(answer.times)} times the {'E*' if unknown == 'modulus' else 'Sq'} of the study"
    return f"{text}, between the steps p* = {low} and {high}{of}"
