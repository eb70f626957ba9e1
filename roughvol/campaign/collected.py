"""Finished cases as one dataset: `study.nc`, and what `collect` returns of an unfinished run."""

from __future__ import annotations

import contextlib
import os
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from roughvol.campaign import doubts, validity
from roughvol.campaign.one_case import FFT
from roughvol.errors import DatasetError
from roughvol.observables.variables import DTYPES, VARIABLES
from roughvol.store import dataset, dimensional, provenance, run_folder, sample_plan, variants
from roughvol.store.dataset import Arrays, Dataset
from roughvol.store.run_folder import case_file, folder_of
from roughvol.study import Case, Study, load

if TYPE_CHECKING:
    from roughvol.ensemble.design import Design


def collect(study: Study | str | Path, out: str | Path | None = None) -> Dataset:
    """Return the finished cases as one dataset, also of an unfinished run; nothing is written.

    Damaged files are left out. `status` and the next run report them. Of an ensemble, the dataset has the means as well
    if all samples are finished. Otherwise its attribute ``answer`` gives the number of the missing ones.

    Parameters
    ----------
    study : Study or path of a study file
        Study of the run.
    out : path, optional
        Folder of the results; default: ``runs/<name of the study>``.

    Returns
    -------
    Dataset
        Finished cases, as in ``study.nc``.

    Raises
    ------
    DatasetError
        If no case is finished.
    """
    study = study if isinstance(study, Study) else load(study)
    folder = folder_of(study, out)
    cases = sample_plan.cases_of(study, folder)
    parts, _, versions = _finished(folder, cases)
    if not parts:
        raise DatasetError(f"no case of {study.name} is finished in {folder}")
    if study.ensemble is None:
        return combined(parts, cases, study, versions)
    return _with_means(study, folder, cases, parts, versions)


def _with_means(
    study: Study, folder: Path, cases: Mapping[str, Case], parts: dict[str, Arrays], versions: Mapping[str, int]
) -> Dataset:
    """Return the finished samples of an ensemble, with the means if none is missing."""
    from roughvol.campaign import trials  # scipy.stats: half a second, for ensembles alone
    from roughvol.ensemble.design import Design

    with contextlib.suppress(DatasetError):  # a budget of time ends elsewhere in each run: its answer is the stored one
        stored = dataset.read(folder / "study.nc")
        same = stored.attrs.get("study") == study.stored() and "answer" in stored.attrs
        if same and stored.attrs.get("case_ids") == provenance.ids_text(parts) and parts.keys() == cases.keys():
            return stored

    results = combined(parts, {id: case for id, case in cases.items() if id in parts}, study, versions)
    design = Design(study, trials.step_errors(study))
    while request := design.next():
        if absent := sum(case.id not in parts for case in request.cases):
            missing = f"{absent} of {len(request.cases)} samples of a round are missing"
            return results.assign_attrs(answer=f"no answer yet: {missing}; a run of the study goes on")
        design.add(parts, trials.surfaces_alone(request.surfaces))
    return with_answer(results, design)


def with_answer(results: Dataset, design: Design) -> Dataset:
    """Return a dataset with the variables of an answer, and its sentences as the attribute ``answer``."""
    from roughvol.ensemble import answer

    for name, (dims, array) in answer.variables(design).items():
        row = VARIABLES[name]
        results[name] = (dims, np.asarray(array, dtype=DTYPES[row.kind]))
        results[name].attrs = {"units": row.units, "long_name": row.long_name, "symbol": row.symbol}
    return results.assign_attrs(answer="\n".join(answer.sentences(design)))


def all_parts(
    folder: Path, cases: Mapping[str, Case], stopping: Callable[[], bool], versions: Counter[str]
) -> dict[str, Arrays]:
    """Return the arrays of cases that are all to be there, and count their versions."""
    parts, faults, found = _finished(folder, cases, stopping)
    absent = [f"{case_file(folder, id)} has vanished" for id in cases if id not in parts and id not in faults]
    if absent or faults:
        raise DatasetError("\n".join([*faults.values(), *absent]))
    versions.update(found)
    return parts


def of_run(
    folder: Path, cases: Mapping[str, Case], study: Study, stopping: Callable[[], bool], *, again: bool
) -> Dataset:
    """Return ``study.nc``, made from the cases ``again`` or where it is not up to date."""
    path = folder / "study.nc"
    with contextlib.suppress(DatasetError, OSError):
        if again:
            raise DatasetError
        stored = dataset.read(path)
        if stored.attrs.get("study") == study.stored() and stored.attrs.get("case_ids") == provenance.ids_text(cases):
            os.utime(path)  # newer than the study file, for make
            return stored
    versions: Counter[str] = Counter()
    parts = all_parts(folder, cases, stopping, versions)
    dataset.write(combined(parts, cases, study, versions), path)
    return dataset.read(path)


def _finished(
    folder: Path, cases: Mapping[str, Case], stopping: Callable[[], bool] = lambda: False
) -> tuple[dict[str, Arrays], dict[str, str], dict[str, int]]:
    """Return the finished cases by id, the faults of unusable files by id, and the number of cases by version."""
    parts: dict[str, Arrays] = {}
    faults: dict[str, str] = {}
    versions: Counter[str] = Counter()
    for id, case in cases.items():
        if stopping():
            raise KeyboardInterrupt
        path = case_file(folder, id)
        try:
            arrays, labels = dataset.read_arrays(path)
        except DatasetError as error:
            if path.exists():
                faults[id] = str(error)
            continue
        fault = run_folder.mismatch(path, labels, run_folder.labels_for(case))
        if fault is None:
            parts[id] = arrays
            versions[labels.get("version", "")] += 1
        else:
            faults[id] = fault
    return parts, faults, dict(versions)


def combined(
    parts: Mapping[str, Arrays], cases: Mapping[str, Case], study: Study, versions: Mapping[str, int]
) -> Dataset:
    """Return the dataset of a study with its provenance, dimensional values and warnings."""
    if study.axes:
        return _joined(parts, cases, study, versions)
    case = next(iter(cases.values()))
    attributes = provenance.provenance(
        study.stored(),
        fft=FFT,
        ids=parts,
        region=case.record.region,
        length_unit=case.length_unit,
        bodies=[body for one in cases.values() for body in one.bodies],
        versions=versions,
        periodic=case.periodic,
    )
    if case.surface_text:
        attributes["surface"] = case.surface_text
    results = dimensional.in_units(dataset.combine(list(parts.values()), attributes), study, case.length_unit)
    findings = validity.after(validity.setting(study), results)
    doubtful = doubts.sentences(study, results["Sq"].values.ravel(), results["L"].item(), case.length_unit)
    return results.assign_attrs(warnings="\n".join(validity.sentences(findings, (*case.notes, *doubtful))))


def _joined(
    parts: Mapping[str, Arrays], cases: Mapping[str, Case], study: Study, versions: Mapping[str, int]
) -> Dataset:
    """Return the dataset of a study with lists: each combination collected by itself, joined along the axes."""
    found = []
    for variant in study.variants:
        held = {case.id: case for case in variant.study.cases() if case.id in parts and case.id in cases}
        if held:
            own = {id: parts[id] for id in held}
            found.append((variant, combined(own, held, variant.study, versions)))
    attributes = {str(name): str(text) for name, text in found[0][1].attrs.items()}
    for name in ("surface", "region"):
        if len({part.attrs.get(name) for _, part in found}) > 1:
            attributes[name] = "; ".join(dict.fromkeys(filter(None, (part.attrs.get(name) for _, part in found))))
    attributes |= {"study": study.stored(), "case_ids": provenance.ids_text(parts)}
    return variants.joined(found, study.axes, attributes | {"warnings": variants.warnings_of(found)})
