"""The ledger: it spares `status` a look at the files, and no state of it makes a wrong file pass."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from roughvol.campaign import batch, running
from roughvol.store import ledger, run_folder, run_status
from roughvol.store.run_folder import case_file, ledger_file
from roughvol.study import Study, loads

TEXT = "name: small\nsurface: {D: 2.4, m: 2, seeds: 3}\nsweep: {steps: 2}\n"


@pytest.fixture(scope="module")
def study() -> Study:
    return loads(TEXT)


@pytest.fixture(scope="module")
def finished(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("finished")
    running.run(study, out=place, jobs=1)
    return place


@pytest.fixture
def place(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "run"))  # with the times of the files


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, bool]]:
    """The files that are opened, and whether all of it is read."""
    found: list[tuple[str, bool]] = []
    look = run_folder.examined

    def watched(path: Path, case: running.Case, *, whole: bool) -> run_folder.Examined:
        found.append((path.stem, whole))
        return look(path, case, whole=whole)

    monkeypatch.setattr(run_folder, "examined", watched)
    return found


def test_status_opens_no_file_that_a_run_has_stored(study: Study, place: Path, opened: list[tuple[str, bool]]) -> None:
    assert len(run_status.status(study, place).done) == 3
    assert opened == []


def test_a_run_that_was_killed_has_noted_what_it_stored(study: Study, place: Path) -> None:
    before = ledger.read(ledger_file(place))
    more = loads(TEXT.replace("seeds: 3", "seeds: 4"))

    def kill(now: batch.Progress) -> None:
        if now.done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        running.run(more, out=place, jobs=1, on_event=kill)
    assert {id: entry.seen for id, entry in ledger.read(ledger_file(place)).items()} == ledger.files(
        place / "cases", ".nc"
    )
    assert len(before) + 1 == len(ledger.read(ledger_file(place)))


def _forget(path: Path) -> None:
    path.unlink()


def _tear(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-9])


def _spoil(path: Path) -> None:
    path.write_bytes(b"\xff\xfe" + np.random.default_rng(5).bytes(500))


def _as_version_0_7_wrote_it(path: Path) -> None:
    head, *lines = path.read_text().splitlines()
    old = [head.replace('"ledger": 2', '"version": "0.7.0"'), *(line.rsplit(" ", 1)[0] for line in lines)]
    path.write_text("\n".join([*old, ""]))


@pytest.mark.parametrize("harm", [_forget, _tear, _spoil, _as_version_0_7_wrote_it])
def test_a_ledger_that_is_damaged_or_old_costs_a_look_at_the_files_and_no_more(
    study: Study, place: Path, opened: list[tuple[str, bool]], harm: Callable[[Path], None]
) -> None:
    harm(ledger_file(place))
    assert len(run_status.status(study, place).done) == 3
    assert opened
    with ledger_file(place).open("a") as stream:
        stream.write("x 1\nx y z\nx -1 ² 3\n\n")
    assert len(run_status.status(study, place).done) == 3


def test_a_file_that_has_changed_since_is_read_whole_and_named(
    study: Study, place: Path, opened: list[tuple[str, bool]]
) -> None:
    id = study.cases()[1].id
    content = bytearray(case_file(place, id).read_bytes())
    content[len(content) // 2] ^= 1
    case_file(place, id).write_bytes(content)
    found = run_status.status(study, place)
    assert list(found.damaged) == [id]
    assert "has been altered" in found.damaged[id]
    assert opened == [(id, True)]


def test_what_the_ledger_says_is_no_proof_for_a_run(study: Study, place: Path) -> None:
    id = study.cases()[1].id
    before = case_file(place, id).stat()
    content = bytearray(case_file(place, id).read_bytes())
    content[len(content) // 2] ^= 1
    case_file(place, id).write_bytes(content)
    os.utime(case_file(place, id), ns=(before.st_atime_ns, before.st_mtime_ns))  # as a disk alters a bit
    (place / "study.nc").unlink()
    assert len(run_status.status(study, place).done) == 3
    assert running.collect(study, place).converged.sum() == 4
    notices: list[str] = []
    running.run(study, out=place, jobs=1, on_event=lambda now: notices.append(now.notice))
    assert sum("has been altered" in notice for notice in notices) == 1
    assert running.collect(study, place).converged.sum() == 6


def test_a_ledger_that_cannot_be_written_stops_nothing(study: Study, tmp_path: Path) -> None:
    ledger_file(tmp_path).mkdir(parents=True)
    running.run(study, out=tmp_path, jobs=1)
    assert len(run_status.status(study, tmp_path).done) == 3


def test_what_is_written_is_read(tmp_path: Path) -> None:
    seen = {"a-1": ledger.Entry((12, 1_700_000_000_123_456_789), "0.7.0"), "b_2.5": ledger.Entry((0, 0), "1.0rc1")}
    ledger.write(tmp_path / "ledger", seen)
    assert ledger.read(tmp_path / "ledger") == seen
    (tmp_path / "c.nc").write_bytes(b"123")
    ledger.add(tmp_path / "ledger", "c", tmp_path / "c.nc", "0.8")
    assert ledger.read(tmp_path / "ledger") == seen | {"c": ledger.Entry(ledger.files(tmp_path, ".nc")["c"], "0.8")}
    assert ledger.files(tmp_path / "nowhere", ".nc") == ledger.read(tmp_path / "nothing") == {}
