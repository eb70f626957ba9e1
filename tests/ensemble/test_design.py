"""The design of an ensemble: the requested accuracy is reached, by stored numbers alone."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.campaign import rounds
from roughvol.ensemble import answer, step_error
from roughvol.ensemble.design import Design, pilot
from roughvol.ensemble.samples import SampleTable
from roughvol.ensemble.step_error import SHARE, StepErrors
from roughvol.ensemble.targets import Arrays
from roughvol.errors import CampaignError, StudyError
from roughvol.study import Case, Study, loads
from tests.bench.coverage import compute, measure, study
from tests.ensemble.kit import Compute, asked, drawn, driven, made

EXACT = StepErrors((0.0,), 0)


def _driven(study: Study, compute: Compute, **options: Any) -> Design:
    return driven(study, compute, EXACT, alone=drawn, **options)


def test_the_interval_is_as_narrow_as_asked_and_holds_the_mean() -> None:
    means = {m: 1.0 + 2.0**-m for m in range(4, 10)}
    found = _driven(asked(9, "0.5 %"), made(means))
    (one,) = found.estimates[2.3]
    assert one.reached
    assert one.mean.half_width <= 0.005 * one.mean.value
    assert abs(one.mean.value - means[9]) <= 2.0 * one.mean.half_width
    assert_allclose(one.bias, 2.0**-9, rtol=1.0)
    have = found.table.counts(2.3)
    used = [have[k] for k in one.plan.levels]
    assert used == sorted(used, reverse=True)
    assert found.table.cost(2.3) < 0.35 * one.plain_cost


def test_where_levels_do_not_pay_it_costs_no_more_than_plain_monte_carlo_and_the_pilot() -> None:
    random = np.random.default_rng

    def unrelated(cases: Sequence[Case]) -> dict[str, Arrays]:
        found = {}
        for case in cases:
            value = {case.m: float(1.0 + 0.1 * random([case.seed or 0, case.m, 5]).standard_normal())}
            found |= made(value, spread=0.0)([case])
        return found

    found = _driven(asked(7, "2 %"), unrelated)
    (one,) = found.estimates[2.3]
    first = sum(n * cost for n, cost in zip(pilot(range(4, 8)).values(), one.costs, strict=True))
    assert one.reached
    assert found.table.cost(2.3) <= 1.5 * one.plain_cost + first
    assert "levels do not pay here" in "\n".join(answer.sentences(found))


def _spectral(cut: int, rolloff: int, accuracy: str) -> Study:
    return loads(
        f"surface: {{H: 0.7, n: auto, cut: {cut}, rolloff: {rolloff}, sides: periodic}}\nsweep: {{steps: 8}}\n"
        f"ensemble: {{accuracy: {{free_volume: {accuracy}}}}}"
    )


AUTO = {"m": lambda accuracy: asked("auto", accuracy), "n": lambda accuracy: _spectral(32, 4, accuracy)}


@pytest.mark.parametrize("key", AUTO)
def test_a_finer_resolution_is_added_until_the_bias_fits(key: str) -> None:
    means = {m: 1.0 + 2.0**-m for m in range(4, 13)}
    found = _driven(AUTO[key]("0.3 %"), made(means, spread=0.02))
    assert found.table.finest == 10  # 2^-10 is the first below half of 0.003
    assert found.estimates[2.3][0].bias <= 0.5 * 0.003 * found.estimates[2.3][0].mean.value


@pytest.mark.parametrize(("key", "finest"), [("m", 7), ("n", 9)])  # 2^9 = 16 · 32: four grids have all waves
def test_a_mean_without_a_limit_is_refused_after_the_pilot(key: str, finest: int) -> None:
    solved: set[int] = set()

    def counted(cases: Sequence[Case]) -> Mapping[str, Arrays]:
        solved.update(case.m or 0 for case in cases)
        return made({m: 0.7**m for m in range(4, 13)})(cases)

    with pytest.raises(StudyError, match=rf"surface.{key}: 'auto' needs means that converge with {key}.*-30"):
        _driven(AUTO[key]("1 %"), counted)
    assert max(solved) == finest


def test_a_mean_that_is_zero_up_to_the_finest_grid_has_no_limit_there() -> None:
    with pytest.raises(StudyError, match=r"its last levels change it by \+0.0 %, \+0.0 %, \+inf %"):
        _driven(asked("auto", "5 %"), made({m: float(m == 7) for m in range(1, 14)}))


def test_a_mean_that_changes_while_waves_are_missing_is_followed_to_the_shortest_wave() -> None:
    """It falls by 30 % at every level up to 2^7 nodes, λ_s = 2 δ, and then converges."""
    means = {m: 0.7 ** min(m, 7) * (1.0 + 0.3 * 4.0 ** -max(m - 7, 0)) for m in range(4, 13)}
    found = _driven(_spectral(64, 4, "4 %"), made(means, spread=0.02))
    assert 8 < found.table.finest < 12
    (one,) = found.estimates[2.3]
    assert abs(one.mean.value - 0.7**7) < 0.04 * 0.7**7


def test_a_mean_without_a_limit_at_a_given_m_says_so() -> None:
    found = _driven(asked(8, "2 %"), made({m: 0.7**m for m in range(4, 9)}))
    assert "does not converge with m, this is the value at m = 8" in answer.sentences(found)[0]
    assert np.isnan(answer.variables(found)["free_volume_bias"][1]).all()
    (alone, *_) = answer.sentences(_driven(asked(1, "5 %"), made({1: 1.0})))
    assert "resolution: not known from one level" in alone


def test_a_mean_beside_fluid_pressure_is_said_to_be_without_it() -> None:
    text = "surface: {D: 2.3, m: 5}\nsweep: {steps: 8}\nensemble: {accuracy: {free_volume: 9 %}}\n"
    lifted = loads(f"{text}record: {{fluid_pressure: {{inlet: 0.01, at: last}}}}")
    found = _driven(lifted, made(dict.fromkeys((3, 4, 5), 1.0)))
    assert "all means are those of the gap without fluid pressure" in answer.sentences(found)[-1]


def test_a_mean_of_zero_on_all_surfaces_is_zero_without_an_error() -> None:
    found = _driven(asked(5, "5 %"), made(dict.fromkeys((3, 4, 5), 0.0)))
    assert "m = 5: 0 ± 0 (the same on all seeds)" in answer.sentences(found)[0]


def test_a_budget_ends_it_and_says_what_was_reached() -> None:
    def within(budget: str) -> Design:
        seconds = itertools.count(0.0, 40.0)
        study = asked(6, "0.1 %", f", budget: {budget}")
        return _driven(study, made({4: 1.0, 5: 1.0, 6: 1.0}), seconds=lambda: next(seconds))

    found = within("1 min")
    assert found.counts == within("60 s").counts
    assert not found.estimates[2.3][0].reached
    said = answer.sentences(found)
    assert "asked for ± 0.1 %" in said[0]
    assert "budget of 1 min" in said[-1]


def test_a_budget_ends_it_where_surfaces_without_a_solve_alone_are_lacking() -> None:
    """The plan had no further samples, and the share of them that fits into the budget was 0/0."""
    text = "surface: {D: 2.2, m: 1}\nensemble: {at: {contact_area: 0.1}, accuracy: {free_volume: 8 %}, budget: 1 s}"
    seconds = itertools.count(0.0, 40.0)
    found = driven(loads(text), steps=EXACT, seconds=lambda: next(seconds))
    assert not found.estimates[2.2][0].reached
    assert "budget of 1 s" in answer.sentences(found)[-1]


def test_an_accuracy_out_of_reach_is_an_error() -> None:
    with pytest.raises(CampaignError, match="needs more than 1000000 samples; its mean is"):
        _driven(asked(5, "1e-9"), made({3: 1.0, 4: 1.0, 5: 1.0}))


def test_a_state_that_a_sweep_does_not_reach_is_an_error_of_the_study() -> None:
    said = r":3: ensemble.at.pressure: 2 is not reached by D = 2.30, m = 3, seed 0.*; m = 3 is a coarser .* m = 5$"
    with pytest.raises(StudyError, match=said):
        _driven(asked(5, "1 %", ", at: {pressure: 2}"), made({3: 1.0, 4: 1.0, 5: 1.0}))


def test_samples_are_values_at_the_state_between_the_steps() -> None:
    samples = []
    for steps in (30, 120):
        table = SampleTable(study(5, 2.3, "5 %", steps=steps), 5)
        case = table.study.sample(2.3, 5, 0)
        table.add(case, compute([case])[case.id])
        samples.append(table.samples[2.3, 5][0])
    found, exact = samples
    assert_allclose(found.values, exact.values, rtol=1e-4)
    assert found.cost < exact.cost


def _choosing(accuracy: str, more: str = "") -> Study:
    return loads(f"surface: {{D: 2.3, m: 5}}\nensemble: {{accuracy: {{{accuracy}}}, at: {{pressure: 0.3}}}}\n{more}")


def test_too_few_steps_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step_error, "SURFACES", 8)
    few = _choosing("free_volume: 4 %", "sweep: {steps: 2}")
    found = driven(few, compute)
    (estimate,) = found.estimates[2.3]
    assert estimate.interpolation_error > 0.1 * estimate.requested
    assert not estimate.steps_suffice
    assert answer.variables(found)["free_volume_step_error_high"][1].all()
    assert "passes a tenth of the accuracy, 4 %: take more sweep.steps" in "\n".join(answer.sentences(found))
    enough = rounds.step_errors(_choosing("free_volume: 2 %", "sweep: {steps: 30}"))
    assert max(enough.errors) <= SHARE


@pytest.mark.parametrize("sweep", ["{pressures: [0.1, 0.3]}", "{steps: 4, to: {pressure: 0.3}}"])
def test_a_solved_state_needs_no_interpolation(sweep: str) -> None:
    assert rounds.step_errors(_choosing("contact_area: 1 %", f"sweep: {sweep}")) == StepErrors((0.0,), 0)
    last = loads("surface: {D: 2.3, m: 6}\nensemble: {accuracy: {free_volume: 1 %}}")
    assert rounds.step_errors(last) == StepErrors((0.0,), 0)


def test_a_state_that_a_step_reaches_needs_no_interpolation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step_error, "STEPS", 4)
    monkeypatch.setattr(step_error, "SURFACES", 2)
    sweep = "sweep: {steps: 2, equal: pressure, to: {pressure: 0.6}}"
    assert rounds.step_errors(_choosing("contact_area: 1 %", sweep)).errors == (0.0,)
    several = "surface: {D: [2.2, 2.4, 2.6], m: 2}\nsweep: {steps: 2}\nensemble: "
    some = loads(several + "{at: {separation: 0.3}, accuracy: {contact_area: 9 %}}")
    assert rounds.step_errors(some).surfaces == len(step_error.trial(some)) == 3


@pytest.mark.slow
@pytest.mark.parametrize("few", [False, True])
def test_the_intervals_of_two_hundred_studies_contain_the_mean(few: bool) -> None:
    found = measure(5, 2.3, "4 %", 200, quantity="free_volume", few=few, seeds=5000)
    assert 0.92 <= found["coverage"] <= 0.98
    assert found["holds"] == 1.0


def test_the_first_grid_shows_the_power_law() -> None:
    for rolloff, finest in ((1, 7), (16, 7), (17, 8), (64, 9)):
        assert max(case.m or 0 for case in _spectral(128, rolloff, "1 %").cases()) == finest
