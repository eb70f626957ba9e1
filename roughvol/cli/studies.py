"""The commands that take a study: check, run, status, tradeoff, schema."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from roughvol import cli_text
from roughvol.cli.group import examples, main, study_of
from roughvol.cli.numbers import say_json, say_table
from roughvol.cli.options import JOBS, JSON, SET, STUDY, completed_figures, deprecated, out
from roughvol.cli.output import say, warn
from roughvol.study.values.durations import duration

if TYPE_CHECKING:
    from roughvol.campaign.batch import Progress
    from roughvol.campaign.cost import Estimate
    from roughvol.ensemble.prediction import Expected
    from roughvol.store.dataset import Dataset
    from roughvol.study import Case, Study
    from roughvol.surfaces.surface import Surface

PICTURES = (".png", ".pdf", ".svg", ".jpg")
SHOWN = 50  # cases of one kind listed by `status`
EVENT_EVERY, PLAIN_EVERY = 1.0, 5.0  # seconds between two lines without a terminal: of a case that ended, of steps


@main.command(
    epilog=examples("roughvol check seal.yaml", "roughvol check scan.yaml --look", "roughvol check seal --json")
)
@STUDY
@click.option("--look", is_flag=True, help="Draw the surface of the first case as NAME-look.png.")
@out("the current one; of --look alone")
@JOBS
@JSON
@SET
def check(study: Path, look: bool, out: Path | None, jobs: int | None, as_json: bool, changes: tuple[str, ...]) -> None:
    """Show STUDY with all defaults, its first surface and its cost; store nothing.

    The cost is the number of cases, memory, disk and expected time. Of an ensemble, small surfaces are solved for it.

    A study beyond the memory or disk of this machine is an error. One of more than 30 days draws a warning.
    """
    from roughvol.campaign import checks, cost, understood, validity

    loaded, folder = study_of(study, changes)
    surface = understood.shown(loaded, checks.check_surfaces(loaded))
    cases = loaded.cases()
    picture = _look(loaded, surface, cases[0], out) if look or out is not None else None
    estimated = cost.estimate(loaded, jobs)
    rows = []
    if loaded.ensemble is not None:
        from roughvol.campaign import trials  # scipy.stats: half a second

        rows = trials.expected(loaded)
    notes = understood.notes(cases[0], surface) if surface is not None and cases[0].file is not None else ()
    doubts = (*notes, *checks.doubtful(loaded, surface)) if not rows else checks.doubtful(loaded, surface)
    warnings = list(validity.sentences(checks.foreseen(loaded, surface), doubts))
    if not rows and (long := cost.warning(estimated.seconds, estimated.jobs)):
        warnings.append(long)
    if as_json:
        sizes = None
        if surface is not None:
            sizes = {"nodes": list(surface.shape), "side": surface.side, "spacing": surface.spacing, "Sq": surface.Sq}
        say_json(
            {
                "study": loaded.model_dump(mode="json"),
                "surface": sizes and sizes | {"unit": cases[0].length_unit},
                "cost": asdict(estimated) | {"expected": [asdict(row) for row in rows]},
                "units": {"memory": "byte", "disk": "byte", "seconds": "s"},
                "picture": picture and str(picture),
                "warnings": warnings,
            }
        )
    else:
        say(loaded.to_yaml())
        if surface is not None:
            say(understood.text(surface, cases[0], len(cases)))
        if picture is not None:
            say(f"# picture {picture}")
        if rows:
            _say_expected(loaded, rows, estimated)
        else:
            say(cli_text.cost(estimated))
        warn(warnings)
        for choice in () if rows else cost.choices(loaded, jobs):
            area, pressure, volume = choice.errors
            say(
                f"# {choice.name:9s} η/σ ≤ {choice.rtol:.0e}: about {duration(choice.seconds)}; "
                f"errors about {f'{area:.0e}' if area else '0'} in A*, {pressure:.0e} of p*, {volume:.0e} in V*"
            )
    cost.check_study_fits(loaded, folder)


def _look(study: Study, surface: Surface | None, case: Case, out: Path | None) -> Path:
    """Draw the surface of a case into a folder, and return the path of the picture."""
    from roughvol.report.figures import surface_picture

    path = (out or Path()) / f"{study.name}-look.png"
    is_file = out is not None and out.suffix in PICTURES  # as in older versions
    if out is not None and is_file:
        path = out
    else:
        path.parent.mkdir(parents=True, exist_ok=True)
    surface_picture.write(surface, case.length_unit, case.label, path)
    if is_file:
        deprecated("check --out FILE", "--out FOLDER")
    return path


@main.command(
    epilog=examples(
        "roughvol run seal.yaml",
        "roughvol run effect_of_D.yaml --jobs 4 --out /data/effect_of_D",
        "roughvol run seal.yaml --set surface.m=7 --set name=finer",
    )
)
@STUDY
@JOBS
@out("runs/NAME")
@click.option("--fresh", is_flag=True, help="Compute every case anew, finished ones too.")
@click.option("--scheduler", metavar="ADDRESS", help="Compute on the workers of this Dask scheduler.")
@click.option(
    "--figures",
    metavar="NAMES",
    shell_complete=completed_figures,
    help="Compute only the cases of these figures, as in fig05,fig06a.",
)
@JSON
@SET
def run(
    study: Path,
    jobs: int | None,
    out: Path | None,
    fresh: bool,
    scheduler: str | None,
    figures: str | None,
    as_json: bool,
    changes: tuple[str, ...],
) -> None:
    """Compute the unfinished cases of STUDY, and collect all cases in study.nc; STUDY may be - for standard input.

    The numbers of the chief states are printed: levels asked for and ends of legs. `roughvol show` has all.

    Ctrl-C stops after the cases at work, a second one at once. The same command continues the run.
    """
    started = time.monotonic()
    from roughvol.campaign import running, signals

    loaded, folder = study_of(study, changes)
    folder = out or folder
    only = None
    if figures:
        from roughvol import plotting

        only = plotting.needed(figures.split(","), loaded.cases())
    last: Progress | None = None

    def follow(now: Progress) -> None:
        nonlocal last
        last = now
        draw(now)

    with _progress() as draw, signals.first_interrupt(_say_how_to_stop) as interrupted:
        results = running.run(
            loaded,
            out=folder,
            jobs=jobs,
            fresh=fresh,
            on_event=follow,
            scheduler=scheduler,
            stopping=interrupted,
            only=only,
        )
    assert last is not None
    if as_json:
        _say_record(loaded.name, results, last, folder / "study.nc", time.monotonic() - started)
        return
    say(cli_text.ran(last, time.monotonic() - started))
    _say_numbers(loaded.name, results)
    say(cli_text.summary(results, folder / "study.nc"))
    warn(results.attrs["warnings"].splitlines())


@main.command(epilog=examples("roughvol status effect_of_D", "roughvol status /data/effect_of_D --json"))
@STUDY
@click.option("--out", type=click.Path(path_type=Path), hidden=True)
@JSON
@SET
def status(study: Path, out: Path | None, as_json: bool, changes: tuple[str, ...]) -> None:
    """List the finished, running, failed and missing cases of STUDY, also during a run.

    STUDY is a study file, - for standard input, the folder of a run, or a name under runs/.
    """
    from roughvol.store import run_folder, run_status

    loaded, folder = study_of(study, changes)
    if out is not None:
        deprecated("status STUDY --out FOLDER", "status FOLDER")
    state = run_status.status(loaded, out or folder)
    if as_json:
        content = asdict(state) | {"folder": str(state.folder)}
        say_json(content | {"units": {"left": "s"}})
        return
    left, several = len(state.running) + len(state.missing), (state.failed, state.damaged)
    total = len(state.done) + left + sum(map(len, several))
    say(f"{state.folder}: {len(state.done)} of {total} cases finished" + (", collected" * state.collected))
    if state.holder is not None:
        time_left = f", about {duration(state.left)} left" if state.left is not None else ""
        say(f"running: {state.holder}{time_left}")
    if mixed := run_folder.versions_text(state.versions):
        say(f"  {mixed}")
    if state.strange:
        say(f"  {cli_text.count(state.strange, 'file')} of cases of another study")
    for title, ids in (("running", state.running), ("missing", state.missing)):
        for id in ids[:SHOWN]:
            say(f"  {id}  {title}")
        if len(ids) > SHOWN:
            say(f"  … and {len(ids) - SHOWN} more {title}")
    for title, reasons in (
        ("failed", state.failed),
        ("damaged, to be computed again", state.damaged),
        ("outdated, to be computed again", state.outdated),
    ):
        for id, reason in list(reasons.items())[:SHOWN]:
            say(f"  {id}  {title}: {reason}")
        if len(reasons) > SHOWN:
            say(f"  … and {len(reasons) - SHOWN} more {title}")


@main.command(epilog=examples("roughvol tradeoff tradeoff.yaml"))
@STUDY
@out("runs/NAME")
@JSON
@SET
def tradeoff(study: Path, out: Path | None, as_json: bool, changes: tuple[str, ...]) -> None:
    """Measure speed against accuracy on the surfaces of STUDY, with work-precision diagrams; numbers in tradeoff.nc.

    Shows also the convergence of A*, p* and V* in the resolution m of the study.
    """
    from roughvol.campaign import tradeoff as trade
    from roughvol.report import convergence
    from roughvol.report.figures import registry
    from roughvol.store import dataset

    loaded, folder = study_of(study, changes)
    folder = out or folder
    show = sys.stderr.isatty()
    measured = trade.measure(loaded, lambda k, n: say(f"\r{k} of {n} sweeps", nl=k == n, err=True) if show else None)
    lines = []
    dataset.write(measured, folder / "tradeoff.nc")
    for name, figure in registry.TRADEOFF.items():
        if figure.missing(measured) is None:
            (folder / "figures").mkdir(exist_ok=True)
            figure(measured).savefig(folder / "figures" / f"{name}.png")
            lines.append(str(folder / "figures" / f"{name}.png"))
    if as_json:
        say_json({"study": loaded.name, "file": str(folder / "tradeoff.nc"), **measured.to_dict()})
        return
    for line in [*lines, convergence.summary(measured), str(folder / "tradeoff.nc")]:
        say(line)


@main.command(epilog=examples("roughvol schema > study.schema.json"))
def schema() -> None:
    """Print the JSON schema of study files, for completion and checks in editors."""
    import json

    from roughvol.study import json_schema

    say(json.dumps(json_schema(), indent=2, ensure_ascii=False))


def _say_expected(study: Study, rows: Sequence[Expected], estimated: Estimate) -> None:
    """Print the expected cost of an ensemble."""
    say(f"# the solver's residual is η/σ ≤ {study.cases()[0].solver.tolerance:.0e}")
    for row in rows:
        samples = ", ".join(f"{n} at m = {m}" for m, n in row.samples.items())
        samples += f", {row.surfaces} surfaces without a solve, {row.steps} steps"
        say(f"# D = {row.D:g}: about {samples}: {duration(row.seconds)} of one core")
        plain = duration(row.plain)
        say(f"#          plain Monte Carlo: {plain} (both to a factor of 2, by surfaces up to m = 6)")
    say(f"# memory  about {cli_text.size(estimated.memory)} a process")


def _say_numbers(name: str, results: Dataset) -> None:
    """Print the chief states of a run, and where its ways through the gap close."""
    if "step" not in results.sizes:
        return
    from roughvol.analysis.stored_run import Run
    from roughvol.report import screen

    for run in Run.of(name, results).parts:
        for table in screen.summary(run):
            say_table(table if run.name == name else table.under(run.name.removeprefix(f"{name}, ")))


def _say_record(name: str, results: Dataset, last: Progress, file: Path, seconds: float) -> None:
    """Print a run as JSON: its cases, the numbers of all surfaces as `show --json` has them, and its warnings."""
    from roughvol.analysis.stored_run import Run
    from roughvol.report import screen

    names, rows, units = screen.records(Run.of(name, results)) if "step" in results.sizes else ([], [], {})
    cases = {"cases": last.cases, "finished_before": last.kept, "seconds": round(seconds, 3)}
    table = {"units": units, "rows": [dict(zip(names, row, strict=True)) for row in rows]}
    answer = {name: results.attrs.get(name, "").splitlines() for name in ("answer", "warnings")}
    say_json({"run": name, "file": str(file), **cases, **table, **answer})


def _say_how_to_stop() -> None:
    say("stopping after the cases at work; Ctrl-C again stops at once", err=True)


@contextlib.contextmanager
def _progress() -> Iterator[Callable[[Progress], None]]:
    """Draw on a terminal; elsewhere write a line now and then."""
    started = time.monotonic()
    if not sys.stderr.isatty():
        last, waiting = started, ""

        def write(now: Progress) -> None:
            nonlocal last, waiting
            if now.notice:
                say(now.notice, err=True)
                return
            text = cli_text.progress(now, time.monotonic() - started)
            waiting = f"{now.event} · {text}" if now.event else waiting
            if time.monotonic() - last >= (EVENT_EVERY if waiting else PLAIN_EVERY):
                say(waiting or text, err=True)
                last, waiting = time.monotonic(), ""

        try:
            yield write
        finally:
            if waiting:
                say(waiting, err=True)
        return

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    columns = (BarColumn(), TaskProgressColumn(), TextColumn("{task.description}"))
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    task = bar.add_task("starting", total=1.0)

    def draw(now: Any) -> None:
        with contextlib.suppress(OSError):  # the terminal is closed
            if now.notice or (now.event and now.failed):
                bar.console.print(now.notice or now.event, markup=False, highlight=False)
            bar.update(task, completed=now.work, description=cli_text.progress(now, time.monotonic() - started))

    bar.start()
    try:
        yield draw
    finally:
        with contextlib.suppress(OSError):
            bar.stop()
