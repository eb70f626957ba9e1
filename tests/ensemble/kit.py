"""Ensembles without a solver or files, and the oracle of their estimator."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from roughvol.campaign import rounds
from roughvol.ensemble.design import Design
from roughvol.ensemble.step_error import StepErrors
from roughvol.ensemble.targets import Arrays
from roughvol.study import Case, Study, loads
from roughvol.typing import Array

Compute = Callable[[Sequence[Case]], Mapping[str, Arrays]]


def driven(
    study: Study,
    compute: Compute = rounds.in_memory,
    steps: StepErrors | None = None,
    seconds: Callable[[], float] = lambda: 0.0,
    alone: Callable[[Sequence[Case]], Sequence[tuple[float, ...]]] = rounds.surfaces_alone,
) -> Design:
    """Return a design after its last round."""
    design = Design(study, rounds.step_errors(study) if steps is None else steps)
    while request := design.next(seconds()):
        design.add(request, compute(request.cases), alone(request.surfaces))
    return design


def drawn(cases: Sequence[Case]) -> list[tuple[float, ...]]:
    """Numbers of surfaces alone that explain nothing."""
    return [tuple(np.random.default_rng([case.seed or 0, 77]).standard_normal(2)) for case in cases]


def made(values: Mapping[int, float], spread: float = 0.1) -> Compute:
    """Samples without a solver: V* of level m has a mean, a scatter that all levels share, and a little of its own."""

    def of(cases: Sequence[Case]) -> dict[str, Arrays]:
        found: dict[str, Arrays] = {}
        for case in cases:
            shared = np.random.default_rng(case.seed).standard_normal()
            own = np.random.default_rng([case.seed, case.m]).standard_normal() * 2.0**-case.m
            v = values[case.m] * (1.0 + spread * (shared + own))
            steps = np.linspace(0.0, 1.0, 9)[1:]
            numbers = {
                "indentation": steps,
                "separation": 3.0 - steps,
                "contact_area_fraction": 0.1 * steps,
                "mean_pressure": steps,
                "free_volume": 3.0 + steps * (v - 3.0),
                "convolutions": np.full(8, 2.0),
                "convolutions_fp32": np.zeros(8),
                "residual": np.full(8, 1e-5),
            }
            found[case.id] = {name: (("step",), row) for name, row in numbers.items()}
        return found

    return of


def asked(m: object, accuracy: str, more: str = "") -> Study:
    """Return a study of the mean V* at the last step."""
    return loads(
        f"surface: {{D: 2.3, m: {m}}}\nsweep: {{steps: 8}}\nensemble: {{accuracy: {{free_volume: {accuracy}}}{more}}}"
    )


def best_linear(groups: Sequence[tuple[Sequence[int], Array]], covariance: Array) -> tuple[Array, Array]:
    """Return the best linear unbiased estimate of the means of all levels, and its covariance.

    The weights of all samples minimise the variance (Schaden & Ullmann 2020, eq. 2.10). A group is samples with common
    seeds: indices of their levels, and values of shape (n, len(levels)). Groups are independent, each level has one.
    """
    size = len(covariance)
    information, right = np.zeros((size, size)), np.zeros(size)
    for levels, values in groups:
        rows = np.asarray(levels)
        inverse = np.linalg.inv(covariance[np.ix_(rows, rows)])
        information[np.ix_(rows, rows)] += len(values) * inverse
        right[rows] += inverse @ values.sum(axis=0)
    spread = np.linalg.inv(information)
    return spread @ right, spread
