"""The command `card`: the leak card of a study."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import roughvol
from roughvol.cli.options import CSV, FRESH, JOBS, JSON, SET, STUDY, at, command, given, out
from roughvol.cli.output import csv_text, say, say_json, say_table, warn_of


@command
@STUDY
@at(several=True, default="last")
@out("runs/NAME_card")
@JOBS
@FRESH
@CSV
@JSON
@SET
def card(
    study: Path, states: tuple[str, ...], as_csv: bool, as_json: bool, changes: tuple[str, ...], **options: Any
) -> None:
    """Write the leak card of STUDY: one page in HTML and PDF.

    The card has the leak along x and y at a load, with the error of solver, grid, window and levelling, and the loads
    at which each way closes. Coarser grids and another levelling are computed for it. STUDY is a study file, or the
    folder or name of a run.

    Several height files have a card each and one together; each combination of lists and each load has its own. A table
    shows all of them. The files of a card are named by its load. --csv and --json print numbers and write no page;
    pressures are in MPa.
    """
    found = roughvol.card(given(study, changes), states, changes=changes, **options)
    if found.notice:
        say(found.notice, err=True)
    if as_csv or as_json or len(found.runs) > 1:  # one card alone has its limits below
        finest = {  # several loads have one run
            ", ".join(filter(None, (words, name))): runs.fine.dataset
            for (_, words), by_surface in found.runs.items()
            for name, runs in by_surface.items()
        }
        for name, results in finest.items():
            warn_of(results, name)
    if as_json:
        say_json(found.plain())
        return
    from roughvol.report import card_page, terminal

    if as_csv:
        say(csv_text(card_page.NUMBERS, card_page.numbers_of(found.pages)), nl=False)
        return
    if len(found.runs) == 1:
        say("\n".join(terminal.lines(card_page.brief(found.pages[0]))))
    if len(found.pages) > 1:
        say_table(card_page.table_of(found.pages))
    for path in found.write():
        say(str(path))
