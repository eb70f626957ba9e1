"""Fixtures of the tests of the reproduction."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.reproduction import kit


@pytest.fixture
def no_figures() -> Iterator[None]:
    """Leave the figures out of reports."""
    with kit.without_figures():
        yield
