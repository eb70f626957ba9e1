"""Campaigns: one case as the paper's Sections 2 and 3, and all cases of a study in parallel processes, resumable.

A study lands in one folder: ``study.yaml`` (every default written out), ``cases/<id>.nc``, ``study.nc``. A case is done
if its file can be read whole and the key stored in it is ours; what else lies in the folder is neither trusted nor
merged. Values do not depend on the number of processes: a case is always solved in a process of its own kind, by one
thread, and nothing that can change an answer passes from one case to the next.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import time
from collections.abc import Callable, MutableMapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from roughvol import dataset, heightfile, record, workers
from roughvol.dataset import Dataset
from roughvol.errors import CampaignError, ContactError, DatasetError, RoughvolError, SurfaceError
from roughvol.physics import halfspace, texture
from roughvol.physics.contact import first_indentation, indentation_for, sweep
from roughvol.physics.halfspace import HalfSpace
from roughvol.physics.surface import Surface, random_midpoint_displacement
from roughvol.study import Case, Study, load

HalfSpaces = MutableMapping[tuple[tuple[int, int], str, int], HalfSpace]

FFT = {"library": f"FFTW {halfspace.FFTW_VERSION}", "planner": halfspace.PLANNER}


def run_case(
    case: Case,
    *,
    study: str = "",
    half_spaces: HalfSpaces | None = None,
    on_step: Callable[[int], None] | None = None,
    threads: int = 1,
) -> Dataset:
    """Return all that is asked about one surface: made (Section 2), pressed step by step (Section 3), reduced.

    Parameters
    ----------
    case : Case
        Surface, sweep, solver, and what to record.
    study : str
        Resolved study as text, for the provenance.
    half_spaces : mutable mapping, optional
        Holds the half space of the last shape and kernel, for the next case to use.
    on_step : callable, optional
        Called with the number of each step solved.
    threads : int
        Threads inside a convolution; they change no value.

    Raises
    ------
    SurfaceError, ContactError, ConvergenceError
        If there is no surface, no problem or no solution; nothing is returned of a sweep that broke off.
    """
    started = time.perf_counter()
    with threadpool_limits(1):  # a sum split over threads would round differently from machine to machine
        surface = surface_of(case)
        values = record.of_surface(case, surface)
        if case.sweep.steps > 0:
            held = {} if half_spaces is None else half_spaces
            half_space = _half_space(surface.shape, case.solver.kernel, threads, held)
            last = _last_indentation(case, surface, half_space)
            indentations = last * np.arange(1, case.sweep.steps + 1) / case.sweep.steps
            contacts = sweep(surface, half_space, indentations, rtol=case.solver.tolerance, method=case.solver.method)
            values |= record.of_sweep(case, surface, contacts, on_step)
    values["wall_time"] = time.perf_counter() - started
    return dataset.build(case, values, dataset.provenance(study, fft=FFT | {"threads": str(threads)}, case=case))


def surface_of(case: Case) -> Surface:
    """Return the surface of a case, generated or read from its file."""
    if case.file is not None:
        heights = heightfile.read(case.file, variable=case.variable)
        if hashlib.sha256(case.file.read_bytes()).hexdigest() != case.sha256:
            message = f"{case.file} has changed since the study was loaded; run the study again"
            raise SurfaceError(message)
        return Surface(heights, case.L / (len(heights) - 1))
    assert case.D is not None
    assert case.m is not None
    assert case.seed is not None
    assert case.midpoint_law is not None
    return random_midpoint_displacement(case.D, case.m, side=case.L, seed=case.seed, law=case.midpoint_law)


def _half_space(shape: tuple[int, int], kernel: str, threads: int, held: HalfSpaces) -> HalfSpace:
    key = (shape, kernel, threads)
    if key not in held:
        held.clear()  # one at a time: it is the largest thing in memory
        held[key] = HalfSpace(shape, kernel=kernel, threads=threads)
    return held[key]


def _last_indentation(case: Case, surface: Surface, half_space: HalfSpace) -> float:
    """Return Δ/σ at the end of the sweep: on a plane, at a value given, or where the search for one ends."""
    target, scale = case.sweep.target, surface.Sq or 1.0
    value = target.value or 0.0
    rtol, method = case.solver.tolerance, case.solver.method
    predicate = record.end_of(case)
    if predicate is not None:
        return first_indentation(surface, half_space, predicate, rtol=rtol, method=method)
    if target.kind in ("contact_area", "pressure"):
        return indentation_for(surface, half_space, target.kind, value, rtol=rtol, method=method)
    if target.kind == "indentation":
        return value
    if target.kind == "summit-plane":
        end = (surface.z_max - texture.summit_plane(surface.heights)) / scale
    else:  # d/σ = value; 0 on the mean plane
        end = (surface.z_max - surface.mean_height) / scale - value
    if not end > 0.0:
        message = f"a sweep to {target.label} would end at Δ/σ = {end:.6g}; allowed: beyond first touch, Δ/σ > 0"
        raise ContactError(message)
    return end


# A study of many cases -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Progress:
    """How far a run has come: counts of cases and steps, the share of the work done, and what happened last.

    ``work`` runs from 0 to 1 and weighs each step by the expected cost of one at its resolution; ``kept`` are the cases
    that were found finished. ``event`` is a line about a case that has just ended, or empty.
    """

    cases: int
    kept: int
    done: int = 0
    failed: int = 0
    steps: int = 0
    steps_done: int = 0
    work: float = 0.0
    event: str = ""


@dataclass(frozen=True)
class Status:
    """What is there of a study: its folder and the ids of its cases that are done, missing, or damaged."""

    folder: Path
    done: tuple[str, ...]
    missing: tuple[str, ...]
    damaged: tuple[str, ...]
    collected: bool


OnEvent = Callable[[Progress], None]


def run(
    study: Study | str | Path,
    *,
    out: str | Path | None = None,
    jobs: int | None = None,
    fresh: bool = False,
    on_event: OnEvent | None = None,
) -> Dataset:
    """Run every case of a study that is not done yet, store each when it is finished, and return them all together.

    Parameters
    ----------
    study : Study or path of a study file
        What to compute.
    out : path, optional
        Folder of the results; ``runs/<name of the study>`` if not given.
    jobs : int, optional
        Number of processes, ≥ 1; all cores if not given. It does not change a value.
    fresh : bool
        Compute every case anew, also those that are done.
    on_event : callable, optional
        Called with a `Progress` when something has moved.

    Returns
    -------
    Dataset
        All cases, as stored in ``study.nc``.

    Raises
    ------
    StudyError, SurfaceError, DatasetError
        If the study, its height file or the folder cannot be used; then nothing has been computed.
    CampaignError
        If cases failed. The others are stored, and the next run computes only what is missing.
    """
    study = study if isinstance(study, Study) else load(study)
    check_surfaces(study)
    folder, cases, text = folder_of(study, out), _cases(study), study.to_yaml()
    if jobs is not None and jobs < 1:
        message = f"jobs is {jobs}; allowed: 1 or more"
        raise CampaignError(message)
    _prepare(folder, text)
    missing = [case for id, case in cases.items() if fresh or _state(folder, case) != "done"]
    if missing:
        (folder / "study.nc").unlink(missing_ok=True)  # it would not belong to the cases beside it
        for case in missing:
            _file(folder, case).unlink(missing_ok=True)
        failures = _compute(missing, text, folder, jobs or cores(), len(cases) - len(missing), on_event)
        if failures:
            raise _campaign_error(failures, len(cases)) from BaseExceptionGroup("failed", list(failures.values()))
    elif on_event is not None:
        on_event(Progress(cases=len(cases), kept=len(cases), work=1.0))
    return _collected(folder, cases, text)


def status(study: Study | str | Path, out: str | Path | None = None) -> Status:
    """Return which cases of a study are done, missing or damaged in a folder."""
    study = study if isinstance(study, Study) else load(study)
    folder, cases = folder_of(study, out), _cases(study)
    found = {id: _state(folder, case) for id, case in cases.items()}
    by_state = {state: tuple(id for id in found if found[id] == state) for state in ("done", "missing", "damaged")}
    return Status(folder, **by_state, collected=(folder / "study.nc").is_file())


def collect(study: Study | str | Path, out: str | Path | None = None) -> Dataset:
    """Return the cases that are done as one dataset, also of a run that is not finished; nothing is written.

    Raises
    ------
    DatasetError
        If no case is done.
    """
    study = study if isinstance(study, Study) else load(study)
    folder, cases = folder_of(study, out), _cases(study)
    done = {id: case for id, case in cases.items() if _state(folder, case) == "done"}
    if not done:
        message = f"no case of {study.name} is finished in {folder}"
        raise DatasetError(message)
    return _combined(folder, done, study.to_yaml())


def check_surfaces(study: Study) -> None:
    """Read the height file of a study once, so that a bad one is known before anything is computed or written.

    Raises
    ------
    SurfaceError
        If its heights are not a surface.
    """
    for case in study.cases():
        if case.file is not None:
            surface_of(case)


def folder_of(study: Study, out: str | Path | None = None) -> Path:
    """Return the folder of the results: the one given, or ``runs/<name of the study>``."""
    return Path("runs") / study.name if out is None else Path(out)


def _cases(study: Study) -> dict[str, Case]:
    return {case.id: case for case in study.cases()}


def _file(folder: Path, case: Case) -> Path:
    return folder / "cases" / f"{case.id}.nc"


def _state(folder: Path, case: Case) -> str:
    path = _file(folder, case)
    if not path.exists():
        return "missing"
    try:
        return "done" if dataset.stored_key(path) == json.loads(json.dumps(case.key)) else "damaged"
    except DatasetError:
        return "damaged"


def cores() -> int:
    """Return the number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _prepare(folder: Path, text: str) -> None:
    """Make the folder, write the study into it, and remove what a killed process left half-written."""
    try:
        (folder / "cases").mkdir(parents=True, exist_ok=True)
        (folder / "study.yaml").write_text(text, encoding="utf-8")
    except OSError as error:
        message = f"cannot write to {folder}: {error}"
        raise DatasetError(message) from error
    dataset.remove_leftovers(folder / "cases")
    dataset.remove_leftovers(folder)


def _compute(
    cases: Sequence[Case], text: str, folder: Path, jobs: int, kept: int, on_event: OnEvent | None
) -> dict[str, BaseException]:
    """Compute cases in worker processes, the longest first, and return the errors of those that failed by id."""
    cost = {case.id: _cost(case) for case in cases}
    steps = {case.id: case.sweep.steps for case in cases}
    reached = dict.fromkeys(cost, 0)
    ended: set[str] = set()
    failures: dict[str, BaseException] = {}

    def tell(event: str = "") -> None:
        if on_event is None:
            return
        share = {id: 1.0 if id in ended else reached[id] / max(steps[id], 1) for id in cost}
        work = sum(cost[id] * share[id] for id in cost) / sum(cost.values())
        progress = Progress(
            cases=kept + len(cases),
            kept=kept,
            done=len(ended) - len(failures),
            failed=len(failures),
            steps=sum(steps.values()),
            steps_done=sum(reached.values()),
            work=work,
            event=event,
        )
        on_event(progress)

    def on_message(message: tuple[str, int]) -> None:
        reached[message[0]] = message[1]
        tell()

    def on_end(task: _Task, error: BaseException | None) -> None:
        case = task[0]
        ended.add(case.id)
        if error is None:
            reached[case.id] = steps[case.id]
            tell(f"{case.label}: done")
        else:
            failures[case.id] = error
            tell(f"{case.label}: FAILED, {_text(error)}")

    tell()
    threads = max(1, jobs // len(cases))  # cores left over work inside the convolutions
    tasks = [(case, text, folder, threads) for case in sorted(cases, key=lambda case: -cost[case.id])]
    try:
        workers.each(_work, tasks, jobs=min(jobs, len(tasks)), on_message=on_message, on_end=on_end)
    finally:
        dataset.remove_leftovers(folder / "cases")
    return failures


_Task = tuple[Case, str, Path, int]
_held: HalfSpaces = {}  # in a worker process: the half space of its last case


def _work(task: _Task, tell: workers.Tell) -> None:
    case, text, folder, threads = task
    result = run_case(case, study=text, half_spaces=_held, on_step=lambda step: tell((case.id, step)), threads=threads)
    dataset.write(result, _file(folder, case))


def _cost(case: Case) -> float:
    """Relative cost: N² log N a convolution, and about as many convolutions a step at every resolution."""
    nodes = 2.0 ** (case.m or 8) + 1.0
    return nodes**2 * math.log(nodes) * max(case.sweep.steps, 1)


def _collected(folder: Path, cases: dict[str, Case], text: str) -> Dataset:
    path = folder / "study.nc"
    with contextlib.suppress(DatasetError):
        stored = dataset.read(path)
        if stored.attrs["study"] == text and stored.attrs.get("case_ids") == dataset.ids_text(cases):
            return stored
    dataset.write(_combined(folder, cases, text), path)
    return dataset.read(path)


def _combined(folder: Path, cases: dict[str, Case], text: str) -> Dataset:
    parts = [dataset.read(_file(folder, case)) for case in cases.values()]
    return dataset.combine(parts, dataset.provenance(text, fft=FFT, ids=cases))


def _campaign_error(failures: dict[str, BaseException], cases: int) -> CampaignError:
    """Name every case that failed, but a dead process only once: it takes all cases that were waiting with it."""
    lost = [id for id, error in failures.items() if isinstance(error, workers.Lost)]
    lines = [f"{id}: {_text(error)}" for id, error in failures.items() if id not in lost]
    if lost:
        shown = ", ".join(lost[:4]) + (" …" if len(lost) > 4 else "")
        lines.append(f"a process died (out of memory?), with it or waiting for it {len(lost)} cases: {shown}")
    others = "" if len(failures) == cases else "; the others are kept"
    return CampaignError("\n".join([f"{len(failures)} of {cases} cases failed{others}", *lines]))


def _text(error: BaseException) -> str:
    return str(error) if isinstance(error, RoughvolError) else f"{type(error).__name__}: {error}"
