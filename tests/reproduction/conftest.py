"""Fixtures of the tests of the reproduction."""

from pathlib import Path

import pytest

from roughvol.reproduction.judgement import Judgement, judge


@pytest.fixture(scope="session")
def answered(small_study: Path) -> Judgement:
    """The claims, judged by the small study."""
    return judge([small_study], any_size=True)
