"""What the commands print: lines, tables, CSV, JSON. A closed pipe or terminal ends the printing, not the command."""

from __future__ import annotations

import codecs
import contextlib
import csv
import errno
import io
import json
import os
import stat
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from roughvol.report import terminal
from roughvol.store import stamped_file

if TYPE_CHECKING:
    from roughvol.analysis.stored_run import Run
    from roughvol.analysis.tables import Table
    from roughvol.report.screen import Records
    from roughvol.store.dataset import Dataset


_standard: list[TextIO] = []  # standard output, while a command has it alone


@contextlib.contextmanager
def alone() -> Iterator[None]:
    """Keep standard output for what a command says: what modules of a user print goes to standard error."""
    if sys.stdout is None:  # it was closed
        yield
        return
    _standard.append(sys.stdout)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        _standard.pop()


def say(text: Any = "", *, err: bool = False, nl: bool = True) -> None:
    """Print a text on standard output, or on standard error; a `FolderError` if the disk is full.

    A reader that is gone, as ``head`` or a closed terminal, silences the stream: the command still writes its files.
    """
    stream = sys.stderr if err else _standard[-1] if _standard else sys.stdout
    try:
        click.echo(text, stream, err=err, nl=nl)
    except OSError as error:
        gone = err or error.errno == errno.EPIPE or (error.errno == errno.EIO and _is_device(stream))
        silence(stream)
        if not gone:
            raise stamped_file.cannot_write(Path("standard output"), error) from error


def warn(sentences: Iterable[str]) -> None:
    """Print each sentence once as a warning."""
    for sentence in dict.fromkeys(sentences):
        say(f"warning: {sentence}", err=True)


def warn_of(run: Dataset, name: str = "") -> None:
    """Print the stored warnings of a run, behind its name: limits that its states exceed, and doubtful input."""
    warn(f"{name}: {line}" if name else line for line in str(run.attrs.get("warnings", "")).splitlines())


def is_seen() -> bool:
    """Return whether standard error is a terminal; it is None where it was closed."""
    return sys.stderr is not None and sys.stderr.isatty()


def escape(stream: TextIO | None) -> None:
    """Make a stream write characters that its encoding lacks as escapes, and the bytes of file names as they are."""
    if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):  # None: closed
        stream.reconfigure(errors="roughvol")


def _escaped(error: UnicodeError) -> tuple[bytes | str, int]:
    """Return the escape of one character, or the byte of a file name in its place (PEP 383)."""
    assert isinstance(error, UnicodeEncodeError)
    one = error.object[error.start]
    written = bytes([ord(one) - 0xDC00]) if "\udc80" <= one <= "\udcff" else one.encode("ascii", "backslashreplace")
    return written, error.start + 1


codecs.register_error("roughvol", _escaped)


def silence(stream: TextIO) -> None:
    """Lead a stream that cannot be written into nothing; else Python would try again at the end."""
    try:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, stream.fileno())
        os.close(nothing)
    except (OSError, io.UnsupportedOperation):  # no file of the system
        pass


def _is_device(stream: TextIO) -> bool:
    try:
        return stat.S_ISCHR(os.fstat(stream.fileno()).st_mode)
    except (OSError, io.UnsupportedOperation):
        return False


def say_table(table: Table) -> None:
    """Print a table with its title above and its note below."""
    say("\n".join(terminal.table_lines(table)))


def say_parts(run: Run, tables: Callable[[Run], Iterable[Table]]) -> None:
    """Print the tables of each combination of a run, with the combination in front of their titles.

    A combination without an answer is a warning, a run without an answer a `DatasetError`.
    """
    from roughvol.analysis.stored_run import answers

    found, errors = answers(run.parts, lambda part: list(tables(part)))
    for part, made in found:
        for table in made:
            say_table(table.under(part.name.removeprefix(run.name).removeprefix(", ")))
    warn(map(str, errors))


def say_numbers(name: str, records: Records, *, as_csv: bool) -> None:
    """Print rows of numbers as CSV or as JSON."""
    names, rows, units = records
    if as_csv:
        say(csv_text(names, rows), nl=False)
    else:
        say_json({"run": name, "units": units, "rows": [dict(zip(names, row, strict=True)) for row in rows]})


def say_json(content: Mapping[str, Any]) -> None:
    """Print JSON; numbers that are not finite are null."""
    from roughvol.study.plain_data import finite

    say(json.dumps(finite(content), indent=1, ensure_ascii=False, allow_nan=False))


def csv_text(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return rows as comma-separated values; a missing value is empty.

    A spreadsheet computes texts such as ``=cmd|…``. A text that begins like a formula gets an apostrophe in front.
    """
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows([[_plain(cell) for cell in row] for row in (head, *rows)])
    return text.getvalue()


def _plain(cell: Any) -> Any:
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(("=", "+", "-", "@", "\t", "\r")) else cell


def count(number: int, noun: str, plural: str = "") -> str:
    """Return a number with its noun: ``1 case``, ``2 cases``."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"
