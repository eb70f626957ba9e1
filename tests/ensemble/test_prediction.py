"""The expected ensemble: near the one that runs, for quantities of the contact and of the void."""

import pytest

from roughvol.campaign import rounds
from roughvol.ensemble import prediction
from roughvol.ensemble.step_error import StepErrors
from roughvol.study import loads
from tests.ensemble.kit import drawn, driven, made
from tests.kit import succeeded

SURFACE = "surface: {D: 2.3, m: 4}\nsweep: {steps: 6}\n"
ASKED = {
    "V*": "ensemble: {accuracy: {free_volume: 3 %}, at: {pressure: 0.3}}",
    "A*": "ensemble: {accuracy: {contact_area: 6 %}, at: {pressure: 0.3}}",
    "leak": "ensemble: {accuracy: {log_leak_rate: 0.2}, at: {pressure: 0.2}}\n"
    "record: {transport: {transmissivity: every-step}}",
}


@pytest.mark.parametrize(
    "name", ["V*", pytest.param("A*", marks=pytest.mark.slow), pytest.param("leak", marks=pytest.mark.slow)]
)
def test_the_expected_cost_is_that_of_the_run_to_a_factor_of_two(name: str) -> None:
    study = loads(SURFACE + ASKED[name])
    (row,) = rounds.expected(study)
    found = driven(study, steps=StepErrors((0.0,), 0))
    cost, plain = found.table.cost(2.3), found.estimates[2.3][0].plain_cost
    assert 0.5 <= row.seconds / cost <= 2.0
    assert 0.4 <= row.plain / plain <= 2.5  # a variance of few samples
    assert row.steps == 6


def test_finer_levels_need_fewer_samples() -> None:
    text = "surface: {D: [2.2, 2.8], m: 10}\nensemble: {accuracy: {free_volume: 1 %}, at: last}"
    planned, compute = prediction.Prediction(loads(text)), made({m: 1.0 + 2.0**-m for m in (4, 5, 6)})
    smooth, rough = planned.expected(compute(planned.request.cases), drawn(planned.request.surfaces))
    counts = list(smooth.samples.values())
    assert list(smooth.samples) == [4, 5, 6, 7, 8, 9, 10]
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > 10 * counts[-1]
    assert smooth.plain / smooth.seconds > rough.plain / rough.seconds > 1.0


def test_check_prints_the_expected_ensemble(few_samples: None) -> None:
    done = succeeded("check", "-", "--jobs", "1", input=SURFACE.replace("m: 4", "m: 3") + ASKED["V*"])
    assert "surfaces without a solve, 6 steps: " in done.output
    assert "plain Monte Carlo: " in done.output
