"""What the tests of the gap share: gaps, drawn by hand, over rough surfaces, and of one period."""

from collections import deque

import numpy as np
from scipy import ndimage

from roughvol.surfaces.midpoint import random_midpoint_displacement


def drawn(text):
    """Return a gap field from a drawing: # closed, . open by 1, a digit open by so much."""
    return np.array([[{"#": 0.0, ".": 1.0}.get(c) if c in "#." else float(c) for c in row] for row in text.split()])


def rough(share, seed=0, m=5, D=2.4, *, periodic=False):
    """Return the gap over a rough surface cut off so that a share of it is closed."""
    z = random_midpoint_displacement(D, m, seed=seed, periodic=periodic).heights
    return np.maximum(np.quantile(z, 1.0 - share) - z, 0.0)


def smooth(seed, closed, shape=(24, 20)):
    """Return a smooth periodic gap with a share of closed elements."""
    field = ndimage.gaussian_filter(np.random.default_rng(seed).standard_normal(shape), 2.0, mode="wrap")
    return np.maximum(field - np.quantile(field, closed), 0.0)


def floods(void, axis, *, corners=False):
    """Walk from element to element through their sides, or through corners as well."""
    steps = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if abs(a) + abs(b) == 1 or (corners and a and b)]
    void = void if axis == 0 else void.T
    wet = {(0, int(column)) for column in np.flatnonzero(void[0])}
    queue = deque(wet)
    while queue:
        row, column = queue.popleft()
        if row == len(void) - 1:
            return True
        for near in ((row + a, column + b) for a, b in steps):
            inside = 0 <= near[0] < void.shape[0] and 0 <= near[1] < void.shape[1]
            if inside and void[near] and near not in wet:
                wet.add(near)
                queue.append(near)
    return False


def straits(width):
    """Return narrow straits between wide lakes."""
    gap = np.ones((30, 10))
    gap[[9, 20]] = 0.0
    gap[9, 2] = gap[20, 7] = width
    return gap


def any_gap(seed):
    """Return a random gap, an axis, and whether the gap is a period: kinds, sizes, closed shares and decades vary."""
    random = np.random.default_rng(seed)
    shape = tuple(int(n) for n in random.integers(73, 200, 2))
    kind, periodic = seed % 5, bool(random.integers(2))
    if kind == 0:
        z = random_midpoint_displacement(random.uniform(2.05, 2.9), 7, seed=seed, periodic=periodic).heights
    elif kind == 1:  # a spectrum, perhaps with a direction
        along, across = np.fft.fftfreq(shape[0])[:, None] * random.uniform(0.2, 1.0), np.fft.rfftfreq(shape[1])
        k = np.hypot(along, across)
        amplitude = np.maximum(k, random.uniform(0.01, 0.1)) ** -random.uniform(1.2, 2.0)
        z = np.fft.irfft2(amplitude * np.exp(2j * np.pi * random.random(k.shape)), shape)
    elif kind == 2:  # channels one element wide
        z = ndimage.gaussian_filter(random.standard_normal(shape), random.uniform(1.0, 6.0), mode="wrap")
        z = np.abs(z) + 0.02 * z.std() * random.random(shape)
    elif kind == 3:  # islands
        z = (ndimage.gaussian_filter(random.standard_normal(shape), random.uniform(0.5, 4.0), mode="wrap")) ** 3
    else:  # decades
        z = -np.exp(
            random.uniform(0.5, 2.3) * ndimage.zoom(random.standard_normal((12, 15)), 10, order=random.integers(2))
        )
    closed = random.uniform(0.01, 0.6)
    return np.maximum(np.quantile(z, 1.0 - closed) - z, 0.0), int(random.integers(2)), periodic
