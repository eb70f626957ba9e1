"""Too little memory: one line and an exit code, wherever it is noticed."""

from __future__ import annotations

import errno
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from roughvol.campaign import batch, limits, resources, running
from roughvol.cli import main
from roughvol.errors import CampaignError
from roughvol.study import loads

TEXT = "name: s\nsurface: {D: 2.4, m: 3, seeds: 1}\nsweep: {steps: 2}\n"


@pytest.fixture
def study(tmp_path: Path) -> str:
    (tmp_path / "s.yaml").write_text(TEXT)
    return str(tmp_path / "s.yaml")


@pytest.mark.skipif(limits.resource is None, reason="this system limits no address space")
@pytest.mark.parametrize("kilobytes", [100_000, 300_000])
def test_a_narrow_limit_is_told_in_one_line_before_any_library_is_loaded(study: str, kilobytes: int) -> None:
    code = (
        "import resource, sys\n"
        f"resource.setrlimit(resource.RLIMIT_AS, ({kilobytes} * 1024,) * 2)\n"
        "from roughvol.cli import main\nmain(prog_name='roughvol')"
    )
    done = subprocess.run([sys.executable, "-c", code, "run", study], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: not enough memory: the limit of address space is ")


def test_a_limit_too_narrow_for_a_case_is_told_before_it_starts(
    study: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "address_space", lambda: limits.needed() + 1e6)
    for call in (["check", study], ["run", study, "--out", str(tmp_path / "out")]):
        refused = CliRunner().invoke(main, call)
        assert refused.exit_code == 1
        assert refused.stderr.startswith("error: not enough memory: D = 2.40, m = 3, seed 0 needs about ")
        assert len(refused.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def _as_scipy_says_it() -> ImportError:
    error = ImportError("the install seems to be broken, try reinstalling")
    error.__cause__ = ImportError("_cyutility.so: failed to map segment from shared object")
    return error


LACKING = [MemoryError(), OSError(errno.ENOMEM, "Cannot allocate memory"), _as_scipy_says_it()]
LACKING += [RuntimeError("can't start new thread")]


@pytest.mark.parametrize("error", LACKING, ids=lambda error: type(error).__name__)
def test_memory_that_runs_out_is_one_line(study: str, monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(running, "run", fail)
    done = CliRunner().invoke(main, ["run", study])
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: not enough memory (")


@pytest.mark.parametrize("error", LACKING, ids=lambda error: type(error).__name__)
def test_memory_that_runs_out_in_a_case_is_its_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(batch, "file_of_case", fail)
    with pytest.raises(CampaignError, match=r"1 of 1 cases failed\n.*: not enough memory$"):
        running.run(loads(TEXT), out=tmp_path)


@pytest.mark.parametrize("error", [ImportError("no module named x"), OSError(errno.EIO, "x"), RuntimeError("x")])
def test_other_errors_are_not_taken_for_it(study: str, monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(running, "run", fail)
    assert CliRunner().invoke(main, ["run", study]).exception is error


def test_without_a_limit_nothing_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "address_space", lambda: None)
    assert limits.too_narrow() == ""
    resources.check_resources(loads(TEXT).cases(), [81], 1e6, tmp_path / "nowhere" / "yet")


def test_a_folder_with_a_name_too_long_is_refused_in_one_line(study: str, tmp_path: Path) -> None:
    folder = tmp_path / ("a" * 300)
    assert resources.free_disk(folder / "b") == resources.free_disk(tmp_path)
    shown = CliRunner().invoke(main, ["run", study, "--out", str(folder)])
    assert shown.exit_code == 2
    assert shown.output.strip().splitlines()[-1] == f"error: cannot write {folder}: File name too long"
