"""Checkpoints: a sweep that broke off goes on to the last bit, and what is damaged or foreign is as good as none."""

import io
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from roughvol.campaign import batch
from roughvol.campaign.one_case import Context, run_case
from roughvol.store import checkpoint, lock, run_folder, stamped_file
from roughvol.store.checkpoint import Checkpoint, packed, unpacked
from roughvol.study import ANSWER_FORMAT, Case, loads
from tests.campaign.kit import values_of

TEXT = """
name: long
surface: {D: 2.4, m: 4, seeds: 2}
material: {E_star: 1.0, hardness: 0.05, plastic: false}
sweep: {steps: 5, to: {contact_area: 0.3}}
record:
  fields_at: {step: [2, 4]}
  box_counting: {at: {contact_area: [0.02, 0.2]}}
  volume_density: {bins: 9, at: {contact_area: [0.02, 0.2], separation: -9}}
  transport: {percolation: every-step, constriction: {step: [1, 4]}, flux_at: {step: [2, 4]}}
"""


@pytest.fixture
def case(monkeypatch: pytest.MonkeyPatch) -> Case:
    monkeypatch.setattr(checkpoint, "NODES", 0)
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)
    return loads(TEXT).cases()[0]


def _stop_at(step: int) -> Any:
    def stop(now: int) -> None:
        if now == step:
            raise KeyboardInterrupt

    return stop


@pytest.mark.parametrize("step", [1, 3, 5])
def test_a_case_killed_after_any_step_goes_on_bit_for_bit(case: Case, tmp_path: Path, step: int) -> None:
    undisturbed, path, solved = run_case(case), tmp_path / ".checkpoint", []
    with pytest.raises(KeyboardInterrupt):
        run_case(case, Context(on_step=_stop_at(step), checkpoint=path))
    result = run_case(case, Context(on_step=solved.append, checkpoint=path))
    assert solved == list(range(step, 6))  # the step at which it was killed was not yet kept
    xr.testing.assert_identical(values_of(result), values_of(undisturbed))


def test_damaged_and_foreign_checkpoints_are_as_good_as_none(case: Case, tmp_path: Path) -> None:
    path = tmp_path / "c"
    mine = Checkpoint(path, case, "1")
    mine.save({"a": [1.5, np.arange(3)]})
    content = path.read_bytes()
    assert mine.load() is not None
    assert Checkpoint(path, loads(TEXT).cases()[1], "1").load() is None
    assert Checkpoint(path, case, "2").load() is None  # of other libraries or vector units
    assert {"numpy", "scipy", "pyfftw", "numba"} <= set(checkpoint.numerics().replace(",", "").split())
    for spoilt in (b"", content[:-1], content[:99], content[:50] + b"\x00" + content[51:], b"x" * 500):
        path.write_bytes(spoilt)
        assert mine.load() is None
    path.unlink()
    assert mine.load() is None


def test_nothing_is_unpickled(case: Case, tmp_path: Path) -> None:
    stream = io.BytesIO()
    np.savez(stream, text=np.array([{"a": 1}], dtype=object), allow_pickle=True)
    mine = Checkpoint(tmp_path / "c", case, "1")
    mine.save({})
    _, labels = stamped_file.verified(tmp_path / "c")
    (tmp_path / "c").write_bytes(stamped_file.stamped(stream.getvalue(), labels))
    assert mine.load() is None


def test_a_checkpoint_that_cannot_be_written_stops_nothing(case: Case, tmp_path: Path) -> None:
    assert run_case(case, Context(checkpoint=tmp_path / "no" / "c")).converged.all()


@pytest.mark.parametrize("shared", [True, False])
def test_a_worker_writes_checkpoints_only_into_its_run(case: Case, tmp_path: Path, shared: bool) -> None:
    def run_task(path: Path, mark: str) -> None:
        task = batch.Task(case, Context(checkpoint=path), mark, ANSWER_FORMAT)
        batch.run_task(task, lambda message: None, lambda: False)

    with lock.opened(tmp_path):
        mark = lock.mark(tmp_path)
        path = run_folder.checkpoint_file(tmp_path, case.id)
        run_task(path, mark if shared else mark.replace("2", "3"))
        run_task(path.with_name("other"), "")
    assert path.exists() is shared
    assert not path.with_name("other").exists()


def test_what_is_packed_comes_back() -> None:
    state = {"a": [0.1, 1e-300, True, None, "é", [np.float64(0.1) / 3]], "b": {"c": np.array([np.nan, -0.0])}}
    back = unpacked(packed(state))
    assert back["a"][:5] == state["a"][:5]
    assert float(back["a"][5][0]) == 0.1 / 3
    np.testing.assert_array_equal(back["b"]["c"], state["b"]["c"])
    assert zipfile.is_zipfile(io.BytesIO(packed(state)))


@pytest.mark.slow
def test_a_large_case_killed_in_its_sweep_goes_on_from_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "surface: {D: 2.3, m: 10, seeds: 1}\nsweep: {steps: 8, to: {indentation: 1.0}}\nsolver: {accuracy: draft}\n"
    code = (
        "import os, sys\nfrom pathlib import Path\nfrom roughvol.store import checkpoint\n"
        "from roughvol.campaign.one_case import Context, run_case\nfrom roughvol.study import loads\n"
        "checkpoint.EVERY = 0.0\n"
        "kill = lambda step: os.kill(os.getpid(), 9) if step == 5 else None\n"
        "run_case(loads(sys.argv[1]).cases()[0], Context(checkpoint=Path(sys.argv[2]), on_step=kill))\n"
    )
    case, path, solved = loads(text).cases()[0], tmp_path / "c", []
    done = subprocess.run([sys.executable, "-c", code, text, str(path)], timeout=300, env=os.environ)
    assert done.returncode == -9
    result = run_case(case, Context(checkpoint=path, on_step=solved.append))
    assert solved == [5, 6, 7, 8]
    xr.testing.assert_identical(values_of(result), values_of(run_case(case)))
