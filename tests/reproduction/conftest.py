"""Fixtures of the tests of the reproduction."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from roughvol.reproduction.judgement import Judgement, judge
from tests.reproduction import kit


@pytest.fixture
def no_figures() -> Iterator[None]:
    """Leave the figures out of reports."""
    with kit.without_figures():
        yield


@pytest.fixture(scope="session")
def answered(small_study: Path) -> Judgement:
    """The claims, judged by the small study."""
    return judge([small_study], any_size=True)
