"""Quantities of a user: functions named in a study, computed, stored, averaged and drawn as built-in ones."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import roughvol
from roughvol.campaign import batch, collect
from roughvol.errors import CampaignError, DatasetError, StudyError
from roughvol.observables.variables import QUANTITIES, VARIABLES
from roughvol.study import loads
from roughvol.study.values import own
from tests.campaign.kit import values_of
from tests.kit import call, refused, said

STUDY = """
name: gaps
surface: {D: 2.3, m: 4, L: 100 um, Sq: 1 um, seeds: 2}
material: {E: 10 MPa, nu: 0.5}
sweep: {steps: 3, to: {pressure: 0.5 MPa}}
record: {own: {OWN}}
"""
MODULE = """
import numpy as np

def largest(state):
    '''Largest gap'''
    assert not state.gap.flags.writeable and state.axis_names == ("x", "y")
    return state.gap.max() * state.Sq

largest.units, largest.version = "length", "VERSION"

def rows(state):
    return state.gap.mean(axis=1)[None]

def halves(state):
    middle = len(state.gap) // 2
    return [state.gap[:middle].mean(), state.gap[middle:].mean()]

halves.coordinates = {"half": [0.0, 1.0]}

def nominal(state):
    return [state.contact.mean(), state.pressure.mean(), state.mean_pressure, state.separation, state.spacing]

nominal.coordinates = {"part": range(5)}

def labelled(dimension, labels):
    def of(state):
        return [0.0] * len(labels)

    of.coordinates = {dimension: labels}
    return of

sides, words, twice = labelled("half", [1.0, 2.0]), labelled("side", ["left", "right"]), labelled("part", [1.0, 1.0])
unknown, none = labelled("part", [1.0, float("nan")]), labelled("part", [])
sloped, three = labelled("dz/dx", [0.0, 1.0]), labelled("axis", range(3))

def forgotten(state):
    state.gap.max()

def failing(state):
    return 1.0 / int(state.mean_pressure * 0.0)

def leaving(state):
    raise SystemExit("gap too wide")

def p(state):
    return state.mean_pressure

p.touch = 0.0

def closed(state):
    return float("nan")

def masked(state):
    return np.ma.masked_less(state.gap, 1e9).mean()
"""
ENSEMBLE = """
name: means
surface: {D: 2.3, m: 2, L: 100 um, Sq: 1 um}
material: {E: 10 MPa, nu: 0.5}
sweep: {steps: 5, to: {indentation: 2}}
record: {own: {OWN}}
ensemble: {accuracy: {ACCURACY}, at: AT}
"""
PACKAGE = frozenset(VARIABLES)
TUTORIAL = Path(__file__).parents[1] / "docs" / "tutorials" / "own-quantity.md"


def forget():
    """Leave no row, and import the modules of quantities anew, as another process does."""
    for name in set(VARIABLES) - PACKAGE:
        del VARIABLES[name], QUANTITIES[name]
    for module in ("mine", "gaps", "my_gaps", "leakage", "loud"):
        sys.modules.pop(module, None)
    own.function_of.cache_clear()


def study(functions, version="", text=STUDY):
    """A study with quantities, after its module is written to the current folder."""
    Path("mine.py").write_text(MODULE.replace("VERSION", version))
    Path("script.py").write_text("raise SystemExit('usage: script.py FILE')")
    forget()
    return loads(text.replace("OWN", functions))


def ensemble(functions, accuracy, at="{indentation: [0.5, 1.1]}"):
    """A study whose means are those of quantities."""
    return study(functions, text=ENSEMBLE.replace("ACCURACY", accuracy).replace("AT", at))


@pytest.fixture(autouse=True)
def _folder(here, few_samples):
    """Work in an empty folder, with ensembles of few samples; leave no rows and no module behind."""
    yield
    forget()


def test_numbers_and_arrays_are_stored_averaged_read_between_steps_and_drawn():
    functions = "largest_gap: mine:largest, halves: mine:halves, parts: mine:nominal, far: mine:masked"
    ds = roughvol.run(study(functions), jobs=1)
    assert ds.largest_gap.attrs == {"units": "um", "long_name": "Largest gap", "symbol": "largest_gap"}
    assert ds.far.isnull().all()  # a masked number is missing
    assert ds.halves.dims == ("D", "m", "seed", "step", "half")
    weighted = (ds.halves * np.array([8.0, 9.0]) / 17.0).sum("half")
    np.testing.assert_allclose(weighted, ds.free_volume, rtol=1e-12)
    area, pressure, p, d, spacing = (ds.parts.isel(part=k) for k in range(5))
    np.testing.assert_array_equal(area, ds.contact_area_fraction)
    np.testing.assert_allclose(pressure, ds.mean_pressure, rtol=1e-12)
    np.testing.assert_array_equal(p, ds.mean_pressure)
    np.testing.assert_array_equal(d, ds.separation)
    np.testing.assert_allclose(spacing, 100.0 / 16.0)
    assert np.isfinite(ds.roughvol.mean("seed").largest_gap).all()
    there = ds.roughvol.at(pressure="0.3 MPa").largest_gap
    assert (ds.largest_gap[..., -1] < there.squeeze()).all()
    figure = roughvol.plot(ds, "largest_gap_of_p")
    assert figure.axes[0].get_ylabel() == "Largest gap [µm]"
    words = "95 % quantile of the gap of all open elements at a load"
    figure = roughvol.plot(ds.assign(largest_gap=ds.largest_gap.assign_attrs(long_name=words)), "largest_gap_of_p")
    figure.draw_without_rendering()
    assert figure.axes[0].yaxis.label.get_window_extent().height < figure.bbox.height  # it is not cut off


def test_a_new_version_computes_anew_and_an_absent_function_leaves_what_is_stored():
    first = study("largest_gap: mine:largest").cases()
    second = study("largest_gap: mine:largest", version="2").cases()
    without = loads(STUDY.replace("own: {OWN}", "")).cases()
    assert len({case.id for case in (*first, *second, *without)}) == 6
    ds = roughvol.run(study("largest_gap: mine:largest"), jobs=1)
    Path("mine.py").unlink()
    forget()
    again = roughvol.open("gaps")
    np.testing.assert_array_equal(again.largest_gap, ds.largest_gap)
    assert roughvol.plot("gaps", "largest_gap_of_p").axes
    open_wide = again.assign(largest_gap=again.largest_gap.where(again.seed == 1, np.inf))
    (line,) = roughvol.plot(open_wide, "largest_gap_of_p").axes[0].get_lines()  # of the surface with finite numbers
    np.testing.assert_array_equal(line.get_ydata(), ds.largest_gap.sel(seed=1).squeeze())


@pytest.mark.parametrize(("before", "after"), [("largest", "halves"), ("halves", "largest"), ("halves", "nominal")])
def test_a_function_that_returns_another_shape_needs_another_version(before, after):
    roughvol.run(study(f"number: mine:{before}"), jobs=1)
    text = Path("mine.py").read_text().replace(f"def {before}(", "def old(").replace(f"{before}.coo", "old.coo")
    text = text.replace("largest.units, largest.version", "version, _")
    more = loads(STUDY.replace("seeds: 2", "seeds: 3").replace("OWN", f"number: mine:{before}"))
    Path("mine.py").write_text(f"{text}\n{before} = {after}\n")
    forget()
    with pytest.raises(DatasetError, match=r"number has other dimensions in some cases .* another attribute version"):
        roughvol.run(more, jobs=1)


@pytest.mark.parametrize(
    ("functions", "words"),
    [
        (
            "a: nosuch:f, b: mine:nosuch",
            r"own\.a: cannot import 'nosuch:f' .ModuleNotFoundError[\s\S]*own\.b: cannot .*no attribute 'nosuch'",
        ),
        (
            "largest_gap: script:largest",
            "cannot import 'script:largest' .*script ends the program .*: usage: script.py FILE",
        ),
        ("largest_gap: nosuch", "no entry point of roughvol.observables; allowed: module:function, or an entry point"),
        ("gap: 'mine:f()', b: 3", r"own\.gap: is no function; .* given 'mine:f\(\)'\n.*own\.b: is no .* given 3"),
        ("Largest gap: mine:largest", r"own\.Largest gap: is no name; .* given 'Largest gap'"),
        ("free_volume: mine:largest", "free_volume is the name of another number of tables or files: choose another"),
        ("state: mine:largest", "record.own.state: state is the name of another number"),
        ("free_volume_range: mine:largest", "free_volume_range is the name of another number"),
        ("a: mine:largest, a_count: mine:nominal", "record.own.a_count: a_count is the name of another number"),
        ("leak_rate_x: mine:largest", "leak_rate_x is the name of another number"),
        ("a: mine:halves, b: mine:sides", "record.own.b: mine:sides has other labels of half than another quantity"),
        ("a: mine:words", "record.own.a: mine:words has labels of side that are equal or no finite numbers"),
        ("a: mine:twice", "labels of part that are equal or no finite numbers; allowed: finite numbers, each once"),
        ("a: mine:unknown", "labels of part that are equal or no finite numbers"),
        ("a: mine:none", "labels of part that are equal or no finite numbers"),
        ("a: mine:sloped", "mine:sloped has the dimension 'dz/dx'; allowed: letters, digits and _"),
        ("part: mine:nominal", "mine:nominal has the dimension 'part'; allowed: .* not the name of the quantity"),
        ("a: mine:three", "record.own.a: mine:three has 3 labels of axis; allowed: x and y"),
        ("", "must be a mapping of names to functions"),
    ],
)
def test_refused(functions, words):
    with pytest.raises(StudyError, match=words):
        roughvol.check(study(functions))


@pytest.mark.parametrize(
    ("functions", "words"),
    [
        ("bad: mine:failing", r"record.own.bad: mine:failing fails at p\* = .*ZeroDivisionError"),
        ("bad: mine:leaving", r"record.own.bad: mine:leaving fails at p\* = .* .SystemExit: gap too wide"),
        ("bad: mine:rows", r"record.own.bad: mine:rows returns shape \(1, 17\); allowed: a number"),
        ("bad: mine:forgotten", "record.own.bad: mine:forgotten returns nothing; allowed: a number"),
    ],
)
def test_a_function_that_fails_names_itself(functions, words):
    with pytest.raises(CampaignError, match=words):
        roughvol.run(study(functions), jobs=1)


def test_what_a_module_prints_is_no_part_of_an_answer():
    Path("loud.py").write_text("print('imported')\n\ndef one(state):\n    print('called')\n    return 1.0\n")
    Path("loud.yaml").write_text(STUDY.replace("OWN", "one: loud:one").replace("gaps", "loud"))
    done = call("run", "loud.yaml", "--json", "--jobs", "1")
    assert json.loads(done.stdout)["rows"][0]["one"] == 1.0
    assert {"imported", "called"} <= set(done.stderr.splitlines())
    assert "imported" not in said("show", "loud", "--csv")
    assert said("show", "--help").startswith("Usage: ")


def test_the_mean_of_a_function_is_that_of_the_built_in_quantity_it_returns_to_the_bit():
    asked = ensemble("p: mine:p, largest_gap: mine:largest", "p: 50 %, pressure: 50 %, largest_gap: 20 %")
    assert loads(asked.to_yaml()) == asked
    ds = roughvol.run(asked, jobs=1)
    for name in (str(name) for name in ds if str(name).startswith("p_")):
        if "solver_error" not in name:  # that of a function is not certified
            np.testing.assert_array_equal(ds[name], ds[name.replace("p_", "mean_pressure_", 1)], strict=True)
    assert (ds.p_step_error > 0.0).all()
    assert ds.largest_gap_mean.attrs["units"] == "um"
    assert "mean largest_gap at indentation = 1.1, D = 2.3, m = 2: " in ds.attrs["answer"]
    assert collect(asked).equals(ds)
    for file in sorted(Path("runs/means/cases").glob("*.nc"))[::3]:
        file.unlink()
    Path("runs/means/study.nc").unlink()
    assert values_of(roughvol.run(asked, jobs=2)).identical(values_of(ds))
    (row,) = roughvol.check(asked, jobs=1).expected
    assert row.seconds > 0.0


@pytest.mark.parametrize(
    ("functions", "accuracy", "words"),
    [
        ("halves: mine:halves", "halves: 5 %", "7: ensemble.accuracy.halves: mine:halves returns an array over half"),
        ("bad: mine:rows", "bad: 5 %", r"6: record.own.bad: mine:rows returns shape \(1, 3\); allowed: a number"),
        ("bad: mine:failing", "bad: 5 %", r"6: record.own.bad: mine:failing fails at p\* = .*ZeroDivisionError"),
        ("nan: mine:closed", "nan: 5 %", "7: ensemble.accuracy.nan: has no value at last .*: its function returns no"),
        ("p: mine:p", "P: 5 %", "7: ensemble.accuracy.P: unknown quantity; did you mean 'p'"),
        ("p: mine:p", "p: much", "7: ensemble.accuracy.p: must be a number > 0"),
        ("p: mine:p, p_mean: mine:p", "p: 5 %", "6: record.own.p: p_mean is the name of another number"),
    ],
)
def test_a_mean_that_cannot_be_taken_is_refused_with_its_place(functions, accuracy, words):
    Path("x.yaml").write_text(ENSEMBLE.replace("OWN", functions).replace("ACCURACY", accuracy).replace("AT", "last"))
    study("p: mine:p")
    for command in ("check", "run"):
        told = refused(command, "x.yaml")
        assert re.match(f"  x.yaml:{words}", told.splitlines()[-1]), told


def test_check_of_a_height_file_takes_a_function():
    np.savetxt("map.txt", np.random.default_rng(0).normal(size=(12, 14)), header="heights in um")
    text = STUDY.replace("OWN", "largest: mine:largest").replace("D: 2.3, m: 4", "file: map.txt")
    study("largest: mine:largest")
    Path("map.yaml").write_text(text.replace(", Sq: 1 um, seeds: 2", ""))
    assert "# surface 12 x 14 nodes" in said("check", "map.yaml")


def test_explain_describes_a_function_as_a_stored_variable():
    study("largest: mine:largest")
    found = roughvol.explain("mine:largest")
    assert (found.name, found.variable.long_name, found.variable.units) == ("largest", "Largest gap", "length")
    assert found.stored_by == "record.own: {largest: mine:largest}"
    with pytest.raises(DatasetError, match="cannot import 'mine:absent'"):
        roughvol.explain("mine:absent")


def test_explain_describes_a_function_and_its_mean_by_the_name_in_a_run():
    roughvol.run(ensemble("width: mine:largest, halves: mine:halves", "width: 20 %"), jobs=1)
    stored = roughvol.open("means")
    forget()
    names = [str(name) for name in stored if str(name).startswith("width_")]
    assert {"width_mean", "width_interval", "width_step_error_high"} < {*names}
    for name in ("width", *names):
        found = roughvol.explain(name)
        assert (found.name, found.variable.symbol) == (name, stored[name].attrs["symbol"])
        assert found.variable.long_name == stored[name].attrs["long_name"]
    assert [key.path for key in roughvol.explain("width").others] == ["seal.width"]
    mean = said("explain", "width_mean")
    assert "mean over all surfaces of the Largest gap" in mean
    assert "record.own: {width: mine:largest}, ensemble.accuracy: {width: 5 %}" in mean
    for name in ("width_median", "halves_mean"):
        with pytest.raises(DatasetError, match=f"no key and no variable '{name}'"):
            roughvol.explain(name)


@pytest.mark.processes
def test_a_package_beside_the_wheel_adds_an_observable_and_its_figure(tmp_path, monkeypatch, capfd):
    site = tmp_path / "site"
    described = site / "leakage-1.0.dist-info"
    described.mkdir(parents=True)
    loud = MODULE.replace("    return state.gap.max()", "    print('called')\n    return state.gap.max()")
    (site / "leakage.py").write_text(f"{loud}\nprint('imported')\n")
    (described / "METADATA").write_text("Metadata-Version: 2.1\nName: leakage\nVersion: 1.0\n")
    (described / "entry_points.txt").write_text("[roughvol.observables]\nlargest_gap = leakage:largest\n")
    Path("gaps.yaml").write_text(STUDY.replace("OWN", "largest_gap: largest_gap").replace("seeds: 2", "seeds: 1"))

    means = ENSEMBLE.replace("OWN", "largest_gap: largest_gap").replace("ACCURACY", "largest_gap: 50 %")
    Path("means.yaml").write_text(means.replace("AT", "last"))
    monkeypatch.syspath_prepend(site)
    monkeypatch.setattr(batch, "SMALL", 0.0)  # the only case is computed in a worker
    # which finds the package, too, and what it prints is no part of an answer
    assert "largest_gap" in json.loads(said("run", "gaps.yaml", "--json", "--jobs", "2"))["rows"][0]
    assert {"imported", "called"} <= set(capfd.readouterr().err.splitlines())
    assert "largest_gap" in said("show", "gaps", "--csv").splitlines()[0]
    assert "largest_gap_of_p.png" in said("plot", "gaps", "largest_gap_of_p")
    assert "mean over all surfaces of the Largest gap" in said("explain", "largest_gap_mean")
    assert "Largest gap" in said("explain", "largest_gap")
    assert "mean largest_gap at the last step, D = 2.3, m = 2: " in said("run", "means.yaml", "--jobs", "1")


def test_the_tutorial_runs_from_an_empty_folder():
    blocks = re.findall(r"```(python|yaml)\n(.*?)```", TUTORIAL.read_text(), re.DOTALL)
    (_, module), (_, yaml), (_, use), (_, number), (_, mean) = blocks
    assert len([line for line in module.splitlines() if line.strip()]) <= 12
    Path("gaps.py").write_text(module)
    Path("gaps.yaml").write_text(yaml.replace("m: 6", "m: 3"))
    roughvol.run("gaps.yaml", jobs=1)
    names = {}
    exec(use, names)
    total = float(names["ds"].gap_share.sum())
    assert 38.0 < total <= 40.0  # 10 steps of 4 surfaces, but for gaps beyond the last class
    Path("my_gaps.py").write_text(number)
    Path("mean.yaml").write_text(mean.replace("m: 6", "m: 2").replace("2 %", "50 %"))
    assert "mean largest_gap at pressure = 0.1, D = 2.3, m = 2: " in said("run", "mean.yaml", "--jobs", "1")
    assert said("plot", "mean_gaps", "largest_gap_of_p") == "runs/mean_gaps/figures/largest_gap_of_p.png\n"
