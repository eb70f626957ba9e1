"""Seals whose leak is known: windows of periodic joints as scans, the joint as the seal.

    python -m tests.bench.seals --joints 30 --kept runs/seals.jsonl
    python -m tests.bench.seals --joints 10 --closings --kept runs/seals-closing.jsonl
    python -m tests.bench.seals --joints 30 --oblong --kept runs/seals-oblong.jsonl
    python -m tests.bench.seals --roll-off
    python -m tests.bench.seals --known
    python -m tests.bench.seals --long
    python -m tests.bench.seals --grooves
    python -m tests.bench.seals --windows --joints 40 --kept runs/seals.jsonl

A joint of 512² elements is the truth: the flow through one period along x or y. Three windows of 129² elements of it,
levelled and mirrored at their sides, are the scans, pressed to the same nominal pressure. The seal is 4 × 4 patches.
With `--oblong` joints of 1024² elements have roll-offs of 3 : 1. The middle third of a window holds as many waves along
y as along x, and is observed. Whole windows are compared.
Printed are the ratio of its leak to that of the joint, and how often the joint lies in the interval. Solved joints are
kept in a file, a line each, and not solved again.
"""

import argparse
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from roughvol.analysis import seal
from roughvol.analysis.seal import Estimate
from roughvol.contact import HalfSpace, first_indentation, indentation_for, solve
from roughvol.contact.state import Contact
from roughvol.gap import sheet
from roughvol.gap.clusters import percolates
from roughvol.gap.transport import conduction
from roughvol.surfaces import Spectrum, Surface, power_law_surface, random_midpoint_displacement
from roughvol.surfaces.psd import waves
from roughvol.surfaces.treatment import level

NODES, WINDOW, SCANS = 512, 129, 3
LOADS = (0.15, 0.33)  # A* of the joint
RTOL = 1e-5


class Kind(NamedTuple):
    """A kind of joint: Hurst exponent, L/λ_r, ratio of the roll-offs along y and x, hardness over E* Sq/L, elements.

    Of as many strips of a window along y the middle one is observed.
    """

    H: float
    rolloff: float
    anisotropy: float = 1.0
    hardness: float | None = None
    nodes: int = NODES
    strips: int = 1

    def observed(self, field: np.ndarray) -> np.ndarray:
        """Return the part of the field of a window that is observed."""
        return np.ascontiguousarray(np.array_split(field, self.strips, axis=1)[self.strips // 2])


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
GROOVES = (  # conductances of three kinds of patches along the flow, and across
    ((0.0, 0.0, 1.0), (50.0, 100.0, 150.0)),
    ((0.05, 1.0, 4.0), (10.0, 30.0, 60.0)),
    ((3.0, 30.0, 300.0), (0.1, 1.0, 3.0)),
    ((0.001, 1.0, 30.0), (1.0, 30.0, 1000.0)),
    ((0.3, 1.0, 3.0), (0.3, 1.0, 3.0)),
    ((0.0, 0.0036, 0.004), (0.0, 0.012, 0.16)),
)
OBLONG = Kind(0.8, 64, 3.0, None, 1024, 3), Kind(0.6, 64, 3.0, None, 1024, 3)


def joint_of(kind: Kind, seed: int) -> tuple[Surface, list[Surface]]:
    """Return a joint, and levelled windows of it at random places that do not overlap."""
    spectrum = Spectrum(rolloff=kind.rolloff, cut=kind.nodes / 4.0, anisotropy=kind.anisotropy)  # four elements
    joint = power_law_surface(spectrum, kind.H, kind.nodes, seed=seed)
    rng = np.random.default_rng(seed)
    z = np.roll(joint.heights, rng.integers(kind.nodes, size=2), axis=(0, 1))
    places = rng.choice(9, SCANS, replace=False)
    return joint, [scan_of(cut_of(z, place), joint.spacing) for place in places]


def cut_of(field: np.ndarray, place: int) -> np.ndarray:
    """Return one of nine windows of a field."""
    nodes = len(field)
    row, column = (nodes // 3 * int(k) for k in divmod(place, 3))
    side = nodes // 4 + 1
    return np.ascontiguousarray(field[row : row + side, column : column + side])


def scan_of(heights: np.ndarray, spacing: float, levelling: str = "tilt") -> Surface:
    """Return a window of a joint as a mirrored patch."""
    return Surface(level(heights, levelling), spacing, sides="mirrored")


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


def closing(surface: Surface, half_space: HalfSpace, axis: int, kind: Kind) -> float:
    """Return the nominal pressure over E* at which the last way along an axis closes, of a window the observed one."""

    def closed(contact: Contact) -> bool:
        gap = contact.gap() if surface.periodic else kind.observed(contact.gap())
        return not percolates(gap > 0.0, axis, periodic=surface.periodic)

    there = first_indentation(surface, half_space, closed, accuracy=1e-3, rtol=RTOL)
    return solve(surface, half_space, there, rtol=RTOL).mean_pressure * surface.Sq / surface.side


def solved(kind: Kind, seed: int, *, closings: bool) -> dict[str, Any]:
    """Return conductances of a joint and its windows, and their closing loads where they are asked for."""
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
        gaps = [(c.gap(), s.Sq) for c, s in zip(there_too, scans, strict=True)]
        states.append(
            {
                "pressure": pressure,
                "joint": flows(contact.gap(), joint.Sq, periodic=True),
                "scans": [flows(kind.observed(gap), unit) for gap, unit in gaps],
                "quadrants": [quadrants(kind.observed(gap), unit) for gap, unit in gaps],
                "whole": [flows(gap, unit) for gap, unit in gaps] if kind.strips > 1 else [],
            }
        )
    loads: list[list[float]] = [[]]
    if closings and kind.hardness is None:
        loads = [[closing(one, spaces[k > 0], axis, kind) for axis in (0, 1)] for k, one in enumerate([joint, *scans])]
    return {"kind": list(kind), "seed": seed, "states": states, "joint": loads[0], "scans": loads[1:]}


def kept(file: Path, joints: int, kinds: Sequence[Kind], *, closings: bool) -> list[dict[str, Any]]:
    """Return solved joints, those of a file first; a joint that is solved is added to the file."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    found = [json.loads(line) for line in lines]
    for seed in range(len(found), joints):
        found.append(solved(kinds[seed % len(kinds)], seed, closings=closings))
        with file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(found[-1]) + "\n")
    return found[:joints]


class Trial(NamedTuple):
    """A seal with known number: kind, load, true number, estimate, and whether its scans have a roll-off."""

    kind: Kind
    load: int
    truth: float
    estimate: Estimate
    representative: bool

    @property
    def inside(self) -> bool:
        """Whether the truth lies in the interval."""
        return self.estimate.low <= self.truth <= self.estimate.high


def trials(row: dict[str, Any]) -> Iterator[tuple[str, Trial]]:
    """Yield the trials of a solved joint along x and y: leaks of three scans, of the first scan, and closing loads."""
    kind = Kind(*row["kind"])
    scans = [replace(scan, heights=kind.observed(scan.heights)) for scan in joint_of(kind, row["seed"])[1]]
    known, known_alone = not seal.doubt_of(scans), not seal.doubt_of(scans[:1])
    of_scans = np.array([state["scans"] for state in row["states"]])
    isotropic = seal.is_isotropic(list(of_scans.swapaxes(0, 1)))
    for load, state in enumerate(row["states"]):
        for axis, turn in ((0, 1), (1, -1)):
            patches = (4, 4 * kind.strips)[::turn]
            values, quarters = np.array(state["scans"])[:, ::turn], np.array(state["quadrants"])[0, :, ::turn]
            truth = state["joint"][axis]
            found = seal.conductance_of(values[:, np.newaxis], patches, isotropic=isotropic)
            yield "three scans", Trial(kind, load, truth, found, known)
            alike = seal.is_isotropic(list(quarters[:, np.newaxis]))
            alone = seal.of_one_map(values[0], quarters, patches, isotropic=alike)
            yield "one scan", Trial(kind, load, truth, alone, known_alone)
            if whole := state.get("whole"):
                found = seal.conductance_of(np.array(whole)[:, np.newaxis, ::turn], (4, 4), isotropic=isotropic)
                yield "three scans, observed whole", Trial(kind, load, truth, found, known)
    for axis, turn in ((0, 1), (1, -1)) if row["joint"] else ():
        loads = np.array(row["scans"])[:, np.newaxis, ::turn]
        found = seal.closing_of(loads, (4, 4 * kind.strips)[::turn], isotropic=isotropic)
        yield "closing load", Trial(kind, 0, row["joint"][axis], found, known)


def line(name: str, some: Sequence[Trial]) -> str:
    """Return numbers of trials: those with an interval, truths inside, ratio to the truth, factor of the interval."""
    sure = [one for one in some if one.representative]
    logs = [math.log(one.estimate.value / one.truth) for one in sure if min(one.truth, one.estimate.value) > 0.0]
    if not logs:
        return f"| {name} | {len(some)} | 0 | | | | |"
    closed = sum(one.estimate.value == 0.0 or one.truth == 0.0 for one in sure)
    factors = [one.estimate.high / one.estimate.value for one in sure if one.estimate.low > 0.0] or [math.nan]
    error = np.std(logs, ddof=1) / math.sqrt(len(logs)) if len(logs) > 1 else math.nan
    ratios = f"{np.exp(np.mean(logs)):.2f} ×÷ {np.exp(error):.2f} | {np.exp(np.median(logs)):.2f}"
    inside = f"{sum(one.inside for one in sure)}"
    return f"| {name} | {len(some)} | {len(sure)} | {inside} | {ratios} | {np.median(factors):.2g} | {closed} |"


def report(joints: list[dict[str, Any]]) -> None:
    """Print a table of each sort of trials."""
    every = [pair for row in joints for pair in trials(row)]
    for sort in dict.fromkeys(name for name, _ in every):
        print(f"\n{sort}: trials, with an interval, truth inside, ratio (mean of logarithms, median), factor, closed")
        some = [trial for name, trial in every if name == sort]
        for load in sorted({one.load for one in some}):
            print(line(f"load {load + 1}", [one for one in some if one.load == load]))
        for kind in dict.fromkeys(one.kind for one in some):
            name = ", ".join(f"{value:g}" for value in kind if value is not None)
            print(line(name, [one for one in some if one.kind == kind]))
        print(line("all", some))


def windows(rows: list[dict[str, Any]]) -> None:
    """Print the leaks of the nine windows of isotropic joints over those of the joints.

    Windows are patches of their own, at the nominal pressure of the joint, or parts of the gap of the pressed joint.
    """
    found: dict[tuple[str, int], list[np.ndarray]] = {}
    spaces = HalfSpace((NODES, NODES), sides="periodic"), HalfSpace((WINDOW, WINDOW), sides="mirrored")
    for row in rows:
        kind = Kind(*row["kind"])
        if kind.hardness is not None or kind.anisotropy != 1.0 or kind.rolloff < 16:
            continue
        joint, _ = joint_of(kind, row["seed"])
        for load, (area, state) in enumerate(zip(LOADS, row["states"], strict=True)):
            there = indentation_for(joint, spaces[0], "contact_area", area, rtol=RTOL)
            whole = solve(joint, spaces[0], there, rtol=RTOL).gap()
            for place in range(9):
                leaks = {"part of the joint": flows(cut_of(whole, place), joint.Sq)}
                for levelling in ("tilt", "mean"):
                    scan = scan_of(cut_of(joint.heights, place), joint.spacing, levelling)
                    gap = pressed(scan, spaces[1], state["pressure"], None).gap()
                    for rim in (0, 8, 24) if levelling == "tilt" else (0,):
                        inner = np.ascontiguousarray(gap[rim : WINDOW - rim, rim : WINDOW - rim])
                        leaks[f"patch, levelled by {levelling}, without {rim} outer elements"] = flows(inner, scan.Sq)
                for name, leak in leaks.items():
                    found.setdefault((name, load), []).append(np.array(leak) / state["joint"])
    for (name, load), ratios in found.items():
        each = np.concatenate(ratios)
        logs = np.log(each[each > 0.0])
        words = (
            f"median {np.median(each):.2f}, geometric mean {np.exp(logs.mean()):.2f}, scatter {np.exp(logs.std()):.1f}"
        )
        print(f"{name}, load {load + 1}: {words}, {np.count_nonzero(each == 0.0)} of {each.size} closed")


def roll_offs(triples: int = 40) -> None:
    """Print how often three maps of 129² have a roll-off, and their numbers of waves along y over those along x."""
    for D in (2.1, 2.3, 2.5, 2.7, 2.9):
        maps = [random_midpoint_displacement(D, 7, seed=seed) for seed in range(3 * triples)]
        print(f"midpoint D = {D}: {_share(maps)}")
    for anisotropy, number in ((1.0, 2.0), (1.0, 4.0), (1.0, 8.0), (3.0, 4.0), (3.0, 8.0), (3.0, 16.0)):
        spectrum = Spectrum(rolloff=2.0 * number, cut=64.0, anisotropy=anisotropy)
        maps = []
        for seed in range(3 * triples):
            z = power_law_surface(spectrum, 0.8, 256, seed=seed).heights[:WINDOW, :WINDOW]
            maps.append(Surface(level(z, "tilt"), 1.0))
        print(f"H = 0.8, {anisotropy:g} : 1, L/λ_r = {number:g} along y: {_share(maps)}")


def _share(maps: list[Surface]) -> str:
    words = []
    for size in (3, 1):
        groups = [maps[k : k + size] for k in range(0, len(maps), size)]
        along = [np.mean([waves(one) for one in group], axis=0) for group in groups]
        ratios = sorted(y / x for x, y in along)
        rolled = sum(map(seal.has_roll_off, groups))
        words.append(f"{rolled} of {len(groups)} groups of {size}, waves {ratios[0]:.2f} to {ratios[-1]:.2f}")
    return "; ".join(words)


def known(seals: int = 20) -> None:
    """Print the flow through the sheet of 16 known patches over that through their gap as a whole."""
    from tests.analysis.test_seal import assembled

    for height in (1.0, 0.4):
        pairs = [assembled(height, seed) for seed in range(seals)]
        logs = np.sort([math.log(network / whole) for whole, network in pairs])
        ends = np.exp(np.quantile(logs, [0.0, 0.16, 0.5, 0.84, 1.0]))
        print(f"height {height}: least, 16 %, median, 84 %, largest: {', '.join(f'{one:.2f}' for one in ends)}")


def long(draws: int = 200) -> None:
    """Print the conductance of cut pieces and of rings over that of whole sheets of 8 times as many columns."""
    rng = np.random.default_rng(0)
    for scatter in (0.5, 1.5):
        for n in (2, 4, 8, 16):

            def mean(m: int, count: int, *, ring: bool, n: int = n, scatter: float = scatter) -> tuple[float, float]:
                found = [
                    sheet.conductance(
                        rng.lognormal(0.0, scatter, (n, m)), rng.lognormal(0.0, scatter, (n - 1, m)), ring=ring
                    )
                    for _ in range(count)
                ]
                return float(np.mean(found)), float(np.std(found) / math.sqrt(count))

            whole = mean(512, draws // 8, ring=False)
            words = [
                f"{name} {m}: {value / whole[0]:.3f} ± {math.hypot(error, whole[1]) / whole[0]:.3f}"
                for name, m, ring in (("cut", 64, False), ("ring", 64, True), ("cut", n, False))
                for value, error in [mean(m, draws * 64 // max(m, 16), ring=ring)]
            ]
            print(f"scatter {scatter} of logarithms, {n} in a row: {'; '.join(words)}")


def grooves() -> None:
    """Print the conductance of blocks over that of whole rings: square blocks, and those as wide as patches conduct."""
    rng, widest = np.random.default_rng(5), seal.WIDEST
    for pools in GROOVES:
        along, across = np.array(pools)
        rings = [(rng.choice(along, (32, 64)), rng.choice(across, (31, 64))) for _ in range(100)]
        whole = np.median([sheet.conductance(*joints, ring=True) for joints in rings])
        ratios = []
        for seal.WIDEST in (1.0, widest):
            ratios.append(np.median(seal.drawn(along, across, (32, 1920), sheet.conductance)) / whole)
        print(f"{pools[0]} along, {pools[1]} across: square {ratios[0]:.2f}, as patches conduct {ratios[1]:.2f}")


def main() -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--joints", type=int, default=0)
    parser.add_argument("--kept", type=Path, default=Path("runs/seals.jsonl"))
    parser.add_argument("--closings", action="store_true")
    for name in ("oblong", "roll-off", "known", "long", "grooves", "windows"):
        parser.add_argument(f"--{name}", action="store_true")
    args = parser.parse_args()
    if args.joints:
        args.kept.parent.mkdir(parents=True, exist_ok=True)
        rows = kept(args.kept, args.joints, OBLONG if args.oblong else KINDS, closings=args.closings)
        (windows if args.windows else report)(rows)
    for wanted, function in (
        (args.roll_off, roll_offs),
        (args.known, known),
        (args.long, long),
        (args.grooves, grooves),
    ):
        if wanted:
            function()


if __name__ == "__main__":
    main()
