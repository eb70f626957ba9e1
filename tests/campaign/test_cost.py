"""Estimates: they count what a study has, grow with what it asks, and bound what it stores."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import roughvol
from roughvol.campaign.cost import START, estimate
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import sweep
from roughvol.ensemble.cost import CASE, convolutions_per_step
from roughvol.observables import requests
from roughvol.study import ACCURACY, Level, loads
from roughvol.study.sections.record import Record
from roughvol.surfaces.midpoint import random_midpoint_displacement


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


def test_cases_of_one_cost_are_estimated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thousands of D with a long record of levels made `roughvol check` wait for minutes."""
    text = "surface: {D: [2.2, 2.5, 2.8], m: [3, 4], seeds: SEEDS}\nsweep: {steps: 7}\nrecord: {fields_at: last}"
    asked: list[object] = []
    find = requests.asked

    def counted(record: Record) -> dict[str, dict[str, Level] | None]:
        asked.append(record)
        return find(record)

    monkeypatch.setattr(requests, "asked", counted)
    one, many = (estimate(loads(text.replace("SEEDS", seeds)), jobs=2) for seeds in ("1", "100"))
    assert len(asked) < 50
    assert (many.cases, many.steps) == (100 * one.cases, 100 * one.steps)
    assert many.disk == pytest.approx(100 * one.disk, rel=1e-12)
    assert many.observables == {name: pytest.approx(100 * taken, rel=1e-12) for name, taken in one.observables.items()}
    assert many.seconds - START == pytest.approx(100 * (one.seconds - START), rel=1e-9)


def test_everything_that_is_recorded_has_its_cost() -> None:
    text = (
        "surface: {D: 2.2, m: 6, seeds: 4}\nsweep: {steps: 10}\n"
        "record: {fields_at: last, box_counting: {}, volume_density: {}, "
        "transport: {transmissivity: STATES, flux_at: last}, region_widths: {shares: [1, 0.5], transmissivity: last}}"
    )
    few = estimate(loads(text.replace("STATES", "last")), jobs=1).observables
    many = estimate(loads(text.replace("STATES", "every-step")), jobs=1).observables
    assert set(few) == {
        *("fields_at", "box_counting", "volume_density", "transmissivity", "flux_at"),
        *("region_widths", "region_transmissivity"),
    }
    assert many["transmissivity"] == pytest.approx(10 * few["transmissivity"], rel=1e-12)
    assert (
        few["transmissivity"] < few["region_transmissivity"] < 1.25 * few["transmissivity"]
    )  # 1 + 0.5² of it, or less
    assert estimate(loads(text.replace("STATES", "last").replace("record", "# record")), jobs=1).observables == {}


@pytest.mark.parametrize("nodes", [9, 33, 129, 1025])
def test_a_step_takes_at_least_its_verification(nodes: int) -> None:
    needed = [convolutions_per_step((nodes, nodes), rtol) for rtol in (1e-1, 1e-3, 1e-6, 1e-9)]
    assert needed == sorted(needed)
    assert needed[0] >= 1.0


def test_accuracies_are_as_far_apart_as_their_sweeps() -> None:
    """By counts, which do not depend on who else is using the machine."""
    surface = random_midpoint_displacement(2.4, 7)
    half_space = HalfSpace(surface.shape)
    end = (surface.z_max - surface.mean_height) / surface.Sq
    for rtol in ACCURACY.values():
        before = half_space.convolutions + 0.6 * half_space.convolutions_fp32
        list(sweep(surface, half_space, end * np.arange(1, 31) / 30, rtol=rtol))
        taken = (half_space.convolutions + 0.6 * half_space.convolutions_fp32 - before) / 30
        assert taken / 2 <= convolutions_per_step(surface.shape, rtol) <= 2 * taken


@pytest.mark.parametrize("target", ["{contact_area: 0.1}", "{pressure: 1}", "percolation"])
def test_a_search_costs_less_than_a_sweep_of_sixty_steps(target: str) -> None:
    text = "surface: {{D: 2.4, m: 7, seeds: 1}}\nsweep: {{steps: {}, to: {}}}"
    plain, searched, twice = (
        estimate(loads(text.format(*how)), jobs=1).seconds - START - CASE
        for how in ((60, "mean-plane"), (60, target), (120, "mean-plane"))
    )
    assert plain < searched < twice


def test_disk_is_an_upper_bound(tmp_path: Path) -> None:
    study = loads(
        "surface: {D: 2.5, m: 5, seeds: 2}\nsweep: {steps: 12}\n"
        "record: {heights: true, fields_at: {step: [6, 12]}, box_counting: {}, volume_density: {}}"
    )
    roughvol.run(study, out=tmp_path)
    assert sum(path.stat().st_size for path in tmp_path.rglob("*.nc")) <= estimate(study).disk
