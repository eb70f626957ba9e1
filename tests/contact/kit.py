"""What the tests of the solver share: surfaces and half spaces, and slow counterparts for some hundred elements."""

import math
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from scipy import linalg
from scipy.optimize import nnls

from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.kernels import influence_matrix, kernel_of
from roughvol.contact.loading import solve, sweep
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.surface import Surface

KERNELS = ("love", "punch")  # with coefficients, so that a free patch has them
FREE = [("free", kernel) for kernel in KERNELS]
PLANES = [(sides, kernel) for sides in ("mirrored", "periodic") for kernel in ("love", "punch", "fourier")]
BODIES = [*FREE, *PLANES]  # (sides, kernel)
SIDES = ("free", "mirrored", "periodic")
REFERENCE = Path(__file__).parents[3] / "shared" / "reference"  # solved cases of other codes
every_body = pytest.mark.parametrize(("sides", "kernel"), BODIES)
every_side = pytest.mark.parametrize("sides", SIDES)


@lru_cache
def half_space(shape, kernel="love", sides="free"):
    return HalfSpace(shape, kernel, sides=sides)


@lru_cache
def fractal(m, D=2.3, seed=0, sides="free"):
    surface = random_midpoint_displacement(D, m, seed=seed, periodic=sides == "periodic")
    return replace(surface, sides=sides)


@lru_cache
def swept(surface, indentations, kernel="love", **options):
    """States of a surface, solved once for all tests."""
    space = half_space(surface.shape, kernel, surface.sides)
    return list(sweep(surface, space, indentations, **options))


def random(seed):
    return np.random.Generator(np.random.PCG64(seed))


def mean_plane(surface):
    """Indentation at which the rigid plane has come down to the mean plane, d = 0."""
    return (surface.z_max - surface.mean_height) / (surface.Sq or 1.0)


def coefficients(shape, kernel="love"):
    """K of the non-negative offsets, by the name of the kernel."""
    return kernel_of(kernel).quadrant(shape)


def dense_matrix(influence):
    """The matrix K(i - j) of all elements of a grid, from the coefficients of the non-negative offsets."""
    rows, columns = influence.shape
    row, column = np.divmod(np.arange(rows * columns), columns)
    return influence[np.abs(row[:, None] - row), np.abs(column[:, None] - column)]


@lru_cache
def dense(shape, kernel="love", sides="free"):
    """The matrix K of a half space. The rows of mirrored elements are sums over the images in the doubled period."""
    if sides != "mirrored":
        return dense_matrix(half_space(shape, kernel, sides).influence)
    doubled = 2 * shape[0], 2 * shape[1]
    image = np.pad(np.arange(math.prod(shape)).reshape(shape), [(0, n) for n in shape], mode="symmetric").ravel()
    origin = np.arange(image.size).reshape(doubled)[: shape[0], : shape[1]].ravel()
    return dense(doubled, kernel, "periodic")[origin] @ np.eye(origin.size)[image]


def summed_displacement(pressure, kernel="love"):
    """K ∗ p by a linear convolution with the whole mirrored kernel, padded in full."""
    from scipy import signal  # imports scipy.stats: half a second

    quadrant = coefficients(pressure.shape, kernel)
    half = np.concatenate([quadrant[:0:-1], quadrant])
    whole = np.concatenate([half[:, :0:-1], half], axis=1)
    return signal.fftconvolve(whole, pressure, mode="valid")


class DenseHalfSpace:
    """A matrix in place of the FFT, with the members that the contact solver needs."""

    sides = "free"

    def __init__(self, shape, kernel="love"):
        self.shape, self.kernel = shape, kernel_of(kernel)
        self.influence = coefficients(shape, kernel)
        self.matrix = dense_matrix(self.influence)
        self.convolutions = self.convolutions_fp32 = 0

    def between(self, elements):
        return self.matrix[np.ix_(elements, elements)]

    def displacement_above(self, heights, elements, pressure):
        self.convolutions += 1
        return self.matrix[:, elements] @ pressure - heights

    def displacement_at(self, elements, pressure, *, single=False):
        self.convolutions_fp32 += single
        self.convolutions += not single
        matrix = self.matrix[np.ix_(elements, elements)]
        return matrix.astype(np.float32) @ pressure.astype(np.float32) if single else matrix @ pressure

    @property
    def total_compliance(self):
        return self.matrix.sum(axis=1).reshape(self.shape)


def exact_pressure(matrix, b):
    """The one q ≥ 0 with Kq - b ≥ 0 and q (Kq - b) = 0: contact set from non-negative least squares, then Cholesky.

    With K = L Lᵀ the energy ½qᵀKq - bᵀq is ½|Lᵀq - L⁻¹b|² up to a constant. The conditions are checked before the
    answer leaves: K is positive definite, so they are sufficient, however the set was found.
    """
    candidates = np.flatnonzero(b > 0.0)
    pressure = np.zeros(b.size)
    if candidates.size:
        factor = linalg.cholesky(matrix[np.ix_(candidates, candidates)], lower=True)
        load = linalg.solve_triangular(factor, b[candidates], lower=True)
        guess = linalg.solve_triangular(factor.T, load)  # all candidates touch: the case that takes nnls longest
        if guess.min() <= 0.0:
            guess, _ = nnls(factor.T, load)
        touching = candidates[guess > 1e-12 * guess.max()]
        pressure[touching] = linalg.solve(matrix[np.ix_(touching, touching)], b[touching], assume_a="pos")
    scale = np.abs(b).max()
    if pressure.min() < -1e-12 * scale or (matrix @ pressure - b).min() < -1e-11 * scale:
        raise ArithmeticError("the oracle found no solution")
    return np.maximum(pressure, 0.0)


def scaled_overlap(surface, indentation):
    """Rigid overlap ū/σ = (z - z_max)/σ + Δ/σ; a flat surface has its lengths in units of 1."""
    return (surface.heights - surface.z_max) / (surface.Sq or 1.0) + indentation


def lattice_pressure(contact):
    """q = p δ/(π E* σ) of a record with the pressure p L/(E* σ)."""
    return contact.pressure() / (math.pi * (contact.shape[0] - (not contact.periodic)))


def numbers(contacts):
    return np.array([(c.contact_area_fraction, c.mean_pressure, c.free_volume) for c in contacts])


def check_conditions(contact, surface, kernel, rtol, rounding=1e-14):
    """All that is true of a record of a free patch by definition, by a convolution that is not the package's.

    `rounding` is that of numbers of the order of 1, and counts in contact outside the overlap where it exceeds 1e-14.
    """
    slack = rounding * (1.0 + abs(contact.indentation)) if rounding > 1e-14 else 0.0
    rounding *= 1.0 + abs(contact.indentation)
    p, g, mask = contact.pressure(), contact.gap(), contact.contact()
    q, b = lattice_pressure(contact), scaled_overlap(surface, contact.indentation)
    u = summed_displacement(q, kernel)
    residual = max(np.abs((u - b)[q > 0]).max(initial=0.0), -(u - b)[b > 0].min(initial=0.0))
    assert p.shape == g.shape == mask.shape == surface.shape
    assert p.min() >= 0.0
    assert g.min() >= 0.0
    assert not (p * g).any()
    assert np.array_equal(mask, p > 0.0)
    assert not g[mask].any()
    assert not (mask & (b <= -slack)).any()  # contact lies within the rigid overlap
    assert residual == pytest.approx(contact.residual, abs=20 * rounding)
    assert contact.residual <= rtol
    assert contact.converged is True
    assert contact.contact_area_fraction == mask.mean()
    assert contact.mean_pressure == pytest.approx(p.mean(), rel=1e-13)
    assert contact.separation == pytest.approx(-b.mean(), abs=rounding)
    expected = 0.0 if mask.all() else contact.separation + u.mean()
    assert contact.free_volume == pytest.approx(expected, abs=10 * rounding)
    assert contact.free_volume == pytest.approx(g.mean(), abs=contact.residual + 10 * rounding)


@lru_cache
def contact_set(shape, seed=0, kernel="love"):
    """A half space, elements in contact on a piece of a fractal surface, K between them, and t with K t = 1."""
    heights = fractal(math.ceil(math.log2(max(shape) - 1)), 2.2, seed).heights[: shape[0], : shape[1]]
    space = half_space(shape, kernel)
    elements = np.flatnonzero(solve(Surface(heights - heights.max(), 1.0), space, 3.0).contact())
    matrix = influence_matrix(space.influence, elements)
    return space, elements, matrix, np.linalg.solve(matrix, np.ones(elements.size))


def of_units(map_, size):
    """The matrix of a linear map of vectors."""
    return np.array(map_(np.eye(size, dtype=np.float32)), dtype=float)


def spectrum_of(inverse, matrix):
    """The eigenvalues of M⁻¹ K, after a check that M⁻¹ is symmetric and positive definite."""
    np.testing.assert_allclose(inverse, inverse.T, rtol=0, atol=1e-5 * np.abs(inverse).max())
    factor = np.linalg.cholesky(0.5 * (inverse + inverse.T))  # fails unless it is positive definite
    return np.linalg.eigvalsh(factor.T @ matrix @ factor)


def self_affine(shape, longest=1.0, hurst=0.8, seed=3):
    """Heights of one period of any sides; waves longer than the longest side over `longest` have equal power."""
    waves = [np.fft.fftfreq(n) * max(shape) for n in shape]
    k = np.hypot(waves[0][:, None], waves[1])
    return np.fft.ifft2(np.fft.fft2(random(seed).standard_normal(shape)) / np.maximum(k, longest) ** (1.0 + hurst)).real
