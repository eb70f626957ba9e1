"""The command `show`: the numbers of a run."""

from __future__ import annotations

import roughvol
from roughvol.cli.options import CSV, JSON, RUN, SET, at, command
from roughvol.cli.output import say, say_numbers, say_parts, say_table, warn, warn_of


@command
@RUN
@at(several=True)
@CSV
@JSON
@SET
def show(run: str | None, states: tuple[str, ...], as_csv: bool, as_json: bool, changes: tuple[str, ...]) -> None:
    """Print the numbers of RUN: a folder, a study.nc, a study file, or a name under runs/ [default: the latest].

    Between two steps, numbers lie on monotone cubics over the quantity asked for. A flow or an opening has the cubic of
    its logarithm, at a load over the logarithm of the load. A leak rate is at the load that has this leak. A state
    beyond the steps is an error. Several surfaces are shown by their mean; --csv and --json have each of them. An
    ensemble has its means last. `roughvol explain NAME` describes a column.
    """
    from roughvol.analysis.stored_run import Run
    from roughvol.questions import opened
    from roughvol.report import screen
    from roughvol.study import levels

    found = opened(run, changes)
    warn_of(found.dataset)
    if as_csv or as_json:
        say_numbers(found.name, roughvol.show(found, states), as_csv=as_csv)
        return
    named = Run.of(found.name, found.dataset)
    if states:
        tables, absent = screen.shown_at(named, levels(states))
        for table in tables:
            say_table(table)
        warn(absent)
    else:
        say_parts(named, screen.shown)
    if answer := named.dataset.attrs.get("answer"):
        say(answer)
