"""Closed-form contacts against resolution: how far the lattice is off, and that it gets nearer as it is refined.

Each error is the root mean square over several contact radii: a single one depends on the position of the circle on the
lattice. The bounds are about 1.5 times the measured errors.
"""

import math
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest

from roughvol.contact.loading import Trials, solve
from roughvol.contact.search import indentation_for, state_under
from roughvol.reproduction import closed_forms
from roughvol.reproduction.formulas import westergaard_mean_gap
from roughvol.surfaces.surface import Surface
from tests.contact.kit import REFERENCE, half_space

NODES = (17, 33, 65)
RADII = np.linspace(0.25, 0.4, 6)  # of the contact, in units of the side of the grid
RADIUS, SLOPE, DEPTH = 2.0, 0.5, 0.1  # of the sphere, of the cone, of the flat punch


class Body(NamedTuple):
    """A body by the radius a that it shall touch with: its closed form, its shape, Δ, and its parameter."""

    form: str
    heights: object
    indentation: object
    parameter: object

    def exact(self, name=""):
        return getattr(closed_forms, self.form + name)


BODIES = {
    "sphere": Body("hertz", lambda r, a: -r * r / (2.0 * RADIUS), lambda a: a * a / RADIUS, lambda a: RADIUS),
    "cone": Body("cone", lambda r, a: -SLOPE * r, lambda a: 0.5 * math.pi * SLOPE * a, lambda a: SLOPE),
    "punch": Body("circular_punch", lambda r, a: np.where(r <= a, 0.0, -10.0), lambda a: DEPTH, lambda a: a),
}
QUANTITIES = ("force", "radius", "pressure", "displacement", "free volume")


def pressed(heights, indentation, rtol=1e-8):
    """Solve with lengths in units of the side: pressure/E*, gap and force/E*."""
    surface = Surface(heights, 1.0 / (heights.shape[0] - 1))
    scale = surface.Sq or 1.0
    contact = solve(surface, half_space(surface.shape), indentation / scale, rtol=rtol)
    pressure = contact.pressure() * scale / surface.side
    return contact, pressure, contact.gap() * scale, pressure.sum() * surface.spacing**2


@lru_cache
def errors(name, nodes):
    """Relative errors of one body on one grid, in the order of QUANTITIES."""
    body = BODIES[name]
    x = (np.arange(nodes) - 0.5 * (nodes - 1)) / (nodes - 1)
    r = np.hypot(x[:, None], x)
    squares = []
    for a in RADII:
        indentation, parameter = body.indentation(a), body.parameter(a)
        exact = body.exact()(indentation, parameter)
        assert exact.contact_radius == pytest.approx(a)
        heights = body.heights(r, a)
        contact, pressure, gap, force = pressed(heights, indentation)
        displacement = gap + indentation - (heights.max() - heights)
        # away from the square root at the edge and from the singular apex of the cone
        inner, outer = (r < 0.8 * a) & (r > 0.2 * a), r > 1.2 * a
        area = contact.contact().sum() / (nodes - 1) ** 2
        p, u = (body.exact(name)(r, indentation, parameter) for name in ("_pressure", "_displacement"))
        squares.append(
            (
                force / exact.force - 1.0,
                math.sqrt(area / math.pi) / a - 1.0,
                np.abs(pressure - p)[inner].max() / exact.mean_pressure,
                np.abs(displacement - u)[outer].max() / indentation,
                (displacement - u).mean() / u.mean(),
            )
        )
    return np.sqrt(np.mean(np.square(squares), axis=0))


# body -> bounds of the errors at 129² elements, and orders of convergence over halvings of the spacing
BOUNDS = {
    "sphere": ((6e-5, 4.5e-3, 3e-4, 5e-5, 5e-5), (1.7, 1.0, 2.0, 1.7, 1.7)),
    "cone": ((4e-5, 4.5e-3, 1.3e-4, 2.5e-5, 3.5e-5), (1.7, 1.0, 2.0, 1.7, 1.7)),
    "punch": ((5e-3, 1.4e-3, 1.4e-2, 6.5e-3, 4.5e-3), (1.0, 1.0, 1.0, 1.0, 1.0)),
}


@pytest.mark.parametrize("nodes", [NODES, pytest.param((*NODES, 129), marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", BODIES)
def test_round_bodies_converge_to_their_closed_forms(name, nodes):
    found = np.array([errors(name, n) for n in nodes])
    bounds, orders = (np.array(row) for row in BOUNDS[name])
    halvings = len(nodes) - 1
    assert (found[-1] < bounds * 2.0 ** ((3 - halvings) * (orders + 0.3))).all()
    assert (np.log2(found[0] / found[-1]) / halvings > orders).all()
    assert (found[1:] < 0.75 * found[:-1]).all()


@lru_cache
def square_punch_compliance(nodes):
    """Δ E* l / F of a flat square of l = N δ: the elements reach half a spacing beyond the outermost nodes."""
    _, _, _, force = pressed(np.zeros((nodes, nodes)), 1.0, rtol=1e-9)
    return nodes / (nodes - 1) / force


@pytest.mark.parametrize(
    ("nodes", "compliance"), [(129, 0.8701463), pytest.param(257, 0.8689983, marks=pytest.mark.slow)]
)
def test_square_punch_on_known_lattices(nodes, compliance):
    assert square_punch_compliance(nodes) == pytest.approx(compliance, abs=6e-8)


def test_square_punch_converges_to_the_plate():
    values = [square_punch_compliance(nodes) for nodes in (17, 33, 65, 129)]
    excess = [value / closed_forms.SQUARE_PUNCH_COMPLIANCE - 1.0 for value in values]
    assert all(1.85 < coarse / fine < 2.0 for coarse, fine in pairwise(excess))  # first order: singular edges
    assert excess[-1] < 2.8e-3
    # extrapolated in 1/N and 1/N², from the three finest
    first, second = 2.0 * values[2] - values[1], 2.0 * values[3] - values[2]
    assert (4.0 * second - first) / 3.0 == pytest.approx(closed_forms.SQUARE_PUNCH_COMPLIANCE, rel=2e-5)


# ---- a wave of one period


def wave_errors(n, kernel, ratio=0.25):
    """Errors of p and of the mean gap of a wave of n elements under Westergaard's mean pressure."""
    x = np.arange(n) / n
    surface = Surface(np.repeat(np.cos(2.0 * np.pi * x)[:, None], 5, axis=1), 1.0 / n, sides="periodic")
    exact = closed_forms.westergaard(x, ratio, 1.0, 1.0)
    space = half_space(surface.shape, kernel, "periodic")
    unit = surface.Sq
    approach = indentation_for(surface, space, "pressure", exact.mean_pressure / unit, rtol=1e-9)
    contact = solve(surface, space, approach, rtol=1e-9)
    return (
        float(np.sqrt(np.mean((contact.pressure()[:, 0] * unit - exact.pressure) ** 2))),
        abs(contact.free_volume * unit / 2.0 - float(westergaard_mean_gap(ratio))),
    )


ORDERS = {"love": (1.0, 2.0), "fourier": (1.0, 2.0), "punch": (0.75, 1.0)}  # of pressures, and of the mean gap


@pytest.mark.parametrize(("kernel", "orders"), ORDERS.items())
def test_wave_converges_to_westergaard(kernel, orders):
    """Order of convergence by kernel, over an eightfold refinement."""
    for before, after, order in zip(wave_errors(64, kernel), wave_errors(512, kernel), orders, strict=True):
        assert math.log(before / after) / math.log(8.0) == pytest.approx(order, abs=0.35)
        assert after < {1.0: 5e-3, 2.0: 1e-6, 0.75: 2e-2}[order]


@pytest.mark.skipif(not (REFERENCE / "periodic_64.npz").exists(), reason="no reference files here")
def test_two_other_codes_find_the_same():
    """periodic_64.npz: Fourier kernel, mean pressure imposed. A* exact, mean gap and largest pressure to 1e-8."""
    with np.load(REFERENCE / "periodic_64.npz") as stored:
        surface, rows = Surface(stored["z"], float(stored["L"]) / 64, sides="periodic"), stored["rows"]
    space, unit = half_space((64, 64), "fourier", "periodic"), surface.Sq
    for pressure, area, gap, largest in rows:
        state = state_under(Trials(surface, space, rtol=1.6e-12), pressure / unit, 1.0)
        assert state.mean_pressure * unit == pytest.approx(pressure, rel=1e-10)
        assert state.contact_area_fraction == area
        assert state.free_volume * unit == pytest.approx(gap, rel=1e-8)
        assert state.pressure().max() * unit == pytest.approx(largest, rel=1e-8)
