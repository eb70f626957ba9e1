"""What a claim is answered from: the runs given, chosen by what they are and never by their names.

A claim declares the configuration it needs (`needs`). Of the runs that have it, the one with the most values compared
is taken, then the one of the finest lattice, then the one of the most surfaces; all others are refused with a reason.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from roughvol.errors import RoughvolError
from roughvol.report.claims.needs import PAPER_D as PAPER_D
from roughvol.report.claims.needs import PAPER_M as PAPER_M
from roughvol.report.claims.needs import Needs, fit, refusals
from roughvol.report.claims.stored_run import Run
from roughvol.report.claims.verdict import Check, Claim, Number
from roughvol.typing import Array

if TYPE_CHECKING:
    pass


A, P, V, D_SIGMA = "contact_area_fraction", "mean_pressure", "free_volume", "separation"
GRID = 20  # points of a common axis on which curves are compared


class Lacking(RoughvolError):
    """What a claim needs and no run has."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """All runs of a report; with ``any_size`` small ones count as well, for trials and not for verdicts."""

    runs: tuple[Run, ...]
    any_size: bool = False

    def fit(self, needs: Needs) -> list[Run]:
        """Return the runs that are what is needed, the best first (see the module's docstring)."""
        return fit(self._asked(needs), self.runs)

    def refusals(self, *needs: Needs) -> dict[str, str]:
        """Return why each run that fits none of several needs is refused, by its name."""
        return refusals([self._asked(each) for each in needs], self.runs)

    def _asked(self, needs: Needs) -> Needs:
        return needs.relaxed() if self.any_size else needs

    def best(self, needs: Needs) -> Run:
        """Return the best of `fit`.

        Raises
        ------
        Lacking
            If there is none.
        """
        found = self.fit(needs)
        if found:
            return found[0]
        message = f"no run with {needs}"
        raise Lacking(message)

    def find(
        self, *needs: str, by: str = "", law: str = "std", end: str | None = "mean-plane", D: float | None = None
    ) -> list[Run]:
        """Return the runs of any size that hold what is asked for, the best first.

        Parameters
        ----------
        needs : str
            Variables the run must hold.
        by : {"", "D", "m"}
            What must have two values at least.
        law, end : str
            Midpoint law, and the label of the state the sweep ends at; None for any.
        D : float, optional
            A dimension that must be among those of the run.
        """
        return self.fit(_any_size(needs, by, law, end, D))

    def pick(
        self, *needs: str, by: str = "", law: str = "std", end: str | None = "mean-plane", D: float | None = None
    ) -> Run:
        """Return the best of `find`.

        Raises
        ------
        Lacking
            If there is none.
        """
        return self.best(_any_size(needs, by, law, end, D))


def _any_size(holds: tuple[str, ...], by: str, law: str, end: str | None, D: float | None) -> Needs:
    return Needs(holds, by=by, law=law, ends=() if end is None else (end,), D=() if D is None else (D,))


@dataclass(frozen=True, eq=False)
class Given:
    """The runs that fit a claim, by what they serve for, the best of each first."""

    needs: Mapping[str, Needs]
    fit: Mapping[str, Sequence[Run]]

    def run(self, use: str = "") -> Run:
        """Return the best run for a use.

        Raises
        ------
        Lacking
            If there is none.
        """
        if self.fit[use]:
            return self.fit[use][0]
        message = f"no run with {self.needs[use]}"
        raise Lacking(message)

    def runs(self, use: str = "") -> list[Run]:
        """Return all runs for a use, the best first."""
        return list(self.fit[use])


@dataclass(frozen=True)
class Outcome:
    """What a claim's function found: its checks, further numbers, the sentence for the verdict, and the runs used."""

    checks: Sequence[Check]
    why: str
    source: Sequence[Run]
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

    def given(self, evidence: Evidence) -> Given:
        """Return the runs that fit."""
        return Given(self.needs, {use: evidence.fit(needs) for use, needs in self.needs.items()})

    def __call__(self, evidence: Evidence) -> Claim:
        """Return the claim with what was found, or with what no run has; every run refused is named."""
        refused = tuple(evidence.refusals(*self.needs.values()).items())
        names = ("id", "title", "place", "sentence", "method", "figures")
        claim = Claim(**{name: getattr(self, name) for name in names}, refused=refused)
        try:
            found = self.answer(self.given(evidence))
        except Lacking as lacking:
            return replace(claim, lacking=str(lacking), why=f"Not computed: {lacking}.")
        checks = tuple(check.tested() for check in found.checks)
        source = tuple(dict.fromkeys(run.name for run in found.source))
        claim = replace(claim, checks=checks, numbers=tuple(found.numbers), source=source, why=found.why)
        if lacking_ := claim.untested:
            return replace(claim, lacking=lacking_, why=f"Not computed: {lacking_}.")
        return claim


CLAIMS: dict[int, Question] = {}


def claim(
    id: int,
    title: str,
    place: str,
    sentence: str,
    *,
    needs: Needs | Mapping[str, Needs],
    figures: tuple[str, ...] = (),
) -> Callable[[Answer], Answer]:
    """Register the function that answers a claim, with the configuration it needs."""

    def register(answer: Answer) -> Answer:
        uses = {"": needs} if isinstance(needs, Needs) else dict(needs)
        CLAIMS[id] = Question(id, title, place, sentence, uses, answer, figures)
        return answer

    return register


def nearest(values: Sequence[float], wish: float) -> float:
    """Return the value nearest to a wish, the larger of two."""
    return min(values, key=lambda value: (abs(value - wish), -value))


def at(x: Array, y: Array, points: Array) -> Array:
    """Return y of each surface at points of x, linear between steps, NaN beyond the steps of that surface.

    ``x``, ``y`` : (surfaces, steps), x rising or falling along a row; the result is (surfaces, points).
    """
    rows = []
    for abscissa, ordinate in zip(x, y, strict=True):
        known = np.isfinite(abscissa) & np.isfinite(ordinate)
        order = np.argsort(abscissa[known], kind="stable")
        rows.append(np.interp(points, abscissa[known][order], ordinate[known][order], left=np.nan, right=np.nan))
    return np.array(rows)


def common(curves: Sequence[Array]) -> Array:
    """Return `GRID` even points over the range that every surface of every curve reaches.

    Raises
    ------
    Lacking
        If there is no such range.
    """
    low = max(float(np.nanmax(np.nanmin(x, axis=1))) for x in curves)
    high = min(float(np.nanmin(np.nanmax(x, axis=1))) for x in curves)
    if not low < high:
        message = "a range of the axis that all surfaces reach"
        raise Lacking(message)
    return np.linspace(low, high, GRID)


def area_slopes(run: Run, D: Sequence[float], m: Sequence[int]) -> tuple[dict[tuple[float, int], Array], float]:
    """Return A*/p* of every surface by (D, m), and the pressure up to which: the rule of Fig. 4b.

    Slope of the least-squares line through the origin over 0 < p* ≤ the largest pressure that all surfaces reach (or,
    if some begin later, the largest of the first pressures, so that each has a step there).
    """
    pressures = {(d, k): run.values(P, D=d, m=k) for d in D for k in m}
    limit = min(float(p[:, -1].min()) for p in pressures.values())
    limit = max(limit, *(float(p[:, 0].max()) for p in pressures.values()))
    slopes = {}
    for (d, k), p in pressures.items():
        weight = np.where(p <= limit, p, 0.0)
        slopes[d, k] = (weight * run.values(A, D=d, m=k)).sum(axis=1) / (weight * p).sum(axis=1)
    return slopes, limit
