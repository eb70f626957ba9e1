"""Studies that are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from roughvol.errors import Problem, StudyError
from roughvol.study import loads


def problems_of(text: str, file: str | Path = "a.yaml") -> tuple[Problem, ...]:
    with pytest.raises(StudyError) as caught:
        loads(text, file)
    return caught.value.problems


def refused(text: str, file: str | Path = "a.yaml") -> str:
    return "\n".join(str(problem) for problem in problems_of(text, file))
