"""The command `plot`: figures of one run, or of several runs overlaid."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from roughvol.cli.options import SET, command, completed_runs_and_figures, out
from roughvol.cli.output import csv_text, say, warn
from roughvol.errors import DatasetError

if TYPE_CHECKING:
    from roughvol.report.figures.style import Drawing

LEAST, MOST = 1.0, 40.0  # inches of a figure
BEYOND = 0.05  # inches by which letters may reach over the edge of a figure of a given size
ROUNDING = 1e-12  # of the largest number of an axis: smaller ones are 0 but for rounding
INCH = {"mm": 25.4, "cm": 2.54, "in": 1.0, "": 1.0}
PAPER = re.compile(r"fig\d\d[ab]?")  # names of the figures of the paper


@command
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

    Figures are named by content: leak_of_p is the leak over the pressure, with p, a, v, d, i for p, A*, V*, d/σ, Δ/σ,
    and gap, leak, flow (T*), stiffness, conductance. Those of the flow through the gap are seal_volume to seal_map.
    Figures of the paper are fig01 to fig12b, in the folder paper.

    Several runs are overlaid in figures named by content, into runs/compared, and so are the combinations of a study
    with lists, into its own figures. Without FIGURE, v_of_p, a_of_p, v_of_a, v_of_d, gap_of_p and leak_of_p are drawn,
    and all other figures of one run. A FIGURE that does not apply is named, and the others are drawn.
    """
    from roughvol import plotting
    from roughvol.report.figures import content
    from roughvol.store import StoredRun
    from roughvol.store.run import check_once, is_run, names_of

    inches = _inches(size)
    wanted = [name for name in names if name in plotting.NAMES and not Path(name).exists()]
    if any(is_run(name) for name in names if name not in wanted):
        wanted = [name for name in names if name in wanted or not is_run(name)]  # figures of a user's quantities too
    others = [name for name in names if name not in wanted]
    opened = [StoredRun.open(name, changes) for name in others] or [StoredRun.open(None, changes)]
    alone = len(opened) == 1
    titles = names_of([run.file for run in opened])
    check_once("plot", [(run.file, title) for run, title in zip(opened, titles, strict=True)])
    runs = content.parts([(title, run.dataset) for title, run in zip(titles, opened, strict=True)])
    plotting.check_known(wanted, runs)
    drawings, refused = plotting.drawings(runs, wanted, alone=alone)
    folder = out or (opened[0].pages / "figures" if alone else Path("runs/compared"))
    drawn = 0
    for name, draw in drawings.items():
        target = folder / f"{name}.{suffix}"
        if out is None and PAPER.fullmatch(target.stem):
            target = target.parent / "paper" / target.name
        try:
            figure = draw()
            left = _shaped(figure, inches, log)
            if inches is not None and suffix != "csv":
                _check_room(figure, name)
            _write(figure, target)
        except DatasetError as error:
            refused += [] if suffix == "csv" and not wanted else [str(error)]  # maps of a run have no points
            continue
        warn(f"{name} has no positive {axis}: this axis stays linear" for axis in left)
        say(target)
        drawn += 1
    reasons = dict.fromkeys(refused)
    if reasons and not drawn:
        raise DatasetError("\n".join(reasons))
    for reason in reasons:
        say(f"not drawn: {reason}", err=True)


def _write(figure: Drawing, target: Path) -> None:
    """Write a figure, or the points of its curves without the columns that no curve has."""
    from roughvol.report.figures import content
    from roughvol.store import stamped_file

    if target.suffix != ".csv":
        stamped_file.make_folder(target.parent)
        figure.savefig(target)
        return
    points = list(content.data(figure))
    held = [name for name in content.COLUMNS if name in "xy" or any(point[name] is not None for point in points)]
    stamped_file.write(target, csv_text(held, ([point[name] for name in held] for point in points)).encode())


def _check_room(figure: Drawing, name: str) -> None:
    """Refuse a size in which the axes have no room beside legend and labels, or these no room themselves."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        figure.draw_without_rendering()
    width, height = figure.get_size_inches()
    box = figure.get_tightbbox()
    inside = min(box.x0, box.y0, width - box.x1, height - box.y1) > -BEYOND
    if not inside or any("constrained_layout not applied" in str(one.message) for one in told):
        message = f"{name}: legend and labels leave no room for the axes in {width:.3g} x {height:.3g} in"
        raise DatasetError(f"{message}; allowed: a larger --size")


def _inches(size: str | None) -> tuple[float, float] | None:
    """Return a size as width and height in inches."""
    if size is None:
        return None
    match = re.fullmatch(r"(\d+\.?\d*)\s*x\s*(\d+\.?\d*)\s*(mm|cm|in|)", size.strip())
    width, height = (float(match[k]) / INCH[match[3]] for k in (1, 2)) if match else (0.0, 0.0)
    if not (LEAST <= width <= MOST and LEAST <= height <= MOST):
        message = f"--size is {size!r}; allowed: WxH with a unit mm, cm or in (default), {LEAST} to {MOST} in"
        raise DatasetError(f"{message}, as 120x80mm")
    return width, height


def _shaped(figure: Any, inches: tuple[float, float] | None, log: str | None) -> list[str]:
    """Give a figure a size, and its axes logarithmic scales; return the axes without positive data."""
    from roughvol.report.figures.style import plain_ticks

    left = []
    if inches is not None:
        figure.set_size_inches(*inches)
    for ax in figure.axes if log else ():
        for axis in log or "":
            if ax.name != "rectilinear" or ax.images or not ax.lines:  # a map and its colour bar
                continue
            if getattr(ax.dataLim, f"{axis}1") > 0.0:
                # a curve ends at its last positive x; one that falls to 0 goes to the lower edge
                getattr(ax, f"set_{axis}scale")("log", nonpositive="mask" if axis == "x" else "clip")
                if getattr(ax, f"get_{axis}lim")()[0] <= 0.0:  # an axis that begins at 0
                    ax.autoscale(axis=axis)
                if axis == "x":
                    numbers = [float(x) for line in ax.lines for x in line.get_xdata() if x > 0.0]
                    if min(numbers) < (least := ROUNDING * max(numbers)):  # as d/σ at the mean plane
                        ax.set_xlim(min(x for x in numbers if x >= least), max(numbers))
                    plain_ticks(ax.xaxis)
            else:
                left.append(axis)
    above = [child for ax in figure.axes if ax.get_xscale() == "log" for child in ax.child_axes]
    if above:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            figure.draw_without_rendering()  # an axis on top has the scale of the axis below from then on
        for ax in above:
            plain_ticks(ax.xaxis)
    return left
