"""Lists in keys that take one value: axes of the dataset, shared cases, one figure."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import roughvol
from roughvol.cli import main
from roughvol.errors import StudyError
from roughvol.report.figures import content
from roughvol.store import dataset
from roughvol.store.variants import parts_of
from roughvol.study import load, loads

TEXT = """
surface: {files: maps/*.npy, L: 100 um}
material: {E: [5 MPa, 10 MPa], nu: 0.5}
sweep: {pressures: [0.05 MPa, 0.1 MPa]}
record: {dimensional: {pressure: MPa}}
"""
MADE = "surface: {D: 2.3, m: 4, seeds: 2, L: 100 um, Sq: 1 um}\n"


@pytest.fixture(autouse=True)
def _maps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("maps").mkdir()
    for k in range(8):
        np.save(f"maps/m{k}.npy", np.random.default_rng(k).random((9, 9)))
    Path("many.yaml").write_text(TEXT, encoding="utf-8")


def test_maps_materials_and_loads_make_one_dataset_and_one_figure() -> None:
    done = CliRunner().invoke(main, ["run", "many.yaml", "--jobs", "1"])
    assert done.exit_code == 0, done.output
    assert "E = 10 MPa" in done.stdout
    ds = dataset.read(Path("runs/many/study.nc"))
    assert dict(ds.sizes) | {"E": 2, "case": 8, "step": 2} == dict(ds.sizes)
    assert (ds.E.values.tolist(), ds.E.attrs["units"]) == ([5.0, 10.0], "MPa")
    np.testing.assert_allclose(ds.nominal_pressure, np.broadcast_to([0.05, 0.1], (2, 8, 2)), rtol=2e-5)
    assert bool((ds.free_volume.sel(E=10.0) > ds.free_volume.sel(E=5.0)).all())  # a stiffer body is pressed flat later
    for material in (5, 10):
        alone = roughvol.run(loads(TEXT.replace("[5 MPa, 10 MPa]", f"{material} MPa"), f"alone{material}.yaml"), jobs=1)
        assert (alone.free_volume.values == ds.free_volume.sel(E=material).values).all()
    drawn = CliRunner().invoke(main, ["plot", "many", "v_of_p"])
    assert drawn.exit_code == 0, drawn.output
    assert Path("runs/many/figures/v_of_p.png").is_file()
    curves = CliRunner().invoke(main, ["plot", "many", "v_of_p", "--format", "csv"])
    assert curves.exit_code == 0
    with Path("runs/many/figures/v_of_p.csv").open() as stream:
        assert {"E = 5 MPa", "E = 10 MPa"} <= {row["curve"] for row in csv.DictReader(stream)}


def test_numbers_on_the_screen_name_the_combination() -> None:
    roughvol.run("many.yaml", jobs=1)
    shown = CliRunner().invoke(main, ["show", "many", "--csv"])
    rows = list(csv.DictReader(io.StringIO(shown.stdout)))
    assert len(rows) == 2 * 8 * 2
    assert {row["E"] for row in rows} == {"5.0", "10.0"}
    assert "E = 5 MPa" in CliRunner().invoke(main, ["show", "many", "--at", "pressure=0.07MPa"]).stdout
    assert "E = 10 MPa" in CliRunner().invoke(main, ["compare", "many"]).stdout
    for command in (["status", "many"], ["check", "many.yaml"], ["report", "many"], ["plot", "many"]):
        done = CliRunner().invoke(main, command)
        assert done.exit_code == 0, done.output
    assert Path("runs/many/figures/E_5_MPa").is_dir()


def test_combinations_in_several_units_come_in_that_of_the_first() -> None:
    text = MADE + "material: {E_star: [10 MPa, 200 bar]}\nsweep: {pressures: [0.1 MPa, 0.4 MPa]}"
    roughvol.run(loads(text, "mixed.yaml"), jobs=1)
    shown = CliRunner().invoke(main, ["show", "mixed", "--json"])
    table = json.loads(shown.stdout)
    assert table["units"]["nominal_pressure"] == "MPa"
    pressures = [row["nominal_pressure"] for row in table["rows"]]
    np.testing.assert_allclose(pressures, np.tile([0.1, 0.4], 4), rtol=1e-5)
    compared = CliRunner().invoke(main, ["compare", "mixed", "--at", "pressure=0.4 MPa"])
    assert compared.exit_code == 0, compared.output
    assert "p [MPa]" in compared.stdout
    assert CliRunner().invoke(main, ["compare", "mixed"]).exit_code == 0
    drawn = CliRunner().invoke(main, ["plot", "mixed", "v_of_p", "--format", "csv"])
    assert drawn.exit_code == 0, drawn.output
    with Path("runs/mixed/figures/v_of_p.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert {row["x_label"] for row in rows} == {"nominal pressure p [MPa]"}
    assert max(float(row["x"]) for row in rows) < 0.41


def test_progress_tells_combinations_apart_and_an_unfinished_run_is_named() -> None:
    text = MADE.replace("seeds: 2", "seeds: [5]") + "material: {E: [10 MPa, 20 MPa], nu: 0.3}\n"
    Path("two.yaml").write_text(text + "sweep: {steps: 2, to: {mean_gap: 2.4 um}}", encoding="utf-8")
    done = CliRunner().invoke(main, ["run", "two.yaml", "--jobs", "1"])
    ids = [case.id for case in load("two.yaml").cases()]
    assert any(f"{id}: done · " in done.stderr for id in ids)
    Path("runs/two/study.nc").unlink()
    for name in ("two", "two.yaml", "runs/two"):
        refused = CliRunner().invoke(main, ["show", name])
        assert refused.exit_code == 2
        assert "has no study.nc: its run has not ended; see: roughvol status runs/two" in refused.stderr


def test_many_combinations_leave_room_for_their_figure() -> None:
    text = MADE + "material: {E: [5 MPa, 10 MPa], nu: [0.3, 0.5], hardness: [none, 90 MPa]}\n"
    text += "sweep: {steps: 2, to: [mean-plane, summit-plane]}\nrecord: {region: [none, interior]}"
    roughvol.run(loads(text, "many.yaml"), jobs=1)
    figure = content.draw("v_of_p", content.parts("many", dataset.read(Path("runs/many/study.nc")), alone=True))
    figure.draw_without_rendering()  # a warning of matplotlib is an error of the test
    box = figure.axes[0].get_window_extent()
    assert box.height > 1.4 * figure.dpi
    assert box.width > 0.5 * figure.bbox.width


def test_equal_starred_loads_share_their_cases() -> None:
    study = loads(MADE + "material: {E: [5 MPa, 10 MPa], nu: [0.3, 0.5]}\nsweep: {pressures: [0.5, 1]}")
    assert len(study.cases()) == 2
    ds = roughvol.run(study, jobs=1)
    assert ds.free_volume.dims == ("E", "nu", "D", "m", "seed", "step")
    assert (ds.free_volume == ds.free_volume.isel(E=0, nu=0)).all()


def test_a_further_item_computes_only_its_own_cases() -> None:
    roughvol.run(
        loads(MADE + "material: {E: [5 MPa, 10 MPa], nu: 0.5}\nsweep: {pressures: [0.1 MPa]}", "x.yaml"), jobs=1
    )
    before = {path.name: path.stat().st_mtime_ns for path in Path("runs/x/cases").glob("*.nc")}
    more = loads(MADE + "material: {E: [5 MPa, 7 MPa, 10 MPa], nu: 0.5}\nsweep: {pressures: [0.1 MPa]}", "x.yaml")
    ds = roughvol.run(more, jobs=1)
    assert ds.E.values.tolist() == [5.0, 7.0, 10.0]
    after = {path.name: path.stat().st_mtime_ns for path in Path("runs/x/cases").glob("*.nc")}
    assert (len(before), len(after)) == (4, 6)
    assert before.items() <= after.items()


def test_ends_regions_materials_filters_and_hardness_are_axes() -> None:
    text = (
        "surface: {file: maps/m0.npy, L: 100 um, low_pass: [none, 30 um]}\n"
        "material: [{E: 5 MPa, nu: 0.5}, {E_star: 10 MPa, hardness: 5 MPa}]\n"
        "sweep: {steps: 2, to: {pressure: [0.05 MPa, 0.1 MPa]}}\nrecord: {region: [none, interior]}"
    )
    study = loads(text, "x.yaml")
    assert loads(study.stored(), stored=True) == loads(loads(study.stored(), stored=True).stored(), stored=True)
    ds = roughvol.run(study, jobs=1)
    assert dict(ds.sizes) == {"low_pass": 2, "material": 2, "to": 2, "region": 2, "case": 1, "step": 2}
    assert ds.material.values.tolist() == ["E = 5 MPa, nu = 0.5", "E_star = 10 MPa, hardness = 5 MPa"]
    assert ds.to.values.tolist() == ["pressure=0.05 MPa", "pressure=0.1 MPa"]
    assert ds.region.values.tolist() == ["whole", "interior"]
    assert ds.low_pass.values.tolist() == [0.0, 30.0]
    found = parts_of(ds)
    assert len(found) == 16
    assert all("low_pass" not in part.dataset.dims for part in found)
    hard = loads(MADE + "material: {E_star: 10 MPa, hardness: [none, 5 MPa]}\nsweep: {steps: 1}", "hard.yaml")
    assert np.isinf(roughvol.run(hard, jobs=1).hardness.values[-1])


def test_cases_without_lists_keep_their_id() -> None:
    plain = load("many.yaml").variants[0].study.cases()
    text = TEXT.replace("[5 MPa, 10 MPa]", "5 MPa")
    assert [case.id for case in plain] == [case.id for case in loads(text, "many.yaml").cases()]


@pytest.mark.parametrize(
    ("material", "key", "part"),
    [
        ("{E: [5 MPa, -1 MPa], nu: 0.5}", "material.E[1]", "must be > 0"),
        ("{E: [], nu: 0.5}", "material.E", "must have at least one item, given an empty list"),
        ("{E: [5 MPa, 5000 kPa], nu: 0.5}", "material.E[1]", "is item 1 of the list again, given '5000 kPa'"),
        ("{E: 5 MPa, nu: 0.5, hardness: [none, null]}", "material.hardness[1]", "again, given nothing"),
        ("{E: [5 MPa, 6], nu: 0.5}", "material.E[1]", "either all items have a unit, or none, given 6"),
        (f"{{E: {list(range(1, 1002))}, nu: 0.5}}", "material.E", "make 1001 combinations"),
        ("{E: 5 MPa, nu: [0.3, 0.9]}", "material.nu[1]", "must be <= 0.5"),
        ("{E: 5 MPa, nu: 0.3, hardness: [1, 1 GPa]}", "material.hardness[0]", "either all items have a unit"),
        ("[{E: 5 MPa, nu: 0.3}, {E: 5 MPa}]", "material[1].nu", "missing"),
    ],
)
def test_items_without_meaning_are_refused(material: str, key: str, part: str) -> None:
    with pytest.raises(StudyError) as refused:
        loads(f"{MADE}material: {material}\nsweep: {{steps: 1}}\n")
    found = [problem for problem in refused.value.problems if problem.key == key and part in problem.message]
    assert found, refused.value
    assert found[0].line == 2


@pytest.mark.parametrize("key", ["level: [none, tilt]", "low_pass: [none, 5 um]"])
def test_generated_surfaces_take_no_list_of_treatments(key: str) -> None:
    with pytest.raises(StudyError, match=rf"surface\.{key.partition(':')[0]}: excluded by 'D'") as refused:
        loads(MADE.replace("m: 4", f"m: 4, {key}"))
    assert len(refused.value.problems) == 1


def test_an_ensemble_takes_no_list() -> None:
    text = "surface: {D: 2.3, m: auto}\nmaterial: {E: [5 MPa, 6 MPa], nu: 0.5}\n"
    with pytest.raises(StudyError, match=r":2: material\.E: an ensemble takes one value"):
        loads(text + "ensemble: {accuracy: {free_volume: 5 %}}\nsweep: {to: {pressure: 1}}")
