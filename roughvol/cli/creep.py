"""The command `creep`: the leak over time under constant load."""

from __future__ import annotations

from pathlib import Path

import click

import roughvol
from roughvol.cli.ask import beyond, titled
from roughvol.cli.options import BUDGET, JOBS, JSON, RUN, SET, at, command, out
from roughvol.cli.output import csv_text, say, say_json, say_table, warn, warn_of


@command
@RUN
@click.option("--law", required=True, type=click.Path(path_type=Path), help="YAML file of the creep law J(t)/J(0).")
@at(several=False)
@click.option(
    "--times", required=True, metavar="TIMES", help="Times under load: 'FROM..TO' or a list, with units (else s)."
)
@BUDGET
@out("the run's; for creep.csv and creep.png")
@JOBS
@JSON
@SET
def creep(
    run: str | None,
    law: Path,
    state: str | None,
    times: str,
    budget: bool,
    out: Path | None,
    jobs: int | None,
    as_json: bool,
    changes: tuple[str, ...],
) -> None:
    """Show the leak of RUN over time, for a material that creeps under constant load.

    RUN is a folder, a study.nc, a study file, or a name under runs/ [default: the latest].

    The modulus of the study is that at once. States at later times are read off the stored sweep: at constant load the
    contact is that of the modulus 1/J(t) (Lee and Radok 1960). Times whose states the sweep does not reach are refused.
    Of several surfaces the leak is the median, with the 16-84 % range and the number of open surfaces. With --budget it
    has the interval of leak cards at up to four of the states. --at is a pressure or a load.
    """
    from roughvol.analysis import creep as over_time
    from roughvol.analysis.tables import number
    from roughvol.questions import opened
    from roughvol.report.figures.creep import drawing_of
    from roughvol.store import stamped_file

    if state is None:
        raise click.UsageError("needs its constant load, as --at pressure=0.1MPa")
    found = opened(run, changes)
    history = roughvol.creep(found, law, at=state, times=times, budget=budget, jobs=jobs)
    warn_of(found.dataset)
    if as_json:
        say_json({"run": found.name, "leg": 1} | history.plain())
        return
    say(f"{titled(found.name, found.dataset)}: at {number(history.pressure)} {history.pressure_unit}; {history.body}")
    say_table(over_time.table_of(history))
    for line in beyond(found, has_errors=budget):
        say(line)
    folder = out or found.pages
    stamped_file.write(folder / "creep.csv", csv_text(*over_time.rows_of(history)).encode())
    say(str(folder / "creep.csv"))
    if any((leak.value > 0.0).any() for leak in history.leak.values()):
        drawing_of(history, found.dataset).savefig(folder / "creep.png")
        say(str(folder / "creep.png"))
    else:
        warn(["nothing leaks at these times, so no figure is drawn"])
