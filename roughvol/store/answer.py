"""The answer of an ensemble beside its cases in one dataset, and the plan of its samples in the folder of a run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from roughvol.store import run_folder, stamped_file
from roughvol.store.variables import DTYPES, VARIABLES
from roughvol.study import Case, Study

if TYPE_CHECKING:
    from xarray import Dataset

BOUNDS = ("lower", "upper")


def plan_file(folder: Path) -> Path:
    """Return where a run keeps the samples that its ensemble wants."""
    return folder / "ensemble.json"


def keep_plan(folder: Path, counts: Mapping[float, Mapping[int, int]]) -> None:
    """Store how many samples each D and level are to have, for `cases_of`."""
    content = {repr(D): {str(m): n for m, n in samples.items()} for D, samples in counts.items()}
    stamped_file.store(plan_file(folder), json.dumps(content, indent=1).encode())


def cases_of(study: Study, folder: Path) -> dict[str, Case]:
    """Return the cases of a study by id; those of an ensemble are the samples that the latest plan has."""
    cases = study.cases()
    if study.ensemble is not None:
        first, plan = study.ensemble.first_seed, run_folder.small_json(plan_file(folder))
        wanted = {case.D: {case.m: 1} for case in cases}
        for D in wanted:
            samples = plan.get(repr(D))
            for m, n in samples.items() if isinstance(samples, dict) else ():
                if m.isdigit() and isinstance(n, int):
                    wanted[D][int(m)] = n
        cases = tuple(
            study.sample(D, m, first + seed)
            for D, samples in wanted.items()
            if D is not None
            for m, n in samples.items()
            if m is not None
            for seed in range(n)
        )
    return {case.id: case for case in cases}


def with_answer(results: Dataset, values: Mapping[str, tuple[tuple[str, ...], Any]], sentences: str) -> Dataset:
    """Return a dataset with the variables of an answer, each given as dimensions and values, and its sentences."""
    for name, (dims, array) in values.items():
        row = VARIABLES[name]
        results[name] = (dims, np.asarray(array, dtype=DTYPES[row.kind]))
        results[name].attrs = {"units": row.units, "long_name": row.long_name, "symbol": row.symbol}
    return results.assign_attrs(answer=sentences)
