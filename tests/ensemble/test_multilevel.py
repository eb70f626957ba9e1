"""Means from several levels: closed forms, plain Monte Carlo, and honest intervals with few samples."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.ensemble import multilevel
from roughvol.ensemble.multilevel import Mean, chain, correlation, links_of
from tests.ensemble.kit import best_linear

RHO = 0.95
RUNS = 400  # of an estimator
COVARIANCE = np.array([[1.0, RHO * 2.0], [RHO * 2.0, 4.0]])  # of a coarse and a fine level
MARKOV = np.array([0.9, 0.97, 0.99])  # correlations of adjacent levels, each level a noisy copy of the one before


def plain(values: np.ndarray) -> Mean:
    """Return the plain mean, a chain of one level."""
    return chain([values], [0])


def _nested(counts: list[int], seed: int, slope: float = 1.0, mean: float = 3.0) -> list[np.ndarray]:
    """Levels of which each is a slope times the coarser one plus noise, of variance 1 times the slopes squared."""
    random = np.random.default_rng(seed)
    levels = [random.standard_normal(counts[0])]
    for rho in MARKOV[: len(counts) - 1]:
        levels.append(rho * levels[-1] + math.sqrt(1.0 - rho**2) * random.standard_normal(counts[0]))
    return [slope**k * (mean + each[:n]) for k, (each, n) in enumerate(zip(levels, counts, strict=True))]


def test_the_plain_mean_has_students_interval() -> None:
    found = plain(np.array([1.0, 2.0, 3.0, 6.0]))
    assert_allclose([found.value, found.variance, found.freedom], [3.0, 14.0 / 3.0 / 4.0, 3.0])
    assert_allclose(found.half_width, 3.182446305 * math.sqrt(14.0 / 12.0))


def test_the_best_linear_estimate_of_two_levels_is_the_control_variate() -> None:
    """With n pairs and N more coarse samples the variance is s²/n (1 - ρ² N/(n + N)), a closed form."""
    random, n, more = np.random.default_rng(2), 20, 300
    pairs = random.multivariate_normal([1.0, 2.0], COVARIANCE, n)
    coarse = random.normal(1.0, 1.0, (more, 1))
    means, spread = best_linear([((0, 1), pairs), ((0,), coarse)], COVARIANCE)
    assert_allclose(spread[1, 1], 4.0 / n * (1.0 - RHO**2 * more / (n + more)))
    slope = COVARIANCE[0, 1] / COVARIANCE[0, 0]
    everything = np.concatenate([pairs[:, 0], coarse[:, 0]]).mean()
    assert_allclose(means[1], pairs[:, 1].mean() + slope * (everything - pairs[:, 0].mean()))
    assert_allclose(means[0], everything)


def test_a_chain_is_the_best_linear_estimate_with_the_covariance_of_the_samples() -> None:
    """For each level a noisy copy of the next coarser one, no other weights do better (Anderson 1957)."""
    values = _nested([4000, 900, 200, 60], seed=3)
    found = chain(values, range(4))
    covariance = np.empty((4, 4))
    for a in range(4):
        for b in range(4):
            covariance[a, b] = np.prod(MARKOV[min(a, b) : max(a, b)])
    counts = [each.size for each in values] + [0]
    groups = [
        (range(level + 1), np.stack([each[counts[level + 1] : counts[level]] for each in values[: level + 1]], axis=1))
        for level in range(4)
    ]
    means, spread = best_linear(groups, covariance)
    assert abs(found.value - means[3]) < math.sqrt(spread[3, 3])
    assert_allclose(found.variance, spread[3, 3], rtol=0.3)


def _covered(found: list[Mean], mean: float) -> float:
    """Share of intervals that contain a mean, of estimates without a bias."""
    errors = np.array([each.value - mean for each in found])
    assert abs(errors.mean()) < 4.0 * errors.std() / math.sqrt(len(found))
    return float(np.mean(np.abs(errors) <= [each.half_width for each in found]))


@pytest.mark.parametrize(("counts", "slope"), [([300, 60, 20, 3], 1.0), ([40, 12], 1.0), ([300, 60, 20, 10], 0.5)])
def test_intervals_of_chains_cover_the_mean(counts: list[int], slope: float) -> None:
    """Also with three samples on the finest level, whose own variance is often far too small.

    Residuals that shrink fourfold from level to level are pooled with larger ones: intervals are then too wide.
    """
    mean = 3.0 * slope ** (len(counts) - 1)
    inside = _covered([chain(_nested(counts, 100 + run, slope), range(len(counts))) for run in range(RUNS)], mean)
    assert 0.93 <= inside <= (0.985 if slope == 1.0 else 1.0)


def test_stopping_costs_samples() -> None:
    values = _nested([50, 20], seed=11)
    found, wider = chain(values, range(2)), chain(values, range(2), stopping=3.0)
    assert wider.value == found.value
    assert 1.0 + 3.0 / 49.0 < wider.variance / found.variance < 1.0 + 3.0 / 18.0


def test_two_equal_differences_by_chance_do_not_make_an_interval_of_nothing() -> None:
    coarse, middle, _ = _nested([200, 40, 40], seed=7)
    fine = middle[:2] + 0.1
    found = chain([coarse, middle, fine], range(3))
    assert found.links[-1].variance > 0.25 * found.links[1].variance
    assert found.half_width > 0.0


def test_a_variance_above_that_of_the_coarser_levels_is_not_hidden() -> None:
    coarse, middle, _ = _nested([200, 40, 40], seed=8)
    fine = middle[:3] + np.array([0.0, 5.0, -5.0])
    found = chain([coarse, middle, fine], range(3))
    assert found.links[-1].freedom == 2.0
    assert_allclose(found.links[-1].variance, (fine - found.links[-1].slope * middle[:3]).var(ddof=1))
    assert found.half_width > multilevel.quantile(3.0) * 2.0


def test_levels_with_few_samples_are_linked_to_their_neighbour_alone() -> None:
    links = links_of(_nested([100, 40, 5], seed=9))
    assert (1, 0) in links
    assert (2, 1) in links
    assert (2, 0) not in links
    assert links[2, 1].slope == links[1, 0].slope


def test_constant_levels_have_no_correlation_and_a_slope_all_the_same() -> None:
    ones = np.ones(20)
    assert math.isnan(correlation(ones, ones))
    assert chain([ones, ones[:9]], range(2)).half_width == 0.0


def test_a_parent_has_all_seeds_of_its_level() -> None:
    coarse, middle, fine = _nested([100, 80, 80], seed=10)
    values = [coarse, middle[:30], fine]
    links = links_of(values)
    assert (2, 1) not in links
    assert multilevel.nearest_chain(links, 2) == (0, 2)
    assert multilevel.nearest_chain(links, 1) == (0, 1)
    assert chain(values, (0, 2)).half_width < plain(fine).half_width
    assert_allclose(multilevel.level_variance(links, (0, 2)), fine.var(ddof=1), rtol=0.2)


def _controlled(counts: list[int], surfaces: int, seed: int) -> tuple[list[np.ndarray], np.ndarray]:
    """Levels that two numbers of the surface alone explain to four fifths, with a mean of 3."""
    random = np.random.default_rng(seed)
    alone = random.normal([0.2, 4.0], [0.1, 0.5], (surfaces, 2))
    shared = 8.0 * (alone[:, 0] - 0.2) - 0.8 * (alone[:, 1] - 4.0)
    levels = [shared + 0.45 * random.standard_normal(surfaces)]
    for rho in MARKOV[: len(counts) - 1]:
        levels.append(levels[-1] + 0.45 * math.sqrt(1.0 - rho**2) * random.standard_normal(surfaces))
    return [3.0 + each[:n] for each, n in zip(levels, counts, strict=True)], alone


def test_a_level_with_surfaces_alone_has_the_variance_of_a_control_variate() -> None:
    values, alone = _controlled([200], 20_000, seed=12)
    found, without = chain(values, [0], alone=alone), plain(values[0])
    explained = 8.0**2 * 0.1**2 + 0.8**2 * 0.5**2
    assert_allclose(found.variance, 0.45**2 / 200 + explained / 20_000, rtol=0.15)
    assert found.half_width < 0.6 * without.half_width
    assert found.links[0].freedom == 197.0
    assert_allclose(multilevel.level_variance(links_of(values, alone), (0,), alone), 0.45**2 + explained, rtol=0.15)


def test_surfaces_alone_in_no_greater_number_change_nothing() -> None:
    values, alone = _controlled([60], 60, seed=13)
    found = chain(values, [0], alone=alone)
    assert_allclose(found.value, values[0].mean())
    assert_allclose(found.variance, values[0].var(ddof=1) / 60, rtol=0.05)


@pytest.mark.parametrize("counts", [[60, 24, 10, 3], [30]])
def test_intervals_with_surfaces_alone_cover_the_mean(counts: list[int]) -> None:
    found = []
    for run in range(RUNS):
        values, alone = _controlled(counts, 1000, 1000 + run)
        found.append(chain(values, range(len(counts)), alone=alone))
    assert 0.93 <= _covered(found, 3.0) <= 0.985


def test_a_level_of_few_samples_is_not_regressed_on_surfaces_alone() -> None:
    values, alone = _controlled([100, 10], 500, seed=14)
    links = links_of(values, alone)
    assert len(links[0, -1].gains) == 2
    assert links[1, 0].gains == ()
    assert links[0, -1].alone > 2.0 * links[0, -1].variance
