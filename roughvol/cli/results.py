"""The commands that draw and judge results: plot, report."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from roughvol import cli_text
from roughvol.cli.group import examples, main
from roughvol.cli.options import JSON, SET, completed_runs, completed_runs_and_figures, out
from roughvol.cli.output import say, warn
from roughvol.errors import CampaignError, DatasetError

if TYPE_CHECKING:
    from roughvol.report.figures.content import Named
    from roughvol.store import StoredRun

LEAST, MOST = 1.0, 40.0  # inches of a figure
PAPER = re.compile(r"fig\d\d[ab]?")  # names of the figures of the paper


@main.command(
    epilog=examples(
        "roughvol plot                                     all figures of the latest run",
        "roughvol plot effect_of_D fig04a v_of_p --format pdf",
        "roughvol plot dry wet leak_of_p --size 120x80mm   two runs overlaid",
    )
)
@click.argument("names", metavar="[RUN]... [FIGURE]...", nargs=-1, shell_complete=completed_runs_and_figures)
@click.option(
    "--format",
    "suffix",
    type=click.Choice(["png", "pdf", "svg", "csv"]),
    default="png",
    show_default=True,
    help="Kind of file; csv: the points of the curves.",
)
@click.option("--size", metavar="WxH", help="Width and height, as 120x80mm, 7x4in or 16x9cm [default: of the figure].")
@click.option("--log", type=click.Choice(["x", "y", "xy"]), help="Axes with a logarithmic scale.")
@out("figures in the run")
@SET
def plot(
    names: tuple[str, ...],
    suffix: str,
    size: str | None,
    log: str | None,
    out: Path | None,
    changes: tuple[str, ...],
) -> None:
    """Draw figures from RUN: a folder, a study.nc, a study file, or a name under runs/ [default: the latest].

    Figures of the paper are fig01 to fig12b, in the folder paper. Those of the flow through the gap are seal_volume to
    seal_map. Others are named by content: v_of_p is V* over p*, with p, a, v, d, i for p*, A*, V*, d/σ, Δ/σ, and gap,
    leak, flow.

    Several runs are overlaid in figures named by content, into runs/compared, and so are the combinations of a study
    with lists, into its own figures. Without FIGURE, all figures of the run are drawn, or v_of_p, a_of_p, v_of_a,
    v_of_d, gap_of_p, leak_of_p of several runs. A FIGURE that does not apply is named, and the others are drawn.
    """
    from roughvol import plotting
    from roughvol.report.figures import content
    from roughvol.store import StoredRun, stamped_file
    from roughvol.store.run import is_run, names_of

    inches = _inches(size)
    known = {*plotting.figures(), *content.NAMES}
    wanted = [name for name in names if name in known and not Path(name).exists()]
    others = [name for name in names if name not in wanted]
    misspelt = [name for name in others if not is_run(name)]
    if len(misspelt) < len(others):
        plotting.check_known(misspelt)
    opened = [StoredRun.open(name, changes) for name in others] or [StoredRun.open()]
    stored = zip(names_of([run.file for run in opened]), opened, strict=True)
    runs = [part for name, run in stored for part in content.parts(name, run.dataset, alone=len(opened) == 1)]
    drawings, refused = _drawings(runs, wanted, alone=len(opened) == 1)
    folder = out or (opened[0].folder / "figures" if len(opened) == 1 else Path("runs/compared"))
    drawn = 0
    for name, draw in drawings.items():
        target = folder / f"{name}.{suffix}"
        if out is None and PAPER.fullmatch(target.stem):
            target = target.parent / "paper" / target.name
        try:
            figure = draw()
            points = list(content.data(figure)) if suffix == "csv" else []
        except DatasetError as error:
            refused += [str(error)] if wanted else []  # among all figures of a run, maps have no points
            continue
        left = _shaped(figure, inches, log)
        warn(f"{name} has no positive {axis}: this axis stays linear" for axis in left)
        if suffix == "csv":
            stamped_file.write(target, _csv(points).encode())
        else:
            target.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(target)
        say(target)
        drawn += 1
    if refused and not drawn:
        raise DatasetError("\n".join(refused))
    for reason in refused:
        say(f"not drawn: {reason}", err=True)


Draws = dict[str, Callable[[], Any]]


def _drawings(runs: Sequence[Named], wanted: Sequence[str], *, alone: bool) -> tuple[Draws, list[str]]:
    """Return what draws each figure of runs by its path, and why some of those wanted cannot be drawn."""
    from roughvol import plotting
    from roughvol.report.figures import content

    figures, drawings, refused = plotting.figures(), Draws(), list[str]()
    every = [name for name in content.DRAWN if content.missing(name, runs) is None]
    for name in wanted or (every if len(runs) > 1 else ()):
        if name in content.NAMES:
            reason = content.missing(name, runs)
            if reason is None:
                drawings[name] = partial(content.draw, name, runs)
        elif alone:
            reasons = {run.name: figures[name].missing(run.dataset) for run in runs}
            reason = "\n".join(dict.fromkeys(filter(None, reasons.values()))) or None
            for run in runs:
                if reasons[run.name] is None:
                    drawings[f"{_within(run, runs)}{name}"] = partial(figures[name], run.dataset)
        else:
            reason = f"{name} shows one run; several are overlaid in figures by content, {content.IN_WORDS}"
        refused += [reason] if reason else []
    for run in runs if alone and not wanted else ():
        reasons = {name: figure.missing(run.dataset) for name, figure in figures.items()}
        if all(reasons.values()):
            raise DatasetError("\n".join(filter(None, reasons.values())))
        for name in (name for name, reason in reasons.items() if not reason):
            drawings[f"{_within(run, runs)}{name}"] = partial(figures[name], run.dataset)
    return drawings, refused


def _within(run: Named, runs: Sequence[Named]) -> str:
    """Return the folder of the figures of a combination, as ``E_5_MPa/``; empty of a study without lists."""
    return f"{slug(run.name)}/" if len(runs) > 1 else ""


def _csv(points: Sequence[Mapping[str, object]]) -> str:
    """Return the points of curves as comma-separated values; columns that no curve has are left out."""
    from roughvol.report.figures import content

    held = [name for name in content.COLUMNS if any(point[name] is not None for point in points)]
    return cli_text.csv_text(held, ([point[name] for name in held] for point in points))


def slug(words: str) -> str:
    """Return words as the name of a folder, as ``E_5_MPa``."""
    return re.sub(r"[^A-Za-z0-9.+-]+", "_", words).strip("_")


def _inches(size: str | None) -> tuple[float, float] | None:
    """Return a size as width and height in inches."""
    if size is None:
        return None
    match = re.fullmatch(r"(\d+\.?\d*)\s*x\s*(\d+\.?\d*)\s*(mm|cm|in|)", size.strip())
    scale = {"mm": 1 / 25.4, "cm": 1 / 2.54, "in": 1.0, "": 1.0}
    width, height = (float(match[k]) * scale[match[3]] for k in (1, 2)) if match else (0.0, 0.0)
    if not (LEAST <= width <= MOST and LEAST <= height <= MOST):
        message = (
            f"--size is {size!r}; allowed: WxH with a unit mm, cm or in (default), {LEAST} to {MOST} in, as 120x80mm"
        )
        raise DatasetError(message)
    return width, height


def _shaped(figure: Any, inches: tuple[float, float] | None, log: str | None) -> list[str]:
    """Give a figure a size, and its axes logarithmic scales; return the axes without positive data."""
    left = []
    if inches is not None:
        figure.set_size_inches(*inches)
    for ax in figure.axes if log else ():
        for axis in log or "":
            if ax.name != "rectilinear" or ax.images:
                continue
            if getattr(ax.dataLim, f"{axis}1") > 0.0:
                getattr(ax, f"set_{axis}scale")("log")
            else:
                left.append(axis)
    return left


@main.command(epilog=examples("roughvol report", "roughvol report effect_of_D effect_of_m --out /tmp/report"))
@click.argument("run", nargs=-1, shell_complete=completed_runs)
@out("the run, or runs/report")
@click.option(
    "--check",
    "expected",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="JSON with expected verdicts and bands of numbers; a departure is an error.",
)
@JSON
@SET
def report(
    run: tuple[str, ...], out: Path | None, expected: Path | None, as_json: bool, changes: tuple[str, ...]
) -> None:
    """Report on RUN..., as report.html, report.md and claims.json [default: all runs].

    A RUN is a folder, a study.nc, a study file, or a name under runs/. Runs of the paper's configuration answer its
    claims; others are refused by name and reason. Every other run, such as one of a measured map, gets its own
    section: surface, loading, states, closing pressures, warnings, figures.
    """
    from roughvol.report import page
    from roughvol.reproduction.judgement import departures, judge
    from roughvol.reproduction.sections import report_of
    from roughvol.store import StoredRun

    opened = [StoredRun.open(name, changes) for name in run] or _all_runs()
    judgement = judge(opened)
    found = report_of(judgement)
    written = page.write(found, out or (opened[0].folder if len(opened) == 1 else Path("runs/report")))
    if as_json:
        say(page.to_json(found))
    else:
        say(page.summary(found))
        say(written)
    left = departures(judgement, expected.read_text(encoding="utf-8")) if expected else []
    if left:
        head = f"{cli_text.count(len(left), 'answer')} left the bands of {expected}"
        raise CampaignError("\n".join([head, *(f"  {departure}" for departure in left)]))


def _all_runs() -> list[StoredRun]:
    """Return all runs under runs/, with a warning for those whose results are of another study."""
    from roughvol.store import StoredRun
    from roughvol.store.run import with_results

    opened, refused = [], []
    for folder in with_results():
        try:
            opened.append(StoredRun.open(folder))
        except DatasetError as error:
            refused.append(error)
    if not opened:
        opened.append(StoredRun.open())
    warn(f"{error}" for error in refused)
    return opened
