"""Box counts of sets whose dimension is known, and against a plain loop over boxes."""

import numpy as np
import pytest

from roughvol.gap.box_counting import BoxCounts, box_counts, local_dimension


def empty(rows, columns=None):
    return np.zeros((rows, columns or rows), dtype=bool)


def carpet(levels, kept, size):
    """Return the set in which each black cell is replaced by the pattern ``kept`` (size × size), ``levels`` times."""
    pattern = np.array(kept, dtype=bool).reshape(size, size)
    mask = np.ones((1, 1), dtype=bool)
    for _ in range(levels):
        mask = np.kron(mask, pattern).astype(bool)
    return mask


def counts_by_loops(mask, side):
    sides = [2**k for k in range(side.bit_length())]
    rows, columns = (side * (length // side) for length in mask.shape)
    return [
        sum(mask[i : i + r, j : j + r].any() for i in range(0, rows, r) for j in range(0, columns, r)) for r in sides
    ]


@pytest.mark.parametrize(("shape", "side"), [((1, 1), 1), ((3, 3), 2), ((17, 17), 16), ((16, 37), 16), ((40, 9), 8)])
def test_counts_equal_plain_loops(shape, side):
    mask = np.random.Generator(np.random.PCG64(1)).random(shape) < 0.1
    r, counts = box_counts(mask)
    assert r.tolist() == [2**k for k in range(side.bit_length())]
    assert counts.tolist() == counts_by_loops(mask, side)
    assert np.all(counts[:-1] >= counts[1:])
    assert np.all(counts[:-1] <= 4 * counts[1:])


def of(place, size=33):
    mask = empty(size)
    mask[place] = True
    return mask


SETS = {  # a set in boxes that fit it, and its dimension at every scale
    "square": (~empty(65), 2.0),
    "line": (of(np.s_[5, :]), 1.0),
    "edge": (of(np.s_[:, 0]), 1.0),
    "point": (of(np.s_[9, 3]), 0.0),
    "diagonal": (np.eye(64, dtype=bool), 1.0),
    "gasket": (carpet(6, [1, 1, 1, 0], 2), np.log(3) / np.log(2)),  # three of four quarters kept
}


@pytest.mark.parametrize(("mask", "dimension"), SETS.values(), ids=SETS)
def test_sets_have_their_dimension_at_every_scale(mask, dimension):
    counts, side = box_counts(mask), 2 ** (len(mask).bit_length() - 1)
    assert counts.counts[0] == mask[:side, :side].sum()
    local = local_dimension(counts)
    np.testing.assert_allclose(local.dimension, dimension, atol=1e-14)
    np.testing.assert_allclose(local.r_mid, np.sqrt(counts.r[1:] * counts.r[:-1]), rtol=1e-15)


@pytest.mark.parametrize("shape", [(8, 8), (9, 14)])
def test_counts_of_a_period_are_means_over_all_positions(shape):
    mask = np.random.Generator(np.random.PCG64(4)).random(shape) < 0.1
    rows, columns = shape
    r, counts = box_counts(mask, periodic=True)
    for side, count in zip(r, counts, strict=True):
        boxes = np.pad(mask, (0, side), mode="wrap")
        black = [boxes[i : i + side, j : j + side].any() for i in range(rows) for j in range(columns)]
        assert count == pytest.approx(np.mean(black) * mask.size / side**2, rel=1e-12)


def test_empty_domain_has_no_dimension():
    local = local_dimension(box_counts(empty(9)))
    assert local.r_mid.shape == (3,)
    assert np.isnan(local.dimension).all()
    assert local_dimension(BoxCounts(np.array([1]), np.array([1]))).dimension.size == 0
