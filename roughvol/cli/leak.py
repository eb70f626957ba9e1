"""Answers for a design review: the leak card, and read-offs from a stored sweep."""

from __future__ import annotations

import math
from pathlib import Path

import click

from roughvol.cli.group import examples, main, results_file, run_name


@main.command(
    epilog=examples(
        "roughvol card scan.yaml                          at the end of its sweep",
        "roughvol card scan.yaml --at pressure=0.3        at p* = 0.3",
    )
)
@click.argument("study", type=click.Path(path_type=Path))
@click.option("--at", "state", default="last", show_default=True, metavar="KIND=VALUE", help="The load of the card.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder of the card [default: runs/NAME_card].")
@click.option("--jobs", type=int, metavar="N", help="Processes [default: all cores].")
def card(study: Path, state: str, out: Path | None, jobs: int | None) -> None:
    """Write the leak card of STUDY: one page in HTML and PDF.

    The card has the leak along x and y at one load, with the error of solver, grid, window and levelling, and the
    pressure at which each way closes. Coarser grids and another levelling are computed for it.
    """
    from roughvol.campaign import card as runs
    from roughvol.report import card_page
    from roughvol.study import load

    asked = load(study)
    folder = out or Path("runs") / f"{asked.name}_card"
    made = runs.compute(asked, runs.level_of(state), folder, jobs=jobs)
    for line in card_page.lines_of(made, asked.name):
        click.echo(line)
    click.echo(str(card_page.write(made, asked.name, folder)))


@main.command(
    epilog=examples(
        'roughvol ask seal --leak-rate "1e-3 mm^3/s"                                   the pressure needed',
        'roughvol ask seal --leak-rate "1e-3 mm^3/s" --for modulus --pressure "0.5 MPa"',
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
def ask(run: str | None, leak_rate: str, unknown: str, pressure: str | None) -> None:
    """Read off a stored sweep where the leak of RUN falls below a value: RUN is a folder, a study.nc, or a name.

    Nothing is solved: starred numbers depend on E* and Sq through p* alone. Between two steps the logarithm of the leak
    is linear in the pressure.
    """
    from roughvol.report import gas_leak
    from roughvol.report.ask import ask as read_off
    from roughvol.store import dataset

    results = dataset.read(results_file(run))
    kelvin = None
    if gas_leak.is_throughput(leak_rate.lstrip("<= ")):
        results, kelvin = gas_leak.in_place(results, unknown)
    if "leak_rate_x" not in results or "nominal_pressure" not in results:
        largest, at = 1.0, None  # `ask` refuses with the reason
    else:
        own = str(results["leak_rate_x"].attrs["units"])
        kind = "flow" if kelvin is None else "throughput"
        largest = _in_unit(leak_rate.lstrip("<= "), own, "--leak-rate", kind, kelvin)
        own = str(results["nominal_pressure"].attrs["units"])
        at = _in_unit(pressure, own, "--pressure", "pressure") if pressure is not None else None
    click.echo(f"{run_name(results_file(run))}: leak up to {leak_rate.lstrip('< ')}")
    for answer in read_off(results, largest, unknown, pressure=at):
        low, high = answer.between
        enough = math.isinf(answer.value) if unknown != "pressure" else answer.value == 0.0
        if enough:
            words = f"any {unknown}"
        elif math.isinf(answer.value) or answer.value == 0.0:
            words = f"no {unknown} within the stored loads"
        else:
            words = f"{unknown} {answer.value:.4g} {answer.unit}, between the steps p* = {low:.4g} and {high:.4g}"
        click.echo(f"along {answer.axis}: {words}")


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
