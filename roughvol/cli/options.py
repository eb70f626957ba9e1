"""Arguments and options that commands share, each with one meaning, and their completion in a shell."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from roughvol.cli.output import alone
from roughvol.tables import table

if TYPE_CHECKING:
    from roughvol.study import Study

Decorated = Callable[..., Any]
Completed = list[CompletionItem] | list[str]
GROUPS = table(__file__, "commands")
"""Commands by group."""
FILES = (".csv", ".htm", ".html", ".json", ".md", ".nc", ".pdf", ".png", ".svg", ".txt", ".yaml", ".yml")  # suffixes


def examples(*lines: str) -> str:
    """Return the end of a help page; the backspace keeps click from joining lines."""
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in lines)])


class _Command(click.Command):
    """A command that has standard output alone."""

    def invoke(self, ctx: click.Context) -> Any:
        with alone():
            return super().invoke(ctx)


def command(function: Decorated) -> click.Command:
    """Return the command of a function, with the examples of its row."""
    row = next(rows[function.__name__] for rows in GROUPS.values() if function.__name__ in rows)
    return click.command(cls=_Command, epilog=examples(*row["examples"].splitlines()))(function)


def given(study: Path, changes: tuple[str, ...]) -> Study | Path:
    """Return the study of standard input for ``-``, else the path of a study."""
    from roughvol.study import loads

    if str(study) != "-":
        return study
    content = sys.stdin.buffer.read() if sys.stdin is not None else b""  # None: closed
    return loads(content.decode("utf-8-sig", "surrogateescape"), "<stdin>", changes=changes)


def completed_runs(context: click.Context, parameter: click.Parameter, start: str) -> Completed:
    """Return the names of runs and study files with this start, or let the shell complete a path."""
    runs = sorted(path.parent.name for path in Path("runs").glob("*/study.yaml"))
    studies = sorted(path.name for suffix in ("yaml", "yml") for path in Path().glob(f"*.{suffix}"))
    found = [name for name in dict.fromkeys([*runs, *studies]) if name.startswith(start)]
    return found or [CompletionItem(start, type="file")]


def completed_figures(context: click.Context, parameter: click.Parameter, start: str) -> Completed:
    """Return the names of figures with this start, behind a comma too."""
    from roughvol import plotting

    before, comma, last = start.rpartition(",")
    return [f"{before}{comma}{name}" for name in plotting.FIGURES if name.startswith(last)]


def completed_runs_and_figures(context: click.Context, parameter: click.Parameter, start: str) -> Completed:
    """Return the names of runs, and after the first the names of figures, with this start."""
    runs = completed_runs(context, parameter, start)
    if not context.params.get(parameter.name or ""):
        return runs
    from roughvol import plotting

    return [name for name in plotting.NAMES if name.startswith(start)] + [run for run in runs if isinstance(run, str)]


def completed_states(context: click.Context, parameter: click.Parameter, start: str) -> Completed:
    """Return ``last`` and the kinds of a state with this start."""
    from roughvol.study import STATE_KINDS

    return [word for word in ("last", *(f"{kind}=" for kind in STATE_KINDS), "step=") if word.startswith(start)]


def completed_changes(context: click.Context, parameter: click.Parameter, start: str) -> Completed:
    """Return the keys of a study with this start."""
    from roughvol.study.reference import keys

    return [f"{path}=" for path in dict.fromkeys(key.path for key in keys()) if path.startswith(start)]


STUDY = click.argument(
    "study", type=click.Path(path_type=Path, allow_dash=True), shell_complete=completed_runs, metavar="STUDY"
)
RUN = click.argument("run", required=False, shell_complete=completed_runs)
SET = click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="KEY=VALUE",
    shell_complete=completed_changes,
    help="Another value of a key of the study, as surface.m=6; repeatable.",
)
BUDGET = click.option("--budget", is_flag=True, help="Compute the runs of leak cards at the answer, for its errors.")
JOBS = click.option("--jobs", "-j", type=click.IntRange(min=1), metavar="N", help="Processes [default: one a core].")
FRESH = click.option("--fresh", is_flag=True, help="Compute every case anew, finished ones too.")


def _one_form(context: click.Context, _: click.Parameter, given: bool) -> bool:
    """Refuse two forms of the numbers at once; the context has the options before this one."""
    if given and (context.params.get("as_csv") or context.params.get("as_json")):
        raise click.UsageError("--csv and --json exclude each other")
    return given


CSV = click.option("--csv", "as_csv", is_flag=True, callback=_one_form, help="Comma-separated values.")
JSON = click.option(
    "--json", "as_json", is_flag=True, callback=_one_form, help="JSON, with units where numbers have them."
)


def at(*, several: bool, default: str | None = None) -> Callable[[Decorated], Decorated]:
    """Return the option of a load, the same in every command."""
    words = "A load: last, pressure=0.5MPa, contact_area=0.1, p=0.3, d=0, 'mean_gap=1um, leg 2'"
    return click.option(
        "--at",
        "states" if several else "state",
        multiple=several,
        default=(default,) if several and default else default,
        show_default=default is not None,
        metavar="KIND=VALUE[, leg N]",
        shell_complete=completed_states,
        help=words + ("; repeatable." if several else "."),
    )


def out(default: str) -> Callable[[Decorated], Decorated]:
    """Return the option of the folder that a command writes into."""
    words = f"Folder to write into [default: {default}]."
    return click.option("--out", type=click.Path(), callback=_folder, help=words)


def _folder(_: click.Context, __: click.Parameter, text: str | None) -> Path | None:
    """Return a folder; refuse an empty text, as of a variable of the shell that is not set, and the name of a file."""
    if text == "":
        raise click.BadParameter("must be a folder, as . or runs/other, given an empty text")
    if text and Path(text).suffix.lower() in FILES and not Path(text).is_dir():
        raise click.BadParameter(f"must be a folder, which holds files of fixed names, given {text!r}")
    return None if text is None else Path(text)
