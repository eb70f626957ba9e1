"""Estimates: they count what a study has, grow with what it asks, and bound what it stores."""

from __future__ import annotations

from pathlib import Path

import pytest

import roughvol
from roughvol.estimate import convolutions_per_step, estimate
from roughvol.study import loads


def test_counts_are_those_of_the_study() -> None:
    cost = estimate(loads("surface: {D: [2.2, 2.8], m: [3, 4], seeds: 3}\nsweep: {steps: 7}"), jobs=100)
    assert (cost.cases, cost.steps, cost.jobs) == (12, 84, 12)


def test_cost_grows_with_what_is_asked() -> None:
    plain = estimate(loads("surface: {D: 2.2, m: 6, seeds: 4}\nsweep: {steps: 50}"), jobs=1)
    more_steps = estimate(loads("surface: {D: 2.2, m: 6, seeds: 4}\nsweep: {steps: 5000}"), jobs=1)
    fields = estimate(loads("surface: {D: 2.2, m: 6, seeds: 4}\nsweep: {steps: 50}\nrecord: {fields_at: last}"), jobs=1)
    larger = estimate(loads("surface: {D: 2.2, m: 8, seeds: 4}\nsweep: {steps: 50}"), jobs=1)
    assert more_steps.seconds > plain.seconds
    assert larger.seconds > plain.seconds
    assert larger.memory > plain.memory
    assert fields.disk > plain.disk


def test_processes_share_the_time_but_not_that_of_one_case() -> None:
    study = loads("surface: {D: 2.2, m: 6, seeds: 8}\nsweep: {steps: 10000}")
    times = [estimate(study, jobs=jobs).seconds for jobs in (1, 2, 8, 100)]
    assert times[0] > times[1] > times[2] == times[3]


@pytest.mark.parametrize("nodes", [9, 33, 129, 1025])
def test_a_step_takes_at_least_its_verification(nodes: int) -> None:
    needed = [convolutions_per_step((nodes, nodes), rtol) for rtol in (1e-1, 1e-3, 1e-6, 1e-9)]
    assert needed == sorted(needed)
    assert needed[0] >= 1.0


def test_disk_is_an_upper_bound(tmp_path: Path) -> None:
    study = loads(
        "surface: {D: 2.5, m: 5, seeds: 2}\nsweep: {steps: 12}\n"
        "record: {heights: true, fields_at: {step: [6, 12]}, box_counting: {}, volume_density: {}}"
    )
    roughvol.run(study, out=tmp_path)
    assert sum(path.stat().st_size for path in tmp_path.rglob("*.nc")) <= estimate(study).disk
