"""The finished cases of a study brought together, every bit of each checked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

from roughvol.errors import DatasetError
from roughvol.store import dataset, run_folder
from roughvol.store.columns import Arrays
from roughvol.store.run_folder import case_file
from roughvol.study import Case


def sound_parts(
    place: Path, cases: Mapping[str, Case], stopping: Callable[[], bool] = lambda: False
) -> tuple[dict[str, Arrays], dict[str, str], dict[str, int]]:
    """Return the arrays of the finished cases in the order of the cases, the faults of the other files, the versions.

    The versions are those of roughvol that computed the cases, each with the number of its cases.

    Raises
    ------
    KeyboardInterrupt
        If it was stopped on the way.
    """
    parts: dict[str, Arrays] = {}
    bad: dict[str, str] = {}
    versions: Counter[str] = Counter()
    for id, case in cases.items():
        if stopping():
            raise KeyboardInterrupt
        path = case_file(place, id)
        try:
            arrays, labels = dataset.read_arrays(path)
        except DatasetError as error:
            if path.exists():
                bad[id] = str(error)
            continue
        why = run_folder.mismatch(path, labels, case)
        if why is None:
            parts[id] = arrays
            versions[labels.get("version", "")] += 1
        else:
            bad[id] = why
    return parts, bad, dict(versions)
