"""A study of 0.11.1 means the same, or is refused with the new key: all keys of its schema, and studies with each."""

import re
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from roughvol import spellings
from roughvol.errors import RoughvolDeprecation, StudyError
from roughvol.study import loads
from roughvol.study.reference import keys
from tests.kit import call, succeeded
from tests.stored_runs.archive import of_oldest

OLDEST = of_oldest()
CHOSEN = {("sweep.steps", "auto"): 20}  # where an ensemble has no sweep.steps: the page says so


def test_every_key_has_its_words_and_its_default() -> None:
    for path, values, default in OLDEST["keys"]:
        if row := spellings.former("key", path):
            assert row.works, path
            continue
        now = [key for key in keys() if key.path == path]
        # surface.file had to be given, and may stand in surface.files
        assert default in [key.default for key in now] or (path == "surface.file" and default is None), path
        allowed = {word for key in now for word in re.findall(r"'([^']+)'", key.values)}
        gone = [word for word in re.findall(r"'([^']+)'", values) if word not in allowed]
        assert [word for word in gone if not spellings.former("key", f"{path}={word}")] == [], path


@pytest.mark.parametrize("name", OLDEST["studies"])
def test_a_study_means_the_same_or_is_refused_with_the_new_key(name: str) -> None:
    text, before = OLDEST["studies"][name]["text"], dict(_flat(OLDEST["studies"][name]["loaded"]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RoughvolDeprecation)
        try:
            study = loads(text, "study.yaml", stored=True)
        except StudyError as error:
            left = [row for row in spellings.of("key") if not row.works]
            named = [any(row.message in problem.message for row in left) for problem in error.problems]
            assert all(named)
            return
    now = dict(_flat(study.model_dump(mode="json", context={"stored": True})))
    for path, value in before.items():
        row = spellings.former("key", path)
        new, wanted = (row.new, row.values[value]) if row else (path, value)
        assert now.pop(new) == CHOSEN.get((new, str(wanted)), wanted), path
    defaults = {key.path: key.default for key in keys()}
    for path, value in now.items():  # keys that are new have values that change nothing
        assert value in (None, False, {}, 1e-4) or defaults[path] == str(value), path


def _flat(data: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and values; those of legs with their place."""
    for name, value in data.items():
        if isinstance(value, Mapping) and value:
            yield from _flat(value, f"{before}{name}.")
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            for place, item in enumerate(value):
                yield from _flat(item, f"{before}{name}[{place}].")
        else:
            yield f"{before}{name}", value


def test_the_studies_have_every_key() -> None:
    given = " ".join(study["text"] for study in OLDEST["studies"].values())
    names = {path.rpartition(".")[2] for path, _, _ in OLDEST["keys"]}
    assert [name for name in names if not re.search(rf"\b{name}\b", given)] == []


def test_the_default_of_height_files_that_changed_is_said(here: Path) -> None:
    np.save("z.npy", np.random.default_rng(0).random((6, 6)))
    text = "surface: {file: z.npy, L: 1%s}\nsweep: {steps: 1, to: {pressure: 0.1}}\n"
    said = "surface.sides is not given: height files are mirrored at their sides; before version 0.16"
    for sides, times in (("", 1), (", sides: mirrored", 0)):
        Path("s.yaml").write_text(text % sides, encoding="utf-8")
        done = succeeded("run", "s.yaml", "--fresh")
        assert done.stderr.count(said) == times
        assert said not in call("run", "s.yaml").stderr  # nothing is computed
    Path("s.yaml").write_text(text % "", encoding="utf-8")
    assert [call("card", "s.yaml", "--json").stderr.count(said) for _ in range(2)] == [1, 0]
