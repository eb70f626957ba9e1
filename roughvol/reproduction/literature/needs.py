"""Configurations that rows of the literature need: periodic surfaces with a spectrum, and given height files."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable
from dataclasses import dataclass

from roughvol.analysis.stored_run import Run
from roughvol.reproduction.claims.evidence import Question, claim
from roughvol.reproduction.claims.needs import SAME, Needs, listed, symbol

LITERATURE: dict[int, Question] = {}
cited = functools.partial(claim, among=LITERATURE)
AREA = "contact_area_fraction"
ROUND = 0.02  # relative difference between the A* of a step and that asked for


@dataclass(frozen=True)
class Rolled(Needs):
    """Configuration of a run of periodic surfaces with a roll-off and Gaussian heights.

    Attributes
    ----------
    rolloff : float
        Smallest L/λ_r.
    ratios : tuple of float
        λ_s/δ that must be among those of the run.
    resolved : float
        Smallest λ_s/δ of the finest grid.
    area : tuple of float
        Least and largest A* between which the steps of every surface must reach.
    """

    law: str = ""
    kernel: str = ""
    rolloff: float = 1.0
    ratios: tuple[float, ...] = ()
    resolved: float = 0.0
    area: tuple[float, float] = (1.0, 0.0)

    def unfit(self, run: Run) -> tuple[str, ...]:
        """Return every reason for which a run is refused, in words; none if it fits."""
        surface = run.spectral
        if surface is None:
            return ("no surfaces with a spectrum",)
        if not surface.periodic:
            return ("free patches, needs periodic surfaces",)
        if absent := [name for name in self.holds if name not in run.dataset]:
            return (f"no {', '.join(symbol(name) for name in absent)} recorded",)
        return tuple(self._reasons(run))

    def _reasons(self, run: Run) -> Iterable[str]:
        surface = run.spectral
        assert surface is not None
        if surface.Ssk is not None or surface.anisotropy != 1.0:
            yield "skewed or anisotropic surfaces, needs Gaussian isotropic ones"
        if "plastic_volume" in run.dataset or "leg" in run.dataset:
            yield "yield or a path of legs, needs one sweep in elastic contact"
        if surface.rolloff < self.rolloff * (1.0 - SAME):
            yield f"L/λ_r = {surface.rolloff:g}, needs {self.rolloff:g}"
        ratios = ratios_of(run)
        if any(min(abs(ratio - wanted) for ratio in ratios.values()) > SAME for wanted in self.ratios):
            yield f"λ_s/δ = {listed(ratios.values())}, needs {listed(self.ratios)}"
        elif max(ratios.values()) < self.resolved * (1.0 - SAME):
            yield f"λ_s/δ = {max(ratios.values()):g}, needs {self.resolved:g}"
        if run.rtol > self.rtol * (1.0 + SAME):
            yield f"residual up to {run.rtol:g}, needs {self.rtol:g}"
        count = min(run.computed(D=D, m=m) for D in run.D for m in run.m)
        if count < self.seeds:
            yield f"{count} surfaces of each kind, needs {self.seeds}"
        elif self.area[0] <= self.area[1] and not self._reaches(run):
            yield f"needs steps from A* = {self.area[0]:g} to {self.area[1]:g}"

    def _reaches(self, run: Run) -> bool:
        """Return whether the steps of every surface reach from the least A* to the largest."""
        area = run.dataset[AREA]
        least, largest = float(area.min("step").max()), float(area.max("step").min())
        return least <= self.area[0] * (1.0 + ROUND) and largest >= self.area[1] * (1.0 - ROUND)

    def relaxed(self) -> Rolled:
        """Return the configuration without its size."""
        return dataclasses.replace(self, seeds=1, rolloff=1.0, ratios=(), resolved=0.0, area=(1.0, 0.0))

    def rank(self, run: Run) -> tuple[int, ...]:
        """Return the order of runs that fit: grids, finest grid, surfaces."""
        return len(run.m), max(run.m), run.seeds, 0, 0, run.steps

    def __str__(self) -> str:
        """Return the configuration in words."""
        words = ["periodic surfaces with a spectrum", *([", ".join(map(symbol, self.holds))] if self.holds else [])]
        words += [f"L/λ_r >= {self.rolloff:g}"] if self.rolloff > 1.0 else []
        words += [f"λ_s/δ = {listed(self.ratios)}"] if self.ratios else []
        words += [f"λ_s/δ >= {self.resolved:g}"] if self.resolved else []
        words += [f"{self.seeds} surfaces of each kind"] if self.seeds > 1 else []
        words += [f"A* from {self.area[0]:g} to {self.area[1]:g}"] if self.area[0] <= self.area[1] else []
        return "; ".join(words)


@dataclass(frozen=True)
class Light(Needs):
    """Configuration of a run of free midpoint surfaces at given light loads; its end counts in trials as well."""

    def relaxed(self) -> Light:
        """Return the configuration without its size: variables, comparison and end."""
        return Light(self.holds, self.by, ends=self.ends)


@dataclass(frozen=True)
class Files(Needs):
    """Configuration of a run of given height files.

    Attributes
    ----------
    names : tuple of str
        Names of files that must be among the cases of the run.
    periodic : bool
        Whether each file is one period.
    origin : str
        Where to find the files, in words.
    """

    law: str = ""
    names: tuple[str, ...] = ()
    periodic: bool = True
    origin: str = ""

    def unfit(self, run: Run) -> tuple[str, ...]:
        """Return every reason for which a run is refused, in words; none if it fits."""
        if "case" not in run.dataset.dims or run.study is None:
            return ("no heights from a file",)
        stored = set(map(str, run.dataset["case"].values))
        if absent := [name for name in self.names if name not in stored]:
            return (f"no file {', '.join(absent)}",)
        return tuple(self._reasons(run))

    def _reasons(self, run: Run) -> Iterable[str]:
        assert run.study is not None
        if absent := [name for name in self.holds if name not in run.dataset]:
            yield f"no {', '.join(symbol(name) for name in absent)} recorded"
        if getattr(run.study.surface, "periodic", False) != self.periodic:
            yield "a free patch, needs a period" if self.periodic else "a period, needs a free patch"
        if run.study.solver.kernel != self.kernel:
            yield f"kernel {run.study.solver.kernel}, needs {self.kernel}"
        if run.rtol > self.rtol * (1.0 + SAME):
            yield f"residual up to {run.rtol:g}, needs {self.rtol:g}"

    def relaxed(self) -> Files:
        """Return the configuration itself: a file has no size to relax."""
        return self

    def rank(self, run: Run) -> tuple[int, ...]:
        """Return the order of runs that fit: files, steps."""
        return (run.dataset.sizes["case"], run.steps)

    def __str__(self) -> str:
        """Return the configuration in words."""
        where = f" ({self.origin})" if self.origin else ""
        return f"{', '.join(self.names)}{where}, kernel {self.kernel}"


def ratios_of(run: Run) -> dict[int, float]:
    """Return λ_s/δ of each m of a run of surfaces with a spectrum."""
    assert run.spectral is not None
    return {m: 2.0**m / run.spectral.shortest_ratio for m in run.m}
