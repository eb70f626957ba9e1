"""Paths of legs and plastic contact as cases of a study: what is stored, resumed and refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose, assert_array_equal

import roughvol
from roughvol.campaign.one_case import Context, Stopped, run_case, surface_of
from roughvol.cli import main
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import sweep
from roughvol.errors import ContactError, StudyError
from roughvol.store import checkpoint, dataset
from roughvol.study import loads

SURFACE = "surface: {D: 2.3, m: 5, seeds: [4], L: 100.0}\n"
PATH = "sweep: [{steps: 6, to: {pressure: 1.5}}, {steps: 4, to: {pressure: 0.4}}, {steps: 5, to: {indentation: 2.5}}]\n"
HARD = "material: {E_star: 1.0, hardness: 0.05}\n"


def _pressed(text: str) -> dataset.Dataset:
    return run_case(loads(SURFACE + text).cases()[0]).squeeze(("D", "m", "seed"))


@pytest.mark.parametrize("material", ["", HARD])
def test_legs_are_steps_equal_in_indentation_from_end_to_end(material: str) -> None:
    ds = _pressed(PATH + material)
    assert ds.leg.dims == ("step",)
    assert_array_equal(ds.leg, [1] * 6 + [2] * 4 + [3] * 5)
    ends = ds.indentation.values[[5, 9, 14]]
    assert_allclose(ds.mean_pressure[[5, 9]], [1.5, 0.4], rtol=1e-5)
    assert ends[2] == 2.5
    begins = [0.0, *ends[:-1]]
    legs = [np.linspace(*leg)[1:] for leg in zip(begins, ends, (7, 5, 6), strict=True)]
    assert_allclose(ds.indentation, np.concatenate(legs), rtol=1e-12)
    surface = surface_of(loads(SURFACE).cases()[0])
    hardness = 0.05 * surface.side / surface.Sq if material else None
    contacts = list(sweep(surface, HalfSpace(surface.shape), ds.indentation.values, hardness=hardness))
    assert_allclose(ds.free_volume, [contact.free_volume for contact in contacts], rtol=1e-12)


def test_legs_of_any_kernel_end_at_their_pressures(tmp_path: Path) -> None:
    generator = np.random.default_rng(140)  # overlaps fall on the way down here
    shape = tuple(generator.integers(5, 12, 2))
    heights = generator.normal(size=shape)
    np.save(tmp_path / "noise.npy", heights)
    hardness = float(np.exp(generator.uniform(-0.7, 2.0)))
    pressures = hardness * np.array([0.9, 0.8, 0.6, 0.9, 0.5, 0.95])
    legs = ", ".join(f"{{steps: 5, to: {{pressure: {pressure}}}}}" for pressure in pressures)
    text = f"surface: {{file: {tmp_path / 'noise.npy'}, L: 1.0}}\nsweep: [{legs}]\n"
    text += (
        f"material: {{E_star: 1.0, hardness: {hardness * heights.std()}}}\nsolver: {{kernel: punch, rtol: 1.0e-8}}\n"
    )
    assert_allclose(run_case(loads(text).cases()[0]).mean_pressure.values.ravel()[4::5], pressures, rtol=5e-6)


def test_elastic_contact_retraces_and_metal_does_not() -> None:
    there_and_back = "sweep: [{steps: 5, to: {indentation: 2}}, {steps: 4, to: {indentation: 0.4}}]\n"
    for material, equal in (("", True), (HARD, False)):
        ds = _pressed(there_and_back + material)
        up, down = ds.mean_pressure.values[:4][::-1], ds.mean_pressure.values[5:]
        assert np.allclose(up, down, rtol=1e-5) == equal


def test_a_sweep_without_a_list_stores_no_leg() -> None:
    assert "leg" not in _pressed("sweep: {steps: 2, to: {indentation: 1}}\n")
    assert "leg" in _pressed("sweep: [{steps: 2, to: {indentation: 1}}]\n")


def test_one_leg_in_a_list_is_the_sweep() -> None:
    one, other = (_pressed(f"sweep: {text}\n") for text in ("{steps: 3}", "[{steps: 3}]"))
    assert_array_equal(one.mean_pressure, other.mean_pressure)


def test_unloading_leaves_no_pressure_and_a_surface_below_the_virgin_one() -> None:
    record = "record: {residual_heights: true, heights: true, texture: true}\n"
    ds = _pressed("sweep: [{steps: 5, to: {pressure: 1}}, {steps: 3, to: {pressure: 0}}]\n" + HARD + record)
    assert ds.mean_pressure[-1] == ds.contact_area_fraction[-1] == 0.0
    depth = (ds.heights - ds.residual_heights).values
    assert depth.min() == 0.0
    assert_allclose(depth.mean() / ds.Sq, ds.plastic_volume[-1], rtol=1e-12)
    assert_allclose((depth > 0).mean(), ds.plastic_area_fraction[-1], rtol=1e-12)
    # the residual surface is at its highest point at Δ
    assert_allclose(ds.indentation[-1], (ds.heights.max() - ds.residual_heights.max()) / ds.Sq, rtol=1e-12)
    assert ds.Sp_residual < ds.Sp
    assert_allclose(ds.plastic_volume[4:], ds.plastic_volume[4], atol=1e-6)


@pytest.mark.parametrize("material", ["", HARD])
def test_levels_and_the_void_are_recorded_on_a_path(material: str) -> None:
    record = "record: {fields_at: {pressure: [0.7, 1.5]}, transport: {transmissivity: every-step}}\n"
    ds = _pressed(PATH + material + record)
    assert_allclose(ds.field_at_mean_pressure, [0.7, 1.5], rtol=1e-5)
    assert_allclose(ds.pressure.mean(("x", "y")), ds.field_at_mean_pressure, rtol=1e-9)
    assert ds.transmissivity.sel(axis="x").notnull().all()


def test_a_path_goes_on_from_its_checkpoint_with_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoint, "NODES", 1)
    monkeypatch.setattr(checkpoint, "EVERY", 0.0)
    case = loads(SURFACE + PATH + HARD + "record: {residual_heights: true}\n").cases()[0]
    whole = run_case(case)
    for stop in (3, 6, 8, 10, 12):
        steps: list[int] = []
        file = tmp_path / f"{stop}.npz"
        with pytest.raises(Stopped):
            run_case(case, Context(checkpoint=file, on_step=steps.append, stopping=lambda: len(steps) >= stop))  # noqa: B023
        rest: list[int] = []
        again = run_case(case, Context(checkpoint=file, on_step=rest.append))
        assert rest[0] == stop + 1
        assert dataset.answers(again).identical(dataset.answers(whole))
        assert_array_equal(again.free_volume, whole.free_volume)
        assert_array_equal(again.residual_heights, whole.residual_heights)


def test_a_hardness_counts_over_the_scaled_heights() -> None:
    text = "surface: {{D: 2.3, m: 4, seeds: [1], L: {}, Sq: {}}}\nmaterial: {{E: 70 GPa, nu: 0.3, hardness: 1 GPa}}\n"
    text += "sweep: {{steps: 3, to: {{indentation: 2}}}}\n"
    sizes = [("100 um", "1 um"), ("0.1 mm", "1 um")]
    micro, milli = (run_case(loads(text.format(*size)).cases()[0]) for size in sizes)
    assert_allclose(micro.plastic_volume, milli.plastic_volume, rtol=1e-12)
    flat = run_case(loads(text.format("100 um", "1 nm")).cases()[0])
    assert (flat.plastic_volume == 0.0).all()


def test_a_pressure_above_the_hardness_is_an_error_that_names_it() -> None:
    with pytest.raises(ContactError, match=r"p\* = 50 is not reached: pressures end at the hardness, p\* = \d"):
        _pressed("sweep: {steps: 2, to: {pressure: 50}}\n" + HARD)


def test_yield_is_that_of_the_region() -> None:
    record = "record: {residual_heights: true, heights: true, region: {x: [0.25, 0.75], y: [0, 1]}}\n"
    ds = _pressed("sweep: {steps: 3, to: {pressure: 1}}\n" + HARD + record)
    depth = (ds.heights - ds.residual_heights).sel(x=slice(0.25, 0.75)).values
    assert_allclose(depth.mean() / ds.Sq, ds.plastic_volume[-1], rtol=1e-10)
    assert_allclose((depth > 0).mean(), ds.plastic_area_fraction[-1], rtol=1e-12)
    whole = (ds.heights - ds.residual_heights).values
    assert whole.mean() != pytest.approx(depth.mean(), rel=1e-3)


def test_a_leg_without_length_is_an_error() -> None:
    surface = surface_of(loads(SURFACE).cases()[0])
    height = surface.peak - 1.0  # d/σ at Δ/σ = 1
    with pytest.raises(ContactError, match="leg 2 has no length"):
        _pressed(f"sweep: [{{steps: 2, to: {{indentation: 1}}}}, {{steps: 2, to: {{separation: {height!r}}}}}]\n")


@pytest.mark.parametrize(
    ("text", "key", "words"),
    [
        ("sweep: []\n", "sweep", "at least 1"),
        ("sweep: [{steps: 0}]\n", "sweep[0].steps", ">= 1"),
        ("sweep: [{to: {pressure: 0}}]\n", "sweep[0].to.pressure", "first leg"),
        ("sweep: [{}, {stepps: 3, to: {pressure: 0}}]\n", "sweep[1].stepps", "did you mean 'steps'"),
        ("sweep: [{to: {pressure: 1}}, {to: {pressure: 1}}]\n", "sweep[1].to", "no length"),
        ("sweep: [{}, {to: {pressure: -1}}]\n", "sweep[1].to.pressure", ">= 0"),
        ("sweep: [{}]\nensemble: {accuracy: {free_volume: 1 %}}\n", "sweep", "ensemble"),
        ("record: {residual_heights: true}\n", "record.residual_heights", "material.hardness"),
        ("material: {hardness: 0.1}\nsolver: paper\n", "solver", "paper"),
        ("material: {hardness: 0.1, plastic: maybe}\n", "material.plastic", "true or false"),
    ],
)
def test_what_makes_no_path_is_refused_with_its_place(text: str, key: str, words: str) -> None:
    with pytest.raises(StudyError) as caught:
        loads(SURFACE + text)
    (problem,) = [problem for problem in caught.value.problems if problem.key == key]
    assert words in problem.message
    assert problem.line == next(
        k for k, line in enumerate((SURFACE + text).splitlines(), 1) if line.startswith(key[:5])
    )


def test_a_path_runs_plots_and_is_reported_from_the_command_line(tmp_path: Path) -> None:
    record = "record: {heights: true, residual_heights: true, transport: {transmissivity: every-step}}\n"
    text = (
        "surface: {D: 2.3, m: 4, seeds: 2, L: 100 um, Sq: 0.5 um}\nmaterial: {E: 70 GPa, nu: 0.33, hardness: 1 GPa}\n"
    )
    text += "sweep: [{steps: 4, to: {pressure: 1}}, {steps: 3, to: {pressure: 0}}]\n" + record
    (tmp_path / "metal.yaml").write_text(text)
    (tmp_path / "elastic.yaml").write_text(
        text.replace("1 GPa}", "1 GPa, plastic: false}").replace("residual_heights: true, ", "")
    )
    for name in ("metal", "elastic"):
        run = CliRunner().invoke(
            main, ["run", str(tmp_path / f"{name}.yaml"), "--out", str(tmp_path / name), "--jobs", "1"]
        )
        assert run.exit_code == 0, run.output
    drawn = CliRunner().invoke(main, ["plot", str(tmp_path / "metal")])
    assert drawn.exit_code == 0, drawn.output
    assert {"path_loops.png", "yielded_map.png"} <= {path.name for path in (tmp_path / "metal" / "figures").iterdir()}
    out = tmp_path / "report"
    made = CliRunner().invoke(main, ["report", str(tmp_path / "metal"), str(tmp_path / "elastic"), "--out", str(out)])
    assert made.exit_code == 0, made.output
    page = (out / "report.md").read_text()
    assert "With yield (metal) and without (elastic)" in page
    assert "On every leg of the path" in page
    assert "pressures end there" in page


@pytest.mark.parametrize("hardness", ["", ", hardness: 2"])
def test_levels_on_all_legs_are_states_of_each(hardness: str, tmp_path: Path) -> None:
    text = (
        f"surface: {{D: 2.3, m: 4, seeds: [4], Sq: 1}}\nmaterial: {{E_star: 100{hardness}}}\n"
        "sweep: [{steps: 3, to: {pressure: 2}}, {steps: 2, to: {pressure: 0.1}}, {steps: 3, to: {pressure: 1}}]\n"
        "record: {fields_at: {pressure: [0.5, 1]}, transport: {percolation: {pressure: 0.5}}, all_legs: true}\n"
    )
    study = loads(text, "legs.yaml")
    ds = roughvol.run(study, out=tmp_path / "all", jobs=1).squeeze(("D", "m", "seed"))
    labels = [f"pressure={p}{leg}" for leg in ("", ", leg 2", ", leg 3") for p in ("0.5", "1")]
    assert ds.field_at.values.tolist() == labels
    np.testing.assert_allclose(ds.field_at_mean_pressure, [0.5, 1.0] * 3, rtol=1e-5)
    legs = [int(ds.leg.sel(step=step)) for step in ds.field_at_step.values.tolist()]
    assert legs == [1, 1, 2, 2, 3, 3]
    assert ds.leg.values[ds.percolates.sel(axis="x").notnull().values].tolist() == [1, 2, 3]
    first = loads(text.replace(", all_legs: true", ""), "legs.yaml")
    assert first.cases()[0].id != study.cases()[0].id
    old = roughvol.run(first, out=tmp_path / "first", jobs=1).squeeze(("D", "m", "seed"))
    assert old.field_at.values.tolist() == labels[:2]
    assert (old.gap.values == ds.gap.isel(field_at=slice(2)).values).all()
    loading, unloading = ds.gap.sel(field_at="pressure=0.5"), ds.gap.sel(field_at="pressure=0.5, leg 2")
    difference = float(np.abs(loading - unloading).max())
    assert difference > 0.01 if hardness else difference < 1e-4  # metal remembers, rubber does not


@pytest.mark.parametrize(("record", "drawn"), [("0.5], all_legs: true", True), ("1], all_legs: false", False)])
def test_states_of_later_legs_hinder_no_figure(record: str, drawn: bool, tmp_path: Path) -> None:
    record = record.replace("], ", "]}, ")
    text = (
        "surface: {D: 2.3, m: 4, seeds: [4, 5], Sq: 1}\nmaterial: {E_star: 100}\n"
        "sweep: [{steps: 3, to: {pressure: 0.7}}, {steps: 2, to: {pressure: 0.1}}, {steps: 3, to: {pressure: 2}}]\n"
        f"record: {{fields_at: {{pressure: [{record}}}\n"
    )
    out = tmp_path / "legs"
    roughvol.run(loads(text, "legs.yaml"), out=out, jobs=1)
    for command in ("plot", "report"):
        done = CliRunner().invoke(main, [command, str(out)])
        assert done.exit_code == 0, done.output
    assert (out / "figures" / "paper" / "fig09.png").is_file() is drawn
    named = CliRunner().invoke(main, ["plot", str(out), "fig09"])
    assert (named.exit_code == 0) is drawn
    assert drawn or "no case of the dataset has a value of each on the first leg" in named.stderr
