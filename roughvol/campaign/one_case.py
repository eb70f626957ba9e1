"""One case: the paper's Sections 2 and 3 as one function, and the finished steps of a long one kept on the way."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, MutableMapping
from dataclasses import dataclass, field
from pathlib import Path

from roughvol.campaign import path
from roughvol.campaign.case_surface import kernel_on, one_thread, surface_of
from roughvol.contact import convolution
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.kernels import Kernel
from roughvol.contact.loading import Compliance, sweep
from roughvol.observables import reduction
from roughvol.observables.levels import options_of
from roughvol.observables.reduction import Reduction
from roughvol.observables.regions import Values
from roughvol.spellings import arguments
from roughvol.store import checkpoint as checkpoints
from roughvol.store import dataset, provenance, small_file
from roughvol.store.checkpoint import Checkpoint
from roughvol.store.dataset import Arrays, Dataset
from roughvol.study import Case
from roughvol.surfaces.surface import Surface
from roughvol.typing import Sides

HalfSpaces = MutableMapping[tuple[tuple[int, int], Sides, Kernel, int], HalfSpace]

FFT = {"library": f"FFTW {convolution.FFTW_VERSION}", "planner": convolution.PLANNER}


class Stopped(Exception):
    """A case that was asked to end, and has kept its finished steps."""


def _ignore(step: int) -> None:
    """Do nothing at a step."""


def _never() -> bool:
    return False


@dataclass(frozen=True)
class Context:
    """How a case is computed; it changes no value.

    Attributes
    ----------
    half_spaces : mutable mapping
        Holds the half space of the last shape and kernel, for the next case to use.
    threads : int
        Threads inside a convolution.
    checkpoint : path, optional
        Where a large case keeps its finished steps meanwhile, and finds those of a run that was killed.
    on_step : callable
        Called with the number of each step solved.
    stopping : callable
        Asked after each step of a case with a checkpoint; once it is true the case ends there.
    study : str
        Resolved study as text, for the provenance.
    surface : Surface, optional
        Surface of the case, if it has been read already.

    See Also
    --------
    roughvol.campaign.run_case : Computes a case with it.

    Examples
    --------
    >>> from roughvol.campaign import Context, run_case
    >>> from roughvol.study import loads
    >>> solved, study = [], loads("{surface: {D: 2.2, m: 3, seeds: 1}, sweep: {steps: 3}}")
    >>> _ = run_case(study.cases()[0], Context(on_step=solved.append))
    >>> len(solved)
    3
    """

    half_spaces: HalfSpaces = field(default_factory=dict)
    threads: int = 1
    checkpoint: Path | None = None
    on_step: Callable[[int], None] = _ignore
    stopping: Callable[[], bool] = _never
    study: str = ""
    surface: Surface | None = None

    def provenance(self, case: Case) -> dict[str, str]:
        """Return the provenance of the file of a case."""
        return provenance.provenance(self.study, fft=FFT | {"threads": str(self.threads)}, cases=[case])


@arguments
def run_case(case: Case, context: Context | None = None) -> Dataset:
    """Return all that is asked about one surface: made (Section 2), pressed step by step (Section 3), reduced.

    Parameters
    ----------
    case : Case
        Surface, sweep, solver, and what to record.
    context : Context, optional
        Half spaces, threads, checkpoint, study, surface.

    Returns
    -------
    Dataset
        One case, with dimensions of length 1.

    Raises
    ------
    Stopped
        If it ended because it was asked to, its steps kept.
    SurfaceError, ContactError, ConvergenceError
        If there is no surface, no problem or no solution; nothing is returned of a sweep that broke off.

    See Also
    --------
    roughvol.run : Computes and stores all cases of a study.

    Examples
    --------
    >>> from roughvol.campaign import run_case
    >>> from roughvol.study import loads
    >>> study = loads("{surface: {D: [2.2, 2.5], m: 3, seeds: 2}, sweep: {steps: 3}}")
    >>> run_case(study.cases()[0])["free_volume"].sizes["step"]
    3
    """
    context = context or Context()
    return dataset.build(case, _recorded(case, context), context.provenance(case))


def file_of_case(case: Case, context: Context) -> bytes:
    """Return the content of the file of a case, as `run_case`; quicker than `dataset.to_bytes` if it is small."""
    return dataset.case_bytes(case, _recorded(case, context), context.provenance(case))


def arrays_of_case(case: Case, context: Context | None = None) -> Arrays:
    """Return what is stored of a case, as `run_case`, without a file: dimensions and values by name."""
    return small_file.arrays_of_case(case, _recorded(case, context or Context()))


def _recorded(case: Case, context: Context) -> Values:
    """Return all that is asked about one surface by stored name."""
    started, file = time.perf_counter(), context.checkpoint
    with one_thread():  # a sum split over threads would round differently from machine to machine
        surface = context.surface or surface_of(case)
        values = undeformed(case, surface)
        if case.sweep.steps > 0:
            half_space = half_space_of(surface, kernel_on(surface.spacing, case), context.threads, context.half_spaces)
            large = math.prod(surface.shape) >= checkpoints.NODES
            kept = Checkpoint(file, case, checkpoints.numerics()) if file is not None and large else None
            values |= _swept(case, surface, half_space, kept, context)
    values["wall_time"] = time.perf_counter() - started
    return values


def undeformed(case: Case, surface: Surface) -> Values:
    """Return the numbers of the undeformed surface and of its treatment by stored name."""
    values = reduction.of_surface(case, surface)
    if case.treatment.filling is not None:
        values["filled_fraction"] = surface.filled / surface.heights.size
    if case.treatment.outliers is not None:
        values |= {"outliers_removed": surface.outliers, "peak_height": surface.peak}
        values["peak_height_before"] = surface.peak_before
    return values


def _swept(
    case: Case, surface: Surface, half_space: Compliance, checkpoint: Checkpoint | None, context: Context
) -> Values:
    """Return the values recorded of the sweep; steps in the checkpoint are not solved again."""
    reduced, way = Reduction(case, surface, half_space), path.Path(case, surface, half_space)
    state = checkpoint.load() if checkpoint else None
    if state is not None:
        reduced.restore(state["reduction"], state["states"])
        way.end, way.plan = state["end"], list(state["plan"])
    left = (way.after(reduced) for _ in range(reduced.steps, case.sweep.steps))  # each after the state before
    for contact in sweep(surface, half_space, left, options_of(case, surface), resume=reduced.states):
        reduced.follow(contact)
        context.on_step(reduced.steps)
        if checkpoint is not None:
            stopped = context.stopping()
            if stopped or checkpoint.due():
                whole = {"states": reduced.states, "reduction": reduced.state(), "end": way.end, "plan": way.plan}
                checkpoint.save(whole)
            if stopped:
                raise Stopped
    return reduced.values()


def half_space_of(surface: Surface, kernel: Kernel, threads: int, held: HalfSpaces) -> HalfSpace:
    """Return the half space of a surface: the one held if it fits, else a new one, which is held from then on."""
    key = (surface.shape, surface.sides, kernel, threads)
    if key not in held:
        held.clear()  # one at a time: it is the largest thing in memory
        held[key] = HalfSpace(surface.shape, kernel, threads, sides=surface.sides)
    return held[key]
