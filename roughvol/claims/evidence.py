"""What a claim is answered from: the runs given, chosen by what they hold and never by their names.

A claim asks for variables, for a comparison (of D or of m), for a midpoint law and for the plane the sweep ends on; of
the runs that have these, the one with the most values compared is taken, then the one of the finest lattice, then the
one of the most surfaces. So a report of two small runs follows the same rules as that of the whole paper.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from roughvol.claims.model import Check, Claim, Number
from roughvol.errors import RoughvolError, StudyError
from roughvol.physics.surface import Surface, random_midpoint_displacement
from roughvol.study import GeneratedSurface, Study, loads

if TYPE_CHECKING:
    from xarray import Dataset

Array = NDArray[np.float64]

A, P, V, D_SIGMA = "contact_area_fraction", "mean_pressure", "free_volume", "separation"
PAPER_D, PAPER_M = 2.3, 7  # the paper's single surface, Figs. 4b and 7 to 12b
GRID = 20  # points of a common axis on which curves are compared


class Lacking(RoughvolError):
    """What a claim needs and no run has."""


@dataclass(frozen=True, eq=False)
class Run:
    """A stored study: its name, its dataset, and the study itself where its text can be read again."""

    name: str
    dataset: Dataset
    study: Study | None = field(default=None)

    @classmethod
    def of(cls, name: str, dataset: Dataset) -> Run:
        """Return the run of a dataset as `dataset.read` gives it."""
        try:
            return cls(name, dataset, loads(dataset.attrs.get("study", ""), file=name, stored=True))
        except StudyError:  # of a version that wrote other studies: the numbers still are
            return cls(name, dataset)

    @property
    def generated(self) -> GeneratedSurface | None:
        """How the surfaces were made, None if they were read from a file."""
        surface = self.study.surface if self.study else None
        return surface if isinstance(surface, GeneratedSurface) else None

    @property
    def law(self) -> str:
        """Midpoint law, empty for surfaces from files."""
        return self.generated.midpoint_law if self.generated else ""

    @property
    def end(self) -> str:
        """Where the sweep ends, empty where nothing was pressed."""
        return self.study.sweep.target.label if self.study and self.study.sweep.steps else ""

    @property
    def L(self) -> float:
        """Length of the first axis [length]."""
        return float(self.dataset["L"])

    @property
    def D(self) -> list[float]:
        """Fractal dimensions, increasing."""
        return [float(D) for D in self.dataset["D"].values]

    @property
    def m(self) -> list[int]:
        """Refinements, increasing."""
        return [int(m) for m in self.dataset["m"].values]

    @property
    def seeds(self) -> int:
        """Number of surfaces of each D and m."""
        return int(self.dataset.sizes["seed"])

    def values(self, name: str, *, D: float, m: int) -> Array:
        """Return a stored variable of one D and m, the surfaces along the first axis."""
        one = self.dataset[name].sel(D=D, m=m)
        return np.asarray(one.transpose("seed", ...).values, dtype=np.float64)

    def last(self, name: str, *, D: float, m: int) -> Array:
        """Return a variable at the last step, shape (seeds,)."""
        return self.values(name, D=D, m=m)[:, -1]

    def surface(self, D: float, m: int, seed: int) -> Surface:
        """Return the surface of a case, made again from its labels (nothing of it needs to be stored)."""
        made = random_midpoint_displacement(D, m, side=self.L, seed=seed, law=self.law)
        height = self.generated.height if self.generated else None
        return made if height is None else Surface(made.heights * (height / made.Sq), made.spacing)

    def seed_numbers(self) -> list[int]:
        """Return the seeds."""
        return [int(seed) for seed in self.dataset["seed"].values]


@dataclass(frozen=True, eq=False)
class Evidence:
    """All runs of a report."""

    runs: tuple[Run, ...]

    def find(
        self, *needs: str, by: str = "", law: str = "std", end: str | None = "mean-plane", D: float | None = None
    ) -> list[Run]:
        """Return the runs that have what is asked for, the best first (see the module's docstring).

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
        found = []
        for run in self.runs:
            if run.generated is None or run.law != law or (end is not None and run.end != end):
                continue
            if any(name not in run.dataset for name in needs) or (by and run.dataset.sizes[by] < 2):
                continue
            if D is None or any(abs(D - each) < 1e-9 for each in run.D):
                found.append(run)
        compared: Callable[[Run], int] = lambda run: run.dataset.sizes[by] if by else 0  # noqa: E731
        return sorted(found, key=lambda run: (compared(run), max(run.m), run.seeds), reverse=True)

    def pick(
        self, *needs: str, by: str = "", law: str = "std", end: str | None = "mean-plane", D: float | None = None
    ) -> Run:
        """Return the best of `find`.

        Raises
        ------
        Lacking
            If there is none.
        """
        found = self.find(*needs, by=by, law=law, end=end, D=D)
        if found:
            return found[0]
        wants = [f"{', '.join(needs)}" if needs else "surfaces", f"midpoint law {law}"]
        wants += [f"several {by}"] * bool(by) + [f"a sweep to {end}"] * bool(end)
        wants += [] if D is None else [f"D = {D:g}"]
        message = f"no run with {', '.join(wants)}"
        raise Lacking(message)


@dataclass(frozen=True)
class Outcome:
    """What a claim's function found: its checks, further numbers, the sentence for the verdict, and the runs used."""

    checks: Sequence[Check]
    why: str
    source: Sequence[Run]
    numbers: Sequence[Number] = ()


Answer = Callable[[Evidence], Outcome]
CLAIMS: dict[int, Callable[[Evidence], Claim]] = {}


def claim(
    id: int, title: str, place: str, sentence: str, *, figures: tuple[str, ...] = ()
) -> Callable[[Answer], Answer]:
    """Register the function that answers a claim; its docstring is the method shown beside the verdict."""

    def register(answer: Answer) -> Answer:
        @functools.wraps(answer)
        def claimed(evidence: Evidence) -> Claim:
            claimed = Claim(id, title, place, sentence, method=inspect.getdoc(answer) or "", figures=figures)
            fixed = {name: getattr(claimed, name) for name in ("id", "title", "place", "sentence", "method", "figures")}
            try:
                found = answer(evidence)
            except Lacking as lacking:
                return Claim(**fixed, lacking=str(lacking), why=f"Not computed: {lacking}.")
            source = tuple(dict.fromkeys(run.name for run in found.source))
            return Claim(
                **fixed, checks=tuple(found.checks), numbers=tuple(found.numbers), why=found.why, source=source
            )

        CLAIMS[id] = claimed
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
