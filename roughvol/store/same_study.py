"""Whether the results in a folder are those of a study, for `run` and `status` alike."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from roughvol.errors import DatasetError, StudyError
from roughvol.store import sample_plan
from roughvol.store.run_folder import case_file, outdated, stored_ids, stored_study, strangers
from roughvol.study import Case, HeightFile, Record, Study, axes, loads
from roughvol.study.axes import Label
from roughvol.study.values.units import same

AXES = ("surface.D", "surface.H", "surface.m", "surface.n", "surface.seeds")
WORDS = ("name", "comment", "seal")  # keys and sections that change no stored number


def another_study(folder: Path, study: Study, cases: Mapping[str, Case]) -> str | None:
    """Return a message with the differences if the results in a folder are of another study, else None.

    A study with more cases, fewer cases, or equal answers is the same. A folder without a finished case has no results.
    """
    text = stored_study(folder)
    if text is None or not (stored_ids(folder) or (folder / "study.nc").exists()):
        return None
    reasons = []
    if text != study.stored():
        try:
            reasons = differences(loads(text, file=folder / "study.yaml", stored=True), study)
        except StudyError as error:
            reasons = [f"its study.yaml cannot be read: {error}"]
    first = next(iter(cases.values()), None)
    if not reasons and first is not None and first.bodies and (strange := _of_other_heights(folder, cases)):
        files = " and ".join(str(body.file) for body in first.bodies)
        reasons = [f"surface.file: the content of {files} is not that of {strange}"]
    if not reasons:
        return None
    lines = "\n".join(f"  {line}" for line in reasons)
    return (
        f"{folder} holds the results of another study:\n{lines}\n"
        "another --out keeps them, --fresh computes all anew in this folder; from Python: out=FOLDER, fresh=True"
    )


def _of_other_heights(folder: Path, cases: Mapping[str, Case]) -> str:
    """Return the id of a stored case if no stored case has the heights of one of these cases, else nothing."""
    old = outdated(folder, cases)
    strange = [id for id in strangers(folder, cases) if id not in old]
    digests = {id.rsplit("-")[-1] for id in cases}  # equal content under another name is the same study
    if not stored_ids(folder).isdisjoint(cases) or any(id.rsplit("-")[-1] in digests for id in strange):
        return ""
    heights = [json.loads(case.key_text)["surface"]["bodies"] for case in cases.values()]
    return "" if any(_bodies_of(folder, id) in heights for id in strange) else "".join(strange[:1])


def _bodies_of(folder: Path, id: str) -> Any:
    """Return the files of a stored case with the sha256 of each; nothing if the case cannot be read."""
    from roughvol.store import dataset  # xarray: a second, for this question alone

    try:
        key = json.loads(dataset.read_arrays(case_file(folder, id))[1].get("case", "{}"))
    except (DatasetError, ValueError):
        return None
    return key.get("surface", {}).get("bodies")


def differences(old: Study, new: Study) -> list[str]:
    """Return the settings that change the answer of a shared case, or of all if none is shared; a line each."""
    before, after = _keys(old), _keys(new)
    both = [name for name in AXES if name in before and name in after]
    lines = [_line(before, after, name) for name in both if _are_apart(before[name], after[name])]
    unitless = old.record.has_units != new.record.has_units
    both_of = _with_files_of(old, new), [variant.study for variant in new.variants]
    stored, asked = (_answers(combinations, unitless=unitless) for combinations in both_of)
    if stored == asked if not (old.axes or new.axes) else any(one in asked for one in stored):
        return lines
    lines += _changed(before, after, ("record", *AXES, *WORDS))
    return lines or _changed(before, after, ("record", *WORDS)) or ["the surface: its file has changed"]


def _are_apart(old: list[Any] | str, new: list[Any] | str) -> bool:
    """Return whether two lists have no value in common; the word auto is a value of its own."""
    first, second = ([values] if isinstance(values, str) else values for values in (old, new))
    return not any(value in second for value in first)


def changed_keys(old: Study, new: Study) -> list[str]:
    """Return the keys of two studies that differ and may change a number, with both values; a line each."""
    return _changed(_keys(old), _keys(new), WORDS)


def stored_in(folder: Path, study: Study) -> Study:
    """Return the study that a folder stores; without a readable one the study itself."""
    text = stored_study(folder)
    if text in (None, study.stored()):
        return study
    try:
        return loads(str(text), stored=True)
    except StudyError:
        return study


def spelled_as(study: Study, stored: Study) -> Study:
    """Return a study with the values of its keys as the lists of a stored study spell them, where these are equal."""
    keys = axes.spelled_as(study.model_dump(mode="json"), stored.model_dump(mode="json")) if stored.axes else {}
    return study.changed(**keys) if keys else study


def part(study: Study, stored: Study) -> dict[str, list[Label]]:
    """Return the labels of the lists of a stored study that a study has, by axis; empty if it has another combination.

    The stored study has no lists: empty.
    """
    labels = {_settings(variant.study): variant.labels for variant in stored.variants} if stored.axes else {}
    asked = [labels.get(_settings(variant.study), {}) for variant in study.variants]
    if not all(asked):
        return {}
    return {
        axis.name: [label for label in axis.labels if any(own[axis.name] == label for own in asked)]
        for axis in stored.axes
    }


def cases_of_stored(stored: Study, study: Study, folder: Path) -> set[str]:
    """Return the ids of the cases of a stored study, which has the height files of another study."""
    return {id for one in _with_files_of(stored, study) for id in sample_plan.cases_of(one, folder)}


def _settings(study: Study) -> str:
    """Return the keys of a study that may change a number, as text."""
    return json.dumps({name: value for name, value in _keys(study).items() if name.partition(".")[0] not in WORDS})


def _keys(study: Study) -> dict[str, Any]:
    """Return the dotted keys of a study, as in files of results."""
    return dict(_flat(study.model_dump(mode="json", context={"stored": True})))


def _changed(before: Mapping[str, Any], after: Mapping[str, Any], left_out: Collection[str]) -> list[str]:
    def differ(name: str) -> bool:
        old, new = before.get(name), after.get(name)
        return old != new if name == "surface.L" else not same(old, new)  # stored lengths have the unit of L

    names = [name for name in dict.fromkeys([*before, *after]) if differ(name)]
    names = [name for name in names if name not in left_out and name.partition(".")[0] not in left_out]
    return [_line(before, after, name) for name in names]


def _with_files_of(old: Study, new: Study) -> list[Study]:
    """Return the combinations of a stored study with the paths of the height files of a new one."""
    given, found = new.surface, []
    for study in (variant.study for variant in old.variants):
        surface = study.surface
        if isinstance(surface, HeightFile) and isinstance(given, HeightFile):
            against = surface.against
            if against is not None and given.against is not None:
                against = against.model_copy(update={"file": given.against.file})
            surface = surface.model_copy(update={"file": given.file, "files": given.files, "against": against})
        found.append(study.model_copy(update={"surface": surface}))
    return found


def _answers(combinations: Sequence[Study], *, unitless: bool) -> list[dict[str, Any]]:
    """Return the part of the key that all cases of a combination share, for each; nothing without height files.

    What is recorded is no part of it: stored cases stay beside those with other records. Recorded states with a unit
    bring the modulus and Sq into the key; ``unitless`` leaves them out.
    """
    found = []
    try:
        for study in combinations:
            case = study.cases()[0]
            key = json.loads((replace(case, record=Record()) if unitless else case).key_text)
            key["surface"] = {name: value for name, value in key["surface"].items() if name not in ("D", "m", "seed")}
            del key["record"]
            found.append(key)
    except StudyError:
        return []
    return found


def _flat(data: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted keys and the values of nested mappings."""
    for name, value in data.items():
        if isinstance(value, Mapping) and value:
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def _line(before: Mapping[str, Any], after: Mapping[str, Any], name: str) -> str:
    """Return a key with its two values; lists of one item as that item."""
    values = [keys[name] for keys in (before, after) if name in keys]
    if all(isinstance(value, list) and len(value) == 1 for value in values):
        values = [value[0] for value in values]
    texts = iter([json.dumps(value, ensure_ascii=False) for value in values])
    shown = [next(texts) if name in keys else "absent" for keys in (before, after)]
    return f"{name}: {' → '.join(shown)}"
