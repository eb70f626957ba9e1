"""The first hour: examples of the package, keys and variables in words, and the page made from them."""

import errno
import re
import runpy
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import xarray as xr

import roughvol
from roughvol.errors import DatasetError
from roughvol.observables.variables import VARIABLES
from roughvol.store import stamped_file
from roughvol.study import load
from roughvol.study.reference import keys
from tests.kit import LEAKING, ROOT, call, ran, refused, said, succeeded

EXAMPLES = ("ensemble", "metal", "reproduce", "scan", "seal")
pytestmark = pytest.mark.usefixtures("here")


@pytest.mark.parametrize("arguments", [["init"], ["init", "--list"], ["init", "seal", "--list"]])
def test_init_lists_the_examples_and_writes_nothing(arguments: list[str]) -> None:
    assert [line.split()[0] for line in said(*arguments).splitlines()[1:-1]] == list(EXAMPLES)
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize("example", EXAMPLES)
def test_init_writes_a_study_that_is_understood(example: str) -> None:
    written = said("init", example)
    study = load(f"{example}.yaml")
    assert study.name == example
    assert study.cases()
    assert f"roughvol run {example}.yaml" in written


@pytest.mark.parametrize(("example", "load"), [("seal", "10 kPa"), ("scan", "10 kPa"), ("metal", "1 MPa")])
def test_examples_with_units_run_without_a_warning_and_show_a_leak_rate(example: str, load: str) -> None:
    said("init", example)
    done = succeeded("run", f"{example}.yaml", "--jobs", "1")
    assert "warning" not in done.output
    head, row = (line.split("  ") for line in said("show", example, "--at", f"pressure={load}").splitlines()[:2])
    assert any("Q_x [mm^3/s]" in cell for cell in head)
    assert row[0].startswith(f"pressure={load}")
    if example == "seal":
        _check_the_row_of_the_first_tutorial()


def _check_the_row_of_the_first_tutorial() -> None:
    """Compare the row of the page with what its command prints of the run."""
    page = (ROOT / "docs/tutorials/first-study.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"^roughvol (show seal --at .*)$", page, re.MULTILINE)
    there = re.search(r"^state  .*\npressure=.*$", page, re.MULTILINE)
    for line, whole in zip(there[0].splitlines(), said(*shown.split()).splitlines()[:2], strict=True):
        cells = re.split(r" {2,}| … *", line)  # … stands for the columns left out
        assert re.match(" .*".join(map(re.escape, cells)), whole)


def test_the_study_of_a_height_map_says_its_sides() -> None:
    np.savetxt("face.txt", np.random.default_rng(0).normal(size=(9, 9)))
    given = ["--set", "surface.L=9 um", "--set", "surface.heights_unit=nm"]
    for more, sides in (
        ([], "mirrored"),
        (["--set", "surface.sides=free"], "free"),
        (["--set", "surface.sides=periodic", "--set", "surface.level=none"], "periodic"),
    ):
        said("init", "face.txt", *given, *more)
        assert load("face.yaml").surface.sides == sides
        assert f"sides {sides}: " in call("check", "face.yaml").output
        assert "# sides: mirrored, the map is a part of a joint" in Path("face.yaml").read_text(encoding="utf-8")
        Path("face.yaml").unlink()


def test_several_height_maps_make_one_study() -> None:
    heights = np.random.default_rng(0).normal(size=(9, 9))
    np.savetxt("face1.txt", heights, header="heights in um")
    heights[3, 4] = np.nan
    np.savetxt("face2.txt", heights)
    told = said("init", "face1.txt", "face2.txt")
    assert "with surface.missing: interpolate" in told
    assert "fill in surface.L, which not all maps give" in told
    text = Path("face.yaml").read_text(encoding="utf-8")
    assert text.startswith("# The height maps face1.txt, face2.txt. ")
    Path("face.yaml").write_text(text.replace("FILL IN, as ", ""), encoding="utf-8")
    assert [case.file.name for case in load("face.yaml").cases()] == ["face1.txt", "face2.txt"]
    np.savetxt("other.txt", heights)
    said("init", "other.txt", "face2.txt", "--set", "surface.L=9 um")
    assert load("maps.yaml").name == "maps"
    for names in (("face1.txt", "none.txt"), ("none.txt", "face1.txt")):
        assert "'none.txt' is no height map; allowed are one example, or one height map or several" in refused(
            "init", *names
        )
    assert "'seal' is no height map" in refused("init", "face1.txt", "seal")


@pytest.mark.parametrize("name", ["123", "1e5", "true", "a#b: c", "a\nb", "a\x01b", "a\x85b", "a\u2028b"])
def test_a_height_map_may_have_any_name(name: str) -> None:
    np.savetxt(f"{name}.txt", np.random.default_rng(0).normal(size=(9, 9)))
    said("init", f"{name}.txt", "--set", "surface.L=9 um")
    (written,) = Path().glob("*.yaml")
    assert Path(load(written).surface.file).name == f"{name}.txt"


def test_the_study_of_a_map_has_the_treatment_that_the_map_needs() -> None:
    z = np.random.default_rng(0).standard_normal((30, 31))
    z[3, 4] = np.nan
    axes = {"x": ("x", np.arange(30.0), {"units": "um"}), "y": ("y", 1.3 * np.arange(31.0), {"units": "um"})}
    xr.DataArray(z, axes, ("x", "y"), "z", {"units": "um"}).to_netcdf("map.nc")
    told = said("init", "map.nc")
    assert "with surface.resample: square, which the heights need\nwith surface.missing: interpolate" in told
    assert call("check", "map.yaml").exit_code == 0
    Path("map.yaml").unlink()
    assert "give resample: square" in refused("init", "map.nc", "--set", "surface.resample=none")
    said("init", "map.nc", "--set", "surface.missing=refuse", "--set", "surface.low_pass=1 nm")
    assert load("map.yaml").surface.missing == "refuse"


def test_the_study_of_a_height_map_takes_lists_and_mappings() -> None:
    np.savetxt("face.txt", np.random.default_rng(0).normal(size=(9, 9)))
    given = ["surface.L='9 um'", "surface.level=[none, tilt]", "surface.crop.x=[0, 0.5]", "surface.outliers={}"]
    said("init", "face.txt", *(word for change in given for word in ("--set", change)))
    study = load("face.yaml")
    assert [axis.labels for axis in study.axes] == [("none", "tilt")]
    assert study.surface.crop.x == (0.0, 0.5)
    assert study.surface.outliers is not None
    assert "surface.file is no mapping" in refused("init", "face.txt", "--set", "surface.file.x=3")


def test_init_passes_over_a_header_that_is_not_understood() -> None:
    np.savetxt("face.csv", np.eye(9, 3), header="Date,2026-03-21", comments="", delimiter=",")
    given = ["surface.header=ignore", "surface.columns=heights", "surface.L=9 um"]
    said("init", "face.csv", *(word for change in given for word in ("--set", change)))


def test_a_file_that_is_not_read_is_named_without_the_study_that_is_not_written() -> None:
    Path("face.stl").write_bytes(b"solid\0\0\0" + bytes(16))
    told = refused("init", "face.stl")
    assert "reads; save it as .x3p, or as text of points x y z" in told
    assert "face.yaml" not in told
    assert not Path("face.yaml").exists()
    np.save("mask.npy", np.zeros((9, 9), bool))
    assert "mask.npy: holds values of type bool, not numbers" in refused("init", "mask.npy")
    np.save("unknown.npy", np.full((4, 4), np.nan))
    assert "unknown.npy: none of the 16 heights is known" in refused("init", "unknown.npy")
    assert not Path("mask.yaml").exists()


def test_init_overwrites_nothing() -> None:
    Path("scan.txt").write_text("mine", encoding="utf-8")
    assert "scan.txt; nothing was written" in refused("init", "scan")
    assert [path.name for path in Path().iterdir()] == ["scan.txt"]
    assert Path("scan.txt").read_text(encoding="utf-8") == "mine"


def test_init_that_cannot_write_one_file_leaves_none() -> None:
    blocked = stamped_file.aside_of(Path("scan.txt"))
    blocked.mkdir()
    assert "cannot write scan.txt" in refused("init", "scan")
    assert list(Path().iterdir()) == [blocked]


def test_init_on_a_read_only_disk_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    stamped_file.aside_of(Path("seal.yaml")).mkdir()
    monkeypatch.setattr(Path, "unlink", Mock(side_effect=OSError(errno.EROFS, "Read-only file system")))
    assert "error: cannot write seal.yaml" in refused("init", "seal")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("surface.against.file", ("height field", "must be given")),
        ("sweep", ("{steps: 60, to: mean-plane, equal: indentation}", "sweep.steps")),
        ("leak_rate", ("volume flow along the axis", "length^3/time")),
        ("material", ("{E_star} or {E, nu}", "material.E_star", "where its key has a list")),
        ("Q_seal", ("derived from study.nc", "needs      seal")),
    ],
)
def test_explain_gives_meaning_values_default_and_unit_in_order(name: str, words: tuple[str, ...]) -> None:
    shown = said("explain", name)
    assert [part for part in words if part not in shown] == []
    assert sorted(words, key=shown.index) == list(words)


def test_explain_knows_every_variable_and_the_columns_of_the_tables() -> None:
    for name in VARIABLES:
        said("explain", name)
    assert said("explain", "transmissivity").startswith(said("explain", "transmissivity_x"))


def test_explain_knows_the_heads_and_names_of_the_columns_of_show() -> None:
    ran("columns", LEAKING.replace("seeds: 1", "seeds: 2"))
    heads = re.split(r"  +", said("show", "columns").splitlines()[1].strip())
    assert {"p [MPa]", "V*", "d/σ", "open along x", "median T_y*", "median Q_x [mm^3/s]"} < {*heads}
    names = roughvol.show("columns").names
    for name in (*heads, *names, "Q_seal [mm^3/s]", "seal_leak_rate"):
        if name not in ("step", "surfaces"):
            assert roughvol.explain(name).variable is not None, name
    assert said("explain", "leak_rate").startswith(said("explain", "median Q_x [mm^3/s]"))
    assert "length^3/time" in said("explain", "Q_x dry")
    assert "derived from study.nc" in said("explain", "K L/E*")
    assert said("explain", "h [W/m^2/K]").startswith("contact_conductance")
    with pytest.raises(DatasetError, match="fig05 is a figure; roughvol plot RUN fig05 draws it"):
        roughvol.explain("fig05")
    assert "no key and no variable 'fig12z'; did you mean 'fig12b' or 'fig12a'" in refused("explain", "fig12z")


def test_every_key_has_a_description_and_values() -> None:
    found = keys()
    some = {"surface.D", "surface.file", "sweep.to.pressure", "material.E", "solver.rtol", "record.transport"}
    assert some <= {key.path for key in found}
    assert [key.path for key in found if not key.description or not key.values] == []


def test_the_page_of_the_reference_is_as_its_command_writes_it() -> None:
    page = (ROOT / "docs" / "reference" / "keys-and-variables.md").read_text(encoding="utf-8")
    assert page == runpy.run_path(str(ROOT / "docs" / "keys_and_variables.py"))["page"](), "run: make reference"
    names = set(re.findall(r"^\| `(\w+)`", page, re.MULTILINE))
    for bases, rows in re.findall(r"^With (.*) for Q:\n\n((?:\|.*\n)+)", page, re.MULTILINE):
        ends = re.findall(r"^\| `Q(\w+)`", rows, re.MULTILINE)
        names |= {base + end for base in re.findall(r"`(\w+)`", bases) for end in ends}
    assert VARIABLES.keys() - names == set()
