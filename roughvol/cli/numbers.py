"""Numbers on the screen: show, compare and ls."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from roughvol import cli_text
from roughvol.cli.group import examples, main
from roughvol.cli.options import CSV, JSON, RUN, SET, at, completed_runs, deprecated
from roughvol.cli.output import say
from roughvol.study.values.durations import duration

if TYPE_CHECKING:
    from roughvol.analysis.stored_run import Run
    from roughvol.analysis.tables import Table
    from roughvol.study import Level


@main.command(
    epilog=examples(
        "roughvol show seal                           its steps",
        "roughvol show seal --at pressure=0.5MPa      the state at a load",
        "roughvol show seal --csv > seal.csv          every surface and step, by stored names",
    )
)
@RUN
@at(several=True)
@CSV
@JSON
@SET
def show(run: str | None, states: tuple[str, ...], as_csv: bool, as_json: bool, changes: tuple[str, ...]) -> None:
    """Print the numbers of RUN: a folder, a study.nc, a study file, or a name under runs/ [default: the latest].

    Between two steps, numbers lie on straight lines over the quantity asked for; flows and openings on those of their
    logarithms. A state beyond the steps is an error. Several surfaces are shown by their mean; --csv and --json have
    each of them. An ensemble has its means last. `roughvol explain NAME` describes a column.
    """
    from roughvol.report import screen

    _one_form(as_csv, as_json)
    opened, wanted = _opened(run, changes), _wanted(states)
    if as_csv or as_json:
        names, rows, units = screen.records(opened, wanted)
        _write(names, rows, units if as_json else None, opened.name)
        return
    for part in opened.parts:
        for table in screen.shown(part, wanted):
            say_table(table.under(part.name.removeprefix(opened.name).removeprefix(", ")))
    if answer := opened.dataset.attrs.get("answer"):
        say(answer)


@main.command(
    epilog=examples(
        "roughvol compare metal_seal metal_seal_elastic",
        "roughvol compare dry wet --at pressure=0.5MPa --at pressure=1MPa",
        "roughvol compare seals                       the materials of a study with a list of them",
    )
)
@click.argument("run", nargs=-1, required=True, shell_complete=completed_runs)
@at(several=True)
@CSV
@JSON
@SET
def compare(
    run: tuple[str, ...], states: tuple[str, ...], as_csv: bool, as_json: bool, changes: tuple[str, ...]
) -> None:
    """Print the numbers of RUN RUN... side by side at equal loads; of one run with lists, its combinations.

    Without --at, the loads are nominal pressures that all runs reach, or p* where one has no units. Units are those of
    the first run. The rule between steps is that of `roughvol show`.
    """
    from roughvol.report import screen

    _one_form(as_csv, as_json)
    opened = [part for name in run for part in _opened(name, changes).parts]
    if len(opened) < 2:
        raise click.UsageError("compare takes two runs or more; one is shown by: roughvol show RUN")
    found = screen.compared(opened, _wanted(states))
    if as_csv or as_json:
        names, rows, units = found.records()
        _write(names, rows, units if as_json else None, "compare")
        return
    say_table(found.table())


@main.command(epilog=examples("roughvol ls", "roughvol ls /data/runs", "roughvol ls --json"))
@click.argument("folder", type=click.Path(path_type=Path), default=Path("runs"), metavar="[FOLDER]")
@click.option("--out", type=click.Path(path_type=Path), hidden=True)
@JSON
def ls(folder: Path, out: Path | None, as_json: bool) -> None:
    """List all runs in FOLDER [default: runs], the latest first: name, state, size, age."""
    from roughvol.store import runs

    if out is not None:
        deprecated("ls --out FOLDER", "ls FOLDER")
        folder = out
    found = runs.listed(folder)
    if as_json:
        rows = [{"run": one.name, "state": one.state, "bytes": one.size, "seconds": round(one.age)} for one in found]
        say_json({"folder": str(folder), "units": {"bytes": "byte", "seconds": "s"}, "rows": rows})
        return
    if not found:
        say(f"no run in {folder}; start one with: roughvol run STUDY")
        return
    lines = [(one.name, one.state, cli_text.size(one.size), f"{duration(one.age)} ago") for one in found]
    say(cli_text.table(("run", "state", "size", "changed"), lines))


def say_table(table: Table) -> None:
    """Print a table with its title above and its note below."""
    if table.title:
        say(table.title)
    say(cli_text.table(table.head, table.rows))
    if table.note:
        say(f"  {table.note}")


def say_json(content: Mapping[str, Any]) -> None:
    """Print JSON; numbers that are not finite are null."""
    say(json.dumps(_finite(content), indent=1, ensure_ascii=False, allow_nan=False))


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _opened(run: str | None, changes: Sequence[str]) -> Run:
    from roughvol.analysis.stored_run import Run
    from roughvol.store import StoredRun

    stored = StoredRun.open(run, changes)
    return Run.of(stored.name, stored.dataset)


def _wanted(states: Sequence[str]) -> list[Level]:
    from roughvol.study import parse

    return [parse(text) for text in states]


def _one_form(as_csv: bool, as_json: bool) -> None:
    if as_csv and as_json:
        raise click.UsageError("--csv and --json exclude each other")


def _write(names: Sequence[str], rows: Sequence[Sequence[Any]], units: dict[str, str] | None, name: str) -> None:
    """Print rows as JSON where units are given, else as CSV; a missing value is empty there."""
    if units is not None:
        say_json({"run": name, "units": units, "rows": [dict(zip(names, row, strict=True)) for row in rows]})
        return
    say(cli_text.csv_text(names, rows), nl=False)
