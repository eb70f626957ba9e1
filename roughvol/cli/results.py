"""The commands that draw and judge results: plot, report."""

from __future__ import annotations

from pathlib import Path

import click

from roughvol import cli_text
from roughvol.cli.group import examples, main, results_file
from roughvol.errors import CampaignError, DatasetError


@main.command(epilog=examples("roughvol plot", "roughvol plot effect_of_D fig04a fig06b --format pdf"))
@click.argument("run", required=False)
@click.argument("figure", nargs=-1)
@click.option("--format", "suffix", type=click.Choice(["png", "pdf", "svg"]), default="png", show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="Folder of the figures [default: figures in the run].")
def plot(run: str | None, figure: tuple[str, ...], suffix: str, out: Path | None) -> None:
    """Draw figures from RUN: a folder, a study.nc, or a name under runs/ [default: the latest].

    Figures of the paper are fig01 to fig12b; those of the flow through the gap are seal_volume to seal_map.

    Without FIGURE, all figures of the run are drawn.
    """
    from roughvol.report.figures import selection
    from roughvol.store import dataset

    figures = selection.figures()
    first_is_figure = run is not None and run in figures and not Path(run).exists()
    names = (str(run), *figure) if first_is_figure else figure
    path = results_file(None if first_is_figure else run)
    results = dataset.read(path)
    folder = out or path.parent / "figures"
    for name in selection.drawable(results, names):
        target = folder / f"{name}.{suffix}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            figures[name][0](results).savefig(target)
        except OSError as error:
            message = f"cannot write {target}: {error}"
            raise DatasetError(message) from error
        click.echo(target)


@main.command(epilog=examples("roughvol report", "roughvol report effect_of_D effect_of_m --out /tmp/report"))
@click.argument("run", nargs=-1)
@click.option("--out", type=click.Path(path_type=Path), help="Folder of the report [default: the run, or runs/report].")
@click.option(
    "--check",
    "expected",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="JSON with expected verdicts and bands of numbers; a departure is an error.",
)
def report(run: tuple[str, ...], out: Path | None, expected: Path | None) -> None:
    """Report on RUN..., as report.html, report.md and claims.json [default: all runs].

    A RUN is a folder, a study.nc, or a name under runs/. Runs of the paper's configuration answer its claims; others
    are refused by name and reason. Every other run, such as one of a measured map, gets its own section: surface,
    loading, states, closing pressures, warnings, figures.
    """
    from roughvol.report import write as reporting

    finished = sorted(Path("runs").glob("*/study.nc"))
    paths = [results_file(name) for name in run] or finished or [results_file(None)]
    answered = reporting.assemble(paths)
    page = reporting.write(answered, out or (paths[0].parent if len(paths) == 1 else Path("runs/report")))
    click.echo(reporting.summary(answered))
    click.echo(page)
    departures = reporting.departures(answered, expected.read_text(encoding="utf-8")) if expected else []
    if departures:
        head = f"{cli_text.count(len(departures), 'answer')} left the bands of {expected}"
        message = "\n".join([head, *(f"  {departure}" for departure in departures)])
        raise CampaignError(message)
