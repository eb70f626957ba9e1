"""Files of a user are whole or stay as they were, and what cannot be printed ends no work."""

import contextlib
import errno
import io
import os
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from roughvol.cli import main
from roughvol.store import stamped_file
from tests.kit import LEAKING, ran, refused, said, without_figures

pytestmark = pytest.mark.usefixtures("no_figures")

MAP = LEAKING.replace("{D: 2.3, m: 4, seeds: 1, L: 100 um, Sq: 1 um}", "{file: map.txt, L: 100 um, heights_unit: um}")
CREEP = ["creep", "tiny", "--law", "creep.yaml", "--at", "pressure=0.2 MPa", "--times", "1 s..1 h"]
COMMANDS = {
    "png": ["plot", "tiny", "v_of_p"],
    "csv": ["plot", "tiny", "v_of_p", "--format", "csv"],
    "report": ["report", "tiny"],
    "creep": CREEP,
    "look": ["check", "tiny.yaml", "--look"],
    "card": ["card", "map.yaml", "--jobs", "1"],
}


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with contextlib.chdir(folder := tmp_path_factory.mktemp("computed")), without_figures():
        Path("map.yaml").write_text(MAP, encoding="utf-8")
        Path("creep.yaml").write_text("power: {exponent: 0.02, time: 1 s}\n", encoding="utf-8")
        np.savetxt("map.txt", np.random.default_rng(1).normal(size=(17, 17)))
        ran("tiny", LEAKING)
        for command in COMMANDS.values():
            said(*command)
    return folder


@pytest.fixture
def place(computed: Path, here: Path) -> Path:
    return Path(shutil.copytree(computed, here, dirs_exist_ok=True))


@contextlib.contextmanager
def _no_file_beyond(size: int) -> Iterator[None]:
    """Let no file grow beyond a size, as a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def _files(folder: Path) -> dict[str, bytes]:
    names = ("*.png", "*.pdf", "*.svg", "*.csv", "*.html", "*.md", "claims.json")
    return {str(path): path.read_bytes() for name in names for path in folder.rglob(name)}


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_a_disk_that_is_full_leaves_the_files_of_a_user_as_they_were(place: Path, command: list[str]) -> None:
    before = _files(place)
    assert before
    with _no_file_beyond(10_000 if command[0] == "card" else 256):  # its runs write small files first
        told = refused(*command)
    assert "cannot write" in told
    assert _files(place) == before
    assert not [path for path in place.rglob("*") if path.name.endswith(".part")]


def test_a_folder_that_cannot_be_made_is_named(place: Path) -> None:
    folder = place / "tiny.yaml" / "figures"
    for command in ([*COMMANDS["png"], "a_of_p"], COMMANDS["csv"], COMMANDS["report"]):
        told = refused(*command, "--out", folder)
        assert told.count(f"cannot write {folder}: Not a directory") == 1


def test_a_device_is_written_and_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    stamped_file.store(pipe, b"content")
    assert os.read(reader, 100) == b"content"
    assert pipe.is_fifo()


def _shell(place: Path, line: str) -> subprocess.CompletedProcess[str]:
    command = f"{sys.executable} -m roughvol"
    there = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), "OMP_NUM_THREADS": "1"}
    line = line.replace("roughvol", command)
    return subprocess.run(["bash", "-c", line], cwd=place, env=there, capture_output=True, text=True, timeout=120)


def test_a_closed_pipe_does_not_keep_a_command_from_its_files(
    place: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    made = place / "runs" / "tiny" / "creep.png"
    made.unlink()
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w") as closed:  # noqa: PTH123  # its end raises as that of Python, where the stream is not silenced
        monkeypatch.setattr(sys, "stdout", closed)
        main(CREEP, standalone_mode=False)
    assert made.is_file()
    assert capfd.readouterr().err == ""


def test_a_closed_standard_error_does_not_end_a_command(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", None)  # as Python has it where it was closed
    assert main(["run", "tiny.yaml"], standalone_mode=False) is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"surface: {D: 2.3, m: 4}\ncomment: \xff", "  <stdin>:2: not YAML"),
        (None, "  <stdin>: a study is a mapping"),  # it was closed
    ],
)
def test_a_standard_input_that_is_no_text_is_one_message(
    text: bytes | None, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", text and io.TextIOWrapper(io.BytesIO(text), "utf-8", "strict"))
    with pytest.raises(SystemExit, match="2"):
        main(["check", "-"])
    assert capsys.readouterr().err.startswith(f"1 problem\n{words}")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize("command", ["ls", "--help"])
def test_an_output_that_cannot_be_written_is_one_message(place: Path, command: str) -> None:
    done = _shell(place, f"roughvol {command} > /dev/full")
    assert done.returncode in (1, 2)
    (message,) = done.stderr.splitlines()
    assert re.match(r"(?i)error: ", message)
    assert os.strerror(errno.ENOSPC) in message


@pytest.mark.parametrize(
    ("files", "command"),
    [
        pytest.param(8, "report tiny", marks=pytest.mark.slow),
        (12, "run tiny.yaml --set name=many --set surface.seeds=3 --jobs 2"),
    ],
)
def test_too_few_open_files_are_one_message_or_enough(place: Path, files: int, command: str) -> None:
    done = _shell(place, f"ulimit -n {files}; roughvol {command}")
    assert "Traceback" not in done.stderr
    if done.returncode:
        assert "ulimit -n" in done.stderr.splitlines()[-1]
