"""States at levels between two steps: they are at the level, hold their own numbers and disturb no step."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from roughvol.campaign.case_surface import surface_of
from roughvol.campaign.one_case import run_case
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import solve
from roughvol.observables import reduction
from roughvol.observables.levels import reached
from roughvol.observables.regions import within
from roughvol.study import loads, parse
from roughvol.surfaces import texture
from tests.observables.kit import answer

DIMS = ("field_at", "density_at", "box_at", "flux_at", "texture_at")
STUDY = """
surface: {{D: 2.4, m: {m}, seeds: [3]}}
sweep: {{steps: {steps}, to: {to}}}
solver: {solver}
record: {{{record}}}
"""
AT = "fields_at: {pressure: [0.02, 0.5], contact_area: [0.02, 0.08], indentation: 1, separation: 0.7, step: 2}"


def pressed(selected, m=4, steps=7, to="{indentation: 3}", solver="{}"):
    case = loads(STUDY.format(m=m, steps=steps, to=to, solver=solver, record=selected)).cases()[0]
    return run_case(case).isel(D=0, m=0, seed=0, drop=True), case


def state(result, label, dim="field_at"):
    found = result.sel({dim: label})
    return {name: float(found[f"{dim}_{name}"]) for name in (*reduction.OF_STATE, "step")}


@pytest.mark.parametrize(
    ("region", "solver"), [("", "{}"), ("region: interior, ", "{kernel: punch}"), ("", "{rtol: 1.0e-3}")]
)
def test_a_state_is_at_its_level(region, solver):
    result, case = pressed(region + AT, to="{indentation: 4}", solver=solver)
    element = 1 / (81 if region else 289)
    for kind, name in (("pressure", "mean_pressure"), ("indentation", "indentation"), ("separation", "separation")):
        for label in (label for label in result.field_at.values if label.startswith(kind)):
            assert state(result, label)[name] == pytest.approx(float(label.split("=")[1]), rel=5e-6)
    surface = surface_of(case)
    half_space = HalfSpace(surface.shape, kernel=case.solver.kernel)
    for area in (0.02, 0.08):
        found = state(result, f"contact_area={area}")
        assert area <= found["contact_area_fraction"] < area + element
        short = solve(surface, half_space, found["indentation"] * (1 - 1e-4), rtol=1e-9)
        assert within(short, case).contact_area_fraction < area


FIVE, LISTED = "{steps: 5, to: {contact_area: 0.1}}", "{pressures: [0.1, 0.2]}"
LEGS = f"[{LISTED}, {{steps: 1, to: {{pressure: 0.1}}}}]"
SHORT = {"mean_pressure": 0.1 * (1.0 - 3e-6)}  # of a listed state, by the error of a search
UNDECIDED = {"contact_area_fraction": 0.1 - 1 / 17**2}  # a finite residual leaves an element undecided at the end


@pytest.mark.parametrize(
    ("sweep", "level", "step", "state", "expected"),
    [
        (FIVE, "contact_area=0.25", 4, {"contact_area_fraction": 0.25 - 1e-12}, True),
        (FIVE, "contact_area=0.25", 4, {"contact_area_fraction": 0.2499}, False),
        (FIVE, "separation=-0.5", 4, {"separation": -0.5 + 1e-12}, True),
        (FIVE, "separation=-0.5", 4, {"separation": -0.4999}, False),
        (FIVE, "indentation=300", 4, {"indentation": 300.0 - 1e-8}, True),
        (FIVE, "pressure=2", 4, {"mean_pressure": 1.999}, False),
        *((FIVE, level, 4, {}, expected) for level, expected in (("step=4", True), ("step=5", False), ("last", False))),
        *((FIVE, f"contact_area={area}", n, UNDECIDED, (n, area) == (5, 0.1)) for n in (4, 5) for area in (0.1, 0.2)),
        *((LISTED, f"pressure={p}", 1, SHORT, p == 0.1) for p in (0.1, 0.11, 0.2)),
        *((LEGS, f"pressure={p}", 1, SHORT, p == 0.1) for p in (0.1, 0.2)),
    ],
)
def test_neither_rounding_nor_the_error_of_a_search_decides_a_level(sweep, level, step, state, expected):
    (case,) = loads(f"surface: {{D: 2.4, m: 4, seeds: 1}}\nsweep: {sweep}").cases()
    assert reached(parse(level), step, SimpleNamespace(**state), case, surface_of(case)) is expected


def test_what_is_stored_belongs_to_the_state_and_lies_between_the_steps():
    result, case = pressed(AT)
    surface = surface_of(case)
    for label in result.field_at.values:
        found, fields = state(result, label), result.sel(field_at=label)
        exact = solve(surface, HalfSpace(surface.shape), found["indentation"], rtol=1e-9)
        assert_allclose(fields["gap"], exact.gap(), atol=1e-5)
        assert_allclose(float(fields["pressure"].mean()), found["mean_pressure"], rtol=1e-12)
        assert_allclose(float((fields["gap"] == 0.0).mean()), found["contact_area_fraction"], rtol=1e-12)
        assert_allclose(float(fields["gap"].mean()), found["free_volume"], rtol=1e-5)
        step = int(found["step"])
        below = float(result.indentation[step - 2]) if step > 1 else 0.0
        assert below < found["indentation"] <= float(result.indentation[step - 1])
    assert state(result, "step=2") == {
        **{name: float(result[name][1]) for name in reduction.OF_STATE},
        "step": 2,
    }


@pytest.mark.parametrize("solver", ["{}", "{kernel: punch}", "{max_error: {mean_pressure: 1.0e-4}}"])
def test_no_step_changes_by_a_bit(solver):
    plain, _ = pressed("", solver=solver)
    with_levels, _ = pressed(AT, solver=solver)
    for name in (*reduction.OF_STATE, *reduction.OF_SOLVER):
        assert_array_equal(plain[name], with_levels[name])
    assert "level_convolutions" not in plain
    assert float(with_levels.level_convolutions) > 0


def test_equal_levels_are_solved_once():
    one, _ = pressed("fields_at: {pressure: 0.5}")
    several, _ = pressed(
        "fields_at: {pressure: 0.5}, box_counting: {at: {pressure: 0.5}}, volume_density: {at: {pressure: 0.5}}, "
        "transport: {flux_at: {pressure: 0.5}}, texture: {at: {pressure: 0.5}}"
    )
    assert float(one.level_convolutions) == float(several.level_convolutions) > 0
    states = [state(several, "pressure=0.5", dim) for dim in DIMS]
    assert all(other == states[0] for other in states)
    heights = -several.gap.values[0] * float(several.Sq)
    assert float(several.Ssk_loaded[0]) == texture.Ssk(heights)


def test_levels_on_a_step_are_that_step():
    result, _ = pressed("fields_at: {indentation: [1, 3], step: 1, contact_area: 0.9}", steps=3)
    assert float(result.level_convolutions) == 0.0
    assert result.field_at_step.sel(field_at=["indentation=1", "indentation=3"]).values.tolist() == [1, 3]
    missed = state(result, "contact_area=0.9")
    assert missed.pop("step") == -1
    assert np.isnan(list(missed.values())).all()
    for to in ("{contact_area: 0.1}", "{pressure: 0.7}"):
        end, _ = pressed(f"fields_at: {to}", to=to)
        assert float(end.level_convolutions) == 0.0
        assert int(end.field_at_step[0]) == 7


def test_levels_before_the_first_step_are_found():
    result, _ = pressed("fields_at: {pressure: 1.0e-4, contact_area: 1.0e-9, indentation: 0.01}", steps=1)
    assert result.field_at_step.values.tolist() == [1, 1, 1]
    assert state(result, "pressure=0.0001")["mean_pressure"] == pytest.approx(1e-4, rel=1e-5)
    touch = state(result, "contact_area=1e-09")
    assert touch["contact_area_fraction"] == 1 / 289
    assert touch["indentation"] < 1e-3


def test_an_area_below_one_element_is_met_at_first_touch_on_every_leg():
    path = "[{steps: 2, to: {pressure: 0.2}}, {steps: 2, to: {pressure: 0}}, {steps: 2, to: {pressure: 0.3}}]"
    text = f"surface: {{D: 2.3, m: 4, seeds: [1]}}\nmaterial: {{hardness: 0.3}}\nsweep: {path}\n"
    result = answer(text + "record: {fields_at: {contact_area: 1.0e-9}, all_legs: true}")
    elements = 289 * result.field_at_contact_area_fraction.values.ravel()
    assert elements[0] >= 1.0 > elements[1] == 0.0  # leg 2 ends without contact
    assert elements[2] >= 1.0
    assert np.all(result.field_at_mean_pressure < 1e-3)


@pytest.mark.parametrize("hardness", ["", "material: {hardness: 0.3}\n"])
@pytest.mark.parametrize("to", [0.1, 4.0])
@pytest.mark.parametrize(
    "level", ["{separation: 0.5}", "{indentation: 1.5}", "{pressure: 0.5}", f"{{contact_area: {50 / 289}}}"]
)
def test_a_level_at_the_end_of_a_leg_is_of_the_next_leg_too(level, hardness, to):
    path = f"[{{steps: 3, to: {level}}}, {{steps: 2, to: {{pressure: {to}}}}}]"
    text = f"surface: {{D: 2.3, m: 4, seeds: [1]}}\n{hardness}sweep: {path}\n"
    result = answer(text + f"record: {{fields_at: {level}, all_legs: true}}").squeeze()
    assert result.field_at_step.values.tolist() == [3, 4]
    for name in ("mean_pressure", "separation", "contact_area_fraction"):
        end, begin = result[f"field_at_{name}"].values
        assert end == float(result[name][2])
        assert begin == pytest.approx(end, rel=1e-5)


@pytest.mark.parametrize("sides", ["free", "mirrored", "periodic"])
def test_a_level_at_a_step_of_an_unloading_leg_is_the_state_of_the_step(sides):
    path = "[{steps: 3, to: {contact_area: 0.2}}, {steps: 3, to: {contact_area: 0.05}}]"
    text = f"surface: {{D: 2.3, m: 4, seeds: [1], sides: {sides}}}\nsweep: {path}\n"
    steps = answer(text).squeeze()
    kinds = ("mean_pressure", "contact_area_fraction", "free_volume")
    levels = {name: [float(steps[name][k]) for k in (4, 5)] for name in kinds}
    levels["mean_pressure"][1] *= 1.0 - 5e-6  # the end of the leg misses it by less than answers see
    of = dict(zip(kinds, ("pressure", "contact_area", "free_volume"), strict=True))
    fields = ", ".join(f"{of[name]}: {values!r}" for name, values in levels.items())
    result = answer(text + f"record: {{fields_at: {{{fields}}}, all_legs: true}}").squeeze()
    for name, values in levels.items():
        on_leg = [label for label in result.field_at.values if label.startswith(of[name]) and label.endswith("leg 2")]
        assert_allclose(result[f"field_at_{name}"].sel(field_at=on_leg), values, rtol=1e-5)


@pytest.mark.parametrize("sides", ["free", "mirrored"])
def test_a_level_beyond_the_loss_of_contact_is_met_without_contact(sides):
    path = "[{steps: 2, to: {free_volume: 0.5}}, {steps: 1, to: {free_volume: 1.6}}]"
    text = f"surface: {{D: 2.3, m: 4, seeds: [1], sides: {sides}}}\nmaterial: {{hardness: 0.01}}\nsweep: {path}\n"
    levels = "{free_volume: 1.5, separation: 1.2, contact_area: 0.02}"
    result = answer(text + f"record: {{fields_at: {levels}, all_legs: true}}")
    volume, separation, area = (
        state(result, f"{label}, leg 2") for label in ("free_volume=1.5", "separation=1.2", "contact_area=0.02")
    )
    assert volume["free_volume"] == pytest.approx(1.5, rel=1e-6)
    assert separation["separation"] == pytest.approx(1.2, rel=1e-6)
    assert volume["mean_pressure"] == separation["mean_pressure"] == 0.0
    assert area["contact_area_fraction"] == pytest.approx(0.02, abs=2 / 289)
    assert area["mean_pressure"] > 0.0


@pytest.mark.parametrize("sides", ["free", "mirrored"])
def test_a_level_before_contact_comes_back_is_met_without_contact(sides):
    path = "[{steps: 2, to: {free_volume: 0.5}}, {steps: 1, to: {separation: 9}}, {steps: 2, to: {free_volume: 0.8}}]"
    text = f"surface: {{D: 2.3, m: 4, seeds: [1], sides: {sides}}}\nsweep: {path}\n"
    result = answer(text + "record: {fields_at: {free_volume: [5, 1], contact_area: 0.05}, all_legs: true}")
    apart, pressed = (state(result, f"free_volume={volume}, leg 3") for volume in (5, 1))
    assert apart["free_volume"] == pytest.approx(5.0, rel=1e-6)
    assert apart["mean_pressure"] == 0.0
    assert pressed["free_volume"] == pytest.approx(1.0, rel=1e-5)
    assert state(result, "contact_area=0.05, leg 3")["contact_area_fraction"] == pytest.approx(0.05, abs=2 / 289)


def test_the_error_of_the_pressure_asked_for_holds_at_levels():
    asked = 1e-3
    at = "fields_at: {pressure: [0.5, 2], contact_area: 0.3, separation: -1}"
    accurate = f"{{max_error: {{mean_pressure: {asked}}}}}"
    result, case = pressed(at, m=5, to="{contact_area: 0.5}", solver=accurate)
    surface = surface_of(case)
    assert float(result.iterations.max()) > 1.0  # a factorisation would leave no residual
    for label in result.field_at.values:
        found = state(result, label)
        exact = solve(surface, HalfSpace(surface.shape), found["indentation"], rtol=1e-10)
        assert found["mean_pressure"] == pytest.approx(exact.mean_pressure, rel=asked)


def test_quantities_along_the_steps_stay_at_the_first_step_beyond():
    at = "{pressure: 0.5}"
    result, _ = pressed(f"fields_at: {at}, transport: {{constriction: {at}, flux_at: {at}, transmissivity: {at}}}")
    step = int(result.field_at_step[0])
    assert np.flatnonzero(result.critical_gap.sel(axis="x").notnull()) == [step - 1]
    assert float(result.mean_pressure[step - 1]) > 0.5
    # the flow through the state at the level is one through more gap
    assert float(result.flux_at_transmissivity.sel(axis="x")[0]) > float(result.transmissivity.sel(axis="x")[step - 1])


@pytest.mark.parametrize(
    ("kind", "region", "sides"),
    [
        ("free_volume", "", ""),
        ("free_volume", "region: interior, ", ", sides: periodic"),
        ("separation", "region: interior, ", ""),
        ("separation", "", ", sides: periodic"),
        ("separation", "", ", sides: mirrored"),
    ],
)
def test_levels_before_the_first_touch_are_missing(kind, region, sides):
    record = f"{region}fields_at: {{{kind}: [600, 1.5]}}"
    text = STUDY.format(m=4, steps=3, to="{indentation: 2}", solver="{}", record=record)
    result = answer(text.replace("seeds: [3]", f"seeds: [3]{sides}"))
    missed, found = state(result, f"{kind}=600"), state(result, f"{kind}=1.5")
    assert missed.pop("step") == -1
    assert np.isnan(list(missed.values())).all()
    assert found[kind] == pytest.approx(1.5, rel=5e-6)
