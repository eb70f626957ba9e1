"""Closed forms against numerical integration of the half space, and the laws each of them must obey."""

import math

import numpy as np
import pytest
from scipy.special import ellipk

from roughvol.errors import ContactError, SurfaceError
from roughvol.reproduction import closed_forms, formulas
from roughvol.surfaces.midpoint import random_midpoint_displacement
from tests.refused import refusals

NODES, WEIGHTS = np.polynomial.legendre.leggauss(200)
DELTA, E_STAR = 0.03, 7.0
PARAMETERS = {"hertz": 2.0, "circular_punch": 0.4, "cone": 0.2}
SHAPES = {
    shape: (parameter, *(getattr(closed_forms, shape + part) for part in ("", "_pressure", "_displacement")))
    for shape, parameter in PARAMETERS.items()
}


def rings(a):
    """Radii and widths that resolve the square roots at the edge: s = a sin θ."""
    angle = (NODES + 1.0) * math.pi / 4.0
    return a * np.sin(angle), WEIGHTS * math.pi / 4.0 * a * np.cos(angle)


@pytest.mark.parametrize("shape", SHAPES)
def test_pressure_adds_up_to_the_force(shape):
    parameter, contact, pressure, _ = SHAPES[shape]
    force, a, mean = contact(DELTA, parameter, E_STAR)
    s, ds = rings(a)
    assert 2 * math.pi * (pressure(s, DELTA, parameter, E_STAR) * s) @ ds == pytest.approx(force, rel=1e-7)
    assert mean * math.pi * a**2 == pytest.approx(force, rel=1e-14)
    assert pressure(1.001 * a, DELTA, parameter, E_STAR) == 0.0


@pytest.mark.parametrize("shape", SHAPES)
def test_pressure_displaces_the_half_space_as_stated(shape):
    parameter, contact, pressure, displacement = SHAPES[shape]
    a = contact(DELTA, parameter).contact_radius
    s, ds = rings(a)
    p = pressure(s, DELTA, parameter)
    # Boussinesq on the axis, u = 2 ∫ p ds / E*; off the axis each ring is an elliptic integral.
    assert 2.0 * p @ ds == pytest.approx(DELTA, rel=1e-4)
    for r in (1.2 * a, 2.0 * a, 9.0 * a):
        ring = 4.0 / math.pi * p * s / (r + s) * ellipk(4 * r * s / (r + s) ** 2)
        assert displacement(r, DELTA, parameter) == pytest.approx(ring @ ds, rel=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_displacement_fits_the_indenter_and_touches_smoothly(shape):
    parameter, contact, _, displacement = SHAPES[shape]
    a = contact(DELTA, parameter).contact_radius
    r = np.array([0.0, 0.3, 0.999, 1.0, 1.0 + 1e-9]) * a
    indenter = {"hertz": r**2 / (2 * parameter), "circular_punch": 0.0 * r, "cone": parameter * r}[shape]
    np.testing.assert_allclose(displacement(r, DELTA, parameter), DELTA - indenter, rtol=1e-4)
    force = contact(DELTA, parameter).force
    assert displacement(1e3 * a, DELTA, parameter) == pytest.approx(force / (math.pi * 1e3 * a), rel=1e-4)


@pytest.mark.parametrize("shape", SHAPES)
def test_force_is_the_slope_of_the_energy(shape):
    # F is homogeneous in Δ: 3/2, 1 and 2; contact radius 1/2, 0 and 1.
    parameter, contact, _, _ = SHAPES[shape]
    one, four = contact(DELTA, parameter), contact(4 * DELTA, parameter)
    powers = {"hertz": (1.5, 0.5), "circular_punch": (1.0, 0.0), "cone": (2.0, 1.0)}[shape]
    ratios = (four.force / one.force, four.contact_radius / one.contact_radius)
    assert ratios == pytest.approx((4 ** powers[0], 4 ** powers[1]), rel=1e-13)
    assert contact(DELTA, parameter, 3.0).force == pytest.approx(3.0 * one.force, rel=1e-14)


def test_infinite_pressures_where_the_solution_has_them():
    assert closed_forms.circular_punch_pressure(0.4, DELTA, 0.4) == math.inf
    assert closed_forms.cone_pressure(0.0, DELTA, 0.2) == math.inf


def test_rectangle_equals_the_integral_of_point_loads():
    a, b = 0.7, 0.4
    s, t = 0.5 * a * NODES[:, None], 0.5 * b * NODES
    weight = 0.25 * a * b * np.outer(WEIGHTS, WEIGHTS)
    for x, y in ((1.0, 0.0), (0.1, 0.9), (-2.0, 3.0)):
        direct = float((weight / np.hypot(x - s, y - t)).sum()) * 5.0 / (math.pi * E_STAR)
        assert closed_forms.rectangle_displacement(x, y, (a, b), 5.0, E_STAR) == pytest.approx(direct, rel=1e-12)


def test_rectangle_is_the_sum_of_its_parts_and_symmetric():
    along = np.linspace(-1.5, 1.5, 13)  # on edges and corners too
    x, y = np.meshgrid(along, along, indexing="ij")
    whole = closed_forms.rectangle_displacement(x, y, (2.0, 1.0))
    parts = sum(closed_forms.rectangle_displacement(x - c, y, (1.0, 1.0)) for c in (-0.5, 0.5))
    np.testing.assert_allclose(whole, parts, rtol=1e-13)
    np.testing.assert_allclose(whole, whole[::-1], rtol=1e-13)
    np.testing.assert_allclose(whole, closed_forms.rectangle_displacement(y, x, (1.0, 2.0)), rtol=1e-13)
    assert whole.max() == whole[6, 6]


def test_single_element():
    centre = float(closed_forms.rectangle_displacement(0.0, 0.0, (0.5, 0.5), 1.0, E_STAR))
    assert closed_forms.single_element_pressure(DELTA, 0.5, E_STAR) == pytest.approx(DELTA / centre, rel=1e-14)


@pytest.mark.parametrize("sides", [(1.0, 1.0), (2.0, 0.5), (0.1, 3.0)])
def test_mean_displacement_is_the_mean(sides):
    x, y = 0.5 * sides[0] * NODES[:, None], 0.5 * sides[1] * NODES
    mean = float(0.25 * WEIGHTS @ closed_forms.rectangle_displacement(x, y, sides, 2.0, 3.0) @ WEIGHTS)
    assert closed_forms.rectangle_mean_displacement(sides, 2.0, 3.0) == pytest.approx(mean, rel=1e-6)


def gaussian_volume_by_quadrature(t):
    z = t - 12.0 * (NODES + 1.0) / 2.0
    return 6.0 * WEIGHTS @ ((t - z) * np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi))


def test_bearing_area_of_gaussian_heights():
    for t in (-3.0, 0.0, 1.7, 4.0):
        assert formulas.bearing_area_volume(t) == pytest.approx(gaussian_volume_by_quadrature(t), rel=1e-9)
    assert formulas.bearing_area_volume(8.0) == pytest.approx(8.0, rel=1e-15)


@pytest.mark.parametrize("factor", [1e-250, 1.0, 1e250])
def test_bearing_area_of_given_heights(factor):
    z = random_midpoint_displacement(2.4, 5, seed=2).heights
    zeta = (z - z.mean()) / z.std()
    t = np.array([zeta.min() - 1, zeta.min(), -0.3, 0.0, 1.1, zeta.max(), 9.0])
    direct = np.maximum(t[:, None] - zeta.ravel(), 0.0).mean(axis=1)
    np.testing.assert_allclose(formulas.bearing_area_volume(t, factor * z), direct, atol=1e-13)
    assert direct[0] == 0.0
    assert direct[-1] == pytest.approx(9.0, rel=1e-14)  # above all heights V* = d/σ


def test_bearing_area_factor_of_the_paper_makes_it_linear_in_the_area():
    area = np.linspace(0.0, 1.0, 5)
    with_factor = formulas.bearing_area_volume(0.5, area_fraction=area)
    np.testing.assert_allclose(with_factor, (1.0 - area) * formulas.bearing_area_volume(0.5), rtol=1e-15)


def thresholds_and_dimensions(bins, length, spacing):
    """Thresholds of a known distribution, v uniform on (0, 1), and the dimensions that Eq. 6 then gives."""
    thresholds = np.linspace(0.0, 1.0, bins + 1)
    inside = 0.1 + 0.9 * thresholds  # a tenth in contact
    return thresholds, np.log(inside * (length / spacing) ** 2) / np.log(length / spacing)


@pytest.mark.parametrize("bins", [1, 2, 10, 100])
def test_volume_from_dimension_as_printed_does_not_converge_and_with_volumes_does(bins):
    thresholds, dimensions = thresholds_and_dimensions(bins, 100.0, 1.0)
    options = {"length": 100.0, "spacing": 1.0, "Sq": 0.5, "area": 1e4}
    printed = formulas.volume_from_dimension(thresholds, dimensions, **options)
    assert printed == pytest.approx(0.9 / 0.5 / bins, rel=1e-12)
    # The exact value: 90 % of the elements are open, with a mean volume of one half.
    volume = formulas.volume_from_dimension(thresholds, dimensions, weight="volume", **options)
    assert volume == pytest.approx(0.9 * 0.5 / 0.5, rel=1e-12)


def test_persson_area():
    small = formulas.persson_area(1e-6, 0.1, Sq=2.0, side=100.0)
    assert small == pytest.approx(math.sqrt(8 / math.pi) * 1e-6 * 2.0 / (100.0 * 0.1), rel=1e-9)
    area = formulas.persson_area(np.linspace(0.0, 1e3, 200), 0.1, Sq=2.0, side=100.0)
    assert np.all(np.diff(area) >= 0.0)
    assert (area[0], area[-1]) == (0.0, 1.0)
    # Invariant under x, y → λ x, λ y: the slope falls as the side grows.
    pressures = np.array([0.1, 3.0])
    one, ten = (formulas.persson_area(pressures, 0.1 / k, Sq=2.0, side=100.0 * k) for k in (1.0, 10.0))
    np.testing.assert_allclose(one, ten)


def test_critical_radius_is_where_the_plasticity_index_is_one():
    radius = formulas.critical_radius(0.3, 200.0, 5.0)
    assert radius == pytest.approx(0.3 * 1600.0, rel=1e-14)
    assert formulas.plasticity_index(0.3, radius, 200.0, 5.0) == pytest.approx(1.0, rel=1e-14)
    assert formulas.plasticity_index(0.3, radius / 4, 200.0, 5.0) == pytest.approx(2.0, rel=1e-14)


def volume(thresholds, dimensions, **options):
    return formulas.volume_from_dimension(thresholds, dimensions, length=1.0, spacing=0.1, Sq=1.0, area=1.0, **options)


FLAT = np.ones((3, 3))
test_flat_heights_are_refused = refusals(SurfaceError, (lambda: formulas.bearing_area_volume(0.0, FLAT), "not flat"))
test_refused = refusals(
    ContactError,
    (lambda: closed_forms.hertz(0.0, 1.0), "indentation must be finite and positive, got 0.0"),
    (lambda: closed_forms.cone(1.0, -0.1), "slope"),
    (lambda: closed_forms.circular_punch(1.0, math.nan), "radius"),
    (lambda: closed_forms.single_element_pressure(1.0, math.inf), "spacing"),
    (lambda: closed_forms.rectangle_displacement(0.0, 0.0, (1.0, 0.0)), "b must be"),
    (lambda: formulas.bearing_area_volume(0.0, "uniform"), "got 'uniform'"),
    (lambda: formulas.bearing_area_volume(0.0, area_fraction=1.2), r"\[0, 1\], got 1.2"),
    (lambda: formulas.persson_area(1.0, 0.0, Sq=1.0, side=1.0), "Sdq"),
    (lambda: formulas.plasticity_index(1.0, 1.0, 1.0, 0.0), "hardness"),
    (lambda: volume(np.ones(1), np.ones(1)), r"K \+ 1 >= 2"),
    (lambda: volume(np.ones(3), np.ones(2)), r"\(3,\) and \(2,\)"),
    (lambda: volume(-np.arange(3.0), np.ones(3)), "not decrease"),
    (lambda: volume(np.ones(2), np.ones(2), weight="v"), "got 'v'"),
)
