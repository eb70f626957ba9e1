"""``ds.roughvol``: against plain numpy, over every shape of a dataset, and its refusals."""

import contextlib
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from xarray import Dataset

import roughvol
from roughvol.errors import DatasetError, StudyError
from tests.kit import python

QUESTIONS: tuple[Callable[[Dataset], object], ...] = (
    lambda ds: ds.roughvol.at("last"),
    roughvol.show,
    lambda ds: roughvol.plot(ds, "v_of_p"),
)
STUDY: dict[str, Any] = {
    "surface": {"D": [2.2, 2.6], "m": [4, 5], "seeds": 2, "L": "100 um"},
    "material": {"E": ["10 MPa", "20 MPa"], "nu": 0.5},
    "sweep": {"steps": 6, "to": "mean-plane"},
}


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return roughvol.run(STUDY, out=tmp_path_factory.mktemp("swept"))


def test_a_level_that_some_surfaces_alone_reach_keeps_the_labels_of_all(swept: Dataset) -> None:
    ends = swept.roughvol.derived()["nominal_pressure"].isel(step=-1)
    level = 0.999 * float(ends.max())  # no surface of 10 MPa, and one of 20 MPa
    found = swept.roughvol.at(pressure=f"{level} MPa")
    reached = (ends >= level).transpose(*found["reached"].dims)
    assert int(reached.sum()) == 1
    assert dict(found["reached"].sizes) == dict(reached.sizes)
    assert np.array_equal(found["reached"].values, reached.values)
    assert np.array_equal(found["free_volume"].notnull().values, reached.values)
    with pytest.warns(roughvol.RoughvolWarning, match="E = 20 MPa, .*: 1 of 2 surfaces do not reach pressure=.*no row"):
        assert len(roughvol.show(swept, f"pressure={level} MPa").rows) == int(reached.sum())


def test_the_mean_and_its_count_leave_out_missing_surfaces(swept: Dataset) -> None:
    found = swept.roughvol.at(pressure=float(swept["mean_pressure"].isel(step=-1).median()))
    means = found.roughvol.mean("seed")
    assert np.allclose(means["separation"], found["separation"].mean("seed"), equal_nan=True)
    assert np.array_equal(means["separation_count"], found["reached"].sum("seed"))
    in_mm = means.roughvol.in_units(Sq="mm")
    assert np.allclose(1e3 * in_mm["Sq_range"], means["Sq_range"], rtol=1e-12, equal_nan=True)
    of_bound = found.assign_coords(bound="lower").roughvol.mean("seed")  # as of an answer of an ensemble at one bound
    assert of_bound["separation_range"].identical(means["separation_range"])


def test_an_interval_has_no_average(swept: Dataset) -> None:
    """The range of a mean over seeds, averaged over m, had the dimension bound twice."""
    of_seeds = swept.isel(E=0).roughvol.mean("seed")
    found = of_seeds.roughvol.mean("m")
    assert np.allclose(found["free_volume"], of_seeds["free_volume"].mean("m"))
    assert found["free_volume_range"].dims == ("bound", "D", "step")
    assert "free_volume_range_range" not in found


def test_derived_numbers_have_units_and_are_converted(swept: Dataset) -> None:
    whole = swept.roughvol.derived()
    kilo = whole.roughvol.in_units(nominal_pressure="kPa", mean_gap="nm")
    assert np.allclose(kilo["nominal_pressure"], 1e3 * whole["nominal_pressure"], rtol=1e-12)
    assert np.allclose(kilo["mean_gap"], 1e3 * whole["mean_gap"], rtol=1e-12)
    assert kilo["mean_gap"].attrs == whole["mean_gap"].attrs | {"units": "nm"}
    assert whole.roughvol.in_units(mean_gap="um") is not whole
    for found in (whole, swept.roughvol.at("last")):
        assert found["E"].attrs["units"] == swept["E"].attrs["units"] == "MPa"


def test_derived_numbers_keep_the_order_of_the_labels(swept: Dataset) -> None:
    assert swept.isel(E=[1, 0]).roughvol.derived()["E"].values.tolist() == [20.0, 10.0]


def test_the_last_state_of_a_pressed_map_is_its_last_step() -> None:
    heights = np.random.Generator(np.random.PCG64(3)).normal(size=(12, 17))
    ds = roughvol.press(heights, L=1.0, E_star=1.0, sweep={"steps": 3, "to": {"contact_area": 0.3}})
    found = ds.roughvol.at("last")
    assert dict(found.sizes) == {}
    assert float(found["free_volume"]) == float(ds["free_volume"].isel(step=-1))
    assert str(found["case"].values) == str(ds["case"].values)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda ds: ds.roughvol.at(pressure="9 GPa"), "its steps have pressure"),
        (lambda ds: ds.roughvol.at(separation=50), "has no state at separation=50"),
        (lambda ds: ds.roughvol.at(force=1), "allowed: last, or KIND=VALUE"),
        (lambda ds: ds.roughvol.at(), "at takes one level"),
        (lambda ds: ds.roughvol.at(pressure=1, separation=1), "at takes one level"),
        (lambda ds: ds.roughvol.at(np.array(["p=0.1", "p=0.2"])), "one load is taken, given 2"),
        (lambda ds: ds.roughvol.at({"pressure": 1, "leg": "x"}), "leg is 'x'; allowed: a whole number from 1"),
        (lambda ds: ds.roughvol.at("last", leg=2), "no leg 2; allowed: 1"),
        (lambda ds: ds.roughvol.at("last", leg=1.0), r"leg is 1\.0; allowed: a whole number from 1"),
        (lambda ds: ds.drop_vars("separation").roughvol.at(separation=0.5), "has no separation; allowed: all var"),
        (lambda ds: ds.roughvol.mean("time"), "no dimension 'time'; allowed: "),
        (lambda ds: ds.roughvol.mean().roughvol.mean("bound"), "no dimension 'bound'; allowed: "),
        (lambda ds: ds.roughvol.in_units(mean_gap="um"), "no variable 'mean_gap'"),
        (lambda ds: ds.roughvol.derived().roughvol.in_units(mean_gap="MPa"), "not converted to 'MPa'"),
        (lambda ds: ds.roughvol.in_units(L="mm"), "L is a coordinate and keeps its unit; ds.roughvol.quantity"),
    ],
)
def test_a_question_without_an_answer_is_refused(swept: Dataset, call: Any, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        call(swept)


def test_the_accessor_comes_with_the_functions_that_return_a_dataset_and_not_with_the_import() -> None:
    used = "roughvol.open; import xarray; xarray.Dataset.roughvol"
    python("-c", f"import sys, roughvol; assert 'xarray' not in sys.modules; {used}")


@pytest.mark.parametrize(
    "choice", [{"E": 20.0}, {"seed": 1}, {"D": 2.6, "m": 5}, {"E": 10.0, "D": 2.2, "m": 4, "seed": 0}], ids=str
)
def test_the_choice_of_a_label_and_the_question_may_be_exchanged(swept: Dataset, choice: dict[str, float]) -> None:
    asked = swept.roughvol.at(pressure="0.02 MPa").sel(choice)
    chosen = swept.sel(choice)
    found = chosen.roughvol.at(pressure="0.02 MPa")
    assert set(found["free_volume"].dims) == set(asked["free_volume"].dims)
    for name in ("free_volume", "nominal_pressure"):
        xr.testing.assert_allclose(found[name], asked[name], rtol=1e-12)
    rows = roughvol.show(chosen, "pressure=0.02 MPa")
    column = [row[rows.names.index("free_volume")] for row in rows.rows]
    assert np.allclose(sorted(column), np.sort(asked["free_volume"].values.ravel()), rtol=1e-12)
    assert roughvol.plot(chosen, "v_of_p").axes


@pytest.mark.parametrize("name", ["mean_pressure", "Sq"])
def test_a_number_that_became_a_coordinate_changes_no_answer(swept: Dataset, name: str) -> None:
    marked = swept.set_coords(name)
    assert roughvol.show(marked, "last").rows == roughvol.show(swept, "last").rows
    for question in (lambda ds: ds.roughvol.at("last"), lambda ds: ds.roughvol.derived()):
        found = question(marked)
        assert name in found.coords
        xr.testing.assert_identical(found.reset_coords(name), question(swept))


def test_a_single_number_as_a_coordinate_has_its_row_and_labels_of_a_user_stay(swept: Dataset) -> None:
    one = swept.isel(D=0, m=0, seed=0)
    assert roughvol.show(one.set_coords("Sq"), "last").rows == roughvol.show(one, "last").rows
    labelled = swept.assign_coords(batch=("seed", [f"batch {seed}" for seed in swept.seed.values]))
    found = labelled.roughvol.at("last")
    assert found.batch.equals(labelled.batch.sel(seed=found.seed))


def test_the_choice_of_a_recorded_state_changes_no_number() -> None:
    heights = np.random.Generator(np.random.PCG64(4)).normal(size=(12, 15))
    legs = [{"steps": 3, "to": {"contact_area": 0.4}}, {"steps": 2, "to": {"contact_area": 0.1}}]
    ds = roughvol.press(heights, L=1.0, sweep=legs, record={"fields_at": {"contact_area": [0.25]}})
    chosen = ds.isel(field_at=0)
    whole, part = (one.roughvol.at(contact_area=0.25) for one in (ds, chosen))
    assert float(part["free_volume"]) == float(whole["free_volume"])
    assert float(part["free_volume"]) == float(ds["field_at_free_volume"].item())
    assert roughvol.show(chosen, "contact_area=0.25").rows == roughvol.show(ds, "contact_area=0.25").rows
    assert chosen.roughvol.derived()["gap"].dims == ("x", "y")


def test_heights_in_another_unit_change_no_load(swept: Dataset) -> None:
    in_um = swept.isel(D=[0], m=[0])
    in_mm = in_um.roughvol.in_units(Sq="mm")
    for level in ("0.02 MPa", "20 kPa"):
        found, same = in_mm.roughvol.at(pressure=level), in_um.roughvol.at(pressure=level)
        assert np.allclose(found["free_volume"], same["free_volume"], rtol=1e-12)
    assert np.allclose(in_mm.roughvol.derived()["mean_gap"], in_um.roughvol.derived()["mean_gap"], rtol=1e-12)


def test_numbers_at_a_load_are_no_states(swept: Dataset) -> None:
    law = {"power": {"exponent": 0.1, "time": "1 s"}}
    read_offs = (
        lambda ds: roughvol.ask(ds, leak_rate="1 mm^3/s"),
        lambda ds: roughvol.creep(ds, law, at="p=0.1", times="1 s"),
    )
    numbers = swept.roughvol.at("last")
    for error, questions in ((DatasetError, QUESTIONS), (StudyError, read_offs)):
        for question in questions:
            with pytest.raises(error, match="has no dimension step, as numbers at a load; allowed: the states"):
                question(numbers)


def test_what_follows_from_a_step_or_a_part_of_the_variables_is_derived() -> None:
    heights = np.random.Generator(np.random.PCG64(5)).normal(size=(9, 9))
    legs = [{"steps": 2, "to": {"contact_area": 0.4}}, {"steps": 2, "to": {"contact_area": 0.1}}]
    ds = roughvol.press(heights, L="100 um", E_star="10 MPa", sweep=legs).drop_vars("mean_gap")
    last = ds.isel(step=-1).roughvol.derived()
    assert float(last["mean_gap"]) == float(ds.roughvol.derived()["mean_gap"][-1])
    part = ds[["nominal_pressure", "free_volume", "Sq"]].roughvol.derived()
    assert np.array_equal(part["nominal_pressure"], ds["nominal_pressure"])


def test_what_is_derived_twice_stays_under_fluid_pressure() -> None:
    heights = np.random.Generator(np.random.PCG64(5)).normal(size=(9, 9))
    record = {
        "transport": {"transmissivity": "every-step"},
        "fluid_pressure": {"inlet": "1 bar", "at": "last"},
        "dimensional": {"leak_rate": {"pressure_drop": "1 bar", "viscosity": "1 mPa*s", "unit": "mm^3/s"}},
    }
    ds = roughvol.press(heights, L="100 um", E_star="10 MPa", to={"pressure": "0.5 MPa"}, steps=2, record=record)
    once = ds.roughvol.derived()
    last, along_x = once.roughvol.at("last"), ds.sel(axis="x").roughvol.derived()
    pairs = (once, once.roughvol.derived()), (last, last.roughvol.derived()), (once.sel(axis="x"), along_x)
    for (first, again), name in itertools.product(pairs, ("leak_rate", "leak_rate_dry", "open", "open_dry")):
        assert np.array_equal(again[name], first[name], equal_nan=True), name


@pytest.mark.parametrize(
    ("choose", "word"),
    [
        (lambda ds: ds.isel(step=1), "step 2 alone"),
        (lambda ds: ds.assign_coords(axis="x"), "axis x alone"),
        (lambda ds: ds.sel(E=20.0, drop=True), "lost its label of E"),
        (lambda ds: ds.isel(seed=0, drop=True), "has no dimension seed or case"),
        (lambda ds: ds.mean("seed"), r"ds\.roughvol\.at\(LOAD\)\.roughvol\.mean"),
        (lambda ds: ds.stack(surface=("D", "m", "seed")), "has no dimension seed or case"),
        (lambda ds: ds.where(ds["mean_pressure"] > 0.1), "has Sq along step"),
        (lambda ds: ds.assign_coords(seed=[f"face {k}" for k in range(ds.sizes["seed"])]), "has seed = face 0"),
        (lambda ds: ds.isel(seed=[]), "has no surface"),
        (lambda ds: ds.isel(D=0, drop=True), "has no D;"),
        (lambda ds: ds.isel(step=[]), "has no step;"),
        (lambda ds: ds[["mean_pressure"]], "has no Sq"),
        (lambda ds: ds.drop_vars("step"), "lost its label of step"),
        (lambda ds: ds.drop_attrs(), "has lost its units"),
        (lambda ds: ds.sortby("step", ascending=False), "has its steps in another order"),
        (lambda ds: xr.concat([ds, ds], "step", data_vars="minimal"), "has step = 1 twice"),
        (
            lambda ds: xr.concat([ds, ds.assign_coords(seed=[7, 8])], "seed"),
            "has seed = 7, which its study does not name",
        ),
        (lambda ds: xr.concat([ds, ds], "seed"), "has seed = 0 twice"),
        (lambda ds: xr.concat([ds, ds], "m"), r"has m = \d+ twice"),
        (
            lambda ds: xr.concat([ds, ds], xr.DataArray(["a", "b"], dims="run", name="run")),
            "has a dimension run, which its study",
        ),
    ],
)
def test_a_choice_without_what_a_question_needs_is_refused(
    swept: Dataset, choose: Callable[[Dataset], Dataset], word: str
) -> None:
    for question in (*QUESTIONS, roughvol.ask, lambda ds: roughvol.plot(ds, "fig05")):
        with pytest.raises(DatasetError, match=word):
            question(choose(swept))


AT = {"pressure": "0.1 MPa"}
SEAL = {"seal": {"length": "1 mm", "width": "0.1 mm"}}
LIQUID = {"pressure_drop": "1 mbar", "viscosity": "1 mPa*s"}
LEAK = {"transport": {"transmissivity": "every-step"}, "dimensional": {"leak_rate": LIQUID}}
LIFT = {"inlet": "1 mbar", "outlet": "0 mbar", "coupling": "one-way", "at": AT}


@pytest.mark.parametrize(
    ("change", "lost", "words"),
    [
        ({"record": {"fields_at": AT}}, ["indentation", "field_at_step"], ""),
        ({"record": {"transport": {"flux_at": AT}}}, ["flux_at_step"], ""),
        (SEAL, ["nodes_x"], ""),
        (SEAL | {"record": LEAK}, ["nodes_x"], "has no nodes_x; allowed: all variables"),
        ({"record": {"fluid_pressure": LIFT}}, ["fluid_at_step"], "has no fluid_at_step; allowed: all variables"),
        ({"record": {"fluid_pressure": LIFT}}, ["fluid_leak_dry"], "has no fluid_leak_dry; allowed: all variables"),
    ],
)
def test_variables_that_a_user_dropped_are_left_out_or_named(
    here: Path, change: dict[str, Any], lost: list[str], words: str
) -> None:
    surface = {"D": 2.2, "m": 3, "L": "0.1 mm", "Sq": "1 um", "seeds": 2, "sides": "mirrored"}
    study = {"name": "all", "surface": surface, "material": {"E_star": "10 MPa"}, "sweep": {"steps": 2, "to": AT}}
    ds = roughvol.run(study | change, jobs=1)
    with contextlib.nullcontext() if not words else pytest.raises(DatasetError, match=words):
        assert float(ds.drop_vars(lost).roughvol.at(AT)["mean_pressure"].min()) > 0.0
    with pytest.raises(StudyError, match="has no mean_pressure; allowed: all variables"):
        roughvol.ask(ds.drop_vars("mean_pressure"))


def test_a_height_file_may_have_the_name_of_two_bodies(here: Path) -> None:
    """The label of its case was read as that of two files."""
    np.save("seal against ring.npy", np.random.default_rng(3).normal(size=(7, 7)))
    ds = roughvol.run({"surface": {"file": "seal against ring.npy", "L": 1.0}, "sweep": {"steps": 2}}, jobs=1)
    assert len(roughvol.show(ds, "last").rows) == 1


@pytest.mark.parametrize(("second", "words"), [("face.npy", "face.npy twice"), ("other.npy", "other.npy")])
def test_runs_of_height_files_that_were_joined_are_refused(here: Path, second: str, words: str) -> None:
    """Both had the modulus of the first: a surface of the second was left out as not pressed to the load."""
    runs = []
    for name, file, E in (("one", "face.npy", "10 MPa"), ("other", second, "40 MPa")):
        np.save(file, np.random.default_rng(3).normal(size=(7, 7)))
        surface, sweep = {"file": file, "L": "1 mm", "heights_unit": "um"}, {"pressures": ["0.1 MPa", "0.2 MPa"]}
        runs.append(roughvol.run({"name": name, "surface": surface, "material": {"E_star": E}, "sweep": sweep}))
        roughvol.show(runs[-1])
    for question in QUESTIONS:
        with pytest.raises(DatasetError, match=f"has case = {words}, which its study does not name"):
            question(xr.concat(runs, "case", combine_attrs="override"))
