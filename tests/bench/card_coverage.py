"""How often the intervals of a leak card hold leak and closing load of a finer surface: the parts grid and levelling.

    python -m tests.bench.card_coverage --first 4000 --surfaces 200

A surface of 257 × 257 elements is the truth. Each fourth height, or means of 4 × 4 heights, are the scan. Seeds below
3000 were used to set the rules of `roughvol.analysis.leak_budget.grid`, those from 3000 on were not. Solved numbers
are kept in `--kept`, so that rules are tried again without new solves.
"""

import argparse
import json
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from threadpoolctl import threadpool_limits

from roughvol.analysis.closing import Closing, Span
from roughvol.analysis.leak_budget.card import _at_most
from roughvol.analysis.leak_budget.grid import Finer, grid_part, grid_part_of_load
from roughvol.analysis.leak_budget.levelling import Levelled, levelling_part, levelling_part_of_load
from roughvol.analysis.leak_budget.state import Loaded, curve_of
from roughvol.analysis.parts import together
from roughvol.analysis.stored_run import Run
from roughvol.contact import HalfSpace, first_indentation, indentation_for
from roughvol.contact.loading import Contact, sweep
from roughvol.gap import clusters, transport
from roughvol.store.dataset import Dataset
from roughvol.study import Level
from roughvol.surfaces import Spectrum, Surface, power_law_surface, random_midpoint_displacement, texture
from roughvol.surfaces.treatment import block_means, fill, level
from roughvol.typing import Array, Sides

COARSER, NODES = 4, 256  # scan over truth, nodes of the truth along a side
FRACTIONS = (0.25, 0.5, 0.75)  # of the indentation at which the truth closes
CURVE = np.linspace(0.1, 0.99, 10)  # of that at which the scan closes
FEWEST = 16  # nodes of a side of the coarsest grid
RTOL, ACCURACY = 1e-5, 1e-3
GRIDS = ("scan", "twice", "four", "level")
LOADS = ("wide open", "half way", "nearly closed")
LEAST = 0.93
Numbers = dict[str, Any]


@dataclass(frozen=True)
class Kind:
    """A random surface and its scan."""

    seed: int
    law: str  # midpoint or spectrum
    D: float
    rolloff: float
    cut: float  # shortest wave in spacings of the truth
    anisotropy: float
    flaw: str
    sampled: str


def kind_of(seed: int) -> Kind:
    """Return the kind of a seed, all kinds about as often."""
    draw = np.random.default_rng([seed, 32]).choice
    return Kind(
        seed=seed,
        law=("midpoint", "spectrum", "spectrum")[seed % 3],
        D=float(draw([2.1, 2.3, 2.5, 2.7])),
        rolloff=float(draw([4, 8, 16])),
        cut=float(draw([2, 4, 8, 16])),
        anisotropy=float(draw([1, 3])),
        flaw=str(draw(["plain", "tilted", "noisy", "missing"])),
        sampled=str(draw(["decimated", "averaged"])),
    )


def truth_of(kind: Kind, nodes: int = NODES, sides: Sides = "free") -> Surface:
    """Return the fine surface of a kind, levelled, of side 1 and Sq 0.01."""
    if kind.law == "midpoint":
        heights = random_midpoint_displacement(kind.D, nodes.bit_length() - 1, seed=kind.seed).heights
    else:
        spectrum = Spectrum(
            rolloff=min(kind.rolloff, 0.5 * nodes / kind.cut),
            cut=nodes / kind.cut,
            Sq=0.01,
            anisotropy=kind.anisotropy,
            periodic=False,
        )
        heights = power_law_surface(spectrum, min(3.0 - kind.D, 0.9), nodes, seed=kind.seed).heights
    heights = level(heights, "tilt")
    return Surface(0.01 * heights / heights.std(), 1.0 / nodes, sides=sides)


def scan_of(kind: Kind, truth: Surface, coarser: int = COARSER) -> tuple[Array, float]:
    """Return the heights of a scan, NaN where missing, and its side."""
    rng = np.random.default_rng([kind.seed, 33])
    heights = (
        truth.heights[::coarser, ::coarser] if kind.sampled == "decimated" else block_means(truth.heights, coarser)
    )
    heights = heights.copy()
    side = (len(heights) - 1) * coarser * truth.spacing
    if kind.flaw == "tilted":
        heights += 0.03 * np.linspace(0.0, 1.0, len(heights))[:, None]
    if kind.flaw == "noisy":
        heights += 0.03 * truth.Sq * rng.standard_normal(heights.shape)
    if kind.flaw == "missing":
        heights[rng.random(heights.shape) < 0.02] = np.nan
    return heights, side


def pressed_of(heights: Array, side: float, sides: Sides, downsample: int = 1, degree: str = "tilt") -> Surface:
    """Return a scan as a study presses it."""
    heights = fill(level(block_means(heights, downsample), degree), "interpolate")
    return Surface(heights, side / (len(heights) - 1), sides=sides)


def grids_of(kind: Kind, truth: Surface, sides: Sides) -> dict[str, Surface]:
    """Return the scan of a surface, the same on coarser grids, and with another levelling at twice the spacing."""
    heights, side = scan_of(kind, truth)
    given = {"scan": (1, "tilt"), "twice": (2, "tilt"), "four": (4, "tilt"), "level": (2, "quadratic")}
    few = len(heights) // 4 < FEWEST
    return {name: pressed_of(heights, side, sides, *of) for name, of in given.items() if not (few and name == "four")}


def load_of(surface: Surface, contact: Contact) -> float:
    """Return the nominal pressure over E*."""
    return contact.mean_pressure * surface.Sq / surface.side


def leaks_of(surface: Surface, contact: Contact) -> list[float]:
    """Return the leaks along x and y, T* V*³ Sq³."""
    gap = surface.Sq * contact.gap()
    flows = (transport.conduction(gap, axis, accuracy=ACCURACY).coefficient for axis in (0, 1))
    return [float(flow * gap.mean() ** 3) for flow in flows]


def closings_of(surface: Surface, half_space: HalfSpace) -> tuple[list[float], list[float]]:
    """Return indentations and loads at which the last way along x and y closes."""
    ends = [
        first_indentation(
            surface, half_space, lambda c, a=axis: not clusters.percolates(c.gap() > 0.0, a), accuracy=1e-3, rtol=RTOL
        )
        for axis in (0, 1)
    ]
    states = [next(sweep(surface, half_space, [end], rtol=RTOL)) for end in ends]
    return ends, [load_of(surface, state) for state in states]


def at_loads(surface: Surface, loads: list[float]) -> Numbers:
    """Return closing loads, and leaks at nominal pressures."""
    half_space = HalfSpace(surface.shape, sides=surface.sides)
    ends, closings = closings_of(surface, half_space)
    unit = surface.Sq / surface.side
    places = [indentation_for(surface, half_space, "pressure", load / unit, rtol=RTOL) for load in loads]
    leaks = [leaks_of(surface, state) for state in sweep(surface, half_space, sorted(places), rtol=RTOL)]
    return {"closing": closings, "leak": leaks, "ends": ends}


def solved(kind: Kind, nodes: int, sides: Sides) -> Numbers:
    """Return the numbers of truth, scan, coarser grids and another levelling."""
    truth = truth_of(kind, nodes, sides)
    half_space = HalfSpace(truth.shape, sides=sides)
    ends, closings = closings_of(truth, half_space)
    states = list(sweep(truth, half_space, [share * max(ends) for share in FRACTIONS], rtol=RTOL))
    loads = [load_of(truth, state) for state in states]
    leaks = [leaks_of(truth, state) for state in states]
    found: Numbers = {"truth": {"closing": closings, "leak": leaks, "area": [s.contact_area_fraction for s in states]}}
    del states, half_space
    grids = grids_of(kind, truth, sides)
    found |= {name: at_loads(surface, loads) for name, surface in grids.items()}
    scan = grids["scan"]
    curve = sweep(scan, HalfSpace(scan.shape, sides=sides), CURVE * max(found["scan"]["ends"]), rtol=RTOL)
    found["curve"] = [(load_of(scan, state), leaks_of(scan, state)) for state in curve]
    return found | {"loads": loads}


def every(seeds: range, kept: Path, nodes: int, sides: Sides) -> Iterator[tuple[Kind, Numbers]]:
    """Yield all kinds with their numbers, solved or read."""
    kept.mkdir(parents=True, exist_ok=True)
    for seed in seeds:
        file = kept / f"{nodes}_{sides}_{seed}.json"
        if not file.exists():
            with threadpool_limits(1):
                started = time.process_time()
                found = solved(kind_of(seed), nodes, sides)
            file.write_text(json.dumps(found | {"seconds": time.process_time() - started}))
        kind, found = kind_of(seed), json.loads(file.read_text())
        truth = truth_of(kind, nodes, sides)
        for name, surface in ({"truth": truth} | grids_of(kind, truth, sides)).items():
            found[name]["Sdq"] = texture.Sdq(surface.with_neighbours, surface.spacing)
        yield kind, found


class Solved(Loaded):
    """Solved numbers of a grid in the place of a run."""

    def __init__(self, numbers: Numbers, place: int, loads: list[float], curve: list[Any]) -> None:
        super().__init__(
            "",
            Run("", Dataset(), None),
            Level("last"),
            Dataset({"mean_pressure": 0.0, "Sdq": ("seed", [numbers["Sdq"]])}),
            None,
            "",
        )
        self.__dict__.update(numbers=numbers, place=place, loads=loads, points=curve)

    def leak(self, axis: str, name: str = "") -> float:
        """Return the leak at the load."""
        return float(self.numbers["leak"][self.place]["xy".index(axis)])

    def number(self, name: str, axis: str = "") -> float:
        """Return the slope of the surface, or the load."""
        return super().number(name) if name == "Sdq" else float(self.loads[self.place])

    @cached_property
    def closing(self) -> dict[str, Closing]:
        """The closing loads."""
        loads = zip("xy", self.numbers["closing"], strict=True)
        return {axis: Closing((Span(float(load), float(load)),), "") for axis, load in loads}

    def curve(self, axis: str, name: str = "") -> PchipInterpolator | None:
        """Return the logarithm of the leak."""
        points = {load: leaks["xy".index(axis)] for load, leaks in self.points}
        return curve_of(points | {self.load: self.leak(axis)}, self.closing[axis].value)


def intervals(found: Numbers) -> Iterator[tuple[str, float, float, float, float]]:
    """Yield of each way leak or closing, truth, number of the scan, and the ends of its interval without window."""
    for axis, k in (("x", 0), ("y", 1)):
        for place in range(len(FRACTIONS)):
            own = {name: list(zip(found["loads"], found[name]["leak"], strict=True)) for name in GRIDS if name in found}
            own["scan"] = found["curve"]
            grids = {name: Solved(found[name], place, found["loads"], curve) for name, curve in own.items()}
            fine = [grids.pop("scan")]
            levelled = Levelled("", [grids["twice"]], [grids.pop("level")])
            coarser = [(name, [grid]) for name, grid in grids.items()]
            finer = [Finer.of(fine[0], [grid for _, (grid,) in coarser])]
            of_load = (
                grid_part_of_load(fine, coarser, finer, axis),
                levelling_part_of_load(levelled, axis),
            )
            closing = Closing(fine[0].closing[axis].spans, "", of_load)
            if place == 0:
                yield "closing", found["truth"]["closing"][k], closing.value, *closing.interval
            leak, truth = fine[0].leak(axis), found["truth"]["leak"][place][k]
            if leak > 0.0:
                parts = (
                    grid_part(fine, coarser, finer, axis),
                    levelling_part(fine, levelled, axis),
                )
                smaller, larger = together(parts)
                yield LOADS[place], truth, leak, leak / smaller, leak * larger
            else:
                yield "closed", truth, 0.0, 0.0, _at_most(fine, closing, axis)


def main() -> None:
    """Print the coverage by kind, and by how much narrower intervals would still hold 93 %."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=4000)
    parser.add_argument("--surfaces", type=int, default=200)
    parser.add_argument("--sides", default="free", choices=("free", "mirrored"))
    parser.add_argument("--nodes", type=int, default=NODES)
    parser.add_argument("--kept", type=Path, default=Path("/tmp/roughvol_coverage"))
    given = parser.parse_args()
    rows: dict[str, list[tuple[bool, float]]] = {}
    ways: list[tuple[str, float, float, float, float]] = []
    changes: list[list[float]] = []
    for kind, found in every(range(given.first, given.first + given.surfaces), given.kept, given.nodes, given.sides):
        for k in (0, 1):
            loads = [found[grid]["closing"][k] for grid in ("truth", "scan", "twice")]
            changes.append([loads[0] / loads[1], found["truth"]["Sdq"] / found["scan"]["Sdq"], loads[1] / loads[2]])
        for way in intervals(found):
            name, truth, _, low, high = way
            ways.append(way)
            of = "closing load" if name == "closing" else "leak"
            held = low <= truth <= high
            factor = math.sqrt(high / low) if low > 0.0 else math.inf
            for words in ("all", *_words(kind), *([name] if of == "leak" else [])):
                rows.setdefault(f"{of}: {words}", []).append((held, factor))
    print("| | ways | held | median factor |\n|---|---|---|---|")
    for words, found_ways in sorted(rows.items()):
        held, factors = zip(*found_ways, strict=True)
        middle = f"{np.median(factors):.2f}" if math.isfinite(np.median(factors)) else "from 0"
        print(f"| {words} | {len(held)} | {100.0 * np.mean(held):.0f} % | {middle} |")
    slope, twice = np.corrcoef(np.log(changes).T)[0, 1:]
    print(f"closing, truth over scan: correlation {slope:.2f} with the slopes, {twice:.2f} with scan over twice")
    for of in ("closing", "leak"):
        some = [way[1:] for way in ways if (way[0] == "closing") == (of == "closing") and way[2] > 0.0]
        shares = [(share, float(np.mean([_held(share, *way) for way in some]))) for share in np.arange(0.3, 1.5, 0.02)]
        needed = next((share for share, held in shares if held >= LEAST), math.nan)
        halves = [0.5 * math.log(high / low) for _, _, low, high in some if low > 0.0]
        print(f"{of}: {LEAST:.0%} needs {needed:.2f} of the logarithm of the factor,", end=" ")
        print(f"{math.exp((1.0 - needed) * float(np.median(halves))):.2f} times less in the median")


def _words(kind: Kind) -> tuple[str, ...]:
    law = (
        f"midpoint D {kind.D:g}" if kind.law == "midpoint" else f"spectrum, shortest wave {kind.cut / COARSER:g} pixels"
    )
    more = () if kind.law == "midpoint" else (f"spectrum, L/λ_r {kind.rolloff:g}", f"spectrum, {kind.anisotropy:g} : 1")
    return law, kind.flaw, kind.sampled, *more


def _held(share: float, truth: float, number: float, low: float, high: float) -> bool:
    """Return whether an interval with a share of its logarithms holds the truth."""
    with np.errstate(divide="ignore"):
        ends = (number * (np.float64(low) / number) ** share, number * (high / number) ** share)
    return bool(ends[0] <= truth <= ends[1])


if __name__ == "__main__":
    main()
