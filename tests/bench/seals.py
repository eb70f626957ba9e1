"""Seals whose leak is known: windows of periodic joints as scans, the joint as the seal.

    python -m tests.bench.seals --joints 30 --kept runs/seals.jsonl

A joint of 512² elements is the truth: the flow through one period, along x or y. Three windows of 129² elements of it,
levelled and mirrored at their sides, are the scans, pressed at the same nominal pressure. `Patches` of the six
conductances give the seal of 4 × 4 patches. Printed are the ratio of its leak to that of the joint, and how often the
joint lies in the interval. Solved joints are kept in a file, a line each.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from roughvol.contact import HalfSpace, first_indentation, indentation_for, solve
from roughvol.contact.state import Contact
from roughvol.gap.clusters import percolates
from roughvol.gap.transport import conduction
from roughvol.surfaces import Spectrum, Surface, power_law_surface
from roughvol.surfaces.treatment import level

NODES, WINDOW, SCANS = 512, 129, 3
CUT = NODES / 4.0  # shortest wave: four elements
LOADS = (0.15, 0.33)  # A* of the joint
RTOL = 1e-5


class Kind(NamedTuple):
    """A kind of joint: Hurst exponent, L/λ_r, ratio of the roll-offs along y and x, and hardness over E* Sq/L."""

    H: float
    rolloff: float
    anisotropy: float = 1.0
    hardness: float | None = None


KINDS = (
    Kind(0.8, 16),
    Kind(0.8, 32),
    Kind(0.5, 16),
    Kind(0.5, 32),
    Kind(0.9, 16),
    Kind(0.9, 32),
    Kind(0.7, 8),
    Kind(0.8, 16, 3.0),
    Kind(0.6, 32, 3.0),
    Kind(0.8, 16, 1.0, 150.0),
)


def joint_of(kind: Kind, seed: int) -> tuple[Surface, list[Surface]]:
    """Return a joint, and levelled windows of it at random places that do not overlap."""
    spectrum = Spectrum(rolloff=kind.rolloff, cut=CUT, anisotropy=kind.anisotropy)
    joint = power_law_surface(spectrum, kind.H, NODES, seed=seed)
    rng = np.random.default_rng(seed)
    z = np.roll(joint.heights, rng.integers(NODES, size=2), axis=(0, 1))
    scans = []
    for place in rng.choice(9, SCANS, replace=False):
        row, column = (170 * int(k) for k in divmod(place, 3))
        cut = level(z[row : row + WINDOW, column : column + WINDOW], "tilt")
        scans.append(Surface(cut, joint.spacing, sides="mirrored"))
    return joint, scans


def pressed(surface: Surface, half_space: HalfSpace, pressure: float, hardness: float | None) -> Contact:
    """Return the state at a nominal pressure over E*."""
    steepness = surface.Sq / surface.side
    starred = pressure / steepness
    if hardness is None:
        there = indentation_for(surface, half_space, "pressure", starred, rtol=RTOL)
        return solve(surface, half_space, there, rtol=RTOL)

    def excess(indentation: float) -> float:
        return solve(surface, half_space, indentation, rtol=RTOL, hardness=hardness).mean_pressure / starred - 1.0

    most = 2.0
    while excess(most) < 0.0:
        most *= 1.5
    there = optimize.brentq(excess, most / 10.0, most, rtol=1e-4)
    return solve(surface, half_space, there, rtol=RTOL, hardness=hardness)


def flows(gap: np.ndarray, unit: float, *, periodic: bool = False) -> list[float]:
    """Return the sheet conductances of a gap along x and y [length³], those of plates one apart being 1."""
    found = (conduction(gap, axis, periodic=periodic).coefficient for axis in (0, 1))
    return [float(one * (gap.mean() * unit) ** 3) for one in found]


def quadrants(gap: np.ndarray, unit: float) -> list[list[float]]:
    """Return the conductances of the quadrants of a gap."""
    parts = (half for rows in np.array_split(gap, 2) for half in np.array_split(rows, 2, axis=1))
    return [flows(np.ascontiguousarray(part), unit) for part in parts]


def closing(surface: Surface, half_space: HalfSpace, axis: int) -> float:
    """Return the nominal pressure over E* at which the last way along an axis closes."""

    def closed(contact: Contact) -> bool:
        return not percolates(contact.gap() > 0.0, axis, periodic=surface.periodic)

    there = first_indentation(surface, half_space, closed, accuracy=1e-3, rtol=RTOL)
    return solve(surface, half_space, there, rtol=RTOL).mean_pressure * surface.Sq / surface.side


def solved(kind: Kind, seed: int) -> dict[str, Any]:
    """Return conductances and closing loads of a joint and its windows."""
    joint, scans = joint_of(kind, seed)
    spaces = [HalfSpace(one.shape, sides=one.sides) for one in (joint, scans[0])]
    hard = [
        None if kind.hardness is None else kind.hardness * r
        for r in (1.0, *(joint.Sq / joint.side / one.Sq * one.side for one in scans))
    ]
    states = []
    for area in LOADS:
        there = indentation_for(joint, spaces[0], "contact_area", area, rtol=RTOL)
        contact = solve(joint, spaces[0], there, rtol=RTOL)
        pressure = contact.mean_pressure * joint.Sq / joint.side
        if kind.hardness is not None:
            contact = pressed(joint, spaces[0], pressure, hard[0])
        there_too = [pressed(one, spaces[1], pressure, h) for one, h in zip(scans, hard[1:], strict=True)]
        states.append(
            {
                "pressure": pressure,
                "joint": flows(contact.gap(), joint.Sq, periodic=True),
                "scans": [flows(c.gap(), s.Sq) for c, s in zip(there_too, scans, strict=True)],
                "quadrants": [quadrants(c.gap(), s.Sq) for c, s in zip(there_too, scans, strict=True)],
            }
        )
    closings = (
        [[]]
        if kind.hardness is not None
        else [[closing(one, spaces[k > 0], axis) for axis in (0, 1)] for k, one in enumerate([joint, *scans])]
    )
    return {"kind": list(kind), "seed": seed, "states": states, "joint": closings[0], "scans": closings[1:]}
