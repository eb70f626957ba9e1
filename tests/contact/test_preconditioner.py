"""The approximate inverse: who is expected in contact, and sweeps with any constants or a wrong inverse."""

from functools import lru_cache

import numpy as np
import pytest

from roughvol.contact import preconditioner
from roughvol.contact.kernels import influence_matrix
from roughvol.contact.options import Tuning
from roughvol.contact.preconditioner import approximate_inverse
from tests.contact.kit import contact_set, fractal, random, spectrum_of, swept

# ---- who is expected in contact


N = 49


@lru_cache
def lifted(**constants):
    """Return a contact with elements around it that hardly penetrate, and the inverse for both."""
    space, elements, _, t = contact_set((N, N))
    around = np.unique((elements[:, None] + np.array([-N - 1, -N, -1, 0, 1, N, N + 1])).clip(0, N * N - 1))
    inside = np.isin(around, elements)
    q, w = np.where(inside, 1.0, 0.0), np.where(inside, -0.01, -1e-6)
    rates = np.zeros(around.size), np.ones(around.size)
    rates[0][inside] = t
    inverse, free = approximate_inverse(space, around, q, w, (q > 0) | (w < 0), rates, Tuning(**constants))
    assert free[inside].all()
    assert free[~inside].mean() < 0.1
    return around, inverse, free, influence_matrix(space.influence, around)


def by_units(map_, size):
    """As `of_units`, for a map that depends on the elements with r ≠ 0."""
    return np.array([map_(unit) for unit in np.eye(size)], dtype=float).T


@pytest.mark.parametrize("again_from", [0, 10**9])
def test_elements_that_neighbours_lift_clear_are_left_out_and_right_for_the_others(again_from):
    around, inverse, free, matrix = lifted(lifted_again_from=again_from)
    kept = np.flatnonzero(free)
    found = spectrum_of(by_units(inverse, around.size)[np.ix_(kept, kept)], matrix[np.ix_(kept, kept)])
    assert found[0] > 0.4
    assert found[-1] < 2.0


def test_an_element_left_out_takes_part_with_the_near_field_around_it():
    around, inverse, free, matrix = lifted()
    row, column = np.divmod(around, N)
    for one in np.flatnonzero(~free)[::5]:
        near = free & (np.abs(row - row[one]) <= 2) & (np.abs(column - column[one]) <= 2)
        near[one] = True
        near = np.flatnonzero(near)
        wanted = np.zeros(around.size)
        wanted[near] = np.linalg.solve(matrix[np.ix_(near, near)], (near == one).astype(float))
        found = inverse(1.0 * (np.arange(around.size) == one))
        np.testing.assert_allclose(found, wanted, rtol=0, atol=3e-6 * wanted.max())


def test_elements_left_out_that_are_in_contact_after_all_are_as_well_served_as_the_rest():
    around, inverse, free, matrix = lifted()
    row, column = np.divmod(around, N)
    apart = np.flatnonzero(~free & (row % 8 == 3) & (column % 8 == 4))
    assert apart.size > 4
    together = np.union1d(np.flatnonzero(free), apart)
    # linear only while the same elements take part: the ones with r ≠ 0
    all_of_them = np.isin(np.arange(around.size), together).astype(float)
    some = by_units(lambda r: inverse(all_of_them + r) - inverse(all_of_them), around.size)[np.ix_(together, together)]
    found = spectrum_of(some, matrix[np.ix_(together, together)])
    assert found[0] > 0.65  # alone: 0.58
    assert found[-1] < 1.5


def test_many_that_take_part_again_are_handled_piece_by_piece():
    (_, inverse, free, _), (_, pieces, _, _) = lifted(), lifted(cache=64 * 3)
    r = np.where(free, 0.0, 1.0)
    np.testing.assert_allclose(pieces(r), inverse(r), rtol=0, atol=1e-6)


# ---- the solver with every kind, on grids small enough to compare


KINDS = {
    "factorised blocks": {},
    "blocks of blocks": {"factorised_up_to": 5},
    "smaller blocks": {"block_side": 4},
    "nothing left out": {"lifted_rounds": 0, "lifted_again_from": 0},
    "left out again": {"lifted_again_from": 0},
    "short reach": {"near_reach": 2.0**0.5},
    "cut always": {"cut_every": 1},
    "every step measured": {"last_step": 0.0},
}
CELLS = [(kind, 2.1, "love") for kind in KINDS] + [("blocks of blocks", 2.8, "punch"), ("left out again", 2.8, "love")]


def steps(surface, count):
    return tuple(surface.peak * np.arange(1, count + 1) / count)


@lru_cache
def factorised(D, kernel):
    """Return a surface and its sweep by factorisations alone."""
    surface = fractal(6, D, 5)
    return surface, tuple(swept(surface, steps(surface, 4), kernel, tuning=Tuning(dense_up_to=10**6)))


@pytest.mark.parametrize(("kind", "D", "kernel"), CELLS)
def test_sweep_does_not_depend_on_the_constants(kind, D, kernel):
    surface, exact = factorised(D, kernel)
    iterated = Tuning(dense_up_to=0, **KINDS[kind])
    for one, other in zip(swept(surface, steps(surface, 4), kernel, rtol=1e-9, tuning=iterated), exact, strict=True):
        assert one.residual <= 1e-9
        np.testing.assert_allclose(one.pressure(), other.pressure(), rtol=0, atol=1e-7 * other.pressure().max())
        assert np.array_equal(one.contact(), other.contact())


@pytest.mark.parametrize(("D", "precision"), [(2.5, "mixed"), (2.9, "double")])
def test_rough_states_do_not_stall_the_next(D, precision):
    surface = fractal(6, D, 1)
    contacts = swept(surface, steps(surface, 40), rtol=0.1, precision=precision)
    assert max(c.iterations for c in contacts) < 200  # 2000 is where an iteration is given up


@pytest.mark.slow
def test_iterations_hardly_grow_with_the_grid():
    means = []
    for m in (9, 10):
        contacts = swept(fractal(m, 2.5, 1), steps(fractal(m, 2.5, 1), 60))
        means.append(np.mean([c.iterations for c in contacts[40:]]))
    assert means[0] < 5.5
    assert means[1] < 1.1 * means[0]


@pytest.mark.slow
def test_a_mirrored_patch_takes_no_more_iterations_than_a_free_patch():
    """Twenty equal steps to A* = 0.1 on 513 × 513 elements."""
    means = []
    for sides, approach in (("free", 4.52), ("mirrored", 7.13)):
        contacts = swept(fractal(9, sides=sides), tuple(approach * np.arange(1, 21) / 20))
        assert contacts[-1].contact_area_fraction == pytest.approx(0.1, rel=0.02)
        means.append(np.mean([contact.iterations for contact in contacts]))
    assert means[1] <= means[0]


# ---- a direction that gains nothing costs time, not the answer


WRONG = {
    "negative": lambda z: -z,
    "not a number": lambda z: np.nan * z,
    "overflow": lambda z: np.float32(3e38) * z,
    "noise": lambda z: random(8).standard_normal(z.size).astype(np.float32),
    "zero": np.zeros_like,
    "stalls": lambda z: z * np.logspace(-8, 8, z.size, dtype=np.float32),
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("wrong", "parts"),
    [
        *((wrong, ("by_blocks",)) for wrong in WRONG),
        *((wrong, ("by_blocks", "near_field")) for wrong in ("noise", "zero")),
    ],
)
def test_a_wrong_inverse_costs_iterations_and_not_the_answer(monkeypatch, wrong, parts):
    surface = fractal(5)
    options = {"rtol": 1e-7, "tuning": Tuning(dense_up_to=0, iterations=200)}
    right = swept(surface, steps(surface, 3), **options)
    for part in parts:
        made = getattr(preconditioner, part)

        def spoilt(*args, made=made):
            inverse = made(*args)
            return lambda r: WRONG[wrong](inverse(r))

        monkeypatch.setattr(preconditioner, part, spoilt)
    for one, other in zip(swept.__wrapped__(surface, steps(surface, 3), **options), right, strict=True):
        assert one.residual <= 1e-7
        assert abs(one.free_volume - other.free_volume) <= 2e-7
        assert one.iterations < (1000 if wrong == "stalls" else 60)
