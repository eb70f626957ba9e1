"""One vocabulary: an option means the same in every command, and every command takes a study in each form."""

import re
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import pytest
import yaml

from roughvol.cli import main
from roughvol.cli.group import GROUPS
from tests.kit import LEAKING, answered, call, ran, refused, said, without_figures

STUDY = LEAKING.replace("steps: 8", "steps: 12")
CREEP = ("--law", "creep.yaml", "--times", "1 s..1 h")
WORDS: dict[str, tuple[str, ...]] = {  # behind the name of a command, where they are more than a run
    "compare": ("tiny", "other"),
    "plot": ("tiny", "v_of_p"),
    "ask": ("tiny", "--leak-rate", "1e-3 mm^3/s"),
    "card": ("tiny", "--jobs", "1"),
    "creep": ("tiny", "--at", "pressure=0.2MPa", *CREEP),
}


@pytest.fixture(scope="module", autouse=True)
def _runs(there: Path) -> Iterator[None]:
    for name in ("tiny", "other"):
        ran(name, STUDY)
    Path("creep.yaml").write_text("power: {exponent: 0.02, time: 1 s}\n", encoding="utf-8")
    with without_figures():
        yield


def _options(command: click.Command) -> dict[str, click.Option]:
    return {name: p for p in command.params if isinstance(p, click.Option) for name in p.opts if not p.hidden}


COMMANDS = [(name, main.get_command(click.Context(main), name)) for rows in GROUPS.values() for name in rows]


@pytest.mark.parametrize(("name", "command"), COMMANDS)
def test_an_option_has_one_meaning(name: str, command: click.Command) -> None:
    options = _options(command)
    assert ("--jobs" in options) == ("-j" in options)
    if "--out" in options:
        assert str(options["--out"].help).startswith("Folder to write into [default: ")
    if "--at" in options:
        assert options["--at"].metavar == "KIND=VALUE[, leg N]"
    takes = {param.name for param in command.params if isinstance(param, click.Argument)}
    if takes & {"study", "run", "names"}:
        assert "--set" in options


def test_json_of_a_run_has_the_numbers_of_show() -> None:
    ran, shown = (answered(name, "tiny") for name in ("run", "show"))
    assert ran["rows"] == shown["rows"]
    assert ran["units"] == shown["units"]
    assert (ran["cases"], ran["finished_before"]) == (1, 1)


FORMS = ("tiny", "tiny.yaml", "runs/tiny", "runs/tiny/study.nc")


FORMS_OF = {  # two functions open all of them: `StoredRun.open` and `study_of`
    **dict.fromkeys(("show", "status"), FORMS),
    "run": FORMS[:1],
    **dict.fromkeys(("plot", "report", "compare", "creep"), FORMS[1:2]),
    **dict.fromkeys(("check", "card"), FORMS[2:3]),
}


@pytest.mark.parametrize(("name", "form"), [(name, form) for name, forms in FORMS_OF.items() for form in forms])
def test_a_command_takes_a_study_in_each_form(name: str, form: str) -> None:
    assert said(name, form, *WORDS.get(name, ())[1:])


LOADS = ("last", "pressure=0.2 MPa", "p=0.3", "pressure=0.2MPa, leg 1", "load=1 mN")


LOADS_OF = {"show": LOADS, "ask": LOADS, "creep": LOADS[2:3], "compare": LOADS[4:]}  # one parser


@pytest.mark.parametrize(("name", "load"), [(name, load) for name, loads in LOADS_OF.items() for load in loads])
def test_a_load_is_written_alike_in_every_command(name: str, load: str) -> None:
    words = WORDS | {"show": ("tiny",), "creep": ("tiny", *CREEP), "ask": (*WORDS["ask"], "--for", "modulus")}
    assert said(name, *words[name], "--at", load)


def test_a_change_of_a_key_is_that_of_the_run_or_an_error() -> None:
    assert said("show", "tiny", "--set", "surface.m=4")
    for name in ("show", "ask", "creep", "compare", "plot", "report"):
        told = refused(name, *WORDS.get(name, ("tiny",)), "--set", "surface.m=5")
        assert "surface.m: 4 → 5" in told
        assert "roughvol run tiny --set surface.m=5" in told


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("shw", "tiny"), "no command 'shw'; did you mean 'show'?"),
        (("init", "sael"), "did you mean 'seal'"),
        (("explain", "surface.fiel"), "did you mean 'surface.file'"),
        (("run", "tiny.yaml", "--figures", "fig5"), "did you mean 'fig05'"),
        (("run", "tiny.yaml", "--figures", ""), "no figure ''"),
        (("show", "tiyn"), "no results of 'tiyn': .*; did you mean 'tiny'?"),
        (("run", "tiny.yml"), "did you mean 'tiny.yaml'?"),
        (("run", "tiny.yamll"), "did you mean 'tiny.yaml'?"),
        (("compare", "tiny", "othr"), "no results of 'othr': .*; did you mean 'other'?"),
        (("status", "othr"), "no study file and no run: .*; did you mean 'other'?"),
        (("show", "tiny", "--at", "presure=0.5"), "no state 'presure=0.5'; did you mean 'pressure'?"),
        (("show", "tiny", "--at", "pressure"), "no state 'pressure'; allowed: last, or KIND=VALUE"),
        (("show", "tiny", "--at", "pressure=0.5", "MPa"), r"in quotation marks: 'pressure=0.5 MPa'"),
        (("card", "tiny", "--at", "p=0.3", "MPa", "--at", "p=0.5", "MPa"), "in quotation marks: 'p=0.3 MPa'"),
        (("compare", "tiny", "tiny", "--at", "pressure=0.3", "MPa"), "in quotation marks: 'pressure=0.3 MPa'"),
        (("ask", "tiny", "--leak-rate", "1e-6", "mm^3/s"), r"in quotation marks: '1e-6 mm\^3/s'"),
        (("show", "tiny", "--set", "surface.m=5", "--set", "surface.D=2.9"), r"roughvol show runs/tiny\s*$"),
        (("ask", "tiny", "--leak-rate", "3 MPa"), "the leak rate is '3 MPa'"),
        (("ask", "none", "--leak-rate", "1 mm^3/s"), "none"),
        (("card", "tiny.yaml", "--at", "load=3"), "load=3: needs its unit, as load=20N"),
        (("card", "none.yaml"), "none.yaml"),
    ],
)
def test_a_word_of_the_command_line_with_a_slip_names_what_was_meant(words: tuple[str, ...], hint: str) -> None:
    assert re.search(hint.replace("?", r"\?"), refused(*words))


# height maps


@pytest.fixture
def maps(here: Path) -> None:
    z = np.random.default_rng(0).normal(size=(12, 12))
    np.savetxt("rows.txt", z)
    np.save("array.npy", z)
    points = [(2.0 * i, 2.0 * j, z[i, j]) for i in range(12) for j in range(12)]
    Path("face.xyz").write_text("\n".join("\t".join(f"{x:.6f}" for x in point) for point in points), encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "file"),
    [("show", "face.xyz"), ("show", "rows.txt"), *((name, "array.npy") for name in ("run", "status", "plot", "ask"))],
)
def test_a_height_map_in_place_of_a_study_is_told_apart(maps: None, name: str, file: str) -> None:
    told = refused(name, file, *WORDS.get(name, ())[1:])
    assert "YAML" not in told
    assert f"{file}: a height map, no" in told
    assert f"roughvol init {file}" in told


@pytest.mark.parametrize(
    ("file", "absent"),
    [("face.xyz", ("surface.unit", "um")), *((name, ("surface.L", "22 um")) for name in ("rows.txt", "array.npy"))],
)
def test_init_writes_the_study_of_a_height_map(maps: None, file: str, absent: tuple[str, str]) -> None:
    study, (key, value) = f"{Path(file).stem}.yaml", absent
    assert f"fill in {key}" in said("init", file)
    assert key in refused("check", study)
    assert "nothing was written" in refused("init", file)
    Path(study).unlink()
    said("init", file, "--set", f"{key}={value}")
    said("run", study, "--set", "sweep.steps=2", "--jobs", "1")


@pytest.mark.parametrize(("unit", "written"), [("m", {"unit": "um"}), ("mm", {"unit": "um"}), ("um", {})])
def test_the_study_of_a_small_map_has_a_unit_of_its_size(maps: None, unit: str, written: dict[str, str]) -> None:
    metres = {"m": 1.0, "mm": 1e-3, "um": 1e-6}[unit]
    x, y, z = np.loadtxt("face.xyz").T * 1e-6 / metres
    np.savetxt("small.csv", np.column_stack([x, y, z]), delimiter=";", header=f"x[{unit}];y[{unit}];z[{unit}]")
    told = said("init", "small.csv")
    section = yaml.safe_load(Path("small.yaml").read_text(encoding="utf-8"))["surface"]
    assert {key: value for key, value in section.items() if key == "unit"} == written
    assert ("with surface.unit: um, as its L is" in told) == bool(written)
    assert "L = 22 um" in said("check", "small.yaml")


def test_the_height_of_a_count_is_to_be_filled_in(here: Path) -> None:
    counts = np.rint(100.0 * np.random.default_rng(0).normal(size=(12, 12)) + 1000.0).astype("u2")
    tiff, size = pytest.importorskip("tifffile"), {"resolution": (2, 2), "metadata": {"unit": "um"}}
    tiff.imwrite("counts.tif", counts)
    tiff.imwrite("sized.tif", counts, imagej=True, **size)
    said("init", "sized.tif")
    assert "FILL IN, as 0.95 nm" in Path("sized.yaml").read_text(encoding="utf-8")
    assert "fill in surface.L and surface.heights_unit, which counts.tif does not give" in said("init", "counts.tif")
    section = yaml.safe_load(Path("counts.yaml").read_text(encoding="utf-8"))["surface"]
    assert section["heights_unit"] == "FILL IN, as 0.95 nm"
    Path("counts.yaml").unlink()
    told = said("init", "counts.tif", "--set", "surface.L=22 um", "--set", "surface.heights_unit=1 nm")
    assert "fill in" not in told
    Path("counts.yaml").unlink()
    assert "surface.heights_unit" in said("init", "counts.tif", "--set", "surface.against.file=counts.tif")


# help and completion


def test_help_groups_every_command_with_its_first_words_in_full() -> None:
    shown = call("--help").output
    names = [name for rows in GROUPS.values() for name in rows]
    assert len(names) == len(set(names))
    places = [shown.index(f"{title}:\n") for title in GROUPS]
    assert places == sorted(places)
    assert "Documentation: " in shown
    assert "..." not in shown.partition("Start:")[2]


def _completed(*words: str) -> set[str]:
    asked = {"_ROUGHVOL_COMPLETE": "bash_complete", "COMP_WORDS": " ".join(("roughvol", *words))}
    answer = call(env=asked | {"COMP_CWORD": str(len(words))}, prog_name="roughvol")
    return {line.removeprefix("plain,") for line in answer.stdout.splitlines()}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("show", "ti"), {"tiny", "tiny.yaml"}),
        (("status", "oth"), {"other", "other.yaml"}),
        (("compare", "tiny", "oth"), {"other", "other.yaml"}),
        (("plot", "tiny", "leak_of_"), {f"leak_of_{x}" for x in ("p", "a", "v", "d", "i", "gap")}),
        (("plot", "tiny", "fig11"), {"fig11a", "fig11b"}),
        (("run", "tiny", "--figures", "fig01,fig11"), {"fig01,fig11a", "fig01,fig11b"}),
        (("show", "tiny", "--at", "la"), {"last"}),
        (("run", "tiny", "--set", "surface.see"), {"surface.seeds="}),
        (("show", "./ru"), {"file,./ru"}),  # a path is left to the shell
        (("init", "s"), {"scan", "seal"}),
    ],
)
def test_completion_knows_runs_figures_states_and_keys(words: tuple[str, ...], expected: set[str]) -> None:
    assert _completed(*words) == expected
