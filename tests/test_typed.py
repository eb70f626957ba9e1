"""Types of the installed package: mypy --strict passes a program of a user, and finds each fault in wrong calls."""

import re
import subprocess
import sys
import venv
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

import roughvol
from tests.test_packaging import ROOT, wheel

PROGRAM, WRONG = (Path(__file__).with_name("typed") / name for name in ("program.py", "wrong.py"))
PAGE = ROOT / "docs" / "reference" / "python.md"
__all__ = ["wheel"]  # a fixture


@pytest.fixture(scope="module")
def faults(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[int, str]]:
    """Faults that mypy finds, by file and line; the package is the wheel, installed in an environment of its own."""
    pytest.importorskip("mypy", reason="needs roughvol[dev]")
    folder = tmp_path_factory.mktemp("user")
    venv.create(folder / "venv", symlinks=True)
    python = folder / "venv" / "bin" / "python"
    (site,) = (folder / "venv").glob("lib/python*/site-packages")
    with zipfile.ZipFile(wheel) as held:
        held.extractall(site)
    others = [path for path in sys.path if path.endswith("site-packages")]  # numpy, xarray, pint
    (site / "others.pth").write_text("\n".join(others), encoding="utf-8")
    for file in (PROGRAM, WRONG):
        (folder / file.name).write_bytes(file.read_bytes())
    # of the optional packages nothing is asked: they take half of the time
    skipped = "[mypy]\n[mypy-numba.*,distributed.*,dask.*,IPython.*]\nfollow_imports = skip\n"
    (folder / "mypy.ini").write_text(skipped, encoding="utf-8")
    options = ("--strict", "--config-file=mypy.ini", "--no-error-summary", f"--python-executable={python}")
    cache = f"--cache-dir={ROOT / '.mypy_cache' / 'user'}"
    words = (sys.executable, "-m", "mypy", *options, cache, PROGRAM.name, WRONG.name)
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=290)
    assert done.returncode in (0, 1), done.stderr
    found: dict[str, dict[int, str]] = {PROGRAM.name: {}, WRONG.name: {}}
    for name, line, message in re.findall(r"^(\w+\.py):(\d+): error: (.*)", done.stdout, re.MULTILINE):
        found[name][int(line)] = message
    return found


def test_a_program_of_a_user_has_no_fault(faults: dict[str, dict[int, str]]) -> None:
    assert faults[PROGRAM.name] == {}


def test_every_wrong_call_is_found_and_no_other(faults: dict[str, dict[int, str]]) -> None:
    lines = WRONG.read_text(encoding="utf-8").splitlines()
    wrong = {number for number, line in enumerate(lines, 1) if line.endswith("# wrong")}
    assert len(wrong) > 15
    assert set(faults[WRONG.name]) == wrong


def test_the_program_uses_every_public_function() -> None:
    text = PROGRAM.read_text(encoding="utf-8")
    public = {f"roughvol.{name}" for name in roughvol.__all__ if not isinstance(getattr(roughvol, name), ModuleType)}
    named = re.findall(r"^.. auto(?:function|class):: (\S+)", PAGE.read_text("utf-8"), re.M)
    on_page = {name.rpartition(".")[2] for name in named}
    assert {name for name in public if name not in text} == set()
    assert {name for name in on_page if not re.search(rf"\b{name}\b", text)} == set()
