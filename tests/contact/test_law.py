"""Contact laws: the projection, the free set, and the residual of a solution."""

from __future__ import annotations

import numpy as np
import pytest
from oracles import fractal, half_space

from roughvol.contact.law import HardWall, RigidWall
from roughvol.contact.loading import solve

LAWS = [RigidWall(), HardWall(1.5)]


@pytest.mark.parametrize("law", LAWS)
def test_the_projection_is_allowed_nearest_and_repeatable(law):
    q = np.random.default_rng(0).normal(size=200) * 2.0
    allowed = law.project(q)
    assert law.outside(allowed).size == 0
    assert np.array_equal(law.project(allowed), allowed)
    assert np.array_equal(np.flatnonzero(allowed != q), law.outside(q))
    other = law.project(np.random.default_rng(1).normal(size=200) * 2.0)
    assert (np.abs(q - allowed) <= np.abs(q - other)).all()


@pytest.mark.parametrize("law", LAWS)
def test_an_admitted_change_of_allowed_pressures_stays_allowed_at_first(law):
    q = law.project(np.random.default_rng(2).normal(size=200) * 2.0)
    change = np.random.default_rng(3).normal(size=200)
    step = 1e-9 * change * law.admits(q, change)
    assert law.outside(q + step).size == 0
    assert law.admits(q, np.zeros(200)).all()


@pytest.mark.parametrize("hardness", [None, 3.0])
def test_a_solution_leaves_no_residual_on_the_free_elements(hardness):
    surface = fractal(5)
    contact = solve(surface, half_space(surface.shape), 2.0, rtol=1e-10, hardness=hardness)
    law, q, w = contact._leg.law, np.zeros(surface.heights.size), contact._state.gap()
    q[contact._state.elements] = contact._state.pressure
    assert np.abs(w[law.free(q, w)]).max() <= contact.residual
    loaded = q > 0.0
    assert np.abs(law.residual(q, w)[loaded]).max() <= contact.residual
    assert law.held(q).any() == (hardness is not None)
    assert law.outside(q).size == 0
