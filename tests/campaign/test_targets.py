"""Ends and lists of loads with units: where a sweep ends, which steps it has, what is refused, which ids stay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

import roughvol
from roughvol.campaign.one_case import Context, Stopped, run_case
from roughvol.cli import main
from roughvol.errors import ContactError, StudyError
from roughvol.store import checkpoint, dataset
from roughvol.study import loads

SURFACE = "surface: {D: 2.3, m: 5, seeds: [4], L: 100 um, Sq: 1 um}\nmaterial: {E_star: 10 MPa}\n"
ARBITRARY = "surface: {D: 2.3, m: 5, seeds: [4]}\n"
SCALE = 10.0 * 1.0 / 100.0  # MPa: E* Sq/L
AREA = (33 * 100.0 / 32) ** 2  # um², of all elements


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def _pressed(text: str, surface: str = SURFACE) -> dataset.Dataset:
    study = loads(surface + text)
    assert loads(study.stored(), stored=True) == study
    return run_case(study.cases()[0]).squeeze(("D", "m", "seed"))


@pytest.mark.parametrize(
    ("to", "name", "value"),
    [
        ("{pressure: 0.2 MPa}", "mean_pressure", 0.2 / SCALE),
        ("{pressure: 200 kPa}", "mean_pressure", 0.2 / SCALE),
        ("{load: 1 mN}", "mean_pressure", 1e-3 / (AREA * 1e-12) * 1e-6 / SCALE),
        ("{separation: 0.5 um}", "separation", 0.5),
        ("{separation: -200 nm}", "separation", -0.2),
        ("{indentation: 2 um}", "indentation", 2.0),
        ("{mean_gap: 1 um}", "free_volume", 1.0),
        ("{free_volume: 0.8}", "free_volume", 0.8),
    ],
)
def test_a_sweep_ends_at_a_value_with_its_unit(to: str, name: str, value: float) -> None:
    ds = _pressed(f"sweep: {{steps: 3, to: {to}}}")
    assert_allclose(ds[name].values[-1], value, rtol=2e-5)
    assert_allclose(np.diff(ds.indentation), float(ds.indentation[0]), rtol=1e-9)  # steps stay equal


def test_an_end_in_units_is_that_of_the_starred_number() -> None:
    one = _pressed("sweep: {steps: 3, to: {pressure: 0.2 MPa}}")
    other = _pressed(f"sweep: {{steps: 3, to: {{pressure: {0.2 / SCALE!r}}}}}")
    assert_allclose(one.indentation, other.indentation, rtol=1e-9)


@pytest.mark.parametrize(
    ("text", "name", "values"),
    [
        ("pressures: [0.01 MPa, 100 kPa, 0.2 MPa]", "mean_pressure", [0.1, 1.0, 2.0]),
        ("pressures: 0.5", "mean_pressure", [0.5]),
        ("contact_areas: [0.05, 0.2]", "contact_area_fraction", [0.05, 0.2]),
        ("mean_gaps: [1.5 um, 1 um]", "free_volume", [1.5, 1.0]),
        ("free_volumes: [1.2, 0.7]", "free_volume", [1.2, 0.7]),
        ("separations: [1, 0.5, -0.5]", "separation", [1.0, 0.5, -0.5]),
        ("indentations: [1 um, 2 um]", "indentation", [1.0, 2.0]),
        ("loads: [0.1 mN, 1 mN]", "mean_pressure", [k * 1e-4 / AREA * 1e6 / SCALE for k in (1, 10)]),
    ],
)
def test_a_list_makes_a_step_of_each_value(text: str, name: str, values: list[float]) -> None:
    ds = _pressed(f"sweep: {{{text}}}")
    assert ds.sizes["step"] == len(values)
    element = 1.0 / 33**2 if name == "contact_area_fraction" else 0.0
    assert_allclose(ds[name].values, values, rtol=2e-5, atol=1.01 * element)


@pytest.mark.parametrize("material", ["", "material: {E_star: 10 MPa, hardness: 0.5 MPa}\n"])
def test_listed_loads_may_fall_on_a_leg(material: str) -> None:
    surface = SURFACE.replace("material: {E_star: 10 MPa}\n", material) if material else SURFACE
    legs = "[{pressures: [0.1 MPa, 0.2 MPa]}, {pressures: [0.1 MPa, 0 MPa]}, {steps: 2, to: {mean_gap: 0.9 um}}]"
    ds = _pressed(f"sweep: {legs}", surface)
    assert_allclose(ds.mean_pressure.values[:4] * SCALE, [0.1, 0.2, 0.1, 0.0], rtol=2e-5, atol=1e-9)
    assert_allclose(ds.free_volume.values[-1], 0.9, rtol=2e-5)
    assert ds.leg.values.tolist() == [1, 1, 2, 2, 3, 3]


def test_a_list_goes_on_from_its_checkpoint_with_the_same_bits(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(checkpoint, "NODES", 1)
    case = loads(SURFACE + "sweep: [{pressures: [0.05 MPa, 0.1 MPa, 0.2 MPa]}, {pressures: [0.1 MPa]}]").cases()[0]
    whole = run_case(case)
    file, steps = tmp_path / "kept", iter([False, True])
    with pytest.raises(Stopped):
        run_case(case, Context(checkpoint=file, stopping=lambda: next(steps, True)))
    resumed = run_case(case, Context(checkpoint=file))
    for name in ("indentation", "mean_pressure", "free_volume"):
        assert (whole[name].values == resumed[name].values).all()


@pytest.mark.parametrize(
    ("text", "key", "part"),
    [
        ("sweep: {to: {pressure: 0.5 MPa}}", "sweep.to.pressure", "the modulus has none"),
        ("sweep: {to: {mean_gap: 1 um}}", "sweep.to.mean_gap", "L has none"),
        ("sweep: {to: {separation: 1 um}}", "sweep.to.separation", "L has none"),
        ("sweep: {to: {load: 1 N}}", "sweep.to.load", "the modulus has none"),
        ("sweep: {to: {mean_gap: 1}}", "sweep.to.mean_gap", "with a unit of length"),
        ("sweep: {to: {pressure: 1 um}}", "sweep.to.pressure", "is a unit of length, not of pressure"),
        ("sweep: {pressures: [0.1 MPa, 1 MPa]}", "sweep.pressures[1]", "the modulus has none"),
        ("sweep: {pressures: [0.1, 1 MPa]}", "sweep.pressures", "either all values have a unit, or none"),
        ("sweep: {pressures: [1, 0.5]}", "sweep.pressures[1]", "must rise"),
        ("sweep: {free_volumes: [0.5, 1]}", "sweep.free_volumes[1]", "must fall from value to value, as on loading"),
        ("sweep: {pressures: [1], steps: 5}", "sweep", "omit 'steps'"),
        ("sweep: {pressures: [1], contact_areas: [0.1]}", "sweep", "omit 'contact_areas'"),
        ("sweep: [{pressures: [1, 2, 1]}]", "sweep[0].pressures[2]", "must rise or fall"),
        ("sweep: {to: {pressure: 1, load: 1 N}}", "sweep.to", "exactly one of"),
    ],
)
def test_what_has_no_meaning_is_refused_with_its_place(text: str, key: str, part: str) -> None:
    with pytest.raises(StudyError) as refused:
        loads(ARBITRARY + text)
    assert any(problem.key.startswith(key) and part in problem.message for problem in refused.value.problems), (
        refused.value
    )


def test_a_load_excludes_a_region() -> None:
    with pytest.raises(StudyError, match="load on the whole surface"):
        loads(SURFACE + "sweep: {to: {load: 1 mN}}\nrecord: {region: interior}")


def test_a_gap_that_first_touch_has_already_is_an_error_of_the_case() -> None:
    with pytest.raises(ContactError, match="of the first touch"):
        _pressed("sweep: {to: {mean_gap: 90 um}}")


def test_ids_depend_on_the_modulus_only_where_the_sweep_has_units() -> None:
    def id_of(sweep: str, modulus: str = "10 MPa") -> str:
        return loads(SURFACE.replace("10 MPa", modulus) + sweep).cases()[0].id

    assert id_of("sweep: {to: {pressure: 1}}") == id_of("sweep: {to: {pressure: 1}}", "20 MPa")
    assert id_of("sweep: {to: {pressure: 1 MPa}}") != id_of("sweep: {to: {pressure: 1 MPa}}", "20 MPa")
    assert id_of("sweep: {to: {pressure: 1 MPa}}") == id_of("sweep: {to: {pressure: 1 MPa}}", "10000 kPa")


FLUID = "{pressure_drop: 1 bar, viscosity: 1 mPa*s}"
LEAKING = f"record: {{transport: {{transmissivity: every-step}}, dimensional: {{leak_rate: {FLUID}}}}}\n"


@pytest.mark.parametrize("axis", ["", "_x", "_y"])
@pytest.mark.parametrize("material", ["", "hardness: 2 MPa"])
def test_a_sweep_ends_where_the_leak_rate_has_fallen_to_the_value(axis: str, material: str) -> None:
    surface = SURFACE.replace("10 MPa}", f"10 MPa, {material}}}")
    study = loads(surface + LEAKING + f"sweep: {{steps: 3, to: {{leak_rate{axis}: 1e-3 mm^3/s}}}}\n")
    assert loads(study.stored(), stored=True) == study
    ds = roughvol.run(study, out=Path("leaking"), jobs=1).squeeze(("D", "m", "seed"))
    followed = (ds.leak_rate.sel(axis=axis[1:]) if axis else ds.leak_rate.max("axis")).values
    assert_allclose(followed[-1], 1e-3, rtol=1e-4)
    assert (np.diff(followed) < 0.0).all()


def test_listed_leak_rates_are_steps() -> None:
    ds = roughvol.run(
        loads(SURFACE + LEAKING + "sweep: {leak_rates: [1e-2 mm^3/s, 1 mm^3/h, 1e-5 mm^3/s]}\n"),
        out=Path("list"),
        jobs=1,
    )
    largest = ds.leak_rate.max("axis").values.squeeze()
    assert_allclose(largest, [1e-2, 1.0 / 3600.0, 1e-5], rtol=2e-4)
    shown = CliRunner().invoke(main, ["show", "list", "--at", "leak_rate=1mm^3/h"])
    assert shown.exit_code == 0, shown.output
    assert "leak_rate=1 mm^3/h" in shown.stdout


def test_a_finer_tolerance_ends_nearer_to_the_leak_rate() -> None:
    text = SURFACE + LEAKING + "solver: {accuracy: reference}\nsweep: {steps: 1, to: {leak_rate: 1e-4 mm^3/s}}\n"
    ds = roughvol.run(loads(text), out=Path("fine"), jobs=1)
    assert_allclose(ds.leak_rate.max("axis").values.item(), 1e-4, rtol=2e-5)


def test_a_leak_rate_needs_a_fluid_and_a_gap_that_leaks_more() -> None:
    with pytest.raises(StudyError, match=r"sweep\.to\.leak_rate: needs a fluid"):
        loads(SURFACE + "sweep: {to: {leak_rate: 1 mm^3/s}}")
    with pytest.raises(ContactError, match="first touch already"):
        _pressed(LEAKING + "sweep: {steps: 1, to: {leak_rate: 1e9 mm^3/s}}")


def test_the_id_depends_on_the_fluid_only_where_the_sweep_follows_the_leak() -> None:
    def id_of(sweep: str, fluid: str = FLUID) -> str:
        return loads(SURFACE + LEAKING.replace(FLUID, fluid) + sweep).cases()[0].id

    other = FLUID.replace("1 bar", "2 bar")
    assert id_of("sweep: {to: {pressure: 1 MPa}}") == id_of("sweep: {to: {pressure: 1 MPa}}", other)
    assert id_of("sweep: {to: {leak_rate: 1 mm^3/s}}") != id_of("sweep: {to: {leak_rate: 1 mm^3/s}}", other)


@pytest.mark.parametrize(
    ("sweep", "pressures"),
    [
        ("{steps: 4, to: {pressure: 0.2 MPa}, equal: pressure}", [0.5, 1.0, 1.5, 2.0]),
        ("{steps: 3, to: {pressure: 2}, equal: log pressure, first: 0.02 MPa}", [0.2, 0.2 * 10**0.5, 2.0]),
        ("{steps: 4, to: {pressure: 2}, equal: log pressure}", [0.002, 0.02, 0.2, 2.0]),
        ("{steps: 1, to: {pressure: 2}, equal: log pressure}", [2.0]),
        (
            "[{steps: 2, to: {pressure: 2}, equal: pressure}, {steps: 2, to: {pressure: 0}, equal: pressure}]",
            [1, 2, 1, 0],
        ),
        ("[{steps: 1, to: {pressure: 4}}, {steps: 2, to: {pressure: 1}, equal: log pressure}]", [4.0, 2.0, 1.0]),
    ],
)
def test_steps_equal_in_pressure_or_its_logarithm_are_solved_there(sweep: str, pressures: list[float]) -> None:
    ds = _pressed(f"sweep: {sweep}")
    assert_allclose(ds.mean_pressure, pressures, rtol=2e-5, atol=1e-9)


@pytest.mark.parametrize("to", ["mean-plane", "{contact_area: 0.3}", "{mean_gap: 0.5 um}"])
def test_steps_equal_in_pressure_end_where_the_sweep_ends(to: str) -> None:
    plain, even = (_pressed(f"sweep: {{steps: 3, to: {to}{equal}}}") for equal in ("", ", equal: pressure"))
    assert_allclose(even.indentation[-1], plain.indentation[-1], rtol=1e-9)
    last = float(even.mean_pressure[-1])
    assert_allclose(even.mean_pressure, [last / 3, 2 * last / 3, last], rtol=2e-5)


def test_equal_steps_in_pressure_go_on_from_their_checkpoint_with_the_same_bits(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(checkpoint, "NODES", 1)
    text = (
        "[{steps: 3, to: {contact_area: 0.2}, equal: log pressure}, {steps: 2, to: {pressure: 0.1}, equal: pressure}]"
    )
    case = loads(SURFACE + f"sweep: {text}").cases()[0]
    whole = run_case(case)
    for stop in (1, 4):
        file, left = tmp_path / f"kept{stop}", iter([*[False] * (stop - 1), True])
        with pytest.raises(Stopped):
            run_case(case, Context(checkpoint=file, stopping=lambda left=left: next(left, True)))
        resumed = run_case(case, Context(checkpoint=file))
        for name in ("indentation", "mean_pressure", "free_volume"):
            assert (whole[name].values == resumed[name].values).all()


@pytest.mark.parametrize(
    ("sweep", "part"),
    [
        ("{steps: 3, equal: load}", "must be 'indentation', 'pressure' or 'log pressure'"),
        ("{steps: 3, first: 0.1}", "needs equal: log pressure"),
        ("{pressures: [1, 2], equal: pressure}", "omit 'equal'"),
        ("[{to: {pressure: 1}}, {to: {pressure: 0}, equal: log pressure}]", "an end > 0"),
    ],
)
def test_steps_without_meaning_are_refused(sweep: str, part: str) -> None:
    with pytest.raises(StudyError, match=part):
        loads(SURFACE + f"sweep: {sweep}")


def test_a_first_step_beyond_the_last_is_an_error() -> None:
    with pytest.raises(ContactError, match=r"first step is at p\* = 3"):
        _pressed("sweep: {steps: 3, to: {pressure: 2}, equal: log pressure, first: 3}")


LEVELS = "fields_at: {pressure: 0.05 MPa, mean_gap: 1 um, separation: 0.5 um, indentation: 1500 nm, load: 1 mN}"


@pytest.mark.parametrize("material", ["", "hardness: 2 MPa"])
def test_levels_with_units_are_solved_and_named_as_in_the_study(material: str) -> None:
    surface = SURFACE.replace("10 MPa}", f"10 MPa, {material}}}")
    study = loads(surface + f"record: {{{LEVELS}, transport: {{percolation: {{pressure: 0.05 MPa}}}}}}\n")
    assert loads(study.stored(), stored=True) == study
    ds = roughvol.run(study, out=Path("levels"), jobs=1).squeeze(("D", "m", "seed"))
    exact = {
        "pressure=0.05 MPa": ("mean_pressure", 0.5),
        "mean_gap=1 um": ("free_volume", 1.0),
        "separation=0.5 um": ("separation", 0.5),
        "indentation=1500 nm": ("indentation", 1.5),
        "load=1 mN": ("mean_pressure", 1e-3 / (AREA * 1e-12) * 1e-6 / SCALE),
    }
    assert set(ds.field_at.values) == set(exact)
    for label, (name, value) in exact.items():
        assert_allclose(ds[f"field_at_{name}"].sel(field_at=label), value, rtol=2e-5)
    assert int(ds.percolates.sel(axis="x").notnull().sum()) == 1
    shown = CliRunner().invoke(main, ["show", "levels", "--at", "mean_gap=1um"])
    assert shown.exit_code == 0, shown.output
    summed = CliRunner().invoke(main, ["show", "levels", "--at", "pressure=0.05MPa", "--csv"])
    assert summed.exit_code == 0, summed.output


@pytest.mark.parametrize(
    ("text", "key", "part"),
    [
        ("record: {fields_at: {pressure: 0.5 MPa}}", "record.fields_at.pressure", "the modulus has none"),
        ("record: {box_counting: {at: {mean_gap: 1 um}}}", "record.box_counting.at.mean_gap", "L has none"),
        ("record: {fields_at: {load: 2}}", "record.fields_at.load", "with a unit of force"),
    ],
)
def test_levels_without_a_scale_are_refused(text: str, key: str, part: str) -> None:
    with pytest.raises(StudyError) as refused:
        loads(ARBITRARY + text)
    assert any(problem.key.startswith(key) and part in problem.message for problem in refused.value.problems), (
        refused.value
    )


def test_a_level_of_load_excludes_a_region() -> None:
    with pytest.raises(StudyError, match="load on the whole surface"):
        loads(SURFACE + "record: {region: interior, fields_at: {load: 1 mN}}")
