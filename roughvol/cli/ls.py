"""The command `ls`: all runs of a folder."""

from __future__ import annotations

from pathlib import Path

import click

import roughvol
from roughvol.campaign.machine import size
from roughvol.cli.options import JSON, command
from roughvol.cli.output import say, say_json
from roughvol.report import terminal
from roughvol.study.values.durations import duration


@command
@click.argument("folder", type=click.Path(path_type=Path), default=Path("runs"), metavar="[FOLDER]")
@JSON
def ls(folder: Path, as_json: bool) -> None:
    """List all runs in FOLDER [default: runs], the latest first: name, state, size, age."""
    found = roughvol.runs(folder)
    if as_json:
        rows = [{"run": run.name, "state": run.state, "bytes": run.size, "seconds": round(run.age)} for run in found]
        say_json({"folder": str(folder), "units": {"bytes": "byte", "seconds": "s"}, "rows": rows})
        return
    if not found:
        say(f"no run in {folder}; start one with: roughvol run STUDY")
        return
    lines = [(run.name, run.state, size(run.size), f"{duration(run.age)} ago") for run in found]
    say(terminal.aligned(("run", "state", "size", "changed"), lines))
