"""What the commands print. A closed pipe or terminal ends the printing, not the command."""

from __future__ import annotations

import errno
import io
import os
import stat
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TextIO

import click

from roughvol.store import stamped_file


def say(text: Any = "", *, err: bool = False, nl: bool = True) -> None:
    """Print a text on standard output, or on standard error.

    A reader that is gone, as ``head`` or a closed terminal, silences the stream: the command still writes its files.

    Raises
    ------
    FolderError
        If standard output cannot be written for another reason, as a full disk.
    """
    try:
        click.echo(text, err=err, nl=nl)
    except OSError as error:
        gone = err or error.errno == errno.EPIPE or (error.errno == errno.EIO and _is_device(sys.stdout))
        silence(sys.stderr if err else sys.stdout)
        if not gone:
            raise stamped_file.cannot_write(Path("standard output"), error) from error


def warn(sentences: Iterable[str]) -> None:
    """Print each sentence once as a warning."""
    for sentence in dict.fromkeys(sentences):
        say(f"warning: {sentence}", err=True)


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
