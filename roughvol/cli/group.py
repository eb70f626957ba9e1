"""The group of all commands: the help page, errors and exit codes. A command is imported when it is called."""

from __future__ import annotations

import contextlib
import errno
import gc
import importlib
import itertools
import os
import re
import sys
import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import click

from roughvol import errors, spellings
from roughvol._version import __version__
from roughvol.campaign import machine, signals
from roughvol.cli.options import GROUPS, examples
from roughvol.cli.output import count, escape, say, silence, warn

FAILED, BAD_INPUT = 1, 2
OF_RUNS = errors.CampaignError | errors.ContactError | errors.ConvergenceError  # they make the exit code FAILED
CONTINUED = ("run", "card", "ask", "creep")  # commands that keep finished cases
BY_SIGNAL = 128  # plus the number of the signal: 130 by Ctrl-C, 143 by SIGTERM, 129 by SIGHUP
LIGHT = ("schema", "status", "ls", "init", "explain", "licences")  # commands that import no library for computations
CURABLE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.ENAMETOOLONG)
TOO_MANY_FILES = os.strerror(errno.EMFILE)


class _Commands(click.Group):
    """Commands in groups, whose errors become one message and an exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [name for rows in GROUPS.values() for name in rows]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.list_commands(ctx):
            return None
        command: click.Command = getattr(importlib.import_module(f"roughvol.cli.{cmd_name}"), cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for title, rows in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(name, row["line"]) for name, row in rows.items()])

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        if not args[0].startswith("-") and args[0] not in (known := self.list_commands(ctx)):
            ctx.fail(f"no command {args[0]!r}{errors.meant(args[0], known)}")
        command = super().resolve_command(ctx, renamed(args))
        if command[0] not in LIGHT and (message := machine.too_narrow()):
            say(f"error: {message}", err=True)
            ctx.exit(FAILED)
        if command[0] != "run":  # whose --scheduler is one of dask
            ctx.with_resource(_without_dask())
        return command

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:
        escape(sys.stdout)
        try:
            return super().make_context(*args, **kwargs)
        except OSError as error:  # --help into a full disk
            silence(sys.stdout)
            raise click.ClickException(_of_system(error) or str(error)) from error

    def invoke(self, ctx: click.Context) -> Any:
        words = list(ctx.args)  # click takes them from the context
        try:
            with signals.as_interrupts(), _said():
                return super().invoke(ctx)
        except KeyboardInterrupt as error:
            stored = ctx.invoked_subcommand in CONTINUED
            same = f"the same command{' without --fresh' * ('--fresh' in words)}"
            goes_on = f"; finished cases are kept, and {same} continues the run" if stored else ""
            say(f"interrupted{goes_on}", err=True)
            ctx.exit(BY_SIGNAL + signals.number_of(error))
        except click.UsageError as error:
            if hint := _cut_value(words, error.message):
                raise click.UsageError(f"{error.format_message()}{hint}", error.ctx) from error
            raise
        except errors.RoughvolError as error:
            say(f"{_message(error)}{_cut_value(words, str(error))}", err=True)
            ctx.exit(FAILED if isinstance(error, OF_RUNS) else BAD_INPUT)
        except (MemoryError, ImportError, OSError, RuntimeError) as error:
            if machine.is_lack_of_memory(error):
                first = str(error).strip().splitlines()
                say(f"error: not enough memory ({first[0] if first else type(error).__name__})", err=True)
            elif reason := _of_system(error):
                silence(sys.stdout)
                say(f"error: {reason}", err=True)
            else:
                raise
            ctx.exit(FAILED)


def _cut_value(words: list[str], refused: str) -> str:
    """Return what to do where a unit is refused as a word, cut from its number, as ``--at pressure=0.5 MPa``."""
    told = re.findall(r"[^\s()':;]+", refused)
    for number, unit in itertools.pairwise(words):
        if unit in told and not unit.startswith("-") and re.fullmatch(r"([\w.]+=)?[-+.\d]+(e[-+]?\d+)?", number):
            return f"; a value with a blank is in quotation marks: '{number} {unit}'"
    return ""


def renamed(words: list[str]) -> list[str]:
    """Return the words of a command with new options in place of former ones; refuse those that left."""
    found = words[:1]
    for word in words[1:]:
        option, equals, value = word.partition("=")
        row = spellings.former("option", f"{words[0]} {option}")
        if row is not None and not row.works:
            raise click.UsageError(f"{option} {row.message}")
        if row is not None:
            say(f"warning: {option} {row.message}", err=True)
            option = row.new
        found.append(f"{option}{equals}{value}")
    return found


@contextlib.contextmanager
def _without_dask() -> Iterator[None]:
    """Hide dask where it is installed: xarray would import it. An xarray that is imported already knows of dask."""
    if hidden := not {"dask", "xarray"} & set(sys.modules):
        sys.modules["dask"] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        if hidden:
            del sys.modules["dask"]


@contextlib.contextmanager
def _said() -> Iterator[None]:
    """Print warnings of this package, each once."""
    with warnings.catch_warnings():
        warnings.simplefilter("once", errors.RoughvolWarning)
        show = warnings.showwarning

        def say_one(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if issubclass(category, errors.RoughvolWarning):
                warn([str(message)])
            else:
                show(message, category, *place, **more)

        warnings.showwarning = say_one
        yield


def _message(error: errors.RoughvolError) -> str:
    """Return an error as text; the problems of the keys of a study line by line."""
    if isinstance(error, errors.StudyError) and any(problem.key or problem.file for problem in error.problems):
        placed = (replace(one, file="--set") if one.file == errors.CHANGES else one for one in error.problems)
        lines = [f"  {problem}" for problem in placed]
        return "\n".join([count(len(lines), "problem"), *lines])
    return f"error: {error}"


def _of_system(error: BaseException) -> str:
    """Return an error of the system that a user can cure, as a full disk, in words; empty for others."""
    texts = {getattr(one, "errno", None): str(one) for one in machine.with_causes(error)}
    if errno.EMFILE in texts or errno.ENFILE in texts or any(TOO_MANY_FILES in text for text in texts.values()):
        return "too many open files; allow more of them: ulimit -n 256"
    if not isinstance(error, OSError) or error.errno not in CURABLE:
        return ""
    return f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror)


@click.group(
    cls=_Commands,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=examples(
        "roughvol init seal            write an example study into the current folder",
        "roughvol run seal.yaml        compute it; again, to continue",
        "roughvol show seal            its numbers; roughvol plot draws its figures",
        "roughvol explain sweep        keys of a study; roughvol explain free_volume: a stored variable",
        "",
        "Documentation: docs/index.md in the source of roughvol; make docs builds it as a site.",
    ),
)
@click.version_option(__version__)
def main() -> None:
    """Free volume between rough surfaces in elastic contact: study file in, labelled data and figures out."""
    gc.set_threshold(100_000, 20, 100)  # what imports make stays: garbage is sought in it for a tenth of `show`
