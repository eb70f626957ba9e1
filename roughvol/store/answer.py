"""The answer of an ensemble in its dataset, and the planned numbers of samples in the folder of a run."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from roughvol.observables.variables import DTYPES, VARIABLES
from roughvol.store import run_folder, stamped_file
from roughvol.study import Case, Study

if TYPE_CHECKING:
    from xarray import Dataset

BOUNDS = ("lower", "upper")
_LEVEL = re.compile(r"[0-9]{1,2}")


def plan_file(folder: Path) -> Path:
    """Return the path of the planned numbers of samples.

    Parameters
    ----------
    folder : path
        Folder of a run.

    Returns
    -------
    path
        A JSON file.
    """
    return folder / "ensemble.json"


def store_plan(folder: Path, counts: Mapping[float, Mapping[int, int]]) -> None:
    """Store the planned numbers of samples for `cases_of`.

    Parameters
    ----------
    folder : path
        Folder of a run.
    counts : mapping
        Number of samples by D and m.
    """
    samples = {repr(D): {str(m): n for m, n in levels.items()} for D, levels in counts.items()}
    stamped_file.store(plan_file(folder), json.dumps(samples, indent=1).encode())


def cases_of(study: Study, folder: Path) -> dict[str, Case]:
    """Return the cases of a study; of an ensemble, the samples of its latest plan.

    Parameters
    ----------
    study : Study
        The study.
    folder : path
        Folder of a run.

    Returns
    -------
    dict
        Cases by id.
    """
    if study.ensemble is None:
        return {case.id: case for case in study.cases()}
    first, plan = study.ensemble.first_seed, run_folder.small_json(plan_file(folder))
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


def with_answer(results: Dataset, values: Mapping[str, tuple[tuple[str, ...], Any]], sentences: str) -> Dataset:
    """Return a dataset with the variables and the sentences of an answer.

    Parameters
    ----------
    results : Dataset
        Cases of the study.
    values : mapping
        Dimensions and values by the name of the variable.
    sentences : str
        Text of the attribute ``answer``.

    Returns
    -------
    Dataset
        The same dataset with both.
    """
    for name, (dims, array) in values.items():
        row = VARIABLES[name]
        results[name] = (dims, np.asarray(array, dtype=DTYPES[row.kind]))
        results[name].attrs = {"units": row.units, "long_name": row.long_name, "symbol": row.symbol}
    return results.assign_attrs(answer=sentences)
