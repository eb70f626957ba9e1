"""How often the window part of a leak card holds a joint of which the map is a window: leak, and closing load.

    python -m tests.bench.window_coverage --first 1000 --joints 10

A periodic joint of 256 × 256 elements is the truth, four windows of 64 × 64 of it, levelled and mirrored at their
sides, are the maps. Seeds below `FRESH` were used to set `QUADRANTS` of `roughvol.analysis.leak_budget.window`, those
from `FRESH` on were not. Solved numbers are kept in `--kept`.
"""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from roughvol.analysis.leak_budget.window import scatter_of_loads
from roughvol.contact import HalfSpace, first_indentation, indentation_for
from roughvol.contact.loading import Contact, sweep
from roughvol.gap import clusters, transport
from roughvol.observables.void import quarters
from roughvol.surfaces import Spectrum, Surface, power_law_surface
from roughvol.surfaces.treatment import level
from roughvol.typing import Array
from tests.bench.card_coverage import Solved

FRESH = 1000
NODES, SIDE = 256, 64
CORNERS = ((0, 0), (64, 128), (128, 64), (192, 192))
LOADS = (0.1, 0.3, 0.6)  # over the closing load of the joint
LIGHT = 0.5  # of the indentation at which the way closes: where a card has the flows of its quadrants
CURVE = np.linspace(0.1, 0.95, 9)
RTOL, ACCURACY = 1e-5, 1e-3


def joint_of(seed: int) -> tuple[float, Surface]:
    """Return the roll-off wavelengths of a window, and the joint."""
    draw = np.random.default_rng([seed, 34]).choice
    hurst, rolloff = float(draw([0.5, 0.8])), float(draw([4, 8, 16]))
    spectrum = Spectrum(rolloff=rolloff, cut=NODES / 4, Sq=0.01, periodic=True)
    return rolloff * SIDE / NODES, power_law_surface(spectrum, hurst, NODES, seed=seed)


def _flow(gap: Array, axis: int, *, periodic: bool = False) -> float:
    return float(transport.conduction(gap, axis, periodic=periodic, accuracy=ACCURACY).coefficient * gap.mean() ** 3)


def pressed(surface: Surface, loads: list[float]) -> dict[str, Any]:
    """Return closing loads, leaks at nominal pressures and along a curve, of the whole and of its quadrants."""
    half_space, periodic = HalfSpace(surface.shape, sides=surface.sides), surface.periodic

    def shut(contact: Contact, axis: int) -> bool:
        return not clusters.percolates(contact.gap() > 0.0, axis, periodic=periodic)

    def state(contact: Contact) -> dict[str, Any]:
        gap = surface.Sq * contact.gap()
        leaks = [_flow(gap, axis, periodic=periodic) for axis in (0, 1)]
        parts = [[_flow(part, axis) for part in quarters(gap)] for axis in (0, 1)]
        return {"load": contact.mean_pressure * unit, "leak": leaks, "quadrants": [] if periodic else parts}

    unit = surface.Sq / surface.side
    ends = [
        first_indentation(surface, half_space, lambda c, a=axis: shut(c, a), accuracy=1e-3, rtol=RTOL)
        for axis in (0, 1)
    ]
    closings = [next(sweep(surface, half_space, [end], rtol=RTOL)).mean_pressure * unit for end in ends]
    loads = loads or [share * float(np.mean(closings)) for share in LOADS]
    places = [indentation_for(surface, half_space, "pressure", load / unit, rtol=RTOL) for load in loads]
    found = {"closing": closings, "at": [state(one) for one in sweep(surface, half_space, places, rtol=RTOL)]}
    if not periodic:
        steps = sorted([LIGHT, *CURVE])
        along = [state(one) for one in sweep(surface, half_space, np.array(steps) * max(ends), rtol=RTOL)]
        found |= {"light": along[steps.index(LIGHT)], "curve": along}
    return found


def solved(seed: int, kept: Path) -> dict[str, Any]:
    """Return the numbers of a joint and of its windows, solved or read."""
    kept.mkdir(parents=True, exist_ok=True)
    file = kept / f"window_{seed}.json"
    if not file.exists():
        _, joint = joint_of(seed)
        with threadpool_limits(1):
            truth = pressed(joint, [])
            loads, windows = [state["load"] for state in truth["at"]], []
            for row, column in CORNERS:
                heights = level(joint.heights[row : row + SIDE, column : column + SIDE], "tilt")
                windows.append(pressed(Surface(heights, joint.spacing, sides="mirrored"), loads))
        file.write_text(json.dumps({"truth": truth, "windows": windows}))
    return dict(json.loads(file.read_text()))


def _scatter(own: Solved, axis: str, state: dict[str, Any]) -> float:
    k = "xy".index(axis)
    ratios = np.array(state["quadrants"][k]) / (state["leak"][k] or math.inf)
    return scatter_of_loads(own, axis, ratios, state["load"])


def main() -> None:
    """Print the coverage."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=FRESH)
    parser.add_argument("--joints", type=int, default=10)
    parser.add_argument("--kept", type=Path, default=Path("/tmp/roughvol_coverage"))
    given = parser.parse_args()
    rows: dict[str, list[tuple[bool, float]]] = {}
    for seed in range(given.first, given.first + given.joints):
        waves, _ = joint_of(seed)
        found = solved(seed, given.kept)
        for window in found["windows"]:
            for axis in (0, 1):
                name, truth = "xy"[axis], found["truth"]["closing"][axis]
                curve = [(state["load"], state["leak"]) for state in window["curve"]]
                leaks = {"closing": window["closing"], "leak": [state["leak"] for state in window["at"]]}
                leaks["Sdq"] = math.nan  # of the part of the grid
                loads = [state["load"] for state in window["at"]]
                maps = [Solved(leaks, place, loads, curve) for place in range(len(LOADS))]
                half = _scatter(maps[0], name, window["light"])
                held = abs(math.log(truth / window["closing"][axis])) <= half
                rows.setdefault(f"closing load, L/λ_r = {waves:g}", []).append((held, half))
                for share, own, state, at in zip(LOADS, maps, window["at"], found["truth"]["at"], strict=True):
                    if not own.leak(name) > 0.0:  # the interval of a closed way is that of its closing load
                        continue
                    half = _scatter(own, name, state)
                    low, high = own.leak_if(name, -half), own.leak_if(name, half)
                    held, factor = low <= at["leak"][axis] <= high, math.log(high / own.leak(name))
                    rows.setdefault(f"leak at {share} of it, L/λ_r = {waves:g}", []).append((held, factor))
    for words, ways in sorted(rows.items()):
        held, halves = zip(*ways, strict=True)
        print(f"{words}: {100.0 * np.mean(held):.0f} % of {len(ways)}, median factor {np.exp(np.median(halves)):.2f}")
    for start in ("closing", "leak"):
        held = [way[0] for words, ways in rows.items() if words.startswith(start) for way in ways]
        print(f"{start}: {100.0 * np.mean(held):.1f} % of {len(held)}")


if __name__ == "__main__":
    main()
