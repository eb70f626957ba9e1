"""Speed against accuracy: the bounds bound, a reference has no error, and what is read off the ladders."""

from pathlib import Path

import numpy as np
import pytest

from roughvol.campaign import tradeoff
from roughvol.errors import StudyError
from roughvol.report import convergence
from roughvol.report.figures.registry import TRADEOFF
from roughvol.store import dataset, tradeoff_variables
from roughvol.study import ACCURACY, EXPECTED, loads
from tests.campaign.kit import noise, solved
from tests.drawn import shown
from tests.kit import said


@pytest.fixture(scope="module")
def measured() -> dataset.Dataset:
    return tradeoff.measure(loads("name: trade\nsurface: {D: [2.2, 2.6], m: 5, seeds: 1}\nsweep: {steps: 12}"))


def of(ds: dataset.Dataset, **choice: object) -> dataset.Dataset:
    kept = np.all([ds[name].values == value for name, value in choice.items()], axis=0)
    return ds.isel(rung=np.flatnonzero(kept))


def test_every_variable_is_there_and_described(measured: dataset.Dataset) -> None:
    assert set(tradeoff_variables.TABLE) <= set(measured.variables)
    assert all({"units", "long_name", "symbol"} <= set(measured[name].attrs) for name in measured.variables)
    assert all(np.isfinite(measured[name]).all() for name in measured.data_vars if name.endswith("_error"))


def test_errors_stay_below_their_certified_bounds(measured: dataset.Dataset) -> None:
    ladder, rounding = of(measured, ladder="tolerance"), 1e-11
    assert (ladder.residual <= ladder.rtol).all()
    assert (ladder.free_volume_error <= ladder.residual + rounding).all()
    bound = ladder.mean_pressure_bound
    assert (ladder.mean_pressure_error <= bound * (1 + bound) + rounding).all()


def test_each_ladder_changes_one_thing(measured: dataset.Dataset) -> None:
    assert not of(measured, precision="double").convolutions_fp32_per_step.any()
    steps, method = of(measured, ladder="steps"), of(measured, ladder="method")
    assert (set(steps.steps.values), set(method.method.values)) == ({12, 4, 1}, {"fast", "paper"})
    assert float(steps.free_volume_error.max()) <= 1e-9
    assert not steps.contact_area_fraction_error.any()
    assert float(method.free_volume_error.max()) <= 1e-6
    family = of(measured, ladder="resolution")
    assert family.m.values.tolist() == [2, 3, 4, 5]
    for name in ("contact_area_fraction_error", "mean_pressure_error", "free_volume_error"):
        assert float(family[name].values[-2].min()) > 1e3 * float(of(measured, rtol=1e-6)[name].values[0].max())
        assert float(family[name].values[-1].max()) < 1e-8
    kernel = of(measured, ladder="kernel")
    love, punch = (float(of(kernel, kernel=name).contact_area_fraction_error.max()) for name in ("love", "punch"))
    assert (love, punch > 0.0) == (0.0, True)


def test_convergence_in_m_is_that_of_a_geometric_series(measured: dataset.Dataset) -> None:
    found = convergence.convergence(measured)
    assert len(found) == 6
    assert not any(one.converged for one in found if one.quantity == "contact_area_fraction")
    ds = measured.copy(deep=True)
    rows = np.flatnonzero(ds.ladder.values == "resolution")
    ds.free_volume.values[rows] = (1.0 + 0.5 ** np.arange(1, 5))[:, None]  # the limit is 1
    one = next(found for found in convergence.convergence(ds) if found.quantity == "free_volume")
    last = 1.0 + 0.5**4
    assert (one.ratio, one.remaining) == (pytest.approx(0.5), pytest.approx((last - 1.0) / last))
    ds.seconds.values[:] = (ds.rtol.values ** -np.log10(1.25))[:, None]  # a quarter more for each digit
    assert convergence.time_saved(ds) == pytest.approx(0.2)
    assert "costs 20 per cent less time" in convergence.summary(ds)
    ds.seconds.values[:] **= -1.0
    assert "costs 25 per cent more time" in convergence.summary(ds)


@pytest.mark.parametrize("name", TRADEOFF)
def test_figures_are_drawn(name: str, measured: dataset.Dataset) -> None:
    assert shown(TRADEOFF[name](measured)) > 0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("surface: {D: 2.3, m: 4}\nsweep: {steps: 0}", "the study has no sweep"),
        ("surface: {D: 2.3, m: 4}\nsweep: [{steps: 2}, {steps: 1, to: {pressure: 0.1}}]", "one elastic sweep"),
        ("surface: {D: 2.3, m: 4}\nsweep: {to: {pressure: [0.1, 0.2]}}", "one combination of lists"),
        ("surface: {D: 2.3, m: 4, sides: periodic}", "surface.sides: given periodic; allowed: free"),
    ],
)
def test_a_study_without_ladders_is_refused(text: str, words: str) -> None:
    with pytest.raises(StudyError, match=words):
        tradeoff.measure(loads(text))


def test_a_height_file_has_the_ladders_of_one_grid(tmp_path: Path) -> None:
    np.save(tmp_path / "map.npy", noise(1, 14, 11))
    ds = tradeoff.measure(
        loads(f"surface: {{file: {tmp_path / 'map.npy'}, L: 1.0, sides: free}}\nsweep: {{steps: 10}}")
    )
    assert set(ds.ladder.values) == {"tolerance", "steps", "kernel"}
    assert convergence.convergence(ds) == []


def test_command_writes_a_dataset_and_figures(tmp_path: Path) -> None:
    (tmp_path / "small.yaml").write_text("surface: {D: 2.4, m: 4, seeds: 1}\nsweep: {steps: 4}\n")
    text = said("tradeoff", tmp_path / "small.yaml", "--out", tmp_path / "run")
    assert "ten times less accuracy costs" in text
    assert "A* NOT converged in m" in text
    assert "ladder" in dataset.read(tmp_path / "run" / "tradeoff.nc").coords
    assert len(list((tmp_path / "run" / "figures").glob("*.png"))) == len(TRADEOFF)


# Named accuracies and requested errors


def test_named_accuracies_are_of_the_order_they_state(measured: dataset.Dataset) -> None:
    for name, rtol in ACCURACY.items():
        rungs = measured.isel(rung=np.flatnonzero(np.isclose(measured.rtol, rtol, rtol=1e-9, atol=0.0)))
        rung = of(rungs, ladder="tolerance", precision="mixed")
        assert rung.sizes["rung"] == 1
        for quantity, expected in zip(tradeoff_variables.QUANTITIES, EXPECTED[name], strict=True):
            elements = 1 / 33**2 if quantity == "contact_area_fraction" else 0.0  # single ones of a coarser grid
            assert float(rung[f"{quantity}_error"].max()) <= 10.0 * (expected + elements)
        assert float(rung.free_volume_error.max()) <= rtol + 1e-11


@pytest.mark.parametrize("asked", [{"free_volume": 1e-4}, {"mean_pressure": 1e-3}, {"mean_pressure": 1e-6}])
def test_a_requested_error_is_certified_and_met(asked: dict[str, float]) -> None:
    text = "surface: {D: 2.6, m: 6, seeds: 1}\nsweep: {steps: 10}\nsolver: "
    exact, found = (solved(text + solver) for solver in ("{rtol: 1.0e-11}", f"{{max_error: {asked}}}"))
    for name, error in asked.items():
        bound = found.residual if name == "free_volume" else found.mean_pressure_bound
        off = np.abs(found[name] - exact[name]) / (1.0 if name == "free_volume" else found[name])
        assert (off <= bound + 1e-10).all()
        assert (bound <= error).all()
    work, exact_work = (float((ds.convolutions + ds.convolutions_fp32).sum()) for ds in (found, exact))
    assert work < exact_work
