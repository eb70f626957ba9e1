"""Calls of the command line in this process."""

from __future__ import annotations

from typing import Any

from click.testing import CliRunner, Result

from roughvol.cli import main


def call(*arguments: object, **options: Any) -> Result:
    """Return the end of a command: exit code, output, errors."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments], **options)


def said(*arguments: object) -> str:
    """Return the output of a command that succeeds."""
    done = call(*arguments)
    assert done.exit_code == 0, done.output
    return done.stdout


def refused(*arguments: object) -> str:
    """Return the message of a command that refuses its input."""
    done = call(*arguments)
    assert done.exit_code == 2, done.output
    return done.stderr
