"""The matrix of extremes; `make extremes` runs all of it and writes docs/explanation/notes/extremes.md."""

from typing import Any

import pytest
from extremes.matrix import CELLS, Cell, over_random_cases


def _named(cell: Cell) -> Any:
    return pytest.param(cell, id=f"{cell.group} {cell.name}", marks=[] if cell.quick else [pytest.mark.slow])


@pytest.mark.parametrize("cell", [_named(cell) for cell in CELLS])
def test_extreme(cell: Cell) -> None:
    found = cell.run()
    assert found.residual <= 0.1
    assert found.compared


def test_some_random_cases() -> None:
    assert over_random_cases(18, nodes=10_000).residual <= 1e-3
