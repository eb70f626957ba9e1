"""Finished cases as one dataset, with provenance, dimensional values and warnings: ``study.nc``."""

from __future__ import annotations

import contextlib
import json
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from roughvol.campaign import interpretation, validity
from roughvol.campaign.one_case import FFT
from roughvol.errors import DatasetError
from roughvol.store import dataset, dimensional, provenance, run_folder, variants
from roughvol.store.dataset import Arrays, Dataset
from roughvol.store.run_folder import case_file
from roughvol.study import Case, Study


@dataclass
class Finished:
    """The arrays of finished cases by id, their versions, and the faults of unusable files by id."""

    arrays: dict[str, Arrays] = field(default_factory=dict)
    versions: Counter[str] = field(default_factory=Counter)
    faults: dict[str, str] = field(default_factory=dict)


def finished(folder: Path, cases: Mapping[str, Case], stopping: Callable[[], bool] = lambda: False) -> Finished:
    """Return the finished cases of a folder; raise `KeyboardInterrupt` if it is to stop."""
    found = Finished()
    for id, case in cases.items():
        if stopping():
            raise KeyboardInterrupt
        path = case_file(folder, id)
        try:
            arrays, _, labels = dataset.read_arrays(path)
        except DatasetError as error:
            if path.exists():
                found.faults[id] = str(error)
            continue
        if fault := run_folder.mismatch(path, labels, run_folder.labels_for(case)):
            found.faults[id] = fault
        else:
            named = {"case": (("case",), np.array([case.label], dtype=object))} if case.file else {}
            found.arrays[id] = arrays | named  # the file may have had another name
            found.versions[labels.get("version", "")] += 1
    return found


def complete(folder: Path, cases: Mapping[str, Case], stopping: Callable[[], bool]) -> Finished:
    """Return cases that are all finished, else raise `DatasetError`."""
    found = finished(folder, cases, stopping)
    absent = [id for id in cases if id not in found.arrays and id not in found.faults]
    if absent or found.faults:
        lines = [*found.faults.values(), *(f"{case_file(folder, id)} has vanished" for id in absent)]
        raise DatasetError("\n".join(lines))
    return found


def stored(folder: Path, study: Study, ids: Iterable[str]) -> Dataset | None:
    """Return ``study.nc`` if it has this study and these cases, in any order."""
    with contextlib.suppress(DatasetError):
        results = dataset.read(folder / "study.nc")
        held = json.loads(results.attrs.get("case_ids", "[]"))
        if results.attrs.get("study") == study.stored() and sorted(held) == sorted(ids):
            return results
    return None


def renewed(folder: Path, results: Dataset) -> Dataset:
    """Return the results of ``study.nc`` and make this file newer than the study file, for make."""
    with contextlib.suppress(OSError):
        os.utime(folder / "study.nc")
    return results


def of_run(
    folder: Path, cases: Mapping[str, Case], study: Study, stopping: Callable[[], bool], *, again: bool
) -> Dataset:
    """Return ``study.nc``, made from the cases ``again`` or where it is not up to date."""
    if not again and (results := stored(folder, study, cases)) is not None:
        return renewed(folder, results)
    return written(folder, combined(complete(folder, cases, stopping), cases, study))


def written(folder: Path, results: Dataset) -> Dataset:
    """Write results to ``study.nc`` and return them in the order of the file."""
    dataset.write(results, folder / "study.nc")
    return results[[*sorted(map(str, results.data_vars)), *sorted(map(str, results.coords))]]


def combined(found: Finished, cases: Mapping[str, Case], study: Study) -> Dataset:
    """Return the dataset of the finished cases of a study."""
    if study.axes:
        return _joined(found, cases, study)
    case = next(iter(cases.values()))
    every = list(cases.values())
    attributes = provenance.provenance(study.stored(), fft=FFT, cases=every, ids=found.arrays, versions=found.versions)
    results = dataset.combine(list(found.arrays.values()), attributes)
    results = dimensional.in_units(results, study, case.length_unit)
    findings = validity.after(validity.setting(study), results)
    named = results.get("region_waves")
    waves = [] if named is None else named.mean({*named.dims} - {"axis"}).values.tolist()  # of cases that have them
    doubts = interpretation.sentences(study, results["Sq"].values.ravel(), results["L"].item(), case.length_unit, waves)
    notes = [note for one in every for note in one.notes]
    return results.assign_attrs(warnings="\n".join(validity.sentences(findings, [*notes, *doubts])))


def _joined(found: Finished, cases: Mapping[str, Case], study: Study) -> Dataset:
    """Return the dataset of a study with lists: each combination collected by itself, joined along the axes."""
    parts = []
    for variant in study.variants:
        held = {case.id: case for case in variant.study.cases() if case.id in found.arrays and case.id in cases}
        if held:
            arrays = {id: found.arrays[id] for id in held}
            parts.append((variant, combined(Finished(arrays, found.versions), held, variant.study)))
    attributes = {str(name): str(text) for name, text in parts[0][1].attrs.items()}
    attributes |= {"study": study.stored(), "case_ids": provenance.ids_text(found.arrays)}
    return variants.joined(parts, study.axes, attributes | variants.lines_of(parts))
