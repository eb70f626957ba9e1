"""The command `compare`: the numbers of several runs at equal loads."""

from __future__ import annotations

import click

import roughvol
from roughvol.cli.options import CSV, JSON, SET, at, command, completed_runs
from roughvol.cli.output import say_numbers, say_table, warn, warn_of


@command
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
    from roughvol.questions import opened

    runs = [opened(name, changes) for name in run]
    found = roughvol.compare(runs, states)
    for stored in {stored.file: stored for stored in runs}.values():
        warn_of(stored.dataset, stored.name)
    if as_csv or as_json:
        warn(found.left_out)
        say_numbers("compare", found.records(), as_csv=as_csv)
    else:
        say_table(found.table())
