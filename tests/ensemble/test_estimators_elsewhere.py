"""Estimators of an ensemble against independent libraries: generalised least squares, and multilevel Monte Carlo."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.ensemble.allocation import AIM, NORMAL, optimum
from tests.ensemble.kit import best_linear

COVARIANCE = np.array([[1.0, 0.9, 0.7], [0.9, 1.2, 1.0], [0.7, 1.0, 1.1]])
pytestmark = pytest.mark.slow  # imports of seconds
REASON = "pip install 'roughvol[crosscheck]'"


def test_the_best_linear_estimator_is_that_of_generalised_least_squares() -> None:
    models = pytest.importorskip("statsmodels.api", reason=REASON)
    random = np.random.default_rng(7)
    groups = [
        (levels, random.multivariate_normal(np.zeros(3), COVARIANCE, size=n)[:, levels] + np.arange(1.0, 4.0)[levels])
        for levels, n in (([0, 1, 2], 6), ([0, 1], 15), ([0], 40), ([1, 2], 4))
    ]
    means, spread = best_linear(groups, COVARIANCE)
    rows = [
        (level, value) for levels, values in groups for row in values for level, value in zip(levels, row, strict=True)
    ]
    design = np.eye(3)[[level for level, _ in rows]]
    sigma, start = np.zeros((len(rows), len(rows))), 0
    for levels, values in groups:
        for _ in values:
            end = start + len(levels)
            sigma[start:end, start:end], start = COVARIANCE[np.ix_(levels, levels)], end
    fitted = models.GLS([value for _, value in rows], design, sigma=sigma).fit()
    assert_allclose(means, fitted.params, rtol=1e-10)
    assert_allclose(spread, fitted.normalized_cov_params, rtol=1e-8)


def test_samples_of_levels_are_those_of_multilevel_monte_carlo_elsewhere() -> None:
    criteria = pytest.importorskip("qmcpy.stopping_criterion.abstract_cub_mlmc", reason=REASON)
    variances, costs, half = np.array([1.0, 0.04, 0.003, 0.0002]), np.array([1.0, 4.0, 20.0, 90.0]), 0.01
    found = optimum(variances, costs, [2] * 4, half)
    data = SimpleNamespace(var_level=variances, cost_per_sample=costs)
    rule = SimpleNamespace(theta=0.0, rmse_tol=AIM * half / NORMAL)
    assert_allclose(found, criteria.AbstractCubMLMC._get_next_samples(rule, data), atol=1)
