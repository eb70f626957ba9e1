"""The command `licences`: what those who pass roughvol on pass on with it."""

from __future__ import annotations

from dataclasses import asdict

import roughvol
from roughvol.cli.options import JSON, command
from roughvol.cli.output import count, say, say_json
from roughvol.report import terminal

NOTES = {
    "copyleft": "a program that is passed on with these inside is passed on under that licence as a whole",
    "unknown": "neither the metadata nor the licence files have a licence that is known here",
}


@command
@JSON
def licences(as_json: bool) -> None:
    """List the licences of roughvol and of the installed packages that it needs.

    Packages of installed extras come last. Libraries that a wheel bundles are listed below the package: the licence of
    a wheel may be stricter than that of the package, as with FFTW in pyFFTW.
    """
    rows = roughvol.licences()
    if as_json:
        say_json({"rows": [asdict(row) | {"terms": row.terms} for row in rows]})
        return
    lines = []
    for row in rows:
        lines.append((row.name, row.version, row.terms, ", ".join(row.needed_by), row.licence))
        lines += [(f"  {part}", "", "", "", licence) for part, licence in row.parts.items()]
    say(terminal.aligned(("package", "version", "terms", "needed by", "licence"), lines))
    for terms, note in NOTES.items():
        names = [f"{row.name} ({' and '.join(row.deciding)})" for row in rows if row.terms == terms]
        if names:
            say(f"{terms}, {count(len(names), 'package')}: {', '.join(names)}; {note}")
    say("what the licences ask: docs/explanation/licences.md")
