"""Random midpoint displacement against a plain loop fed with the same stream."""

import itertools

import numpy as np
import pytest

from roughvol.errors import SurfaceError
from roughvol.surfaces.midpoint import midpoint_levels, random_midpoint_displacement
from tests.refused import refusals

DIAGONAL, STRAIGHT = [(-1, -1), (-1, 1), (1, -1), (1, 1)], [(-1, 0), (1, 0), (0, -1), (0, 1)]


def deviation(half_step, D, law):
    if law == "std":
        return (1 / np.sqrt(0.09)) / (2 ** ((3 - D) / 2)) ** half_step
    return np.sqrt((1 / np.sqrt(0.09)) / (2 ** ((3 - D) / 2)) ** half_step)


def displaced_by_loops(D, m, seed, law, periodic):
    """Node by node, in the order the seed means, each mean taken over the neighbours that exist."""
    n = 2**m
    nodes = n if periodic else n + 1
    z = np.full((nodes, nodes), np.nan)
    z[::n, ::n] = 0.0
    stream = iter(np.random.Generator(np.random.PCG64(seed)).standard_normal(4 * (n + 1) ** 2))

    def displace(places, offsets, half, half_step):
        for i, j in places:
            around = [(i + a * half, j + b * half) for a, b in offsets]
            around = [(a % n, b % n) if periodic else (a, b) for a, b in around]
            values = [z[a, b] for a, b in around if 0 <= a < nodes and 0 <= b < nodes]
            assert len(values) == (4 if periodic or (0 < i < n and 0 < j < n) else 3)
            z[i, j] = sum(values) / len(values) + deviation(half_step, D, law) * next(stream)

    for level in range(m):
        step, half = n >> level, n >> (level + 1)
        odd, even, inside = range(half, n, step), range(0, nodes, step), range(step, n, step)
        edges = [*itertools.product(odd, even), *itertools.product(even, odd)]
        if not periodic:  # the rim first
            edges = [(i, 0) for i in odd] + [(i, n) for i in odd] + [(0, j) for j in odd] + [(n, j) for j in odd]
            edges += [*itertools.product(odd, inside), *itertools.product(inside, odd)]
        displace(itertools.product(odd, odd), DIAGONAL, half, 2 * level + 1)
        displace(edges, STRAIGHT, half, 2 * level + 2)
    return z


@pytest.mark.parametrize(("law", "periodic"), [("std", False), ("variance", True), ("std", True)])
@pytest.mark.parametrize(("D", "m", "seed"), [(2.001, 2, 1), (2.999, 3, 2), (2.5, 5, 3)])
def test_displacement_equals_plain_loops(D, m, seed, law, periodic):
    surface = random_midpoint_displacement(D, m, side=2.0, seed=seed, law=law, periodic=periodic)
    expected = displaced_by_loops(D, m, seed, law, periodic)
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(surface.heights, expected, rtol=0, atol=1e-13)
    assert (surface.periodic, surface.side, surface.spacing) == (periodic, 2.0, 2.0 / 2**m)


def test_stream_digits():
    heights = random_midpoint_displacement(2.3, 1).heights
    deviations = [deviation(h, 2.3, "std") for h in (1, 2)]
    xi = [0.12573022, -0.13210486, 0.64042265, 0.10490012, -0.53566937]
    centre = deviations[0] * xi[0]
    edges = [centre / 3 + deviations[1] * x for x in xi[1:]]
    expected = [[0, edges[2], 0], [edges[0], centre, edges[1]], [0, edges[3], 0]]
    np.testing.assert_allclose(heights, expected, atol=1e-7)


@pytest.mark.parametrize(("law", "periodic"), [("std", False), ("variance", True)])
def test_surfaces_of_a_seed_are_nested_bit_for_bit(law, periodic):
    fine = random_midpoint_displacement(2.3, 7, seed=5, law=law, periodic=periodic).heights
    for m in range(6, 1, -1):
        fine = fine[::2, ::2]
        coarse = random_midpoint_displacement(2.3, m, seed=5, law=law, periodic=periodic).heights
        np.testing.assert_array_equal(fine, coarse)


def test_midpoint_levels():
    assert midpoint_levels(1).tolist() == [[0, 2, 0], [2, 1, 2], [0, 2, 0]]
    levels = midpoint_levels(4)
    np.testing.assert_array_equal(levels[::2, ::2], midpoint_levels(3))
    # Half step 2k+1 fills the 4^k centres, half step 2k+2 the 2 · 2^k (2^k + 1) edges of the cells.
    assert np.bincount(levels.ravel()).tolist() == [4] + [n for k in range(4) for n in (4**k, 2 * 2**k * (2**k + 1))]


def made(D=2.3, m=3, **others):
    return lambda: random_midpoint_displacement(D, m, **others)


test_arguments_out_of_range = refusals(
    SurfaceError,
    (made(D=2.0), r"D must be in \(2, 3\), got 2.0"),
    (made(D=3.0), r"\(2, 3\)"),
    (made(D=float("nan")), r"\(2, 3\)"),
    (made(D="2.3"), "D must be a number, got '2.3'"),
    (made(m=0), r"m must be an integer in \[1, 14\], got 0"),
    (made(m=15), "got 15"),
    (made(m=2.0), "integer"),
    (made(seed=-1), "seed must be an integer >= 0, got -1"),
    (made(side=0.0), "side must be finite and positive, got 0.0"),
    (made(side=float("inf")), "side"),
    (made(side=10**400), "side must be a number"),
    (made(law="sigma"), "'std', 'variance', got 'sigma'"),
)
