"""The command `status`: the cases of a study by their state."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import roughvol
from roughvol.cli.options import JSON, SET, STUDY, command, given
from roughvol.cli.output import count, say, say_json
from roughvol.study.values.durations import duration

SHOWN = 50  # cases of one state that are listed


@command
@STUDY
@JSON
@SET
def status(study: Path, as_json: bool, changes: tuple[str, ...]) -> None:
    """List the finished, running, failed and missing cases of STUDY, also during a run.

    STUDY is a study file, - for standard input, the folder of a run, or a name under runs/.
    """
    from roughvol.store import run_folder

    state = roughvol.status(given(study, changes), changes=changes)
    if as_json:
        say_json(asdict(state) | {"folder": str(state.folder), "units": {"left": "s"}})
        return
    total = sum(map(len, (state.done, state.running, state.missing, state.failed, state.damaged)))
    say(f"{state.folder}: {len(state.done)} of {total} cases finished" + (", collected" * state.collected))
    if state.holder is not None:
        time_left = f", about {duration(state.left)} left" if state.left is not None else ""
        say(f"running: {state.holder}{time_left}")
    if mixed := run_folder.versions_text(state.versions):
        say(f"  {mixed}")
    if state.strange:
        say(f"  {count(state.strange, 'file')} of cases of another study")
    for title, cases in (
        ("running", dict.fromkeys(state.running, "")),
        ("missing", dict.fromkeys(state.missing, "")),
        ("failed", state.failed),
        ("damaged, to be computed again", state.damaged),
        ("outdated, to be computed again", state.outdated),
    ):
        for id, reason in list(cases.items())[:SHOWN]:
            say(f"  {id}  {title}" + (f": {reason}" if reason else ""))
        if len(cases) > SHOWN:
            say(f"  … and {len(cases) - SHOWN} more {title}")
