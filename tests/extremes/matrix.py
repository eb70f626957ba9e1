"""The extremes: every cell is one surface pressed, checked against all that must be true of any contact.

`CELLS` holds them by group and name. A cell is a function that returns what it found; it fails by an assertion, and any
warning is an error. What is checked of every state (see `press`): the conditions p ≥ 0, g ≥ 0, p g = 0, contact within
the overlap; the residual, recomputed by another convolution; V* = d/σ + mean(u)/σ; along the loading A* and p* rise and
V* falls; and, up to `DENSE` elements, equality with the solution of the dense problem.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest

from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import solve, sweep
from roughvol.contact.search import indentation_for
from roughvol.errors import ContactError, SurfaceError
from roughvol.study import loads
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.surface import Surface
from tests.contact import kit

from .random_cases import random_case, run

DENSE = 300  # elements; beyond, the dense oracle takes too long
RTOL = 1e-9
ROUNDING = 1e-13

half_space = lru_cache(maxsize=4)(HalfSpace)


@dataclass(frozen=True)
class Found:
    """What a cell reports: largest η/σ, states solved, what was compared beyond the conditions."""

    residual: float
    states: int
    compared: str
    seconds: float = 0.0


@dataclass(frozen=True)
class Cell:
    """One place in the matrix."""

    group: str
    name: str
    run: Callable[[], Found]
    quick: bool


CELLS: list[Cell] = []


def cells(group: str, values: dict[str, object], quick: Sequence[str] | None = None):
    """Register a function of one value as a row of cells; those not named in `quick` (all, if None) are slow."""

    def register(function):
        for name, value in values.items():
            CELLS.append(Cell(group, name, lambda value=value: _timed(function, value), quick is None or name in quick))
        return function

    return register


def _timed(function, value) -> Found:
    started = time.perf_counter()
    found = function(value)
    return Found(found.residual, found.states, found.compared, time.perf_counter() - started)


def press(surface, indentations=None, *, rtol=RTOL, thorough=True, **options) -> tuple[Found, list]:
    """Sweep, check every state, and return the report with the states."""
    if indentations is None:
        indentations = kit.mean_plane(surface) * np.arange(1, 6) / 5
    contacts = list(sweep(surface, half_space(surface.shape), indentations, rtol=rtol, **options))
    small = surface.heights.size <= DENSE
    for contact in contacts if thorough else contacts[-1:]:
        kit.check_conditions(contact, surface, "love", rtol + 50 * ROUNDING * scale(contact), 2.5 * ROUNDING)
        if small:
            dense(contact, surface, rtol)
    rising = kit.numbers(contacts) * (1.0, 1.0, -1.0)
    assert (np.diff(rising, axis=0) >= -4 * rtol * np.maximum(1.0, np.abs(rising[1:]))).all()
    residual = max(contact.residual for contact in contacts)
    return Found(residual, len(contacts), "dense solution" if small else "conditions"), contacts


def scale(contact) -> float:
    return max(1.0, abs(contact.indentation))


def dense(contact, surface, rtol) -> None:
    matrix = kit.dense(surface.shape)
    exact = kit.exact_pressure(matrix, kit.scaled_overlap(surface, contact.indentation).ravel())
    off = matrix @ (kit.lattice_pressure(contact).ravel() - exact)
    assert np.abs(off).max() <= 2 * rtol + 1e-10 * scale(contact)


def same(one, other, tolerance) -> None:
    np.testing.assert_allclose(kit.numbers(one), kit.numbers(other), rtol=tolerance, atol=tolerance)


def alike(surface, scaled, words) -> Found:
    """Compare surfaces that differ in their unit of length."""
    at = kit.mean_plane(surface) * np.arange(1, 6) / 5
    found, contacts = press(scaled, at)
    same(contacts, press(surface, at)[1], 1e-11)
    return Found(found.residual, found.states, words)


def fractal(D, m, **options):
    return random_midpoint_displacement(D, m, **options)


@cells("D", {f"{D}": D for D in (2.0001, 2.001, 2.1, 2.5, 2.9, 2.999, 2.9999)})
def over_D(D):
    found, _ = press(fractal(D, 5, seed=1))
    small, _ = press(fractal(D, 3, seed=1))
    return Found(max(found.residual, small.residual), found.states + small.states, "dense solution (m = 3)")


@cells("m", {f"{m}": m for m in range(1, 13)}, quick=[f"{m}" for m in range(1, 7)])
def over_m(m):
    surface = fractal(2.3, m, seed=2)
    if m <= 10:
        return press(surface, thorough=m <= 8)[0]
    # one state, from nothing, for its residual alone: the other conditions do not change with m; the half space is not
    # kept
    space = HalfSpace(surface.shape)
    contact = solve(surface, space, 0.5 * kit.mean_plane(surface), rtol=1e-6)
    assert contact.converged
    return Found(contact.residual, 1, "one solve, η ≤ 1e-6")


SCALES = {f"1e{k}": 10.0**k for k in (-250, -100, -12, 12, 100, 250)}


@cells("heights ×", SCALES)
def over_heights(factor):
    surface = fractal(2.4, 5, seed=3)
    return alike(surface, Surface(surface.heights * factor, surface.spacing), "equal to × 1")


@cells("L", {f"1e{k}": 10.0**k for k in (-12, -6, 6, 12)})
def over_L(L):
    return alike(fractal(2.4, 5, seed=4, side=1.0), fractal(2.4, 5, seed=4, side=L), "equal to L = 1")


@cells("E*", {f"1e{k}": 10.0**k for k in (-12, -3, 9, 15)})
def over_modulus(modulus):
    text = "surface: {{D: 2.4, m: 4, seeds: 1}}\nsweep: {{steps: 4}}\nmaterial: {{E_star: {:e}}}"
    from roughvol.campaign.one_case import run_case

    one, other = (run_case(loads(text.format(E)).cases()[0]) for E in (1.0, modulus))
    for name in ("contact_area_fraction", "mean_pressure", "free_volume"):
        assert np.array_equal(one[name], other[name])
    return Found(float(other.residual.max()), 4, "equal to E* = 1, to the bit")


@cells("Δ", {name: name for name in ("one ulp", "1e-300", "1e-9", "full contact", "beyond full contact")})
def over_indentation(name):
    surface = fractal(2.3, 3, seed=5)
    if name in ("one ulp", "1e-300", "1e-9"):
        at = {"one ulp": np.finfo(float).eps, "1e-300": 1e-300, "1e-9": 1e-9}[name]
        found, (contact,) = press(surface, [at])
        alone = math.pi * 8 / kit.coefficients((1, 1))[0, 0] * at
        assert contact.contact().sum() == 1
        assert abs(contact.pressure().max() / alone - 1.0) < 1e-12
        return Found(found.residual, 1, "one element alone")
    full = indentation_for(surface, half_space(surface.shape), "contact_area", 1.0)
    if name == "full contact":
        found, contacts = press(surface, [0.99 * full, full])
        assert contacts[-1].contact_area_fraction == 1.0
        return found
    found, contacts = press(surface, [full * k for k in (1.0, 2.0, 3.0, 10.0)])
    p = kit.numbers(contacts)
    assert (p[:, 0] == 1.0).all()
    assert not p[:, 2].any()
    slopes = np.diff(p[:, 1]) / np.diff([c.indentation for c in contacts])
    np.testing.assert_allclose(slopes, slopes[0], rtol=1e-8)
    return Found(found.residual, found.states, "linear loading")


def _shapes() -> dict[str, np.ndarray]:
    rng = np.random.Generator(np.random.PCG64(6))
    i, j = np.indices((17, 17))
    bowl = -((i - 8.0) ** 2 + (j - 8.0) ** 2)
    spike, plateau, step = np.zeros((17, 17)), np.zeros((17, 17)), np.zeros((17, 17))
    spike[8, 5], plateau[4:12, 4:12], step[:, :8] = 1.0, 1.0, 1.0
    denormal = rng.standard_normal((17, 17))
    denormal[denormal < 0.5] = 5e-324
    outliers = rng.standard_normal((17, 17))
    outliers[2, 3], outliers[11, 4], outliers[14, 14] = 1e4, -1e6, 40.0
    terraces = np.round(rng.standard_normal((17, 17)))
    return {
        "flat": np.full((17, 17), 3.0),
        "one spike": spike,
        "one pit": -spike,
        "a step": step,
        "plateau with ties": plateau,
        "terraces": terraces,
        "perfect symmetry": bowl,
        "checkerboard": ((i + j) % 2).astype(float),
        "denormals among heights": denormal,
        "one ulp high": 1.0 + np.finfo(float).eps * ((i * j) % 3),
        "white noise": rng.standard_normal((17, 17)),
        "outliers": outliers,
        "3 × 3": rng.standard_normal((3, 3)),
        "3 × 80": rng.standard_normal((3, 80)),
        "80 × 3": rng.standard_normal((80, 3)),
    }


SHAPES = _shapes()


@cells("shape", {name: name for name in SHAPES})
def over_shapes(name):
    surface = Surface(SHAPES[name], 0.5)
    end = kit.mean_plane(surface) or 1.0
    found, contacts = press(surface, end * np.array([1e-6, 0.1, 0.5, 1.0, 3.0, 1000.0]))
    if name == "perfect symmetry":
        for contact in contacts:
            p = contact.pressure()
            for turned in (p.T, p[::-1], p[:, ::-1]):
                np.testing.assert_allclose(p, turned, atol=1e-8 * p.max())
        return Found(found.residual, found.states, "dense solution, symmetry")
    return found


@cells("size", {"3 × 4000": (3, 4000), "4000 × 3": (4000, 3), "129 × 33": (129, 33)}, quick=["129 × 33", "3 × 4000"])
def over_sizes(shape):
    rng = np.random.Generator(np.random.PCG64(7))
    surface = Surface(rng.standard_normal(shape), 1.0)
    found, contacts = press(surface, [1.0, 2.0, 4.0, 8.0])
    turned = Surface(surface.heights.T.copy(), 1.0)
    again = press(turned, [1.0, 2.0, 4.0, 8.0])[1]
    for one, other in zip(contacts, again, strict=True):
        assert one.contact_area_fraction == other.contact_area_fraction
        assert abs(one.free_volume - other.free_volume) <= 2 * RTOL
    return Found(found.residual, found.states, "equal when turned")


@cells("steps", {"1": 1, "60": 60, "10000": 10_000}, quick=["1", "60"])
def over_steps(steps):
    surface = fractal(2.5, 4, seed=8)
    at = kit.mean_plane(surface) * np.arange(1, steps + 1) / steps
    found, contacts = press(surface, at, thorough=steps < 100)
    same(contacts[-1:], [solve(surface, half_space(surface.shape), at[-1], rtol=RTOL)], 1e-8)
    return Found(found.residual, found.states, "last state = one solve")


@cells("precision", {f"{how}, {rtol:.0e}": (how, rtol) for how in ("mixed", "double") for rtol in (1e-1, 1e-6, 1e-12)})
def over_precision(choice):
    how, rtol = choice
    surface = fractal(2.5, 6, seed=9)
    found, contacts = press(surface, rtol=rtol, precision=how)
    exact = press(surface, rtol=1e-12, precision="double")[1]
    for contact, reference in zip(contacts, exact, strict=True):
        assert abs(contact.free_volume - reference.free_volume) <= contact.residual + 1e-11
        assert abs(contact.mean_pressure / reference.mean_pressure - 1.0) <= 1.01 * contact.mean_pressure_bound + 1e-11
    return Found(found.residual, found.states, "bounds of V* and p* hold")


HARDNESSES = {"H/E* 1e-12": 1e-12, "1e-6": 1e-6, "1e-3": 1e-3, "0.05": 0.05, "1": 1.0, "1e6": 1e6}


@cells("hardness", HARDNESSES)
def over_hardness(hardness):
    surface = fractal(2.4, 5, seed=10)
    limit = hardness * surface.side / surface.Sq
    up = kit.mean_plane(surface) * np.arange(1, 6) / 5
    path = [*up, *up[-2::-1], *up[1:], 1.2 * up[-1]]
    contacts = list(sweep(surface, half_space(surface.shape), path, rtol=RTOL, hardness=limit))
    left = np.zeros(surface.shape)  # plastic displacement at the start of the leg
    for k, contact in enumerate(contacts):
        yielding(contact, surface, limit, left)
        if 0 < k < len(path) - 1 and (path[k + 1] > path[k]) != (path[k] > path[k - 1]):
            left = contact.plastic_displacement()
    again = next(k for k in range(6, len(path)) if path[k] == up[-1])
    same([contacts[again]], [contacts[4]], 1e-7)
    force = np.array([0.0, *(contact.mean_pressure for contact in contacts[:9])])
    assert np.trapezoid(force, [0.0, *path[:9]]) >= -1e-9
    return Found(max(contact.residual for contact in contacts), len(contacts), "bounds on p, reloading, work of a loop")


def yielding(contact, surface, limit, left) -> None:
    """Check 0 ≤ p ≤ H, and the gap to the surface that yields."""
    p, g, plastic = contact.pressure(), contact.gap(), contact.plastic_displacement()
    at_limit = p >= limit * (1.0 - 1e-12)
    assert p.max(initial=0.0) <= limit * (1.0 + 1e-12)
    assert not g[p > 0.0].any()
    assert (plastic - left >= 0.0).all()
    assert not (plastic - left)[~at_limit].any()
    w = kit.summed_displacement(kit.lattice_pressure(contact)) - kit.scaled_overlap(surface, contact.indentation) + left
    eta = max(np.abs(w[(p > 0.0) & ~at_limit]).max(initial=0.0), w[at_limit].max(initial=0.0))
    eta = max(eta, -w[p == 0.0].min(initial=0.0))
    assert eta <= RTOL + 100 * ROUNDING * scale(contact)
    volume = contact.separation + (w + kit.scaled_overlap(surface, contact.indentation) - left).mean() + plastic.mean()
    assert abs(contact.free_volume - max(volume, 0.0)) <= 100 * ROUNDING * scale(contact)


@cells("random", {f"{count} cases": count for count in (40, 600)}, quick=())
def over_random_cases(count, nodes=math.inf):
    states, most, failed = 0, 0.0, []
    for case in filter(lambda case: case.heights.size <= nodes, map(random_case, range(count))):
        try:
            solved, residual = run(case)
        except Exception as error:  # all failures are reported together
            failed.append(f"{case}: {type(error).__name__}: {error}")
        else:
            states, most = states + solved, max(most, residual)
    assert not failed, f"{len(failed)} of {count} fail\n" + "\n".join(failed)
    return Found(most, states, "η ≤ its tolerance of 1e-8 to 1e-3, ends of legs")


REFUSED = (
    *("η below reach", "D = 2", "D = 3", "m = 0", "m = 15", "NaN", "infinite"),
    *("denormals alone", "heights × 1e-300", "2 × 9"),
)


@cells("refused", {name: name for name in REFUSED})
def refusals(name):
    if name == "η below reach":
        surface = fractal(2.5, 3)
        with pytest.raises(ContactError, match="the residual η/σ that double precision can reach"):
            solve(surface, half_space(surface.shape), 500.0, rtol=1e-14)
        return Found(0.0, 0, "error says the best reachable η")
    bad = {"NaN": np.nan, "infinite": np.inf, "denormals alone": 1e-323, "heights × 1e-300": 1e-300}
    try:
        if name in bad or name == "2 × 9":
            heights = np.zeros((2, 9) if name == "2 × 9" else (9, 9))
            heights[1, 1] = bad.get(name, 1.0)
            Surface(heights, 1.0)
        else:
            fractal(float(name[4:]) if name[0] == "D" else 2.3, int(name[4:]) if name[0] == "m" else 4)
    except SurfaceError:
        return Found(0.0, 0, "clear error beforehand")
    raise AssertionError(name)
