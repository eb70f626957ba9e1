"""States of stored surfaces at a load: ends, closings, legs, and the number of several surfaces.

The oracle is a few lines of numpy on study.nc.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from xarray import Dataset

import roughvol
from roughvol.analysis.at import at, between, place_of
from roughvol.analysis.average import average
from roughvol.analysis.derived import derived, groups
from roughvol.analysis.leak import counted
from roughvol.analysis.leak_curve import curves
from roughvol.analysis.legs import first_leg
from roughvol.analysis.read_off import checked
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import number
from roughvol.errors import DatasetError
from roughvol.observables.variables import OF_YIELD
from roughvol.report.figures import content, ways
from roughvol.report.figures.families import Family
from roughvol.store import dataset
from roughvol.study import Level, loads, parse
from tests.kit import LEAKING, answered, ran, said, twin

SEAL = """
name: seal
surface: {D: 2.2, m: 4, L: 100 um, Sq: 0.5 um, seeds: 3}
material: {E_star: 10 MPa}
sweep: {steps: 10, to: percolation}
record:
  transport: {percolation: every-step, transmissivity: every-step}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 1 mbar, viscosity: 1 mPa*s, unit: mm^3/s}}
"""
LIFT = """
name: lift
surface: {D: 2.2, m: 4, L: 200 um, Sq: 0.5 um, seeds: [3, 4, 5], sides: periodic}
material: {E_star: 10 MPa}
sweep: {steps: 4, to: {pressure: 0.05 MPa}}
record:
  transport: {transmissivity: every-step}
  fluid_pressure: {inlet: 0.1 bar, outlet: 0 bar, at: {pressure: [0.03 MPa, 0.05 MPa]}, coupling: one-way}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 0.1 bar, viscosity: 1 mPa*s, unit: mm^3/s}}
"""
SWEEP = "{steps: 10, to: percolation}"
CLOSING = SEAL.replace("percolation: every-step", "percolation: every-step, closing: true")
LISTED = SEAL.replace("seal", "flux").replace(SWEEP, "{pressures: [0.02 MPa, 0.05 MPa, 0.1 MPa]}")
FLUX = LISTED.replace(
    "transmissivity: every-step", "transmissivity: every-step, flux_at: {pressure: [0.01 MPa, 0.035 MPa]}"
)


@pytest.fixture(scope="module", autouse=True)
def _folder(there: Path) -> None:
    for name, text in {"seal": SEAL, "lift": LIFT, "flux": FLUX}.items():
        Path(f"{name}.yaml").write_text(text, encoding="utf-8")
        roughvol.run(f"{name}.yaml")


def _made(text: str, folder: Path, sweep: str = SWEEP) -> Dataset:
    """A run of another sweep."""
    return roughvol.run(loads(text.replace(SWEEP, sweep)), out=folder / "made", jobs=1)


def _run(name: str) -> Run:
    return Run.of(name, dataset.read(Path("runs") / name / "study.nc"))


def _groups(run: Run) -> list[Dataset]:
    return [group for _, group in groups(derived(run.dataset, run.study))]


@pytest.mark.parametrize(("kind", "value"), [("pressure", 0.2), ("free_volume", 1.5)])
def test_a_level_before_the_first_step_is_on_no_later_leg_unless_it_is_named(kind: str, value: float) -> None:
    """The state of a later leg was given: of metal that has yielded, with another leak."""
    legs = [{"steps": 2, "to": {"pressure": load}} for load in (1.0, 0.01)]
    ds = roughvol.press(np.random.default_rng(0).normal(size=(9, 9)), L=1.0, hardness=5.0, sweep=legs)
    refusal = rf"{kind}={value} lies before the first step of leg 1; .* '{kind}={value}, leg 2'"
    with pytest.raises(DatasetError, match=refusal):
        roughvol.show(ds, f"{kind}={value}")
    assert roughvol.show(ds, f"{kind}={value}, leg 2").rows
    with pytest.raises(DatasetError, match=r"no state at pressure=0.001: its steps have pressure p\* = 0.01 to 1"):
        roughvol.show(ds, "pressure=0.001")


@pytest.mark.parametrize(
    "text", ["pressure", "q=1", "pressure=", "pressure=1 um", "last=3", "leak_rate=-1 mm^3/s", "A=1.01"]
)
def test_what_is_no_level_is_refused(text: str) -> None:
    with pytest.raises(DatasetError, match=r"allowed|must be"):
        parse(text)


def test_a_state_says_how_far_apart_the_flows_of_the_steps_around_it_are() -> None:
    run = _run("seal")
    ds = run.dataset.isel(D=0, m=0, seed=[0])
    load = float(ds["mean_pressure"][0, :2].mean())
    before, after = (ds["leak_rate"].isel(seed=0, step=k).values for k in (0, 1))
    assert at(run, ds, Level("pressure", load)).apart == pytest.approx((before / after).max())
    assert at(run, ds, Level("step", 1)).apart == 1.0
    notes = [said("show", "seal", "--at", text) for text in (f"p={load}", "step=1")]
    assert ["steps around" in text for text in notes] == [True, False]


def test_a_state_says_that_the_steps_around_it_have_no_flow(tmp_path: Path) -> None:
    text = SEAL.replace("transmissivity: every-step", "transmissivity: {pressure: [0.05 MPa]}")
    _made(text.replace("seeds: 3", "seeds: 1"), tmp_path)
    notes = [said("show", tmp_path / "made", *at) for at in (["--at", "pressure=0.05 MPa"], ["--at", "last"], [])]
    assert ["A flow is missing where a step around" in text for text in notes] == [True, False, False]


@pytest.mark.parametrize(("text", "kind"), [("p=0.3", "pressure"), ("A=0.1", "contact_area"), ("d=0", "separation")])
def test_symbols_name_their_quantities(text: str, kind: str) -> None:
    assert parse(text) == parse(f"{kind}={text.partition('=')[2]}")


def test_a_step_that_ends_short_of_a_recorded_load_has_the_lifted_leak_there() -> None:
    """The recorded state belonged to the next step, and the leak of this surface was missing at the listed load."""
    ds = _run("lift").dataset
    short = ds.assign(mean_pressure=ds["mean_pressure"] * (1.0 - 4e-6), fluid_at_step=ds["fluid_at_step"] + 1)
    whole, found = (counted(each)["leak_rate"].isel(step=-1) for each in (ds, short))
    assert whole.notnull().all()
    assert_allclose(found.values, whole.values, rtol=0.0)


def test_notes_under_fluid_pressure_name_the_gap_of_loads_and_leaks() -> None:
    assert "The loads are those of the dry gap." in said("run", "lift.yaml")
    assert "Q is the leak of the lifted gap" in said("show", "lift", "--at", "last")
    assert "lift: record.fluid_pressure lifts the gap" in said("compare", "lift", "flux", "--at", "last")


@pytest.mark.parametrize("x", ["nominal_pressure", "free_volume"])
def test_a_figure_shows_the_leak_at_every_state_under_fluid_pressure(x: str) -> None:
    ds = first_leg(_groups(_run("lift"))[0])
    stored = ds.isel(seed=[1])
    (way,) = ways.ways(Family("", 0.0, {}, stored), x, "leak_rate", "y")
    states = [at(_run("lift"), stored, parse(level)).data for level in ("pressure=0.03 MPa", "pressure=0.05 MPa")]
    between_steps = stored.drop_sel(step=stored["step"].values[-1:])  # no step has the load of a state
    assert content.missing("leak_of_p", [content.Named("lift", between_steps.expand_dims(("D", "m")))]) is None
    assert_allclose(way.load, [float(state[x][0]) for state in states], rtol=1e-12)
    assert_allclose(way.value, [float(state["leak_rate"].sel(axis="y")[0]) for state in states], rtol=0.0)


@pytest.mark.parametrize(("known", "value"), [([0.0, 0.0], 0.0), ([0.0], math.nan), ([0.0, 4.0], 2.0)])
def test_a_median_of_0_is_missing_where_an_unknown_leak_decides(known: list[float], value: float) -> None:
    found = average("leak_rate", [*known, math.nan])
    assert_allclose((found.value, found.count, found.surfaces), (value, len(known), len(known) + 1))


def test_a_surface_that_closed_does_not_close_those_that_are_not_known(here: Path) -> None:
    text = LEAKING.replace("seeds: 1", "seeds: [1, 2], sides: mirrored").replace("Sq: 1 um", "Sq: 0.5 um")
    text = text.replace("{pressure: 0.5 MPa}", "{contact_area: 0.4}").replace("steps: 8", "steps: 5")
    ran("seal", f"{text}seal: {{length: 12 mm, width: 1 mm}}\n")
    ds = roughvol.open("seal").isel(D=0, m=0, step=-1)
    assert (ds.leak_rate.sel(axis="x").values > 0.0).tolist() == [False, True]
    beyond = f"pressure={1.1 * float(ds.nominal_pressure.max())} MPa"
    _, row, *_ = said("show", "seal", "--at", beyond).splitlines()
    assert row.split()[2:] == ["0", "of", "2", "(1", "closed", "before)", "0", "of", "1", "–", "–"]
    rows = answered("compare", "seal", twin("seal"), "--at", beyond)["rows"]
    assert [(row["closed_before"], row["leak_rate_x"]) for row in rows] == [(1, None), (1, None)]


@pytest.mark.parametrize("corner", [False, True])
def test_the_leak_at_a_load_is_the_reading_of_the_leak_curve(corner: bool, tmp_path: Path) -> None:
    """On steps, between them, beside a closing and beyond; of a corner, also beside steps without a load."""
    unloaded = "record:\n  region: {x: [0, 0.25], y: [0, 0.25]}"
    ds = _made(SEAL.replace("record:", unloaded), tmp_path) if corner else _run("seal").dataset
    assert bool((ds.mean_pressure == 0.0).any()) == corner
    run = checked(ds.roughvol.derived())
    loaded = run.nominal_pressure.where(run.nominal_pressure > 0.0)
    loads = np.geomspace(float(loaded.min()), float(loaded.max()), 13)
    found = [ds.roughvol.at(pressure=f"{load:.15g} MPa") for load in loads]
    compared = 0
    for axis, each in curves(run).items():
        for curve in each:
            read = curve.at(loads).value
            own = [state.leak_rate.sel(axis=axis, seed=state.seed == int(curve.surface.split()[-1])) for state in found]
            leaks = np.array([leak.item() if leak.size else np.nan for leak in own])
            known = np.isfinite(read) & np.isfinite(leaks)
            assert_allclose(leaks[known], read[known], rtol=1e-9)
            compared += int(known.sum())
    assert compared > 40


def test_a_place_lies_between_two_steps_or_on_one() -> None:
    values = np.array([0.0, np.nan, 1.0, 3.0])
    assert place_of(values, 1.0 + 1e-9, 1e-6) == 2.0
    assert place_of(values, 2.0, 1e-6) == 2.5
    assert place_of(values, 2.0, 1e-6, between=False) is None
    assert place_of(values, 4.0, 1e-6) is None
    names = ("free_volume", "flow_index", "openness")  # quantities of a user begin as a flow and as a way
    group = Dataset({name: (("seed", "step"), values[np.newaxis]) for name in names}, coords={"step": [1, 2, 3, 4]})
    there = between(group, [0], [2.5], values[np.newaxis], is_load=True)
    assert [float(there[name][0]) for name in names] == [2.0, 2.0, 2.0]


@pytest.mark.parametrize("pressure", ["0.01 MPa", "0.035 MPa"])
def test_a_state_of_recorded_flux_has_the_leak_solved_for_it(pressure: str, tmp_path: Path) -> None:
    """Before the first step it has no other number than those recorded."""
    run = _run("flux")
    found = at(run, _groups(run)[0], parse(f"pressure={pressure}")).data
    exact = _made(LISTED.replace("0.02 MPa, 0.05 MPa, 0.1 MPa", pressure), tmp_path).isel(D=0, m=0, step=0)
    assert_allclose(found["leak_rate"], exact["leak_rate"], rtol=1e-4)  # loads are searched to `level.REACHED`
    assert_allclose(found.nominal_pressure, exact.nominal_pressure, rtol=1e-5)
    assert bool(found.residual.isnull().all()) == (pressure == "0.01 MPa")


def test_a_state_recorded_on_a_later_leg_is_the_state_solved_for_it(tmp_path: Path) -> None:
    """No surface reaches it on the first leg, so its label names no leg."""
    ends = ("0.02 MPa", "0.01 MPa", "0.1 MPa")
    legs = ", ".join(f"{{steps: 1, to: {{pressure: {end}}}}}" for end in ends)
    text = FLUX.replace("{pressures: [0.02 MPa, 0.05 MPa, 0.1 MPa]}", f"[{legs}]").replace("0.01 MPa, 0.035", "0.035")
    ds = _made(text, tmp_path)
    for leg in ("", ", leg 3"):
        found = ds.roughvol.at(f"pressure=0.035 MPa{leg}")
        assert_allclose(found.free_volume, ds.flux_at_free_volume.isel(flux_at=0), rtol=1e-12)
        assert_allclose(found.transmissivity, ds.flux_at_transmissivity.isel(flux_at=0), rtol=1e-12)


def test_a_state_recorded_on_the_first_leg_is_none_of_a_later_leg(tmp_path: Path) -> None:
    """The surfaces have yielded and leak more at the load on leg 2. A leak of a lifted gap is not read off."""
    legs = "[{steps: 2, to: {pressure: 0.05 MPa}}, {steps: 2, to: {pressure: 0.01 MPa}}]"
    text = SEAL.replace("10 MPa}", "10 MPa, hardness: 1 MPa}")
    flux = text.replace("sivity: every-step", "sivity: every-step, flux_at: {pressure: 0.035 MPa}")
    made = (_made(one.replace("seeds: 3", "seeds: 1"), tmp_path / str(k), legs) for k, one in enumerate((flux, text)))
    found, read_off = (ds.roughvol.at("pressure=0.035 MPa, leg 2").leak_rate for ds in made)
    assert_allclose(found, read_off, rtol=1e-12)
    lifted = LIFT.replace("{steps: 4, to: {pressure: 0.05 MPa}}", legs).replace("0.03 MPa", "0.035 MPa")
    lifted = lifted.replace("[3, 4, 5]", "[3]")
    assert _made(lifted, tmp_path / "lift").roughvol.at("pressure=0.035 MPa, leg 2").leak_rate.isnull().all()


@pytest.mark.parametrize("region", ["{x: [0, 1]}", "{x: [0, 0.5]}"])
def test_the_yield_of_a_recorded_state_is_that_of_a_leg_that_ends_there(region: str, tmp_path: Path) -> None:
    text = (
        "surface: {D: 2.3, m: 4, seeds: 2}\nmaterial: {E_star: 100, hardness: 2}\n"
        f"sweep: {SWEEP}\nrecord: {{region: {region}, fields_at: {{pressure: 0.4}}}}\n"
    )
    one, two = "[{steps: 1, to: {pressure: 1}}]", "[{steps: 4, to: {pressure: 0.4}}, {steps: 1, to: {pressure: 1}}]"
    found, wanted = (
        _made(text, tmp_path / str(k), legs).roughvol.at("pressure=0.4") for k, legs in enumerate((one, two))
    )
    for name in OF_YIELD:
        assert_allclose(found[name], wanted[name], rtol=1e-4)


def test_a_way_that_is_closed_at_a_recorded_state_lets_no_gas_through(tmp_path: Path) -> None:
    """The way is open at the step before. The record of the state has the flow of the liquid alone."""
    text = LIFT.replace("{steps: 4, to: {pressure: 0.05 MPa}}", "{pressures: [0.05 MPa, 3 MPa]}")
    text = text.replace("transmissivity:", "gas_flow: every-step, percolation: every-step, transmissivity:")
    text = text.replace("[0.03 MPa, 0.05 MPa]", "0.1 MPa").replace("mm^3/s}", "mm^3/s}, gas_leak_rate: mbar*l/s")
    ds = _made(text + "fluid: {gas: air, inlet: 2 bar, outlet: 1 bar}\n", tmp_path)
    found = ds.roughvol.at(pressure="0.1 MPa")
    shut = (found.open_dry == 0.0) & (ds.percolates.isel(step=0) == 1.0)
    assert bool(shut.any())
    for name in ("gas_leak_rate_dry", "gas_transmissivity_dry", "percolates"):
        assert bool((found[name].where(shut, 0.0) == 0.0).all()), name


def test_a_way_is_closed_from_its_solved_closing_load_on(tmp_path: Path) -> None:
    text = CLOSING.replace("record:", "record:\n  fields_at: {mean_gap: 0.05 um}")
    ds = _made(text, tmp_path, "{pressures: [0.02 MPa, 2 MPa]}")
    steps = ds.roughvol.derived()
    closes = steps.closing_pressure * (steps.nominal_pressure / steps.mean_pressure).isel(step=-1)
    first, load = steps.nominal_pressure.isel(step=0), float(closes.median())
    there = ds.roughvol.at(pressure=f"{load:.9g} MPa")
    share = ((closes - load) / (closes - first)).clip(0.0)
    assert 0 < int((share > 1e-6).sum()) < share.size
    assert_allclose(there.leak_rate.transpose(*share.dims), steps.leak_rate.isel(step=0) * share, rtol=1e-4, atol=1e-12)
    assert bool(((there.open > 0.0) | (share < 1e-6)).all())
    assert bool(((there.leak_rate == 0.0) | (share > 0.0)).all())
    recorded = ds.roughvol.at(mean_gap="0.05 um")
    assert_allclose(recorded.mean_gap, 0.05, rtol=1e-4)  # the second step is in full contact, where V* is 0
    shut = closes <= recorded.nominal_pressure
    assert bool(shut.any())
    assert bool((recorded.leak_rate.where(shut, 0.0) == 0.0).all())


def test_a_state_before_a_first_step_at_the_closing_load_is_read(tmp_path: Path) -> None:
    text = CLOSING.replace("record:", "record:\n  fields_at: {pressure: 0.02 MPa}")
    ds = _made(text.replace("steps: 10", "steps: 1"), tmp_path)
    assert np.any(ds.closing_pressure.max("axis") == ds.mean_pressure.isel(step=0))
    assert_allclose(ds.roughvol.at(pressure="0.02 MPa").nominal_pressure, 0.02, rtol=1e-5)


@pytest.mark.parametrize("step", ["0.02", "2"])
def test_a_way_is_closed_beside_the_sweep_from_its_solved_closing_load_on(step: str, tmp_path: Path) -> None:
    ds = _made(CLOSING, tmp_path, f"{{pressures: [{step} MPa]}}")
    closes = ds.closing_pressure * (ds.nominal_pressure / ds.mean_pressure).isel(step=-1)
    load = 1.001 * float(closes.median())
    there = ds.roughvol.at(pressure=f"{load:.9g} MPa")
    shut = (closes <= load).transpose(*there.leak_rate.dims)
    assert 0 < int(shut.sum()) < shut.size
    assert_allclose(there.leak_rate, np.where(shut, 0.0, np.nan))
    assert not bool(there.reached.any())
    with pytest.raises(DatasetError, match="no state at pressure="):
        ds.roughvol.at(pressure=f"{0.999 * float(closes.min()):.9g} MPa")


def test_a_recorded_state_in_full_contact_has_no_gap(tmp_path: Path) -> None:
    text = SEAL.replace("record:", "record:\n  fields_at: {pressure: 2 MPa}").replace("seeds: 3", "seeds: 1")
    found = _made(text, tmp_path, "{pressures: [0.02 MPa, 2 MPa]}").roughvol.at(pressure="2 MPa")
    assert_allclose(found.contact_area_fraction, 1.0)
    assert_allclose(found.mean_gap, 0.0)
    assert_allclose(found.nominal_pressure, 2.0, rtol=1e-5)


def test_numbers_of_a_recorded_state_in_units_are_those_without(tmp_path: Path) -> None:
    text = SEAL.replace("record:", "record:\n  fields_at: {contact_area: 0.1}")
    text = text.replace("{pressure: MPa,", "{pressure: MPa, separation: nm, mean_gap: um, free_volume: um,")
    ds = _made(text, tmp_path, "{steps: 3, to: mean-plane}")
    found, steps = ds.roughvol.at(contact_area=0.1), ds.isel(step=1)
    for name, starred in (("mean_plane_separation", "separation"), ("mean_gap", "free_volume")):
        assert_allclose(found[name] / found[starred], steps[name] / steps[starred], rtol=1e-9)


def test_elastic_contact_opens_at_the_load_at_which_it_closes(tmp_path: Path) -> None:
    text = CLOSING.replace("closing: true", "closing: true, constriction: every-step, gas_flow: every-step")
    text += "fluid: {gas: helium, inlet: 1 bar, outlet: 0 bar}\n"
    ds = _made(text, tmp_path, "[{pressures: [0.01 MPa, 2 MPa]}, {pressures: [1.9 MPa, 0.01 MPa]}]")
    closes = ds.closing_pressure * (ds.nominal_pressure / ds.mean_pressure).isel(step=0)
    for load in (0.5 * float(closes.min()), 1.001 * float(closes.median()), 1.001 * float(closes.max())):
        up, down = (ds.roughvol.at(pressure=f"{load:.9g} MPa", leg=leg) for leg in (1, 2))
        assert_allclose(up.open, down.open)
        for found in (up, down):
            way = (closes > load).transpose(*found.open.dims)
            for name in ("open", "percolates", "critical_gap", "transmissivity", "leak_rate"):
                assert np.array_equal(found[name].transpose(*way.dims) > 0.0, way), name
            path = (found.knudsen_number * found.critical_gap).where(found.open == 1.0)  # the mean free path
            assert int(path.count()) == int(way.sum())
            assert_allclose(path.max(), path.min(), rtol=1e-9)


def test_a_surface_that_yielded_does_not_open_at_the_load_at_which_it_closed(tmp_path: Path) -> None:
    text = CLOSING.replace("E_star: 10 MPa", "E_star: 10 MPa, hardness: 1 MPa")
    ds = _made(text, tmp_path, "[{pressures: [0.01 MPa, 0.5 MPa]}, {pressures: [0.01 MPa]}]")
    load = 1.1 * float((ds.closing_pressure * (ds.nominal_pressure / ds.mean_pressure).isel(step=0)).max())
    up, down = (ds.roughvol.at(pressure=f"{load:.9g} MPa", leg=leg).open for leg in (1, 2))
    assert_allclose(up, 0.0)
    assert_allclose(down, 1.0)  # open up to the closed step: where it opens is not known


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [(450.0, 2, "450"), (9996.0, 2, "10000"), (4.5e5, 2, "4.5e5"), (0.0123, 2, "0.012"), (1234.5, 4, "1234")],
)
def test_few_digits_need_no_power(value: float, digits: int, text: str) -> None:
    assert number(value, digits) == text


@pytest.mark.parametrize("closing", [False, True])
def test_a_leak_is_reached_on_the_way_to_0(closing: bool, tmp_path: Path) -> None:
    """Between the last open step and the closing, by a load or by the leak that this load has."""
    text = (CLOSING if closing else SEAL).replace("seeds: 3", "seeds: 1")
    ds = _made(text, tmp_path, "[{steps: 7, to: {pressure: 0.4 MPa}}, {steps: 3, to: {pressure: 0.02 MPa}}]")
    rates = ds.leak_rate.sel(axis="x").squeeze().values
    for step in np.flatnonzero((rates[:-1] > 0.0) != (rates[1:] > 0.0)):
        leg, smaller = int(ds.leg[step + 1]), max(rates[step], rates[step + 1]) * np.array([0.9, 0.1])
        for rate in smaller:
            found = ds.roughvol.at(f"leak_rate_x={rate} mm^3/s, leg {leg}")
            assert_allclose(found.leak_rate.sel(axis="x"), rate, rtol=1e-9)
            again = ds.roughvol.at(f"pressure={found.nominal_pressure.item()} MPa, leg {leg}")
            assert_allclose(again.leak_rate, found.leak_rate, rtol=1e-9)


@pytest.mark.parametrize("smaller", [1e-12, 0.0])
@pytest.mark.parametrize("order", [1, -1])
def test_the_larger_leak_at_a_leak_rate_is_this_rate(smaller: float, order: int) -> None:
    """One way falls below the other between two steps, on loading and unloading, or closes there."""
    ds = roughvol.open("seal").isel(seed=[0], step=[0, 1])
    ds["leak_rate"][...] = np.array([[1e-6, 5e-7], [smaller, 1e-8]])
    for rate in (2e-8, 1e-7, 4e-7):
        found = ds.isel(step=[0, 1][::order]).assign_coords(step=ds.step).roughvol.at(f"leak_rate={rate} mm^3/s")
        assert_allclose(found.leak_rate.max("axis"), rate, rtol=1e-9)


def test_a_state_of_a_leak_rate_is_at_the_load_that_ask_finds() -> None:
    """On few steps, one way closes at its solved load where the other is open."""
    ds = roughvol.open("seal").isel(seed=[1], step=slice(None, None, 2))
    leaks = ds.leak_rate.squeeze().values
    for rate in np.geomspace(leaks.min(axis=0).max(), leaks[0].min(), 9)[1:-1].tolist():
        answers = roughvol.ask(ds, leak_rate=f"{rate} mm^3/s").answers
        for kind, axes in (("leak_rate_x", [0]), ("leak_rate_y", [1]), ("leak_rate", [0, 1])):
            found = ds.roughvol.at(f"{kind}={rate} mm^3/s")
            assert_allclose(found.leak_rate.isel(axis=axes).max("axis"), rate, rtol=1e-9)
            assert_allclose(found.nominal_pressure, max(answers[k].value for k in axes), rtol=1e-9)


def test_the_order_of_axes_changes_no_state_of_a_leak_rate(tmp_path: Path) -> None:
    """One way closes before the other, between the same steps."""
    ds = _made(CLOSING, tmp_path, "{steps: 5, to: {pressure: 0.4 MPa}}")
    leaks = ds.leak_rate.sel(axis="x")
    rate = f"leak_rate_x={0.1 * float(leaks.where(leaks > 0.0).min())} mm^3/s"
    found, turned = (one.roughvol.at(rate) for one in (ds, ds.isel(axis=[1, 0])))
    assert_allclose(turned.nominal_pressure, found.nominal_pressure, rtol=1e-9)
