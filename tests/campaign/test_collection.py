"""Several files and lists of values in one study: each is a case or an axis, as it is alone."""

import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest

import roughvol
from roughvol.errors import StudyError
from roughvol.report import markdown
from roughvol.report.figures import content
from roughvol.report.page import document
from roughvol.store import dataset
from roughvol.store.variants import parts_of
from roughvol.study import load, loads
from roughvol.study.sections import height_file
from roughvol.study.values.durations import duration
from tests.campaign.kit import files_of, table
from tests.kit import call, ran, refused, said

MANY = """
surface: {files: maps/*.npy, L: 100 um}
material: {E: [5 MPa, 10 MPa], nu: 0.5}
sweep: {pressures: [0.05 MPa, 0.1 MPa]}
record: {dimensional: {pressure: MPa}}
"""
SEVERAL = MANY.replace("{E: [5 MPa, 10 MPa], nu: 0.5}", "{E_star: 10 MPa}")
MADE = "surface: {D: 2.3, m: 4, seeds: 2, L: 100 um, Sq: 1 um}\n"


@pytest.fixture(autouse=True)
def _maps(here: None) -> None:
    Path("maps").mkdir()
    for k, shape in enumerate(((9, 9), (9, 9), (9, 12))):
        np.save(f"maps/m{k}.npy", np.random.default_rng(k).random(shape))
    Path("many.yaml").write_text(MANY, encoding="utf-8")
    Path("several.yaml").write_text(SEVERAL, encoding="utf-8")


def _rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_each_file_is_the_case_that_it_is_alone() -> None:
    alone = [loads(SEVERAL.replace("files: maps/*.npy", f"file: maps/m{k}.npy"), "one.yaml") for k in range(3)]
    assert [case.id for case in load("several.yaml").cases()] == [study.cases()[0].id for study in alone]
    ds = roughvol.run("several.yaml", jobs=1)
    assert ds.case.values.tolist() == ["m0.npy", "m1.npy", "m2.npy"]
    np.testing.assert_allclose(ds.mean_pressure * ds.Sq / 100.0 * 10.0, [[0.05, 0.1]] * 3, rtol=2e-5)
    one = roughvol.run(alone[2], jobs=1)
    assert (one.free_volume.sel(case="m2.npy") == ds.free_volume.sel(case="m2.npy")).all()
    assert [entry["file"] for entry in json.loads(ds.attrs["height_files"])] == ds.case.values.tolist()
    np.save("maps/m9.npy", np.random.default_rng(9).random((9, 9)))  # a further file is a further case
    again = said("run", "several.yaml", "--jobs", "1")
    assert "4 cases in " in again
    assert "3 of them finished before" in again
    assert "4 of 4 cases finished, collected" in said("status", "several")


def test_files_that_make_no_cases_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(surface: str, part: str) -> None:
        with pytest.raises(StudyError, match=re.escape(part)):
            loads(f"surface: {surface}\nsweep: {{steps: 1}}\n", "several.yaml").cases()

    for surface, part in table("files"):
        refuse(surface, part)
    monkeypatch.setattr(height_file, "MOST_FILES", 2)
    refuse("{files: '*/*.npy', L: 1 um}", "surface.files: matches more than 2 files")


def test_a_pattern_may_begin_above_the_study() -> None:
    Path("studies").mkdir()
    study = loads("surface: {files: '../maps/m0*.npy', L: 1 um}", Path("studies/s.yaml"))
    assert [Path(case.bodies[0].file).name for case in study.cases()] == ["m0.npy"]


def test_a_pattern_takes_each_file_once_whatever_links_to_its_folder() -> None:
    Path("maps/again").symlink_to(".")
    assert len(loads("surface: {files: 'maps/**/**/m0*.npy', L: 1 um}", Path("s.yaml")).cases()) == 1
    with pytest.raises(StudyError, match=r"surface\.files: no pattern"):
        loads(f"surface: {{files: '{'x' * 300}', L: 1 um}}")


STRANGE = ("=cmd|calc.npy", "@SUM(A1).npy", "+1.npy", "<img src=x onerror=alert(1)>.npy", "<b>\\<i>.npy", "plain.npy")


def test_names_of_files_are_neither_formulas_nor_elements_of_pages() -> None:
    for number, name in enumerate(STRANGE):
        np.save(name, np.random.default_rng(number).random((9, 9)))
    surface = f"{{files: {json.dumps(list(STRANGE))}, L: 100 um, sides: free}}"
    roughvol.run(loads(f"name: strange\nsurface: {surface}\nsweep: {{steps: 2}}\n", "strange.yaml"), jobs=1)
    rows = _rows(said("show", "strange", "--csv"))
    assert {row["case"] for row in rows} == {f"'{name}" if name[0] in "=@+" else name for name in STRANGE}
    assert any(float(row["separation"]) < 0.0 for row in rows)  # negative numbers stay numbers
    said("report", "strange", "--out", "page")
    for page in ("report.md", "report.html"):
        text = Path("page", page).read_text(encoding="utf-8")
        assert "onerror" in text
        assert not re.search(r"(?<!\\)(?:\\\\)*<(?:img src=x|b>|i>\.npy)", text)


# Lists


def test_maps_materials_and_loads_make_one_dataset_and_one_figure() -> None:
    assert "E = 10 MPa" in said("run", "many.yaml", "--jobs", "1")
    ds = dataset.read(Path("runs/many/study.nc"))
    assert dict(ds.sizes) | {"E": 2, "case": 3, "step": 2} == dict(ds.sizes)
    assert (ds.E.values.tolist(), ds.E.attrs["units"]) == ([5.0, 10.0], "MPa")
    np.testing.assert_allclose(ds.nominal_pressure, np.broadcast_to([0.05, 0.1], (2, 3, 2)), rtol=2e-5)
    assert bool((ds.free_volume.sel(E=10.0) > ds.free_volume.sel(E=5.0)).all())  # a stiffer body is pressed flat later
    alone = roughvol.run(loads(MANY.replace("[5 MPa, 10 MPa]", "10 MPa"), "alone.yaml"), jobs=1)
    assert (alone.free_volume.values == ds.free_volume.sel(E=10.0).values).all()
    stored = roughvol.open("alone")  # what a run returns is what its file holds, in the same order
    assert stored.identical(alone)
    for order in (list, lambda made: list(made.sizes), lambda made: list(made.coords)):
        assert order(stored) == order(alone)
    said("plot", "many", "v_of_p", "--format", "csv")
    rows = _rows(Path("runs/many/figures/v_of_p.csv").read_text())
    assert {"E = 5 MPa", "E = 10 MPa"} == {row["curve"].partition(":")[0] for row in rows}
    rows = _rows(said("show", "many", "--csv"))
    assert (len(rows), {row["E"] for row in rows}) == (2 * 3 * 2, {"5.0", "10.0"})
    assert "E = 5 MPa" in said("show", "many", "--at", "pressure=0.07MPa")
    assert "E = 10 MPa" in said("compare", "many")
    said("plot", "many", "fig04a")
    assert Path("runs/many/figures/E=5_MPa").is_dir()


def test_the_report_of_a_combination_has_its_treatment_and_its_region() -> None:
    z = np.random.default_rng(0).normal(size=(9, 9))
    surface = {"heights": z, "L": 1.0, "level": ["tilt", "quadratic"]}
    study = {"name": "treated", "surface": surface, "sweep": {"steps": 1}, "record": {"region": ["none", "interior"]}}
    roughvol.run(study, jobs=1)
    page = markdown.render(document(roughvol.report_on(["treated"]).report))
    title, *sections = re.split("^#+ treated", page, flags=re.MULTILINE)[1:]
    assert title.startswith("\n")  # the combinations are named in their sections
    for section in sections:
        level = "tilt" if section.startswith(", level = tilt") else "quadratic"
        assert f"- Treatment: least-squares {level} of the known heights subtracted\n" in section
        interior = "- Region observed: x/L_x 0.25 to 0.75, y/L_y 0.25 to 0.75\n"
        assert ("Region observed" in section) == (interior in section) == ("region = interior\n" in section)
    assert len(sections) == 4


def test_combinations_in_several_units_come_in_that_of_the_first() -> None:
    text = MADE + "material: {E_star: [10 MPa, 200 bar]}\nsweep: {pressures: [0.1 MPa, 0.4 MPa]}"
    roughvol.run(loads(text, "mixed.yaml"), jobs=1)
    table = json.loads(said("show", "mixed", "--json"))
    assert table["units"]["nominal_pressure"] == "MPa"
    np.testing.assert_allclose([row["nominal_pressure"] for row in table["rows"]], np.tile([0.1, 0.4], 4), rtol=1e-5)
    assert "p [MPa]" in said("compare", "mixed", "--at", "pressure=0.4 MPa")
    said("plot", "mixed", "v_of_p", "--format", "csv")
    rows = _rows(Path("runs/mixed/figures/v_of_p.csv").read_text())
    assert {row["x_label"] for row in rows} == {"nominal pressure p [MPa]"}
    assert max(float(row["x"]) for row in rows) < 0.41


def test_progress_names_combinations_and_an_unfinished_run_is_named() -> None:
    text = MADE.replace("seeds: 2", "seeds: [5]") + "material: {E: [10 MPa, 20 MPa], nu: 0.3}\n"
    Path("two.yaml").write_text(text + "sweep: {steps: 2, to: {mean_gap: 2.4 um}}", encoding="utf-8")
    told = call("run", "two.yaml", "--jobs", "1").stderr
    assert any(f"E = {E} MPa, D = 2.30, m = 4, seed 5: done · " in told for E in (10, 20))
    Path("runs/two/study.nc").unlink()
    for name in ("two", "two.yaml", "runs/two"):
        message = refused("show", name)
        assert "has no study.nc: its run has not ended; see: roughvol status runs/two" in message


def test_many_combinations_leave_room_for_their_figure() -> None:
    text = "surface: {D: 2.3, m: 2, seeds: 1}\nmaterial: {E: [1, 2, 3, 4, 5, 6, 7, 8], nu: [0.1, 0.3, 0.5]}\n"
    text += "sweep: {steps: 2}"
    roughvol.run(loads(text, "many.yaml"), jobs=1)
    figure = content.draw("v_of_p", content.parts([("many", dataset.read(Path("runs/many/study.nc")))]))
    figure.draw_without_rendering()  # a warning of matplotlib is an error of the test
    box = figure.axes[0].get_window_extent()
    assert box.height > 1.4 * figure.dpi
    assert box.width > 0.5 * figure.bbox.width


def test_equal_starred_loads_share_their_cases_and_a_further_item_computes_its_own() -> None:
    study = loads(MADE + "material: {E: [5 MPa, 10 MPa], nu: [0.3, 0.5]}\nsweep: {pressures: [0.5, 1]}", "shared.yaml")
    assert len(study.cases()) == 2
    assert list(study.names_of_cases().values()) == [case.label for case in study.cases()]  # of all combinations
    ds = roughvol.run(study, jobs=1)
    assert ds.free_volume.dims == ("E", "nu", "D", "m", "seed", "step")
    assert (ds.free_volume == ds.free_volume.isel(E=0, nu=0)).all()
    text = MADE + "material: {E: [5 MPa, 10 MPa], nu: 0.5}\nsweep: {pressures: [0.1 MPa]}"
    roughvol.run(loads(text, "x.yaml"), jobs=1)
    before = files_of(Path("runs/x"))
    more = roughvol.run(loads(text.replace("[5 MPa, ", "[5 MPa, 7 MPa, "), "x.yaml"), jobs=1)
    assert more.E.values.tolist() == [5.0, 7.0, 10.0]
    some = loads(
        MADE.replace("seeds", "sides: mirrored, seeds")
        + "material: {E: [5 MPa, 10 MPa], nu: 0.5, thickness: [20 um, none]}\nsweep: {pressures: [0.5]}"
    )
    assert {name.rpartition(", D = ")[0] for name in some.names_of_cases().values()} == {
        "thickness = 20 um",
        "thickness = none",
    }
    assert (len(before), len(files_of(Path("runs/x")))) == (4, 6)
    assert before.items() <= files_of(Path("runs/x")).items()


@pytest.mark.parametrize(
    ("moduli", "words"),
    [
        ("[5 MPa, 10 MPa]", "Run soft: E = 5 MPa, E = 10 MPa. "),
        ("[1, 2, 3, 4, 5, 6, 7]", "Run soft: 7 combinations; the legend names them. "),
        ("[5 MPa]", "Run soft, E = 5 MPa: D = 2.3, m = 4, L = 100 µm, "),
    ],
)
def test_the_note_of_a_figure_names_the_run_of_its_combinations(moduli: str, words: str) -> None:
    text = MADE + f"material: {{E: {moduli}, nu: 0.5}}\nsweep: {{pressures: [0.5, 1]}}"
    figure = roughvol.plot(roughvol.run(loads(text, "soft.yaml"), jobs=1), "v_of_p")
    notes = [note.get_text().replace("\n", " ") for note in figure.texts]
    assert any(note.startswith(words) for note in notes), notes


def test_a_case_of_several_combinations_counts_once_at_the_end_of_a_run() -> None:
    text = MADE + "material: {E: [5 MPa, 10 MPa], nu: 0.5}\nsweep: {steps: 3, to: {pressure: 1}}\n"
    text += "record: {fields_at: {free_volume: 1e-9}, transport: {percolation: every-step}}\n"
    told = ran("both", text)
    ds = roughvol.open("both")
    assert ds.residual.sizes == {"E": 2, "D": 1, "m": 1, "seed": 2, "step": 3}
    assert "2 cases in " in told
    assert "6 states, " in told
    assert "free_volume=1e-09 was not reached in 2 cases" in told
    spent = ds.observable_time.isel(E=0).sum(["D", "m", "seed"])
    shown = ", ".join(f"{one.observable.item()} {duration(float(one))}" for one in spent)
    assert f"time of the observables, all cases: {shown}" in told
    assert "12 states, " in ran("apart", text.replace("pressure: 1}", "pressure: 0.05 MPa}"))


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
    text = "material: {E_star: 10 MPa, hardness: [none, 5 MPa]}\nsweep: {steps: 1}\n"
    hard = loads(f"{MADE}{text}record: {{own: {{own_plastic_volume: sys:getsizeof}}}}", "hard.yaml")
    ds = roughvol.run(hard, jobs=1)
    assert np.isinf(ds.hardness.values[-1])
    own, of_yield = (
        [name in part.dataset for part in parts_of(ds)] for name in ("own_plastic_volume", "plastic_volume")
    )
    assert (own, of_yield) == ([True, True], [False, True])


def test_cases_without_lists_keep_their_id() -> None:
    plain = load("many.yaml").variants[0].study.cases()
    text = MANY.replace("[5 MPa, 10 MPa]", "5 MPa")
    assert [case.id for case in plain] == [case.id for case in loads(text, "many.yaml").cases()]
