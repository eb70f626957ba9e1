"""The run of a name, a folder, a study.nc or a study file: the numbers are those of the study, or they are refused."""

import contextlib
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

import roughvol
from roughvol.report.figures.style import Drawing
from roughvol.store import StoredRun, run_folder, same_study
from roughvol.study import loads
from roughvol.study.axes import choices
from tests.kit import LEAKING, refused, said, succeeded

TEXT = LEAKING.replace("{steps: 8, to: {pressure: 0.5 MPa}}", "{pressures: [0.1 MPa, 0.2 MPa]}")
SCAN = TEXT.replace("{D: 2.3, m: 4, seeds: 1, L: 100 um, Sq: 1 um}", "{file: heights.txt, L: 100 um, heights_unit: um}")


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with contextlib.chdir(folder := tmp_path_factory.mktemp("computed")):
        Path("tiny.yaml").write_text(TEXT, encoding="utf-8")
        roughvol.run("tiny.yaml", jobs=1)
        np.savetxt("heights.txt", _heights(0))
        Path("scan.yaml").write_text(SCAN, encoding="utf-8")
        roughvol.run("scan.yaml", jobs=1)
    return folder


@pytest.fixture
def place(computed: Path, here: Path) -> Path:
    return Path(shutil.copytree(computed, here, dirs_exist_ok=True))


def _heights(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(9, 9))


@pytest.mark.parametrize(
    ("old", "new", "difference"),
    [
        ("m: 4", "m: 3", "surface.m: 4 → 3"),
        ("E: 10 MPa", "E: 20 GPa", 'material.E: "10 MPa" → "20 GPa"'),
        ("seeds: 1", "seeds: 2", "surface.seeds: [0] → [0, 1]"),
        ("1 mPa*s", "2 mPa*s", '→ "2 mPa*s"'),
    ],
)
def test_changed_studies_are_refused(place: Path, old: str, new: str, difference: str) -> None:
    Path("tiny.yaml").write_text(TEXT.replace(old, new), encoding="utf-8")
    message = refused("show", "tiny.yaml")
    assert difference in message
    assert "roughvol run tiny.yaml" in message
    assert "runs/tiny" in message


def test_the_run_advised_for_a_changed_study_computes_it(place: Path) -> None:
    text = TEXT.replace("0.2 MPa]", "0.3 MPa]")
    Path("tiny.yaml").write_text(text, encoding="utf-8")
    assert "roughvol run tiny.yaml --set name=OTHER, or --fresh" in refused("show", "tiny.yaml")
    said("run", "tiny.yaml", "--set", "name=OTHER", "--jobs", "1")
    said("show", "tiny.yaml", "--set", "name=OTHER", "--set", "material.E=10000 kPa")  # no other number
    assert 'surface.L: "100 um"' in refused("show", "OTHER", "--set", "surface.L=0.1 mm")  # the unit of stored lengths
    Path("tiny.yaml").write_text(TEXT.replace("seeds: 1", "seeds: 2"), encoding="utf-8")
    assert "roughvol run tiny.yaml; to see" in refused("show", "tiny.yaml")  # which keeps the cases of the run
    said("run", "tiny.yaml", "--jobs", "1")
    said("show", "tiny.yaml")


LISTED = TEXT.replace("E: 10 MPa", "E: [10 MPa, 20 MPa]").replace("L: 100", "sides: mirrored, L: 100")
LISTED = LISTED.replace("nu: 0.5", "nu: 0.5, thickness: [none, 50 um]").replace("0.2 MPa]", "0.2 MPa, 0.4 MPa]")


@pytest.mark.parametrize("thickness", ["none", "50 um"])
def test_a_study_with_values_of_the_lists_of_a_run_opens_their_results(here: Path, thickness: str) -> None:
    Path("listed.yaml").write_text(LISTED, encoding="utf-8")
    roughvol.run("listed.yaml", jobs=1)
    changes = ["material.E=20 MPa", f"material.thickness={thickness}"]
    alone = roughvol.run("listed.yaml", changes=[*changes, "name=alone"], jobs=1)
    for run in ("listed", "listed.yaml"):
        found = roughvol.open(run, changes=changes)
        assert (found.sizes["E"], found.sizes["thickness"]) == (1, 1)
        for name in ("nominal_pressure", "leak_rate", "free_volume", "Sq"):
            np.testing.assert_array_equal(found[name].squeeze(), alone[name].squeeze())
    half = roughvol.open("listed", changes=["material.E=[20 MPa]"])
    assert (half.sizes["E"], half.sizes["thickness"]) == (1, 2)
    leak = f"{float(alone['leak_rate'].sel(axis='x')[..., 1].item())!r} mm^3/s"
    asked, exact = roughvol.ask("listed", leak_rate=leak, changes=changes), roughvol.ask("alone", leak_rate=leak)
    assert asked.plain()["answers"] == exact.plain()["answers"]
    assert asked.plain()["answers"][0]["value"] == pytest.approx(0.2)
    texts = [said("ask", "listed", "--leak-rate", leak, *_set(*changes)), said("ask", "alone", "--leak-rate", leak)]
    first, second = (text.splitlines()[1:3] for text in texts)  # along x and y
    assert first == second
    assert texts[0].startswith(f"listed, E = 20 MPa, thickness = {thickness}: ")
    assert f"roughvol card listed --set 'material.E=20 MPa' --set {shlex.quote(changes[1])}" in texts[0]
    for change in ("material.E=30 MPa", "material.E=20 kPa", "material.E=[20 MPa, 30 MPa]", "surface.m=3"):
        with pytest.raises(roughvol.errors.FolderError, match="does not hold the results of listed"):
            roughvol.open("listed", changes=[*changes, change])


@pytest.fixture(scope="module")
def of_lists(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the run ``many`` of a height file, with lists of all kinds, and of its study file."""
    text = SCAN.replace("L: 100 um", "L: 100 um, level: [none, tilt]").replace("0.5}", "0.5, thickness: [none, 50 um]}")
    text = text.replace("{pressures: [0.1 MPa, 0.2 MPa]}", "{steps: 3, to: [percolation, {pressure: 0.4 MPa}]}")
    with contextlib.chdir(folder := tmp_path_factory.mktemp("of_lists")):
        np.savetxt("heights.txt", _heights(0))
        Path("many.yaml").write_text(f"{text}  region: [none, interior]\n", encoding="utf-8")
        roughvol.run("many.yaml", jobs=1)
    return folder


@pytest.fixture
def in_lists(of_lists: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in the folder of the run ``many``, which stays as it is."""
    monkeypatch.chdir(of_lists)


@pytest.fixture
def many(of_lists: Path, here: Path) -> Path:
    """Return a copy of the run ``many``, in a current folder without its study file and its heights."""
    return Path(shutil.copytree(of_lists / "runs", here / "runs")) / "many"


def _set(*changes: str) -> list[str]:
    """Return the words of a command for changes."""
    return [word for change in changes for word in ("--set", change)]


CHANGES = ("surface.level=tilt", "material.thickness=50 um", "sweep.to={pressure: 0.4 MPa}", "record.region=none")
PART = "level=tilt_thickness=50_um_pressure=0.4_MPa_region=whole"


def test_the_refusal_of_a_run_with_lists_has_the_changes_that_open_a_part(many: Path) -> None:
    message = refused("ask", "many", "--closed")
    assert "several thickness (50 um, none); allowed: surfaces of one kind at one value of each key" in message
    keys = [text.split(" or ") for text in message.rstrip().partition("opens by a change of each key: ")[2].split("; ")]
    assert len(keys) == 4
    for first, second in keys:
        assert roughvol.open("many", changes=shlex.split(first)[1:]).nbytes < roughvol.open("many").nbytes
        assert roughvol.open("many", changes=shlex.split(second)).nbytes < roughvol.open("many").nbytes
    chosen = [word for first, _ in keys for word in shlex.split(first)]
    assert len(roughvol.ask("many", changes=chosen[1::2]).answers) == 2
    labels = eval(f"dict({message.partition('in Python ds.sel(')[2].partition(');')[0]})")
    assert len(roughvol.ask(roughvol.open("many").sel(labels)).answers) == 2


@pytest.mark.parametrize(
    "text",
    [
        "material: [{E: 5 MPa, nu: 0.3}, {E_star: 3 GPa}, {E: 5 MPa, nu: 0.3, against: {E: 2 GPa, nu: 0.3}}]",
        "material: {E_star: [3.0, 4.0], hardness: [none, 1.0]}\nsweep: {to: [mean-plane, {contact_area: 0.2}]}",
    ],
)
def test_each_change_that_chooses_from_a_list_gives_a_part_of_its_study(text: str) -> None:
    study = loads(f"surface: {{D: 2.3, m: 3, L: 1 mm, Sq: 1 um}}\n{text}")
    for axis, changes in choices(study).items():
        for label, change in changes.items():
            part = loads(study.stored(), of_run="study.yaml", changes=[change])
            assert same_study.part(part, study)[axis] == [label]


@pytest.mark.parametrize(
    ("first", "same"),
    [
        ("material.thickness=50 um", "material.thickness=0.05 mm"),
        ("material.thickness=[50 um]", "material.thickness=[50000 nm]"),
        ("sweep.to={pressure: 0.4 MPa}", "sweep.to={pressure: 4 bar}"),
    ],
)
@pytest.mark.usefixtures("in_lists")
def test_a_value_of_a_list_opens_in_any_unit(first: str, same: str) -> None:
    for run in ("many", "many.yaml"):
        assert roughvol.open(run, changes=[same]).identical(roughvol.open(run, changes=[first]))
        assert said("status", run, "--set", same) == said("status", run, "--set", first)


@pytest.mark.usefixtures("no_figures")  # of the report
def test_the_figures_and_pages_of_a_part_lie_beside_those_of_the_run(many: Path) -> None:
    law = Path("law.yaml")
    law.write_text("power: {exponent: 0.1, time: 1 s}", encoding="utf-8")
    said("plot", "many", "v_of_p")
    names = ("figures/v_of_p.png", "report.html", "report.md", "claims.json", "creep.csv", "creep.png")
    for name in names[1:]:
        (many / name).write_text("of the run", encoding="utf-8")
    before = {path: path.read_bytes() for path in many.rglob("*") if path.is_file()}
    said("plot", "many", "v_of_p", *_set(*CHANGES))
    said("report", "many", *_set(*CHANGES))
    said("creep", "many", "--law", law, "--at", "pressure=0.15MPa", "--times", "1 s", *_set(*CHANGES))
    after = {path: path.read_bytes() for path in many.rglob("*") if path.is_file()}
    assert {path: after[path] for path in before} == before
    made = {str(path.relative_to(many)) for path in after.keys() - before.keys()}
    assert made == {f"{PART}/{name}" for name in names}


def _note_of(drawn: Drawing) -> str:
    return " ".join(" ".join(text.get_text().split()) for text in drawn.texts)


def test_changes_without_a_run_are_those_of_the_latest_run_and_of_each_run(many: Path) -> None:
    given = _set(*CHANGES)
    assert said("show", *given) == said("show", "many", *given) != said("show")
    assert said("plot", "v_of_p", *given) == said("plot", "many", "v_of_p", *given)
    drawn = roughvol.plot("many", "v_of_p", changes=CHANGES[1:])  # the level is varied, all else is shared
    assert [line.get_label() for line in drawn.axes[0].get_lines()][:2] == ["level = none", "level = tilt"]
    assert "Run many, thickness = 50 um, pressure=0.4 MPa, region = whole: level = none" in _note_of(drawn)
    shutil.copytree(many, "runs/other")
    Path("alone.yaml").write_text(f"name: alone\n{TEXT}", encoding="utf-8")  # without a height file
    roughvol.run("alone.yaml", jobs=1)
    found = roughvol.report_on(changes=CHANGES)
    assert [run.pages.name for run in found.runs] == [PART, PART]
    assert [text.partition(":")[0] for text in found.refused] == ["runs/alone"]


@pytest.mark.usefixtures("in_lists")
def test_the_status_of_a_part_counts_the_cases_of_the_run_as_its_own() -> None:
    whole, part = roughvol.status("many"), roughvol.status("many", changes=CHANGES)
    assert len(whole.done) > len(part.done) == 1
    assert (part.strange, part.collected, part.missing) == (0, True, ())


def test_the_command_of_an_answer_repeats_the_changes_of_its_run(many: Path) -> None:
    asked = roughvol.ask("many", changes=CHANGES)
    text = f"roughvol run many {shlex.join(_set(*CHANGES))}"
    assert asked.command().startswith(f"{text} --set name=many_closer --set ")
    assert asked.plain()["narrower"] == asked.command()
    assert roughvol.ask(changes=CHANGES).command() == asked.command()  # of the latest run


def test_the_attributes_of_a_part_have_the_lines_of_its_combinations(many: Path) -> None:
    whole, part = (roughvol.open("many", changes=changes).attrs["region"] for changes in ((), CHANGES[3:]))
    assert "interior" in whole
    assert part.splitlines() == [line for line in whole.splitlines() if "interior" not in line]


@pytest.mark.usefixtures("in_lists")
def test_results_that_share_no_case_are_kept_from_a_run() -> None:
    assert "--set sweep.steps=4 --set name=OTHER, or --fresh" in refused("show", "many", "--set", "sweep.steps=4")
    message = refused("show", "many", "--set", "material.nu=0.4")  # starred numbers of a half space have no modulus
    assert "to compute them: roughvol run many --set material.nu=0.4; to see" in message


def test_a_part_of_a_file_name_has_a_limit_and_several_texts_have_several() -> None:
    for text, kept in (("E = 5 MPa, m = 3", "E=5_MPa_m=3"), ("Fläche 1.npy", "Fläche_1.npy")):
        assert run_folder.slug(text) == kept
    for text in ("E = 5 MPa, " * 100, "a" * 151):
        name = run_folder.slug(text)
        assert len(name) == run_folder.LONGEST
        assert name != run_folder.slug(f"{text}b")
    assert len(run_folder.slug("ä" * 150).encode()) <= run_folder.LONGEST
    names = run_folder.slugs(["a b.npy", "a_b.npy", "c d.npy", "(.npy", ").npy"])
    assert len(set(names.values())) == len(names)
    assert names["c d.npy"] == "c_d.npy"


def test_a_moved_run_of_height_files_opens_in_parts(many: Path, of_lists: Path) -> None:
    part = roughvol.open("many", changes=CHANGES)
    moved = many.rename("moved")
    assert roughvol.open(moved, changes=CHANGES).identical(part)
    message = refused("ask", "moved", "--closed", "--budget", *_set(*CHANGES))
    assert "surface.file: no such file" in message  # a card presses the heights
    shutil.copy(of_lists / "heights.txt", moved)
    assert roughvol.status("moved", changes=CHANGES).collected


def test_a_run_of_a_part_says_that_study_nc_has_its_cases_alone(of_lists: Path, here: Path) -> None:
    shutil.copytree(of_lists, here, dirs_exist_ok=True)
    spelled = [change.replace("0.4 MPa", "400 kPa") for change in CHANGES]
    done = succeeded("run", "many.yaml", *_set(*spelled), "--jobs", "1")
    assert roughvol.open("many", changes=CHANGES)["mean_pressure"].size > 0  # the run has the values as they were
    assert (
        "runs/many/study.nc gets the cases of this study alone; runs/many/cases keeps files of other cases: "
        in done.stderr
    )


def test_a_changed_height_file_does_not_get_the_numbers_of_the_old_one(place: Path) -> None:
    np.savetxt("heights.txt", _heights(1))
    message = refused("compare", "scan.yaml", "tiny")
    assert "surface.file: the content of heights.txt" in message
    assert "roughvol run scan.yaml" in message


def test_a_run_from_another_folder_does_not_take_heights_of_equal_name(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("elsewhere").mkdir()
    monkeypatch.chdir("elsewhere")
    np.savetxt("heights.txt", _heights(1))
    for command in ("card", "check", "tradeoff"):
        for changes in ((), ("--set", "name=other", "--set", "sweep.pressures=[0.1 MPa]")):
            assert "the content of heights.txt has changed" in refused(command, "../runs/scan", *changes)
    assert "heights.txt" in said("check", "../runs/scan", "--set", "surface.file=heights.txt")
    assert "heights.txt" in said("check", "../scan.yaml")


@pytest.mark.parametrize("run", ["scan", "runs/scan/study.nc"])
def test_a_run_opens_by_its_name_without_its_height_file(place: Path, run: str) -> None:
    Path("heights.txt").unlink()
    said("show", run)
    assert StoredRun.open(run).name == "scan"


@pytest.mark.parametrize("run", ["tiny", "runs/tiny/study.nc", "tiny.yaml"])
def test_an_interrupted_extension_is_not_shown(place: Path, monkeypatch: pytest.MonkeyPatch, run: str) -> None:
    Path("tiny.yaml").write_text(TEXT.replace("seeds: 1", "seeds: 3"), encoding="utf-8")
    asked = iter([False, False, True])
    with pytest.raises(KeyboardInterrupt):
        roughvol.run("tiny.yaml", jobs=1, stopping=lambda: next(asked, True))
    message = refused("show", run)
    assert "surface.seeds: [0] → [0, 1, 2]" in message
    assert "roughvol run" in message


@pytest.mark.parametrize("run", ["tiny", "runs/tiny/study.nc", "tiny.yaml"])
def test_the_results_of_another_run_are_not_shown_as_those_of_this_one(place: Path, run: str) -> None:
    shutil.copy("runs/scan/study.nc", "runs/tiny/study.nc")
    message = refused("show", run)
    assert "surface.file" in message
    assert "runs/tiny" in message


def test_the_results_of_a_run_of_equal_settings_and_other_heights_are_not_those_of_this_one(place: Path) -> None:
    Path("other").mkdir()
    np.savetxt("other/heights.txt", _heights(1))
    shutil.copy("scan.yaml", "other/scan.yaml")
    roughvol.run("other/scan.yaml", out="runs/other", jobs=1)
    shutil.copy("runs/other/study.nc", "runs/scan/study.nc")
    assert "heights-" in refused("show", "scan")


def test_words_of_a_study_file_change_no_number(place: Path) -> None:
    Path("tiny.yaml").write_text(f"# a comment\nname: tiny\n{TEXT}comment: measured twice\n", encoding="utf-8")
    said("show", "tiny.yaml")


def test_a_copied_study_nc_opens_in_a_folder_of_its_own(place: Path) -> None:
    Path("elsewhere").mkdir()
    for name in ("study.nc", "kept.nc"):
        shutil.copy("runs/tiny/study.nc", f"elsewhere/{name}")
    assert [StoredRun.open(run).name for run in ("elsewhere", "elsewhere/kept.nc")] == ["elsewhere", "kept"]


def test_the_file_of_a_case_is_no_run(place: Path) -> None:
    (case,) = Path("runs/tiny/cases").glob("*.nc")
    assert "the file of one case" in refused("show", str(case))


def test_a_run_by_name_with_another_name_is_the_run_of_that_name(place: Path) -> None:
    changes = ["--set", "surface.m=3", "--set", "name=coarse"]
    assert said("run", "tiny", *changes, "--jobs", "1").endswith("runs/coarse/study.nc\n")
    assert said("show", "tiny", *changes) == said("show", "coarse")
    absent = refused("show", "tiny", "--set", "surface.m=3", "--set", "name=other")
    assert "to compute them: roughvol run tiny --set surface.m=3 --set name=other" in absent


def test_commands_in_messages_have_paths_as_words_of_a_shell(place: Path) -> None:
    shutil.copy("tiny.yaml", "my tiny.yaml")
    assert "roughvol run 'my tiny.yaml' --set name=other" in refused("show", "my tiny.yaml", "--set", "name=other")
    shutil.copytree("runs/tiny", "my run")
    Path("my run/study.nc").unlink()
    assert "roughvol status 'my run'" in refused("show", "my run")


def test_a_problem_of_a_stored_study_is_placed_in_its_file(place: Path) -> None:
    Path("heights.txt").rename("moved.txt")
    told = refused("check", "scan")
    assert "runs/scan/study.yaml:2: surface.file: no such file" in told
    assert (
        "a run has the names of its height files alone: call in the folder they begin in, or give the study file"
        in told
    )
    Path("runs/tiny/study.yaml").write_text("name: [\n", encoding="utf-8")
    assert "runs/tiny/study.yaml:2: not YAML" in refused("status", "tiny")
    Path("heights.txt").write_text("1 2 3", encoding="utf-8")
    assert f"runs/scan/study.yaml:2: surface.file: {Path.cwd()}/heights.txt: " in refused("check", "scan")


def test_the_status_of_a_finished_run_needs_no_height_file(place: Path) -> None:
    there = said("status", "scan")
    assert "runs/scan: 1 of 1 cases finished, collected" in there
    Path("heights.txt").rename("moved.txt")
    assert said("status", "scan") == there == said("status", "runs/scan/study.nc")
    assert "no such file" in refused("status", "scan", "--set", "sweep.steps=2")
    next(Path("runs/scan/cases").glob("*.nc")).unlink()
    assert "no such file" in refused("status", "scan")


def test_a_name_longer_than_any_file_has_no_results(place: Path) -> None:
    for command in ("show", "status", "plot"):
        refused(command, "n" * 300)
