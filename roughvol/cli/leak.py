"""Answers for a design review: the leak card, and read-offs from a stored sweep."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from roughvol.cli.group import examples, main, study_of
from roughvol.cli.output import say, warn

if TYPE_CHECKING:
    from roughvol.analysis.read_off import Answer


@main.command(
    epilog=examples(
        "roughvol card scan.yaml                          at the end of its sweep",
        "roughvol card scan.yaml --at pressure=0.3        at p* = 0.3",
        'roughvol card scan.yaml --at "pressure=0.5 MPa"  at a nominal pressure; also load, mean_gap and lengths',
    )
)
@click.argument("study", type=click.Path(path_type=Path))
@click.option(
    "--at",
    "state",
    default="last",
    show_default=True,
    metavar="KIND=VALUE",
    help="The load of the card, starred or with its unit.",
)
@click.option("--out", type=click.Path(path_type=Path), help="Folder of the card [default: runs/NAME_card].")
@click.option("--jobs", type=int, metavar="N", help="Processes [default: all cores].")
def card(study: Path, state: str, out: Path | None, jobs: int | None) -> None:
    """Write the leak card of STUDY: one page in HTML and PDF.

    The card has the leak along x and y at one load, with the error of solver, grid, window and levelling, and the
    pressure at which each way closes. Coarser grids and another levelling are computed for it.
    """
    from roughvol.campaign import card as runs
    from roughvol.report import card_page

    asked, _ = study_of(study)
    folder = out or Path("runs") / f"{asked.name}_card"
    made = runs.compute(asked, runs.level_of(state, asked), folder, jobs=jobs)
    for line in card_page.lines_of(made, asked.name):
        say(line)
    say(str(card_page.write(made, asked.name, folder)))


@main.command(
    epilog=examples(
        'roughvol ask seal --leak-rate "1e-3 mm^3/s"                                   the pressure needed',
        'roughvol ask seal --leak-rate "1e-3 mm^3/s" --for modulus --pressure "0.5 MPa"',
        'roughvol ask seal --leak-rate "1e-3 mm^3/s" --no-solve                        at once, with its error',
    )
)
@click.argument("run", required=False)
@click.option("--leak-rate", required=True, metavar="VALUE", help="Largest leak rate with its unit, as '1e-3 mm^3/s'.")
@click.option(
    "--for",
    "unknown",
    default="pressure",
    show_default=True,
    type=click.Choice(["pressure", "modulus", "Sq"]),
    help="Quantity asked for.",
)
@click.option("--pressure", metavar="VALUE", help="Nominal pressure with its unit, for modulus and Sq.")
@click.option("--no-solve", is_flag=True, help="Read off the stored sweep alone.")
def ask(run: str | None, leak_rate: str, unknown: str, pressure: str | None, no_solve: bool) -> None:
    """Find where the leak of RUN falls below a value: RUN is a folder, a study.nc, a study file, or a name.

    First the answer is read off the stored sweep: numbers depend on E* and Sq through p* alone. It has the error of an
    interpolation, which is estimated. Then a few states are solved, and the answer equals a new run at that value to
    1e-6. Their number is printed.
    """
    from roughvol.analysis import gas_leak
    from roughvol.analysis.read_off import ask as read_off
    from roughvol.store import StoredRun
    from roughvol.study.units import has_unit

    opened = StoredRun.open(run)
    results = opened.dataset
    kelvin, given = None, leak_rate.lstrip("<= ")
    if gas_leak.is_throughput(given):
        results, kelvin = gas_leak.in_place(results, unknown)
    if "leak_rate_x" not in results or "nominal_pressure" not in results:
        largest, at = 1.0, None  # `ask` refuses with the reason
    else:
        own = str(results["leak_rate_x"].attrs["units"])
        kind = "flow" if kelvin is None else "throughput"
        largest = _in_unit(given, own, "--leak-rate", kind, kelvin)
        given = given if has_unit(given) else f"{given} {own}"
        own = str(results["nominal_pressure"].attrs["units"])
        at = _in_unit(pressure, own, "--pressure", "pressure") if pressure is not None else None
    answers = read_off(results, largest, unknown, pressure=at)
    say(f"{opened.name}: leak up to {given}")
    for answer in answers:
        say(f"along {answer.axis}: {_words(answer, unknown)}")
    found = [answer for answer in answers if math.isfinite(answer.nominal) and answer.nominal > 0.0]
    if no_solve or not found:
        return
    if kelvin is not None:
        warn(["the answers have the error of the read-off: solves refine the leak of a liquid alone"])
        return
    from roughvol.campaign import inverse
    from roughvol.errors import CampaignError, DatasetError

    try:
        study = opened.pressable()
    except DatasetError as error:
        warn([f"the answers have the error of the read-off: {error}"])
        return
    for answer in found:
        start = at if unknown == "Sq" else None
        try:
            refined = inverse.refine(study, results, answer.axis, largest, answer.nominal, scaled_from=start)
        except CampaignError as error:
            warn([f"along {answer.axis} the answer has the error of the read-off: {error}"])
            continue
        value = refined.nominal if at is None or unknown == "pressure" else at / refined.nominal
        say(f"along {answer.axis}: {unknown} {value:.9g} {answer.unit}, to 1e-6 by {refined.solves} solves")


def _words(answer: Answer, unknown: str) -> str:
    """Return a read-off in words."""
    low, high = answer.between
    if answer.nominal == 0.0:
        return f"any {unknown} of p* = {high:.4g} or more: the first step leaks less; smaller loads are not stored"
    if math.isinf(answer.nominal):
        return f"no {unknown} within the stored loads, up to p* = {low:.4g}"
    steps = f"between the steps p* = {low:.4g} and {high:.4g}"
    error = f"read off to about {100.0 * answer.error:.1g} %" if math.isfinite(answer.error) else "read off"
    return f"{unknown} {answer.value:.4g} {answer.unit}, {steps}, {error}"


def _in_unit(text: str, unit: str, option: str, kind: str, kelvin: float | None = None) -> float:
    """Return a quantity with a unit as a number in another unit."""
    from roughvol.errors import Problem, StudyError
    from roughvol.study import convert, read, throughput
    from roughvol.study.units import unit_of

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
        'roughvol creep seal --law creep.yaml --pressure "0.1 MPa" --times "1 s..30 day"',
        'roughvol creep seal --law creep.yaml --pressure "0.1 MPa" --times "1 min, 1 h, 1 day"',
        "creep.yaml holds one of:",
        "  prony: {shares: [0.3, 0.2], times: [10 s, 1 h]}        1 + sum of shares (1 - exp(-t/times))",
        "  power: {exponent: 0.1, time: 1 s}                      1 + (t/time)^exponent",
        "  table: {times: [1 s, 1 day], ratios: [1, 1.5]}         or moduli: [10 MPa, 6.7 MPa]",
    )
)
@click.argument("run", required=False)
@click.option("--law", required=True, type=click.Path(path_type=Path), help="YAML file of the creep law J(t)/J(0).")
@click.option("--pressure", required=True, metavar="VALUE", help="Constant nominal pressure with its unit.")
@click.option("--times", required=True, metavar="TIMES", help="Times under load: 'FROM..TO' or a list, with units.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder of creep.csv and creep.png [default: the run's].")
def creep(run: str | None, law: Path, pressure: str, times: str, out: Path | None) -> None:
    """Show the leak of RUN over time, for a material that creeps under constant load.

    The modulus of the study is that at once. States at later times are read off the stored sweep: at constant load the
    contact is that of the modulus 1/J(t) (Lee and Radok 1960). Times whose states the sweep does not reach are refused.
    """
    from roughvol.analysis import creep as over_time
    from roughvol.analysis.read_off import check_leaks
    from roughvol.report.figures.creep import drawing_of
    from roughvol.store import StoredRun
    from roughvol.study import load_creep, read_times

    opened = StoredRun.open(run)
    results = opened.dataset
    check_leaks(results)
    at = _in_unit(pressure, str(results["nominal_pressure"].attrs["units"]), "--pressure", "pressure")
    history = over_time.history(results, load_creep(law), at, read_times(times))
    for line in over_time.lines_of(history):
        say(line)
    folder = out or opened.folder
    over_time.write_csv(history, folder / "creep.csv")
    say(str(folder / "creep.csv"))
    if any((leak > 0.0).any() for leak in history.leak.values()):
        drawing_of(history).savefig(folder / "creep.png")
        say(str(folder / "creep.png"))
    else:
        warn(["nothing leaks at these times, so no figure is drawn"])
