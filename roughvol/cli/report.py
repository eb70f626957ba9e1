"""The command `report`: a report of runs, with the claims of the paper."""

from __future__ import annotations

from pathlib import Path

import click

import roughvol
from roughvol.cli.options import JSON, SET, command, completed_runs, out
from roughvol.cli.output import count, say, say_json, warn
from roughvol.errors import CampaignError


@command
@click.argument("run", nargs=-1, shell_complete=completed_runs)
@out("the run, or runs/report")
@click.option(
    "--check",
    "expected",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="JSON with expected verdicts and bands of numbers; a departure is an error.",
)
@JSON
@SET
def report(
    run: tuple[str, ...], out: Path | None, expected: Path | None, as_json: bool, changes: tuple[str, ...]
) -> None:
    """Report on RUN..., as report.html, report.md and claims.json [default: all runs].

    A RUN is a folder, a study.nc, a study file, or a name under runs/. Runs of the paper's configuration answer its
    claims; others are refused by name and reason. Every other run, such as one of a measured map, gets its own
    section: surface, loading, states, closing pressures, warnings, figures.
    """
    from roughvol.report import page
    from roughvol.reproduction.judgement import departures

    found = roughvol.report_on(run, changes=changes)
    warn(found.refused)
    written = found.write(out)
    if as_json:
        say_json(found.plain())
    else:
        say(page.summary(found.report))
        say(written)
    left = departures(found.judgement, expected.read_bytes()) if expected else []
    if left:
        head = f"{count(len(left), 'answer')} left the bands of {expected}"
        raise CampaignError("\n".join([head, *(f"  {departure}" for departure in left)]))
