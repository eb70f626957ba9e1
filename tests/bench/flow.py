"""Time and memory of flows, one thread, by processor time.

python -m tests.bench.flow states 9        16 states of D = 2.2 to A* = 0.15: contact against flows, x and y
python -m tests.bench.flow direct 9        one flow in light and heavy contact: by gradients against factorised
python -m tests.bench.flow levels 6        16 states by the size up to which grids and levels are factorised
python -m tests.bench.flow gas 9           16 states: flows of a gas over those of a liquid, three laws
python -m tests.bench.flow lifted 9        a contact under fluid pressure: flows by gradients against factorised
python -m tests.bench.flow coupled 5       states under fluid pressure, far from closing and near it: seconds, rounds
python -m tests.bench.flow peer 512        one flow against reynoldsflow, errors against the flow to 1e-11
python -m tests.bench.flow large 12 0.1    memory and time of one flow through the gap over a cut surface
python -m tests.bench.flow card 10         the leak card of a mirrored map of D = 2.2, and its run on the finest grid
python -m tests.bench.flow errors 500      true errors over stated ones, random gaps
python -m tests.bench.flow fewer 7         leaks read between fewer of 60 states of a sweep, D = 2.2, 2.5, 2.8
"""

import functools
import itertools
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from threadpoolctl import threadpool_limits

import roughvol
from roughvol.campaign.workers import in_this_process
from roughvol.contact import HalfSpace, sweep
from roughvol.contact.loading import Trials
from roughvol.contact.search import state_under
from roughvol.contact.state import Contact
from roughvol.errors import ConvergenceError
from roughvol.gap import multigrid
from roughvol.gap.constriction import constriction
from roughvol.gap.gas import LAWS, conduction_of_gas
from roughvol.gap.transport import Conduction, conduction
from roughvol.observables.coupling import Coupling, Lifted
from roughvol.surfaces import random_midpoint_displacement
from tests.gap.kit import any_gap

STATES, DEEPEST, ACCURACIES = 16, 1.9, (1e-2, 1e-3, 1e-4, 1e-6)
TOLERANCES = (1e-10, 1e-8, 1e-6, 1e-4)  # of reynoldsflow


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a function returns, and the seconds of the processor."""
    started = time.process_time()
    result = function()
    return result, time.process_time() - started


def gaps(m: int) -> list[np.ndarray]:
    """Return the gaps of the states, from first touch to 1.9 times the depth of the mean plane."""
    surface = random_midpoint_displacement(2.2, m, side=100.0, seed=0)
    end = DEEPEST * (surface.z_max - surface.mean_height) / surface.Sq
    steps = np.linspace(0.0, end, STATES + 1)[1:]
    half_space = HalfSpace(surface.shape)
    return [np.array(state.gap()) for state in sweep(surface, half_space, steps)]


def states(m: int) -> None:
    """Print the seconds of a sweep, and of its flows at several accuracies with their errors."""
    found, contact = timed(lambda: gaps(m))
    print(f"{found[0].shape[0]}^2, {STATES} states to A* = {np.mean(found[-1] == 0.0):.3f}: contact {contact:.2f} s")
    followed(found[:1], 1e-3)  # loads compiled code
    for accuracy in (1e-3, 1e-4):
        _, seconds = timed(lambda at=accuracy: followed(found, at))
        print(f"flows to {accuracy:.0e}: {seconds:.2f} s, {seconds / contact:.2f} of the contact")


def followed(found: list[np.ndarray], accuracy: float) -> None:
    """Solve the flows of successive states along both axes, each from the pressures of the last."""
    for axis in (0, 1):
        start = None
        for gap in found:
            start = conduction(gap, axis, accuracy=accuracy, start=start).pressure


def factorised(gap: np.ndarray) -> Conduction:
    """Return the flow by one factorisation."""
    kept, multigrid.DIRECT = multigrid.DIRECT, gap.size
    try:
        return conduction(gap, 0)
    finally:
        multigrid.DIRECT = kept


def direct(m: int) -> None:
    """Print seconds and errors of flows at several accuracies, against the factorisation."""
    for gap in gaps(m)[3::4]:
        exact, seconds = timed(lambda gap=gap: factorised(gap))
        print(f"A* = {np.mean(gap == 0.0):.3f}: factorised {seconds:.2f} s")
        for accuracy in ACCURACIES:
            flow, taken = timed(lambda gap=gap, at=accuracy: conduction(gap, 0, accuracy=at))
            error = flow.coefficient / exact.coefficient - 1.0
            print(
                f"  {accuracy:.0e}: {taken:.3f} s, 1/{seconds / taken:.0f}, error {error:.1e}, stated {flow.error:.1e}"
            )


def levels(m: int) -> None:
    """Print seconds of flows to 1e-4 by `multigrid.DIRECT`: medians of 5 rounds, in which the sizes take turns."""
    found, sizes, kept = gaps(m), (5000, 2500, 1000), multigrid.DIRECT
    followed(found[:1], 1e-4)  # loads compiled code
    taken: dict[int, list[float]] = {size: [] for size in sizes}
    for _ in range(5):
        for size in sizes:
            multigrid.DIRECT = size
            taken[size].append(timed(lambda: followed(found, 1e-4))[1])
    multigrid.DIRECT = kept
    print(", ".join(f"{size}: {np.median(seconds):.3f} s" for size, seconds in taken.items()))


def gas(m: int) -> None:
    """Print seconds of flows of a gas to 1e-4, from 1 bar to vacuum, over those of a liquid, along x."""
    found = gaps(m)
    conduction(found[0], 0)  # loads compiled code, as the first flow of each law does

    def liquids() -> None:
        start = None
        for gap in found:
            start = conduction(gap, 0, start=start).pressure

    _, liquid = timed(liquids)
    print(f"{STATES} states, liquid: {liquid:.2f} s")
    for law, path in itertools.product(LAWS, (0.1, 10.0)):

        def flows(law: str = law, path: float = path) -> list[int]:
            start, turns = None, []
            for gap in found:
                flow = conduction_of_gas(gap, 0, law, path * constriction(found[-1], 0).gap, 0.0, start=start)
                start, turns = flow.pressure, [*turns, flow.turns]
            return turns

        conduction_of_gas(found[0], 0, law, path, 0.0)
        turns, seconds = timed(flows)
        print(
            f"{law}, mean free path {path:g} of the last constriction: {seconds:.2f} s, {seconds / liquid:.1f} times, "
            f"{min(turns)} to {max(turns)} turns"
        )


def lifted(m: int) -> None:
    """Print seconds of a mirrored contact under 0.3 of its load as fluid pressure, coupled in full."""
    surface = replace(random_midpoint_displacement(2.2, m, seed=1), sides="mirrored")
    half_space = HalfSpace(surface.shape, sides="mirrored")
    *_, state = sweep(surface, half_space, np.linspace(0.0, 1.6, 9)[1:])
    coupling, kept = Coupling(surface, half_space, 0, 0.3 * state.mean_pressure), multigrid.DIRECT
    coupling.one_way(state.mean_pressure, state)  # loads compiled code
    for words, direct in (("gradients", kept), ("factorised", surface.heights.size)):
        multigrid.DIRECT = direct
        found, seconds = timed(lambda: coupling.solve(state.mean_pressure, state))
        print(f"{words}: {seconds:.1f} s, {found.rounds} rounds, V* = {found.gap.mean():.10f}")
    multigrid.DIRECT = kept


def coupled(m: int) -> None:
    """Print seconds and rounds of states coupled in full: six surfaces, both axes, inlets 0.4 and 0.8 of the load."""
    for load in (1.5, 4.0):
        means, seconds, rounds = [], 0.0, 0
        for seed, sides, axis, share in itertools.product((1, 2, 3), ("periodic", "mirrored"), (0, 1), (0.4, 0.8)):
            made = random_midpoint_displacement(2.2, m, seed=seed, periodic=sides == "periodic")
            surface = replace(made, sides=sides)
            half_space = HalfSpace(surface.shape, sides=sides)
            dry = state_under(Trials(surface, half_space, rtol=1e-9), load, 1.0)
            joint = Coupling(surface, half_space, axis, share * load)
            found, taken = timed(functools.partial(_found, joint, load, dry))
            seconds += taken
            if found is not None:
                means, rounds = [*means, found.gap.mean()], rounds + found.rounds
        print(f"p* = {load:g}: {len(means)} states, {seconds:.1f} s, {rounds} rounds, mean V* = {np.mean(means):.8f}")


def _found(joint: Coupling, load: float, dry: Contact) -> Lifted | None:
    """Return the coupled state, None where none is found."""
    try:
        return joint.solve(load, dry)
    except ConvergenceError:
        return None


def peer(n: int) -> None:
    """Print seconds and errors of reynoldsflow at several tolerances, and of the flow at several accuracies.

    A flow (median of five) is compared with reynoldsflow at its own tolerance, and with its fastest flow that has no
    larger error.
    """
    from reynoldsflow import transport as other

    z = random_midpoint_displacement(2.2, int(np.log2(n)), seed=0).heights[:n, :n]
    gap = np.maximum(np.quantile(z, 0.9) - z, 0.0)
    gap[:, 0] = 0.0  # a wall: periodic sideways is then closed sideways
    exact = conduction(gap, 0, accuracy=1e-11)  # and loads compiled code
    plates = gap.mean() ** 3 * gap.shape[1] / len(gap)

    def theirs(tolerance: float | None) -> float:
        filtered, _, flux = other.solve_fluid_problem(gap, rtol=tolerance)
        return float(abs(np.atleast_1d(other.compute_total_flux(filtered, flux, len(gap)))[0]))

    found = []
    for tolerance in (None, *TOLERANCES):
        total, seconds = timed(lambda tolerance=tolerance: theirs(tolerance))
        found.append((abs(total / (exact.coefficient * plates) - 1.0), seconds))
        print(f"{n}^2: reynoldsflow, rtol {tolerance or 'its own'}: {seconds:.2f} s, error {found[-1][0]:.1e}")
    for accuracy in (*ACCURACIES, 3e-7, 1e-9):
        solved = [timed(lambda at=accuracy: conduction(gap, 0, accuracy=at)) for _ in range(5)]
        flow, taken = solved[0][0], float(np.median([seconds for _, seconds in solved]))
        error = flow.coefficient / exact.coefficient - 1.0
        alike = min((seconds for off, seconds in found if off <= error), default=np.nan)
        print(
            f"  {accuracy:.0e}: {taken:.3f} s, error {error:.1e}: {found[0][1] / taken:.0f} times faster,"
            f" {alike / taken:.0f} times at no larger error"
        )


def large(m: int, closed: float) -> None:
    """Print the coefficient, its error, the growth of the resident set, and the seconds."""
    heights = random_midpoint_displacement(2.3, m, seed=0).heights
    gap = np.maximum(np.quantile(heights, 1.0 - closed) - heights, 0.0)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    flow, seconds = timed(lambda: conduction(gap, 0))
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    print(
        f"{gap.shape[0]}^2 elements, {closed:.0%} closed: T* = {flow.coefficient!r}, error {flow.error:.1e}, "
        f"{grown / 2**20:.2f} GiB more ({grown * 1024 / gap.size:.0f} bytes an element), {seconds:.0f} s"
    )


def card(m: int) -> None:
    """Print the seconds of the leak card of a mirrored map, and those of its run on the finest grid."""
    z = random_midpoint_displacement(2.2, m, seed=0).heights
    study = {
        "name": "map",
        "surface": {"file": "map.npy", "L": "500 um", "unit": "um", "level": "tilt", "sides": "mirrored"},
        "material": {"E": "10 MPa", "nu": 0.5},
        "sweep": {"steps": 12, "to": "percolation"},
        "record": {
            "transport": {"percolation": "every-step", "transmissivity": "every-step"},
            "dimensional": {"pressure": "MPa", "leak_rate": {"pressure_drop": "1 mbar", "viscosity": "1 mPa*s"}},
        },
    }
    with tempfile.TemporaryDirectory() as folder, in_this_process():
        np.save(Path(folder, "map.npy"), z / z.std())
        changes = [f"surface.file={folder}/map.npy"]
        found, seconds = timed(lambda: roughvol.card(study, out=folder, jobs=1, changes=changes))
        (runs,) = found.runs["last", ""].values()
    finest = float(runs.fine.dataset["wall_time"].sum())
    print(f"{z.shape[0]}^2: card {seconds:.0f} s, its run on the finest grid {finest:.0f} s by the clock")


def fewer(m: int) -> None:
    """Print by what factor leaks differ that are read on the logarithm between every second, fourth, eighth state.

    They are read on the cubic over the logarithm of the load, and on the straight line over the load. The median, 95 %
    and the largest are of 6 surfaces of each D, both axes, from the first to the last state with an open way.
    """
    for D in (2.2, 2.5, 2.8):
        found: dict[tuple[int, str], list[np.ndarray]] = {
            (n, way): [] for n in (2, 4, 8) for way in ("cubic", "straight")
        }
        for seed in range(6):
            surface = random_midpoint_displacement(D, m, seed=seed)
            end = (surface.z_max - surface.mean_height) / surface.Sq
            states = list(sweep(surface, HalfSpace(surface.shape), np.linspace(0.0, end, 61)[1:]))
            loads = np.log([state.mean_pressure for state in states])
            for axis in (0, 1):
                flows = [conduction(state.gap(), axis).coefficient * state.free_volume**3 for state in states]
                still = np.flatnonzero(np.array(flows) > 0.0)
                for (every, way), factors in found.items():
                    kept = still[::every]
                    between = np.setdiff1d(np.arange(kept[-1]), kept)
                    logs = np.log(np.array(flows)[kept])
                    cubic = PchipInterpolator(loads[kept], logs)(loads[between])
                    straight = np.interp(np.exp(loads[between]), np.exp(loads[kept]), logs)
                    read = cubic if way == "cubic" else straight
                    factors.append(np.exp(np.abs(read - np.log(np.array(flows)[between]))))
        for (every, way), factors in found.items():
            all_of = np.concatenate(factors)
            print(
                f"D = {D}, every {every}, {way}: median {np.median(all_of):.4f}, 95 % {np.quantile(all_of, 0.95):.3f}, "
                f"largest {all_of.max():.3f}"
            )


def errors(number: int) -> None:
    """Print true errors of flows over the stated ones; the gaps are those of tests/gap/test_network.py."""
    kept, ratios, cycles, cycle = multigrid.DIRECT, list[float](), 0, multigrid.Multigrid.__call__

    def counted(self: multigrid.Multigrid, inflow: np.ndarray) -> np.ndarray:
        nonlocal cycles
        cycles += 1
        return cycle(self, inflow)

    multigrid.Multigrid.__call__ = counted
    for seed, (most, direct) in itertools.product(range(number), ((200, 200), (70, kept))):
        gap, axis, periodic = any_gap(seed)
        gap = np.ascontiguousarray(gap[:most, :most])
        multigrid.DIRECT = gap.size
        exact = conduction(gap, axis, periodic=periodic).coefficient
        multigrid.DIRECT = direct
        for accuracy in ACCURACIES:
            flow = conduction(gap, axis, periodic=periodic, accuracy=accuracy)
            if flow.error > 0.0:
                ratios.append((flow.coefficient / exact - 1.0 - 1e-9) / flow.error)
    multigrid.DIRECT = kept
    print(f"{len(ratios)} flows, {cycles} cycles: largest {max(ratios):.2f}, median {np.median(ratios):.3f}")


if __name__ == "__main__":
    what, *numbers = sys.argv[1:]
    with threadpool_limits(1):
        if what == "large":
            large(int(numbers[0]), float(numbers[1]))
        else:
            of = {
                "states": states,
                "direct": direct,
                "levels": levels,
                "gas": gas,
                "lifted": lifted,
                "coupled": coupled,
                "peer": peer,
                "card": card,
                "errors": errors,
                "fewer": fewer,
            }
            of[what](int(numbers[0]))
