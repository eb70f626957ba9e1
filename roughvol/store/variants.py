"""Studies with lists: the datasets of their combinations joined along axes, and taken apart again.

Every variable of a surface gets the axes of the study in front, as ``(E, case, step)``. A case that several
combinations share is repeated.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from xarray import DataArray, Dataset

from roughvol.errors import DatasetError, StudyError
from roughvol.observables.variables import MEAN_ENDS, OF_YIELD, QUANTITIES, STATES, VARIABLES
from roughvol.store import dataset
from roughvol.study import AXES, Axis, Study, Variant, loads
from roughvol.study.axes import with_endings

SURFACES = (*AXES, "D", "m", "seed", "case")  # dimensions of lists and surfaces
IN_LINES = ("warnings", "surface", "region")  # attributes with lines; those of some combinations have their words


def joined(
    parts: Sequence[tuple[Variant[Study], Dataset]], axes: Sequence[Axis], attributes: Mapping[str, str]
) -> Dataset:
    """Return one dataset of several combinations: the axes of the study, then the dimensions of a surface."""
    described: dict[str, dict[str, object]] = {}
    arrays = []
    for variant, part in parts:
        own: dataset.Arrays = {
            name: ((name,), np.array([label], dtype=object if isinstance(label, str) else float))
            for name, label in variant.labels.items()
        }
        for name, (dims, values) in dataset.arrays_of(part).items():
            described.setdefault(name, dict(part[name].attrs))
            if name in part.coords:
                own[name] = dims, values
            else:
                own[name] = (*variant.labels, *dims), values[(np.newaxis,) * len(variant.labels)]
        arrays.append(own)
    results = dataset.combine(arrays, attributes)
    for name, attrs in described.items():
        results[name].attrs = attrs
    for axis in axes:
        if axis.unit is not None:
            results[axis.name].attrs["units"] = axis.unit
    return results


def chosen(results: Dataset) -> list[str]:
    """Return the lists and the dimensions of surfaces of which a dataset has one label, and no dimension."""
    return [name for name in SURFACES if name in results.coords and not results[name].dims]


def recorded(results: Dataset) -> list[str]:
    """Return the dimensions of recorded states of which a dataset has one label, and no dimension."""
    return [name for name in STATES if name in results.coords and name not in results.dims]


def coordinates_of_user(results: Dataset) -> list[str]:
    """Return the coordinates of a dataset that a user made of its numbers, as by ds.set_coords."""
    rows = {name: QUANTITIES.get(name) for name in map(str, results.coords) if name not in (*SURFACES, *dataset.COORDS)}
    return [name for name, row in rows.items() if row is not None and row.dims != name]  # labels of the user stay


def widened(results: Dataset) -> Dataset:
    """Return a dataset with the dimensions of all lists, surfaces and recorded states; its numbers are variables."""
    results = results.reset_coords(coordinates_of_user(results))
    full = results.expand_dims(names) if (names := chosen(results)) else results
    if "ensemble_at" in results:  # its means are of all surfaces, and have no dimension seed, and most no m
        of_means = {
            name: results[name].expand_dims([dim for dim in dims if dim not in results[name].dims]).transpose(*dims)
            for name, dims in _means_of(results).items()
        }
        full = full.drop_vars("ensemble_at").assign(of_means)
    for dim in recorded(full):
        rows = {str(name): VARIABLES[str(name)].dims.split() for name in full.data_vars if name in VARIABLES}
        along = {name: full[name].expand_dims(dim) for name, dims in rows.items() if dim in dims}
        full = full.drop_vars([dim, *along]).assign(
            {name: one.transpose(..., *rows[name][1:], missing_dims="ignore") for name, one in along.items()}
        )
    return full


def _means_of(results: Dataset) -> dict[str, list[str]]:
    """Return the variables of an ensemble with their dimensions; those of a function of the user are as of V*."""
    found = {}
    for name in map(str, results.data_vars):
        end = max((end for end in MEAN_ENDS if name.endswith(end)), key=len, default="")
        is_mean = f"{name.removesuffix(end)}_accuracy_asked" in results
        row = VARIABLES.get(name) or VARIABLES[f"free_volume{end if is_mean else ''}"]
        if not row.dims.startswith("..."):
            found[name] = row.dims.split()
            if foreign := [str(dim) for dim in results[name].dims if dim not in found[name]]:
                place = f"{name} along {foreign[0]}, as after ds.where"
                raise DatasetError(f"the dataset has {place}; allowed: the dimensions of a run")
    return found


def whole(results: Dataset) -> Dataset:
    """Return a dataset as `widened` does; a `DatasetError` if it lacks the dimensions of a state."""
    for name, least in (("step", 1), ("axis", 2)):
        if name in results.coords and results.sizes.get(name, 0) < least:
            if not results[name].size:
                raise DatasetError(f"the dataset has no {name}; allowed: states with their labels and variables")
            label = np.atleast_1d(results[name].values)[0]
            kept = f"the dimension kept, as .sel(step=[{label}])" if name == "step" else "both axes; .sel of the answer"
            raise DatasetError(f"the dataset has {name} {label} alone; allowed: {kept}")
    full = widened(results)
    if "mean_pressure" in full and "step" in full.dims:
        if "units" not in full["mean_pressure"].attrs:
            raise DatasetError("the dataset has lost its units; allowed: with xarray.set_options(keep_attrs=True)")
        if "Sq" in full and "step" in full["Sq"].dims:
            raise DatasetError("the dataset has Sq along step, as after ds.where; allowed: the dimensions of a run")
        surface = next((name for name in ("case", "seed") if name in full.dims), None)
        if surface is None:
            first = "; a mean over surfaces is that of their numbers at a load: ds.roughvol.at(LOAD).roughvol.mean()"
            raise DatasetError(f"the dataset has no dimension seed or case; allowed: the dimensions of a run{first}")
        needed = ("Sq",) if "case" in full.dims else ("D", "m", "Sq")
        lacks = next((name for name in needed if name not in full), "") if full.sizes[surface] else "surface"
        if lacks:
            raise DatasetError(f"the dataset has no {lacks}; allowed: surfaces with their labels and variables")
    return full


class Part(NamedTuple):
    """One combination of a stored study: its words, its labels, and its dataset without the axes."""

    words: str
    labels: dict[str, float | str]
    dataset: Dataset


def study_in(results: Dataset) -> Study | None:
    """Return the study of a dataset, or None if the dataset has none that can be read again."""
    try:
        return _read(str(results.attrs.get("study", "")))
    except StudyError:  # of a version that wrote other studies: the numbers still are
        return None


@functools.lru_cache(maxsize=64)
def _read(text: str) -> Study:
    return loads(text, stored=True)


def parts_of(results: Dataset) -> list[Part]:
    """Return the combinations of a stored study, each as the dataset of a study without lists."""
    held = [name for name in AXES if name in results.dims]
    if not held:
        return [Part("", {}, results)]
    try:
        study = _read(str(results.attrs.get("study", "")))
    except StudyError as error:
        message = f"the study of a dataset with the axes {', '.join(held)} cannot be read again: {error}"
        raise DatasetError(message) from error
    found = []
    endings = {variant.words: f" ({variant.words})" for variant in study.variants}
    stored = {name: results[name].values.tolist() for name in held}
    for variant in study.variants:
        labels = dict(variant.labels)
        if labels.keys() != set(held) or any(label not in stored[name] for name, label in labels.items()):
            continue
        others = tuple(ending for words, ending in endings.items() if words != variant.words)
        part = results.sel(labels).drop_vars(held)
        if not variant.study.material.yields:
            of_states = [f"{dim}_{name}" for dim in STATES for name in OF_YIELD]
            part = part.drop_vars([*OF_YIELD, *of_states], errors="ignore")
        part = _without_lines(part, others, endings[variant.words]).assign_attrs(study=variant.study.stored())
        found.append(Part(variant.words, labels, part))
    if not found:
        raise DatasetError(f"the study of the dataset has no combination with its values of {', '.join(held)}")
    return found


def counted_once(results: Dataset, study: Study) -> Dataset:
    """Return results without fields, a case that several combinations share in the first of these alone.

    E* and ν act through p* alone, so combinations of moduli may share their cases.
    """
    parts = parts_of(results)
    if len(parts) == 1:
        return results
    ids = {variant.words: {case.id for case in variant.study.cases()} for variant in study.variants}
    held, seen = list(parts[0].labels), set[str]()
    first = DataArray(np.zeros([results.sizes[name] for name in held], bool), {n: results[n] for n in held}, held)
    for part in parts:
        first.loc[part.labels] = not ids[part.words] <= seen
        seen |= ids[part.words]
    return results.drop_dims(("x", "y"), errors="ignore").where(first)


def part_words(results: Dataset) -> str:
    """Return in words the labels that a part of a study with lists has; empty for all combinations."""
    study = study_in(results)
    held = {axis: results[axis.name].values.ravel() for axis in (study.axes if study else ()) if axis.name in results}
    parts = ((axis, labels.tolist()) for axis, labels in held.items() if labels.size < len(axis.labels))
    return ", ".join(axis.words(label) for axis, labels in parts for label in labels)


def part_with(results: Dataset, labels: Mapping[str, Sequence[float | str]]) -> Dataset:
    """Return the combinations of results that have some labels of lists, without the lines of others in attributes."""
    part, study = results.sel(labels), study_in(results)
    others = tuple(
        f" ({variant.words})"
        for variant in (study.variants if study else ())
        if any(variant.labels[name] not in kept for name, kept in labels.items())
    )
    return _without_lines(part, others)


def _without_lines(part: Dataset, others: tuple[str, ...], own: str = "") -> Dataset:
    """Return a dataset without the lines in attributes that have other endings, and without its own ending."""
    lines = {name: str(part.attrs[name]).splitlines() for name in IN_LINES if name in part.attrs}
    kept = {name: (line.removesuffix(own) for line in of if not line.endswith(others)) for name, of in lines.items()}
    return part.assign_attrs({name: "\n".join(of) for name, of in kept.items()})


def of_one_combination(results: Dataset) -> Dataset:
    """Return results of one combination as those of its study without lists; others unchanged."""
    parts = parts_of(results)
    return parts[0].dataset if len(parts) == 1 else results


def lines_of(parts: Sequence[tuple[Variant[Study], Dataset]]) -> dict[str, str]:
    """Return the attributes with lines that any combination has; the lines of some have their words behind them."""
    found = dict[str, str]()
    for name in IN_LINES:
        every = [(variant.words, str(part.attrs.get(name, "")).splitlines()) for variant, part in parts]
        lines = [f"{text}{ending}" for text, ending in with_endings(every)]
        found |= {name: "\n".join(lines)} if any(name in part.attrs for _, part in parts) else {}
    return found
