"""Studies with lists: the datasets of their combinations joined along axes, and taken apart again.

Every variable of a surface gets the axes of the study in front, as ``(E, case, step)``. A case that several
combinations share is repeated.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from xarray import Dataset

from roughvol.errors import DatasetError, StudyError
from roughvol.store import dataset
from roughvol.study import AXES, Axis, Study, Variant, loads


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


class Part(NamedTuple):
    """One combination of a stored study: its words, its labels, and its dataset without the axes."""

    words: str
    labels: dict[str, float | str]
    dataset: Dataset


def parts_of(results: Dataset) -> list[Part]:
    """Return the combinations of a stored study, each as the dataset of a study without lists."""
    held = [name for name in AXES if name in results.dims]
    if not held:
        return [Part("", {}, results)]
    try:
        study: Study = loads(str(results.attrs.get("study", "")), stored=True)
    except StudyError as error:
        message = f"the study of a dataset with the axes {', '.join(held)} cannot be read again: {error}"
        raise DatasetError(message) from error
    found = []
    warnings = str(results.attrs.get("warnings", "")).splitlines()
    variants = study.variants
    stored = {name: results[name].values.tolist() for name in held}
    for variant in variants:
        labels = dict(variant.labels)
        if labels.keys() != set(held) or any(label not in stored[name] for name, label in labels.items()):
            continue
        one = results.sel(labels).drop_vars(held)
        own = [
            line.removesuffix(f" ({variant.words})") for line in warnings if not _of_another(line, variant, variants)
        ]
        found.append(
            Part(variant.words, labels, one.assign_attrs(study=variant.study.stored(), warnings="\n".join(own)))
        )
    return found


def _of_another(line: str, variant: Variant[Study], variants: Sequence[Variant[Study]]) -> bool:
    """Return whether a warning ends with the words of another combination."""
    return any(line.endswith(f" ({other.words})") for other in variants if other.words != variant.words)


def warnings_of(parts: Sequence[tuple[Variant[Study], Dataset]]) -> str:
    """Return the warnings of all combinations; those of some have their words behind them."""
    lines = [str(part.attrs.get("warnings", "")).splitlines() for _, part in parts]
    texts = list(dict.fromkeys(itertools.chain(*lines)))
    found = []
    for text in texts:
        if all(text in own for own in lines):
            found.append(text)
        else:
            found += [
                f"{text} ({variant.words})" for (variant, _), own in zip(parts, lines, strict=True) if text in own
            ]
    return "\n".join(found)
