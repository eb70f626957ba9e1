"""The time left of a run, with a clock that the test moves."""

from __future__ import annotations

import pytest

from roughvol.campaign.forecast import Forecast
from roughvol.ensemble import cost
from roughvol.study import loads


class _Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize("processes", [1, 2, 7])
@pytest.mark.parametrize("slower", [0.7, 1.0, 4.0])
def test_the_time_left_is_that_of_the_work_left_at_the_mean_rate(processes: int, slower: float) -> None:
    works = {f"fine{k}": 2.0 for k in range(21)} | {f"coarse{k}": 0.1 for k in range(210)}
    clock = _Clock()
    forecast = Forecast(works, dict.fromkeys(works, 60), clock=clock)
    assert forecast.left() is None
    whole = slower * sum(works.values()) / processes
    for id, seconds in works.items():
        clock.now += slower * seconds / processes
        forecast.ended(id)
        assert forecast.left() == pytest.approx(whole - clock.now, abs=1e-9)
    assert forecast.share == pytest.approx(1.0)


def test_steps_of_a_case_at_work_count_as_their_share() -> None:
    clock = _Clock()
    forecast = Forecast({"long": 30.0, "none": 0.0}, {"long": 10, "none": 0}, clock=clock)
    clock.now = 6.0
    forecast.reached("long", 2)
    assert forecast.share == pytest.approx(0.2)
    assert forecast.left() == pytest.approx(24.0)


def test_later_batches_count_as_work_left() -> None:
    clock = _Clock()
    forecast = Forecast({"a": 30.0}, {"a": 10}, 30.0, clock)
    clock.now = 60.0
    forecast.ended("a")
    assert forecast.share == pytest.approx(0.5)
    assert forecast.left() == pytest.approx(60.0)


def test_work_grows_with_grid_searches_and_observables() -> None:
    def total(text: str, m: int = 7) -> float:
        (case,) = loads(f"surface: {{D: 2.3, m: {m}, seeds: 1}}\n{text}", "x").cases()
        return cost.expected_seconds(case, (2**m + 1, 2**m + 1))

    plain = total("sweep: {steps: 20}")
    assert total("sweep: {steps: 40}") > plain
    assert total("sweep: {steps: 20}", m=8) > 3.0 * plain
    assert total("sweep: {steps: 20, to: percolation}") > 1.5 * plain
    assert total("sweep: {steps: 20}\nrecord: {transport: {transmissivity: every-step}}") > 2.0 * plain
    assert total("sweep: {pressures: [0.1, 0.2, 0.3]}") > plain
    assert total("sweep: {steps: 0}") < 0.3 * plain
