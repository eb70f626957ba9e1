"""Cases that other runs under one root have finished."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import roughvol
from roughvol.campaign import batch, shared_cases
from roughvol.cli import main
from roughvol.store import dataset, run_status, stamped_file
from roughvol.store.same_study import differences
from roughvol.study import loads

TEXT = """
surface: {D: 2.4, m: 4, seeds: 2}
sweep: {steps: 4, to: {pressure: 1}}
record: {fields_at: {pressure: 0.5, step: [2, 4]}, transport: {transmissivity: every-step}}
"""
VARYING = ("wall_time", "observable_time", "transport_time", "level_convolutions")


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def idle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make every solve an error."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a case is computed")

    monkeypatch.setattr(batch.Batch, "through", refuse)


def _values(ds: xr.Dataset) -> xr.Dataset:
    return dataset.answers(ds).drop_vars(VARYING, errors="ignore")


def _changed(record: str) -> str:
    return f"{TEXT[: TEXT.index('record:')]}record: {{{record}}}\n"


def test_another_record_is_computed_and_keeps_the_old_cases_until_then(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    old, new = loads(TEXT, "x.yaml"), loads(_changed("transport: {percolation: every-step}"), "x.yaml")
    before = roughvol.run(old, jobs=1)
    files = {path: path.read_bytes() for path in Path("runs/x/cases").glob("*.nc")}

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(batch.Batch, "through", interrupted)
        with pytest.raises(KeyboardInterrupt):
            roughvol.run(new, jobs=1)
    assert {path: path.read_bytes() for path in files} == files  # a kill loses nothing
    xr.testing.assert_identical(_values(dataset.read(Path("runs/x/study.nc"))), _values(before))
    assert not run_status.status(new).collected
    after = roughvol.run(new, jobs=1)  # no --fresh
    assert "percolates" in after
    xr.testing.assert_identical(after.free_volume, before.free_volume)
    assert {path: path.read_bytes() for path in files} == files
    assert run_status.status(new).collected


def test_going_back_to_the_old_record_computes_nothing(request: pytest.FixtureRequest) -> None:
    roughvol.run(loads(TEXT, "x.yaml"), jobs=1)
    roughvol.run(loads(_changed("transport: {percolation: every-step}"), "x.yaml"), jobs=1)
    request.getfixturevalue("idle")
    assert "gap" in roughvol.run(loads(TEXT, "x.yaml"), jobs=1)


def test_a_renamed_or_commented_study_and_one_with_shared_cases_compute_nothing(
    request: pytest.FixtureRequest,
) -> None:
    first = roughvol.run(loads(TEXT, "x.yaml"), jobs=1)
    request.getfixturevalue("idle")
    Path("y.yaml").write_text(f"comment: the same\n{TEXT.replace('seeds: 2', 'seeds: [1]')}")
    done = CliRunner().invoke(main, ["run", "y.yaml", "--jobs", "1"])
    assert done.exit_code == 0, done.output
    assert "1 finished in other runs" in done.stderr
    again = dataset.read(Path("runs/y/study.nc"))
    assert (again.free_volume.sel(seed=1) == first.free_volume.sel(seed=1)).all()
    name = next(Path("runs/y/cases").glob("*.nc"))
    assert name.read_bytes() == (Path("runs/x/cases") / name.name).read_bytes()


def test_damaged_files_and_other_formats_of_a_sibling_are_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    roughvol.run(loads(TEXT, "x.yaml"), jobs=1)
    one, other = sorted(Path("runs/x/cases").glob("*.nc"))
    content = bytearray(one.read_bytes())
    content[len(content) // 2] ^= 1
    one.write_bytes(content)
    content, labels = stamped_file.verified(other)
    stamped_file.store(other, stamped_file.stamped(content, labels | {"format_of_answers": "2"}))
    computed: list[str] = []
    through = batch.Batch.through
    monkeypatch.setattr(
        batch.Batch,
        "through",
        lambda self, *args: (computed.extend(case.id for case in self._cases), through(self, *args))[1],
    )
    roughvol.run(loads(TEXT, "y.yaml"), jobs=1)
    assert sorted(computed) == [one.stem, other.stem]


def test_runs_outside_a_root_share_nothing(tmp_path: Path) -> None:
    study = loads(TEXT, "x.yaml")
    roughvol.run(study, out=tmp_path / "a", jobs=1)
    assert shared_cases.taken(tmp_path / "b", study.cases()) == []


def test_a_region_of_its_own_is_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    first = roughvol.run(loads(TEXT, "x.yaml"), jobs=1)
    inner = roughvol.run(loads(_changed("region: interior"), "x.yaml"), jobs=1)
    assert not np.allclose(first.contact_area_fraction, inner.contact_area_fraction)


def test_a_changed_record_is_no_reason_to_refuse_a_folder() -> None:
    text = "surface: {D: 2.3, m: 3, seeds: 1}\n"
    old = loads(text + "sweep: {steps: 4}\nrecord: {volume_density: {}}\ncomment: four", "x.yaml")
    assert differences(old, loads(text + "sweep: {steps: 3}", "x.yaml")) == ["sweep.steps: 4 → 3"]
