"""Periodic surfaces from the study to stored numbers."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import roughvol
from roughvol.campaign import cost, tradeoff
from roughvol.campaign.one_case import run_case, surface_of
from roughvol.campaign.running import run
from roughvol.errors import ContactError
from roughvol.study import loads
from roughvol.surfaces.texture import summit_plane

SURFACE = "surface: {D: 2.4, m: 5, L: 3.0, seeds: [2], periodic: true}\n"


def solved(text: str) -> Any:
    study = loads(SURFACE + text)
    return run_case(study.cases()[0]).squeeze(), surface_of(study.cases()[0])


@pytest.mark.parametrize("seed", range(2))
def test_a_crop_of_137_elements_is_pressed_to_its_pressures(seed: int) -> None:
    """0.11.1 ended without convergence: a second tier of blocks with three blocks around the period."""
    noise = np.random.Generator(np.random.PCG64(seed)).standard_normal((256, 256))
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(256), np.fft.fftfreq(256), indexing="ij"))
    heights = np.fft.ifft2(np.fft.fft2(noise) * np.maximum(frequency, 4 / 256) ** -1.8).real[:137, :137]
    pressures = ["0.006 MPa", "0.02 MPa", "0.04 MPa"]
    states = roughvol.press(
        1e-3 * heights / heights.std(),
        L="1 mm",
        E="10 MPa",
        nu=0.49,
        surface={"periodic": True, "heights_unit": "mm"},
        sweep={"pressures": pressures},
        jobs=1,
    )
    assert states.nominal_pressure.values == pytest.approx([float(p.split()[0]) for p in pressures], rel=5e-6)
    assert states.converged.all()


@pytest.mark.parametrize(
    ("to", "name", "value"),
    [
        ("{pressure: 2.0}", "mean_pressure", 2.0),
        ("{contact_area: 0.3}", "contact_area_fraction", 0.3),
        ("{free_volume: 0.4}", "free_volume", 0.4),
        ("{separation: 0.7}", "separation", 0.7),
        ("{indentation: 1.2}", "indentation", 1.2),
        ("mean-plane", "contact_area_fraction", 1.0),
        ("mean-plane", "separation", 0.0),
    ],
)
def test_a_sweep_ends_where_it_was_asked_to(to: str, name: str, value: float) -> None:
    data, _ = solved(f"sweep: {{steps: 3, to: {to}}}")
    assert float(data[name][-1]) == pytest.approx(value, abs=2e-3 if name == "contact_area_fraction" else 2e-5)


def test_stored_indentation_and_separation_are_those_of_the_mean_planes() -> None:
    data, surface = solved("sweep: {steps: 5, to: {contact_area: 0.6}}\nsolver: {kernel: fourier}")
    assert data["free_volume"].values == pytest.approx(data["separation"].values, abs=0.0)
    assert (data["indentation"] + data["separation"]).values == pytest.approx(surface.peak, rel=1e-12)
    # steps are equal in the approach
    approach = (data["indentation"] + data["mean_pressure"]).values
    assert np.diff(approach, 2) == pytest.approx(0.0, abs=1e-4 * approach[-1])
    assert "periodic elastic half space" in data.attrs["conventions"]
    assert "L/rows" in data.attrs["conventions"]


def test_levels_between_steps_are_solved_for() -> None:
    levels = "{separation: [1.0], indentation: [0.8], free_volume: [0.6], pressure: [0.5], contact_area: [0.2]}"
    data, _ = solved(f"sweep: {{steps: 4, to: {{contact_area: 0.5}}}}\nrecord: {{fields_at: {levels}}}")
    at = data.set_index(field_at="field_at") if "field_at" not in data.indexes else data
    for label, name, value in (
        ("separation=1", "separation", 1.0),
        ("indentation=0.8", "indentation", 0.8),
        ("free_volume=0.6", "free_volume", 0.6),
        ("pressure=0.5", "mean_pressure", 0.5),
    ):
        state = at.sel(field_at=label)
        assert float(state[f"field_at_{name}"]) == pytest.approx(value, abs=2e-5)
        assert float(state["gap"].mean()) == pytest.approx(float(state["field_at_free_volume"]), abs=1e-5)
    assert data["x"].values == pytest.approx(np.arange(32) / 32)


@pytest.mark.parametrize(
    ("to", "name", "value"),
    [
        ("mean-plane", "separation", 0.0),
        ("{separation: 0.0}", "separation", 0.0),
        ("{separation: -0.2}", "separation", -0.2),
        ("{indentation: 1.2}", "indentation", 1.2),
    ],
)
@pytest.mark.parametrize("path", ["sweep: {%s}", "sweep: [{steps: 1, to: {pressure: 0.2}}, {%s}]"])
def test_a_plane_is_that_of_the_separation_where_the_surface_yields(
    to: str, name: str, value: float, path: str
) -> None:
    data, _ = solved(f"material: {{E_star: 1, hardness: 0.4}}\n{path % f'steps: 2, to: {to}'}")
    assert float(data[name][-1]) == pytest.approx(value, abs=2e-5)
    assert float(data["contact_area_fraction"][-1]) < 1.0


def test_a_plane_under_a_hardness_that_nothing_reaches_is_that_of_elastic_contact() -> None:
    ends = [
        solved(f"material: {{E_star: 1, {given}}}\nsweep: {{steps: 1}}")[0]
        for given in ("hardness: null", "hardness: 1e5")
    ]
    elastic, hard = (float(np.ravel(data["mean_pressure"])[-1]) for data in ends)
    assert hard == pytest.approx(elastic, rel=1e-4)


@pytest.mark.parametrize("periodic", ["true", "false"])
@pytest.mark.parametrize("to", ["{percolation: x}", "percolation", "{contact_area: 1.0}", "{contact_area: 0.5}"])
def test_an_end_by_elements_is_the_first_on_every_path(periodic: str, to: str) -> None:
    surface = f"surface: {{D: 2.3, m: 4, seeds: [1], periodic: {periodic}}}\n"
    ends = []
    for text in (
        f"sweep: {{steps: 2, to: {to}}}",
        f"material: {{E_star: 1, hardness: 1e5}}\nsweep: {{steps: 2, to: {to}}}",
        "sweep: [{steps: 1, to: {contact_area: 0.3}}, {steps: 1, to: {contact_area: 0.05}}, "
        + f"{{steps: 2, to: {to}}}]",
    ):
        ends.append(run_case(loads(surface + text).cases()[0]).squeeze())
    for data in ends[1:]:
        assert float(data["mean_pressure"][-1]) == pytest.approx(float(ends[0]["mean_pressure"][-1]), rel=3e-4)
        assert float(data["contact_area_fraction"][-1]) == float(ends[0]["contact_area_fraction"][-1])


@pytest.mark.parametrize("periodic", ["true", "false"])
@pytest.mark.parametrize("hardness", ["null", "0.4"])
@pytest.mark.parametrize(
    ("to", "name", "value"),
    [
        ("{separation: 3}", "separation", 3.0),
        ("{indentation: 0}", "indentation", 0.0),
        ("{free_volume: 5}", "free_volume", 5.0),
    ],
)
def test_a_leg_may_lose_contact_and_the_next_one_find_it(
    periodic: str, hardness: str, to: str, name: str, value: float
) -> None:
    up = "{steps: 2, to: {pressure: 0.2}}"
    study = loads(
        f"surface: {{D: 2.3, m: 4, L: 1, seeds: [1], periodic: {periodic}}}\n"
        f"material: {{E_star: 1, hardness: {hardness}}}\nsweep: [{up}, {{steps: 2, to: {to}}}, {up}]"
    )
    data = run_case(study.cases()[0]).squeeze()
    assert float(data[name][3]) == pytest.approx(value, abs=1e-6)
    assert float(data["mean_pressure"][3]) == 0.0
    assert float(data["mean_pressure"][-1]) == pytest.approx(0.2, rel=1e-4)
    assert float(data["separation"][-1]) == pytest.approx(float(data["separation"][1]), abs=2e-5)


def test_paths_up_and_down_with_a_hardness() -> None:
    legs = "[{steps: 3, to: {separation: 0.6}}, {steps: 2, to: {separation: 1.0}}, {steps: 2, to: {pressure: 3}}]"
    data, _ = solved(f"material: {{E_star: 1, hardness: 2.0}}\nsweep: {legs}")
    assert data["separation"].values[[2, 4]] == pytest.approx([0.6, 1.0], abs=1e-4)
    assert float(data["mean_pressure"][-1]) == pytest.approx(3.0, abs=1e-3)
    difference = data["free_volume"] - data["separation"] - data["plastic_volume"]
    assert difference.values == pytest.approx(0.0, abs=1e-9)
    assert float(data["plastic_volume"][-1]) > 0.0


def test_full_contact_is_the_deepest_end() -> None:
    with pytest.raises(ContactError, match="allowed on a periodic surface: up to"):
        solved("sweep: {steps: 3, to: {indentation: 50}}")
    data, surface = solved("sweep: {steps: 2, to: summit-plane}")
    expected = (surface.z_max - summit_plane(surface.with_neighbours)) / surface.Sq
    assert float(data["indentation"][-1]) == pytest.approx(expected, abs=1e-4)


def test_the_void_stops_percolating_with_joined_sides_and_the_cell_agrees() -> None:
    quantities = ", ".join(f"{name}: every-step" for name in ("percolation", "transmissivity", "cell_transmissivity"))
    data, _ = solved(f"sweep: {{steps: 4, to: percolation}}\nrecord: {{transport: {{{quantities}}}}}")
    last = data.isel(step=-1)
    assert not last["percolates"].any()
    assert float(last["transmissivity"].sel(axis="x")) == float(last["cell_transmissivity"].sel(axis="x")) == 0.0
    assert (data["cell_transmissivity"].sel(axis="x").values[:2] > 0.0).all()
    assert 0.2 < float(last["contact_area_fraction"]) < 0.7


def test_regions_of_a_period() -> None:
    data, _ = solved(
        "sweep: {steps: 2, to: {contact_area: 0.4}}\nrecord: {region_widths: {shares: [1, 0.5]}, "
        "region: {x: [0, 0.5], y: [0, 1]}}"
    )
    assert float(data["contact_area_fraction"][-1]) == pytest.approx(0.4, abs=5e-3)
    whole = data["mean_pressure_within"].sel(region_width=1.0)
    assert math.isfinite(float(whole[-1]))


def test_a_height_file_is_one_period(tmp_path: Path) -> None:
    x = np.arange(32) / 32
    np.save(tmp_path / "wave.npy", np.cos(2 * np.pi * x)[:, None] + np.zeros(16))
    text = "surface: {file: wave.npy, L: 2.0, periodic: true}\nsweep: {steps: 3, to: {contact_area: 1}}"
    data = run_case(loads(text, tmp_path / "s.yaml").cases()[0]).squeeze()
    # full contact of a wave: mean p = π E* h/λ, over E* σ/L with σ = h/√2
    assert float(data["mean_pressure"][-1]) == pytest.approx(math.pi * math.sqrt(2.0), rel=0.02)


def test_check_knows_the_cost_and_tradeoff_refuses() -> None:
    study = loads(SURFACE + "sweep: {steps: 2}")
    assert cost.estimate(study, 1).seconds > 0.0
    with pytest.raises(ContactError, match="the surface is periodic"):
        tradeoff.surfaces_of(study)


def test_an_ensemble_of_periodic_surfaces(tmp_path: Path) -> None:
    text = (
        "surface: {D: 2.3, m: 5, periodic: true}\nsweep: {steps: 5, to: {pressure: 0.4}}\n"
        "ensemble: {accuracy: {free_volume: 20 %}, at: {pressure: [0.2]}}"
    )
    data: xr.Dataset = run(loads(text), out=tmp_path / "run", jobs=1)
    assert np.isfinite(data["free_volume_mean"].values).all()
