"""Cases and the paths of their sweeps: where a leg ends, which steps it has, what is stored, resumed and refused."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import roughvol
from roughvol.campaign import cost, one_case
from roughvol.campaign.case_surface import surface_of
from roughvol.campaign.execution import run
from roughvol.campaign.one_case import Context, run_case
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import sweep
from roughvol.errors import ContactError, RoughvolError
from roughvol.store import checkpoint
from roughvol.store.dataset import Dataset
from roughvol.study import loads
from roughvol.surfaces.texture import summit_plane
from tests.campaign.kit import case_of, noise, resumed, solved, table, values_of
from tests.kit import ran, refused, said

pytestmark = pytest.mark.usefixtures("here")

PLAIN = "surface: {D: 2.3, m: 4, seeds: [4], L: 100.0}\n"
UNITS = "surface: {D: 2.3, m: 4, seeds: [4], L: 100 um, Sq: 1 um}\nmaterial: {E_star: 10 MPa}\n"
PERIOD = "surface: {D: 2.4, m: 4, L: 3.0, seeds: [2], sides: periodic}\n"
SCALE = 10.0 * 1.0 / 100.0  # MPa: E* Sq/L
AREA = (17 * 100.0 / 16) ** 2  # um², of all elements
ELEMENT = 1.0 / 17**2
HARD = "material: {E_star: 1.0, hardness: 0.05}\n"
PATH = "sweep: [{steps: 4, to: {pressure: 1.5}}, {steps: 3, to: {pressure: 0.4}}, {steps: 3, to: {indentation: 2.5}}]\n"


def _stored(text: str, out: str = "run") -> Dataset:
    study = loads(text)
    assert loads(study.stored(), stored=True) == study
    return roughvol.run(study, out=out, jobs=1).squeeze(("D", "m", "seed"))


# One case


def test_a_half_space_passed_on_changes_no_value() -> None:
    held: one_case.HalfSpaces = {}
    for case in loads("surface: {D: [2.2, 2.7], m: [2, 3], seeds: 1}\nsweep: {steps: 2}").cases():
        assert values_of(run_case(case, Context(half_spaces=held))).identical(values_of(run_case(case)))
        assert len(held) == 1


def test_without_steps_nothing_is_pressed() -> None:
    result = solved(PLAIN + "sweep: {steps: 0}\nrecord: {heights: true}")
    surface = {"Sq", "Sdq", "z_max", "hurst_measured", "nodes_x", "nodes_y"}
    assert set(result.data_vars) == {*surface, "wall_time", "heights"}
    assert "step" not in result.dims


# Ends


@pytest.mark.parametrize(
    ("surface", "to", "name", "value"),
    [
        (PLAIN, "mean-plane", "separation", 0.0),
        (PLAIN, "{indentation: 2.5}", "indentation", 2.5),
        (PLAIN, "{pressure: 0.75}", "mean_pressure", 0.75),
        (PLAIN, "{contact_area: 0.25}", "contact_area_fraction", 0.25),
        (UNITS, "{pressure: 200 kPa}", "mean_pressure", 0.2 / SCALE),
        (UNITS, "{load: 1 mN}", "mean_pressure", 1e-3 / (AREA * 1e-12) * 1e-6 / SCALE),
        (UNITS, "{separation: -200 nm}", "separation", -0.2),
        (UNITS, "{mean_gap: 1 um}", "free_volume", 1.0),
        (PERIOD, "{pressure: 2.0}", "mean_pressure", 2.0),
        (PERIOD, "{contact_area: 0.3}", "contact_area_fraction", 0.3),
        (PERIOD, "{free_volume: 0.4}", "free_volume", 0.4),
        (PERIOD, "{separation: 0.7}", "separation", 0.7),
        (PERIOD, "{indentation: 1.2}", "indentation", 1.2),
        (PERIOD, "mean-plane", "separation", 0.0),
    ],
)
def test_a_sweep_ends_at_its_value_in_equal_steps(surface: str, to: str, name: str, value: float) -> None:
    ds = solved(f"{surface}sweep: {{steps: 3, to: {to}}}")
    assert_allclose(ds[name][-1], value, rtol=2e-5, atol=1.01 * ELEMENT if name.startswith("contact") else 2e-5)
    approach = ds.indentation + (ds.mean_pressure if "periodic" in surface else 0.0)
    assert_allclose(np.diff(approach), approach[0], rtol=1e-3 if "periodic" in surface else 1e-9)


@pytest.mark.parametrize("surface", [PLAIN, PERIOD])
def test_a_sweep_to_the_summit_plane_ends_on_the_mean_of_the_summits(surface: str) -> None:
    text = f"{surface}sweep: {{steps: 2, to: summit-plane}}"
    pressed, ds = surface_of(case_of(text)), solved(text)
    expected = (pressed.z_max - summit_plane(pressed.with_neighbours)) / pressed.Sq
    assert_allclose(ds.indentation[-1], expected, rtol=1e-4 if pressed.periodic else 1e-10)


@pytest.mark.parametrize(
    ("lists", "name", "values"),
    [
        ("pressures: [0.01 MPa, 100 kPa, 0.2 MPa]", "mean_pressure", [0.1, 1.0, 2.0]),
        ("pressures: 0.5", "mean_pressure", [0.5]),
        ("contact_areas: [0.05, 0.2]", "contact_area_fraction", [0.05, 0.2]),
        ("mean_gaps: [1.5 um, 1 um]", "free_volume", [1.5, 1.0]),
        ("free_volumes: [1.2, 0.7]", "free_volume", [1.2, 0.7]),
        ("separations: [1, 0.5, -0.5]", "separation", [1.0, 0.5, -0.5]),
        ("indentations: [1 um, 2 um]", "indentation", [1.0, 2.0]),
        ("steps: 4, to: {pressure: 0.2 MPa}, equal: pressure", "mean_pressure", [0.5, 1.0, 1.5, 2.0]),
        ("steps: 3, to: {pressure: 2}, equal: log pressure, first: 0.02 MPa", "mean_pressure", [0.2, 0.4**0.5, 2.0]),
        ("steps: 4, to: {pressure: 2}, equal: log pressure", "mean_pressure", [0.002, 0.02, 0.2, 2.0]),
    ],
)
def test_a_list_or_a_law_makes_a_step_of_each_value(lists: str, name: str, values: list[float]) -> None:
    ds = solved(f"{UNITS}sweep: {{{lists}}}")
    assert_allclose(ds[name], values, rtol=2e-5, atol=1.01 * ELEMENT if name.startswith("contact") else 1e-12)


@pytest.mark.parametrize("to", ["mean-plane", "{contact_area: 0.3}"])
def test_steps_equal_in_pressure_end_where_the_sweep_ends(to: str) -> None:
    plain, even = (solved(f"{UNITS}sweep: {{steps: 3, to: {to}{equal}}}") for equal in ("", ", equal: pressure"))
    assert_allclose(even.indentation[-1], plain.indentation[-1], rtol=1e-9)
    assert_allclose(even.mean_pressure, float(even.mean_pressure[-1]) * np.array([1, 2, 3]) / 3, rtol=2e-5)


FLUID = "{pressure_drop: 1 bar, viscosity: 1 mPa*s}"
LEAKING = f"record: {{transport: {{transmissivity: every-step}}, dimensional: {{leak_rate: {FLUID}}}}}\n"


@pytest.mark.parametrize(
    ("axis", "more", "rtol"),
    [("", "", 1e-4), ("_x", ", hardness: 2 MPa", 1e-4), ("_y", "}\nsolver: {accuracy: reference", 2e-5)],
)
def test_a_sweep_ends_at_the_value_of_a_leak_rate(axis: str, more: str, rtol: float) -> None:
    surface = UNITS.replace("10 MPa}", f"10 MPa{more}}}")
    ds = _stored(f"{surface}{LEAKING}sweep: {{steps: 3, to: {{leak_rate{axis}: 0.01 mm^3/s}}}}\n")
    followed = (ds.leak_rate.sel(axis=axis[1:]) if axis else ds.leak_rate.max("axis")).values
    assert_allclose(followed[-1], 0.01, rtol=rtol)
    assert (np.diff(followed) < 0.0).all()


def test_listed_leak_rates_are_steps() -> None:
    ds = _stored(UNITS + LEAKING + "sweep: {leak_rates: [1e-1 mm^3/s, 10 mm^3/h, 1e-3 mm^3/s]}\n", "list")
    assert_allclose(ds.leak_rate.max("axis"), [1e-1, 10.0 / 3600.0, 1e-3], rtol=2e-4)
    assert "leak_rate=10 mm^3/h" in said("show", "list", "--at", "leak_rate=10mm^3/h")


# Legs


@pytest.mark.parametrize("material", ["", HARD])
def test_legs_are_steps_equal_in_indentation_from_end_to_end(material: str) -> None:
    ds = solved(PLAIN + PATH + material)
    assert_array_equal(ds.leg, [1] * 4 + [2] * 3 + [3] * 3)
    ends = ds.indentation.values[[3, 6, 9]]
    assert_allclose(ds.mean_pressure[[3, 6]], [1.5, 0.4], rtol=1e-5)
    assert ends[2] == 2.5
    legs = [np.linspace(*leg)[1:] for leg in zip([0.0, *ends[:-1]], ends, (5, 4, 4), strict=True)]
    assert_allclose(ds.indentation, np.concatenate(legs), rtol=1e-12)
    surface = surface_of(case_of(PLAIN))
    hardness = 0.05 * surface.side / surface.Sq if material else None
    contacts = list(sweep(surface, HalfSpace(surface.shape), ds.indentation.values, hardness=hardness))
    assert_allclose(ds.free_volume, [contact.free_volume for contact in contacts], rtol=1e-12)


def test_legs_of_any_kernel_end_at_their_pressures() -> None:
    generator = np.random.default_rng(140)  # overlaps fall on the way down here
    shape = tuple(generator.integers(5, 12, 2))
    heights = generator.normal(size=shape)
    np.save("noise.npy", heights)
    hardness = float(np.exp(generator.uniform(-0.7, 2.0)))
    pressures = hardness * np.array([0.9, 0.8, 0.6, 0.9, 0.5, 0.95])
    legs = ", ".join(f"{{steps: 5, to: {{pressure: {pressure}}}}}" for pressure in pressures)
    text = f"surface: {{file: noise.npy, L: 1.0}}\nsweep: [{legs}]\nsolver: {{kernel: punch, rtol: 1.0e-8}}\n"
    text += f"material: {{E_star: 1.0, hardness: {hardness * heights.std()}}}\n"
    assert_allclose(solved(text).mean_pressure.values.ravel()[4::5], pressures, rtol=5e-6)


@pytest.mark.parametrize("hardness", ["", ", hardness: 0.5 MPa"])
def test_listed_loads_may_fall_on_a_leg(hardness: str) -> None:
    legs = "[{pressures: [0.1 MPa, 0.2 MPa]}, {pressures: [0.1 MPa, 0 MPa]}, {steps: 2, to: {mean_gap: 0.9 um}}]"
    ds = solved(f"{UNITS.replace('10 MPa', f'10 MPa{hardness}')}sweep: {legs}")
    assert_allclose(ds.mean_pressure.values[:4] * SCALE, [0.1, 0.2, 0.1, 0.0], rtol=2e-5, atol=1e-9)
    assert_allclose(ds.free_volume.values[-1], 0.9, rtol=2e-5)
    assert ds.leg.values.tolist() == [1, 1, 2, 2, 3, 3]


def test_one_leg_in_a_list_is_the_sweep_with_its_number() -> None:
    one, other = (solved(f"{PLAIN}sweep: {text}\n") for text in ("{steps: 3}", "[{steps: 3}]"))
    assert_array_equal(one.mean_pressure, other.mean_pressure)
    assert ("leg" in one, "leg" in other) == (False, True)


@pytest.mark.parametrize(
    "sweep",
    [
        PATH + HARD + "record: {residual_heights: true}\n",
        "sweep: [{pressures: [0.05, 0.1, 0.2]}, {pressures: [0.1]}, {steps: 3, to: {pressure: 0.3}}]\n",
        "sweep: [{steps: 3, to: {contact_area: 0.2}, equal: log pressure}, {steps: 2, to: {pressure: 0.1}, "
        "equal: pressure}]\n",
    ],
)
def test_a_path_goes_on_with_the_same_bits(sweep: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "NODES", 1)
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)
    case = case_of(PLAIN + sweep)
    whole = run_case(case)
    for stop in range(1, case.sweep.steps, 2):
        again, rest = resumed(case, stop, tmp_path / f"{stop}.npz")
        assert rest[0] == stop + 1
        assert values_of(again).identical(values_of(whole))


@pytest.mark.parametrize("periodic", ["true", "false"])
@pytest.mark.parametrize("hardness", ["null", "0.4"])
@pytest.mark.parametrize(
    ("to", "name", "value"),
    [("{separation: 3}", "separation", 3.0), ("{indentation: 0}", "indentation", 0.0)],
)
def test_a_leg_may_lose_contact_and_find_it(periodic: str, hardness: str, to: str, name: str, value: float) -> None:
    up = "{steps: 2, to: {pressure: 0.2}}"
    data = solved(
        f"surface: {{D: 2.3, m: 4, L: 1, seeds: [1], periodic: {periodic}}}\n"
        f"material: {{E_star: 1, hardness: {hardness}}}\nsweep: [{up}, {{steps: 2, to: {to}}}, {up}]"
    )
    assert_allclose([data[name][3], data.mean_pressure[3]], [value, 0.0], atol=1e-6)
    assert_allclose(data.mean_pressure[-1], 0.2, rtol=1e-4)
    assert_allclose(data.separation[-1], data.separation[1], atol=2e-5)


@pytest.mark.parametrize("periodic", ["true", "false"])
@pytest.mark.parametrize("to", ["{percolation: x}", "{contact_area: 0.5}"])
def test_an_end_by_elements_is_the_first_on_every_path(periodic: str, to: str) -> None:
    surface = f"surface: {{D: 2.3, m: 4, seeds: [1], periodic: {periodic}}}\n"
    legs = (
        f"[{{steps: 1, to: {{contact_area: 0.3}}}}, {{steps: 1, to: {{contact_area: 0.05}}}}, {{steps: 2, to: {to}}}]"
    )
    first, *others = (
        solved(surface + text)
        for text in (
            f"sweep: {{steps: 2, to: {to}}}",
            f"material: {{E_star: 1, hardness: 1e5}}\nsweep: {{steps: 2, to: {to}}}",
            f"sweep: {legs}",
        )
    )
    for data in others:
        assert_allclose(data.mean_pressure[-1], first.mean_pressure[-1], rtol=3e-4)
        assert data.contact_area_fraction[-1] == first.contact_area_fraction[-1]


# Metal


def test_unloading_leaves_no_pressure_and_a_surface_below_the_virgin_one() -> None:
    record = "record: {residual_heights: true, heights: true, texture: true}\n"
    ds = solved(PLAIN + "sweep: [{steps: 5, to: {pressure: 1}}, {steps: 3, to: {pressure: 0}}]\n" + HARD + record)
    assert ds.mean_pressure[-1] == ds.contact_area_fraction[-1] == 0.0
    depth = (ds.heights - ds.residual_heights).values
    assert depth.min() == 0.0
    assert_allclose(depth.mean() / ds.Sq, ds.plastic_volume[-1], rtol=1e-12)
    assert_allclose((depth > 0).mean(), ds.plastic_area_fraction[-1], rtol=1e-12)
    # the residual surface is at its highest point at Δ
    assert_allclose(ds.indentation[-1], (ds.heights.max() - ds.residual_heights.max()) / ds.Sq, rtol=1e-12)
    assert ds.Sp_residual < ds.Sp
    assert_allclose(ds.plastic_volume[4:], ds.plastic_volume[4], atol=1e-6)


def test_yield_is_that_of_the_region() -> None:
    record = "record: {residual_heights: true, heights: true, region: {x: [0.25, 0.75], y: [0, 1]}}\n"
    ds = solved(PLAIN + "sweep: {steps: 3, to: {pressure: 1}}\n" + HARD + record)
    depth = (ds.heights - ds.residual_heights).sel(x=slice(0.25, 0.75)).values
    assert_allclose(depth.mean() / ds.Sq, ds.plastic_volume[-1], rtol=1e-10)
    assert_allclose((depth > 0).mean(), ds.plastic_area_fraction[-1], rtol=1e-12)
    assert (ds.heights - ds.residual_heights).values.mean() != pytest.approx(depth.mean(), rel=1e-3)


def test_a_hardness_counts_over_the_scaled_heights() -> None:
    text = "surface: {{D: 2.3, m: 4, seeds: [1], L: {}, Sq: {}}}\nmaterial: {{E: 70 GPa, nu: 0.3, hardness: 1 GPa}}\n"
    text += "sweep: {{steps: 3, to: {{indentation: 2}}}}\n"
    sizes = [("100 um", "1 um"), ("0.1 mm", "1 um"), ("100 um", "1 nm")]
    micro, milli, flat = (solved(text.format(*size)) for size in sizes)
    assert_allclose(micro.plastic_volume, milli.plastic_volume, rtol=1e-12)
    assert (flat.plastic_volume == 0.0).all()


@pytest.mark.parametrize("hardness", ["", ", hardness: 2 MPa"])
def test_levels_with_units_are_solved_on_a_path_and_named_as_in_the_study(hardness: str) -> None:
    legs = "[{steps: 4, to: {pressure: 0.2 MPa}}, {steps: 2, to: {pressure: 0.01 MPa}}]"
    levels = "{pressure: 0.05 MPa, mean_gap: 1 um, separation: 0.5 um, indentation: 1500 nm, load: 1 mN}"
    record = f"record: {{fields_at: {levels}, transport: {{percolation: {{pressure: 0.05 MPa}}}}}}\n"
    ds = _stored(f"{UNITS.replace('10 MPa', f'10 MPa{hardness}')}sweep: {legs}\n{record}", "levels")
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
    assert_allclose(ds.pressure.mean(("x", "y")), ds.field_at_mean_pressure, rtol=1e-9)
    assert int(ds.percolates.sel(axis="x").notnull().sum()) == 1
    for options in (["--at", "mean_gap=1um"], ["--at", "pressure=0.05MPa", "--csv"]):
        said("show", "levels", *options)


@pytest.mark.parametrize("hardness", ["", ", hardness: 2"])
def test_levels_on_all_legs_are_states_of_each(hardness: str) -> None:
    text = (
        f"surface: {{D: 2.3, m: 4, seeds: [4], Sq: 1}}\nmaterial: {{E_star: 100{hardness}}}\n"
        "sweep: [{steps: 3, to: {pressure: 2}}, {steps: 2, to: {pressure: 0.1}}, {steps: 3, to: {pressure: 1}}]\n"
        "record: {fields_at: {pressure: [0.5, 1]}, transport: {percolation: {pressure: 0.5}}, all_legs: true}\n"
    )
    ds, first = solved(text), solved(text.replace(", all_legs: true", ""))
    labels = [f"pressure={p}{leg}" for leg in ("", ", leg 2", ", leg 3") for p in ("0.5", "1")]
    assert ds.field_at.values.tolist() == labels
    assert_allclose(ds.field_at_mean_pressure, [0.5, 1.0] * 3, rtol=1e-5)
    assert [int(ds.leg.sel(step=step)) for step in ds.field_at_step.values.tolist()] == [1, 1, 2, 2, 3, 3]
    assert ds.leg.values[ds.percolates.sel(axis="x").notnull().values].tolist() == [1, 2, 3]
    assert case_of(text).id != case_of(text.replace(", all_legs: true", "")).id
    assert first.field_at.values.tolist() == labels[:2]
    assert (first.gap.values == ds.gap.isel(field_at=slice(2)).values).all()
    difference = np.abs(ds.gap.sel(field_at="pressure=0.5") - ds.gap.sel(field_at="pressure=0.5, leg 2")).max()
    assert difference > 0.01 if hardness else difference < 1e-4  # metal remembers, rubber does not


def test_states_of_later_legs_hinder_no_figure() -> None:
    text = (
        "surface: {D: 2.3, m: 4, seeds: [4], Sq: 1}\nmaterial: {E_star: 100}\n"
        "sweep: [{steps: 2, to: {pressure: 0.7}}, {steps: 1, to: {pressure: 0.1}}, {steps: 2, to: {pressure: 2}}]\n"
        "record: {fields_at: {pressure: %s}, all_legs: %s, transport: {transmissivity: last}}\n"
    )
    ran("drawn", text % (0.5, "true"))
    said("plot", "drawn", "fig09")
    ran("later", text % (1, "false"))
    for figure in ("fig09", "flow_of_p"):
        reason = refused("plot", "later", figure)
        assert "no case of the dataset has a value of each on the first leg" in reason
        assert "does not have" not in reason


@pytest.mark.slow
def test_a_path_with_yield_and_without_is_reported_together() -> None:
    legs = "sweep: [{steps: 3, to: {pressure: 1}}, {steps: 2, to: {pressure: 0}}]\n"
    text = f"{UNITS.replace('10 MPa}', '78 GPa, hardness: 1 GPa}')}{legs}record: {{heights: true}}\n"
    for name, study in (("metal", text), ("elastic", text.replace("1 GPa}", "1 GPa, plastic: false}"))):
        run(loads(study, f"{name}.yaml"), out=Path(name), jobs=1)
    said("report", "metal", "elastic", "--out", "report")
    page = Path("report/report.md").read_text()
    for words in ("With yield (metal) and without (elastic)", "On every leg of the path", "pressures end there"):
        assert words in page


# Periodic surfaces


def test_a_dataset_has_the_conventions_of_its_sides() -> None:
    mirrored = "surface: {D: 2.3, m: 4, seeds: 1, sides: mirrored}\n"
    for made, sides, conventions in (
        (PERIOD, "periodic", ("periodic elastic half space", "spacing = L/rows", "the mean gap")),
        (mirrored, "mirrored", ("mirror images", "spacing = L/(rows-1)", "the mean gap")),
    ):
        attrs = solved(made + "sweep: {steps: 1, to: {pressure: 0.1}}").attrs
        assert all(words in attrs["conventions"] for words in conventions)
        assert (attrs["sides"], "periodic" in attrs) == (sides, sides == "periodic")


def test_levels_between_steps_of_a_period_are_solved_for() -> None:
    exact = {"separation": 1.0, "indentation": 0.8, "free_volume": 0.6, "pressure": 0.5}
    levels = ", ".join(f"{kind}: [{value}]" for kind, value in exact.items())
    data = solved(f"{PERIOD}sweep: {{steps: 4, to: {{contact_area: 0.5}}}}\nrecord: {{fields_at: {{{levels}}}}}")
    for kind, value in exact.items():
        state = data.isel(field_at=data.field_at.values.tolist().index(f"{kind}={value:g}"))
        assert_allclose(state[f"field_at_{'mean_' * (kind == 'pressure')}{kind}"], value, atol=2e-5)
        assert_allclose(state.gap.mean(), state.field_at_free_volume, atol=1e-5)
    assert_array_equal(data.x, np.arange(16) / 16)


@pytest.mark.parametrize(
    ("sweep", "name", "value"),
    [
        ("{steps: 2, to: mean-plane}", "separation", 0.0),
        ("{steps: 2, to: {indentation: 1.2}}", "indentation", 1.2),
        ("[{steps: 1, to: {pressure: 0.2}}, {steps: 2, to: {separation: -0.2}}]", "separation", -0.2),
    ],
)
def test_a_plane_is_that_of_the_separation_where_a_period_yields(sweep: str, name: str, value: float) -> None:
    data = solved(f"{PERIOD}material: {{E_star: 1, hardness: 0.4}}\nsweep: {sweep}")
    assert_allclose(data[name][-1], value, atol=2e-5)
    assert float(data.contact_area_fraction[-1]) < 1.0


def test_the_void_stops_percolating_with_joined_sides_and_the_cell_agrees() -> None:
    quantities = ", ".join(f"{name}: every-step" for name in ("percolation", "transmissivity", "cell_transmissivity"))
    data = solved(f"{PERIOD}sweep: {{steps: 4, to: percolation}}\nrecord: {{transport: {{{quantities}}}}}")
    last = data.isel(step=-1)
    assert not last.percolates.any()
    assert last.transmissivity.sel(axis="x") == last.cell_transmissivity.sel(axis="x") == 0.0
    assert (data.cell_transmissivity.sel(axis="x").values[:2] > 0.0).all()


def test_a_height_file_is_one_period() -> None:
    np.save("wave.npy", np.cos(2 * np.pi * np.arange(32) / 32)[:, None] + np.zeros(16))
    data = solved("surface: {file: wave.npy, L: 2.0, sides: periodic}\nsweep: {steps: 3, to: {contact_area: 1}}")
    # full contact of a wave: mean p = π E* h/λ, over E* σ/L with σ = h/√2
    assert_allclose(data.mean_pressure.values.ravel()[-1], math.pi * math.sqrt(2.0), rtol=0.02)


MIDPOINT = "surface: {D: 2.4, m: 4, seeds: 1, sides: periodic}\n"
BODIES = "file: z.npy, L: 1, against: {file: z.npy, mirror: x}, sides: periodic"
HALF = "sweep: {steps: 2, to: {contact_area: 0.5}}\n"
FLOWS = "transport: {percolation: every-step, transmissivity: last, cell_transmissivity: last, constriction: last}"
TEXTURE = "texture: true, psd: {at: last}, box_counting: {}, volume_density: {bins: 5}"
WORKS = {
    "two bodies": f"surface: {{{BODIES}, outliers: {{}}, missing: interpolate}}\n{HALF}record: {{texture: true}}",
    "the paper's algorithm": MIDPOINT + HALF + "solver: {method: paper}",
    "plastic, fourier, region": "surface: {H: 0.7, n: 16, rolloff: 2, seeds: 1, sides: periodic}\n"
    + "sweep: [{steps: 2, to: {separation: 0.6}}, {steps: 1, to: {separation: 1.0}}]\n"
    + HARD
    + "solver: {kernel: fourier}\nrecord: {residual_heights: true, texture: true, region: interior, psd: true}",
    "void, hardness that only reports": MIDPOINT + HALF + "material: {E_star: 1, hardness: 0.3, plastic: false}\n"
    f"record: {{{FLOWS}}}",
    "punch, region": MIDPOINT
    + HALF
    + f"solver: {{kernel: punch}}\nrecord: {{region: interior, region_widths: {{}}, {TEXTURE}}}",
    "ensemble": "surface: {D: 2.4, m: 5, sides: periodic}\nsweep: {pressures: [0.2, 0.4]}\n"
    "ensemble: {accuracy: {free_volume: 40 %}, at: {pressure: [0.2]}}",
}


@pytest.mark.usefixtures("few_samples")
@pytest.mark.parametrize("name", WORKS)
def test_a_period_goes_with_every_other_feature(name: str) -> None:
    z = noise(0, 18, 16)
    z[0, 3:6] = np.nan
    np.save("z.npy", z)
    study = loads(WORKS[name], "study.yaml")
    found = run(study, out=Path("here"), jobs=1)
    assert (found["converged"].astype(float).fillna(1.0) == 1.0).all()
    assert cost.estimate(study, 1).seconds > 0.0


# Refusals


STARTS = {
    "plain+ ": PLAIN,
    "units+ ": UNITS,
    "leaking+ ": UNITS + LEAKING,
    "yielding+ ": UNITS.replace("10 MPa}", "10 MPa, hardness: 2 MPa}"),
    "period+ ": PERIOD,
    "hard period+ ": PERIOD + HARD,
}


@pytest.mark.parametrize(("text", "words"), table("states"))
def test_a_case_without_its_states_is_an_error(text: str, words: str) -> None:
    start, plus, sweep = text.partition("+ ")
    if "%r" in sweep:
        sweep %= surface_of(case_of(PLAIN)).peak - 1.0  # d/σ at Δ/σ = 1
    with pytest.raises(ContactError, match=words):
        solved(STARTS[start + plus] + sweep)


def test_a_gap_wider_than_that_of_the_first_touch_is_refused_with_that_gap() -> None:
    """The gap is a length of the heights of the study, which are scaled to its Sq."""
    with pytest.raises(ContactError, match="um, that of the first touch") as error:
        run_case(case_of(UNITS.replace("Sq: 1 um", "Sq: 0.5 um") + "sweep: {steps: 1, to: {mean_gap: 9 um}}"))
    gap, length = map(float, re.findall(r"[0-9.]+(?= σ| um, that)", str(error.value)))
    assert length == pytest.approx(0.5 * gap, rel=1e-5)


def test_a_period_of_few_heights_is_refused() -> None:
    np.save("few.npy", noise(0, 4, 9))
    with pytest.raises(RoughvolError, match=r"surface\.sides: few\.npy has 4 x 9 heights"):
        run(loads("surface: {file: few.npy, L: 1, sides: periodic}", "study.yaml"), out=Path("run"), jobs=1)


def test_one_way_numbers_are_missing_where_the_first_order_opens_the_joint() -> None:
    text = "surface: {D: 2.2, m: 4, seeds: [1]}\nsweep: {pressures: 4}\nrecord: {transport: "
    text += "{transmissivity: last}, fluid_pressure: {inlet: 4.8, outlet: 0, at: last%s}}\n"
    found = solved(text % "")
    assert np.isfinite(found.fluid_leak).all()
    assert np.isnan(found.fluid_leak_one_way).any()
    with pytest.raises(ContactError, match="mean fluid pressure"):
        solved(text % ", coupling: one-way")
