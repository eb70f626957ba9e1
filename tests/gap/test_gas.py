"""Flow of a gas: kinetic theory, closed forms from viscous to free molecular flow, and laws of the throughput."""

import itertools
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import integrate

from roughvol.errors import ContactError
from roughvol.gap import gas
from roughvol.gap.constriction import constriction
from roughvol.gap.gas import LAWS, kinetic_flow_rate, kinetic_integral, local_flow, plate_flow
from roughvol.gap.transport import conduction
from tests.gap.kit import any_gap, rough

GAP = rough(0.2, 3)
conduction_of_gas = partial(gas.conduction_of_gas, accuracy=1e-10)


def flow(gap, axis, law, path, outlet):
    return conduction_of_gas(gap, axis, law, path, outlet).coefficient


def by_kinetic_theory(D, cells=200):
    """Q(D) of the linearised BGK equation: u = ∫ (D u(t) - 1/2) T(D |y - t|) dt/√π, walls of diffuse reflection."""
    y = (0.5 - 0.5 * np.cos(np.pi * np.arange(cells + 1) / cells)) - 0.5  # cells are small at the walls
    centre = 0.5 * (y[1:] + y[:-1])
    c, weight = np.polynomial.legendre.leggauss(80)
    s = 6.0 * (c + 1.0)  # c = exp(s - 8): log-spaced speeds
    speed, weight = np.exp(s - 10.0), 6.0 * weight * np.exp(s - 10.0)
    flat = weight * np.exp(-(speed**2))

    def from_wall(x):
        """∫ exp(-c² - D x/c) dc, whose derivative is -D T(D x)."""
        return np.tensordot(np.exp(-D * x[..., None] / speed), flat, axes=1)

    # ∫ over a cell of T(D |y - t|) dt, by the difference of the above at its ends
    low, high = y[:-1][None] - centre[:, None], y[1:][None] - centre[:, None]
    at_low, at_high = from_wall(np.abs(low)), from_wall(np.abs(high))
    top = from_wall(np.zeros(1))[0]
    inside = (low < 0.0) & (high > 0.0)
    kernel = np.where(inside, 2.0 * top - at_low - at_high, np.abs(at_low - at_high)) / D / np.sqrt(np.pi)
    u = np.linalg.solve(np.eye(cells) - D * kernel, -0.5 * kernel.sum(axis=1))
    return float(-2.0 * u @ np.diff(y))


@pytest.mark.parametrize("D", [0.02, 0.3, 3.0])
def test_the_fit_is_the_solution_of_the_kinetic_equation(D):
    assert_allclose(kinetic_flow_rate(D), by_kinetic_theory(D), rtol=0.01)


def test_kinetic_flow_has_its_limits_and_its_minimum():
    D = np.logspace(-6, 6, 2001)
    Q = np.vectorize(kinetic_flow_rate)(D)
    assert_allclose(Q[D > 1e4] / (D[D > 1e4] / 6.0), 1.0, rtol=1e-3)  # plane Poiseuille flow
    slope = np.diff(Q[D < 1e-3]) / np.diff(np.log(D[D < 1e-3]))
    assert_allclose(slope, -1.0 / np.sqrt(np.pi), rtol=1e-9)  # the logarithm of free molecular flow
    assert 0.5 < D[np.argmin(Q)] < 2.0  # the minimum of Knudsen


def test_the_integral_is_that_of_the_rate():
    for D in (1e-3, 0.05, 0.7, 40.0):
        ends = [0.0, *(end for end in (0.01, 0.15, 5.0) if end < D), D]
        found = sum(integrate.quad(kinetic_flow_rate, *one, limit=200)[0] for one in pairwise(ends))
        assert_allclose(kinetic_integral(D), found, rtol=1e-7)


@pytest.mark.parametrize("D", gas.STARTS[1:])
def test_the_mean_between_close_pressures_is_that_of_the_integral_where_the_fit_jumps(D):
    path = 0.25 * np.sqrt(np.pi) / D  # a plate of gap 1 has this D at half the inlet pressure
    law = gas._law("kinetic", path)
    for high, low in ((0.501, 0.4999), (0.5001, 0.499)):
        found = gas._mean(law, 1.0, high, low) * (high - low)
        assert_allclose(found, gas.plate_flow("kinetic", 1.0, high, low, path), rtol=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_plane_gap_from_viscous_to_free_molecular(law):
    for path, outlet in itertools.product((1e-4, 1.0, 1e4), (0.0, 0.5, 0.99)):  # mean free path at the inlet over gap
        found = conduction_of_gas(np.full((9, 3), 0.7), 0, law, 0.7 * path, outlet)
        exact = plate_flow(law, 0.7, 1.0, outlet, 0.7 * path) / plate_flow("viscous", 0.7, 1.0, outlet, 1.0)
        assert_allclose(found.coefficient, exact, rtol=1e-8)
        assert_allclose(found.knudsen, 2.0 * path / (1.0 + outlet), rtol=1e-12)
        if law == "slip":  # by hand: g³ (1 - r²)/2 + 6 λ g² (1 - r)
            assert_allclose(exact, 1.0 + 12.0 * path / (1.0 + outlet), rtol=1e-12)


def test_the_laws_meet_in_slip_flow():
    slip, kinetic = (local_flow(law, 1.0, 1.0, 1e-3) for law in ("slip", "kinetic"))
    assert_allclose((kinetic - 1.0) / (slip - 1.0), 1.0162 * 2.0 / np.sqrt(np.pi), rtol=0.01)


@pytest.mark.parametrize(("law", "path"), [*((law, 0.3) for law in LAWS), ("kinetic", 50.0)])
def test_channels_beside_each_other_add_and_in_a_row_share_the_pressure(law, path):
    beside, row = np.zeros((8, 9)), np.ones((10, 2))
    beside[:, 1:4], beside[:, 5:8], row[4:] = 1.0, 0.3, 0.4
    found = flow(beside, 0, law, path, 0.2) * plate_flow("viscous", beside.mean(), 1.0, 0.2, 1.0)
    assert_allclose(found, 3 / 9 * sum(plate_flow(law, g, 1.0, 0.2, path) for g in (1.0, 0.3)), rtol=1e-8)
    assert flow(beside, 1, law, path, 0.2) == 0.0
    for outlet in (0.0, 0.6):
        found = flow(row, 0, law, path, outlet) * plate_flow("viscous", row.mean(), 1.0, outlet, 1)
        low, high = outlet, 1.0  # the pressure between has equal flows on both sides
        for _ in range(200):
            middle = 0.5 * (low + high)
            first, second = plate_flow(law, 1.0, 1.0, middle, path) / 4, plate_flow(law, 0.4, middle, outlet, path) / 6
            low, high = (middle, high) if first > second else (low, middle)
        assert_allclose(found / 10, first, rtol=1e-8)


def test_viscous_gas_flows_as_a_liquid_in_squared_pressures_and_free_molecular_slip_flow_is_linear():
    for axis, outlet in ((0, 0.0), (1, 0.7)):
        assert_allclose(flow(GAP, axis, "viscous", 1.0, outlet), conduction(GAP, axis).coefficient, rtol=1e-6)
    found = flow(GAP, 0, "slip", 1e6, 0.0) * GAP.mean() ** 3 * 0.5
    assert_allclose(found, 6e6 * conduction(GAP, 0, 2.0).coefficient * GAP.mean() ** 2, rtol=1e-5)


@pytest.mark.parametrize("law", LAWS)
def test_throughput_is_that_of_a_mirrored_gap_and_of_any_unit_of_length(law):
    along = flow(GAP, 0, law, 0.1, 0.3)
    assert_allclose(flow(GAP[:, ::-1], 0, law, 0.1, 0.3), along, rtol=1e-8)
    assert_allclose(flow(GAP.T, 1, law, 0.1, 0.3), along, rtol=1e-8)
    # a nonlinear flow may prefer a direction
    assert_allclose(flow(GAP[::-1], 0, law, 0.1, 0.3), along, rtol=1e-6 if law == "viscous" else 0.05)
    for unit in (1e-100, 1e100):
        assert_allclose(flow(unit * GAP, 0, law, unit * 0.1, 0.3), along, rtol=1e-8)
    # more slips through with a longer path
    assert law == "viscous" or flow(GAP, 0, law, 1e-3, 0.3) < along < flow(GAP, 0, law, 10.0, 0.3)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("path", "outlet", "seed"), [(0.01, 0.0, 1), (10.0, 0.1, 3)])
def test_a_throughput_is_within_its_stated_error(law, path, outlet, seed):
    gap = rough(0.25, seed, D=2.4)
    exact = flow(gap, 0, law, path, outlet)
    for accuracy in (1e-2, 1e-6):
        found = gas.conduction_of_gas(gap, 0, law, path, outlet, accuracy=accuracy)
        assert found.error <= accuracy
        assert abs(found.coefficient / exact - 1.0) <= found.error + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100))
def test_throughputs_of_random_gaps_are_within_their_stated_errors_from_any_pressures(seed):
    (gap, axis, periodic), random = any_gap(seed), np.random.default_rng(seed)
    critical = constriction(gap, axis, periodic=periodic).gap
    of = random.choice(LAWS), 10 ** random.uniform(-2.5, 2.0) * (critical or 1.0), random.choice([0.0, 0.3, 0.9])
    through = partial(gas.conduction_of_gas, axis=axis, law=of[0], path=of[1], outlet=of[2], periodic=periodic)
    exact = through(gap, accuracy=1e-9).coefficient
    beside = through(gap * (1.0 + 0.02 * random.random(gap.shape)), accuracy=1e-3).pressure
    for accuracy, start in itertools.product((1e-2, 1e-4, 1e-6), (None, beside)):
        found = through(gap, accuracy=accuracy, start=start)
        assert found.error <= accuracy
        assert abs(found.coefficient - exact) <= (found.error + 1e-9) * exact


@pytest.mark.parametrize(
    ("law", "path", "outlet"), [("knudsen", 1.0, 0.5), ("slip", -1.0, 0.5), ("slip", 1.0, 1.0), ("kinetic", 1e160, 0.5)]
)
def test_refused(law, path, outlet):
    with pytest.raises(ContactError, match="allowed"):
        conduction_of_gas(np.ones((3, 3)), 0, law, path, outlet)


@pytest.mark.parametrize("name", LAWS)
def test_pressures_follow_the_potentials_of_a_constriction(name):
    law, p = gas._law(name, 0.3), np.full((1, 5), 0.5)
    s, (inlet, outlet) = gas._potentials(law, p), gas._potentials(law, np.array([[1.0, 0.0]]))[0]
    assert (inlet, outlet) == (pytest.approx(plate_flow(name, 1.0, 1.0, 0.0, 0.3), rel=1e-12), 0.0)
    towards = inlet * np.array([[0.0, 1e-9, 0.1, 0.9, 1.0]])
    for _ in range(20):
        gas._follow(law, p, s, towards)
    assert p[0, 0] == pytest.approx(gas.VACUUM, rel=1e-6)  # conductances for s stay finite
    assert_allclose(s[:, 1:], towards[:, 1:], rtol=1e-12)
    assert_allclose(gas._potentials(law, p), s, rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("axis", [0, 1])
def test_a_flow_from_the_pressures_of_another_gap_is_the_same_in_fewer_turns(law, axis):
    gap, before = rough(0.25, 1, D=2.4), rough(0.248, 1, D=2.4)
    through = partial(gas.conduction_of_gas, axis=axis, law=law, path=0.1, outlet=0.0, accuracy=1e-6)
    start, alone = through(before).pressure, through(gap)
    kept, found = start.copy(), through(gap, start=start)
    assert abs(found.coefficient / alone.coefficient - 1.0) <= found.error + alone.error
    assert_allclose(found.pressure[gap > 0], alone.pressure[gap > 0], atol=1e-4)
    assert found.turns < alone.turns or law == "viscous"
    np.testing.assert_array_equal(start, kept)


def test_the_shortest_mean_free_path_has_viscous_flow():
    assert_allclose(flow(GAP, 0, "kinetic", 5e-324, 0.5), flow(GAP, 0, "viscous", 0.0, 0.5), rtol=1e-6)


def test_a_closed_gap_passes_nothing():
    assert flow(np.zeros((3, 3)), 0, "kinetic", 1.0, 0.0) == 0.0
