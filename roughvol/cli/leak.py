"""Answers for a design review: the leak card, and read-offs from a stored sweep."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from roughvol import cli_text
from roughvol.cli.group import examples, main, study_of
from roughvol.cli.numbers import say_json, say_table
from roughvol.cli.options import JOBS, JSON, RUN, SET, STUDY, at, deprecated, out
from roughvol.cli.output import say, warn

if TYPE_CHECKING:
    from roughvol.analysis.read_off import Answer
    from roughvol.store.card_runs import CardRuns
    from roughvol.store.dataset import Dataset


@main.command(
    epilog=examples(
        "roughvol card scan.yaml                                 at the end of its sweep",
        "roughvol card scan.yaml --at pressure=0.3               at p* = 0.3",
        'roughvol card scan.yaml --at "pressure=0.5 MPa"         at a nominal pressure; also load, mean_gap, …',
        'roughvol card metal.yaml --at "pressure=0.1 GPa, leg 2" on the second leg of a path',
        "roughvol card scan.yaml --at pressure=0.3 --json        numbers alone, for programs",
    )
)
@STUDY
@at(several=False, default="last")
@out("runs/NAME_card")
@JOBS
@JSON
@SET
def card(study: Path, state: str, out: Path | None, jobs: int | None, as_json: bool, changes: tuple[str, ...]) -> None:
    """Write the leak card of STUDY: one page in HTML and PDF.

    The card has the leak along x and y at one load, with the error of solver, grid, window and levelling, and the
    loads at which each way closes. Coarser grids and another levelling are computed for it. STUDY is a study file, or
    the folder or name of a run.

    Several height files have a card each and one together, and each combination of lists has its own; a table shows
    all of them. The files of a card are named by its load.
    """
    from roughvol.analysis.leak_budget import card_of, check_reached
    from roughvol.campaign import card as cards
    from roughvol.study import parse

    asked, _ = study_of(study, changes)
    level = parse(state)
    folder = out or Path("runs") / f"{asked.name}_card"
    varied = [change for change in changes if not change.startswith("name=")]
    found: dict[str, dict[str, CardRuns]] = {}
    for variant in asked.variants:
        surfaces = cards.surfaces_of(variant.study)
        accept = check_reached if len(surfaces) == 1 else lambda fine: None
        inside = folder.joinpath("runs", *map(cards.slug, (*varied, variant.words)))
        found[variant.words] = {
            name: cards.compute(one, level, inside / cards.slug(name), jobs=jobs, accept=accept)
            for name, one in surfaces.items()
        }
    if as_json:
        data = {words: card_of(list(runs.values()), asked.name, level.label).plain() for words, runs in found.items()}
        say_json(data if asked.axes else data[""])
        return
    from roughvol.report import card_page
    from roughvol.report.card_text import Identity

    command = ["roughvol", "card", str(study), "--at", state]
    origin = Identity(asked, shlex.join([*command, *(word for change in changes for word in ("--set", change))]))
    pages = []
    for words, runs in found.items():
        single = {name: [one] for name, one in runs.items()} if len(runs) > 1 else {}
        for name, some in ({"": list(runs.values())} | single).items():
            title = ", ".join(filter(None, (asked.name, *varied, words, name)))
            stem = "_".join(filter(None, map(cards.slug, ("card", level.label, *varied, words, name))))
            fine = tuple(one.fine.dataset for one in some)
            pages.append(card_page.Page(card_of(some, title, level.label), fine, origin, stem))
    if len(found) == 1:
        say("\n".join(card_page.lines_of(pages[0])))
    if len(pages) > 1:
        table = card_page.table_of(pages)
        say(cli_text.table(table.head, table.rows))
    paths = [card_page.write(page, folder) for page in pages]
    if len(pages) > 1:
        stem = "_".join(map(cards.slug, ("cards", level.label, *varied)))
        paths.append(card_page.write_table(pages, stem, asked.name, folder))
    for path in paths:
        say(str(path))


PRESSURE = click.option("--pressure", metavar="VALUE", hidden=True)


@main.command(
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
    type=click.Choice(["pressure", "modulus", "Sq"]),
    help="Quantity to find.",
)
@at(several=False)
@JSON
@SET
@PRESSURE
@click.option("--no-solve", is_flag=True, hidden=True)
def ask(
    run: str | None,
    leak_rate: str | None,
    closed: bool,
    unknown: str,
    state: str | None,
    as_json: bool,
    changes: tuple[str, ...],
    pressure: str | None,
    no_solve: bool,
) -> None:
    """Find where the leak of RUN falls to a value: RUN is a folder, a study.nc, a study file, or a name.

    The answer is read off the stored sweep: numbers depend on E* and Sq through p* alone. Nothing is solved. Of several
    surfaces the leakiest decides. The answer has the interval of the reading, and the command that narrows it.
    """
    from roughvol.analysis import gas_leak, read_off
    from roughvol.store import StoredRun
    from roughvol.study.values.units import has_unit

    if (leak_rate is None) == (not closed):
        raise click.UsageError("either --leak-rate VALUE or --closed")
    if no_solve:
        warn(["--no-solve is the only way now: nothing is solved; leave it out"])
    opened = StoredRun.open(run, changes)
    results = opened.dataset
    kelvin, given = None, (leak_rate or "").lstrip("<= ")
    if gas_leak.is_throughput(given):
        results, kelvin = gas_leak.in_place(results, unknown)
    read_off.check(results, leaks=not closed)
    load = _load(results, state, pressure)
    if closed:
        answers = read_off.ask_closed(results, unknown, pressure=load)
    else:
        own = str(results["leak_rate"].attrs["units"])
        largest = _in_unit(given, own, "--leak-rate", "flow" if kelvin is None else "throughput", kelvin)
        given = given if has_unit(given) else f"{given} {own}"
        answers = read_off.ask(results, largest, unknown, pressure=load)
    narrower = read_off.narrower(results, answers)
    every = [word for change in (*changes, *narrower) for word in ("--set", change)]
    finer = shlex.join(["roughvol", "run", run or opened.name, *every])
    if as_json:
        content = {
            "run": opened.name,
            "leak_rate": given or None,
            "at": None if load is None else f"pressure={load:.9g} {results['nominal_pressure'].attrs['units']}",
            "leg": 1,
            "answers": [read_off.record(answer, unknown) for answer in answers],
            "narrower": finer if narrower else None,
        }
        say_json(content)
        return
    leg = read_off.path_words(results)
    sought = {"pressure": "least pressure", "modulus": "largest modulus", "Sq": "largest Sq"}[unknown]
    say(f"{opened.name}{leg and f', {leg}'}: {sought} for {'no open way' if closed else f'a leak up to {given}'}")
    for answer in answers:
        say(f"along {answer.axis}: {_words(answer, unknown, closed=closed)}")
    if any(answer.found for answer in answers):
        say(_beyond(opened.name, results))
    if narrower:
        say(f"Solved states narrow the interval: {finer}")


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


def _beyond(name: str, results: Dataset) -> str:
    """Return what several height files count as, and which errors of a leak a read-off does not have."""
    from roughvol.analysis import read_off

    errors = f"Errors of the grid and of the window are not in these numbers; their factors: roughvol card {name}"
    return "\n".join(filter(None, [read_off.files_words(results), errors]))


def _load(results: Dataset, state: str | None, pressure: str | None) -> float | None:
    """Return the nominal pressure of --at, or of --pressure as in older versions, in the unit of a run."""
    from roughvol.analysis import read_off
    from roughvol.study import parse

    if pressure is not None:
        state = f"pressure={pressure}"
        deprecated("--pressure VALUE", f"--at {shlex.quote(state)}")
    return None if state is None else read_off.nominal_of(results, parse(state))


def _in_unit(text: str, unit: str, option: str, kind: str, kelvin: float | None = None) -> float:
    """Return a quantity with a unit as a number in another unit."""
    from roughvol.errors import Problem, StudyError
    from roughvol.study import convert, read, throughput
    from roughvol.study.values.units import unit_of

    try:
        value = read(text, kind)
        if kelvin is not None:
            return throughput(float(value), unit_of(value) or unit, unit, kelvin)
        return float(convert(float(value), unit_of(value) or unit, unit))
    except (ValueError, StudyError) as error:
        message = f"{option} is {text!r}; allowed: a number with its unit, as in {unit} ({error})"
        raise StudyError([Problem(message)]) from error


@main.command(
    epilog=examples(
        'roughvol creep seal --law creep.yaml --at pressure=0.1MPa --times "1 s..30 day"',
        'roughvol creep seal --law creep.yaml --at pressure=0.1MPa --times "1 min, 1 h, 1 day"',
        "creep.yaml holds one of:",
        "  prony: {shares: [0.3, 0.2], times: [10 s, 1 h]}        1 + sum of shares (1 - exp(-t/times))",
        "  power: {exponent: 0.1, time: 1 s}                      1 + (t/time)^exponent",
        "  table: {times: [1 s, 1 day], ratios: [1, 1.5]}         or moduli: [10 MPa, 6.7 MPa]",
        "and, for a study with material.against, the body that creeps:",
        "  body: first                                            or second, both",
    )
)
@RUN
@click.option("--law", required=True, type=click.Path(path_type=Path), help="YAML file of the creep law J(t)/J(0).")
@at(several=False)
@click.option("--times", required=True, metavar="TIMES", help="Times under load: 'FROM..TO' or a list, with units.")
@out("the run's; for creep.csv and creep.png")
@JSON
@SET
@PRESSURE
def creep(
    run: str | None,
    law: Path,
    state: str | None,
    times: str,
    out: Path | None,
    as_json: bool,
    changes: tuple[str, ...],
    pressure: str | None,
) -> None:
    """Show the leak of RUN over time, for a material that creeps under constant load.

    The modulus of the study is that at once. States at later times are read off the stored sweep: at constant load the
    contact is that of the modulus 1/J(t) (Lee and Radok 1960). Times whose states the sweep does not reach are refused.
    Of several surfaces the leak is the median, with the 16-84 % range and the number of open surfaces.
    """
    from roughvol.analysis import creep as over_time
    from roughvol.analysis import read_off
    from roughvol.report.figures.creep import drawing_of
    from roughvol.store import StoredRun
    from roughvol.study import load_creep, read_times

    opened = StoredRun.open(run, changes)
    results = opened.dataset
    read_off.check(results)
    load = _load(results, state, pressure)
    if load is None:
        raise click.UsageError("needs its constant load, as --at pressure=0.1MPa")
    history = over_time.history(results, load_creep(law), load, read_times(times))
    if as_json:
        say_json({"run": opened.name, "leg": 1} | over_time.record(history))
        return
    leg = read_off.path_words(results)
    say(f"{opened.name}{leg and f', {leg}'}: at {history.pressure:.4g} {history.pressure_unit}")
    say_table(over_time.table_of(history))
    say(_beyond(opened.name, results))
    folder = out or opened.folder
    over_time.write_csv(history, folder / "creep.csv")
    say(str(folder / "creep.csv"))
    if any((leak.value > 0.0).any() for leak in history.leak.values()):
        drawing_of(history, results).savefig(folder / "creep.png")
        say(str(folder / "creep.png"))
    else:
        warn(["nothing leaks at these times, so no figure is drawn"])
