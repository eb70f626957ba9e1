"""Quick estimates of the flow: the equation of the medium, its threshold, and closed forms."""

import numpy as np
import pytest

from roughvol.gap.quick_estimates import CLOSES_AT, effective_medium, single_junction
from tests.gap.kit import rough


def test_the_corrected_medium_closes_where_it_is_told_to():
    gap = np.ones((20, 20))
    for closed, flows in ((0.40, True), (0.43, False)):
        gap.ravel()[: round(closed * 400)] = 0.0
        assert (effective_medium(gap, closes_at=CLOSES_AT) > 0.0) == flows
        assert effective_medium(gap) > 0.0
    assert (effective_medium(0.0 * gap), single_junction(0.0 * gap, 1)) == (0.0, 0.0)


def test_half_as_threshold_is_the_equation_of_bruggeman():
    for share in (0.05, 0.3):
        gap = rough(share, 1)
        near = effective_medium(gap, closes_at=0.5 + 1e-12)
        assert near == pytest.approx(effective_medium(gap), rel=1e-8)


def test_the_corrected_medium_solves_its_equation():
    gap, s = rough(0.2, 2), CLOSES_AT / (1 - CLOSES_AT)
    k, effective = gap**3, effective_medium(gap, closes_at=CLOSES_AT) * gap.mean() ** 3
    assert np.mean((k - effective) / (k + s * effective)) == pytest.approx(0.0, abs=1e-9)


def test_a_medium_of_one_gap_has_its_flow():
    for closes_at in (0.5, CLOSES_AT):
        assert effective_medium(np.full((4, 4), 0.3), closes_at=closes_at) == pytest.approx(1.0, rel=1e-12)


def test_the_unit_of_length_does_not_matter():
    gap = rough(0.25, 2)
    for unit in (1e-200, 1e200):
        assert effective_medium(unit * gap) == pytest.approx(effective_medium(gap), rel=1e-10)
        assert single_junction(unit * gap, 0) == pytest.approx(single_junction(gap, 0), rel=1e-12)


def test_the_junction_of_a_period_lies_on_a_way_across_its_sides():
    gap = np.zeros((4, 5))
    gap[:2, 0] = gap[1:, -1] = 2.0
    assert (single_junction(gap, 0), single_junction(gap, 0, periodic=True) > 0.0) == (0.0, True)
