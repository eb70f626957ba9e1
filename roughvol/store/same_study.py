"""Whether the results in a folder are those of a study: `run` and `status` both ask here, and answer alike."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from roughvol.errors import FolderError, StudyError
from roughvol.store.run_folder import outdated, stored_study, strangers
from roughvol.study import Case, HeightFile, Study, loads


def check_same_study(folder: Path, study: Study, cases: Mapping[str, Case]) -> None:
    """Refuse a folder that holds another study, see `another_study`: `run` and `status` both ask here.

    Raises
    ------
    FolderError
        With every difference.
    """
    if message := another_study(folder, study, cases):
        raise FolderError(message)


def another_study(folder: Path, study: Study, cases: Mapping[str, Case]) -> str | None:
    """Return why the results in a folder are of another study, None if they are not.

    A study that adds cases, leaves some out, or changes no answer is the same.
    """
    text = stored_study(folder)
    if text is None:
        return None
    found = []
    if text != study.stored():
        try:
            found = differences(loads(text, file=folder / "study.yaml", stored=True), study)
        except StudyError as error:
            found = [f"its study.yaml cannot be read: {error}"]
    first = next(iter(cases.values()))
    if not found and first.file is not None:
        same, old = first.id.rsplit("-")[-1], outdated(folder, cases)
        # One of our content under another name is no other study.
        strange = [id for id in strangers(folder, cases) if id not in old and id.rsplit("-")[-1] != same]
        if strange:
            files = " and ".join(str(body.file) for body in first.bodies)
            found = [f"surface.file: the content of {files} is not that of {strange[0]}"]
    if not found:
        return None
    lines = "\n".join(f"  {line}" for line in found)
    return (
        f"{folder} holds the results of another study:\n{lines}\n"
        "give another --out to keep them, or --fresh to compute all anew in this folder"
    )


def differences(old: Study, new: Study) -> list[str]:
    """Return what makes two studies disagree about a case they share, or that they share none; a line each."""
    before, after = (dict(_flat(study.model_dump(mode="json", context={"stored": True}))) for study in (old, new))
    lines, shared = [], True
    axes = ("surface.D", "surface.m", "surface.seeds")
    for name in axes:
        if name in before and name in after:
            gone = [value for value in before[name] if value not in after[name]]
            shared = shared and len(gone) < len(before[name])
            if gone:
                lines.append(f"{name}: no longer {', '.join(map(str, gone))}")
    if _answers(_there(old, new)) == _answers(new):
        return [] if shared else lines
    for name in dict.fromkeys([*before, *after]):
        if before.get(name) != after.get(name) and name not in (*axes, "name"):
            lines.append(f"{name}: {_shown(before, name)} → {_shown(after, name)}")
    return lines or ["the surface: its file has changed"]


def _there(old: Study, new: Study) -> Study:
    """Return a stored study with its height files where a new one has them: that decides nothing by itself."""
    surface, given = old.surface, new.surface
    if not isinstance(surface, HeightFile) or not isinstance(given, HeightFile):
        return old
    against = surface.against
    if against is not None and given.against is not None:
        against = against.model_copy(update={"file": given.against.file})
    return old.model_copy(update={"surface": surface.model_copy(update={"file": given.file, "against": against})})


def _answers(study: Study) -> dict[str, Any] | None:
    """Return what all cases of a study share of what changes their answers."""
    try:
        key = study.cases()[0].key
    except StudyError:  # the height file of then is no more
        return None
    key["surface"] = {name: value for name, value in key["surface"].items() if name not in ("D", "m", "seed")}
    return dict(json.loads(json.dumps(key)))


def _flat(data: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in data.items():
        if isinstance(value, Mapping) and value:
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def _shown(values: Mapping[str, Any], name: str) -> str:
    return "not there" if name not in values else json.dumps(values[name], ensure_ascii=False)
