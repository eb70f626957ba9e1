"""The command line: exit codes, one clear message, nothing written for nothing, and the same answer as from Python."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import yaml
from click.testing import CliRunner

import roughvol
from roughvol.cli import main
from roughvol.errors import FolderError
from roughvol.store import dataset
from tests.campaign.kit import values_of
from tests.kit import LEAKING, call, python, ran, refused, said, succeeded

TEXT = """
name: tiny
surface: {D: [2.2, 2.7], m: [3, 4], seeds: 2, L: 10.0}
sweep: {steps: 6, to: mean-plane}
record:
  volume_density: {bins: 9, at: {separation: -2, step: 6}}
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a study file and what `roughvol run` made of it under runs/."""
    place = tmp_path_factory.mktemp("place")
    (place / "tiny.yaml").write_text(TEXT)
    done = succeeded("run", place / "tiny.yaml", "--jobs", "2", "--out", place / "runs" / "tiny")
    (place / "stdout.txt").write_text(done.stdout)
    (place / "stderr.txt").write_text(done.stderr)
    return place


@pytest.fixture
def place(finished: Path, here: Path) -> Path:
    """A copy of it, which is the current folder."""
    return Path(shutil.copytree(finished, here, dirs_exist_ok=True))


HEAVY = "xarray scipy.sparse pint dask matplotlib"
NUMERICS = "pyfftw numba pint scipy.linalg scipy.fft scipy.interpolate scipy.ndimage dask matplotlib"
UNUSED = (  # by command; a row is one process, in which later commands may import more
    {
        "--help": "numpy scipy xarray pandas netCDF4 matplotlib pydantic yaml pyfftw rich",
        "explain leak_rate": HEAVY,
        "ls": HEAVY,
        "status leaking.yaml": HEAVY,
        "show leaking": NUMERICS,
        "compare leaking leaking": NUMERICS,
        "ask leaking --closed": NUMERICS,
    },
    {
        "check leaking.yaml": "xarray scipy.optimize scipy.interpolate scipy.ndimage dask matplotlib",
        "run small.yaml": "pint matplotlib scipy.stats distributed",
    },
)


@pytest.mark.parametrize("unused", UNUSED)
def test_a_command_imports_only_what_it_uses_and_starts_no_process_for_small_cases(
    place: Path, unused: dict[str, str]
) -> None:
    Path("small.yaml").write_text("surface: {D: 2.3, m: 4, seeds: 2}\nsweep: {steps: 5}\n", encoding="utf-8")
    with_ways = LEAKING.replace("{transmissivity", "{percolation: every-step, transmissivity")
    ran("leaking", f"{with_ways}seal: {{length: 1 mm, width: 200 um}}\n")
    code = (
        "import os, sys\nfrom roughvol.cli import main\n"
        f"for command, unused in {unused}.items():\n"
        "    main(command.split(), standalone_mode=False)\n"
        "    print(command, *(name for name in unused.split() if name in sys.modules), file=sys.stderr)\n"
        "assert os.times().children_user < 0.2"
    )
    done = python("-c", code)
    assert [line for line in done.stderr.splitlines() if line.startswith(tuple(unused))] == list(unused)


def test_run_tells_what_happened(finished: Path) -> None:
    out = (finished / "stdout.txt").read_text()
    assert out.startswith("8 cases in ")
    assert "48 states, " in out
    assert "largest residual η/σ " in out
    assert "separation=-2 was not reached in 8 cases" in out
    assert out.splitlines()[-1] == str(finished / "runs" / "tiny" / "study.nc")
    # plain lines of progress elsewhere: one a second for the cases that end, and the last
    lines = (finished / "stderr.txt").read_text().splitlines()
    number, unit = out.split()[3:5]
    assert unit == "s"
    assert 1 <= sum(": done · " in line for line in lines) <= float(number) + 2
    assert "8 of 8 cases · 48 of 48 steps" in lines[-1]


def test_run_tells_once_of_states_that_were_not_reached(place: Path) -> None:
    text = """
surface: {D: 2.3, m: 3, seeds: 1}
sweep: {steps: 2, to: {indentation: 0.5}}
record: {fields_at: {pressure: 1000}, transport: {flux_at: {pressure: 1000}, transmissivity: {contact_area: 0.99}}}
"""
    told = ran("far", text).splitlines()
    assert told.count("pressure=1000 was not reached in 1 case") == 1
    assert "no state of transmissivity was reached in 1 case" in told


def test_python_and_command_line_give_one_answer(finished: Path, tmp_path: Path) -> None:
    returned = roughvol.run(finished / "tiny.yaml", out=tmp_path, jobs=1)
    stored = dataset.read(finished / "runs" / "tiny" / "study.nc")
    xr.testing.assert_identical(values_of(returned), values_of(stored))
    assert {**returned.attrs, "date": ""} == {**stored.attrs, "date": ""}


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252"])
def test_an_encoding_without_a_character_prints_its_escape(place: Path, encoding: str) -> None:
    for command in (["show", "tiny"], ["card", "--help"], ["explain", "free_volume"]):
        done = CliRunner(charset=encoding).invoke(main, command)
        assert done.exit_code == 0, done.exception
        assert done.stdout == call(*command).stdout.encode(encoding, "backslashreplace").decode(encoding)


def test_the_locale_c_prints_escapes_too_and_keeps_the_bytes_of_names(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = call("show", "tiny").stdout
    (place / "runs" / "tiny").rename(place / "Größe")
    monkeypatch.setenv("LC_ALL", "C")
    monkeypatch.setenv("PYTHONUTF8", "0")
    monkeypatch.setenv("PYTHONCOERCECLOCALE", "0")
    each = "for words in sys.argv[1:]: main(words.split(), standalone_mode=False)"
    code = f"import sys\nfrom roughvol.cli import main\n{each}"
    done = python("-c", code, "show Größe", "status Größe")
    assert done.stdout.startswith(shown.encode("ascii", "backslashreplace").decode() + "Größe: 8 of 8 cases finished")


def test_windows_is_refused_in_words() -> None:
    with pytest.raises(AssertionError, match=r"^error: roughvol needs Linux or another Unix; on Windows in"):
        python("-c", "import os, roughvol\nos.name = 'nt'\nimport roughvol.cli")


def test_status_counts_and_names_what_is_missing(place: Path) -> None:
    assert "8 of 8 cases finished, collected" in said("status", "tiny.yaml")
    gone, broken, *_ = sorted((place / "runs" / "tiny" / "cases").iterdir())
    gone.unlink()
    broken.write_bytes(b"")
    shown = said("status", "tiny.yaml")
    assert "6 of 8 cases finished" in shown
    assert f"{gone.stem}  missing" in shown
    assert f"{broken.stem}  damaged" in shown


def test_what_is_no_study_and_no_run_is_refused_with_the_places(place: Path) -> None:
    for word in ("status", "check", "run"):
        assert refused(word, "absent").endswith("run: looked for absent, absent/study.yaml, runs/absent/study.yaml\n")


def test_check_shows_the_resolved_study_and_its_cost(place: Path) -> None:
    shown = said("check", "tiny.yaml")
    # what is printed is itself a study: the cost stands in comments
    assert yaml.safe_load(shown) == yaml.safe_load(roughvol.load("tiny.yaml").to_yaml())
    for line in ("# 8 cases, 48 states to solve", "# memory ", "# disk ", "# time "):
        assert line in shown


def test_check_of_a_height_file_shows_how_it_was_understood(place: Path) -> None:
    np.save("z.npy", np.random.default_rng(0).random((5, 6)))
    Path("map.yaml").write_text("surface: {file: z.npy, L: 4 um}\nsweep: {steps: 1}\n", encoding="utf-8")
    shown = said("check", "map.yaml")
    assert re.search(r"^# surface 5 x 6 nodes, L = 4 um by 5 um, spacing 1 um$", shown, re.MULTILINE)
    assert re.search(r"Sq = 0\.\d+ um, Sdq = 0\.\d+, z_max/Sq = \d\.\d+, z_min/Sq = -\d\.\d+ \(", shown)
    assert "z.npy read by numpy, heights in um, the unit of the study" in shown
    assert "missing 0 heights (0.00%)\n" in shown
    assert "warning" not in shown
    assert yaml.safe_load(shown) == yaml.safe_load(roughvol.load("map.yaml").to_yaml())


def test_check_warns_of_a_spike_and_shows_what_was_taken_out(place: Path) -> None:
    heights = np.random.default_rng(0).random((30, 30))
    heights[4, 5], heights[8, 8] = 40.0, np.nan
    np.save("z.npy", heights)
    keys = "file: z.npy, L: 29, missing: interpolate, level: tilt"
    for extra in ("", ", outliers: {sigma: 6}"):
        text = f"surface: {{{keys}{extra}}}\nsweep: {{steps: 1}}\n"
        Path("map.yaml").write_text(text, encoding="utf-8")
        called = call("check", "map.yaml")
        shown = called.stdout
        told = r"^warning: the highest point lies 29\.\d Sq above .*see surface\.outliers$"
        warned = re.search(told, called.stderr, re.MULTILINE)
        assert (warned is None) == bool(extra)
        assert f"missing {'2 heights' if extra else '1 height'} (" in shown
    assert re.search(r"1 outlier removed; z_max/Sq was 29\.\d and is 1\.\d", shown)
    steps = re.findall(r"step (\d): (\w+)", shown)
    assert steps == [("1", "heights"), ("2", "least"), ("3", "missing")]


def test_check_draws_a_picture_on_request(place: Path) -> None:
    shown = said("check", "tiny.yaml", "--look")
    assert "# picture tiny-look.png" in shown
    assert Path("tiny-look.png").read_bytes().startswith(b"\x89PNG")
    assert "# picture pictures/tiny-look.png" in said("check", "tiny.yaml", "--look", "--out", "pictures")
    assert Path("pictures/tiny-look.png").read_bytes() == Path("tiny-look.png").read_bytes()
    assert "too large a surface to be drawn" in refused("check", "tiny.yaml", "--look", "--set", "surface.m=13")


def test_schema_is_a_json_schema(place: Path) -> None:
    schema = json.loads(said("schema"))
    assert schema["$schema"].startswith("https://json-schema.org/")
    assert set(schema["properties"]) >= {"surface", "sweep", "solver", "record"}


@pytest.mark.parametrize(
    ("text", "expected"),  # study/test_refusals.py has the messages
    [
        ("surface: {D: 5, m: 0}\nsweep: {steps: -1}", ["3 problems", "surface.D", "surface.m", ":2: sweep.steps"]),
        ("surface: {D: [2.3", ["bad.yaml"]),
    ],
)
def test_bad_study_is_refused_in_words(here: Path, text: str, expected: list[str]) -> None:
    Path("bad.yaml").write_text(text)
    done = call("run", "bad.yaml")
    assert done.exit_code == 2
    assert all(part in done.stderr for part in expected), done.stderr
    assert done.stdout == ""
    assert [path.name for path in here.iterdir()] == ["bad.yaml"]


def test_an_empty_folder_and_a_file_are_refused_and_nothing_is_written(here: Path) -> None:
    """An empty text is that of a variable of the shell without a value; the current folder is a dot."""
    text = "surface: {D: 2.3, m: 3, seeds: 1}\nsweep: {steps: 1}"
    Path("s.yaml").write_text(text)
    for command in (("run", "s.yaml"), ("card", "s.yaml"), ("check", "s.yaml", "--look")):
        for folder in ("", "card.pdf"):
            assert "--out': must be a folder" in refused(*command, "--out", folder)
    with pytest.raises(FolderError, match="given an empty text"):
        roughvol.run("s.yaml", out="", jobs=1)
    assert [path.name for path in here.iterdir()] == ["s.yaml"]


def test_bad_heights_are_refused_and_nothing_is_written(here: Path) -> None:
    Path("z.txt").write_text("1 2 3\n4 nan 6\n7 8 9\n")
    Path("bad.yaml").write_text("surface: {file: z.txt, L: 1 mm}\nsweep: {steps: 2}")
    for command in ("check", "run"):
        done = call(command, "bad.yaml")
        assert (done.exit_code, done.stdout) == (2, ""), done.stderr
        assert "z.txt" in done.stderr
    assert sorted(path.name for path in here.iterdir()) == ["bad.yaml", "z.txt"]
    np.save("good.npy", np.eye(3))
    Path("bad.yaml").write_text("surface: {file: good.npy, L: 1 mm,\n  against: {file: z.npy}}\nsweep: {steps: 2}")
    np.save("z.npy", np.full((3, 3), np.nan))
    assert "bad.yaml:2: surface.against.file: " in refused("check", "bad.yaml")


@pytest.mark.usefixtures("here")
def test_an_interrupted_command_promises_what_it_stores(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*given: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(roughvol, "explain", stopped)
    monkeypatch.setattr(roughvol, "card", stopped)
    done = call("explain", "D")
    assert (done.exit_code, done.stderr) == (130, "interrupted\n")
    assert "kept, and the same command continues the run" in call("card", "seal.yaml").stderr
    assert "kept, and the same command without --fresh continues" in call("card", "seal.yaml", "--fresh").stderr


@pytest.mark.usefixtures("here")
def test_plot_without_runs_says_how_to_make_one() -> None:
    assert "roughvol run STUDY" in refused("plot")
