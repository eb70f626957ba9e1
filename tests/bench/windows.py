"""A scan as a patch: the leak of windows of a known joint, with free sides, in their interior, and mirrored.

    python -m tests.bench.windows --windows 9
    python -m tests.bench.windows --hurst 0.5 --rolloff 8 --joints 4 --windows 4 --areas 0.05 0.15 0.3

A joint is one period of a random surface: 512² elements, λ_s = 4 δ, L = 2 mm, Sq = 0.5 µm, E* = 10 MPa. The fluid of
1 mPa·s has a pressure drop of 1 mbar. Windows of 129² nodes do not overlap, and are levelled as scans.
Windows are pressed to the nominal pressures of their joint. The leak is that of a square.
"""

import argparse
import itertools
import math
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

import roughvol
from roughvol.surfaces import Spectrum, power_law_surface

SIDE, HEIGHT, SHORTEST = 2000.0, 0.5, 4  # L and Sq in µm, λ_s/δ
TREATED: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {  # keys of the surface, and of the record
    "free": ({"sides": "free"}, {}),
    "free, interior": ({"sides": "free"}, {"region": "interior"}),
    "mirrored": ({"sides": "mirrored"}, {}),
}
Leaks = NDArray[np.float64]


def leaks(heights: Leaks, L: float, surface: dict[str, Any], record: dict[str, Any], loads: dict[str, Any]) -> Any:
    """Return the states of a map under loads, with the leak along both axes."""
    fluid = {"pressure_drop": "1 mbar", "viscosity": "1 mPa*s", "unit": "mm^3/s"}
    record = record | {"transport": {"transmissivity": "every-step"}, "dimensional": {"leak_rate": fluid}}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", roughvol.RoughvolWarning)
        return roughvol.press(
            heights, L=f"{L!r} um", E_star="10 MPa", sweep=loads, record=record, surface=surface, jobs=1
        )


def joint(args: argparse.Namespace, seed: int) -> tuple[Any, dict[str, list[Any]]]:
    """Return the states of a joint, and those of its windows by their treatment."""
    spectrum = Spectrum(rolloff=args.rolloff, cut=args.nodes / SHORTEST, Sq=HEIGHT)
    z = power_law_surface(spectrum, args.hurst, args.nodes, side=SIDE, seed=seed).heights
    loads = {"contact_areas": args.areas} if args.areas else {"pressures": [f"{p} MPa" for p in args.pressures]}
    whole = leaks(z, SIDE, {"sides": "periodic"}, {}, loads)
    loads = {"pressures": [f"{p:.9g} MPa" for p in whole["nominal_pressure"].values.tolist()]}
    starts = np.linspace(0, args.nodes - args.window, math.ceil(math.sqrt(args.windows))).round().astype(int).tolist()
    found: dict[str, list[Any]] = {name: [] for name in TREATED}
    for row, column in itertools.islice(itertools.product(starts, repeat=2), args.windows):
        part = np.s_[row : row + args.window, column : column + args.window]
        for name, (surface, record) in TREATED.items():
            L = SIDE / args.nodes * (args.window - 1)
            found[name].append(leaks(z[part], L, surface | {"level": "tilt"}, record, loads))
    return whole, found


def cell(values: Leaks, truth: float) -> str:
    """Return geometric mean, factor to the joint and scatter of the open ways, and the number of closed ones."""
    open_ = np.log(values[values > 0.0])
    if not open_.size:
        return f"all {values.size} closed"
    closed = f", {values.size - open_.size} of {values.size} closed" * (open_.size < values.size)
    mean, scatter = float(np.exp(open_.mean())), float(np.exp(open_.std(ddof=1)))
    return f"{mean:.3g} ({mean / truth:.2f}), ×÷ {scatter:.2g}{closed}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hurst", type=float, default=0.8)
    parser.add_argument("--rolloff", type=float, default=16.0, help="L/λ_r of the joint")
    parser.add_argument("--joints", type=int, default=8)
    parser.add_argument("--windows", type=int, default=3, help="windows of each joint")
    parser.add_argument("--nodes", type=int, default=512)
    parser.add_argument("--window", type=int, default=129)
    parser.add_argument("--pressures", type=float, nargs="+", default=[0.03, 0.08], help="MPa")
    parser.add_argument("--areas", type=float, nargs="+", help="A* of the joints, in place of pressures")
    args = parser.parse_args()
    joints = [joint(args, seed) for seed in range(args.joints)]
    states = len(args.areas or args.pressures)
    print(f"| leak in mm³/s, factor to the joints, scatter | {' | '.join(_heads(args, joints))} |")
    print("|---" * (states + 1) + "|")
    rows = {"the joints": [whole for whole, _ in joints]}
    rows |= {name: [one for _, found in joints for one in found[name]] for name in TREATED}
    truths: list[float] = []
    for name, results in rows.items():
        values = np.array([one["leak_rate"].transpose("step", ...).values for one in results])  # result, step, axis
        by_state = [values[:, k].ravel() for k in range(states)]
        truths = truths or [float(np.exp(np.log(some[some > 0.0]).mean())) for some in by_state]
        cells = (cell(some, truth) for some, truth in zip(by_state, truths, strict=True))
        print(f"| {name} | {' | '.join(cells)} |")
    print()  # a table of another call is a table of its own


def _heads(args: argparse.Namespace, joints: list[tuple[Any, dict[str, list[Any]]]]) -> list[str]:
    """Return pressure and contact area of each state, means over the joints."""
    heads = []
    for k in range(len(args.areas or args.pressures)):
        states = [whole.isel(step=k) for whole, _ in joints]
        pressure, area = (
            float(np.mean([float(state[name]) for state in states]))
            for name in ("nominal_pressure", "contact_area_fraction")
        )
        heads.append(f"{pressure:.3g} MPa, A\\* = {area:.2g}")
    return heads


if __name__ == "__main__":
    main()
