"""Registration of a claim, and the runs that answer it: chosen by their configuration, never by their names.

A claim declares the configuration it needs (`needs`). Of the runs that have it, the one with the most values compared
is taken, then the one of the finest lattice, then the one of the most surfaces; all others are refused with a reason.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from xarray import Dataset

from roughvol.errors import RoughvolError
from roughvol.observables.at_state import at_state
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims.verdict import Check, Claim, Number
from roughvol.reproduction.needs import PAPER_A, Needs
from roughvol.store.dataset import recorded_state
from roughvol.tables import table
from roughvol.typing import Array

A, P, V, D_SIGMA = "contact_area_fraction", "mean_pressure", "free_volume", "separation"
GRID = 20  # points of a common axis on which curves are compared
Key = TypeVar("Key")


class Lacking(RoughvolError):
    """A configuration that a claim needs and no run has."""


def require(condition: object, message: str) -> None:
    """Raise `Lacking` with a message unless a condition is true."""
    if not condition:
        raise Lacking(message)


def paper_state(case: Dataset, at: str) -> Dataset:
    """Return the recorded state of a surface (along `at`) whose A* is nearest to that of the paper's state."""
    places = np.flatnonzero(case[f"{at}_step"].values > 0).tolist()  # -1: never reached
    require(places, "no recorded field")
    states = [recorded_state(case, at, place) for place in places]
    return min(states, key=lambda state: abs(float(state[A]) - PAPER_A))


@dataclass(frozen=True, eq=False)
class Evidence:
    """All runs of a report; with ``any_size`` small ones count too, for trials and not for verdicts."""

    runs: tuple[ClaimRun, ...]
    any_size: bool = False

    def fit(self, needs: Needs) -> list[ClaimRun]:
        """Return the runs of a configuration, the best first (see the docstring of the module)."""
        needs = self._asked(needs)
        return sorted((run for run in self.runs if not needs.unfit(run)), key=needs.rank, reverse=True)

    def refusals(self, *needs: Needs) -> dict[str, str]:
        """Return why each run that fits none of several needs is refused, by its name: the need it misses by least."""
        reasons = {run.name: [self._asked(need).unfit(run) for need in needs] for run in self.runs}
        return {name: "; ".join(sorted(unfit, key=len)[0]) for name, unfit in reasons.items() if all(unfit)}

    def _asked(self, needs: Needs) -> Needs:
        return needs.relaxed() if self.any_size else needs

    def best(self, needs: Needs) -> ClaimRun:
        """Return the best of `fit`, or raise `Lacking`."""
        runs = self.fit(needs)
        require(runs, f"no run with {needs}")
        return runs[0]


@dataclass(frozen=True, eq=False)
class Given:
    """The runs that fit a claim, by what they serve for, the best of each first."""

    evidence: Evidence
    needs: Mapping[str, Needs]

    def run(self, use: str = "") -> ClaimRun:
        """Return the best run for a use, or raise `Lacking`."""
        return self.evidence.best(self.needs[use])

    def runs(self, use: str = "") -> list[ClaimRun]:
        """Return all runs for a use, the best first."""
        return self.evidence.fit(self.needs[use])


@dataclass(frozen=True)
class Outcome:
    """Answer to a claim: its checks, further numbers, the sentence for the verdict, and the runs used."""

    checks: Sequence[Check]
    why: str
    source: Sequence[ClaimRun]
    numbers: Sequence[Number] = ()


Answer = Callable[[Given], Outcome]


@dataclass(frozen=True)
class Question:
    """A claim of the paper, what it needs of a run for each use it makes of one, and the function that answers it."""

    id: int
    title: str
    place: str
    sentence: str
    needs: Mapping[str, Needs]
    answer: Answer
    figures: tuple[str, ...] = ()

    @property
    def method(self) -> str:
        """How it is judged: the docstring of the function, shown beside the verdict."""
        return inspect.getdoc(self.answer) or ""

    def __call__(self, evidence: Evidence) -> Claim:
        """Return the claim with what was found, or with what no run has; every run refused is named."""
        refused = tuple(evidence.refusals(*self.needs.values()).items())
        names = ("id", "title", "place", "sentence", "method", "figures")
        claim = Claim(**{name: getattr(self, name) for name in names}, refused=refused)
        try:
            outcome = self.answer(Given(evidence, self.needs))
        except Lacking as lacking:
            return replace(claim, lacking=str(lacking), why=f"Not computed: {lacking}.")
        checks = tuple(check.tested() for check in outcome.checks)
        source = tuple(dict.fromkeys(run.name for run in outcome.source))
        claim = replace(claim, checks=checks, numbers=tuple(outcome.numbers), source=source, why=outcome.why)
        if lacking_ := claim.untested:
            return replace(claim, lacking=lacking_, why=f"Not computed: {lacking_}.")
        return claim


CLAIMS: dict[int, Question] = {}
TEXTS: dict[str, Any] = table(__file__, "paper")


def claim(
    id: int,
    *,
    needs: Needs | Mapping[str, Needs],
    among: dict[int, Question] = CLAIMS,
    texts: Mapping[str, Any] = TEXTS["claim"],
) -> Callable[[Answer], Answer]:
    """Register the function that answers a claim, with the configuration it needs; its texts are a table of TOML."""

    def register(answer: Answer) -> Answer:
        uses = {"": needs} if isinstance(needs, Needs) else dict(needs)
        text = texts[str(id)]
        figures = tuple(text.get("figures", ()))
        among[id] = Question(id, text["title"], text["place"], text["sentence"], uses, answer, figures)
        return answer

    return register


def at(x: Array, y: Array, points: Array) -> Array:
    """Return y of each surface at points of x, by straight lines between steps, NaN beyond them.

    ``x`` rises or falls along (surfaces, steps); the result is (surfaces, points).
    """
    return np.array(
        [at_state(abscissa, ordinate, points, straight=True) for abscissa, ordinate in zip(x, y, strict=True)]
    )


def common(curves: Sequence[Array], points: int = GRID) -> Array:
    """Return even points over the range that every surface of every curve reaches, or raise `Lacking`."""
    low = max(float(np.nanmax(np.nanmin(x, axis=1))) for x in curves)
    high = min(float(np.nanmin(np.nanmax(x, axis=1))) for x in curves)
    require(low < high, "a range of the axis that all surfaces reach")
    return np.linspace(low, high, points)


def volumes(run: ClaimRun, x: str, kinds: Sequence[tuple[float, int]]) -> tuple[Array, Array]:
    """Return V* of surfaces by (D, m) on a common axis x, shape (kinds, seeds, points), and that axis."""
    axes = [run.values(x, D=D, m=m) for D, m in kinds]
    grid = common(axes)
    curves = [at(axis, run.values(V, D=D, m=m), grid) for axis, (D, m) in zip(axes, kinds, strict=True)]
    return np.array(curves), grid


def area_slopes(run: ClaimRun, D: Sequence[float], m: Sequence[int]) -> tuple[dict[tuple[float, int], Array], float]:
    """Return A*/p* of every surface by (D, m), and the pressure up to which it is taken, as `slopes_of_area`."""
    return slopes_of_area({(d, k): (run.values(P, D=d, m=k), run.values(A, D=d, m=k)) for d in D for k in m})


def slopes_of_area(curves: Mapping[Key, tuple[Array, Array]]) -> tuple[dict[Key, Array], float]:
    """Return A*/p* of every surface by key, and the pressure up to which it is taken: the rule of Fig. 4b.

    Slope of the least-squares line through the origin over 0 < p* ≤ limit. The limit is the largest pressure that all
    surfaces reach, or the largest of their first pressures above 0. ``curves`` are (p*, A*), (surfaces, steps), NaN if
    missing.
    """
    limit = min(float(np.nanmax(p, axis=1).min()) for p, _ in curves.values())
    first = np.concatenate([np.where(p > 0.0, p, np.inf).min(axis=1) for p, _ in curves.values()])
    limit = max(limit, float(first[np.isfinite(first)].max(initial=0.0)))
    slopes = {}
    for key, (p, area) in curves.items():
        used = np.where(p <= limit, p, 0.0)
        with np.errstate(invalid="ignore"):  # of a surface without pressure, as in a region without contact: NaN
            slopes[key] = np.nansum(used * area, axis=1) / np.nansum(used * p, axis=1)
    return slopes, limit
