"""The planned numbers of samples of an ensemble, in the folder of its run, and the cases that follow from them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path

from roughvol.store import run_folder, stamped_file
from roughvol.study import Case, Study

_LEVEL = re.compile("[1-9][0-9]?")


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
    samples: list[Case] = []
    for D, finest in {case.D: case.m for case in study.cases()}.items():
        assert D is not None  # the cases of an ensemble are made
        planned = plan.get(repr(D))
        counts = planned.items() if isinstance(planned, dict) else ()
        sound = {m: n for m, n in counts if _LEVEL.fullmatch(m) and type(n) is int and n > 0}
        for m, number in ({str(finest): 1} | sound).items():
            samples += [study.sample(D, int(m), first + seed) for seed in range(number)]
    return {case.id: case for case in samples}
