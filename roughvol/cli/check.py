"""The command `check`: a study with all defaults, its first surface and its cost."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

import roughvol
from roughvol.campaign.machine import size
from roughvol.cli.options import JOBS, JSON, SET, STUDY, command, given, out
from roughvol.cli.output import count, say, say_json, warn
from roughvol.errors import DatasetError
from roughvol.study.values.durations import duration

if TYPE_CHECKING:
    from roughvol.questions import Checked

MANY = 40  # steps of a sweep from which on the notice of fewer steps appears
FEWER = "#         with a fourth of sweep.steps, leaks between the states change by up to 3 % (flow.md)"


@command
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
    from roughvol.campaign import cost, interpretation

    found = roughvol.check(given(study, changes), jobs=jobs, changes=changes)
    picture = _look(found, out or Path()) if look or out is not None else None
    cases = found.study.cases()
    if as_json:
        say_json(found.plain() | {"picture": picture and str(picture)})
    else:
        say(found.study.to_yaml())
        if found.surface is not None:
            say(interpretation.text(found.surface, cases[0], len(cases)))
        if picture is not None:
            say(f"# picture {picture}")
        say("\n".join(_expected(found) if found.expected else _cost(found)))
        warn(found.warnings)
        for choice in () if found.expected else cost.choices(found.study, jobs):
            area, pressure, volume = choice.errors
            say(
                f"# {choice.name:9s} η/σ ≤ {choice.rtol:.0e}: about {duration(choice.seconds)}; "
                f"errors about {f'{area:.0e}' if area else '0'} in A*, {pressure:.0e} of p*, {volume:.0e} in V*"
            )
    cost.check_fits(cases, cases, found.folder)


def _look(found: Checked, folder: Path) -> Path:
    """Draw the surface of the first case into a folder, and return the path of the picture."""
    from roughvol.report.figures import surface_picture
    from roughvol.store import stamped_file

    case, path = found.study.cases()[0], folder / f"{found.study.name}-look.png"
    stamped_file.make_folder(folder)
    if found.surface is None:
        raise DatasetError(f"{case.label}: too large a surface to be drawn before it is computed")
    surface_picture.look(found.surface, case.length_unit, case.label).savefig(path)
    return path


def _cost(found: Checked) -> list[str]:
    """Return the cost of a study as comments of its YAML."""
    estimate, transport = found.estimate, found.study.record.transport
    long = estimate.steps >= MANY * estimate.cases
    return [
        f"# {count(estimate.cases, 'case')}, {count(estimate.steps, 'state')} to solve",
        f"# memory  about {size(estimate.memory)} a process, {count(estimate.jobs, 'process', 'processes')} at once",
        *([f"#         {estimate.notice}"] if estimate.notice else []),
        f"# disk    up to {size(estimate.disk)}",
        f"# time    about {duration(estimate.seconds)} (estimate from convolutions timed on this machine)",
        *(f"#         {duration(seconds)} of one core for {name}" for name, seconds in estimate.observables.items()),
        *([FEWER] if transport and transport.transmissivity == "every-step" and long else []),
    ]


def _expected(found: Checked) -> list[str]:
    """Return the expected cost of an ensemble as comments."""
    lines = [f"# the solver's residual is η/σ ≤ {found.study.cases()[0].solver.tolerance:.0e}"]
    for row in found.expected:
        samples = ", ".join(f"{n} at m = {m}" for m, n in row.samples.items())
        samples += f", {row.surfaces} surfaces without a solve, {row.steps} steps"
        lines.append(f"# D = {row.D:g}: about {samples}: {duration(row.seconds)} of one core")
        plain = duration(row.plain)
        lines.append(f"#          plain Monte Carlo: {plain} (both to a factor of 2, by surfaces up to m = 6)")
    return [*lines, f"# memory  about {size(found.estimate.memory)} a process"]
