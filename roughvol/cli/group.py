"""The group of all commands: exit codes, options that several take, and where a run is found."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from roughvol import cli_text
from roughvol._version import __version__
from roughvol.campaign import limits
from roughvol.errors import CampaignError, ContactError, ConvergenceError, DatasetError, RoughvolError

if TYPE_CHECKING:
    from roughvol.study import Study

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130
LIGHT = ("schema", "status", "ls", "init", "explain")  # commands that import no library for computations
STUDY_SUFFIXES = (".yaml", ".yml")


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
            click.echo(f"error: {message}", err=True)
            ctx.exit(FAILED)
        return command

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            click.echo("interrupted; finished cases are kept, and the same command continues the run", err=True)
            ctx.exit(INTERRUPTED)
        except RoughvolError as error:
            click.echo(cli_text.message(error), err=True)
            ctx.exit(FAILED if isinstance(error, CampaignError | ContactError | ConvergenceError) else BAD_INPUT)
        except (MemoryError, ImportError, OSError, RuntimeError) as error:
            if not limits.is_lack_of_memory(error):
                raise
            first = str(error).strip().splitlines()
            click.echo(f"error: not enough memory ({first[0] if first else type(error).__name__})", err=True)
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


def warn(sentences: Iterable[str]) -> None:
    """Print each sentence once as a warning."""
    for sentence in dict.fromkeys(sentences):
        click.echo(f"warning: {sentence}", err=True)


def study_of(path: Path, changes: Sequence[str] = ()) -> Study:
    """Return the study of a file, or of standard input for ``-``, with changes as ``surface.m=6``."""
    from roughvol.study import load, loads

    if str(path) == "-":
        return loads(sys.stdin.read(), "<stdin>", changes=changes)
    return load(path, changes)


def results_file(run: str | None) -> Path:
    """Return the study.nc of a run: a folder, a study.nc, a study file, or a name under runs/; without one, the latest.

    Raises
    ------
    DatasetError
        If there is none.
    """
    if run is None:
        # every run writes study.yaml, also without a case to compute
        studies = [path for path in Path("runs").glob("*/study.yaml") if path.with_name("study.nc").is_file()]
        if not studies:
            message = "no finished run under runs/; start one with: roughvol run STUDY (roughvol init writes a study)"
            raise DatasetError(message)
        return max(studies, key=lambda path: path.stat().st_mtime).with_name("study.nc")
    if Path(run).suffix in STUDY_SUFFIXES and Path(run).is_file():
        from roughvol.store import run_folder
        from roughvol.study import load

        files = [run_folder.folder_of(load(run)) / "study.nc"]
    else:
        files = [Path(run), Path(run) / "study.nc", Path("runs") / run / "study.nc"]
    for file in files:
        if file.is_file():
            return file
    for folder in (file.parent for file in files if file.name == "study.nc"):
        if (folder / "study.yaml").is_file():
            message = f"{folder} has no study.nc: its run has not ended; see: roughvol status {folder}"
            raise DatasetError(message)
    message = f"no results of {run!r}: looked for {', '.join(map(str, files))}"
    raise DatasetError(message)


def run_name(path: Path) -> str:
    """Return the name of a run: that of the folder of its study.nc."""
    return path.resolve().parent.name if path.name == "study.nc" else path.stem
