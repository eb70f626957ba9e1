"""The linear problem of a flow: multigrid against the factorisation, and what is missing without pyamg."""

from __future__ import annotations

import builtins
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.campaign import cost
from roughvol.errors import ContactError, ConvergenceError
from roughvol.gap import network
from roughvol.gap.gas import conduction_of_gas
from roughvol.gap.transport import cell_conduction, conduction
from roughvol.study import loads
from roughvol.surfaces.midpoint import random_midpoint_displacement

TEXT = """
surface: {D: 2.3, m: 11, seeds: 1}
sweep: {steps: 2, to: {indentation: 1.0}}
record: {transport: {transmissivity: every-step}}
"""


def gap_of(closed: float, m: int = 6, *, periodic: bool = False) -> np.ndarray:
    z = random_midpoint_displacement(2.3, m, seed=1, periodic=periodic).heights
    return np.maximum(np.quantile(z, 1.0 - closed) - z, 0.0)


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every flow is a large one."""
    pytest.importorskip("pyamg", reason="pip install 'roughvol[large]'")
    monkeypatch.setattr(network, "DIRECT", 100)


@pytest.mark.parametrize("closed", [0.0, 0.1, 0.3, 0.38])
@pytest.mark.parametrize("exponent", [1.0, 3.0])
def test_multigrid_finds_the_flow_of_the_factorisation(
    closed: float, exponent: float, large: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    gap = gap_of(closed) + (0.01 if closed == 0.0 else 0.0)
    found = conduction(gap, 0, exponent)
    monkeypatch.setattr(network, "DIRECT", 10**9)
    exact = conduction(gap, 0, exponent)
    assert_allclose(found.coefficient, exact.coefficient, rtol=1e-9)
    assert found.conservation_error < 1e-9
    assert_allclose(found.flux, exact.flux, rtol=1e-6, atol=1e-8 * exact.flux.max())


def test_multigrid_finds_the_flow_of_a_period_and_of_a_gas(large: None, monkeypatch: pytest.MonkeyPatch) -> None:
    gap = gap_of(0.2, periodic=True)

    def flows() -> list[float]:
        gas = [conduction_of_gas(gap, 0, law, 0.1, 0.0).coefficient for law in ("slip", "kinetic")]
        return [cell_conduction(gap, 0), conduction(gap, 1, periodic=True).coefficient, *gas]

    found = flows()
    monkeypatch.setattr(network, "DIRECT", 10**9)
    assert_allclose(found, flows(), rtol=1e-9)


def test_narrow_straits_between_wide_lakes_converge_too(large: None, monkeypatch: pytest.MonkeyPatch) -> None:
    gap = np.ones((40, 20))
    gap[[12, 27]] = 0.0
    gap[12, 3] = gap[27, 15] = 1e-2
    found = conduction(gap, 0).coefficient
    monkeypatch.setattr(network, "DIRECT", 10**9)
    assert_allclose(found, conduction(gap, 0).coefficient, rtol=1e-9)


def test_no_convergence_is_an_error(large: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "ITERATIONS", 2)
    with pytest.raises(ConvergenceError, match="did not converge"):
        conduction(gap_of(0.3), 0)


@pytest.fixture
def without_pyamg(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def importing(name: str, *arguments: Any, **more: Any) -> Any:
        if name.partition(".")[0] == "pyamg":
            raise ImportError(name)
        return real(name, *arguments, **more)

    monkeypatch.delitem(sys.modules, "pyamg", raising=False)
    monkeypatch.setattr(builtins, "__import__", importing)


def test_without_pyamg_a_large_flow_is_refused_with_the_extra_to_install(
    without_pyamg: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(network, "DIRECT", 100)
    with pytest.raises(ContactError, match=r"needs pyamg.*pip install 'roughvol\[large\]'"):
        conduction(gap_of(0.1), 0)
    case = loads(TEXT.replace("m: 11", "m: 4")).cases()[0]
    with pytest.raises(ContactError, match=r"roughvol\[large\]"):  # before anything is computed
        cost.check_fits([case], [], tmp_path)
    small = loads(TEXT.replace("m: 11", "m: 4").replace("record: {", "record: {region: interior, ")).cases()[0]
    cost.check_fits([small], [], tmp_path)


def test_predicted_memory_knows_multigrid() -> None:
    direct, large = (loads(TEXT.replace("m: 11", f"m: {m}")).cases()[0] for m in (10, 12))
    per_node = [cost.memory_of(case, (n, n)) / n**2 for case, n in ((direct, 1025), (large, 4097))]
    assert per_node[1] < 0.8 * per_node[0]
    assert cost.memory_of(large, (4097, 4097)) < 24 * 2**30
