"""The command line: how to run a study, never what to compute; the only place that prints, draws progress and exits."""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from roughvol._version import __version__
from roughvol.campaign import limits
from roughvol.errors import CampaignError, ContactError, ConvergenceError, DatasetError, RoughvolError, StudyError

if TYPE_CHECKING:
    from roughvol.campaign.batch import Progress
    from roughvol.store.dataset import Dataset
    from roughvol.study import Study

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130
LIGHT = ("schema", "status")  # they import no library that computes
SHOWN = 50  # cases of a kind that `status` names
PLAIN_EVERY = 5.0  # seconds between two lines of progress where there is no terminal to draw on


def _examples(*lines: str) -> str:
    """Return the end of a help page; the first character keeps click from filling the lines."""
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in lines)])


STUDY = click.argument("study", type=click.Path(path_type=Path))
OUT = click.option("--out", type=click.Path(path_type=Path), help="Folder of the results [default: runs/NAME].")


class _Door(click.Group):
    """Turns errors into one message and an exit code."""

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        found = super().resolve_command(ctx, args)
        if found[0] not in LIGHT and (message := limits.too_narrow()):
            click.echo(f"error: {message}", err=True)
            ctx.exit(FAILED)
        return found

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            click.echo("interrupted; what is finished is kept, and the same command goes on from there", err=True)
            ctx.exit(INTERRUPTED)
        except RoughvolError as error:
            click.echo(_message(error), err=True)
            ctx.exit(FAILED if isinstance(error, CampaignError | ContactError | ConvergenceError) else BAD_INPUT)
        except (MemoryError, ImportError, OSError, RuntimeError) as error:
            if not limits.is_lack_of_memory(error):
                raise
            first = str(error).strip().splitlines()
            click.echo(f"error: not enough memory ({first[0] if first else type(error).__name__})", err=True)
            ctx.exit(FAILED)


@click.group(
    cls=_Door,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=_examples(
        "roughvol check configs/effect_of_D.yaml    what it will compute, and what that costs",
        "roughvol run configs/effect_of_D.yaml      compute it; again, to go on where it stopped",
        "roughvol plot                              every figure that the latest run can feed",
    ),
)
@click.version_option(__version__)
def main() -> None:
    """Free volume between rough surfaces in elastic contact: from a study file to labelled data and figures."""


@main.command(
    epilog=_examples("roughvol check configs/morphology.yaml", "roughvol check scan.yaml --look --out scan.png")
)
@STUDY
@click.option("--look", is_flag=True, help="Draw the surface of the first case: map, histogram, two profiles.")
@click.option("--out", type=click.Path(path_type=Path), help="File of that picture [default: NAME-look.png].")
@click.option("--jobs", "-j", type=click.IntRange(min=1), help="Processes to reckon with [default: one a core].")
def check(study: Path, look: bool, out: Path | None, jobs: int | None) -> None:
    """Say what STUDY will compute and what it costs, without computing it.

    Prints the study with every default written out, how its surface was understood, then the number of cases, memory,
    disk and expected time.

    A study that needs more memory or disk than this machine has is an error; one of more than 30 days draws a warning.
    """
    from roughvol.campaign import checks, cost, understood, validity
    from roughvol.store import run_folder
    from roughvol.study import load

    loaded = load(study)
    surface = understood.shown(loaded, checks.check_surfaces(loaded))  # a bad file is known before it is read here
    cases = loaded.cases()
    click.echo(loaded.to_yaml())
    if surface is not None:
        click.echo(understood.text(surface, cases[0], len(cases)))
    if look or out is not None:
        from roughvol.report.figures import surface_picture

        path = surface_picture.write(
            surface, cases[0].length_unit, cases[0].label, out or Path(f"{loaded.name}-look.png")
        )
        click.echo(f"# picture {path}")
    if loaded.ensemble is not None:
        _say_expected(loaded, jobs)
        _warn(validity.sentences(checks.foreseen(loaded, surface), ()))
        cost.check_fits(loaded, run_folder.folder_of(loaded))
        return
    estimated = cost.estimate(loaded, jobs)
    click.echo(_cost(estimated))
    noted = understood.notes(cases[0], surface) if surface is not None and cases[0].file is not None else ()
    _warn(validity.sentences(checks.foreseen(loaded, surface), noted))
    for choice in cost.choices(loaded, jobs):
        area, pressure, volume = choice.errors
        click.echo(
            f"# {choice.name:9s} η/σ ≤ {choice.rtol:.0e}: about {_duration(choice.seconds)}; "
            f"errors about {area:.0e} in A*, {pressure:.0e} of p*, {volume:.0e} in V*"
        )
    if slow := cost.warning(estimated.seconds, estimated.jobs):
        _warn([slow])
    cost.check_fits(loaded, run_folder.folder_of(loaded))


@main.command(
    epilog=_examples(
        "roughvol run configs/smoke.yaml", "roughvol run configs/effect_of_D.yaml --jobs 4 --out /data/effect_of_D"
    )
)
@STUDY
@click.option("--jobs", "-j", type=click.IntRange(min=1), help="Processes to use [default: one a core].")
@OUT
@click.option("--fresh", is_flag=True, help="Compute every case anew, also those that are finished.")
@click.option("--scheduler", metavar="ADDRESS", help="Compute on the workers of this Dask scheduler, not here.")
@click.option("--figures", metavar="NAMES", help="Compute only what these figures need, as in fig05,fig06a.")
def run(
    study: Path, jobs: int | None, out: Path | None, fresh: bool, scheduler: str | None, figures: str | None
) -> None:
    """Compute every case of STUDY that is not finished yet and collect them in study.nc.

    Ctrl-C stops after the cases that are being computed, a second one at once; the same command goes on from there.
    """
    started = time.monotonic()
    from roughvol.campaign import running, workers
    from roughvol.report.figures import selection
    from roughvol.store import run_folder
    from roughvol.study import load

    loaded = load(study)
    only = selection.needed(figures.split(","), loaded.cases()) if figures else None
    last: Progress | None = None

    def follow(now: Progress) -> None:
        nonlocal last
        last = now
        draw(now)

    with _progress() as draw, workers.first_interrupt(_say_how_to_stop) as interrupted:
        results = running.run(
            loaded,
            out=out,
            jobs=jobs,
            fresh=fresh,
            on_event=follow,
            scheduler=scheduler,
            stopping=interrupted,
            only=only,
        )
    assert last is not None
    click.echo(_ran(last, time.monotonic() - started))
    click.echo(_summary(results, run_folder.folder_of(loaded, out) / "study.nc"))
    _warn(results.attrs["warnings"].splitlines())


@main.command(epilog=_examples("roughvol status configs/effect_of_D.yaml"))
@STUDY
@OUT
def status(study: Path, out: Path | None) -> None:
    """Say which cases of STUDY are finished, running, failed or missing, also while a run is going on."""
    from roughvol.store import run_folder, run_status

    state = run_status.status(study, out)
    left, several = len(state.running) + len(state.missing), (state.failed, state.damaged)
    total = len(state.done) + left + sum(map(len, several))
    click.echo(f"{state.folder}: {len(state.done)} of {total} cases finished" + (", collected" * state.collected))
    if state.holder is not None:
        time_left = f", about {_duration(state.left)} left" if state.left is not None else ""
        click.echo(f"a run is going on: {state.holder}{time_left}")
    if mixed := run_folder.versions_text(state.versions):
        click.echo(f"  {mixed}")
    if state.strange:
        click.echo(f"  {_count(state.strange, 'file')} of cases that are not of this study")
    for title, ids in (("running", state.running), ("missing", state.missing)):
        for id in ids[:SHOWN]:
            click.echo(f"  {id}  {title}")
        if len(ids) > SHOWN:
            click.echo(f"  … and {len(ids) - SHOWN} more {title}")
    for title, reasons in (
        ("failed", state.failed),
        ("damaged, will be computed again", state.damaged),
        ("outdated, will be computed anew", state.outdated),
    ):
        for id, reason in list(reasons.items())[:SHOWN]:
            click.echo(f"  {id}  {title}: {reason}")
        if len(reasons) > SHOWN:
            click.echo(f"  … and {len(reasons) - SHOWN} more {title}")


@main.command(epilog=_examples("roughvol plot", "roughvol plot effect_of_D fig04a fig06b --format pdf"))
@click.argument("run", required=False)
@click.argument("figure", nargs=-1)
@click.option("--format", "suffix", type=click.Choice(["png", "pdf", "svg"]), default="png", show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="Folder of the figures [default: figures in the run].")
def plot(run: str | None, figure: tuple[str, ...], suffix: str, out: Path | None) -> None:
    """Draw figures from RUN: a folder, a study.nc, or a name under runs/ [default: the latest].

    Those of the paper are fig01 to fig12b, those of the flow through the gap seal_volume to seal_map.

    Without a FIGURE it draws every one that the run can feed.
    """
    from roughvol.report.figures import selection
    from roughvol.store import dataset

    figures = selection.figures()
    first_is_figure = run is not None and run in figures and not Path(run).exists()
    names = (str(run), *figure) if first_is_figure else figure
    path = _study_file(None if first_is_figure else run)
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


@main.command(epilog=_examples("roughvol report", "roughvol report effect_of_D effect_of_m --out /tmp/report"))
@click.argument("run", nargs=-1)
@click.option("--out", type=click.Path(path_type=Path), help="Folder of the report [default: the run, or runs/report].")
@click.option(
    "--check",
    "expected",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="JSON with verdicts and bands of numbers; a departure from them is an error.",
)
def report(run: tuple[str, ...], out: Path | None, expected: Path | None) -> None:
    """Report on RUN..., as report.html, report.md and claims.json [default: all runs].

    A RUN is a folder, a study.nc, or a name under runs/. Runs of the paper's configuration answer its claims; a run
    that lacks it is refused, by name and with the reason. Every other run, as of a measured map, gets a section of its
    own: surface, loading, states, closing pressures, warnings, figures.
    """
    from roughvol.report import write as reporting

    finished = sorted(Path("runs").glob("*/study.nc"))
    paths = [_study_file(name) for name in run] or finished or [_study_file(None)]
    answered = reporting.assemble(paths)
    page = reporting.write(answered, out or (paths[0].parent if len(paths) == 1 else Path("runs/report")))
    click.echo(reporting.summary(answered))
    click.echo(page)
    left = reporting.departures(answered, expected.read_text(encoding="utf-8")) if expected else []
    if left:
        message = "\n".join(
            [f"{_count(len(left), 'answer')} left the bands of {expected}", *(f"  {one}" for one in left)]
        )
        raise CampaignError(message)


@main.command(epilog=_examples("roughvol tradeoff configs/tradeoff.yaml"))
@STUDY
@OUT
def tradeoff(study: Path, out: Path | None) -> None:
    """Measure speed against accuracy on the surfaces of STUDY: tradeoff.nc and work-precision diagrams.

    Says also which of A*, p* and V* are converged in the resolution m of the study.
    """
    from roughvol.campaign import tradeoff as trade
    from roughvol.report import convergence
    from roughvol.report.figures import work_precision
    from roughvol.store import dataset, run_folder
    from roughvol.study import load

    loaded = load(study)
    folder = run_folder.folder_of(loaded, out)
    show = sys.stderr.isatty()
    measured = trade.measure(
        loaded, lambda k, n: click.echo(f"\r{k} of {n} sweeps", nl=k == n, err=True) if show else None
    )
    dataset.write(measured, folder / "tradeoff.nc")
    for name, draw in work_precision.FIGURES.items():
        if work_precision.missing(name, measured) is None:
            (folder / "figures").mkdir(exist_ok=True)
            draw(measured).savefig(folder / "figures" / f"{name}.png")
            click.echo(folder / "figures" / f"{name}.png")
    click.echo(convergence.summary(measured))
    click.echo(folder / "tradeoff.nc")


@main.command(epilog=_examples("roughvol schema > study.schema.json"))
def schema() -> None:
    """Print the JSON schema of study files, for editors to complete and check them."""
    import json

    from roughvol.study import json_schema

    click.echo(json.dumps(json_schema(), indent=2, ensure_ascii=False))


def _say_expected(study: Study, jobs: int | None) -> None:
    """Print what an ensemble is expected to cost."""
    from roughvol.campaign import cost, expected

    estimated = cost.estimate(study, jobs)
    click.echo(f"# the solver's residual is η/σ ≤ {study.cases()[0].solver.tolerance:.0e}")
    for one in expected.expected(study):
        samples = ", ".join(f"{n} at m = {m}" for m, n in one.samples.items())
        click.echo(f"# D = {one.D:g}: about {samples}: {_duration(one.seconds)} of one core")
        click.echo(
            f"#          plain Monte Carlo: {_duration(one.plain)} (both from typical variances, to a factor of 2)"
        )
    click.echo(f"# memory  about {_bytes(estimated.memory)} a process")


def _message(error: RoughvolError) -> str:
    if isinstance(error, StudyError):
        lines = [f"  {problem}" for problem in error.problems]
        return "\n".join([f"{_count(len(lines), 'problem')} in the study", *lines])
    return f"error: {error}"


def _warn(*sentences: Iterable[str]) -> None:
    """Print each sentence once as a warning."""
    for sentence in dict.fromkeys(one for several in sentences for one in several):
        click.echo(f"warning: {sentence}", err=True)


def _ran(last: Progress, seconds: float) -> str:
    before = f", {last.kept} of them finished before" if last.kept else ""
    return f"{_count(last.cases, 'case')} in {_duration(seconds)}{before}"


def _summary(results: Dataset, path: Path) -> str:
    from roughvol.store import dataset

    lines = []
    if "step" in results.sizes:
        solved = results.residual.notnull()
        convolutions = (results.convolutions + results.convolutions_fp32).where(solved)
        lines.append(
            f"{_count(int(solved.sum()), 'state')}, {float(convolutions.mean()):.1f} convolutions each on average"
        )
        lines.append(f"largest residual η/σ {float(results.residual.max()):.1e}")
        if not bool(results.converged.where(solved, True).all()):
            message = f"states that did not converge are stored in {path}; this should not happen, please report it"
            raise CampaignError(message)
    if "observable" in results.sizes:
        seconds = results.observable_time
        taken = {name.item(): float(seconds.sel(observable=name).sum()) for name in results.observable}
        each = (f"{name} {_duration(total)}" for name, total in taken.items())
        lines.append(f"of the time of the cases: {', '.join(each)}")
    for dim in ("field_at", "density_at", "box_at", "flux_at"):
        for label in results.get(dim, ()):
            absent = int((results[f"{dim}_step"].sel({dim: label}) < 0).sum())
            if absent:
                lines.append(f"{label.item()} was not reached in {_count(absent, 'case')}")
    for name, absent in dataset.unreached(results).items():
        lines.append(f"no state at which {name} is asked for was reached in {_count(absent, 'case')}")
    lines += results.attrs.get("answer", "").splitlines()
    return "\n".join([*dict.fromkeys(lines), str(path)])


def _cost(cost: Any) -> str:
    return (
        f"# {_count(cost.cases, 'case')}, {_count(cost.steps, 'state')} to solve\n"
        f"# memory  about {_bytes(cost.memory)} a process, {_count(cost.jobs, 'process', 'processes')} at once\n"
        + (f"#         {cost.notice}\n" if cost.notice else "")
        + f"# disk    up to {_bytes(cost.disk)}\n"
        f"# time    about {_duration(cost.seconds)} (an estimate, from convolutions timed on this machine)"
        + "".join(f"\n#         {_duration(taken)} of one core for {name}" for name, taken in cost.observables.items())
    )


def _count(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _bytes(number: float) -> str:
    power = min(int(math.log10(max(number, 1.0)) / 3), 4)
    return f"{number / 1000**power:.3g} {('B', 'kB', 'MB', 'GB', 'TB')[power]}"


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    days = minutes / 1440
    return f"{minutes / 60:.1f} h" if days < 3 else f"{days:.0f} days" if days < 365 else f"{days / 365.25:.3g} years"


def _study_file(run: str | None) -> Path:
    if run is None:
        # study.yaml is written by every run, also by one that finds all its cases finished
        found = [path for path in Path("runs").glob("*/study.yaml") if path.with_name("study.nc").is_file()]
        if not found:
            message = "no finished run under runs/; start one with: roughvol run STUDY"
            raise DatasetError(message)
        return max(found, key=lambda path: path.stat().st_mtime).with_name("study.nc")
    places = [Path(run), Path(run) / "study.nc", Path("runs") / run / "study.nc"]
    for place in places:
        if place.is_file():
            return place
    message = f"no results of {run!r}: looked for {', '.join(map(str, places))}"
    raise DatasetError(message)


def _say_how_to_stop() -> None:
    click.echo("stopping after the cases that are being computed; Ctrl-C again stops at once", err=True)


@contextlib.contextmanager
def _progress() -> Iterator[Callable[[Progress], None]]:
    """Draw on a terminal, write a line now and then elsewhere."""
    started = time.monotonic()
    if not sys.stderr.isatty():
        last = started

        def write(now: Progress) -> None:
            nonlocal last
            if now.notice:
                click.echo(now.notice, err=True)
            elif now.event or time.monotonic() - last >= PLAIN_EVERY:
                last = time.monotonic()
                event = f"{now.event} · " if now.event else ""
                click.echo(event + _standing(now, last - started), err=True)

        yield write
        return

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    columns = (BarColumn(), TaskProgressColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)

        def draw(now: Any) -> None:
            if now.notice or (now.event and now.failed):
                bar.console.print(now.notice or now.event, markup=False, highlight=False)
            bar.update(task, completed=now.work, description=_standing(now, time.monotonic() - started))

        yield draw


def _standing(now: Progress, seconds: float) -> str:
    """Return cases done, steps, rate and time left in one line."""
    failed = f" ({now.failed} failed)" if now.failed else ""
    text = f"{now.kept + now.done} of {_count(now.cases, 'case')}{failed}"
    if now.steps:
        text += f" · {now.steps_done} of {now.steps} steps · {now.steps_done / max(seconds, 1e-3):.0f} steps/s"
    if 0.01 < now.work < 1.0:
        text += f" · {_duration(seconds * (1.0 - now.work) / now.work)} left"
    return f"{text} · {now.standing}" if now.standing else text
