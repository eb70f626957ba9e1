"""The leak card: each part of the error where the truth is known, several surfaces, closed ways, other grids."""

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.analysis.average import average
from roughvol.analysis.closing import Closing, Span
from roughvol.analysis.derived import derived
from roughvol.analysis.leak_budget import card_of, check_reached, grid
from roughvol.analysis.leak_budget.grid import Finer
from roughvol.analysis.leak_budget.state import surfaces_at_load
from roughvol.analysis.leak_budget.window import window_part
from roughvol.analysis.leak_card import Card, Way
from roughvol.analysis.parts import Part
from roughvol.campaign import card as card_runs
from roughvol.campaign import execution
from roughvol.errors import DatasetError, StudyError
from roughvol.observables import coupling
from roughvol.report import card_text
from roughvol.store.card_runs import CardRuns, Pressed
from roughvol.store.dataset import Dataset
from roughvol.study import Level, load, loads, parse
from roughvol.surfaces import Spectrum, power_law_surface, texture
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.treatment import block_means
from tests.analysis.kit import DIMENSIONAL, RUBBER, part_of
from tests.kit import said

TEXT = RUBBER.replace("m: 4, seeds: 2", "m: 5, seeds: 3").replace("steps: 20", "steps: 4") + "solver: {rtol: 1.0e-4}\n"
ONE = TEXT.replace("seeds: 3", "seeds: 1")
PATH = RUBBER.replace("{steps: 20, to: {pressure: 1.2}}", "[LEGS]").replace("E_star: 10 MPa", "MATERIAL")
PATH = PATH.replace("seeds: 2, L: 200 um", "seeds: [1], L: 100 um")
AT = Level("pressure", 0.6)
PARTS = ["solver", "grid", "window", "levelling"]

pytestmark = pytest.mark.usefixtures("small_grids")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> CardRuns:
    return card_runs.compute(loads(TEXT), AT, tmp_path_factory.mktemp("card"), jobs=1)


def _leaks(card: Card, axis: str) -> np.ndarray:
    return np.array([one.leak(axis) for one in card.surfaces])


def test_a_card_has_the_grid_twice_and_four_times_as_coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(card_runs, "FEWEST_NODES", 33)
    plan = card_runs.plan(loads(TEXT.replace("m: 5", "m: 7")), AT)
    assert [one.study.surface.m for one in (plan.fine, *plan.coarser)] == [(7,), (6,), (5,)]
    assert [one.words for one in plan.coarser] == ["twice the spacing", "four times the spacing"]
    assert plan.levelled is None


@pytest.mark.parametrize("sweep", ["{loads: [10 mN, 20 mN]}", "{steps: 2, to: {load: 20 mN}}"])
def test_a_force_on_another_grid_is_the_same_nominal_pressure(sweep: str) -> None:
    """Elements of a free patch reach half a spacing over its sides, so a coarser grid has a larger area."""
    plan = card_runs.plan(loads(ONE.replace("{steps: 4, to: {pressure: 1.2}}", sweep)), parse("load=20 mN"))
    pressures, ends = [], []
    for planned in (plan.fine, *plan.coarser):
        area = (200.0 + 200.0 / 2 ** planned.study.surface.m[0]) ** 2
        pressures.append(float(planned.level.value) / area)
        ends.append(float(planned.study.sweep.legs[0].target.value) / area)
    assert len(pressures) == 3
    assert_allclose(pressures, 20.0 / 206.25**2, rtol=1e-9)
    assert_allclose(ends, pressures, rtol=1e-9)


@pytest.mark.parametrize(("rolloff", "grids"), [(12, 3), (20, 2), (40, 1)])
def test_a_grid_too_coarse_for_the_waves_of_a_surface_is_left_out(rolloff: int, grids: int) -> None:
    text = f"surface: {{H: 0.8, rolloff: {rolloff}, n: 128, seeds: 1}}\nsweep: {{steps: 3, to: {{pressure: 0.6}}}}"
    assert 1 + len(card_runs.plan(loads(text), AT).coarser) == grids


def _pressed(text: str, at: Level, folder: Path) -> Pressed:
    """The run of the finest grid."""
    planned = card_runs.plan(loads(text), at).fine
    return Pressed("", execution.run(planned.study, jobs=1, out=folder), planned.level)


def _of(run: Pressed, dataset: Dataset | None = None) -> Card:
    """The card of one run, or of its dataset with other numbers."""
    return card_of([CardRuns(run if dataset is None else Pressed("", dataset, run.level))], "seal", "")


def _finest(text: str, at: Level, folder: Path) -> Card:
    """The card of the finest grid alone."""
    return _of(_pressed(text, at, folder))


def test_the_part_of_the_solver_holds_the_leak_of_an_exact_solution(tmp_path: Path) -> None:
    tolerances = ("1.0e-2", "1.0e-8")
    rough, exact = (_finest(ONE.replace("1.0e-4", rtol), Level("last"), tmp_path / rtol) for rtol in tolerances)
    for one, truth in zip(rough.ways, exact.ways, strict=True):
        part = part_of(one, "solver")
        assert part.factor > 1.0
        assert 1.0 / part.factor <= truth.leak.value / one.leak.value <= part.factor


@pytest.mark.slow
def test_the_part_of_the_grid_covers_the_median_on_a_finer_one(tmp_path: Path) -> None:
    """Of 12 surfaces in groups of three: at least 9 of 10 medians on the finer grid lie within the part."""
    text = TEXT.replace("m: 5", "m: 6").replace("seeds: 3", "seeds: 12")
    runs = card_runs.compute(loads(text), AT, tmp_path / "card", jobs=1)
    finer = _pressed(text.replace("m: 6", "m: 7"), AT, tmp_path / "finer").dataset
    covered = []
    for group in map(list, list(itertools.combinations(range(12), 3))[::17]):
        for axis, way in _ways_of(runs, group):
            beyond = np.median(finer["flux_at_leak_rate"].sel(axis=axis).isel(seed=group).values)
            covered.append(abs(math.log(beyond / way.leak.value)) <= math.log(part_of(way, "grid").factor))
    assert np.mean(covered) >= 0.9


def _ways_of(runs: CardRuns, seeds: Sequence[int]) -> Iterator[tuple[str, Way]]:
    """The axes and ways of a card of some surfaces of a run."""
    one, *others = (Pressed(run.words, run.dataset.isel(seed=seeds), run.level) for run in (runs.fine, *runs.coarser))
    return zip("xy", card_of([CardRuns(one, tuple(others))], "s", "").ways, strict=True)


def test_the_grid_of_a_median_is_that_of_its_surfaces_together(runs: CardRuns) -> None:
    """The leak of each surface reaches no farther than twice its largest change from a coarser grid, as a logarithm."""
    grids = (runs.fine, *runs.coarser)
    fine, *others = (one.dataset.flux_at_leak_rate.sel(axis="y").values.ravel() for one in grids)
    change = np.exp(2.0 * np.abs(np.diff(np.log([fine, *others]), axis=0)).max(axis=0))
    part = part_of(card_of([runs], "s", "").ways[1], "grid")
    assert 1.0 < part.factor <= np.median(fine * change) / np.median(fine) * (1 + 1e-9)
    assert 1.0 < part.smaller <= np.median(fine) / np.median(fine / change) * (1 + 1e-9)


class _Fixed:
    """A surface with a leak, and with leaks of a joint whose loads are all larger or smaller."""

    def __init__(self, leak: float, ends: tuple[float, float] = (math.nan, math.nan)) -> None:
        self._leak, self._ends = leak, ends

    def leak(self, axis: str) -> float:
        return self._leak

    def leak_if(self, axis: str, log: float) -> float:
        return self._ends[int(log > 0.0)]

    def unit(self) -> str:
        return ""


@pytest.mark.parametrize(
    ("ends", "leaks", "factor"),
    [
        ((0.01, 100.0), (0.9, 0.45), 4.0),  # (1/2)^2 from four times the spacing to twice; from twice it is 0.9^2
        ((0.01, 100.0), (0.5, 0.45), 4.0),
        ((0.5, 2.0), (0.9, 0.45), 2.0),  # the loads alone
        ((0.01, 100.0), (0.9, 0.0), 100.0),  # closed there: no change bounds the leak
        ((0.01, 100.0), (0.9,), 0.9**-2),
        ((math.nan, math.nan), (0.9, 0.0), 0.9**-2),  # as under fluid pressure: the change is all that is known
    ],
)
def test_the_larger_change_from_a_coarser_grid_bounds_the_leak(
    ends: tuple[float, float], leaks: Sequence[float], factor: float
) -> None:
    coarser: Any = [("a coarser grid", [_Fixed(leak)]) for leak in leaks]
    fine: Any = [_Fixed(1.0, ends)]
    part = grid.grid_part(fine, coarser, [Finer(0.1, 0.1)], "x")
    assert_allclose((part.factor, part.smaller), factor, rtol=1e-12)


def test_the_window_is_the_interval_of_the_median_over_surfaces(runs: CardRuns) -> None:
    card = card_of([runs], "s", "")
    values = np.log(_leaks(card, "y"))
    half = 4.302653 * values.std(ddof=1) / math.sqrt(3) * math.sqrt(math.pi / 2)
    assert_allclose(math.log(part_of(card.ways[1], "window").factor), half, rtol=1e-6)


VARIED = TEXT.replace(", Sq: 0.4 um", "").replace("steps: 4, to: {pressure: 1.2}", "steps: 5, to: percolation")
SMALL = VARIED.replace("m: 5", "m: 4")


@pytest.mark.parametrize(
    ("kind", "end", "words"),
    [
        ("pressure", "{pressure: 0.5}", "pressure=99: 99 is not reached: the sweep ends at pressure 0.5"),
        ("indentation", "mean-plane", "the sweep has no state at indentation=99: its steps have indentation Δ/σ = 0"),
    ],
)
def test_a_load_that_no_surface_reaches_is_refused(kind: str, end: str, words: str, tmp_path: Path) -> None:
    text = SMALL.replace("to: percolation", f"to: {end}")
    with pytest.raises((StudyError, DatasetError), match=words) as refused:
        card_runs.compute(loads(text), Level(kind, 99.0), tmp_path, jobs=1, accept=check_reached)
    assert str(refused.value).count("99") <= 2
    assert not list(tmp_path.glob("**/twice*"))  # nothing is computed for other grids


def test_a_load_before_the_first_step_is_the_state_solved_for_it(tmp_path: Path) -> None:
    text = SMALL.replace("seeds: 3", "seeds: 1").replace("{steps: 5, to: percolation}", "{pressures: [0.5, 1.0]}")
    for way in _finest(text, Level("pressure", 0.2), tmp_path / "early").ways:
        assert_allclose(way.leak.value, _leak_of(text, 0.2, way.axis, tmp_path / "step"), rtol=1e-3)


def test_a_periodic_surface_is_certified_with_its_ways_across_the_edge(tmp_path: Path) -> None:
    text = VARIED.replace("seeds: 3", "seeds: [2], sides: periodic").replace("to: percolation", "to: {pressure: 3.0}")
    way = _finest(text, Level("last"), tmp_path).ways[0]  # its only way along x passes the edge
    assert 1.0 < part_of(way, "solver").factor < 1.01


# parts together


@pytest.mark.parametrize(
    ("factors", "high", "low"),
    [
        ([(2.0, None), (3.0, None)], math.hypot(math.log(2), math.log(3)), None),  # in squares of their logarithms
        ([(4.0, 1.1), (2.0, None), (1.5, math.inf)], math.hypot(math.log(4), math.log(2), math.log(1.5)), math.inf),
        ([(2.0, None), (math.nan, None)], math.nan, None),
        ([(2.0, None), (math.inf, None)], math.nan, None),
    ],
    ids=["squares", "farther up than down", "not known", "without end"],
)
def test_parts_add_in_squares(factors: list[tuple[float, float | None]], high: float, low: float | None) -> None:
    parts = tuple(Part("", up, "", *([] if down is None else [down])) for up, down in factors)
    way = Way("x", average("leak_rate", 1.0), 1, "", Closing((), ""), (), "", parts)
    assert_allclose(math.log(way.factor), high)
    assert_allclose(way.interval, (math.exp(-(high if low is None else low)), math.exp(high)))


def test_the_bracket_of_several_surfaces_is_known_if_all_close() -> None:
    one, other, still = Span(1.0, 2.0), Span(2.0, 4.0), Span(3.0, math.inf)
    assert Closing((one, other), "MPa").bracket == (1.5, 3.0)
    assert all(map(math.isnan, Closing((one, still), "MPa").bracket))
    assert Closing((one,), "MPa").words == "between 1 and 2 MPa"
    several = "between 1.5 and 3 MPa in the mean; the first surface above 1 MPa, the last below 4 MPa"
    assert Closing((one, other), "MPa").words == several
    early, late = Span(1.0, 1.0), Span(3.0, 3.0)
    some = Closing((early, late, still), "MPa")
    assert some.words == "at 2 MPa on 2 of 3 surfaces, open up to 3 MPa on the others"
    way = Way("x", average("leak_rate", 1.0), 3, "", some, (), "", ())
    assert card_text.tight(way, legs=True) == f"on leg 1 closed {some.words}"
    assert math.isnan(Closing((early, still), "MPa").value)
    assert "p* = 2 in the mean" in Closing((early, late), "").words
    solved = Closing((Span(2.0, 2.0),), "MPa", (Part("grid", 2.0, "", 1.25), Part("window", 1.0, "")))
    assert solved.interval == (1.6, 4.0)
    assert solved.words == "at 2 MPa, between 1.6 and 4 MPa"
    unknown = replace(solved, parts=(Part("grid", 2.0, ""), Part("window", math.inf, "")))
    assert unknown.words == "at 2 MPa, its error is not known (window)"


# other grids


def _leak_of(text: str, pressure: float, axis: str, folder: Path) -> float:
    """The leak of a state that is solved for it."""
    text = re.sub("sweep: .*", f"sweep: {{pressures: [{pressure}]}}", text)
    return float(execution.run(loads(text), jobs=1, out=folder).leak_rate.sel(axis=axis).item())


def test_a_coarser_grid_that_closes_before_the_load_leaves_the_part_of_the_closing_load(tmp_path: Path) -> None:
    """Of this surface the way along x closes at p* = 2.50, on the coarser grid at 1.92.

    Every load may be larger on a finer grid: the leak is then that at a lighter load.
    """
    text = VARIED.replace("seeds: 3", "seeds: [1]").replace("steps: 5", "steps: 16")
    runs = card_runs.compute(loads(text), Level("pressure", 2.25), tmp_path, jobs=1)
    along_x, along_y = card_of([runs], "s", "").ways
    assert along_x.leak.value > 0.0
    assert "twice the spacing: closed" in part_of(along_x, "grid").words
    of_load = part_of(along_x.closing, "grid")
    scatter, slopes = math.log(of_load.smaller), math.log(of_load.factor / of_load.smaller)
    assert slopes > scatter > 0.0
    octaves = grid.OCTAVES / (grid.OCTAVES + grid.PIXEL)
    rise = math.exp(grid.OPEN * scatter + octaves * slopes)
    lighter = _leak_of(text, 2.25 / rise, "x", tmp_path / "lighter")
    assert_allclose(part_of(along_x, "grid").factor, lighter / along_x.leak.value, rtol=0.05)
    assert part_of(along_x, "grid").smaller == math.inf  # it closes at a load a little larger
    assert along_x.interval[0] == 0.0
    assert along_x.coarser[0][1].closed
    assert part_of(along_y, "grid").known


@pytest.mark.parametrize("D", [2.3, 2.5, 2.7])
def test_slopes_below_the_map_grow_with_the_fractal_dimension(D: float) -> None:
    """By (D - 2) ln 2 in an octave, of means over pixels; slopes of heights at points grow no less."""
    grown = {"averaged": list[float](), "decimated": list[float]()}
    for seed in range(4):
        heights = random_midpoint_displacement(D, 9, seed=seed).heights
        for sampled, map_ in (("averaged", block_means(heights, 4)), ("decimated", heights[::4, ::4])):
            grown[sampled].append(_finer_than(map_).growth)
    assert_allclose(np.mean(grown["averaged"]), (D - 2.0) * math.log(2.0), atol=0.05)
    assert np.mean(grown["decimated"]) > np.mean(grown["averaged"])


def test_slopes_do_not_grow_below_a_map_that_is_smooth_at_its_spacing() -> None:
    waves = power_law_surface(Spectrum(rolloff=4, cut=16), 0.8, 128, seed=1).heights
    smooth = _finer_than(waves)
    assert smooth.growth == 0.0
    assert smooth.of_closing == (smooth.scatter, smooth.scatter)
    assert "ends before it" in grid._finer_words([smooth])
    assert "roughness below the spacing counts" in grid._finer_words([Finer(0.5, 0.1)])


def _finer_than(heights: np.ndarray) -> Finer:
    """Return what a finer grid may change, of surfaces that close at one load on every grid."""
    grids = []
    for factor in (1, 2, 4):
        slope = texture.Sdq(block_means(heights, factor), float(factor))
        closing = Closing((Span(1.0, 1.0),), "")
        grids.append(SimpleNamespace(number={"Sdq": slope}.__getitem__, closing={"x": closing, "y": closing}))
    one, *others = grids
    return Finer.of(one, others)


def test_a_closed_way_leaks_at_most_what_it_does_at_the_far_end_of_its_closing_load(tmp_path: Path) -> None:
    text = VARIED.replace("seeds: 3", "seeds: [0]").replace("steps: 5", "steps: 8")
    runs = card_runs.compute(loads(text), Level("last"), tmp_path, jobs=1)
    for way in (card := card_of([runs], "s", "")).ways:
        assert way.leak.value == 0.0
        assert way.open == 0
        assert way.parts == way.closing.parts
        low, high = way.closing.interval
        assert low < way.closing.value < high
        at = card.surfaces[0].number("mean_pressure")
        lighter = _leak_of(text, at * way.closing.value / high, way.axis, tmp_path / way.axis)
        assert way.interval == (0.0, pytest.approx(lighter, rel=0.05))
        middles = [closing.value for closing in (way.closing, *(closing for _, closing in way.coarser))]
        words = part_of(way, "grid").words
        assert ("a finer grid the way may be open" in words) == (sorted(middles, reverse=True) == middles)
        assert "at the last open step" in way.last_open
        assert "leak at most" in part_of(way, "solver").words


def test_a_surface_that_closed_before_a_force_has_its_pressure(tmp_path: Path) -> None:
    text = ONE.replace("{steps: 4, to: {pressure: 1.2}}", "{steps: 3, to: percolation}")
    ds = _pressed(text, Level("last"), tmp_path).dataset
    for at in ("pressure=5 MPa", f"load={5.0 * 206.25**2} uN"):
        (surface,) = surfaces_at_load(Pressed("", ds, parse(at)))
        assert surface.leak("x") == 0.0
        assert surface.load == pytest.approx(5.0)


def test_a_part_of_the_closing_load_that_is_not_known_leaves_a_closed_way_without_a_bound(tmp_path: Path) -> None:
    text = SMALL.replace("seeds: 3", "seeds: [0]")  # 17 nodes have no coarser grid
    for way in _finest(text, Level("last"), tmp_path).ways:
        assert way.leak.value == 0.0
        assert all(map(math.isnan, (*way.interval, *way.closing.interval)))


@pytest.mark.slow
def test_the_closing_load_of_a_surface_4_times_finer_lies_in_the_interval(tmp_path: Path) -> None:
    """Of 6 surfaces: at least 10 of 12 ways, without the part of the window."""
    text = VARIED.replace("m: 5", "m: 6").replace("seeds: 3", "seeds: 6").replace("steps: 5", "steps: 8")
    runs = card_runs.compute(loads(text), AT, tmp_path / "card", jobs=1)
    like_coarser = card_runs.plan(loads(text), AT).coarser[0].study.changed(**{"surface.m": 8})
    finer = execution.run(like_coarser, jobs=1, out=tmp_path / "finer")
    held = []
    for seed in range(6):
        for axis, way in _ways_of(runs, [seed]):
            part = part_of(way.closing, "grid")
            truth = finer["closing_pressure"].sel(axis=axis).isel(seed=seed).item()
            own = runs.fine.dataset["closing_pressure"].sel(axis=axis).isel(seed=seed).item()
            held.append(1.0 / part.smaller <= truth / own <= part.factor)
    assert sum(held) >= 10


def test_the_accuracy_of_the_flows_is_in_the_part_of_the_solver(tmp_path: Path) -> None:
    """Without a key of the study the flows of a card are solved to 1e-3."""
    run = _pressed(ONE.replace("m: 5", "m: 4"), Level("last"), tmp_path)
    exact = ONE.replace("{transmissivity: every-step}", "{transmissivity: every-step, accuracy: 1e-9}")
    for text, accuracy in ((ONE, 1e-3), (exact, 1e-9)):
        assert card_runs.plan(loads(text), Level("last")).fine.study.record.transport.accuracy == accuracy
    rough = run.dataset.assign(transmissivity_error=run.dataset.transmissivity_error + 0.01)
    one, other = (_of(run, ds).ways[0] for ds in (run.dataset, rough))
    own = float(run.dataset.transmissivity_error.max())
    more = part_of(other, "solver").factor / part_of(one, "solver").factor
    assert_allclose(more, (1.01 + own) / (1.0 + own), rtol=1e-9)


@pytest.fixture
def _grids_of_8(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a map of 17 nodes have a grid of twice its spacing."""
    monkeypatch.setattr(card_runs, "FEWEST_NODES", 8)


@pytest.mark.usefixtures("_grids_of_8")
def test_a_card_of_a_file_has_levelling_and_quadrants_at_one_nominal_pressure(tmp_path: Path) -> None:
    heights = random_midpoint_displacement(2.2, 4, side=100.0, seed=5).heights
    tilted = heights / heights.std() * 0.4 + np.linspace(0, 0.3, 17)
    np.savetxt(tmp_path / "scan.txt", tilted, header="heights in um")
    text = TEXT.replace("{D: 2.2, m: 5, seeds: 3, L: 200 um, Sq: 0.4 um}", "{file: scan.txt, L: 200 um, level: tilt}")
    (tmp_path / "s.yaml").write_text(text)
    made = card_runs.compute(load(tmp_path / "s.yaml"), AT, tmp_path / "card", jobs=1)
    assert made.levelled.words == "level: quadratic at twice the spacing"
    every = [made.fine, *made.coarser, made.levelled]
    nominal = [run.dataset.flux_at_mean_pressure.item() * run.dataset.Sq.item() / run.dataset.L.item() for run in every]
    assert_allclose(nominal, nominal[0], rtol=1e-4)
    way = card_of([made], "scan", "").ways[0]
    assert [part.name for part in way.parts] == PARTS
    assert "quadrants of the map" in part_of(way, "window").words


def test_another_levelling_that_cannot_be_computed_has_its_reason(tmp_path: Path) -> None:
    """Less a quadratic, the map scatters so little that its spikes are too many outliers."""
    bow = np.linspace(-1.0, 1.0, 16)[:, np.newaxis] ** 2
    heights = 3.0 * bow + 0.01 * np.random.default_rng(0).normal(size=(16, 16))
    heights[::3, ::4] += 0.3
    np.savetxt(tmp_path / "scan.txt", heights, header="heights in um")
    surface = "{file: scan.txt, L: 200 um, level: tilt, outliers: {sigma: 6}}"
    study = loads(re.sub("surface: .*", f"surface: {surface}", TEXT), file=tmp_path / "s.yaml")
    made = card_runs.compute(study, AT, tmp_path / "card", jobs=1)
    part = part_of(card_of([made], "scan", "").ways[0], "levelling")
    assert (part.known, "not computed: " in part.words, "9.4%, lie farther" in part.words) == (False, True, True)


@pytest.mark.usefixtures("_grids_of_8")
def test_a_card_without_units_has_the_budget_of_the_same_map_with_units(tmp_path: Path) -> None:
    """L of block means is that of other nodes, so closing loads are compared as p* Sq/L."""
    heights = random_midpoint_displacement(2.2, 4, seed=5).heights
    np.save(tmp_path / "scan.npy", 0.4 * heights / heights.std())
    text = TEXT.replace("D: 2.2, m: 5, seeds: 3, L: 200 um, Sq: 0.4 um", "file: scan.npy, L: 200 um")
    text = text.replace("steps: 4", "steps: 2")
    plain = text.replace(" um", "").replace("10 MPa", "10.0").replace(f", {DIMENSIONAL}", "")
    ways = []
    for name, study in (("units", text), ("plain", plain)):
        made = card_runs.compute(loads(study, file=tmp_path / "s.yaml"), AT, tmp_path / name, jobs=1)
        ways.append(card_of([made], "scan", "").ways)
    for one, other in zip(*ways, strict=True):
        assert (one.unit, other.unit) == ("mm^3/s", "")
        loads_of = [[coarser.value / way.closing.value for _, coarser in way.coarser] for way in (one, other)]
        assert_allclose(*loads_of, rtol=1e-6)
        for name in PARTS:
            assert_allclose(part_of(one, name).factor, part_of(other, name).factor, rtol=1e-6)


# loads


@pytest.mark.parametrize(("text", "kind"), [("mean_gap=600 nm", "free_volume"), ("separation=0.6 um", "separation")])
def test_a_load_may_have_a_unit(text: str, kind: str, tmp_path: Path) -> None:
    found = _pressed(RUBBER.replace("steps: 20", "steps: 2"), parse(text), tmp_path).dataset[f"flux_at_{kind}"]
    assert_allclose(found, 1.5, rtol=1e-5)  # Sq is 0.4 um


def test_each_leg_of_a_path_has_its_own_leak(tmp_path: Path) -> None:
    text = PATH.replace("MATERIAL", "E: 200 GPa, nu: 0.3, hardness: 5 GPa")
    text = text.replace("LEGS", "{steps: 2, to: {pressure: 1.0}}, {steps: 2, to: {pressure: 0.1}}")
    leaks = {}
    for at in ("pressure=0.5", "pressure=0.5, leg 2", "last, leg 1"):
        run = _pressed(text, parse(at), tmp_path)
        way = _of(run).ways[0]
        leaks[at] = way.leak.value
        assert part_of(way, "solver").known
    assert leaks["pressure=0.5, leg 2"] < 0.9 * leaks["pressure=0.5"]  # yield keeps the surfaces nearer


def test_an_unloaded_surface_has_no_load(tmp_path: Path) -> None:
    text = PATH.replace("MATERIAL", "E_star: 10 MPa, hardness: 1 MPa").replace("m: 4", "m: 5, sides: mirrored")
    text = text.replace("LEGS", "{steps: 2, to: {pressure: 1.0}}, {steps: 2, to: {pressure: 0}}")
    run = _pressed(text, parse("last, leg 2"), tmp_path)
    rounded = run.dataset.copy(deep=True)
    rounded["mean_pressure"][{"step": -1}] = 1e-17
    assert derived(rounded, None)["mean_pressure"].isel(step=-1) == 0.0
    assert card_text.load_of(_of(run, rounded)).startswith("0 MPa (p* = 0) on leg")


def test_a_step_beside_the_load_of_a_card_changes_no_error(tmp_path: Path) -> None:
    """The search for a listed pressure ends within 1e-5 of it, and the state of the card is solved once more."""
    text = ONE.replace("200 um", "100 um").replace("steps: 4, to: {pressure: 1.2}", "pressures: [0.3, 0.6, 0.9, 1.2]")
    run = _pressed(text, AT, tmp_path)
    parts = []
    for share in (0.0, 3e-7, -3e-7):
        loads_of_steps = {name: run.dataset[name].copy() for name in ("mean_pressure", "nominal_pressure")}
        for pressure in loads_of_steps.values():
            pressure[{"step": 1}] *= 1.0 + share
        window = part_of(_of(run, run.dataset.assign(loads_of_steps)).ways[0], "window")
        parts.append((window.factor, window.smaller))
    for beside in parts[1:]:
        assert_allclose(beside, parts[0], rtol=1e-3)


def test_elastic_contact_has_the_same_errors_on_every_leg(tmp_path: Path) -> None:
    legs = "{steps: 4, to: {pressure: 1.0}}, {steps: 4, to: {pressure: 0.1}}, {steps: 2, to: {pressure: 2.0}}"
    text = PATH.replace("MATERIAL", "E_star: 10 MPa").replace("LEGS", legs)
    windows = []
    for leg in (1, 2, 3):
        card = _of(_pressed(text, parse(f"pressure=0.5, leg {leg}"), tmp_path))
        assert f"on leg {leg}" in card_text.load_of(card)
        windows.append(part_of(card.ways[0], "window"))
    for window in windows[1:]:
        assert_allclose([window.factor, window.smaller], [windows[0].factor, windows[0].smaller], rtol=1e-2)


# fluid pressure

LIFT = """name: lift
surface: {D: 2.2, m: 5, L: 200 um, Sq: 0.5 um, seeds: [1], sides: periodic}
material: {E_star: 10 MPa}
sweep: {steps: 2, to: {pressure: 0.1 MPa}}
record:
  transport: {transmissivity: every-step}
  fluid_pressure: {inlet: 0.5 bar, outlet: 0 bar, at: last}
  dimensional: {pressure: MPa, leak_rate: {pressure_drop: 0.5 bar, viscosity: 1 mPa*s, unit: mm^3/s}}
"""


@pytest.fixture(scope="module")
def lifted(tmp_path_factory: pytest.TempPathFactory) -> CardRuns:
    return card_runs.compute(loads(LIFT), parse("pressure=0.08 MPa"), tmp_path_factory.mktemp("lift"), jobs=1)


def test_under_fluid_pressure_every_run_has_the_leak_of_the_lifted_gap(lifted: CardRuns) -> None:
    fine = lifted.fine.dataset
    card = card_of([lifted], "lift", "")
    assert card.lifted
    for axis, way in zip("xy", card.ways, strict=True):
        assert_allclose(way.leak.value, fine["fluid_leak_rate"].sel(axis=axis).item(), rtol=1e-12)
        assert way.leak.value > 1.5 * fine["flux_at_leak_rate"].sel(axis=axis).item()
        dry = next(beside for beside in card.beside if "without fluid pressure" in beside.words)
        assert_allclose(dry.leaks["xy".index(axis)].value, fine["flux_at_leak_rate"].sel(axis=axis).item(), rtol=1e-12)
        coarse = lifted.coarser[0].dataset["fluid_leak_rate"].sel(axis=axis).item()
        assert f"twice the spacing: × {coarse / way.leak.value:.4g}" in part_of(way, "grid").words
        assert all(part.known for part in way.parts)
        assert not part_of(way, "solver").words.startswith("certified")
    assert card.plain()["ways"][0]["closing_pressure"] is None  # known of the dry gap alone


def test_the_window_under_fluid_pressure_is_that_of_the_lifted_gap(lifted: CardRuns) -> None:
    dry = lifted.fine.dataset.copy()
    dry["fluid_gap"] = dry["gap"].rename(field_at="fluid_at").broadcast_like(dry["fluid_gap"])
    one, other = (part_of(_of(lifted.fine, ds).ways[0], "window").factor for ds in (lifted.fine.dataset, dry))
    assert math.isfinite(one)
    assert one != other


def test_the_part_of_the_solver_under_fluid_pressure_holds_an_exact_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text, at = LIFT.replace("m: 5", "m: 6"), parse("pressure=0.08 MPa")
    card = _finest(text, at, tmp_path / "card")
    monkeypatch.setattr(coupling, "ACCURACY", 1e-7)
    monkeypatch.setattr(coupling, "ROUNDS", 100)
    state = text.replace("{steps: 2, to: {pressure: 0.1 MPa}}", "{pressures: [0.08 MPa]}")
    truth = execution.run(loads(state + "solver: {rtol: 1.0e-9}\n"), jobs=1, out=tmp_path / "exact")
    for axis, way in zip("xy", card.ways, strict=True):
        off = abs(math.log(truth["fluid_leak_rate"].sel(axis=axis).item() / way.leak.value))
        part = part_of(way, "solver")
        assert part.words.endswith("; flows to 1e-03")
        assert off <= math.log(part.factor / 1.001)  # a small grid is factorised: its flow has no error


def test_the_part_of_the_solver_under_fluid_pressure_follows_the_longer_side(here: Path) -> None:
    heights, at = random_midpoint_displacement(2.2, 4, seed=7).heights[:9], parse("pressure=0.08 MPa")
    cards = []
    for name, z, length in (("wide", heights, "100 um"), ("tall", heights.T, "200 um")):
        np.save(f"{name}.npy", 0.5 * z / z.std())  # µm
        surface = f"{{file: {name}.npy, L: {length}, heights_unit: um, sides: mirrored}}"
        text = LIFT.replace("{D: 2.2, m: 5, L: 200 um, Sq: 0.5 um, seeds: [1], sides: periodic}", surface)
        cards.append(_finest(text, at, here / name))
    for wide, tall in zip(cards[0].ways, reversed(cards[1].ways), strict=True):
        assert_allclose(wide.leak.value, tall.leak.value, rtol=1e-3)
        factors = [part_of(way, "solver").factor for way in (wide, tall)]
        assert_allclose(np.log(factors[0] / 1.001), np.log(factors[1] / 1.001), rtol=0.1)  # of gains from rounds


@pytest.mark.usefixtures("_grids_of_8")
def test_a_fluid_pressure_without_units_keeps_its_nominal_value_on_other_grids(tmp_path: Path) -> None:
    heights = random_midpoint_displacement(2.2, 4, side=100.0, seed=5).heights
    np.save(tmp_path / "scan.npy", heights)
    (tmp_path / "s.yaml").write_text(
        "surface: {file: scan.npy, L: 100, level: tilt}\nsweep: {steps: 1, to: {pressure: 1.0}}\n"
        "record: {fluid_pressure: {inlet: 0.2, at: last}}\n"
    )
    runs = card_runs.compute(load(tmp_path / "s.yaml"), Level("last"), tmp_path / "card", jobs=1)
    every = [run.dataset for run in (runs.fine, *runs.coarser, runs.levelled)]
    inlets = [(ds.fluid_at_inlet * ds.Sq / ds.L).item() for ds in every]
    assert_allclose(inlets, inlets[0], rtol=1e-9)
    card = card_of([runs], "", "")
    assert_allclose(card.ways[0].leak.value, runs.fine.dataset.fluid_leak.sel(axis="x").item(), rtol=1e-12)


# the curve of a leak


def test_the_load_of_a_leak_is_the_inverse_of_the_leak_at_a_load(runs: CardRuns) -> None:
    for one in surfaces_at_load(runs.fine):
        for axis in "xy":
            closes = one.closing[axis].value
            for share in (0.01, 0.2, 0.5, 0.9):  # before the first step, between steps, and beyond the last
                leak = one.leak_at(axis, share * closes)
                assert leak > 0.0
                assert_allclose(one.load_at(axis, leak), share * closes, rtol=1e-6)
            assert one.leak_at(axis, closes) == 0.0
            assert one.load_at(axis, 0.0) == closes
            assert_allclose(one.leak_if(axis, 0.0), one.leak(axis), rtol=1e-12)


def test_the_window_of_a_map_with_a_closed_quadrant_ends_at_its_closing_load(tmp_path: Path) -> None:
    """A quadrant that is closed, or nearly, counts as the closing load: it does not widen the part without end."""
    run = _pressed(TEXT.replace("seeds: 3", "seeds: [1]"), Level("last"), tmp_path)
    factors = []
    for share in (1.0, 1e-60, 0.0):
        flows = run.dataset["quadrant_flow"].copy()
        flows[{"quadrant": 0}] *= share
        way = _of(run, run.dataset.assign(quadrant_flow=flows)).ways[0]
        factors.append(part_of(way.closing, "window").factor)
    assert_allclose(factors[1], factors[2], rtol=1e-6)
    assert 1.0 < factors[0] < math.inf
    assert factors[2] < math.inf
    window = part_of(_of(run, run.dataset.drop_vars("quadrant_flow")).ways[0].closing, "window")
    assert (window.known, window.words) == (False, "the flows of its quadrants are not stored")


# where the truth is known


def test_quadrants_of_one_map_hold_the_mean_of_the_ensemble(tmp_path: Path) -> None:
    surface = "{H: 0.8, rolloff: 6, n: 32, seeds: 8, L: 200 um, Sq: 0.4 um}"
    text = re.sub("surface: .*", f"surface: {surface}", TEXT).replace("steps: 4", "steps: 2")
    fine = execution.run(card_runs.plan(loads(text), AT).fine.study, jobs=1, out=tmp_path)
    every = list(surfaces_at_load(Pressed("", fine, AT)))
    for axis in "xy":
        logs = np.log([one.leak(axis) for one in every])
        factors = [math.log(window_part([one], axis).factor) for one in every]
        covered = np.abs(logs - logs.mean()) <= factors
        assert np.mean(covered) >= 0.75  # 95 % of the intervals, with few surfaces to count


def test_another_levelling_covers_the_leak_of_the_map_without_its_form(tmp_path: Path) -> None:
    heights = random_midpoint_displacement(2.2, 4, side=200.0, seed=4).heights
    x = np.linspace(-1.0, 1.0, heights.shape[0])
    flat = _levelled(0.4 * heights / heights.std())
    np.savetxt(tmp_path / "flat.txt", flat, header="heights in um")
    np.savetxt(tmp_path / "bowed.txt", flat + 0.3 * x[:, None] ** 2, header="heights in um")
    leak = {}
    for name, level in (("flat", "none"), ("bowed", "tilt")):
        text = re.sub("surface: .*", f"surface: {{file: {name}.txt, L: 200 um, level: {level}}}", TEXT)
        text = text.replace("steps: 4, to: {pressure: 1.2}", "steps: 3, to: {pressure: 0.01 MPa}")
        (tmp_path / f"{name}.yaml").write_text(text)
        study, at = load(tmp_path / f"{name}.yaml"), parse("pressure=0.01 MPa")
        leak[name] = card_of([card_runs.compute(study, at, tmp_path / name, jobs=1)], name, "")
    for truth, bowed in zip(leak["flat"].ways, leak["bowed"].ways, strict=True):
        factor = part_of(bowed, "levelling").factor
        assert factor > 1.02
        off = abs(math.log(truth.leak.value / bowed.leak.value))
        assert_allclose(off, math.log(factor), rtol=1e-3)  # quadratic: the truth


def _levelled(heights: np.ndarray) -> np.ndarray:
    """Heights less the quadratic surface through them."""
    x = np.linspace(-1.0, 1.0, heights.shape[0])
    u, v = (axis.ravel() for axis in np.meshgrid(x, x, indexing="ij"))
    terms = np.stack([np.ones(u.size), u, v, u * u, u * v, v * v], axis=1)
    fit = terms @ np.linalg.lstsq(terms, heights.ravel(), rcond=None)[0]
    return heights - fit.reshape(heights.shape)


def test_a_card_from_the_file_of_an_instrument(here: Path) -> None:
    topography = pytest.importorskip("SurfaceTopography", reason="needs the extra roughvol[measured]")
    heights = random_midpoint_displacement(2.2, 4, side=200.0, seed=11).heights
    heights = 0.8 * heights / heights.std() + 0.02 * np.arange(17)[:, None]
    holes = np.random.default_rng(0).random(heights.shape) < 0.02
    scan = topography.Topography(np.ma.masked_array(heights, holes), (17 * 7.8125, 17 * 7.8125), unit="µm")
    scan.to_x3p("scan.x3p")
    text = re.sub("surface: .*", "surface: {file: scan.x3p, level: tilt, missing: interpolate, unit: um}", TEXT)
    Path("seal.yaml").write_text(text.replace("steps: 4, to: {pressure: 1.2}", "steps: 2, to: {pressure: 0.05 MPa}"))
    printed = said("card", "seal.yaml", "--at", "pressure=0.03 MPa", "--jobs", "1")
    for row in (
        r"Load +0\.03 MPa",
        r"Surface +scan\.x3p, Sq ",
        "\n  solver ",
        "\n  grid ",
        "\n  window ",
        "\n  levelling ",
    ):
        assert re.search(row, printed)
    assert Path("runs/seal_card/card_pressure=0.03_MPa.pdf").stat().st_size > 1_000
