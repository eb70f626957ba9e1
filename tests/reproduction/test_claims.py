"""The claims: verdicts follow by rule, intervals cover, and planted truths and falsehoods are told apart."""

import dataclasses
import functools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from roughvol.campaign import one_case
from roughvol.gap.box_counting import box_counts
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims import assess
from roughvol.reproduction.claims import statistics as stats
from roughvol.reproduction.claims.area_and_volume import _over_scatter
from roughvol.reproduction.claims.density import pooled
from roughvol.reproduction.claims.evidence import CLAIMS, Evidence, Lacking, area_slopes, at, slopes_of_area
from roughvol.reproduction.claims.many_seeds import many_seeds
from roughvol.reproduction.claims.shape import fitted_dimension
from roughvol.reproduction.claims.verdict import (
    ABSENT,
    FAILS,
    HOLDS,
    QUALIFIED,
    Check,
    Claim,
    Number,
    above,
    below,
    plain,
)
from roughvol.reproduction.judgement import Judgement
from roughvol.reproduction.needs import Needs
from roughvol.store import dataset
from roughvol.study import Study, loads


@pytest.fixture(scope="module")
def small(small_study: Path) -> ClaimRun:
    """One run of three D, three m and four seeds that records all there is."""
    return ClaimRun.of("small", dataset.read(small_study))


@pytest.fixture(scope="module")
def claims(answered: Judgement) -> dict[int, Claim]:
    return {claim.id: claim for claim in answered.claims}


def _any(*runs: ClaimRun) -> Evidence:
    """Return evidence that small runs count in: what is tested is how a claim is judged, not of what."""
    return Evidence(runs, any_size=True)


def _with(run: ClaimRun, **variables: xr.DataArray) -> ClaimRun:
    return dataclasses.replace(run, dataset=run.dataset.assign(variables))


# verdicts


def _claim(*checks: tuple[bool | None, bool], lacking: str = "") -> Claim:
    made = tuple(Check("", met, essential=essential) for met, essential in checks)
    return Claim(1, "", "", "", checks=made, lacking=lacking)


@pytest.mark.parametrize(
    ("checks", "verdict"),
    [
        ([(True, True), (True, False)], HOLDS),
        ([(True, True), (False, False)], QUALIFIED),
        ([(True, True), (None, False)], QUALIFIED),
        ([(None, True), (True, True)], QUALIFIED),
        ([(None, True), (None, True), (True, False)], ABSENT),
        ([(False, True), (True, True), (True, False)], FAILS),
        ([(True, False)], ABSENT),
        ([], ABSENT),
    ],
)
def test_verdict_follows_from_the_checks(checks: list[tuple[bool | None, bool]], verdict: str) -> None:
    assert _claim(*checks).verdict == verdict


def test_nothing_is_claimed_of_what_is_lacking() -> None:
    assert _claim((True, True), lacking="a run").verdict == ABSENT


@pytest.mark.parametrize(
    ("low", "high", "over", "under"), [(1.1, 2, True, False), (0, 0.9, False, True), (0, 2, None, None)]
)
def test_a_limit_inside_the_interval_is_undecided(low: float, high: float, over: object, under: object) -> None:
    number = Number("k", "", 0.5 * (low + high), low, high, 5)
    assert above(number, 1.0) is over
    assert below(number, 1.0) is under


def test_the_checklist_is_complete_argued_and_says_what_it_needs() -> None:
    assert sorted(CLAIMS) == list(range(1, 25))
    for question in CLAIMS.values():
        claim = question(Evidence(()))
        assert claim.verdict == ABSENT  # nothing was given
        assert all((claim.lacking, claim.title, claim.place, claim.sentence))
        assert len(claim.method) > 60
        needs = question.needs.values()
        assert all(need.holds for need in needs)
        assert any(not need.optional for need in needs)
        assert any(need.finest or need.m for need in needs)


# statistics


@pytest.mark.parametrize(("interval", "holds"), [(stats.mean, lambda row: 3.0), (stats.single, lambda row: row[10])])
def test_an_interval_of_ten_covers_the_mean_or_one_more_as_often_as_it_says(interval: Any, holds: Any) -> None:
    draws = np.random.Generator(np.random.PCG64(2)).normal(3.0, 2.0, (2000, 11))
    numbers = [interval("k", "", row[:10]) for row in draws]
    covered = np.mean([number.low <= holds(row) <= number.high for number, row in zip(numbers, draws, strict=True)])
    assert covered == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / 2000))


def test_the_jackknife_covers_a_band_over_the_scatter_as_often_as_it_says() -> None:
    random = np.random.Generator(np.random.PCG64(3))
    numbers = []
    for common, own in zip(random.normal(size=(1000, 1, 10, 1)), random.normal(size=(1000, 3, 10, 1)), strict=True):
        curves = np.reshape([0.9, 1.0, 1.1], (3, 1, 1)) + 0.1 * (math.sqrt(0.5) * (common + own))
        numbers.append(stats.jackknife("k", "", functools.partial(_over_scatter, curves), 10))
    assert np.mean([number.low <= 1.0 <= number.high for number in numbers]) == pytest.approx(0.95, abs=0.03)
    assert math.isnan(stats.jackknife("k", "", functools.partial(_over_scatter, curves[:, :2]), 2).low)  # one has none


def test_the_jackknife_of_a_mean_is_near_the_t_interval() -> None:
    values = np.random.Generator(np.random.PCG64(3)).normal(10.0, 1.0, 200)
    found, wanted = stats.jackknife("k", "", lambda kept: float(values[kept].mean()), 200), stats.mean("k", "", values)
    assert (found.low, found.high) == pytest.approx((wanted.low, wanted.high), rel=1e-3)
    assert math.isnan(stats.jackknife("k", "", lambda kept: 0.0, 3).low)


def test_one_surface_has_no_interval_and_nan_is_left_out() -> None:
    assert stats.mean("k", "", [2.0]) == Number("k", "", 2.0, 2.0, 2.0, 1)
    assert stats.mean("k", "", [1.0, math.nan, 3.0]).n == 2
    assert stats.ratio("k", "", [0.5, 2.0]).value == pytest.approx(1.0)


def test_slope_and_straightness_of_a_line() -> None:
    x = np.arange(5.0)
    assert stats.slope(x, 3 - 2 * x) == pytest.approx(-2.0)
    assert stats.straightness(x, 3 - 2 * x) == pytest.approx(1.0)
    assert stats.straightness(x, x**2) < 0.95
    assert math.isnan(stats.slope([1.0, 1.0], [0.0, 1.0]))


# what claims are made of


def test_a_run_with_what_is_asked_for_is_found_by_what_it_holds(small: ClaimRun) -> None:
    coarse = dataclasses.replace(small, name="coarse", dataset=small.dataset.isel(m=[0]))
    few = dataclasses.replace(small, name="few", dataset=small.dataset.isel(seed=[0]))
    assert Evidence((coarse, few, small)).best(Needs(("free_volume",), by="D")).name == "small"
    assert Evidence((coarse,)).fit(Needs(("free_volume",), by="m")) == []
    with pytest.raises(Lacking, match="midpoint law variance"):
        Evidence((small,)).best(Needs(("free_volume",), law="variance"))


def test_a_run_remakes_its_surfaces(small: ClaimRun) -> None:
    surface = small.surface(2.3, 5, seed=1)
    assert surface.Sq == float(small.dataset["Sq"].sel(D=2.3, m=5, seed=1))


def test_interpolation_does_not_reach_beyond_a_curve() -> None:
    found = at(np.array([[3.0, 2.0, 1.0]]), np.array([[30.0, 20.0, 10.0]]), np.array([0.5, 1.5, 3.0]))
    assert math.isnan(found[0, 0])
    assert found[0, 1:].tolist() == [15.0, 30.0]


def test_pooling_keeps_the_integral() -> None:
    edges = np.array([[0.0, 1.0, 2.0], [0.0, 2.0, 4.0]])
    f = np.array([[0.75, 0.25], [0.4, 0.1]])
    v, together = pooled(f, edges, 7)
    assert together.sum() * (v[1] - v[0]) == pytest.approx(1.0)


def test_dimension_of_the_plane_and_of_a_line_are_exact() -> None:
    plane, line = np.ones((64, 64), dtype=bool), np.zeros((64, 64), dtype=bool)
    line[10] = True
    for mask, dimension in ((plane, 2.0), (line, 1.0)):
        counts = box_counts(mask)
        assert fitted_dimension(counts.r, counts.counts.astype(float)[np.newaxis])[0] == pytest.approx(dimension)


# planted truths and falsehoods


def test_a_planted_exponent_is_found(small: ClaimRun) -> None:
    pressure = small.dataset["mean_pressure"]
    for planted, verdict in ((0.37, HOLDS), (0.9, FAILS)):
        area = 0.1 * pressure * 2.0 ** (-planted * small.dataset["m"])
        claim = CLAIMS[4](_any(_with(small, contact_area_fraction=area.transpose(*pressure.dims))))
        assert claim.all_numbers["exponent"].value == pytest.approx(planted, abs=1e-12)
        assert claim.verdict == verdict


def test_slopes_are_those_of_the_line_through_the_origin(small: ClaimRun) -> None:
    area = 0.07 * small.dataset["mean_pressure"]
    slopes, _ = area_slopes(_with(small, contact_area_fraction=area), small.D, small.m)
    assert all(np.allclose(each, 0.07, rtol=1e-12) for each in slopes.values())


def test_a_surface_that_is_not_pressed_has_no_slope_and_others_take_their_first_pressures() -> None:
    late = np.array([[0.0, 0.0, 3.0], [0.0, 0.0, 0.0]])
    early = np.array([[1.0, 2.0]])
    slopes, limit = slopes_of_area({"early": (early, 0.2 * early), "late": (late, 0.1 * late)})
    assert limit == 3.0
    assert slopes["early"].tolist() == pytest.approx([0.2])
    assert slopes["late"].tolist() == pytest.approx([0.1, np.nan], nan_ok=True)


def test_volume_independent_of_D_is_seen_as_such(small: ClaimRun) -> None:
    area = small.dataset["contact_area_fraction"]
    scatter = 1.0 + 0.2 * xr.DataArray([-1.0, 1.0, -0.5, 0.5], dims="seed")
    claim = CLAIMS[7](_any(_with(small, free_volume=((1.0 - area) * scatter).transpose(*area.dims))))
    assert claim.all_numbers["band"].value < 1e-3
    assert claim.checks[-1].met


def test_more_volume_at_larger_D_is_a_dependence(small: ClaimRun) -> None:
    volume = (2.0 - small.dataset["mean_pressure"] / 10.0) * small.dataset["D"]
    claim = CLAIMS[20](_any(_with(small, free_volume=volume.transpose(*small.dataset["free_volume"].dims))))
    assert claim.verdict == HOLDS
    reverse = CLAIMS[20](_any(_with(small, free_volume=-volume.transpose(*small.dataset["free_volume"].dims))))
    assert reverse.verdict == FAILS


def test_a_step_that_goes_the_wrong_way_is_counted(small: ClaimRun) -> None:
    volume = small.dataset["free_volume"].copy(deep=True)
    volume[0, 0, 0, 5] += 1.0
    far = _with(small, separation=small.dataset["separation"] - 100.0)  # as if it had been pressed on to full contact
    claim = CLAIMS[10](_any(_with(far, free_volume=volume)))
    assert claim.all_numbers["wrong_steps"].value == 1
    assert claim.verdict == FAILS


# what the small study gives


def test_small_study_answers_what_it_can(claims: dict[int, Claim]) -> None:
    absent = {id for id, claim in claims.items() if claim.verdict == ABSENT}
    assert absent == {8, 9, 10, 24}  # more surfaces, four m, full contact, two L
    assert all(claims[id].lacking in claims[id].why for id in absent)
    assert {claims[id].verdict for id in (2, 3, 13)} == {HOLDS}  # robust on small surfaces too


def test_a_claim_ends_in_a_sentence_has_keys_of_its_own_and_is_json(claims: dict[int, Claim]) -> None:
    for claim in claims.values():
        assert claim.why.endswith(".")
        assert "nan" not in claim.why
        keys = [check.number.key for check in claim.checks if check.number] + [number.key for number in claim.numbers]
        assert len(keys) == len(set(keys)), claim.id
    data = json.loads(json.dumps(plain(list(claims.values())), allow_nan=False))
    assert [claim["id"] for claim in data] == list(range(1, 25))
    assert {claim["verdict"] for claim in data} <= {HOLDS, QUALIFIED, FAILS, ABSENT}


def test_readings_need_only_one_run(answered: Judgement) -> None:
    found = {reading.topic: reading for reading in answered.readings}
    law = found["Midpoint law"]
    assert {row.reading.split(" ")[0] for row in law.rows} == {"standard"}  # the other law was not run
    scaled = found["E or E*"].rows
    assert scaled[2].number.value == pytest.approx(scaled[0].number.value / 0.75)


def test_many_seeds_contain_the_mean_and_narrow_as_they_should(small: ClaimRun) -> None:
    with pytest.raises(Lacking):
        many_seeds(_any(small))
    study: Study = loads("{surface: {D: [2.1, 2.9], m: 2, seeds: 40}, sweep: {steps: 3}, name: many}")
    computed = dataset.combine([one_case.run_case(case) for case in study.cases()], {"study": study.to_yaml()})
    many = ClaimRun.of("many", computed)
    _, spreads, flips = many_seeds(_any(many))
    for spread in spreads:
        assert spread.one[0] < spread.ten[0] < spread.many.value < spread.ten[1] < spread.one[1]
        assert spread.missed < 0.12
    assert all(0.0 <= flip.ten <= flip.one <= 1.0 for flip in flips)


# which runs are fit


PAPER_RUN = """
name: {name}
surface: {{D: {D}, m: {m}, L: {L}, seeds: {seeds}, midpoint_law: {law}}}
sweep: {{steps: {steps}, to: {to}}}
solver: {{rtol: {rtol}}}
record: {{volume_density: {{bins: {bins}, at: last}}}}
"""
BY_D = {"D": [2.1, 2.3, 2.5, 2.7, 2.9], "m": [7, 8], "seeds": 10, "steps": 60, "to": "mean-plane"}
BY_M = BY_D | {"D": [2.3], "m": [3, 4, 5, 6, 7, 8]}


def _fabricated(name: str, offset: float = 0.0, **changes: object) -> ClaimRun:
    """Return a run with smooth numbers made up, of the paper's configuration or one changed; nothing is computed."""
    given = BY_D | {"L": 100.0, "law": "std", "rtol": 1e-6, "bins": 50} | changes
    study: Study = loads(PAPER_RUN.format(name=name, **given), file=name)
    surface = study.surface
    sizes = {"D": len(surface.D), "m": len(surface.m), "seed": len(surface.seeds), "step": study.sweep.steps}
    along = [surface.D, surface.m, surface.seeds, np.arange(1, sizes["step"] + 1)]
    D, m, seed, step = np.meshgrid(*map(np.array, along), indexing="ij", sparse=True)
    scatter = 1.0 + 0.02 * np.sin(5.0 * seed + 1.0) + offset
    p = 1.5 * (step / max(sizes["step"], 1)) ** 1.5 * np.ones_like(D * m * scatter)
    area = p * 0.8 * np.exp(-1.5 * (D - 2.0)) * 2.0 ** (-0.37 * m) * scatter
    separation = 3.5 * (1.0 - step / max(sizes["step"], 1)) * np.ones_like(p)
    volume = separation + (0.6 + 0.4 * D - 2.0**-m) * p**0.5 * scatter
    dims = ("D", "m", "seed", "step")
    data = xr.Dataset(
        {"contact_area_fraction": (dims, area), "mean_pressure": (dims, p), "free_volume": (dims, volume)},
        coords={"D": list(surface.D), "m": list(surface.m), "seed": list(surface.seeds), "L": float(surface.L)},
    ).assign_coords(step=along[3])
    data["separation"] = (dims, separation)
    data["Sq"] = (dims[:3], np.ones([sizes[dim] for dim in dims[:3]]))
    data.attrs["study"] = study.to_yaml()
    return ClaimRun.of(name, data)


TOYS: dict[str, dict[str, Any]] = {
    "coarse": {"m": [4], "seeds": 1},
    "few_steps": {"steps": 3},
    "another_end": {"to": "{pressure: 1.0}"},
    "one_D": {"D": [2.5]},
    "many_coarse_D": {"D": [2.05, 2.1, 2.2, 2.3, 2.4, 2.5, 2.6, 2.7, 2.8, 2.9], "m": [2, 3, 4], "seeds": 3},
    "another_law": {"law": "variance"},
    "loose": {"rtol": 1e-2},
    "many_coarse_seeds": {"m": [3, 4], "seeds": 200, "steps": 8},
}


@pytest.fixture(scope="module")
def paper() -> list[ClaimRun]:
    return [_fabricated("by_D"), _fabricated("by_m", **BY_M)]


@pytest.fixture(scope="module")
def answers(paper: list[ClaimRun]) -> dict[int, dict[str, Any]]:
    return {claim["id"]: claim for claim in plain(assess(paper))}


def test_runs_of_the_paper_answer(answers: dict[int, dict[str, Any]]) -> None:
    assert {id for id, claim in answers.items() if claim["verdict"] != ABSENT} >= {3, 4, 5, 6, 7, 8, 9, 17, 20, 23}
    assert answers[3]["source"] == ["by_D"]
    assert answers[4]["source"] == ["by_m"]


def test_toys_change_no_verdict_and_no_number(paper: list[ClaimRun], answers: dict[int, dict[str, Any]]) -> None:
    toys = [_fabricated(name, offset=0.3, **changes) for name, changes in TOYS.items()]
    for claim in plain(assess([*toys[::2], *paper, *toys[1::2]])):
        # how V*, A* and p* rise is asked of every sweep of the paper's size
        assert {*TOYS} - claim["refused"].keys() <= ({"another_end", "another_law"} if claim["id"] == 10 else set())
        assert claim == answers[claim["id"]] | {"refused": claim["refused"]}


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"m": [4]}, "m = 4, needs m >= 8"),
        ({"seeds": 1}, "1 surface of each kind, needs 10"),
        ({"steps": 6}, "6 steps, needs 60"),
        ({"to": "summit-plane"}, "sweep to summit-plane, needs one to mean-plane"),
        ({"law": "variance"}, "midpoint law variance, needs std"),
        ({"D": [2.1, 2.9]}, "D = 2.1, 2.9, needs 2.1, 2.3, 2.5, 2.7, 2.9"),
        ({"rtol": 1e-3}, "residual up to 0.001, needs 1e-06"),
    ],
)
def test_a_run_is_refused_by_name_with_the_reason(changes: dict[str, Any], reason: str) -> None:
    claim = CLAIMS[3](Evidence((_fabricated("toy", **changes),)))
    assert dict(claim.refused) == {"toy": reason}
    assert claim.verdict == ABSENT
    assert "needs" not in claim.lacking  # it names what no run is, not what one run lacks
    assert "m >= 8" in claim.lacking


def test_a_run_whose_cases_are_not_all_there_is_refused() -> None:
    run = _fabricated("half")
    run.dataset["Sq"].loc[{"D": 2.5, "m": 8, "seed": [0, 1, 2]}] = np.nan
    assert dict(CLAIMS[3](Evidence((run,))).refused) == {"half": "7 surfaces of D = 2.5, m = 8 computed, needs 10"}


def test_a_run_without_the_records_is_refused_for_that_alone() -> None:
    run = _fabricated("bare", m=[4])
    assert dict(CLAIMS[12](Evidence((run,))).refused) == {"bare": "no g/σ recorded"}


def test_a_criterion_without_a_value_is_not_a_failed_one() -> None:
    nothing = Number("k", "", math.nan, math.nan, math.nan, 0)
    claim = Claim(1, "", "", "", checks=(Check("a", True), Check("b", False, nothing).tested()))
    assert claim.verdict == ABSENT
    assert '"b"' in claim.untested
