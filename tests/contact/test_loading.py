"""The contact problem: its conditions, an exact oracle, and the laws that every sweep obeys."""

import dataclasses
import math
import pickle
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from roughvol.contact import active_set
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import Trials, solve, sweep
from roughvol.contact.options import Tuning
from roughvol.errors import ContactError, ConvergenceError
from roughvol.surfaces.surface import Surface
from tests.contact import kit
from tests.refused import refusals

generator = kit.random(20)
axis = np.arange(11.0) - 5.0
peaks = np.full((13, 13), -1.0)
peaks[[3, 3, 9, 9], [3, 9, 3, 9]] = 0.0
spike = np.zeros((11, 11))
spike[5, 8] = 1.0
HEIGHTS = {
    **{f"D={D} m={m}": kit.fractal(m, D, m).heights for D, m in ((2.1, 4), (2.5, 3), (2.9, 4), (2.3, 1), (2.001, 3))},
    **{"white noise": generator.standard_normal((14, 11)), "3 × 60": generator.standard_normal((3, 60))},
    **{"3 × 3": generator.standard_normal((3, 3)), "plateaus": generator.integers(0, 3, (11, 13)).astype(float)},
    **{"four peaks": peaks, "spike": spike, "pit": -spike, "checkerboard": np.indices((10, 11)).sum(axis=0) % 2.0},
    **{"flat": np.full((13, 13), 3.0), "wedge": np.broadcast_to(-np.abs(axis), (8, 11))},
    **{"pyramid": -np.maximum(np.abs(axis), np.abs(axis[:, None]))},
}
GENERIC = [name for name in HEIGHTS if name.startswith("D=") or name in ("white noise", "3 × 60", "3 × 3")]
SURFACES = {name: Surface(heights, 1.0) for name, heights in HEIGHTS.items()}
INDENTATIONS = (0.05, 0.6, 0.61, 2.0, 7.0, 60.0, 400.0)
STEPS = (0.1, 0.9, 2.4, 8.0)
TIGHT = 1e-10


def total_work(contacts):
    return sum(c.convolutions + c.convolutions_fp32 for c in contacts)


def check_exact(contact, surface, kernel):
    """The state is that of the dense oracle. Return elements that are in contact or open beyond doubt."""
    b = kit.scaled_overlap(surface, contact.approach).ravel()
    matrix = kit.dense(surface.shape, kernel, surface.sides)
    q = kit.exact_pressure(matrix, b)
    w = matrix @ q - b
    # |K⁻¹| < 4 for all kernels: the freedom within a residual of 1e-10
    np.testing.assert_allclose(kit.lattice_pressure(contact).ravel(), q, rtol=0, atol=1e-9 * (1.0 + 1e-3 * q.max()))
    mask, loaded, open_ = contact.contact().ravel(), q > 1e-8, w > 1e-8  # ties leave elements that are neither
    assert mask[loaded].all()
    assert not mask[open_].any()
    return loaded | open_


# ---- the conditions, on anything


ON_SURFACES = [(name, "love", "fast") for name in HEIGHTS] + [
    (name, "punch", "fast") for name in ("plateaus", *GENERIC)
]
ON_SURFACES += [(name, "love", "paper") for name in ("D=2.1 m=4", "D=2.9 m=4", "D=2.3 m=1")]


@pytest.mark.parametrize(("name", "kernel", "method"), ON_SURFACES)
def test_sweep_is_the_exact_solution_on_any_surface(name, kernel, method):
    surface = SURFACES[name]
    contacts = kit.swept(surface, INDENTATIONS, kernel, rtol=TIGHT, method=method)
    assert [c.indentation for c in contacts] == list(INDENTATIONS)
    for contact in contacts:
        kit.check_conditions(contact, surface, kernel, TIGHT)
        decided = check_exact(contact, surface, kernel)
        assert name not in GENERIC or decided.all()


@kit.every_body
@pytest.mark.parametrize("iterated", [False, True])
def test_sweep_is_the_exact_solution_for_any_body(sides, kernel, iterated):
    surface = kit.fractal(4, 2.4, 0, sides)
    options = {"rtol": TIGHT, "tuning": Tuning(dense_up_to=0)} if iterated else {"rtol": TIGHT}
    for contact in kit.swept(surface, (1e-12, 1e-6, 0.8, 0.8 + 1e-9, 2.5, 20.0), kernel, **options):
        check_exact(contact, surface, kernel)


@settings(max_examples=12, derandomize=True)
@given(
    arrays(np.int8, st.tuples(st.integers(3, 6), st.integers(3, 6)), elements=st.integers(0, 4)),
    st.lists(st.integers(1, 60), min_size=1, max_size=4, unique=True).map(sorted),
    st.sampled_from(kit.KERNELS),
)
def test_surfaces_full_of_ties(heights, tenths, kernel):
    surface = Surface(heights, 1.0)
    for contact in sweep(surface, kit.half_space(surface.shape, kernel), [t / 10.0 for t in tenths], rtol=TIGHT):
        check_exact(contact, surface, kernel)
        kit.check_conditions(contact, surface, kernel, TIGHT)


@pytest.mark.parametrize("kernel", kit.KERNELS)
@pytest.mark.parametrize("shape", [(65, 65), (40, 90), pytest.param((129, 129), marks=pytest.mark.slow)])
def test_made_up_solution_is_found(shape, kernel):
    # Any q ≥ 0 and g ≥ 0 that exclude each other are the contact of the heights K ∗ q - g.
    generator = kit.random(3)
    mask = generator.random(shape) < 0.4
    mask[10:30, 5:25] = True
    q = np.where(mask, generator.uniform(0.1, 1.0, shape), 0.0)
    g = np.where(mask, 0.0, generator.uniform(0.01, 1.0, shape))
    heights = kit.summed_displacement(q, kernel) - g
    surface = Surface(heights, 1.0)
    contact = solve(surface, kit.half_space(shape, kernel), heights.max() / surface.Sq, rtol=1e-9)
    assert np.array_equal(contact.contact(), mask)
    np.testing.assert_allclose(kit.lattice_pressure(contact) * surface.Sq, q, rtol=0, atol=1e-6)
    np.testing.assert_allclose(contact.gap() * surface.Sq, g, rtol=0, atol=1e-6)


def test_before_touch_there_is_no_contact_and_no_work():
    surface = kit.fractal(4)
    apart, touching, pressed = kit.swept(surface, (-1.5, 0.0, 0.7), rtol=TIGHT)
    for contact, indentation in ((apart, -1.5), (touching, 0.0)):
        kit.check_conditions(contact, surface, "love", 0.0)
        assert contact.indentation == indentation
        assert contact.free_volume == contact.separation
        assert contact.iterations == contact.convolutions == contact.convolutions_fp32 == 0
    assert touching.free_volume == pytest.approx(kit.mean_plane(surface), rel=1e-14)
    check_exact(pressed, surface, "love")


# ---- invariance


HEIGHT = kit.fractal(4).heights
SCALED = [Surface(HEIGHT, 1e-250), Surface(HEIGHT, 1e250), *(Surface(np.ldexp(HEIGHT, k), 1.0) for k in (-800, 900))]
SCALED += [Surface(heights, 1.0) for heights in (HEIGHT * 1e-250, HEIGHT * 1e250, HEIGHT + 1e3)]


@pytest.mark.parametrize(("surface", "to_the_bit"), [(surface, n < 4) for n, surface in enumerate(SCALED)])
def test_neither_lateral_scale_nor_height_scale_and_datum_change_anything(surface, to_the_bit):
    """A lateral scale and a power of two change no bit."""
    contacts, unscaled = kit.swept(surface, STEPS, rtol=TIGHT), kit.swept(kit.fractal(4), STEPS, rtol=TIGHT)
    near = 0.0 if to_the_bit else 1e-9
    np.testing.assert_allclose(kit.numbers(contacts), kit.numbers(unscaled), rtol=near)
    for a, b in zip(contacts, unscaled, strict=True):
        assert np.array_equal(a.contact(), b.contact())
        np.testing.assert_allclose(a.pressure(), b.pressure(), rtol=0, atol=near * b.pressure().max())
        assert not to_the_bit or np.array_equal(a.gap(), b.gap())


# ---- along a sweep


def test_sweep_is_lazy_and_does_not_depend_on_what_comes_later():
    """Equal sweeps are equal to the last bit, also of two surfaces by turns on a used half space."""
    surface, other, used = kit.fractal(5, 2.7), kit.fractal(5, 2.1), HalfSpace((33, 33))
    steps = iter((0.2, 1.0, 4.0))
    first, second = islice(sweep(surface, HalfSpace((33, 33)), steps), 2)
    assert list(steps) == [4.0]
    list(sweep(other, used, [0.3, 9.0, 50.0]))
    together = zip(sweep(surface, used, (0.2, 1.0, 9.0)), sweep(other, used, (0.2, 1.0, 9.0)), strict=True)
    for a, (b, _) in zip((first, second), together, strict=False):
        assert np.array_equal(a.pressure(), b.pressure())
        assert np.array_equal(a.gap(), b.gap())
        assert (a.free_volume, a.residual) == (b.free_volume, b.residual)


@pytest.mark.parametrize("sides", ["free", "mirrored", "periodic"])
def test_void_is_where_the_gap_is_of_states_solved_and_on_lines(sides):
    surface = kit.fractal(4, sides=sides)
    trials = Trials(surface, kit.half_space(surface.shape, sides=sides))
    light = trials.at(0.5, trials.untouched)
    heavy = trials.at(2.0, light)
    line = trials.line(light, heavy)
    estimates = [line(indentation, margin) for indentation in (0.3, 1.2, 2.5) for margin in (0.0, 0.1)]
    for contact in (trials.untouched, light, heavy, *estimates):
        assert np.array_equal(contact.void(), contact.gap() > 0.0)
        assert 0 < np.count_nonzero(contact.void()) <= surface.heights.size


def test_records_own_their_arrays():
    surface = kit.fractal(5)
    kept, contacts = [], []
    for contact in sweep(surface, kit.half_space(surface.shape), (0.5, 1.0, 5.0)):
        contacts.append(contact)
        kept.append((contact.pressure(), contact.gap(), contact.contact()))
        for array in (contact.pressure(), contact.gap(), contact.contact()):
            array[:] = 1  # a copy: neither the record nor the next step may notice
    for contact, arrays_before in zip(contacts, kept, strict=True):
        for before, now in zip(arrays_before, (contact.pressure(), contact.gap(), contact.contact()), strict=True):
            assert np.array_equal(before, now)
        kit.check_conditions(contact, surface, "love", 1e-6)
    with pytest.raises(dataclasses.FrozenInstanceError):
        contacts[0].free_volume = 0.0


def test_records_count_the_work_of_their_step():
    surface, space = kit.fractal(5), HalfSpace((33, 33))
    steps = np.linspace(0.0, kit.mean_plane(surface), 21)[1:]
    options = {"tuning": Tuning(dense_up_to=0)}
    contacts = list(sweep(surface, space, steps, **options))
    assert sum(c.convolutions for c in contacts) == space.convolutions
    assert sum(c.convolutions_fp32 for c in contacts) == space.convolutions_fp32
    assert min(c.convolutions for c in contacts) >= 1  # every state was verified in double precision
    assert min(c.iterations for c in contacts) >= 1
    cold = [solve(surface, space, step, **options) for step in steps]
    assert total_work(contacts) < 0.6 * total_work(cold)  # steps profit from the last states


LINE = np.linspace(-1.0, 1.0, 41)
COMPACT_OR_ROUGH = {
    "sphere": -(LINE[:, None] ** 2) - LINE**2,
    "plateaus": kit.random(2).integers(0, 4, (15, 52)).astype(float),
    "white noise": kit.random(2).standard_normal((54, 20)),
}


@pytest.mark.parametrize("kernel", kit.KERNELS)
@pytest.mark.parametrize("name", COMPACT_OR_ROUGH)
def test_any_accuracy_is_reached_and_less_of_it_never_costs_more(name, kernel):
    work, surface = [], Surface(COMPACT_OR_ROUGH[name], 1.0)
    for rtol in (1e-1, 1e-3, 1e-6, 1e-10):
        contacts = kit.swept(surface, (0.4, 0.7, 1.5, 12.0, 70.0), kernel, rtol=rtol)
        assert max(c.residual for c in contacts) <= rtol
        work.append(total_work(contacts))
    # a few more may be needed where a contact set is harder to settle at one accuracy than at a higher one; without the
    # M-matrix (punch) there is no telling
    if kernel == "love":
        assert (np.maximum.accumulate(work) <= 1.2 * np.array(work) + 5).all()


# ---- other ways to the same answer


def test_a_dense_matrix_can_stand_in_for_the_half_space():
    surface, steps = kit.fractal(4, 2.5), (0.3, 2.0, 40.0)
    space = kit.DenseHalfSpace(surface.shape)
    by_matrix = list(sweep(surface, space, steps, rtol=TIGHT))
    for contact in by_matrix:
        check_exact(contact, surface, "love")
    assert sum(c.convolutions for c in by_matrix) == space.convolutions > 0


@pytest.mark.parametrize("heights", [kit.fractal(5).heights, np.zeros((17, 17))])
def test_a_cold_start_in_stages_ends_in_the_same_state(heights):
    surface = Surface(heights, 1.0)
    (at_once,) = kit.swept(surface, (2.0,), rtol=1e-9)
    (in_stages,) = kit.swept(surface, (2.0,), rtol=1e-9, tuning=Tuning(cold_up_to=100))
    assert np.array_equal(in_stages.contact(), at_once.contact())
    assert in_stages.mean_pressure == pytest.approx(at_once.mean_pressure, rel=1e-8)
    assert in_stages.residual <= 1e-9


# ---- parts of an endless plane


@pytest.mark.parametrize("kernel", ["punch", "fourier"])
def test_mean_gap_is_the_separation_up_to_full_contact(kernel):
    """V* = d/σ exactly, Δ is that of the mean planes and ends at z_max, and the approach exceeds it by p*."""
    surface = kit.fractal(5, 2.4, sides="periodic")
    contacts = kit.swept(surface, (0.3, 1.0, 3.0, 10.0, 40.0, 1e3), kernel)
    for contact in contacts:
        assert contact.free_volume == contact.separation
        assert contact.gap().mean() == pytest.approx(contact.free_volume, abs=1e-6)
        assert contact.indentation == pytest.approx(surface.peak - contact.separation, abs=1e-12)
        assert contact.approach == pytest.approx(contact.indentation + contact.mean_pressure, abs=1e-6)
    assert (contacts[-1].contact_area_fraction, contacts[-1].free_volume) == (1.0, 0.0)
    assert (np.diff([c.indentation for c in contacts]) >= 0.0).all()


@pytest.mark.parametrize(
    ("kernel", "shape", "hardness"),
    [("love", (17, 17), None), ("love", (14, 23), 4.0), ("punch", (14, 23), None), ("fourier", (17, 17), 4.0)],
)
def test_a_mirrored_surface_is_a_quarter_of_its_period(kernel, shape, hardness):
    """Up and down again: the period of a surface and its mirror images has the same gaps, contacts and pressures."""
    patch = Surface(kit.self_affine(shape), 1.0, sides="mirrored")
    period = Surface(np.pad(patch.heights, [(0, n) for n in shape], mode="symmetric"), 1.0, sides="periodic")
    longer = period.side / patch.side  # p* and the hardness are over L
    approaches = (0.4, 1.5, 3.0, 6.0, 2.0)
    states = kit.swept(patch, approaches, kernel, rtol=1e-12, hardness=hardness)
    whole = kit.swept(period, approaches, kernel, rtol=1e-12, hardness=hardness and longer * hardness)
    for one, two in zip(states, whole, strict=True):
        assert (one.approach, one.contact_area_fraction) == (two.approach, two.contact_area_fraction)
        assert np.array_equal(np.pad(one.contact(), [(0, n) for n in shape], mode="symmetric"), two.contact())
        for name in ("indentation", "separation", "free_volume", "plastic_volume", "plastic_area_fraction"):
            assert getattr(one, name) == pytest.approx(getattr(two, name), abs=1e-11)
        assert longer * one.mean_pressure == pytest.approx(two.mean_pressure, rel=1e-10)
        quarter = two.pressure()[: shape[0], : shape[1]]
        assert longer * one.pressure() == pytest.approx(quarter, abs=1e-10 * quarter.max())
        assert one.gap() == pytest.approx(two.gap()[: shape[0], : shape[1]], abs=1e-11)
    assert hardness is None or states[-1].plastic_volume > 0.0


@pytest.mark.parametrize("shape", [(64, 64), (61, 17)])
def test_seams_take_no_more_iterations_than_the_middle(shape):
    """Sides that are multiples of 8 or not; the surface is rolled so that its peak lies on the corner."""
    heights = kit.self_affine(shape)
    top = np.unravel_index(heights.argmax(), shape)
    iterations = []
    for shift in (-top[0], -top[1]), (shape[0] // 2 - top[0], shape[1] // 2 - top[1]):
        surface = Surface(np.roll(heights, shift, (0, 1)), 1.0, sides="periodic")
        iterations.append(sum(contact.iterations for contact in kit.swept(surface, tuple(0.8 * np.arange(1, 11)))))
    assert iterations[0] <= 1.3 * iterations[1] + 20


# 0.11.1 ended without convergence on all of these: one or two thousand iterations, or a residual that was no number
@pytest.mark.parametrize(("shape", "kernel"), [((17, 17), "love"), ((74, 15), "fourier"), ((133, 133), "love")])
def test_periods_of_any_sides_converge_wherever_they_begin(shape, kernel):
    surface = Surface(kit.self_affine(shape, longest=4.0, hurst=0.3, seed=1), 1.0, sides="periodic")
    rolled = Surface(np.roll(surface.heights, (5, 3), (0, 1)), 1.0, sides="periodic")
    ends = []
    for approach in (5.0, 60.0):
        one, other = (solve(each, kit.half_space(shape, kernel, "periodic"), approach) for each in (surface, rolled))
        assert max(one.residual, other.residual) <= 1e-6
        assert one.free_volume == pytest.approx(other.free_volume, abs=2e-6)
        assert max(one.iterations, other.iterations) < 60
        ends.append(one.contact_area_fraction)
    assert ends[0] < 0.5 < ends[1]


# ---- errors


def flawed(surface=SURFACES["D=2.5 m=3"], space=(9, 9), at=1.0, **options):
    return lambda: solve(surface, kit.half_space(space), at, **options)


test_refused = refusals(
    ContactError,
    *((flawed(rtol=rtol), rf"rtol is {rtol}.*0 < rtol") for rtol in (0.0, -1e-3, 1.5, math.nan)),
    *((flawed(hardness=hardness), "hardness is") for hardness in (0.0, -1.0, math.nan)),
    *((flawed(**{name: "1"}), f"{name} must be a number, got '1'") for name in ("rtol", "pressure_error", "hardness")),
    *((flawed(at=at), f"indentation must be a number, got {at!r}") for at in (None, "1", 1j)),
    (flawed(hardness=1.0, method="paper"), "'paper' has no hardness"),
    (flawed(method="slow"), r"'slow'.*fast, paper"),
    (flawed(precision="half"), r"'half'.*mixed, double"),
    (flawed(pressure_error=0.2), r"pressure_error is 0.2.*<= 0.1"),
    *((flawed(at=at), rf"indentation is {at}.*finite") for at in (math.nan, math.inf, -math.inf)),
    (flawed(np.zeros((9, 9))), r"the surface is of the type ndarray; allowed: a Surface"),
    (flawed(space=(9, 10)), r"\(9, 9\).*\(9, 10\)"),
    (flawed(kit.fractal(3, sides="periodic"), (8, 8)), "the surface is periodic, the half space free"),
    (flawed(kit.fractal(7), (129, 129), method="paper"), r"65.*\(129, 129\)"),
    (flawed(at=3.0, rtol=1e-18), "rtol is 1e-18 at the indentation 3; allowed: at least 1e-15"),
)


@pytest.mark.parametrize("steps", [(1.0, 1.0), (1.0, 2.0, 1.5, 1.5), (0.0, 0.0), (-1.0, -1.0), (0.5, 1.0, math.nan)])
def test_an_indentation_twice_is_refused_after_the_records_before(steps):
    contacts = sweep(kit.fractal(3), kit.half_space((9, 9)), steps)
    assert [next(contacts).indentation for _ in steps[:-1]] == list(steps[:-1])
    with pytest.raises(ContactError, match=rf"indentation is {steps[-1]}.*not {steps[-2]:g}, that of the state before"):
        next(contacts)


TIGHTEST = {"dense_up_to": 8, "single_from": 0.0}  # one round with 32-bit directions leaves more than 1e-13


@pytest.mark.parametrize(
    ("indentation", "rtol", "options", "words", "most"),
    [
        (30.0, 1.25e-14, {}, "not converged", 3e-12),  # it came as far as rounding allows
        (1.0, 1e-13, {"tuning": Tuning(**TIGHTEST, iterations=1)}, "not converged", math.inf),
        (1.0, 1e-13, {"tuning": Tuning(**TIGHTEST, rounds=1)}, "not converged", math.inf),
        (1.0, 1e-6, {"method": "paper", "tuning": Tuning(gauss_seidel=1)}, "Gauss-Seidel not converged", math.inf),
    ],
)
def test_an_unreachable_residual_is_an_error_that_carries_its_numbers(indentation, rtol, options, words, most):
    surface = kit.fractal(5)
    with pytest.raises(ConvergenceError, match=words) as caught:
        solve(surface, kit.half_space(surface.shape), indentation, rtol=rtol, **options)
    for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
        assert error.indentation == indentation
        assert error.iterations >= 1
        assert rtol < error.residual < most
        assert f"indentation {indentation:g}" in str(error)
    # and the half space is as good as before
    kit.check_conditions(solve(surface, kit.half_space(surface.shape), 3.0), surface, "love", 1e-6)


@pytest.mark.parametrize("fault", [0, 1])  # 1: the matrix is not positive definite
def test_a_contact_set_that_goes_in_circles_is_left_to_conjugate_gradients(fault, monkeypatch):
    # Wrong solutions of the equations: half of the elements turn tensile, then penetrate, for ever.
    def wrong(matrix, b, **_):
        circles = b.size == whole and not fault
        return None, np.where(np.arange(b.size) % 2, -1.0, 1e-9) if circles else np.full(b.size, 1e-9), fault

    surface = kit.fractal(4)
    whole = np.count_nonzero(kit.scaled_overlap(surface, 1.0) > 0.0)
    assert 8 < whole <= Tuning().dense_up_to
    expected = solve(surface, kit.half_space(surface.shape), 1.0, rtol=1e-9)
    monkeypatch.setattr(active_set.linalg.lapack, "dposv", wrong)
    found = solve(surface, kit.half_space(surface.shape), 1.0, rtol=1e-9)
    assert found.iterations > expected.iterations
    assert found.mean_pressure == pytest.approx(expected.mean_pressure, rel=1e-8)


# ---- solved cases


def reference_states():
    """Surface, Δ/σ, p* and g/σ of solved states: tests/reference/make_cases.py (Cholesky), and other codes if there."""
    with np.load(Path(__file__).parents[2] / "tests" / "reference" / "rough_33x25.npz") as case:
        surface, E_star = Surface(case["z"], float(case["dx"])), float(case["E_star"])
        for number in range(3):
            pressure = case["pressure"][number] * surface.side / (E_star * surface.Sq)
            yield surface, float(case["delta"][number]) / surface.Sq, pressure, case["gap"][number] / surface.Sq
    for name in (f"m{m}_D2.3_seed0_frac{fraction}.npz" for m in (5, 6) for fraction in (0.5, 1.0)):
        if (kit.REFERENCE / name).exists():
            with np.load(kit.REFERENCE / name) as case:
                surface = Surface(case["z"], float(case["dx"]))
                pressure = case["pressure"] * float(case["L"]) / surface.Sq
                yield surface, float(case["delta"]) / surface.Sq, pressure, case["gap"] / surface.Sq


def test_reference_states_are_solved():
    for surface, indentation, expected, gap in reference_states():
        (contact,) = kit.swept(surface, (indentation,), rtol=1e-6)
        assert np.array_equal(contact.contact(), expected > 0.0)
        assert contact.mean_pressure == pytest.approx(expected.mean(), rel=1e-6)
        assert contact.free_volume == pytest.approx(gap.mean(), rel=1e-6)
        np.testing.assert_allclose(contact.pressure(), expected, rtol=0, atol=1e-5 * expected.max())
        np.testing.assert_allclose(contact.gap(), gap, rtol=0, atol=1e-5)
