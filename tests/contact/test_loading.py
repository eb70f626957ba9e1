"""The contact problem: its conditions, an exact oracle, and the laws that every sweep obeys."""

from __future__ import annotations

import dataclasses
import inspect
import json
import math
import pickle
import re
from functools import lru_cache
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from oracles import (
    KERNELS,
    DenseHalfSpace,
    coefficients,
    dense_matrix,
    exact_pressure,
    fractal,
    half_space,
    lattice_pressure,
    mean_plane,
    scaled_overlap,
    solved_case,
    summed_displacement,
)

from roughvol.contact import active_set
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import Trials, solve, sweep
from roughvol.contact.options import SearchTuning, Tuning
from roughvol.errors import ContactError, ConvergenceError
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.surface import Surface

ROOT = Path(__file__).parents[2]
REFERENCE = ROOT.parent / "shared" / "reference"
OWN_REFERENCE = ROOT / "tests" / "reference" / "rough_33x25.npz"
STORED = json.loads((ROOT / "tests" / "regression" / "contact.json").read_text(encoding="utf-8"))

rng = np.random.Generator(np.random.PCG64(20))
axis = np.arange(17.0) - 8.0
PLATEAUS = rng.integers(0, 3, (15, 18)).astype(float)  # drawn first to last: the order is part of the surfaces
WHITE, TALL, SMALLEST = rng.standard_normal((20, 11)), rng.standard_normal((3, 60)), rng.standard_normal((3, 3))
peaks = np.full((17, 17), -1.0)
peaks[[3, 3, 13, 13], [3, 13, 3, 13]] = 0.0
spike = np.zeros((17, 17))
spike[5, 11] = 1.0
HEIGHTS = {
    **{f"D={D} m={m}": random_midpoint_displacement(D, m, seed=m).heights for D in (2.1, 2.5, 2.9) for m in (3, 4)},
    **{f"D=2.3 m={m}": random_midpoint_displacement(2.3, m, seed=m).heights for m in (1, 2)},
    **{f"D={D}": random_midpoint_displacement(D, 4, seed=1).heights for D in (2.001, 2.999)},
    **{"white noise": WHITE, "3 × 60": TALL, "3 × 3": SMALLEST, "plateaus": PLATEAUS, "four peaks": peaks},
    **{"spike": spike, "pit": -spike, "checkerboard": np.indices((16, 17)).sum(axis=0) % 2.0},
    **{"flat": np.full((17, 17), 3.0), "wedge": np.broadcast_to(-np.abs(axis), (12, 17))},
    **{"pyramid": -np.maximum(np.abs(axis), np.abs(axis[:, None]))},
}
GENERIC = [name for name in HEIGHTS if name.startswith("D=") or name in ("white noise", "3 × 60", "3 × 3")]
INDENTATIONS = (0.05, 0.6, 0.61, 2.0, 7.0, 60.0, 400.0)
TIGHT = 1e-10


@lru_cache
def swept(name, kernel):
    surface = Surface(HEIGHTS[name], 1.0)
    return surface, list(sweep(surface, half_space(surface.shape, kernel), INDENTATIONS, rtol=TIGHT))


@lru_cache
def matrix(shape, kernel="love"):
    return dense_matrix(coefficients(shape, kernel))


def residual(contact, surface, kernel="love"):
    """η/σ from the pressure alone, by a convolution that is not the package's."""
    q, b = lattice_pressure(contact), scaled_overlap(surface, contact.indentation)
    w = summed_displacement(q, kernel) - b
    return max(np.abs(w[q > 0]).max(initial=0.0), -w[b > 0].min(initial=0.0))


def numbers(contacts):
    return np.array([(c.contact_area_fraction, c.mean_pressure, c.free_volume) for c in contacts])


def check_conditions(contact, surface, kernel, rtol):
    """All that is true of a record by definition."""
    p, g, mask = contact.pressure(), contact.gap(), contact.contact()
    b = scaled_overlap(surface, contact.indentation)
    assert p.shape == g.shape == mask.shape == surface.shape
    assert p.min() >= 0.0
    assert g.min() >= 0.0
    assert not (p * g).any()
    assert np.array_equal(mask, p > 0.0)
    assert not g[mask].any()
    assert not (mask & (b <= 0.0)).any()  # contact lies within the rigid overlap
    rounding = 1e-14 * (1.0 + abs(contact.indentation))
    assert residual(contact, surface, kernel) == pytest.approx(contact.residual, abs=20 * rounding)
    assert contact.residual <= rtol
    assert contact.converged is True
    assert contact.contact_area_fraction == mask.mean()
    assert contact.mean_pressure == pytest.approx(p.mean(), rel=1e-13)
    assert contact.separation == pytest.approx(-b.mean(), abs=rounding)
    mean_displacement = summed_displacement(lattice_pressure(contact), kernel).mean()
    expected = 0.0 if mask.all() else contact.separation + mean_displacement
    assert contact.free_volume == pytest.approx(expected, abs=10 * rounding)
    assert contact.free_volume == pytest.approx(g.mean(), abs=contact.residual + 10 * rounding)


# ---- the conditions, on anything


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("name", HEIGHTS)
def test_conditions_hold_on_any_surface(name, kernel):
    surface, contacts = swept(name, kernel)
    assert [c.indentation for c in contacts] == list(INDENTATIONS)
    for contact in contacts:
        check_conditions(contact, surface, kernel, TIGHT)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("name", HEIGHTS)
def test_sweep_is_the_exact_solution(name, kernel):
    surface, contacts = swept(name, kernel)
    for contact in contacts:
        b = scaled_overlap(surface, contact.indentation).ravel()
        q = exact_pressure(matrix(surface.shape, kernel), b)
        w = matrix(surface.shape, kernel) @ q - b
        # |K⁻¹| < 4 for both kernels: the freedom within a residual of 1e-10
        np.testing.assert_allclose(lattice_pressure(contact).ravel(), q, rtol=0, atol=1e-9 * (1.0 + 1e-3 * q.max()))
        mask = contact.contact().ravel()
        loaded, open_ = q > 1e-8, w > 1e-8  # ties leave elements that are neither
        assert mask[loaded].all()
        assert not mask[open_].any()
        if name in GENERIC:
            assert (loaded | open_).all()


@settings(max_examples=80, deadline=None, derandomize=True)
@given(
    arrays(np.int8, st.tuples(st.integers(3, 7), st.integers(3, 7)), elements=st.integers(0, 4)),
    st.lists(st.integers(1, 60), min_size=1, max_size=4, unique=True).map(sorted),
    st.sampled_from(KERNELS),
)
def test_surfaces_full_of_ties(heights, tenths, kernel):
    surface = Surface(heights, 1.0)
    for contact in sweep(surface, half_space(surface.shape, kernel), [t / 10.0 for t in tenths], rtol=TIGHT):
        q = exact_pressure(matrix(surface.shape, kernel), scaled_overlap(surface, contact.indentation).ravel())
        np.testing.assert_allclose(lattice_pressure(contact).ravel(), q, rtol=0, atol=1e-9)
        check_conditions(contact, surface, kernel, TIGHT)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("shape", [(65, 65), (40, 90), (129, 129)])
def test_made_up_solution_is_found(shape, kernel):
    # Any q ≥ 0 and g ≥ 0 that exclude each other are the contact of the heights K ∗ q - g.
    generator = np.random.Generator(np.random.PCG64(3))
    mask = generator.random(shape) < 0.4
    mask[10:30, 5:25] = True
    q = np.where(mask, generator.uniform(0.1, 1.0, shape), 0.0)
    g = np.where(mask, 0.0, generator.uniform(0.01, 1.0, shape))
    heights = summed_displacement(q, kernel) - g
    surface = Surface(heights, 1.0)
    contact = solve(surface, half_space(shape, kernel), heights.max() / surface.Sq, rtol=1e-9)
    assert np.array_equal(contact.contact(), mask)
    np.testing.assert_allclose(lattice_pressure(contact) * surface.Sq, q, rtol=0, atol=1e-6)
    np.testing.assert_allclose(contact.gap() * surface.Sq, g, rtol=0, atol=1e-6)
    assert contact.mean_pressure == pytest.approx(math.pi * (shape[0] - 1) * q.mean() / surface.Sq, rel=1e-7)
    assert contact.free_volume == pytest.approx(g.mean() / surface.Sq, abs=1e-9)


def test_before_touch_there_is_no_contact_and_no_work():
    surface, space = fractal(4), HalfSpace((17, 17))
    apart, touching, pressed = sweep(surface, space, [-1.5, 0.0, 0.7], rtol=TIGHT)
    for contact, indentation in ((apart, -1.5), (touching, 0.0)):
        check_conditions(contact, surface, "love", 0.0)
        assert contact.indentation == indentation
        assert contact.free_volume == contact.separation
        assert not contact.contact().any()
        assert contact.iterations == contact.convolutions == contact.convolutions_fp32 == 0
    assert touching.free_volume == pytest.approx(mean_plane(surface), rel=1e-14)
    alone = solve(surface, space, 0.7, rtol=TIGHT)
    np.testing.assert_allclose(pressed.pressure(), alone.pressure(), rtol=0, atol=1e-9)


# ---- invariance


STEPS = (0.1, 0.9, 2.4, 8.0)


@lru_cache
def unscaled():
    return list(sweep(fractal(4), half_space((17, 17)), STEPS, rtol=TIGHT))


@pytest.mark.parametrize("factor", [1e-250, 1e-6, 3.0, 1e250])
def test_lateral_scale_changes_nothing(factor):
    surface = Surface(fractal(4).heights, fractal(4).spacing * factor)
    scaled = list(sweep(surface, half_space((17, 17)), STEPS, rtol=TIGHT))
    assert np.array_equal(numbers(scaled), numbers(unscaled()))
    for a, b in zip(scaled, unscaled(), strict=True):
        assert np.array_equal(a.pressure(), b.pressure())
        assert np.array_equal(a.gap(), b.gap())


@pytest.mark.parametrize("exponent", [-800, -3, 10, 900])
def test_height_scale_by_a_power_of_two_changes_no_bit(exponent):
    surface = Surface(np.ldexp(fractal(4).heights, exponent), 1.0)
    scaled = list(sweep(surface, half_space((17, 17)), STEPS, rtol=TIGHT))
    assert np.array_equal(numbers(scaled), numbers(unscaled()))
    for a, b in zip(scaled, unscaled(), strict=True):
        assert np.array_equal(a.pressure(), b.pressure())


@pytest.mark.parametrize(
    "heights", [fractal(4).heights * 10.0**k for k in (-250, -12, 12, 250)] + [fractal(4).heights + 1e3]
)
def test_height_scale_and_datum_change_nothing(heights):
    scaled = list(sweep(Surface(heights, 1.0), half_space((17, 17)), STEPS, rtol=TIGHT))
    np.testing.assert_allclose(numbers(scaled), numbers(unscaled()), rtol=1e-9)
    for a, b in zip(scaled, unscaled(), strict=True):
        assert np.array_equal(a.contact(), b.contact())
        np.testing.assert_allclose(a.pressure(), b.pressure(), rtol=0, atol=1e-9 * b.pressure().max())


@pytest.mark.parametrize(
    "turn", [np.transpose, np.flipud, np.fliplr, np.rot90], ids=["transposed", "upside down", "mirrored", "rotated"]
)
@pytest.mark.parametrize("name", ["D=2.5 m=4", "white noise"])
def test_turned_surface_has_the_turned_solution(name, turn):
    surface, contacts = swept(name, "love")
    turned = Surface(turn(surface.heights), 1.0)
    for a, b in zip(sweep(turned, half_space(turned.shape), INDENTATIONS, rtol=TIGHT), contacts, strict=True):
        assert np.array_equal(a.contact(), turn(b.contact()))
        expected = turn(lattice_pressure(b))  # p* is in units of the first axis, which turns too
        np.testing.assert_allclose(lattice_pressure(a), expected, rtol=0, atol=1e-9 * (1.0 + 1e-3 * expected.max()))
        np.testing.assert_allclose(a.gap(), turn(b.gap()), rtol=0, atol=3 * TIGHT + 1e-12)


@pytest.mark.parametrize("name", ["pyramid", "four peaks", "flat"])
def test_symmetric_surface_has_a_symmetric_solution(name):
    _, contacts = swept(name, "love")
    for contact in contacts:
        p = contact.pressure()
        for turn in (np.transpose, np.flipud, np.rot90):
            np.testing.assert_allclose(turn(p), p, rtol=0, atol=1e-8 * p.max())
            assert np.array_equal(turn(contact.contact()), contact.contact())


@pytest.mark.parametrize("margin", [((0, 1), (0, 0)), ((0, 0), (7, 4)), ((30, 0), (1, 60))])
def test_a_margin_too_deep_to_touch_changes_only_the_averages(margin):
    surface = fractal(4)
    wide = Surface(np.pad(surface.heights, margin, constant_values=surface.heights.min() - 1e3), 1.0)
    inner = (slice(margin[0][0], margin[0][0] + 17), slice(margin[1][0], margin[1][0] + 17))
    for contact in unscaled():
        padded = solve(wide, half_space(wide.shape), contact.indentation * surface.Sq / wide.Sq, rtol=1e-13)
        q = lattice_pressure(padded) * wide.Sq
        assert np.count_nonzero(q) == np.count_nonzero(q[inner])
        np.testing.assert_allclose(q[inner], lattice_pressure(contact) * surface.Sq, rtol=0, atol=1e-8)


# ---- along a sweep


@pytest.mark.parametrize("D", [2.1, 2.5, 2.9])
def test_contact_grows_and_free_volume_shrinks(D):
    surface = fractal(5, D)
    steps = np.linspace(0.0, 2.0 * mean_plane(surface), 41)[1:]
    contacts = list(sweep(surface, half_space(surface.shape), steps, rtol=TIGHT))
    change = np.diff(numbers(contacts), axis=0)
    assert change[:, 0].min() >= 0.0
    assert change[:, 1].min() > 0.0
    assert change[:, 2].max() < 0.0
    # V* falls by less than Δ rises, since the half space gives way, and lies above the rigid d/σ
    assert (change[:, 2] + np.diff(steps)).min() > 0.0
    assert all(c.free_volume > c.separation for c in contacts)


@pytest.mark.parametrize("D", [2.1, 2.9])
def test_contact_sets_are_nested_pressures_rise_and_gaps_are_convex(D):
    surface = fractal(5, D)
    contacts = list(sweep(surface, half_space(surface.shape), np.linspace(0.2, 6.0, 30), rtol=1e-11))
    for a, b in pairwise(contacts):
        assert not (a.contact() & ~b.contact()).any()
        assert (b.pressure() - a.pressure()).min() >= -1e-8
        # θ = 1: the secant is a lower bound of the next gap: an element open there stays open
    for a, b, c in zip(contacts, contacts[1:], contacts[2:], strict=False):
        w = [k.gap() for k in (a, b, c)]
        assert (w[0] - 2.0 * w[1] + w[2]).min() >= -1e-10
        predicted = b.contact() | (2.0 * w[1] - w[0] < 1e-10)
        assert not (c.contact() & ~predicted).any()
        assert b.mean_pressure - a.mean_pressure < c.mean_pressure - b.mean_pressure  # F(Δ) is convex


def test_lowering_what_does_not_touch_changes_nothing_and_what_does_relieves():
    surface = fractal(4)
    contact = solve(surface, half_space((17, 17)), 2.0, rtol=TIGHT)
    indentation = 2.0 * surface.Sq
    force = lattice_pressure(contact).sum() * surface.Sq
    for mask, unchanged in ((~contact.contact(), True), (contact.contact() & (surface.heights < surface.z_max), False)):
        low = Surface(surface.heights - 0.3 * surface.Sq * mask, 1.0)
        lowered = solve(low, half_space((17, 17)), indentation / low.Sq, rtol=TIGHT)
        if unchanged:
            assert lattice_pressure(lowered).sum() * low.Sq == pytest.approx(force, rel=1e-8)
        else:
            assert lattice_pressure(lowered).sum() * low.Sq < 0.99 * force


def test_work_of_the_load_is_the_elastic_energy():
    # ½ Σ p ū = ∫ F dΔ; F is convex, so the midpoint rule lies below the integral and the trapezoidal rule above it.
    surface = fractal(5)
    steps = np.linspace(0.0, 3.0, 241)
    contacts = list(sweep(surface, half_space(surface.shape), steps[1:], rtol=TIGHT))
    force = np.array([0.0, *(lattice_pressure(c).sum() for c in contacts)])
    energy = np.array(
        [0.0, *(0.5 * np.sum(lattice_pressure(c) * scaled_overlap(surface, c.indentation)) for c in contacts)]
    )
    assert np.diff(force, 2).min() > -1e-9
    double = steps[2] - steps[0]
    above = np.cumsum(0.5 * double * (force[:-2:2] + force[2::2]))
    below = np.cumsum(double * force[1::2])
    assert (below <= energy[2::2] + 1e-9).all()
    assert (energy[2::2] <= above + 1e-9).all()
    assert above[-1] - below[-1] < 1e-3 * energy[-1]


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize(
    "steps", [(0.3, 0.6, 0.9, 1.2, 1.5), (1e-12, 1e-6, 0.3, 0.3 + 1e-9, 2.0, 2.1, 30.0), (5.0, 5.001)]
)
def test_sweep_is_a_solve_at_each_step(steps, kernel):
    surface = fractal(5, 2.5)
    for contact in sweep(surface, half_space(surface.shape, kernel), steps, rtol=1e-11):
        alone = solve(surface, half_space(surface.shape, kernel), contact.indentation, rtol=1e-11)
        assert np.array_equal(contact.contact(), alone.contact())
        np.testing.assert_allclose(lattice_pressure(contact), lattice_pressure(alone), rtol=0, atol=1e-9)
        assert contact.free_volume == pytest.approx(alone.free_volume, abs=2e-11)


def test_sweep_is_lazy_and_does_not_depend_on_what_comes_later():
    surface, space = fractal(5), HalfSpace((33, 33))
    asked = []

    def steps():
        for step in (0.5, 1.0, 1.5):
            asked.append(step)
            yield step

    first, second = islice(sweep(surface, space, steps()), 2)
    assert asked == [0.5, 1.0]
    whole = list(sweep(surface, space, [0.5, 1.0, 4.0]))
    assert np.array_equal(first.pressure(), whole[0].pressure())
    assert np.array_equal(second.pressure(), whole[1].pressure())


def test_equal_sweeps_are_equal_to_the_last_bit():
    surface, steps = fractal(5, 2.7), np.linspace(0.2, 4.0, 12)
    fresh = list(sweep(surface, HalfSpace(surface.shape), steps))
    used = HalfSpace(surface.shape)
    list(sweep(fractal(5, 2.1), used, [0.3, 9.0, 50.0]))
    for a, b in zip(fresh, sweep(surface, used, steps), strict=True):
        assert np.array_equal(a.pressure(), b.pressure())
        assert np.array_equal(a.gap(), b.gap())
        assert (a.free_volume, a.residual, a.convolutions) == (b.free_volume, b.residual, b.convolutions)


def test_two_sweeps_may_share_a_half_space():
    a, b, space = fractal(5, 2.1), fractal(5, 2.9), HalfSpace((33, 33))
    steps = (0.5, 1.5, 4.0)
    together = list(zip(sweep(a, space, steps), sweep(b, space, steps), strict=True))
    for (x, y), alone_a, alone_b in zip(together, sweep(a, space, steps), sweep(b, space, steps), strict=True):
        assert np.array_equal(x.pressure(), alone_a.pressure())
        assert np.array_equal(y.pressure(), alone_b.pressure())


def test_records_own_their_arrays():
    surface = fractal(5)
    kept, contacts = [], []
    for contact in sweep(surface, half_space(surface.shape), (0.5, 1.0, 2.0, 5.0)):
        contacts.append(contact)
        kept.append((contact.pressure(), contact.gap(), contact.contact()))
        for array in (contact.pressure(), contact.gap(), contact.contact()):
            array[:] = 1  # a copy: neither the record nor the next step may notice
    for contact, (p, g, mask) in zip(contacts, kept, strict=True):
        assert np.array_equal(contact.pressure(), p)
        assert np.array_equal(contact.gap(), g)
        assert np.array_equal(contact.contact(), mask)
        check_conditions(contact, surface, "love", 1e-6)
    with pytest.raises(dataclasses.FrozenInstanceError):
        contacts[0].free_volume = 0.0


def test_records_count_the_work_of_their_step():
    surface, space = fractal(6), HalfSpace((65, 65))
    steps = np.linspace(0.0, mean_plane(surface), 21)[1:]
    contacts = list(sweep(surface, space, steps))
    assert sum(c.convolutions for c in contacts) == space.convolutions
    assert sum(c.convolutions_fp32 for c in contacts) == space.convolutions_fp32
    assert min(c.convolutions for c in contacts) >= 1  # every state was verified in double precision
    assert min(c.iterations for c in contacts) >= 1
    cold = [solve(surface, space, step) for step in steps]
    work, cold_work = (sum(c.convolutions + c.convolutions_fp32 for c in some) for some in (contacts, cold))
    assert work < 0.5 * cold_work  # steps profit from the last states


# ---- the residual is a bound


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("D", [2.1, 2.9])
def test_residual_bounds_the_errors_of_pressure_and_volume(D, rtol):
    # A pressure with residual η solves a surface changed by η at most: F(Δ - η) ≤ F ≤ F(Δ + η), |δV*| ≤ η.
    surface = fractal(6, D)
    space = half_space(surface.shape)
    loosest = 0.0
    for contact in sweep(surface, space, np.linspace(0.4, 4.0, 7), rtol=rtol):
        check_conditions(contact, surface, "love", rtol)
        eta = residual(contact, surface)
        below, exact, above = sweep(
            surface, space, [contact.indentation + shift for shift in (-eta - 1e-12, 0.0, eta + 1e-12)], rtol=1e-12
        )
        assert below.mean_pressure * (1 - 1e-10) <= contact.mean_pressure <= above.mean_pressure * (1 + 1e-10)
        assert abs(contact.free_volume - exact.free_volume) <= eta + 1e-11
        loosest = max(loosest, eta)
    assert loosest > 1e-3 * rtol  # else nothing was put to the test


@lru_cache
def compact_and_rough(name):
    x = np.linspace(-1.0, 1.0, 129)
    generator = np.random.Generator(np.random.PCG64(2))
    heights = {
        "sphere": lambda: -(x[:, None] ** 2) - x**2,
        "flat": lambda: np.zeros((129, 129)),
        "ripples": lambda: (
            0.02 * np.cos(17 * x[:80, None]) * np.cos(11 * x[:70]) - (x[:80, None] + 0.3) ** 2 - x[:70] ** 2
        ),
        "plateaus": lambda: generator.integers(0, 4, (15, 52)).astype(float),
        "white noise": lambda: generator.standard_normal((54, 20)),
        "fractal": lambda: fractal(6).heights,
    }
    return Surface(heights[name](), 1.0)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("name", ["sphere", "flat", "ripples", "plateaus", "white noise", "fractal"])
def test_any_accuracy_is_reached_and_less_of_it_never_costs_more(name, kernel):
    surface = compact_and_rough(name)
    space = half_space(surface.shape, kernel)
    steps = (0.4, 0.7, 1.5, 12.0, 70.0)
    work = []
    for rtol in (1e-1, 1e-2, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-10):
        contacts = list(sweep(surface, space, steps, rtol=rtol))
        assert max(c.residual for c in contacts) <= rtol
        work.append(sum(c.convolutions + c.convolutions_fp32 for c in contacts))
    # a few more may be needed where a contact set is harder to settle at one accuracy than at a higher one; without the
    # M-matrix (punch) there is no telling
    if kernel == "love":
        assert (np.maximum.accumulate(work) <= 1.2 * np.array(work) + 5).all()


# ---- other ways to the same answer


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_dense_matrix_can_stand_in_for_the_half_space(kernel):
    surface = fractal(4, 2.5)
    dense = DenseHalfSpace(surface.shape, kernel)
    steps = (0.3, 0.9, 2.0, 6.0, 40.0)
    by_matrix = list(sweep(surface, dense, steps, rtol=TIGHT))
    by_fft = list(sweep(surface, half_space(surface.shape, kernel), steps, rtol=TIGHT))
    for a, b in zip(by_matrix, by_fft, strict=True):
        assert np.array_equal(a.contact(), b.contact())
        np.testing.assert_allclose(a.pressure(), b.pressure(), rtol=0, atol=1e-8 * b.pressure().max())
        assert a.free_volume == pytest.approx(b.free_volume, abs=3 * TIGHT)
    assert sum(c.convolutions for c in by_matrix) == dense.convolutions > 0


@pytest.mark.parametrize("D", [2.1, 2.9])
@pytest.mark.parametrize("m", [2, 3, 4])
def test_algorithm_of_the_paper_finds_the_same(m, D):
    surface = fractal(m, D)
    space, steps = half_space(surface.shape), (0.3, 0.8, 1.9, 4.0, 30.0)
    fast, paper = (list(sweep(surface, space, steps, rtol=TIGHT, method=method)) for method in ("fast", "paper"))
    for a, b in zip(fast, paper, strict=True):
        check_conditions(b, surface, "love", TIGHT)
        assert np.array_equal(a.contact(), b.contact())
        np.testing.assert_allclose(a.pressure(), b.pressure(), rtol=0, atol=1e-8 * a.pressure().max())
        np.testing.assert_allclose(a.gap(), b.gap(), rtol=0, atol=3 * TIGHT)


# ---- extremes


@pytest.mark.parametrize("kernel", KERNELS)
def test_single_contact_is_one_element_on_the_half_space(kernel):
    surface = fractal(5)
    for contact in sweep(surface, half_space(surface.shape, kernel), (1e-200, 1e-9, 1e-3)):
        mask = contact.contact()
        assert mask.sum() == 1
        assert surface.heights[mask] == surface.z_max
        p = math.pi * 32 * contact.indentation / coefficients((1, 1), kernel)[0, 0]
        assert contact.pressure().max() == pytest.approx(p, rel=1e-12)


def test_equal_highest_points_all_touch_at_once():
    _, contacts = swept("four peaks", "love")
    p = contacts[0].pressure()
    assert np.count_nonzero(p) == 4
    assert p[p > 0].max() == pytest.approx(p[p > 0].min(), rel=1e-12)


def test_flat_square_is_a_rigid_punch():
    surface, space = Surface(np.full((33, 33), -7.0), 0.1), half_space((33, 33))
    one, ten = sweep(surface, space, (1.0, 10.0), rtol=TIGHT)
    assert lattice_pressure(one).sum() == pytest.approx(11.980817, abs=1e-6)
    assert ten.mean_pressure == pytest.approx(10.0 * one.mean_pressure, rel=1e-9)
    for contact in (one, ten):
        assert (contact.contact_area_fraction, contact.free_volume) == (1.0, 0.0)
        assert contact.separation == -contact.indentation
        edge = contact.pressure()[0]
        assert edge.min() > 1.5 * contact.pressure()[16, 16]  # singular there


@pytest.mark.parametrize("m", [3, 5, 6])
def test_full_contact_at_200_sigma(m):
    surface = fractal(m)
    space = half_space(surface.shape)
    a, b = sweep(surface, space, (200.0, 210.0), rtol=TIGHT)
    punch = solve(Surface(np.zeros(surface.shape), 1.0), space, 10.0, rtol=TIGHT)
    for contact in (a, b):
        assert (contact.contact_area_fraction, contact.free_volume) == (1.0, 0.0)
        assert not contact.gap().any()
    # beyond full contact the rough surface is as stiff as the flat one
    assert b.mean_pressure - a.mean_pressure == pytest.approx(punch.mean_pressure, rel=1e-9)


# ---- bounds


@pytest.mark.parametrize("D", [2.1, 2.5, 2.9])
@pytest.mark.parametrize("rtol", [1e-2, 1e-4])
def test_bound_of_the_pressure_is_one_and_sharp(rtol, D):
    iterated = Tuning(dense_up_to=8)  # a factorisation would leave no residual
    surface = fractal(4, D)
    steps = mean_plane(surface) * np.arange(1, 11) / 5
    contacts = list(sweep(surface, half_space(surface.shape), steps, rtol=rtol, tuning=iterated))
    for contact in contacts:
        K, b = matrix(surface.shape), scaled_overlap(surface, contact.indentation).ravel()
        lattice = math.pi * 16 / b.size
        exact = lattice * exact_pressure(K, b).sum()
        touched = exact_pressure(K, b + contact.residual) > 0.0
        stiffness = lattice * np.linalg.solve(K[np.ix_(touched, touched)], np.ones(touched.sum())).sum()
        least = stiffness * contact.residual / contact.mean_pressure
        assert abs(contact.mean_pressure - exact) <= contact.mean_pressure_bound * contact.mean_pressure + 1e-11
        assert least <= contact.mean_pressure_bound * (1 + 1e-6) + 1e-11
    # late in the sweep the bound is near the stiffness, not near that of the whole grid
    assert contacts[-1].mean_pressure_bound <= 2.0 * least


@pytest.mark.parametrize("asked", [1e-2, 1e-4])
def test_error_of_the_pressure_asked_for_is_certified(asked):
    surface = fractal(6, 2.5)
    steps = mean_plane(surface) * np.array([0.2, 0.4, 0.6, 0.8, 1.0, 1.5, 3.0])
    exact = list(sweep(surface, half_space(surface.shape), steps, rtol=1e-11))
    for contact, truth in zip(
        sweep(surface, half_space(surface.shape), steps, rtol=1e-1, pressure_error=asked), exact, strict=True
    ):
        assert abs(contact.mean_pressure / truth.mean_pressure - 1.0) <= contact.mean_pressure_bound + 1e-10
        assert contact.mean_pressure_bound <= asked


def test_load_is_never_lost_below_the_tolerance():
    """Random surfaces, tolerances and indentations down to 1e-6 σ, where no load at all would meet the residual."""
    iterated = Tuning(dense_up_to=4)
    rng = np.random.Generator(np.random.PCG64(11))
    for trial in range(60):
        n = int(rng.integers(3, 13))
        x, y = np.indices((n, n))
        heights = [(x + y) % 2, 1.0 * (x > n // 2), x / n, np.zeros((n, n))][trial % 4]
        heights = heights + rng.standard_normal((n, n)) * (trial % 3) * 10 ** rng.uniform(-6, 0)
        surface, K = Surface(heights, 1.0), matrix((n, n))
        asked = None if trial % 2 else float(10 ** rng.uniform(-4, -1))
        at = np.unique(10 ** rng.uniform(-6, 1, 6))
        rtol = float(10 ** rng.uniform(-6, -1))
        for contact in sweep(surface, half_space((n, n)), at, rtol=rtol, pressure_error=asked, tuning=iterated):
            b = scaled_overlap(surface, contact.indentation).ravel()
            exact = math.pi * (n - 1) * exact_pressure(K, b).mean()
            assert contact.mean_pressure > 0.0
            error = abs(contact.mean_pressure - exact)
            assert error <= contact.mean_pressure_bound * contact.mean_pressure + 1e-11 * exact
            assert contact.mean_pressure_bound <= (asked or 1.0)
            assert contact.residual <= 0.01 * contact.indentation


def test_a_state_without_load_after_the_touch_has_no_bound():
    trials = Trials(fractal(3), half_space((9, 9)))
    empty = {"elements": np.empty(0, dtype=np.intp), "pressure": np.empty(0), "touch_at": np.ones(81)}
    assert trials.untouched.mean_pressure_bound == 0.0
    assert trials.known({"indentation": 1e-9, **empty}, 1e-9).mean_pressure_bound == math.inf


# ---- errors


def test_shapes_that_differ_are_refused():
    with pytest.raises(ContactError, match=r"\(9, 9\).*\(9, 10\)"):
        solve(fractal(3), half_space((9, 10)), 1.0)


@pytest.mark.parametrize("rtol", [0.0, -1e-3, 1.5, math.nan])
def test_rtol_out_of_range_is_refused(rtol):
    with pytest.raises(ContactError, match=rf"rtol is {rtol}.*0 < rtol"):
        solve(fractal(3), half_space((9, 9)), 1.0, rtol=rtol)


@pytest.mark.parametrize("steps", [(1.0, 1.0), (1.0, 2.0, 1.5, 1.5), (0.0, 0.0), (-1.0, -1.0)])
def test_an_indentation_twice_is_refused(steps):
    with pytest.raises(ContactError, match=rf"indentation is {steps[-1]}.*not {steps[-2]:g}, that of the state before"):
        list(sweep(fractal(3), half_space((9, 9)), steps))


@pytest.mark.parametrize("indentation", [math.nan, math.inf, -math.inf])
def test_indentation_that_is_no_number_is_refused(indentation):
    with pytest.raises(ContactError, match=rf"indentation is {indentation}.*finite"):
        solve(fractal(3), half_space((9, 9)), indentation)


def test_unknown_method_is_refused_with_the_known_ones():
    with pytest.raises(ContactError, match=r"'slow'.*fast, paper"):
        solve(fractal(3), half_space((9, 9)), 1.0, method="slow")


def test_algorithm_of_the_paper_is_kept_to_small_grids():
    with pytest.raises(ContactError, match=r"65.*\(129, 129\)"):
        solve(fractal(7), half_space((129, 129)), 1.0, method="paper")


def test_records_before_an_error_are_still_delivered():
    contacts = sweep(fractal(3), half_space((9, 9)), [0.5, 1.0, math.nan])
    assert [next(contacts).indentation, next(contacts).indentation] == [0.5, 1.0]
    with pytest.raises(ContactError, match=r"nan.*finite"):
        next(contacts)


def test_unreachable_residual_is_an_error_that_carries_its_numbers():
    surface = fractal(6)
    with pytest.raises(ContactError, match=r"rtol is 1e-18 at the indentation 3; allowed: at least 1e-15"):
        solve(surface, half_space(surface.shape), 3.0, rtol=1e-18)
    with pytest.raises(ConvergenceError) as caught:
        solve(surface, half_space(surface.shape), 30.0, rtol=1.25e-14)
    for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
        assert error.indentation == 30.0
        assert error.iterations >= 1
        assert 1.25e-14 < error.residual < 3e-12  # it came as far as rounding allows
        assert "indentation 30" in str(error)
    # and the half space is as good as before
    check_conditions(solve(surface, half_space(surface.shape), 3.0), surface, "love", 1e-6)


# ---- solved cases


def test_stored_case_is_what_the_oracle_says():
    states = solved_case(STORED["heights"], [state["indentation"] for state in STORED["states"]])
    for state, stored in zip(states, STORED["states"], strict=True):
        assert state == pytest.approx(stored, rel=1e-12)


@pytest.mark.parametrize("method", ["fast", "paper"])
def test_stored_case_is_solved(method):
    surface, states = Surface(STORED["heights"], 1.0), STORED["states"]
    space = half_space(surface.shape)
    contacts = list(sweep(surface, space, [state["indentation"] for state in states], rtol=1e-6, method=method))
    assert len(contacts) == len(states) > 4
    for contact, state in zip(contacts, states, strict=True):
        assert contact.contact().sum() == state["contact_elements"]
        assert contact.mean_pressure == pytest.approx(state["mean_pressure"], rel=1e-6)
        # relative while V* is of the order of σ; near full contact η bounds the absolute error
        assert contact.free_volume == pytest.approx(state["free_volume"], rel=1e-6, abs=contact.residual)


@pytest.mark.parametrize("number", range(3))
def test_reference_state_is_solved(number):
    """States of tests/reference/make_cases.py: dense matrix, Cholesky, right to 1e-12 σ."""
    with np.load(OWN_REFERENCE) as case:
        surface, E_star = Surface(case["z"], float(case["dx"])), float(case["E_star"])
        pressure, gap = case["pressure"][number], case["gap"][number] / surface.Sq
        indentation = float(case["delta"][number]) / surface.Sq
    expected = pressure * surface.side / (E_star * surface.Sq)
    for rtol in (1e-6, 1e-11):
        contact = solve(surface, half_space(surface.shape), indentation, rtol=rtol)
        assert np.array_equal(contact.contact(), expected > 0.0)
        assert contact.mean_pressure == pytest.approx(expected.mean(), rel=rtol)
        assert contact.free_volume == pytest.approx(gap.mean(), rel=rtol)
        np.testing.assert_allclose(contact.pressure(), expected, rtol=0, atol=10 * rtol * expected.max())
        np.testing.assert_allclose(contact.gap(), gap, rtol=0, atol=10 * rtol)


@pytest.mark.skipif(not REFERENCE.is_dir(), reason="solved cases of other codes are not part of the repository")
@pytest.mark.parametrize("name", [f"m{m}_D2.3_seed0_frac{fraction}.npz" for m in (5, 6) for fraction in (0.5, 1.0)])
def test_reference_case_of_another_code_is_solved(name):
    with np.load(REFERENCE / name) as case:
        surface = Surface(case["z"], float(case["dx"]))
        expected = case["pressure"] * float(case["L"]) / surface.Sq
        gap = case["gap"] / surface.Sq
        contact = solve(surface, half_space(surface.shape), float(case["delta"]) / surface.Sq, rtol=1e-6)
    assert np.array_equal(contact.contact(), expected > 0.0)
    assert contact.mean_pressure == pytest.approx(expected.mean(), rel=1e-6)
    assert contact.free_volume == pytest.approx(gap.mean(), rel=1e-6)
    np.testing.assert_allclose(contact.pressure(), expected, rtol=0, atol=1e-5 * expected.max())
    np.testing.assert_allclose(contact.gap(), gap, rtol=0, atol=1e-5)


# ---- at the paper's size


@pytest.mark.slow
@pytest.mark.parametrize(("m", "D"), [(7, 2.1), (7, 2.9), (8, 2.3)])
def test_sixty_steps_at_real_size(m, D):
    surface = fractal(m, D)
    steps = np.linspace(0.0, mean_plane(surface), 61)[1:]
    before = None
    for contact in sweep(surface, half_space(surface.shape), steps, rtol=1e-9):
        check_conditions(contact, surface, "love", 1e-9)
        if before is not None:
            assert not (before.contact() & ~contact.contact()).any()
            assert before.mean_pressure < contact.mean_pressure
            assert before.free_volume > contact.free_volume
        before = contact
    alone = solve(surface, half_space(surface.shape), steps[-1], rtol=1e-9)
    assert np.array_equal(before.contact(), alone.contact())
    assert before.mean_pressure == pytest.approx(alone.mean_pressure, rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("kernel", KERNELS)
def test_white_noise_to_full_contact_at_real_size(kernel):
    generator = np.random.Generator(np.random.PCG64(8))
    surface = Surface(generator.standard_normal((200, 257)), 1.0)
    for contact in sweep(surface, half_space(surface.shape, kernel), (0.5, 2.0, 5.0, 20.0, 100.0, 2000.0), rtol=1e-8):
        check_conditions(contact, surface, kernel, 1e-8)
    assert kernel == "punch" or contact.contact_area_fraction == 1.0


@pytest.mark.parametrize("heights", [fractal(6).heights, np.zeros((33, 33)), np.eye(33)])
def test_a_cold_start_in_stages_ends_in_the_same_state(heights):
    surface = Surface(heights, 1.0)
    at_once = solve(surface, half_space(surface.shape), 2.0, rtol=1e-9)
    in_stages = solve(surface, half_space(surface.shape), 2.0, rtol=1e-9, tuning=Tuning(cold_up_to=200))
    assert np.array_equal(in_stages.contact(), at_once.contact())
    assert in_stages.mean_pressure == pytest.approx(at_once.mean_pressure, rel=1e-8)
    assert in_stages.residual <= 1e-9


@pytest.mark.parametrize("precision", ["mixed", "double"])
@pytest.mark.parametrize("rtol", [1e-6, 1e-10])
def test_cut_pressures_may_be_summed_or_convolved(precision, rtol):
    surface = Surface(fractal(6).heights[:, :40], 1.0)
    ends = np.linspace(0.3, 3.0, 7)
    convolved, summed = (
        list(
            sweep(
                surface,
                half_space(surface.shape),
                ends,
                rtol=rtol,
                precision=precision,
                tuning=Tuning(dense_up_to=8, sum_terms=terms),
            )
        )
        for terms in (0.0, math.inf)
    )
    for one, other in zip(convolved, summed, strict=True):
        assert max(one.residual, other.residual) <= rtol
        assert abs(one.free_volume - other.free_volume) <= 2.0 * rtol
    assert sum(c.convolutions + c.convolutions_fp32 for c in convolved) > sum(
        c.convolutions + c.convolutions_fp32 for c in summed
    )


# ---- every exit without convergence is an error


@pytest.mark.parametrize("limit", [{"iterations": 1}, {"rounds": 1}])
def test_a_solve_given_up_is_an_error_that_carries_its_numbers(limit):
    surface = fractal(6)
    # one round with 32-bit directions leaves more than 1e-13
    tight = Tuning(dense_up_to=8, single_from=0.0, **limit)
    with pytest.raises(ConvergenceError, match="not converged") as caught:
        solve(surface, half_space(surface.shape), 1.0, rtol=1e-13, tuning=tight)
    assert caught.value.indentation == 1.0
    assert caught.value.iterations >= 1
    assert caught.value.residual > 1e-13


def test_a_contact_set_that_does_not_settle_is_an_error(monkeypatch):
    # Wrong solutions of the equations: half of the elements turn tensile, then penetrate, for ever.
    def wrong(factor, b, **_):
        return np.where(np.arange(b.size) % 2, -1.0, 1e-9) if b.size == whole else np.full(b.size, 1e-9)

    surface = fractal(4)
    whole = np.count_nonzero(scaled_overlap(surface, 1.0) > 0.0)
    assert 8 < whole <= Tuning().dense_up_to
    monkeypatch.setattr(active_set.linalg, "cho_solve", wrong)
    with pytest.raises(ConvergenceError, match="did not settle"):
        solve(surface, half_space(surface.shape), 1.0)


def test_gauss_seidel_that_does_not_converge_is_an_error():
    surface = fractal(4)
    with pytest.raises(ConvergenceError, match="Gauss-Seidel not converged"):
        solve(surface, half_space(surface.shape), 1.0, method="paper", tuning=Tuning(gauss_seidel=1))


def test_tolerances_are_not_kept_between_solves():
    surface = fractal(5)
    trials = Trials(surface, half_space(surface.shape), rtol=1e-9)
    rough = trials.at(1.0, trials.untouched, rtol=1e-2)
    exact = trials.at(2.0, trials.untouched)
    assert exact.residual <= 1e-9
    assert rough.residual <= 1e-2


# ---- the constants


@pytest.mark.parametrize(("record", "most"), [(Tuning, 25), (SearchTuning, 12)])
def test_no_more_constants_than_a_reader_can_hold(record, most):
    names = [field.name for field in dataclasses.fields(record)]
    explained = re.findall(r"^(?:    #.*\n    (\w+): .*|    (\w+): .*# \w.*)$", inspect.getsource(record), re.MULTILINE)
    assert len(names) <= most
    assert [above or beside for above, beside in explained] == names
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(record(), names[0], 1)
