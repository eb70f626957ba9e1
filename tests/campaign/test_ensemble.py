"""Ensembles: the accuracy asked for is reached, by stored numbers alone, whoever computes and whatever interrupts."""

from __future__ import annotations

import itertools
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

from roughvol.analysis.stored_run import Run
from roughvol.campaign import answered, ensemble, samples, sampling, steps
from roughvol.campaign.batch import Progress
from roughvol.campaign.collected import collect
from roughvol.campaign.running import run
from roughvol.cli import main
from roughvol.errors import CampaignError, StudyError
from roughvol.report.run_facts import facts
from roughvol.store import dataset
from roughvol.store.dataset import Arrays
from roughvol.store.run_status import status
from roughvol.study import Case, Study, loads
from tests.bench.coverage import compute, measure, study

TEXT = """
name: mean
surface: {D: 2.3, m: 4}
ensemble: {accuracy: {free_volume: 8 %}, at: {pressure: [0.1, 0.3]}}
"""


def _made(values: Mapping[int, float], spread: float = 0.1) -> ensemble.Compute:
    """Samples without a solver: V* of level m has a mean, a scatter that all levels share, and a little of its own."""

    def made(cases: Sequence[Case]) -> dict[str, Arrays]:
        found: dict[str, Arrays] = {}
        for case in cases:
            assert case.m is not None
            assert case.seed is not None
            shared = np.random.default_rng(case.seed).standard_normal()
            own = np.random.default_rng([case.seed, case.m]).standard_normal() * 2.0**-case.m
            v = values[case.m] * (1.0 + spread * (shared + own))
            steps = np.linspace(0.0, 1.0, 9)[1:]
            numbers = {
                "indentation": steps,
                "separation": 3.0 - steps,
                "contact_area_fraction": 0.1 * steps,
                "mean_pressure": steps,
                "free_volume": 3.0 + steps * (v - 3.0),
                "convolutions": np.full(8, 2.0),
                "convolutions_fp32": np.zeros(8),
                "residual": np.full(8, 1e-5),
            }
            found[case.id] = {name: (("step",), row) for name, row in numbers.items()}
        return found

    return made


def _asked(m: object, accuracy: str, more: str = "") -> Study:
    return loads(
        f"surface: {{D: 2.3, m: {m}}}\nsweep: {{steps: 8}}\nensemble: {{accuracy: {{free_volume: {accuracy}}}{more}}}"
    )


def test_the_interval_is_as_narrow_as_asked_and_holds_the_mean() -> None:
    means = {m: 1.0 + 2.0**-m for m in range(4, 10)}
    found = ensemble.estimate_means(_asked(9, "0.5 %"), _made(means))
    (one,) = found.estimates[2.3]
    assert one.reached
    assert one.mean.half_width <= 0.005 * one.mean.value
    assert abs(one.mean.value - means[9]) <= 2.0 * one.mean.half_width
    assert_allclose(one.weak_error.bias, 2.0**-9, rtol=1.0)
    have = found.samples.counts(2.3)
    used = [have[k] for k in one.plan.levels]
    assert used == sorted(used, reverse=True)
    assert found.samples.cost(2.3) < 0.35 * one.plain_cost


def test_where_levels_do_not_pay_it_costs_no_more_than_plain_monte_carlo_and_the_pilot() -> None:
    random = np.random.default_rng

    def unrelated(cases: Sequence[Case]) -> dict[str, Arrays]:
        found = {}
        for case in cases:
            assert case.m is not None
            value = {case.m: float(1.0 + 0.1 * random([case.seed or 0, case.m, 5]).standard_normal())}
            found |= _made(value, spread=0.0)([case])
        return found

    found = ensemble.estimate_means(_asked(7, "2 %"), unrelated)
    (one,) = found.estimates[2.3]
    pilot = sum(n * cost for n, cost in zip(sampling.pilot(range(4, 8)).values(), one.costs, strict=True))
    assert one.reached
    assert found.samples.cost(2.3) <= 1.5 * one.plain_cost + pilot
    assert "levels do not pay here" in "\n".join(answered.sentences(found))


def test_a_finer_resolution_is_added_until_the_bias_fits() -> None:
    means = {m: 1.0 + 2.0**-m for m in range(4, 13)}
    found = ensemble.estimate_means(_asked("auto", "0.3 %"), _made(means, spread=0.02))
    assert found.samples.finest == 10  # 2^-10 is the first below half of 0.003
    assert found.estimates[2.3][0].weak_error.bias <= 0.5 * 0.003 * found.estimates[2.3][0].mean.value


def test_a_mean_without_a_limit_is_refused_after_the_pilot() -> None:
    calls = itertools.count()

    def counted(cases: Sequence[Case]) -> Mapping[str, Arrays]:
        next(calls)
        return _made({m: 0.7**m for m in range(4, 13)})(cases)

    with pytest.raises(StudyError, match=r"surface.m: 'auto' needs means that converge with m.*-30"):
        ensemble.estimate_means(_asked("auto", "1 %"), counted)
    assert next(calls) == 1


def test_a_mean_without_a_limit_at_a_given_m_says_so() -> None:
    found = ensemble.estimate_means(_asked(8, "2 %"), _made({m: 0.7**m for m in range(4, 9)}))
    assert "does not converge with m, this is the value at m = 8" in answered.sentences(found)[0]
    assert np.isnan(answered.variables(found)["free_volume_bias"][1]).all()


def test_a_budget_ends_it_and_says_what_was_reached() -> None:
    seconds = itertools.count(0.0, 40.0)
    found = ensemble.estimate_means(
        _asked(6, "0.1 %", ", budget: 1 min"), _made({4: 1.0, 5: 1.0, 6: 1.0}), clock=lambda: next(seconds)
    )
    assert not found.estimates[2.3][0].reached
    said = answered.sentences(found)
    assert "asked for ± 0.1 %" in said[0]
    assert "budget of 1 min" in said[-1]


def test_an_accuracy_out_of_reach_is_an_error() -> None:
    with pytest.raises(CampaignError, match="needs more than 1000000 samples; its mean is"):
        ensemble.estimate_means(_asked(5, "1e-9"), _made({3: 1.0, 4: 1.0, 5: 1.0}))


def test_a_state_that_a_sweep_does_not_reach_is_an_error_of_the_study() -> None:
    with pytest.raises(StudyError, match=r":3: ensemble.at.pressure: 2 is not reached by D = 2.30, m = 5, seed 0"):
        ensemble.estimate_means(
            loads(
                "surface: {D: 2.3, m: 5}\nsweep: {steps: 8}\n"
                "ensemble: {accuracy: {free_volume: 1 %}, at: {pressure: 2}}"
            ),
            _made({3: 1.0, 4: 1.0, 5: 1.0}),
        )


def test_samples_are_values_at_the_state_between_the_steps() -> None:
    one = study(5, 2.3, "5 %", steps=30)
    case = one.cases()[0]
    found = samples.sample_of(samples.targets_of(one.ensemble), case, compute([case])[case.id])
    fine = study(5, 2.3, "5 %", steps=240)
    exact = samples.sample_of(
        samples.targets_of(fine.ensemble), fine.cases()[0], compute(fine.cases()[:1])[fine.cases()[0].id]
    )
    assert_allclose(found.values, exact.values, rtol=1e-4)
    assert found.cost < exact.cost


def _choosing(accuracy: str, more: str = "") -> Study:
    return loads(f"surface: {{D: 2.3, m: 6}}\nensemble: {{accuracy: {{{accuracy}}}, at: {{pressure: 0.3}}}}\n{more}")


def test_too_few_steps_are_named() -> None:
    few = _choosing("free_volume: 4 %", "sweep: {steps: 2}")
    found = ensemble.estimate_means(few, compute)
    (estimate,) = found.estimates[2.3]
    assert estimate.interpolation_error > 0.1 * estimate.requested
    assert not estimate.steps_suffice
    assert answered.variables(found)["free_volume_step_error_high"][1].all()
    assert "passes a tenth of the accuracy, 4 %: take more sweep.steps" in "\n".join(answered.sentences(found))
    enough = steps.measured(_choosing("free_volume: 2 %", "sweep: {steps: 30}"))
    assert (enough.number, max(enough.errors) <= steps.SHARE) == (30, True)


def test_the_last_step_and_listed_states_need_no_interpolation() -> None:
    last = loads("surface: {D: 2.3, m: 6}\nensemble: {accuracy: {free_volume: 1 %}}")
    assert steps.measured(last) == steps.Steps(20, (0.0,), 0)
    listed = steps.measured(_choosing("free_volume: 1 %", "sweep: {pressures: [0.1, 0.3]}"))
    assert (listed.number, listed.errors) == (2, (0.0,))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ensemble")
    run(loads(TEXT), out=folder, jobs=1)
    return folder


def test_the_answer_is_stored_beside_its_cases(finished: Path) -> None:
    results = dataset.read(finished / "study.nc")
    mean, interval = results.free_volume_mean, results.free_volume_interval
    assert mean.dims == ("D", "ensemble_at")
    assert interval.dims == ("D", "ensemble_at", "bound")
    assert results.ensemble_at.values.tolist() == ["pressure=0.1", "pressure=0.3"]
    assert results.bound.values.tolist() == ["lower", "upper"]
    assert bool((interval.sel(bound="lower") < mean).all() and (mean < interval.sel(bound="upper")).all())
    assert_allclose(0.5 * (interval.sel(bound="upper") + interval.sel(bound="lower")), mean)
    assert results.free_volume_bias.dims == ("D", "ensemble_at")
    counted = results.residual.notnull().any("step").sum("seed")
    assert_allclose(results.ensemble_samples, counted)
    assert all(results[name].attrs["units"] for name in results.data_vars)
    answer = results.attrs["answer"]
    assert "mean V* at pressure = 0.1, D = 2.3, m = 4" in answer
    assert CliRunner().invoke(main, ["show", str(finished)]).stdout.endswith(f"{answer}\n")
    loading = facts(Run.of("finished", results)).loading
    assert answer.splitlines()[0] in [f"{name}: {text}" for name, text in loading]


def test_no_number_depends_on_the_processes_or_on_an_interruption(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished / "cases", tmp_path / "two" / "cases")
    for number, path in enumerate(sorted((tmp_path / "two" / "cases").glob("*.nc"))):
        if number % 3 == 0:
            path.unlink()
    run(loads(TEXT), out=tmp_path / "two", jobs=2)
    one, two = (dataset.answers(dataset.read(folder / "study.nc")) for folder in (finished, tmp_path / "two"))
    assert one.identical(two)
    assert (
        dataset.read(finished / "study.nc").attrs["answer"]
        == dataset.read(tmp_path / "two" / "study.nc").attrs["answer"]
    )


def test_a_finished_ensemble_is_found_finished(finished: Path) -> None:
    told: list[Progress] = []
    before = (finished / "study.nc").read_bytes()
    run(loads(TEXT), out=finished, on_event=told.append)
    assert (finished / "study.nc").read_bytes() == before
    assert "V* at D = 2.3 ±" in told[-1].interval
    state = status(loads(TEXT), finished)
    assert not state.missing
    assert state.strange == 0
    assert state.collected
    assert collect(loads(TEXT), finished).free_volume.notnull().any("step").sum() == len(state.done)


def test_a_finished_ensemble_is_collected_with_its_answer(finished: Path, tmp_path: Path) -> None:
    stored = dataset.read(finished / "study.nc")
    assert dataset.answers(collect(loads(TEXT), finished)).identical(dataset.answers(stored))
    shutil.copytree(finished / "cases", tmp_path / "cases")
    shutil.copy(finished / "ensemble.json", tmp_path)
    from_cases = collect(loads(TEXT), tmp_path)
    assert not (tmp_path / "study.nc").exists()
    assert from_cases.attrs["answer"] == stored.attrs["answer"]
    assert_allclose(from_cases.free_volume_mean, stored.free_volume_mean)


def test_an_unfinished_ensemble_is_collected_without_an_answer(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished / "cases", tmp_path / "cases")
    shutil.copy(finished / "ensemble.json", tmp_path)
    last = sorted((tmp_path / "cases").glob("*_m2_*.nc"))[-1]
    last.unlink()
    results = collect(loads(TEXT), tmp_path)
    assert "free_volume_mean" not in results
    assert "no answer yet: 1 of " in results.attrs["answer"]
    assert results.free_volume.notnull().any("step").sum() == len(list((tmp_path / "cases").glob("*.nc")))


@pytest.mark.parametrize("level", ["²", "٣x", "-1", "1" * 5000, ""])
def test_a_plan_with_a_level_that_is_no_number_is_read_without_it(finished: Path, tmp_path: Path, level: str) -> None:
    shutil.copytree(finished, tmp_path / "run")
    plan = json.loads((finished / "ensemble.json").read_text(encoding="utf-8"))
    plan["2.3"][level] = 3
    (tmp_path / "run" / "ensemble.json").write_text(json.dumps(plan), encoding="utf-8")
    assert status(loads(TEXT), tmp_path / "run").done == status(loads(TEXT), finished).done


def test_fresh_computes_every_sample_again(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished, tmp_path / "run")
    before = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "run" / "cases").glob("*.nc")}
    results = run(loads(TEXT), out=tmp_path / "run", jobs=1, fresh=True)
    after = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "run" / "cases").glob("*.nc")}
    assert after.keys() == before.keys()
    assert all(after[name] > before[name] for name in after)
    assert dataset.answers(results).identical(dataset.answers(dataset.read(finished / "study.nc")))


@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_cluster_gives_the_same_answer(finished: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="needs dask.distributed: pip install 'roughvol[cluster]'")
    local = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, dashboard_address=":0", protocol="tcp"
    )
    with local as cluster:
        results = run(loads(TEXT), out=tmp_path, scheduler=cluster.scheduler_address)
    stored = dataset.read(finished / "study.nc")
    assert dataset.answers(results).identical(dataset.answers(stored))
    assert results.attrs["answer"] == stored.attrs["answer"]


def test_figures_cannot_choose_the_cases_of_an_ensemble(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match="an ensemble decides itself"):
        run(loads(TEXT), out=tmp_path, only=["x"])


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("few", [False, True])
def test_the_intervals_of_two_hundred_studies_contain_the_mean(few: bool) -> None:
    found = measure(5, 2.3, "4 %", 200, quantity="free_volume", few=few, seeds=5000)
    assert 0.92 <= found["coverage"] <= 0.98
    assert found["holds"] == 1.0


def _spectral(cut: int, rolloff: int, accuracy: str) -> Study:
    return loads(
        f"surface: {{H: 0.7, n: auto, cut: {cut}, rolloff: {rolloff}, periodic: true}}\nsweep: {{steps: 8}}\n"
        f"ensemble: {{accuracy: {{free_volume: {accuracy}}}}}"
    )


def test_a_grid_of_a_spectrum_is_refined_until_the_bias_fits() -> None:
    means = {m: 1.0 + 2.0**-m for m in range(4, 13)}
    found = ensemble.estimate_means(_spectral(64, 4, "0.3 %"), _made(means, spread=0.02))
    assert found.samples.finest == 10


def test_a_mean_that_changes_while_waves_are_missing_is_followed_to_the_shortest_wave() -> None:
    """It falls by 30 % at every level up to 2^7 nodes, λ_s = 2 δ, and then converges."""
    means = {m: 0.7 ** min(m, 7) * (1.0 + 0.3 * 4.0 ** -max(m - 7, 0)) for m in range(4, 13)}
    found = ensemble.estimate_means(_spectral(64, 4, "4 %"), _made(means, spread=0.02))
    assert 8 < found.samples.finest < 12
    (one,) = found.estimates[2.3]
    assert abs(one.mean.value - 0.7**7) < 0.04 * 0.7**7


def test_a_mean_without_a_limit_where_four_grids_have_all_waves_is_refused() -> None:
    solved: list[int] = []

    def counted(cases: Sequence[Case]) -> Mapping[str, Arrays]:
        solved.extend(case.m or 0 for case in cases)
        return _made({m: 0.7**m for m in range(4, 13)})(cases)

    with pytest.raises(StudyError, match=r"surface.n: 'auto' needs means that converge with n.*-30"):
        ensemble.estimate_means(_spectral(32, 4, "1 %"), counted)
    assert max(solved) == 9  # 512 = 16 · 32


def test_the_first_grid_shows_the_power_law() -> None:
    for rolloff, finest in ((1, 7), (16, 7), (17, 8), (64, 9)):
        assert max(case.m or 0 for case in _spectral(128, rolloff, "1 %").cases()) == finest
