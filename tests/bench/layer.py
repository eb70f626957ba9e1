"""An elastic layer against ContactMechanics, and against the half space.

python -m tests.bench.layer peer         solved states in the displacements of ContactMechanics (`make bench-peers`)
python -m tests.bench.layer thickness    mean gap of layers over that of the half space at one pressure
"""

import sys

import numpy as np

from roughvol.contact import HalfSpace, indentation_for, solve
from roughvol.contact.kernels import LOVE, Kernel, layer
from roughvol.contact.state import Contact
from roughvol.surfaces import Surface, random_midpoint_displacement

YOUNG = 2.0  # drops out


def surfaces() -> dict[str, Surface]:
    """Return a wave in two directions, and fractals of a rough and of a smooth kind."""
    x = 2.0 * np.pi * np.arange(48) / 48
    wavy = Surface(np.cos(x)[:, None] + 0.3 * np.cos(2.0 * x + 1.0), spacing=1.0, sides="periodic")
    fractals = {f"D = {D}": random_midpoint_displacement(D, 6, seed=1, side=64.0, periodic=True) for D in (2.7, 2.2)}
    return {"waves": wavy, **fractals}


def pressed(surface: Surface, kernel: Kernel, pressure: float, rtol: float) -> Contact:
    """Return the state of a p*."""
    half_space = HalfSpace(surface.shape, kernel, sides="periodic")
    return solve(surface, half_space, indentation_for(surface, half_space, "pressure", pressure, rtol=rtol), rtol=rtol)


def peer() -> None:
    """Print by how much solved states miss equilibrium in the displacements of ContactMechanics."""
    from ContactMechanics import PeriodicFFTElasticHalfSpace

    for name, surface in surfaces().items():
        for thickness, nu in ((0.5, 0.3), (3.0, 0.49), (20.0, 0.45)):
            contact = pressed(surface, layer(thickness, nu, elements=False), 2.0, 1e-11)
            # p of p* and lengths over σ with σ = 1: p = p* E* σ/L. Forces are negative there, displacements positive.
            modulus = YOUNG / (1.0 - nu**2)
            p = contact.pressure() * modulus / surface.side
            theirs = PeriodicFFTElasticHalfSpace(
                surface.shape, YOUNG, (surface.side,) * 2, thickness=thickness * surface.spacing, poisson=nu
            )
            u = theirs.evaluate_disp(-p * surface.spacing**2)
            gap = u - surface.heights / surface.unit
            touching = contact.contact()
            gap -= gap[touching].mean()
            inside, outside = np.abs(gap[touching]).max(), gap[~touching].min(initial=np.inf)
            off = np.abs(gap - contact.gap()).max()
            print(f"{name:8} h = {thickness:4} spacings, nu = {nu}: A* = {contact.contact_area_fraction:.3f}")
            print(f"  gap/σ in contact {inside:.1e}, least outside {outside:.1e}, off by {off:.1e}")


def thickness() -> None:
    """Print the mean gap at two pressures over that of the half space, D = 2.2, 128 by 128 elements."""
    surface = random_midpoint_displacement(2.2, 7, seed=0, periodic=True)
    half = {p: pressed(surface, LOVE, p, 1e-9).free_volume for p in (0.2, 2.0)}
    for nu in (0.3, 0.5):
        for share in (1.0, 0.5, 0.25, 0.1, 0.05):
            gaps = [pressed(surface, layer(share * 128, nu), p, 1e-9).free_volume / half[p] - 1.0 for p in half]
            print(
                f"nu = {nu}, h = {share} L: "
                + ", ".join(f"p* = {p}: {gap:+.2%}" for p, gap in zip(half, gaps, strict=True))
            )


if __name__ == "__main__":
    {"peer": peer, "thickness": thickness}[sys.argv[1]]()
