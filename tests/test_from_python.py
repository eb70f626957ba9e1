"""The page "From Python": its code blocks run in order, and give what their comments say."""

import importlib.util
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import roughvol
from roughvol.study import load_creep

PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "from-python.md"
SMALLER = {  # sizes of the page: those of the tests
    '"steps": 8, "to": {"pressure": "0.6 MPa"}': '"steps": 4, "to": {"pressure": "0.6 MPa"}',
    '"n": 32, "rolloff": 4, "cut": 16': '"n": 16, "rolloff": 3, "cut": 7',
    '"length": "12 mm", "width": "1 mm"': '"length": "1.2 mm", "width": "0.1 mm"',
    '{"free_volume": "5 %"}': '{"free_volume": "50 %"}',
    '{"D": 2.3, "m": 4}, "sweep": {"steps": 8}': '{"D": 2.3, "m": 2}, "sweep": {"steps": 3}',
}
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def names(few_samples: None, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """All names after the blocks have run in an empty folder; ``printed`` has what they print."""
    names: dict[str, Any] = {"printed": []}
    names["print"] = lambda value: names["printed"].append(str(value))
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore", roughvol.RoughvolWarning)
        warnings.simplefilter("ignore", ImportWarning)  # SurfaceTopography runs without MPI
        names["folder"] = tmp_path_factory.mktemp("page")
        patch.chdir(names["folder"])
        for block in BLOCKS:
            if "SurfaceTopography" in block and importlib.util.find_spec("SurfaceTopography") is None:
                continue
            for size, smaller in SMALLER.items():
                block = block.replace(size, smaller)
            exec(compile(block, str(PAGE), "exec"), names)
    return names


def test_the_blocks_run(names: dict[str, Any]) -> None:
    assert len(BLOCKS) >= 10
    assert all(size in "".join(BLOCKS) for size in SMALLER)
    assert float(names["again"].free_volume[-1]) == float(names["pressed"].free_volume[-1])


def test_the_map_is_one_in_every_form(names: dict[str, Any]) -> None:
    """The comments on numbers hold: 0.02 MPa at the end, a length of 100 um from coordinates."""
    load = {"E": "10 MPa", "nu": 0.5, "to": {"pressure": "0.02 MPa"}, "steps": 2}
    forms = (roughvol.press(names["scan"], **load), roughvol.press(names["heights"], L="100 um", **load))
    for ds in forms:
        assert float(ds.nominal_pressure[-1]) == pytest.approx(0.02, rel=1e-5)
        assert (float(ds.L), ds.nominal_pressure.units) == (100.0, "MPa")
    assert float(forms[0].Sq) == pytest.approx(float(forms[1].Sq))


def test_the_six_things_give_what_their_comments_say(names: dict[str, Any]) -> None:
    assert re.findall(r"^## (\d)", PAGE.read_text(encoding="utf-8"), re.MULTILINE) == list("123456")
    at_load, needed, seal = names["at_load"], names["needed"], names["card"].seal
    assert needed.low <= needed.value <= needed.high
    assert (needed.unit, names["closing"].unit, seal.unit) == ("MPa", "MPa", "mm^3/s")
    assert needed.value < names["closing"].high
    first, second = names["history"].leak["x"].value[:2]
    assert first > second  # a material that creeps seals better
    assert names["cards"].plain()["seal"]["leak"] == seal.leak
    assert all((names["folder"] / page).exists() for page in names["pages"])
    assert set(names["found"].frame()["run"]) == {"m4", "m5"}
    saved = pd.read_csv(names["folder"] / "joint.csv")
    assert list(saved["state"]) == ["pressure=0.1 MPa"] * 2 + ["pressure=0.2 MPa"] * 2
    leak = at_load.leak_rate.sel(axis="x").values.ravel()
    assert saved["leak_rate_x"].to_numpy()[2:] == pytest.approx(leak, rel=1e-6)


def test_the_text_of_an_answer_has_no_datasets(names: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(names["folder"])
    answers = (roughvol.ask("joint"), names["cards"], roughvol.compare(["m4", "m5"]), roughvol.report_on(["joint"]))
    assert not any("xarray" in repr(answer) for answer in answers)


def test_messages_begin_as_their_comments_say(names: dict[str, Any]) -> None:
    said = re.findall(r"print\(\w+\)  # (.*?) \.\.\.$", "\n".join(BLOCKS), re.MULTILINE)
    assert len(said) == len(names["printed"]) == 4
    for printed, start in zip(names["printed"], said, strict=True):
        assert printed.startswith(start)


def pressed() -> xr.Dataset:
    """A dataset in memory."""
    return roughvol.press(np.eye(3), L=2.0, steps=1, surface={"sides": "free"})


TINY = {"name": "tiny", "surface": {"D": 2.5, "m": 3, "seeds": 2}, "sweep": {"steps": 2}}
RUNS = "runs are a list of names, paths and datasets, given a value of the type "
WRONG: list[tuple[Callable[[Any], Any], Any, str]] = [
    (roughvol.run, 3, "a study is a file, a mapping or a Study, given a value of the type int"),
    *(
        (take, "surface: {D: 2.5, m: 3}\n", "a study file is a path, given the text of a study")
        for take in (roughvol.run, roughvol.load)
    ),
    (roughvol.status, 3, "a study is a file, a mapping or a Study, given a value of the type int"),
    (roughvol.check, {"surface": {"D": 9.0, "m": 3}}, r'study\["surface"\]\["D"\]: must be < 3, given 9'),
    (roughvol.card, xr.Dataset(), "a study is a file, a mapping or a Study, given a value of the type Dataset"),
    (roughvol.run, xr.Dataset(), "a study is a file, a mapping or a Study, given a value of the type Dataset"),
    (roughvol.campaign.estimate, {}, "a study is a Study, as of roughvol.load, given a value of the type dict"),
    (roughvol.open, 3, "a run is a name or a path, given a value of the type int"),
    (roughvol.show, b"joint", "a run is a name, a path or a dataset, given a value of the type bytes"),
    (roughvol.compare, "joint", f"{RUNS}str"),
    (roughvol.compare, 3, f"{RUNS}int"),
    (roughvol.compare, xr.Dataset(), f"{RUNS}Dataset"),
    (roughvol.report_on, Path("joint"), f"{RUNS}PosixPath"),
    (roughvol.report_on, {"joint": 1}, f"{RUNS}dict"),
    (roughvol.plot, {}, "plot takes one run or more, given an empty mapping"),
    (roughvol.plot, ["joint"], 'several runs are a mapping of their labels, as {"fine": "seal"}, given .* list'),
    (lambda figure: roughvol.plot(pressed(), figure), 3, "a figure is text, given a value of the type int"),
    (lambda name: pressed().roughvol.mean(name), ["seed"], "a dimension is text, given a value of the type list"),
    (lambda name: pressed().roughvol.quantity(name), [], "the name of a variable is text, given a value .* list"),
    (
        lambda names: pressed()[names].roughvol.at(pressure=0.1),
        ["free_volume"],
        "the dataset has no mean_pressure; allowed: all variables of a run",
    ),
    (lambda names: roughvol.ask(pressed()[names]), ["free_volume"], "the run has no mean_pressure; allowed: all"),
    (roughvol.explain, "surface.d", r"no key and no variable 'surface\.d'; did you mean 'surface\.D'\?;"),
    (roughvol.check, TINY | {"record": {"own": {"a": int}}}, ".* type; a function has its name here.*function$"),
    (roughvol.explain, 3, "a name is text, given a value of the type int"),
    (roughvol.load, None, "a study file is a path, given a value of the type NoneType"),
    (roughvol.runs, 3, "the folder of runs is a path, given a value of the type int"),
    (load_creep, 3, "a creep law is a mapping or the path of its file, given a value of the type int"),
    (lambda jobs: roughvol.check(TINY, jobs=jobs), 2.5, "jobs is 2.5; allowed: a whole number, 1 or more"),
    (lambda at: roughvol.run(TINY, scheduler=at), 3, "the scheduler's address is text, given a value of the type int"),
    (lambda out: roughvol.card(TINY, out=out), 3, "the folder of the results is a path, given a value of the type int"),
    (lambda fresh: roughvol.run(TINY, fresh=fresh), "no", "fresh is True or False, given a value of the type str"),
    (lambda only: roughvol.run(TINY, only=only), "id", "only is a list of ids of cases, given a value of the type str"),
    (lambda only: roughvol.run(TINY, only=only), [3], "only: 3 names no case of this study"),
    (lambda changes: roughvol.show(pressed(), changes=changes), "surface.m=6", "changes are of a run by name or path;"),
    (lambda changes: roughvol.plot(pressed(), changes=changes), {"material.E": 5}, "changes are of a run by name"),
    (lambda load: roughvol.show(pressed(), load), {"pressure": []}, "pressure has no value; allowed: a value or a"),
    (load_creep, "law\0.yaml", r"law\\x00\.yaml: cannot read the creep law: embedded null byte"),
    (lambda L: roughvol.check(TINY, changes={"surface.L": L}), np.nan, r"changes: surface\.L: must be a finite number"),
    (lambda z: roughvol.check(TINY, changes={"surface.heights": z}), np.eye(3), ".* surface.heights of the study"),
    (lambda L: roughvol.check(TINY, changes={"surface.L": L}), -(10**400), r"changes: surface\.L: .* beyond 1\.8e308"),
    (lambda leak: roughvol.ask(pressed(), leak_rate=leak), np.nan, "leak_rate: must be a finite number, given nan"),
    (lambda changes: roughvol.check(TINY, changes=changes), 3, "changes are a mapping, .* the type int"),
]


@pytest.mark.parametrize(("function", "argument", "words"), WRONG)
def test_an_argument_of_a_type_without_meaning_is_named(
    function: Callable[[Any], Any], argument: Any, words: str, here: Path
) -> None:
    with pytest.raises(roughvol.errors.RoughvolError, match=f"^{words}"):
        function(argument)
    assert not list(here.iterdir())


def test_labels_name_the_runs_of_a_comparison() -> None:
    """Two datasets in memory had the name press both."""
    rows = roughvol.compare({"soft": pressed(), "hard": pressed()}, "last").records().frame()
    assert rows["run"].tolist() == ["soft", "hard"]


def test_cases_are_taken_from_a_generator(tmp_path: Path) -> None:
    first, second = (case.id for case in roughvol.study.of_data(TINY).cases())
    ds = roughvol.run(TINY, out=tmp_path, jobs=1, only=(id for id in [second]))
    assert ds.attrs["case_ids"] == f'["{second}"]'
    assert first not in ds.attrs["case_ids"]
