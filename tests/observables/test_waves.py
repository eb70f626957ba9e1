"""The spectrum before and under load, of the whole surface and of a region."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from roughvol.campaign.one_case import run_case, surface_of
from roughvol.errors import StudyError
from roughvol.observables import waves
from roughvol.observables.regions import check
from roughvol.study import loads
from roughvol.surfaces.psd import spectral
from roughvol.surfaces.surface import Surface

PERIOD = "surface: {D: 2.3, m: 5, L: 4.0, seeds: [3], periodic: true}\n"
PATCH = PERIOD.replace(", periodic: true", "")
SWEEP = "sweep: {steps: 3, to: {pressure: 2.0}}\n"
AT = "record: {psd: {at: {pressure: [0.5, 2.0]}}, fields_at: {pressure: [0.5, 2.0]}"


@pytest.mark.parametrize("surface", [PERIOD, PATCH], ids=["period", "patch"])
def test_under_load_it_is_that_of_the_gap_in_the_units_of_the_heights(surface: str) -> None:
    (case,) = loads(surface + SWEEP + AT + "}").cases()
    data, made = run_case(case).squeeze(), surface_of(case)
    for number in (0, 1):
        gap = data["gap"].values[number] * made.unit
        wanted = spectral(Surface(gap, made.spacing, periodic=case.periodic))  # a sign changes no power
        np.testing.assert_allclose(data["psd_loaded"].values[number], wanted.psd, rtol=1e-9)
        assert float(data["rms_slope_loaded"][number]) == pytest.approx(wanted.rms_slope, rel=1e-9)
        assert float(data["nayak_parameter_loaded"][number]) == pytest.approx(wanted.nayak, rel=1e-9)
    assert data["psd_loaded"].attrs["units"] == "length^4"
    assert "wave_number" not in data
    heights = [float(data["rms_height"]), *data["rms_height_loaded"].values.tolist()]
    assert heights == sorted(heights, reverse=True)  # load flattens
    assert data["psd_at"].values.tolist() == ["pressure=0.5", "pressure=2"]


def test_a_period_under_load_has_its_height_exactly() -> None:
    """h_rms of the deformed surface is the deviation of the gap: no window takes part."""
    (case,) = loads(PERIOD + SWEEP + AT + "}").cases()
    data, made = run_case(case).squeeze(), surface_of(case)
    assert data["rms_height_loaded"].values == pytest.approx(data["gap"].std(("x", "y")).values * made.unit, rel=1e-9)


def test_a_region_is_a_patch_with_its_own_wave_numbers() -> None:
    (case,) = loads(PERIOD + SWEEP + AT + ", region: interior}").cases()
    data, made = run_case(case).squeeze(), surface_of(case)
    inside = np.s_[8:25, 8:25]
    wanted = spectral(Surface(made.heights[inside], made.spacing))
    np.testing.assert_allclose(data["psd"], wanted.psd, rtol=1e-9)
    np.testing.assert_allclose(data["wave_number"], 2.0 * math.pi * wanted.wave / (16 * made.spacing))
    loaded = spectral(Surface(data["gap"].values[0][inside] * made.unit, made.spacing))
    np.testing.assert_allclose(data["psd_loaded"].values[0], loaded.psd, rtol=1e-9)


def test_full_contact_leaves_no_waves() -> None:
    (case,) = loads(PERIOD + "sweep: {steps: 2}\nrecord: {psd: {at: last}}").cases()
    data = run_case(case).squeeze()
    assert float(data["rms_height_loaded"]) < 1e-9 * float(data["rms_height"])


def test_every_request_of_a_spectrum_is_another_case() -> None:
    records = ("psd: true", "psd: {at: last}", "psd: true, region: interior", "region: interior", "psd: false")
    cases = [loads(f"{PERIOD}{SWEEP}record: {{{record}}}").cases()[0] for record in records]
    assert len({case.id for case in cases}) == len(cases)
    for record in records:
        study = loads(f"{PERIOD}{SWEEP}record: {{{record}}}")
        assert loads(study.to_yaml()) == study
        key = json.loads(study.cases()[0].key_text)["record"]
        assert type(study.record).model_validate(key).psd == study.record.psd  # as stored states are read


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PERIOD + "sweep: {steps: 0}\nrecord: {psd: {at: last}}", "record.psd.at: no contact to record"),
        (PERIOD + SWEEP + "record: {psd: {at: {pressure: 3}}}", "is not reached"),
        (PERIOD + "record: {psd: 3}", "must be true, false or a mapping"),
    ],
)
def test_what_has_no_spectrum_is_refused(text: str, words: str) -> None:
    with pytest.raises(StudyError) as refused:
        loads(text)
    assert words in str(refused.value)


def test_a_region_of_two_elements_is_refused() -> None:
    (case,) = loads(PERIOD + SWEEP + "record: {psd: true, region: {x: [0, 0.05]}}").cases()
    with pytest.raises(StudyError, match=r"record\.region.*2 × 32 elements; record\.psd needs 3 × 3"):
        check(case, (32, 32))


def test_before_load_nothing_is_changed() -> None:
    (case,) = loads(PERIOD + "sweep: {steps: 0}\nrecord: {psd: true}").cases()
    surface = surface_of(case)
    np.testing.assert_array_equal(waves.before_load(case, surface)["psd"], spectral(surface).psd)
