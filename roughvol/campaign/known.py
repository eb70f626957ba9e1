"""Cases that stored files answer already: in this folder with another record, or in a sibling under ``runs/``.

A file with the same id is the same case: it is linked or copied once every bit of it is verified. A file that differs
in its record alone answers a case if its stored states have all that is asked (`observables.stored_states`). Files of
another answer format are never used, and no file is changed or removed.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from roughvol.campaign import path as paths
from roughvol.campaign.one_case import FFT, one_thread, surface_of, undeformed
from roughvol.errors import DatasetError, RoughvolError
from roughvol.observables.stored_states import Names, Unanswerable, of_stored
from roughvol.store import dataset, provenance, run_folder, stamped_file
from roughvol.store.run_folder import case_file
from roughvol.store.variables import VARIABLES
from roughvol.study import Case, Record

ROOT = "runs"  # name of a folder whose runs share their cases
MADE = frozenset(  # of the record alone, made anew
    {"region_aspect", "transport_time", "level_convolutions", "wall_time", "central_pressure_ratio"}
)
KEPT = ("roughvol_version", "libraries", "fft", "host", "platform", "cpu_count", "date")  # of the solve


@dataclass
class Found:
    """What stored files answer.

    Attributes
    ----------
    missing : list of Case
        Cases still to compute.
    shared : int
        Cases of another run.
    reduced : int
        Cases answered by stored states.
    """

    missing: list[Case] = field(default_factory=list)
    shared: int = 0
    reduced: int = 0

    @property
    def notice(self) -> str:
        """What was found, in a line; empty if nothing."""
        parts = [f"{self.shared} finished in other runs of this folder"] if self.shared else []
        parts += [f"{self.reduced} answered by stored states"] if self.reduced else []
        return f"nothing to compute for {' and '.join(parts)}" if parts else ""


def answered(folder: Path, missing: Sequence[Case], text: str, stopping: Callable[[], bool] = lambda: False) -> Found:
    """Store the cases that stored files answer, and return the others.

    Parameters
    ----------
    folder : Path
        Folder of the run, which this process owns.
    missing : sequence of Case
        Cases without a file there.
    text : str
        The study, for the provenance.
    stopping : callable
        Polled between two cases.

    Returns
    -------
    Found
        The cases left.

    Raises
    ------
    FolderError
        If the folder cannot be written.
    KeyboardInterrupt
        If it is to stop.
    """
    found = Found()
    if not missing:
        return found
    files = _Files(folder)
    for case in missing:
        if stopping():
            raise KeyboardInterrupt
        if _shared(files, folder, case):
            found.shared += 1
        elif _reduced(files, folder, case, text):
            found.reduced += 1
        else:
            found.missing.append(case)
    return found


class _Files:
    """The case files of a folder and of its siblings under a root, by readable prefix and by digest."""

    def __init__(self, folder: Path) -> None:
        own = folder.resolve()
        self.siblings: list[Path] = []
        if own.parent.name == ROOT:
            with contextlib.suppress(OSError):
                self.siblings = sorted(one for one in own.parent.iterdir() if one != own and (one / "cases").is_dir())
        self._by_part: dict[str, list[Path]] = {}
        for one in (folder, *self.siblings):
            for id in sorted(run_folder.stored_ids(one)):
                for part in set(id.rpartition("-")[::2]):
                    self._by_part.setdefault(part, []).append(case_file(one, id))

    def like(self, case: Case) -> list[Path]:
        """Return the files that may hold the states of a case: of equal prefix, or of equal digest."""
        prefix, _, digest = case.id.rpartition("-")
        return list(dict.fromkeys([*self._by_part.get(prefix, ()), *self._by_part.get(digest, ())]))

    def content(self, path: Path, case: Case) -> tuple[dict[str, Any], dataset.Arrays, dict[str, str]] | None:
        """Return key, variables and attributes of a sound file of the present format, None for another."""
        try:
            labels = stamped_file.labels(path)
            expected = run_folder.labels_for(case)
            if any(labels.get(name) != expected[name] for name in ("format", "format_of_answers")):
                return None
            if labels.get("states", expected["states"]) != expected["states"]:
                return None
            arrays, attributes = dataset.read_case(path)
            return json.loads(attributes["case"]), arrays, attributes
        except (DatasetError, KeyError, ValueError, RecursionError, OSError):
            return None


def _shared(files: _Files, folder: Path, case: Case) -> bool:
    """Link or copy the file of a case from a sibling, if there is a sound one."""
    target = case_file(folder, case.id)
    for sibling in files.siblings:
        source = case_file(sibling, case.id)
        if not source.is_file() or run_folder.examined(source, case).fault is not None:
            continue
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            aside = stamped_file.aside_of(target)
            aside.unlink(missing_ok=True)
            os.link(source, aside)
            aside.replace(target)
        except OSError:  # another disk, or a file system without links
            try:
                stamped_file.store(target, source.read_bytes())
            except OSError as error:
                raise stamped_file.cannot_write(target, error) from error
        if run_folder.examined(target, case).fault is None:  # the sibling may have been replaced meanwhile
            return True
        target.unlink(missing_ok=True)
    return False


def _reduced(files: _Files, folder: Path, case: Case, text: str) -> bool:
    """Store a case from the stored states of a file that differs in its record alone, if one has all that is asked."""
    wanted = stamped_file.states_of(json.loads(case.key_text))
    for path in files.like(case):
        content = files.content(path, case)
        if content is None or stamped_file.states_of(content[0]) != wanted:
            continue
        try:
            values, attributes = _values(case, *content, text)
        except (Unanswerable, ValueError, RoughvolError):  # the run computes it, and reports what fails
            continue
        try:
            stamped_file.make_folder(folder / "cases")
        except OSError as error:
            raise stamped_file.cannot_write(folder / "cases", error) from error
        stamped_file.store(case_file(folder, case.id), dataset.case_bytes(case, values, attributes))
        return True
    return False


def _values(
    case: Case, key: Mapping[str, Any], arrays: dataset.Arrays, attributes: Mapping[str, str], text: str
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return values and attributes of a case from those of a stored one."""
    started = time.perf_counter()
    record = Record.model_validate(key["record"])
    own = {name: _own(name, dims, values) for name, (dims, values) in arrays.items()}
    along: dict[str, list[str]] = {}
    at: dict[str, list[str]] = {}
    for name in own:
        row = VARIABLES[name]
        dims = row.dims.split()
        if row.observable and dims[:2] == ["...", "step"]:
            along.setdefault(row.observable, []).append(name)
        if dims[:1] == ["..."] and len(dims) > 1 and dims[1].endswith("_at"):
            at.setdefault(dims[1], []).append(name)
    with one_thread():
        surface = surface_of(case)
        values = undeformed(case, surface)
        if case.sweep.steps > 0:
            base = {n: v for n, v in own.items() if not VARIABLES[n].observable and _of_every_study(n)}
            states = of_stored(paths.starred(case, surface), surface, record, own, Names(along, at))
            values = base | values | states
    values["wall_time"] = float(own.get("wall_time", 0.0)) + time.perf_counter() - started
    made = provenance.provenance(text, fft=FFT, case=case)
    return values, made | {name: attributes[name] for name in KEPT if name in attributes} | {
        "states_of": attributes.get("case_id", "")
    }


def _of_every_study(name: str) -> bool:
    """Return whether a variable without an observable is stored in every study with steps."""
    return VARIABLES[name].dims in ("... step", "...") and name not in MADE and not name.startswith(("rms_", "nayak"))


def _own(name: str, dims: tuple[str, ...], values: Any) -> Any:
    """Return a stored variable without the dimensions of the case."""
    wanted = [dim for dim in VARIABLES[name].dims.split() if dim != "..."]
    extra = len(dims) - len(wanted) if VARIABLES[name].dims.startswith("...") else 0
    array = np.asarray(values)[(0,) * extra]
    return array.item() if array.ndim == 0 else array
