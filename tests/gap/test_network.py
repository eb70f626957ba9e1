"""The linear problem of a flow: multigrid against the factorisation, and what is missing without pyamg."""

from __future__ import annotations

import builtins
import sys
from functools import partial
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
from tests.gap.kit import rough

TEXT = """
surface: {D: 2.3, m: 11, seeds: 1}
sweep: {steps: 2, to: {indentation: 1.0}}
record: {transport: {transmissivity: every-step}}
"""


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every flow is a large one."""
    pytest.importorskip("pyamg", reason="pip install 'roughvol[large]'")
    monkeypatch.setattr(network, "DIRECT", 100)


def straits() -> np.ndarray:
    """Narrow straits between wide lakes."""
    gap = np.ones((40, 20))
    gap[[12, 27]] = 0.0
    gap[12, 3] = gap[27, 15] = 1e-2
    return gap


PERIOD = rough(0.2, 1, D=2.3, periodic=True)
FLOWS = {
    **{
        f"closed {c}, n = {n}": partial(conduction, rough(c, 1, D=2.3) + (c == 0.0) * 0.01, 0, n)
        for c, n in ((0.0, 3.0), (0.1, 1.0), (0.3, 3.0), (0.38, 3.0))
    },
    "straits": partial(conduction, straits(), 0),
    "cell": partial(cell_conduction, PERIOD, 0),
    "period": partial(conduction, PERIOD, 1, periodic=True),
    **{law: partial(conduction_of_gas, PERIOD, 0, law, 0.1, 0.0) for law in ("slip", "kinetic")},
}


@pytest.mark.parametrize("name", FLOWS)
def test_multigrid_finds_the_flow_of_the_factorisation(name: str, large: None, monkeypatch: pytest.MonkeyPatch) -> None:
    found = FLOWS[name]()
    monkeypatch.setattr(network, "DIRECT", 10**9)
    exact = FLOWS[name]()
    assert_allclose(getattr(found, "coefficient", found), getattr(exact, "coefficient", exact), rtol=1e-9)
    if hasattr(found, "flux"):
        assert found.conservation_error < 1e-9
        assert_allclose(found.flux, exact.flux, rtol=1e-6, atol=1e-8 * exact.flux.max())


def test_no_convergence_is_an_error(large: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "ITERATIONS", 2)
    with pytest.raises(ConvergenceError, match="did not converge"):
        conduction(rough(0.3, 1, D=2.3), 0)


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
        conduction(rough(0.1, 1, D=2.3), 0)
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
