"""The planned numbers of samples of an ensemble, in the folder of its run, and the cases that follow from them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path

from roughvol.store import run_folder, stamped_file
from roughvol.study import Case, Study

_LEVEL = re.compile(r"[0-9]{1,2}")


def path(folder: Path) -> Path:
    """Return the path of the planned numbers of samples."""
    return folder / "ensemble.json"


def store(folder: Path, counts: Mapping[float, Mapping[int, int]]) -> None:
    """Store the planned numbers of samples by D and m for `cases_of`."""
    samples = {repr(D): {str(m): n for m, n in levels.items()} for D, levels in counts.items()}
    stamped_file.store(path(folder), json.dumps(samples, indent=1).encode())


def cases_of(study: Study, folder: Path) -> dict[str, Case]:
    """Return the cases of a study by id; of an ensemble, the samples of its latest plan."""
    if study.ensemble is None:
        return {case.id: case for case in study.cases()}
    first, plan = study.ensemble.first_seed, run_folder.small_json(path(folder))
    counts = {case.D: {case.m: 1} for case in study.cases()}
    for D, levels in counts.items():
        planned = plan.get(repr(D))
        for m, number in planned.items() if isinstance(planned, dict) else ():
            if _LEVEL.fullmatch(m) and isinstance(number, int):
                levels[int(m)] = number
    samples = (
        study.sample(D, m, first + seed)
        for D, levels in counts.items()
        if D is not None
        for m, number in levels.items()
        if m is not None
        for seed in range(number)
    )
    return {case.id: case for case in samples}
