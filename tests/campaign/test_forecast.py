"""The time left of a run, with a clock that the test moves."""

from __future__ import annotations

import heapq

import pytest

from roughvol.campaign.forecast import Forecast, Rates, Work, work_of
from roughvol.study import loads


class _Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def _run(
    works: dict[str, Work], factors: dict[int, float], *, processes: int, start: float, power: float
) -> list[tuple[float, float]]:
    """Return times and the seconds left said there, of a run on processes that take `factors` times as long.

    Messages come after each fifth of the steps, whose time rises with the given power.
    """
    clock = _Clock()
    forecast = Forecast(works, clock=clock)
    forecast.start(processes, here=False)
    waiting = sorted(works, key=lambda id: -works[id].total)
    events: list[tuple[float, int, str, int]] = []
    said = []
    cold = processes

    def begin() -> None:
        nonlocal cold
        id = waiting.pop(0)
        work, delay = works[id], start if cold > 0 else 0.0
        cold -= 1
        forecast.begun(id)
        for fifth in range(1, 6):
            seconds = factors[work.nodes] * (work.first + work.swept * (fifth / 5) ** power)
            heapq.heappush(events, (clock.now + delay + seconds, len(works) - len(waiting), id, fifth))

    for _ in range(processes):
        begin()
    while events:
        clock.now, _, id, fifth = heapq.heappop(events)
        forecast.reached(id, fifth * works[id].steps // 5)
        if fifth == 5:
            forecast.ended(id)
            if waiting:
                begin()
        said.append((clock.now, forecast.left()))
    assert forecast.share == pytest.approx(1.0)
    return said


@pytest.mark.parametrize("processes", [1, 2, 7])
@pytest.mark.parametrize("factors", [{9: 1.0, 5: 1.0}, {9: 4.0, 5: 4.0}, {9: 0.7, 5: 1.2}, {9: 3.0, 5: 1.7}])
@pytest.mark.parametrize("power", [1.0, 1.5])
def test_after_five_seconds_the_time_left_is_right_within_a_factor_of_two(
    processes: int, factors: dict[int, float], power: float
) -> None:
    works = {f"fine{k}": Work(9, 0.1, 2.0, 60, 1.5) for k in range(20)}
    works |= {f"coarse{k}": Work(5, 0.01, 0.1, 60, 1.5) for k in range(200)}
    said = _run(works, factors, processes=processes, start=2.0, power=power)
    end = said[-1][0]
    late = [(now, left) for now, left in said if now >= 5.0 and end - now > 1.0]
    assert late
    assert [(now, left, end - now) for now, left in late if not 0.5 < left / (end - now) < 2.0] == []


def test_the_last_cases_do_not_share_the_processes() -> None:
    works = {f"{k}": Work(9, 0.0, 10.0, 10) for k in range(5)}
    clock = _Clock()
    forecast = Forecast(works, clock=clock)
    forecast.start(4, here=True)
    assert forecast.left() == pytest.approx(20.0, abs=0.5)  # 12.5 if the fifth were shared out


def test_a_case_without_signs_has_time_left() -> None:
    clock = _Clock()
    forecast = Forecast({"long": Work(9, 1.0, 1.0, 10)}, clock=clock)
    forecast.start(1, here=True)
    forecast.begun("long")
    clock.now = 100.0
    assert forecast.left() >= 20.0


def test_a_late_start_of_processes_is_a_sign_of_a_slow_machine() -> None:
    clock = _Clock()
    forecast = Forecast({"a": Work(9, 0.0, 10.0, 10), "b": Work(9, 0.0, 10.0, 10)}, clock=clock)
    forecast.start(1, here=False)
    forecast.begun("a")
    clock.now = 10.0
    forecast.reached("a", 1)
    assert forecast.left() > 40.0


def test_rates_pass_on_from_round_to_round_and_later_rounds_count() -> None:
    rates, clock = Rates(), _Clock()
    first = Forecast({"a": Work(9, 0.0, 30.0, 10)}, rates=rates, later={9: 30.0}, clock=clock)
    first.start(1, here=True)
    assert first.left() == pytest.approx(60.0, rel=0.02)
    first.begun("a")
    clock.now = 60.0
    first.ended("a")
    assert first.share == pytest.approx(0.5)
    assert first.left() == pytest.approx(60.0, rel=0.02)
    second = Forecast({"b": Work(9, 0.0, 30.0, 10)}, rates=rates, clock=clock)
    assert second.left() == pytest.approx(60.0, rel=0.02)


def test_work_grows_with_grid_searches_and_observables() -> None:
    def total(text: str, m: int = 7) -> float:
        (case,) = loads(f"surface: {{D: 2.3, m: {m}, seeds: 1}}\n{text}", "x").cases()
        return work_of(case, (2**m + 1, 2**m + 1)).total

    plain = total("sweep: {steps: 20}")
    assert total("sweep: {steps: 40}") > plain
    assert total("sweep: {steps: 20}", m=8) > 3.0 * plain
    assert total("sweep: {steps: 20, to: percolation}") > 1.5 * plain
    assert total("sweep: {steps: 20}\nrecord: {transport: {transmissivity: every-step}}") > 2.0 * plain
    assert total("sweep: {pressures: [0.1, 0.2, 0.3]}") > plain
    assert total("sweep: {steps: 0}") < 0.3 * plain
