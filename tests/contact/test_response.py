"""The linear response of a contact: against dense matrices, and against the change of solved contacts."""

import math

import numpy as np
import pytest

from roughvol.contact.loading import solve
from roughvol.contact.options import TUNING, Tuning
from roughvol.contact.response import Response
from roughvol.errors import ConvergenceError
from roughvol.surfaces.surface import Surface
from tests.contact.kit import dense, every_body, every_side, half_space, random

ITERATIVE = Tuning(dense_up_to=0)


@every_body
@pytest.mark.parametrize(("shape", "tuning"), [((9, 9), TUNING), ((12, 19), ITERATIVE)])
def test_pressures_displace_the_elements_as_asked(sides, kernel, shape, tuning):
    generator = random(2)
    for count in (1, 2, 70):
        elements = np.sort(generator.choice(math.prod(shape), size=count, replace=False))
        matrix, asked = dense(shape, kernel, sides)[np.ix_(elements, elements)], generator.normal(size=count)
        response = Response(half_space(shape, kernel, sides), elements, tuning=tuning)
        exact = np.linalg.solve(matrix, asked)
        np.testing.assert_allclose(response.pressure(asked), exact, atol=1e-6 * np.abs(exact).max())
        stiffness = np.linalg.solve(matrix, np.ones(count)).sum()
        assert response.rates.sum() == pytest.approx(stiffness, rel=1e-7)


@every_side
@pytest.mark.parametrize("hardness", [None, 8.0])
def test_the_response_is_the_change_of_a_solved_contact(sides, hardness):
    """Elements at the hardness keep their pressure: the elements between 0 and the hardness respond alone."""
    space = half_space((24, 20), sides=sides)
    surface = Surface(np.random.default_rng(5).normal(size=(24, 20)), 1.0, sides=sides)
    factor, step = np.pi * surface.intervals[0], 1e-5
    below, here, above = (
        solve(surface, space, 1.6 + change, rtol=1e-12, hardness=hardness).pressure().ravel() / factor
        for change in (-step, 0.0, step)
    )
    limit = np.inf if hardness is None else hardness / factor * (1.0 - 1e-9)
    sets = [(q > 0.0) + (q >= limit).astype(int) for q in (below, here, above)]
    assert all(np.array_equal(sets[1], other) for other in sets)  # else the change is no derivative
    assert (here >= limit).any() == (hardness is not None)
    elements = np.flatnonzero(sets[1] == 1)
    for tuning in (TUNING, ITERATIVE):
        rates = Response(space, elements, tuning=tuning).rates
        change = (above - below)[elements] / (2.0 * step)
        np.testing.assert_allclose(change, rates, atol=1e-5 * rates.max())
    assert np.abs(above - below)[sets[1] != 1].max() == 0.0


def test_small_displacements_have_small_pressures():
    """The inverse of the solver has 32 bits, and no number below 1e-45."""
    asked = random(3).normal(size=81)
    response = Response(half_space((9, 9)), np.arange(81), tuning=ITERATIVE)
    for small in (2.0**-120, 2.0**-1000):
        np.testing.assert_array_equal(response.pressure(small * asked), small * response.pressure(asked))


def test_an_accuracy_that_is_not_reached_is_an_error():
    response = Response(half_space((9, 9)), np.arange(81), tuning=Tuning(dense_up_to=0, iterations=1))
    with pytest.raises(ConvergenceError, match="linear response of 81 elements"):
        response.pressure(np.ones(81))
