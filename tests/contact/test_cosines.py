"""The mirrored convolution against cosine transforms of scipy, and the period of a patch and its images."""

import math

import numpy as np
import pytest
from scipy import fft

from roughvol.contact.cosines import Cosines, FoldedCosines, MirroredConvolution
from roughvol.contact.loading import solve
from roughvol.contact.options import TUNING
from roughvol.surfaces.surface import Surface
from tests.contact.kit import half_space, random

# small, even, odd, prime, with large prime factors, powers of two
SHAPES = [(1, 1), (1, 9), (3, 4), (64, 1), (17, 34), (48, 51), (33, 257), (100, 75), (1367, 9), (8, 2049)]


NODES = [*range(1, 20), 33, 48, 61, 64, 69, 128, 257, 1000, 1367, 1382, 2049]  # the last three are not folded


@pytest.mark.parametrize(("kind", "sizes"), [(Cosines, NODES), (FoldedCosines, NODES[:-3])])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_waves_are_cosine_transforms_up_to_signs(dtype, kind, sizes):
    for nodes in sizes:
        cosines = kind(nodes, np.dtype(dtype))
        assert np.array_equal(np.sort(cosines.element, axis=None), np.arange(nodes))
        assert np.array_equal(np.unique(cosines.wave), np.arange(nodes + 1))
        x = random(nodes).standard_normal((3, nodes))
        source = x.T[cosines.element].transpose(0, 2, 1).astype(dtype)  # (q, 3, p)
        shape = cosines.q, 3, cosines.half
        between, waves = (np.zeros(shape, dtype=np.result_type(dtype, np.complex64)) for _ in range(2))
        target = np.empty_like(source)
        forward, backward = cosines.plans(source, between, waves, target)
        forward()
        wanted = np.pad(0.5 * fft.dct(x, type=2), [(0, 0), (0, 1)]).T[cosines.wave]  # (q, half, 2, 3)
        found = waves.view(dtype).reshape(cosines.q, 3, cosines.half, 2).transpose(0, 2, 3, 1)
        near = math.sqrt(nodes) * (1e-13 if dtype == np.float64 else 1e-5)
        assert np.abs(found) == pytest.approx(np.abs(wanted), abs=near)
        backward()
        assert target == pytest.approx(source, abs=near)


@pytest.mark.parametrize("shape", SHAPES)
def test_convolution_is_that_of_cosine_transforms(shape):
    spectrum, pressure = random(1).random((shape[0] + 1, shape[1] + 1)), random(2).standard_normal(shape)
    elements = np.flatnonzero(pressure.ravel() > 0.3)
    row, column = np.divmod(elements.astype(np.int32), np.int32(shape[1]))
    field = np.where(pressure > 0.3, pressure, 0.0)
    wanted = fft.idctn(fft.dctn(field) * spectrum[:-1, :-1])
    for dtype, near in ((np.float64, 1e-13), (np.float32, 3e-6)):
        engine = MirroredConvolution(spectrum, np.dtype(dtype), 1, TUNING)
        places = engine.places(row, column)
        above = engine.convolve_above(pressure, places, field.ravel()[elements])
        assert above == pytest.approx(wanted - pressure, abs=near * np.abs(pressure).max())
        at = engine.convolve_at(places, field.ravel()[elements].astype(dtype))
        assert at == pytest.approx(wanted.ravel()[elements], abs=near * np.abs(pressure).max())
        none = engine.places(row[:0], column[:0])
        assert not engine.convolve_above(np.zeros(shape), none, np.zeros(0)).any()


def test_far_from_the_sides_no_block_has_an_image():
    """A contact in the middle alone, with more elements than a factorisation takes."""
    x = np.linspace(-1.0, 1.0, 120)
    dome = Surface(-(x[:, None] ** 2) - x**2, 1.0, sides="mirrored")
    contact = solve(dome, half_space(dome.shape, sides="mirrored"), 0.4)
    assert contact.contact()[20:100, 20:100].sum() == contact.contact().sum() > 240
