"""How wrong the quick estimates are: by hand, and on the page."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims.evidence import Evidence
from roughvol.reproduction.claims.leak_estimates import ratios
from roughvol.reproduction.judgement import judge
from roughvol.store import dataset
from tests.reproduction import kit

STATES = ("seed", "step", "axis")


def run_with(area, medium, junction, flow) -> ClaimRun:
    states = {"contact_area_fraction": area, "estimate_medium_transmissivity": medium}
    along = {"estimate_junction_transmissivity": junction, "transmissivity": flow}
    made = {name: (STATES[:2], np.array(values)) for name, values in states.items()}
    made |= {name: (STATES, np.stack([values, values], axis=-1)) for name, values in along.items()}
    return ClaimRun("by hand", xr.Dataset(made))


def test_ratios_by_hand() -> None:
    area = [[0.0, 0.12, 0.15, 0.18], [0.11, 0.13, 0.9, np.nan]]
    flow = [[1.0, 0.2, 0.2, 0.4], [0.5, 0.0, 0.0, 0.5]]
    medium = [[1.0, 0.2, 0.1, 1.2], [1.0, 0.3, 0.0, 0.5]]
    found = ratios(Evidence((run_with(area, medium, flow, flow),)))
    assert [ratio.estimate for ratio in found] == ["effective medium", "single critical junction"]
    off, exact = found  # both over x and y: the states at A* = 0.11, 0.12, 0.15, 0.18 twice
    assert off.area == (0.1, 0.2)
    assert off.states == 8
    assert off.median == pytest.approx(1.5)  # of 1, 1/2, 3, 2
    assert off.span[0] == pytest.approx(0.5)
    assert off.span[1] == pytest.approx(3.0)
    assert off.doubled == 0.25  # more than a factor of two: 3 alone
    assert off.closed == 2  # open by the estimate, closed in truth, along x and y
    assert (exact.median, exact.span, exact.doubled, exact.closed) == (1.0, (1.0, 1.0), 0.0, 0)


def test_a_run_without_estimates_or_with_few_states_says_nothing() -> None:
    few = [[0.15, 0.16]]
    assert ratios(Evidence((run_with(few, few, few, few),))) == []
    lacking = run_with(few, few, few, few)
    assert ratios(Evidence((ClaimRun("x", lacking.dataset.drop_vars("transmissivity")),))) == []


def test_the_report_says_how_wrong_they_are(tmp_path: Path) -> None:
    study = (
        "{surface: {D: 2.2, m: 4, seeds: 2}, sweep: {steps: 12, to: {contact_area: 0.15}},"
        " record: {transport: {transmissivity: every-step, estimates: every-step}}}"
    )
    path = kit.stored(tmp_path, leak=study)["leak"]
    ds, page = dataset.read(path), judge([path])
    assert page.estimates
    first = page.estimates[0]
    inside = (ds.contact_area_fraction > first.area[0]) & (ds.contact_area_fraction <= first.area[1])
    both = [ds.estimate_medium_transmissivity / ds["transmissivity"].sel(axis=axis) for axis in "xy"]
    every = np.concatenate([ratio.where(inside).values.ravel() for ratio in both])
    assert first.median == pytest.approx(np.nanmedian(every))
    for text in (kit.to_markdown(page), kit.to_html(page)):
        assert "How wrong the quick estimates of leakage are" in text
        assert f"{first.median:.2f}" in text
