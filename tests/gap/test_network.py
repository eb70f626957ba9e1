"""The linear problem of a flow: conjugate gradients against the factorisation, and the error that they state."""

from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.sparse.linalg import spsolve

from roughvol.errors import ConvergenceError
from roughvol.gap import multigrid, network
from roughvol.gap.gas import conduction_of_gas
from roughvol.gap.multigrid import Conductances, Multigrid, turned
from roughvol.gap.network import Network, between_reservoirs, faces
from roughvol.gap.transport import cell_conduction, conduction
from tests.gap.kit import any_gap, rough, straits

DIRECT, EVERYTHING, SHIPPED = 200, 10**9, multigrid.DIRECT


PERIOD = rough(0.2, 1, D=2.3, periodic=True)
FLOWS = {
    **{
        f"closed {c}, n = {n}": partial(conduction, rough(c, 1, D=2.3) + (c == 0.0) * 0.01, 0, n)
        for c, n in ((0.0, 3.0), (0.1, 1.0), (0.3, 3.0), (0.38, 3.0))
    },
    "straits": partial(conduction, straits(1e-2), 0),
    "cell": partial(cell_conduction, PERIOD, 0),
    "period": partial(conduction, PERIOD, 1, periodic=True),
    **{law: partial(conduction_of_gas, PERIOD, 0, law, 0.1, 0.0) for law in ("slip", "kinetic")},
}


def check(seed, monkeypatch, accuracies=(1e-2, 1e-4, 1e-8), near=(1e-10, 1e-10), direct=DIRECT, most=200):
    """Check the stated errors of flows by conjugate gradients; return whether something flows.

    Gaps are cut to ``most`` elements. ``near`` is the rounding below and above.
    """
    gap, axis, periodic = any_gap(seed)
    gap = np.ascontiguousarray(gap[:most, :most])
    monkeypatch.setattr(multigrid, "DIRECT", EVERYTHING)
    exact = conduction(gap, axis, periodic=periodic).coefficient
    monkeypatch.setattr(multigrid, "DIRECT", direct)
    for accuracy in accuracies:
        flow = conduction(gap, axis, periodic=periodic, accuracy=accuracy)
        assert flow.error <= accuracy
        assert direct != SHIPPED or (flow.error > 0.0) == (exact > 0.0)  # by gradients, where something flows
        assert flow.pressure is None or not np.any(flow.pressure[gap == 0.0])
        assert -near[0] * exact <= flow.coefficient - exact <= (flow.error + near[1]) * exact, (seed, accuracy)
    return exact > 0.0


@pytest.mark.parametrize("seed", [0, 1, 4, 8, 13, 27, 30, 123, 129, 323])
def test_a_flow_is_too_large_by_no_more_than_its_stated_error(seed, monkeypatch):
    check(seed, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("kind", range(5))
def test_hundred_gaps_of_each_kind_have_flows_within_their_stated_error(kind, monkeypatch):
    """Over 500 random gaps with a flow: fractal, of a spectrum, channels, islands, decades."""
    flowing, seed = 0, kind
    while flowing < 100:
        flowing += check(seed, monkeypatch, (1e-2, 1e-3, 1e-4, 1e-6), (1e-9, 1e-15))
        seed += 5


@pytest.mark.slow
def test_gaps_above_the_factorised_size_have_flows_within_their_stated_error(monkeypatch):
    for seed in range(500):
        check(seed, monkeypatch, near=(1e-9, 1e-9), direct=SHIPPED, most=51 + seed % 20)


@pytest.mark.parametrize("name", FLOWS)
def test_multigrid_finds_the_flow_of_the_factorisation(name, monkeypatch):
    monkeypatch.setattr(multigrid, "DIRECT", 100)
    found = FLOWS[name](accuracy=1e-11)
    monkeypatch.setattr(multigrid, "DIRECT", EVERYTHING)
    exact = FLOWS[name](accuracy=1e-11)
    assert_allclose(getattr(found, "coefficient", found), getattr(exact, "coefficient", exact), rtol=1e-9)
    if hasattr(found, "flux"):
        # flux in wide water costs no dissipation, so it is less exact than the flow: most in the straits
        assert found.conservation_error < 1e-4
        assert_allclose(found.flux, exact.flux, rtol=1e-4, atol=1e-4 * exact.flux.max())


def test_a_flow_without_convergence_is_factorised_or_an_error(monkeypatch):
    exact = conduction(rough(0.3, 1, D=2.3), 0, accuracy=1e-9)
    monkeypatch.setattr(multigrid, "DIRECT", 100)
    monkeypatch.setattr(network, "STEPS", 2)
    found = conduction(rough(0.3, 1, D=2.3), 0, accuracy=1e-9)
    assert found.error == 0.0
    assert found.coefficient == pytest.approx(exact.coefficient, rel=1e-9)
    monkeypatch.setattr(network, "FACTORISED", 1000)
    with pytest.raises(ConvergenceError, match="did not converge"):
        conduction(rough(0.3, 1, D=2.3), 0)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4])
def test_pressures_to_start_from_dissipate_little_more_than_the_flow(seed, monkeypatch):
    monkeypatch.setattr(multigrid, "DIRECT", 100)
    gap, _, periodic = any_gap(seed)
    down, east = faces((gap / gap.max()) ** 3 + 1e-8, periodic)
    of_faces, inflow = between_reservoirs(down, east), np.zeros(gap.shape)
    inflow[0] = down[0]
    matrix = of_faces.matrix()
    flow = inflow.sum() - inflow.ravel() @ spsolve(matrix, inflow.ravel())
    pressure = Network(of_faces).start(inflow).ravel()
    dissipation = inflow.sum() - 2.0 * inflow.ravel() @ pressure + pressure @ (matrix @ pressure)
    assert flow < dissipation < 1.3 * flow
    assert inflow.sum() > 20.0 * flow  # dissipation of the pressure 0


def test_a_flow_without_a_state_before_starts_from_these_pressures(monkeypatch):
    monkeypatch.setattr(multigrid, "DIRECT", 100)
    monkeypatch.setattr(network, "STEPS", 4)  # seven from the pressure 0
    assert conduction(rough(0.2, 1, m=7, D=2.2), 0, accuracy=1e-3).error > 0.0  # without factors


def grid(south, east):
    """Return a grid whose first row is held."""
    own = np.zeros(south.shape)
    own[0] = 1.0
    return Conductances(south, east, own)


@pytest.mark.parametrize("shape", [(2, 9), (1, 7), (7, 1), (5, 6)])
@pytest.mark.parametrize("around", [False, True])
def test_matrix_and_outflow_of_a_grid_are_those_of_its_joints(shape, around):
    random = np.random.default_rng(sum(shape))
    south, east = random.random((2, *shape))
    if not around:
        south[-1], east[:, -1] = 0.0, 0.0
    network = grid(south, east)
    p = random.random(shape)
    out = network.own * p
    for joints, axis in ((south, 0), (east, 1)):
        flux = joints * (p - np.roll(p, -1, axis))
        out += flux - np.roll(flux, 1, axis)
    assert_allclose((network.matrix() @ p.ravel()).reshape(shape), out, atol=1e-14)
    towards = random.random(shape)
    direction = (p - towards) / 0.5
    outflow = np.empty(shape)
    turned(direction, towards, 0.5, *network, outflow)
    assert_allclose(direction, p, atol=1e-14)
    assert_allclose(outflow, out, atol=1e-13)


def test_the_cycle_is_symmetric_and_positive():
    random = np.random.default_rng(0)
    south, east = np.exp(random.uniform(-12.0, 12.0, (2, 20, 30)))
    network = grid(south, east)
    cycle = Multigrid(network, direct=30)
    inverse = np.array([cycle(unit.reshape(20, 30)).flatten() for unit in np.eye(600)])
    assert_allclose(inverse, inverse.T, rtol=1e-6, atol=1e-9 * np.abs(inverse).max())
    assert np.linalg.eigvalsh(0.5 * (inverse + inverse.T)).min() > 0.0
