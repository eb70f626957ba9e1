"""How often the intervals of an ensemble contain the mean: many small studies with seeds of their own.

    python -m tests.bench.coverage --m 5 --studies 200 --accuracy "4 %"
    python -m tests.bench.coverage --m 5 --studies 200 --accuracy "4 %" --few

The mean is that of a run of 5000 other seeds. With `--few` the finest level begins with 4 samples, as an expensive one
does. Sweeps are kept in memory: no file is written.
"""

import argparse
import functools
import json
from collections.abc import Mapping, Sequence
from unittest import mock

import numpy as np
from threadpoolctl import threadpool_limits

from roughvol.campaign.case_surface import surface_of
from roughvol.campaign.path import last_indentation
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import sweep
from roughvol.ensemble import design
from roughvol.ensemble.step_error import StepErrors
from roughvol.ensemble.targets import series_of, targets_of
from roughvol.study import Case, Study, loads
from tests.ensemble.kit import driven

SERIES = ("indentation", "separation", "contact_area_fraction", "mean_pressure", "free_volume")
COUNTS = ("convolutions", "convolutions_fp32", "residual")
REFERENCE, REFERENCE_SEED, APART = 5000, 10_000_000, 100_000
STUDY = """
surface: {{D: {D}, m: {m}}}
sweep: {{steps: {steps}}}
ensemble: {{accuracy: {{{quantity}: {accuracy}}}, at: {{pressure: [0.3]}}, first_seed: {seed}}}
"""
_held: dict[int, HalfSpace] = {}


def swept(case: Case) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Return what a campaign reads of a case."""
    assert case.m is not None
    surface, half_space = surface_of(case), _held.setdefault(case.m, HalfSpace((2**case.m + 1, 2**case.m + 1)))
    last, steps = last_indentation(case, surface, half_space), case.sweep.steps
    touch = (surface.z_max - surface.mean_height) / surface.Sq
    rows = [
        [contact.indentation, touch - contact.indentation, *(getattr(contact, name) for name in SERIES[2:] + COUNTS)]
        for contact in sweep(surface, half_space, last * np.arange(1, steps + 1) / steps, rtol=case.solver.tolerance)
    ]
    return {name: (("step",), column) for name, column in zip(SERIES + COUNTS, np.array(rows).T, strict=True)}


def compute(cases: Sequence[Case]) -> Mapping[str, dict[str, tuple[tuple[str, ...], np.ndarray]]]:
    """Return all cases, in this process."""
    with threadpool_limits(1):
        return {case.id: swept(case) for case in cases}


def study(m: int, D: float, accuracy: str, *, quantity: str = "free_volume", seed: int = 0, steps: int = 15) -> Study:
    """Return a small study of one mean, with a first seed of its own."""
    return loads(STUDY.format(m=m, D=D, accuracy=accuracy, quantity=quantity, seed=seed, steps=steps))


@functools.cache
def reference(m: int, D: float, *, quantity: str, seeds: int = REFERENCE, steps: int = 15) -> float:
    """Return the plain mean of many seeds."""
    one = study(m, D, "1 %", quantity=quantity, steps=steps)
    (target,) = targets_of(one.ensemble)
    cases = (one.sample(D, m, REFERENCE_SEED + seed) for seed in range(seeds))
    return float(np.mean([target.value(series_of(swept(case)), case) for case in cases]))


def measure(m: int, D: float, accuracy: str, studies: int, *, quantity: str, few: bool, seeds: int) -> dict[str, float]:
    """Return the share of intervals that contain the mean, and more of these studies."""
    mean = reference(m, D, quantity=quantity, seeds=seeds)
    inside, finest, errors, held = 0, [], [], 0
    with mock.patch.object(design, "COSTLY", {m: 4, m - 1: 10} if few else design.COSTLY):
        for number in range(studies):
            one = study(m, D, accuracy, quantity=quantity, seed=number * APART)
            found = driven(one, compute, StepErrors((0.0,), 0))
            estimate = found.estimates[D][0]
            inside += abs(estimate.mean.value - mean) <= estimate.mean.half_width
            held += estimate.reached
            finest.append(found.table.counts(D)[-1])
            errors.append(estimate.mean.value / mean - 1.0)
    return {
        "m": m,
        "D": D,
        "studies": studies,
        "coverage": inside / studies,
        "holds": held / studies,
        "mean of the reference": mean,
        "mean error in %": 100.0 * float(np.mean(errors)),
        "spread of the error in %": 100.0 * float(np.std(errors)),
        "finest samples, median": float(np.median(finest)),
    }


def main() -> None:
    """Print the coverage."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--m", type=int, default=5)
    parser.add_argument("--D", type=float, default=2.3)
    parser.add_argument("--accuracy", default="4 %")
    parser.add_argument("--quantity", default="free_volume")
    parser.add_argument("--studies", type=int, default=200)
    parser.add_argument("--seeds", type=int, default=REFERENCE)
    parser.add_argument("--few", action="store_true", help="begin with 4 samples on the finest level")
    given = parser.parse_args()
    print(
        json.dumps(
            measure(
                given.m,
                given.D,
                given.accuracy,
                given.studies,
                quantity=given.quantity,
                few=given.few,
                seeds=given.seeds,
            )
        )
    )


if __name__ == "__main__":
    main()
