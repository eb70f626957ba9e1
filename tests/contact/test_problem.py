"""What a residual η bounds: the errors of V* and p*, by theorem with Love's kernel and by measurement with others."""

import math

import numpy as np
import pytest

from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import Trials, solve, sweep
from roughvol.contact.options import Tuning
from roughvol.errors import ContactError
from roughvol.surfaces.surface import Surface
from tests.contact import kit

BEYOND = {"love": 1e-12, "fourier": 1e-12, "punch": 0.07}  # of the interval of the load; measured, see solver.md
ITERATED = Tuning(dense_up_to=4)  # a factorisation would leave no residual


@kit.every_body
@pytest.mark.parametrize(("count", "most"), [(8, 14), pytest.param(40, 22, marks=pytest.mark.slow)])
def test_changes_of_height_change_volume_and_load_by_no_more_than_their_largest(sides, kernel, count, most):
    """δV* = y·δ and δF = s·δ to first order, for heights of the contact changed by δ, |δ| ≤ η.

    Contacts are from scattered to nearly full.
    """
    generator = kit.random(1)
    for _ in range(count):
        shape = tuple(int(side) for side in generator.integers(6, most, 2))
        everywhere, field = kit.dense(shape, kernel, sides), generator.standard_normal(shape)
        for _ in range(generator.integers(0, 4)):
            field = field + np.roll(field, 1, 0) + np.roll(field, 1, 1)
        for share in (0.05, 0.5, 0.95, 1.0):
            elements = np.flatnonzero(field.ravel() >= np.quantile(field, 1.0 - share))
            right = np.column_stack((everywhere[elements].mean(axis=1), np.ones(elements.size)))
            y, s = np.linalg.solve(everywhere[np.ix_(elements, elements)], right).T
            assert np.abs(y).sum() <= 1.0 + 1e-12
            assert np.abs(s).sum() <= (1.0 + BEYOND[kernel]) * s.sum()
            assert kernel != "love" or s.min() > 0.0


@kit.every_body
@pytest.mark.parametrize("hardness", [None, 6.0])
def test_errors_are_below_the_residual(sides, kernel, hardness):
    surface = kit.fractal(4, 2.5, 4, sides)
    for indentation in (0.5, 2.5):
        space = kit.half_space(surface.shape, kernel, sides)
        exact = solve(surface, space, indentation, rtol=1e-13, hardness=hardness)
        for rtol in (1e-1, 1e-4):
            found = solve(surface, space, indentation, rtol=rtol, hardness=hardness, tuning=ITERATED)
            assert abs(found.free_volume - exact.free_volume) <= found.residual + 1e-13
            assert abs(found.plastic_volume - exact.plastic_volume) <= found.residual + 1e-13
            error = abs(found.mean_pressure / exact.mean_pressure - 1.0)
            assert error <= (1.0 + BEYOND[kernel]) * found.mean_pressure_bound + 1e-12


@pytest.mark.parametrize(("D", "rtol"), [(2.1, 1e-2), (2.9, 1e-4)])
def test_bound_of_the_pressure_is_one_and_sharp(rtol, D):
    surface, K = kit.fractal(4, D), kit.dense((17, 17))
    steps = tuple(kit.mean_plane(surface) * np.arange(1, 9) / 4)
    for contact in (contacts := kit.swept(surface, steps, rtol=rtol, tuning=ITERATED)):
        b = kit.scaled_overlap(surface, contact.indentation).ravel()
        lattice = math.pi * 16 / b.size
        exact = lattice * kit.exact_pressure(K, b).sum()
        touched = kit.exact_pressure(K, b + contact.residual) > 0.0
        stiffness = lattice * np.linalg.solve(K[np.ix_(touched, touched)], np.ones(touched.sum())).sum()
        least = stiffness * contact.residual / contact.mean_pressure
        assert abs(contact.mean_pressure - exact) <= contact.mean_pressure_bound * contact.mean_pressure + 1e-11
        assert least <= contact.mean_pressure_bound * (1 + 1e-6) + 1e-11
    # late in the sweep the bound is near the stiffness, not near that of the whole grid
    assert contacts[-1].mean_pressure_bound <= 2.0 * least


def test_error_of_a_pressure_that_no_longer_rises_is_certified():
    """Two steps with one pressure: the whole contact has yielded, and no further element touches."""
    surface, hardness = Surface(np.pad([[3.0]], 2), 1.0), 1e-3
    for contact in kit.swept(surface, (0.1, 0.2, 0.3, 0.4), hardness=hardness, pressure_error=1e-2):
        assert contact.mean_pressure == pytest.approx(hardness / surface.heights.size)
        assert contact.mean_pressure_bound <= 1e-2


def test_an_error_of_the_pressure_left_by_the_leg_before_is_named():
    surface, space = Surface(kit.random(1).standard_normal((9, 9)), 1.0), kit.half_space((9, 9))
    asked = {"hardness": 5.0, "pressure_error": 1e-3, "tuning": ITERATED}
    top = next(sweep(surface, space, [2.0], rtol=1e-2, **asked))
    touch = Trials(surface, space, rtol=1e-2, hardness=5.0, after=top.state(), turned=True).problem.touch
    with pytest.raises(ContactError, match=r"the legs before .* allowed: 0\.001\. A smaller rtol lowers it"):
        kit.swept(surface, (2.0, touch + 1e-4), rtol=1e-2, **asked)
    assert kit.swept(surface, (2.0, touch + 1e-4), rtol=1e-9, **asked)[-1].mean_pressure_bound <= 1e-3


def test_load_is_never_lost_below_the_tolerance():
    """Random surfaces, tolerances and indentations down to 1e-6 σ, where no load at all would meet the residual."""
    rng = kit.random(11)
    for trial in range(24):
        n = int(rng.integers(3, 11))
        x, y = np.indices((n, n))
        heights = [(x + y) % 2, 1.0 * (x > n // 2), x / n, np.zeros((n, n))][trial % 4]
        surface = Surface(heights + rng.standard_normal((n, n)) * (trial % 3) * 10 ** rng.uniform(-6, 0), 1.0)
        asked = None if trial % 2 else float(10 ** rng.uniform(-4, -1))
        at, rtol = np.unique(10 ** rng.uniform(-6, 1, 4)), float(10 ** rng.uniform(-6, -1))
        for contact in sweep(surface, kit.half_space((n, n)), at, rtol=rtol, pressure_error=asked, tuning=ITERATED):
            b = kit.scaled_overlap(surface, contact.indentation).ravel()
            exact = math.pi * (n - 1) * kit.exact_pressure(kit.dense((n, n)), b).mean()
            assert contact.mean_pressure > 0.0
            error = abs(contact.mean_pressure - exact)
            assert error <= contact.mean_pressure_bound * contact.mean_pressure + 1e-11 * exact
            assert contact.mean_pressure_bound <= (asked or 1.0)
            assert contact.residual <= 0.01 * contact.indentation


def test_a_state_without_load_after_the_touch_has_no_bound():
    trials = Trials(kit.fractal(3), HalfSpace((9, 9)))
    empty = {"elements": np.empty(0, dtype=np.intp), "pressure": np.empty(0), "touch_at": np.ones(81)}
    assert trials.untouched.mean_pressure_bound == 0.0
    assert trials.known({"indentation": 1e-9, **empty}, 1e-9).mean_pressure_bound == math.inf
