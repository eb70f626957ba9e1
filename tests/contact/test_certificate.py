"""What a residual η bounds: the errors of V* and p*, by theorem with Love's kernel and by measurement with others."""

from __future__ import annotations

import numpy as np
import pytest

from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.kernels import influence_matrix
from roughvol.contact.loading import solve
from roughvol.contact.options import Tuning
from roughvol.surfaces.midpoint import random_midpoint_displacement

SPACES = [(False, "love"), (False, "punch")]
SPACES += [(True, kernel) for kernel in ("love", "punch", "fourier")]
BEYOND = {"love": 1e-12, "fourier": 1e-12, "punch": 0.07}  # of the interval of the load; measured, see solver.md


def random_contacts(generator):
    """Yield the shape and the elements of contacts from scattered to nearly full."""
    for _ in range(40):
        shape = tuple(int(side) for side in generator.integers(6, 22, 2))
        field = generator.standard_normal(shape)
        for _ in range(generator.integers(0, 4)):
            field = field + np.roll(field, 1, 0) + np.roll(field, 1, 1)
        for share in (0.05, 0.2, 0.5, 0.8, 0.95, 1.0):
            yield shape, np.flatnonzero(field.ravel() >= np.quantile(field, 1.0 - share))


@pytest.mark.parametrize(("periodic", "kernel"), SPACES)
def test_changes_of_height_change_volume_and_load_by_no_more_than_their_largest(periodic, kernel):
    """δV* = y·δ and δF = s·δ to first order, for heights of the contact changed by δ, |δ| ≤ η."""
    generator = np.random.Generator(np.random.PCG64(1))
    for shape, elements in random_contacts(generator):
        space = HalfSpace(shape, kernel, periodic=periodic)
        everywhere = influence_matrix(space.influence, np.arange(shape[0] * shape[1]))
        matrix = everywhere[np.ix_(elements, elements)]
        y = np.linalg.solve(matrix, everywhere[elements].mean(axis=1))
        assert np.abs(y).sum() <= 1.0 + 1e-12
        s = np.linalg.solve(matrix, np.ones(elements.size))
        assert np.abs(s).sum() <= (1.0 + BEYOND[kernel]) * s.sum()
        inverse = np.linalg.inv(matrix)
        if space.kernel.m_matrix:
            assert (inverse - np.diag(np.diagonal(inverse))).max() <= 1e-10
            assert s.min() > 0.0


@pytest.mark.parametrize(("periodic", "kernel"), SPACES)
@pytest.mark.parametrize("hardness", [None, 6.0])
def test_errors_are_below_the_residual(periodic, kernel, hardness):
    surface = random_midpoint_displacement(2.5, 5, seed=4, periodic=periodic)
    space = HalfSpace(surface.shape, kernel, periodic=periodic)
    for indentation in (0.5, 1.5, 2.5):
        exact = solve(surface, space, indentation, rtol=1e-13, hardness=hardness)
        for rtol in (1e-1, 1e-2, 1e-4):
            found = solve(surface, space, indentation, rtol=rtol, hardness=hardness, tuning=Tuning(dense_up_to=0))
            assert abs(found.free_volume - exact.free_volume) <= found.residual + 1e-13
            assert abs(found.plastic_volume - exact.plastic_volume) <= found.residual + 1e-13
            error = abs(found.mean_pressure / exact.mean_pressure - 1.0)
            assert error <= (1.0 + BEYOND[kernel]) * found.mean_pressure_bound + 1e-12
