"""The surface of a case, generated or read, and the kernel on its lattice, without the solver."""

from __future__ import annotations

import functools
import sys
from contextlib import AbstractContextManager
from dataclasses import replace

from threadpoolctl import ThreadpoolController

from roughvol.contact.kernels import Kernel, kernel_of
from roughvol.errors import Problem, StudyError, SurfaceError
from roughvol.study import Case
from roughvol.surfaces import measured
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.surface import Surface
from roughvol.surfaces.waves import power_law_surface


def surface_of(case: Case) -> Surface:
    """Return the surface of a case, generated or read from its files.

    Parameters
    ----------
    case : Case
        Its D, m, seed and law or spectrum, or its files.

    Returns
    -------
    Surface
        The undeformed surface.
    """
    if case.file is not None:
        with one_thread():  # levelling sums over all nodes
            return measured.surface(case.bodies, case.treatment, case.L, case.length_unit, sides=case.sides)
    assert case.D is not None
    assert case.m is not None
    assert case.seed is not None
    if case.spectrum is not None:
        try:
            with one_thread():
                made = power_law_surface(case.spectrum, 3.0 - case.D, 2**case.m, side=case.L, seed=case.seed)
        except SurfaceError as error:  # not every surface has the skewness
            raise StudyError([Problem(f"{case.label}: {error}", "surface.Ssk")]) from error
    else:
        assert case.midpoint_law is not None
        made = random_midpoint_displacement(
            case.D, case.m, side=case.L, seed=case.seed, law=case.midpoint_law, periodic=case.periodic
        )
    return made if made.sides == case.sides else replace(made, sides=case.sides)


def kernel_on(spacing: float, case: Case) -> Kernel:
    """Return the kernel of a case on a lattice."""
    lengths = {name: length / spacing for name, length in case.kernel.lengths}
    return kernel_of(case.kernel.name, **lengths, **dict(case.kernel.numbers))


@functools.lru_cache(maxsize=1)
def _libraries(modules: int) -> ThreadpoolController:
    """Return the control of the threads of all libraries. The search takes 2 ms, once for a number of modules."""
    return ThreadpoolController()


def one_thread() -> AbstractContextManager[object]:
    """Return a context in which the libraries of linear algebra use one thread."""
    return _libraries(len(sys.modules)).limit(limits=1)
