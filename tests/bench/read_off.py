"""How often the interval of a read-off contains the truth: random sweeps, and the same with a quarter of the steps.

    python -m tests.bench.read_off --surfaces 90

Each surface is pressed in 24 to 96 steps. Every fourth step is kept, and the others are read off: the leak at their
load (as `roughvol creep` and `roughvol show` do), and the load at their leak (as `roughvol ask` does). The other steps
are solved, so the truth is known. Surfaces, grids, steps, and ends are random; every third surface has a gas as well.
Sweeps are kept in `--out`, and taken from there again.
"""

import argparse
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from roughvol.analysis import read_off
from roughvol.analysis.leak_curve import Curve, curves
from roughvol.campaign import execution
from roughvol.errors import CampaignError
from roughvol.store.dataset import Dataset
from roughvol.study import loads

FINER = 4
SOLVED = 1e-5  # relative: leaks and loads of steps are solved to this
STUDY = """name: one
surface: {surface}
material: {{E_star: 10 MPa}}
sweep: {{steps: {steps}, to: {end}, equal: {equal}}}
solver: {{rtol: 1.0e-6}}
{fluid}
record:
  transport: {{transmissivity: every-step{flow}}}
  dimensional: {{pressure: MPa, leak_rate: {{pressure_drop: 10 mbar, viscosity: 1 mPa*s, unit: mm^3/s}}{rate}}}
"""
ENDS, SHARES = ("percolation", "{pressure: 0.5}", "{pressure: 1.5}", "mean-plane"), (0.5, 0.2, 0.2, 0.1)


class Point(NamedTuple):
    """One reading: what was read on which way, and true over stated error; the width of the interval as a factor."""

    kind: str  # liquid, gas
    read: str  # leak, load
    way: str
    place: str  # first, inner or last of the steps
    true: float
    stated: float

    @property
    def holds(self) -> bool:
        """Whether the interval contains the truth, to what is solved."""
        return self.true <= self.stated + SOLVED


def study(seed: int) -> str:
    """Return a random study."""
    rng = np.random.default_rng([seed, 19])
    m, steps = int(rng.choice([5, 6])), int(rng.choice([6, 8, 12, 16, 24]))
    common = f"seeds: [{seed}], L: 200 um, Sq: 0.4 um, sides: {'periodic' if rng.random() < 0.5 else 'free'}"
    H = round(float(rng.uniform(0.3, 0.95)), 2)
    midpoint = rng.choice(["midpoint", "spectrum"]) == "midpoint"
    end = rng.choice(ENDS, p=SHARES)
    equal = rng.choice(["indentation", "log pressure"], p=[0.7, 0.3])
    waves = f"H: {H}, n: {2**m}, rolloff: {rng.choice([1, 2, 4])}"
    gas = seed % 3 == 2
    return STUDY.format(
        surface=f"{{{f'D: {3 - H:.2f}, m: {m}' if midpoint else waves}, {common}}}",
        steps=FINER * steps,
        end=end,
        equal=equal,
        fluid="fluid: {gas: helium, inlet: 1 bar, outlet: 0.1 bar}" if gas else "",
        flow=", gas_flow: every-step" if gas else "",
        rate=", gas_leak_rate: sccm" if gas else "",
    )


def points(run: Dataset, name: str) -> Iterator[Point]:
    """Yield the readings of the omitted steps of a run."""
    fluids = {"liquid": run} | ({"gas": read_off.of_gas(run, "pressure")[0]} if "gas_leak_rate" in run else {})
    for fluid, leaks in fluids.items():
        coarse = leaks.isel(step=slice(FINER - 1, None, FINER))
        for axis in "xy":
            kept = {one.surface: one for one in curves(coarse)[axis]}
            for truth in curves(leaks)[axis]:
                if truth.surface in kept:
                    yield from _of_way(kept[truth.surface], truth, fluid, f"{name} {axis}")


def _of_way(curve: Curve, truth: Curve, fluid: str, way: str) -> Iterator[Point]:
    steps = curve.pressure[curve.leak > 0.0]
    for load, leak in zip(truth.pressure, truth.leak, strict=True):
        if steps.size < 2 or not steps[0] < load < steps[-1] or load in steps or leak <= 0.0:
            continue
        k = int(np.searchsorted(steps, load))
        place = "first" if k == 1 else "last" if k == steps.size - 1 else "inner"
        reading, log = curve.at(np.array([load])), np.log(leak)
        answer = curve.load_where(lambda at, log=log: np.full(np.shape(at), log))
        ends = (reading.value[0], reading.low[0], reading.high[0]), (answer.value, answer.low, answer.high)
        for read, true, (value, low, high) in zip(("leak", "load"), (leak, load), ends, strict=True):
            stated = high / value if true > value else value / low
            yield Point(fluid, read, way, place, abs(float(np.log(true / value))), float(np.log(stated)))


def table(found: Iterable[Point]) -> str:
    """Return how many of the intervals hold, of all readings and of parts of them."""
    found = list(found)
    rows = [
        "| readings | number | ways | hold | true over stated, 95 % | largest | median half width |",
        "|---" * 7 + "|",
    ]
    parts = {
        "leak of a liquid at a load (creep)": [p for p in found if (p.kind, p.read) == ("liquid", "leak")],
        "load of a leak of a liquid (ask)": [p for p in found if (p.kind, p.read) == ("liquid", "load")],
        "leak of a gas at a load": [p for p in found if (p.kind, p.read) == ("gas", "leak")],
        "load of a leak of a gas (ask)": [p for p in found if (p.kind, p.read) == ("gas", "load")],
        "between the first two steps": [p for p in found if p.place == "first"],
        "between the last two open steps": [p for p in found if p.place == "last"],
        "all": found,
    }
    for name, some in parts.items():
        if some:
            ratio = np.array([p.true / (p.stated + SOLVED) for p in some])
            held = 100 * np.mean([p.holds for p in some])
            half = 100 * np.expm1(np.median([p.stated for p in some]))
            ways = len({(p.kind, p.way) for p in some})
            cells = f"{held:.1f} % | {np.quantile(ratio, 0.95):.2f} | {ratio.max():.1f} | {half:.1f} %"
            rows.append(f"| {name} | {len(some)} | {ways} | {cells} |")
    return "\n".join(rows)


def measured(seeds: Iterable[int], out: Path) -> Iterator[Point]:
    """Yield the readings of random studies; a study whose flow is not solved is named and left out."""
    for seed in seeds:
        try:
            run = execution.run(loads(study(seed)), jobs=1, out=out / str(seed))
        except CampaignError as error:
            print(f"{seed}: left out, {error}")
            continue
        yield from points(run, str(seed))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--surfaces", type=int, default=90)
    parser.add_argument("--out", type=Path, default=Path("runs/bench/read_off"))
    options = parser.parse_args()
    print(table(measured(range(options.surfaces), options.out)))


if __name__ == "__main__":
    main()
