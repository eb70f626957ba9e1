"""The group of all commands: exit codes, and options that several take."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from roughvol import cli_text
from roughvol._version import __version__
from roughvol.campaign import limits, signals
from roughvol.cli.output import say, silence
from roughvol.errors import CampaignError, ContactError, ConvergenceError, RoughvolError

if TYPE_CHECKING:
    from roughvol.study import Study

FAILED, BAD_INPUT = 1, 2
BY_SIGNAL = 128  # plus the number of the signal: 130 by Ctrl-C, 143 by SIGTERM, 129 by SIGHUP
LIGHT = ("schema", "status", "ls", "init", "explain")  # commands that import no library for computations


def examples(*lines: str) -> str:
    """Return the end of a help page; the backspace keeps click from joining lines."""
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in lines)])


STUDY = click.argument("study", type=click.Path(path_type=Path, allow_dash=True))
OUT = click.option("--out", type=click.Path(path_type=Path), help="Folder of the results [default: runs/NAME].")


SET = click.option(
    "--set", "changes", multiple=True, metavar="KEY=VALUE", help="Another value of a key, as surface.m=6; repeatable."
)


class _Commands(click.Group):
    """A group of commands that turns errors into one message and an exit code."""

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        command = super().resolve_command(ctx, args)
        if command[0] not in LIGHT and (message := limits.too_narrow()):
            say(f"error: {message}", err=True)
            ctx.exit(FAILED)
        return command

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:
        try:
            return super().make_context(*args, **kwargs)
        except OSError as error:  # --help into a full disk
            silence(sys.stdout)
            raise click.ClickException(cli_text.system_error(error) or str(error)) from error

    def invoke(self, ctx: click.Context) -> Any:
        try:
            with signals.as_interrupts():
                return super().invoke(ctx)
        except KeyboardInterrupt as error:
            say("interrupted; finished cases are kept, and the same command continues the run", err=True)
            ctx.exit(BY_SIGNAL + signals.number_of(error))
        except RoughvolError as error:
            say(cli_text.message(error), err=True)
            ctx.exit(FAILED if isinstance(error, CampaignError | ContactError | ConvergenceError) else BAD_INPUT)
        except (MemoryError, ImportError, OSError, RuntimeError) as error:
            if limits.is_lack_of_memory(error):
                first = str(error).strip().splitlines()
                say(f"error: not enough memory ({first[0] if first else type(error).__name__})", err=True)
            elif reason := cli_text.system_error(error):
                silence(sys.stdout)
                say(f"error: {reason}", err=True)
            else:
                raise
            ctx.exit(FAILED)


@click.group(
    cls=_Commands,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=examples(
        "roughvol init seal            write an example study into the current folder",
        "roughvol run seal.yaml        compute it; again, to continue",
        "roughvol show seal            its numbers; roughvol plot draws its figures",
        "roughvol explain sweep        keys of a study; roughvol explain free_volume: a stored variable",
    ),
)
@click.version_option(__version__)
def main() -> None:
    """Free volume between rough surfaces in elastic contact: study file in, labelled data and figures out."""


def study_of(study: Path, changes: Sequence[str] = ()) -> tuple[Study, Path]:
    """Return a study and the folder of its results: of a study file, a run, or standard input for ``-``."""
    from roughvol.store import folder_of, run
    from roughvol.study import loads

    if str(study) == "-":
        read = loads(sys.stdin.read(), "<stdin>", changes=changes)
        return read, folder_of(read)
    return run.study_of(study, changes)
