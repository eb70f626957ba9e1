"""Contact laws: the rigid wall and the hardness, the laws of loading and unloading, and paths by a dense oracle."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roughvol.contact.law import Wall
from roughvol.contact.loading import sweep
from roughvol.contact.options import Tuning
from roughvol.surfaces.surface import Surface
from tests.contact.kit import REFERENCE, dense, every_body, every_side, fractal, half_space, random, swept

RTOL = 1e-9
UP = tuple(np.linspace(0.0, 2.6, 7)[1:])
DOWN = UP[-2::-1]


@pytest.mark.parametrize("law", [Wall(), Wall(1.5)])
def test_the_projection_is_allowed_nearest_and_repeatable(law):
    q, another = 2.0 * random(0).normal(size=(2, 200))
    allowed, other = law.project(q), law.project(another)
    assert law.outside(allowed).size == 0
    assert np.array_equal(law.project(allowed), allowed)
    assert np.array_equal(np.flatnonzero(allowed != q), law.outside(q))
    assert (np.abs(q - allowed) <= np.abs(q - other)).all()
    # an admitted change of allowed pressures stays allowed at first
    assert law.outside(allowed + 1e-9 * another * law.admits(allowed, another)).size == 0
    assert law.admits(allowed, np.zeros(200)).all()


@every_body
@pytest.mark.parametrize("hardness", [None, 3.0])
def test_a_solution_leaves_no_residual_on_the_free_elements(sides, kernel, hardness):
    surface = fractal(4, sides=sides)
    (contact,) = swept(surface, (2.0,), kernel, rtol=1e-10, hardness=hardness)
    law, q, w = contact._leg.law, np.zeros(surface.heights.size), contact._state.gap()
    q[contact._state.elements] = contact._state.pressure
    assert np.abs(w[law.free(q, w)]).max() <= contact.residual
    assert np.abs(law.residual(q, w)[q > 0.0]).max() <= contact.residual
    assert law.held(q).any() == (hardness is not None)
    assert law.outside(q).size == 0


# ---- paths


def gauss_seidel(matrix, b, limit):
    """The pressures 0 ≤ q ≤ limit of K q - b ⊥ q, one element at a time until none changes."""
    q = np.zeros(b.size)
    for _ in range(20_000):
        before = q.copy()
        for i in range(b.size):
            q[i] = min(max(q[i] + (b[i] - matrix[i] @ q) / matrix[i, i], 0.0), limit)
        if np.abs(q - before).max() < 1e-13:
            return q
    raise AssertionError


def stepwise(surface, indentations, hardness, kernel="love"):
    """p*, A*, V* and the mean plastic displacement of a path; the plastic displacement grows at every step."""
    matrix, factor = dense(surface.shape, kernel), np.pi * (surface.shape[0] - 1)
    h = ((surface.heights - surface.heights.max()) / surface.Sq).ravel()
    plastic = np.zeros(h.size)
    for indentation in indentations:
        b = h + indentation - plastic
        q = gauss_seidel(matrix, b, hardness / factor)
        w = matrix @ q - b
        plastic += np.where(q >= hardness / factor, np.maximum(-w, 0.0), 0.0)
        yield factor * q.mean(), (q > 0.0).mean(), np.maximum(w, 0.0).mean(), plastic.mean()


def check_path(contacts, steps, near=1e-9):
    for contact, (pressure, area, volume, plastic) in zip(contacts, steps, strict=True):
        assert contact.mean_pressure == pytest.approx(pressure, abs=near)
        assert contact.free_volume == pytest.approx(volume, abs=contact.residual + 1e-11)
        assert contact.plastic_volume == pytest.approx(plastic, abs=contact.residual + 1e-11)
        assert abs(contact.contact_area_fraction - area) <= 1.01 / math.prod(contact.shape)  # one on the brink


@settings(max_examples=10, derandomize=True)
@given(
    seed=st.integers(0, 2**32 - 1),
    hardness=st.floats(0.5, 60.0),
    path=st.lists(st.floats(0.2, 4.0), min_size=2, max_size=5, unique=True),
    dense_up_to=st.sampled_from([0, 240]),
    kernel=st.sampled_from(["love", "punch"]),
)
def test_paths_are_those_of_steps_with_dense_matrices(seed, hardness, path, dense_up_to, kernel):
    surface = Surface(random(seed).normal(size=(5, 6)), 1.0)
    tuning = Tuning(dense_up_to=dense_up_to)
    contacts = sweep(surface, half_space((5, 6), kernel), path, rtol=RTOL, hardness=hardness, tuning=tuning)
    check_path(contacts, stepwise(surface, path, hardness, kernel), 1e-6)


UNDONE = (*np.linspace(0.3, 3.0, 6), *np.linspace(2.5, 1.0, 3), *np.linspace(1.5, 3.5, 4))


def undone():
    """A surface on which overlaps fall within a leg with the kernel of the punch, which has no M-matrix."""
    generator = np.random.default_rng(0)
    for _ in range(14):
        heights, hardness = generator.normal(size=(6, 7)), float(np.exp(generator.uniform(np.log(0.5), np.log(60))))
    return Surface(heights, 1.0), hardness


def test_plastic_displacement_stays_without_an_m_matrix():
    surface, hardness = undone()
    contacts = swept(surface, UNDONE, "punch", rtol=RTOL, hardness=hardness)
    for before, after in itertools.pairwise(contacts):
        fallen = before.plastic_displacement() - after.plastic_displacement()
        assert fallen.max() <= before.residual + after.residual + 1e-14
    check_path(contacts, stepwise(surface, UNDONE, hardness, "punch"))


SURFACE = fractal(4, 2.3, 3)


def test_a_hardness_that_no_pressure_reaches_changes_no_bit():
    for soft, hard in zip(swept(SURFACE, UP), swept(SURFACE, UP, hardness=1e9), strict=True):
        assert np.array_equal(soft.pressure(), hard.pressure())
        for name in ("free_volume", "convolutions", "residual"):
            assert getattr(soft, name) == getattr(hard, name)
        assert hard.plastic_volume == hard.plastic_area_fraction == 0.0


def test_without_hardness_the_contact_is_the_bearing_area():
    for contact in swept(SURFACE, UP, hardness=1e-9):
        overlap = contact.indentation + (SURFACE.heights - SURFACE.heights.max()) / SURFACE.Sq
        assert np.array_equal(contact.contact(), overlap > 0.0)
        assert np.array_equal(contact.yielded(), overlap > 0.0)
        assert contact.plastic_volume == pytest.approx(np.maximum(overlap, 0.0).mean())
        assert contact.mean_pressure == pytest.approx(1e-9 * contact.contact_area_fraction)


@every_side
@pytest.mark.parametrize("hardness", [None, 40.0, 2.0])
def test_elastic_contact_retraces_and_yielded_contact_unloads_below_and_returns(sides, hardness):
    turn = len(UP) - 1
    surface = fractal(4, 2.3, 3, sides)
    contacts = swept(surface, (*UP, *DOWN, *UP[1:]), rtol=RTOL, hardness=hardness)
    top = contacts[turn]
    for up, down in zip(contacts[:turn][::-1], contacts[turn + 1 :], strict=False):
        if top.plastic_volume > 0.0:
            assert down.mean_pressure <= up.mean_pressure + 1e-6
        else:
            assert down.mean_pressure == pytest.approx(up.mean_pressure, rel=1e-6)
            assert down.contact_area_fraction == up.contact_area_fraction
        assert down.plastic_volume == pytest.approx(top.plastic_volume, abs=1e-8)
    for name in ("mean_pressure", "free_volume", "plastic_volume"):
        assert getattr(contacts[-1], name) == pytest.approx(getattr(top, name), abs=1e-7)
    assert np.abs(contacts[-1].pressure() - top.pressure()).max() < 1e-5 * (hardness or 1.0)
    for contact in contacts:
        assert contact.pressure().max() <= (hardness or np.inf) + 1e-9
        assert contact.free_volume == pytest.approx(contact.gap().mean(), abs=1e-6)
        if sides != "free":
            assert contact.free_volume == pytest.approx(contact.separation + contact.plastic_volume, abs=1e-12)


@settings(max_examples=8, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), hardness=st.floats(0.5, 30.0))
def test_loading_keeps_contact_and_yield_and_the_free_volume_has_its_bound(seed, hardness):
    surface, space = Surface(random(seed).normal(size=(9, 9)), 1.0), half_space((9, 9))
    path = np.linspace(0.0, 3.0, 5)[1:]
    exact = list(sweep(surface, space, path, rtol=1e-11, hardness=hardness))
    for before, after in itertools.pairwise(exact):
        assert not (before.contact() & ~after.contact()).any()
        assert ((after.plastic_displacement() - before.plastic_displacement()) >= -1e-10).all()
        assert (after.pressure() - before.pressure() >= -1e-7).all()
    for rough, fine in zip(sweep(surface, space, path, rtol=1e-3, hardness=hardness), exact, strict=True):
        assert abs(rough.free_volume - fine.free_volume) <= rough.residual + 1e-10
        assert abs(rough.plastic_volume - fine.plastic_volume) <= rough.residual + 1e-10
        assert abs(rough.mean_pressure - fine.mean_pressure) <= rough.mean_pressure_bound * rough.mean_pressure + 1e-9


@pytest.mark.skipif(not (REFERENCE / "plastic_65.npz").is_file(), reason="solved cases of other codes are not here")
@pytest.mark.parametrize("hardness", [np.inf, pytest.param(0.2, marks=pytest.mark.slow), 0.05])
def test_paths_solved_by_another_code_are_met(hardness):
    with np.load(REFERENCE / "plastic_65.npz") as case:
        surface, rows = Surface(case["z"], float(case["dx"])), case["rows"]
    rows = rows[rows[:, 0] == hardness]
    side, height = surface.side, surface.Sq
    limit = None if np.isinf(hardness) else hardness * side / height
    contacts = swept(surface, tuple(rows[:, 2]), rtol=1e-10, hardness=limit)
    for contact, (*_, pressure, area, plastic, gap, largest) in zip(contacts, rows, strict=True):
        assert contact.mean_pressure * height / side == pytest.approx(pressure, rel=1e-7)
        assert contact.contact_area_fraction == pytest.approx(area, rel=1e-10)
        assert contact.plastic_volume * height == pytest.approx(-plastic, rel=1e-7, abs=1e-11)
        assert contact.free_volume * height == pytest.approx(gap, rel=1e-7)
        assert contact.pressure().max() * height / side == pytest.approx(largest, rel=1e-7)
