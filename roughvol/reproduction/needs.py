"""The configuration that a claim or a row of the literature needs of a run, as data, and why a run does not have it.

A claim of the paper is about surfaces of certain D and m, so many of them, pressed so far in so many steps. A run that
is smaller, coarser or ends elsewhere answers another question; it is refused, by name and with the reason.

A field of a configuration has words, in which `str` shows it, and may be of size, which trials with small runs leave
out. The default of a field asks for nothing.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from roughvol.observables.variables import VARIABLES
from roughvol.report.figures import cases
from roughvol.report.figures.origin import numbers_text
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.typing import Sides

SAME = 1e-9  # largest difference of two equal D, L or tolerances
ROUND = 0.02  # relative difference between the A* of a step and that asked for


def _of_kind(default: Any, words: str = "") -> Any:
    return field(default=default, metadata={"words": words})


def _of_size(default: Any, words: str = "") -> Any:
    return field(default=default, metadata={"words": words, "is_size": True})


@dataclass(frozen=True)
class Needs:
    """Configuration of a run of free midpoint surfaces."""

    holds: tuple[str, ...] = ()  # stored variables
    D: tuple[float, ...] = _of_size((), "D = {}")  # among those of the run
    m: tuple[int, ...] = _of_size((), "m = {}")  # among those of the run
    by: str = ""  # "D" or "m", at least two values of it are compared; the run with the most values is the best
    finest: int = _of_size(0, "m >= {}")  # smallest refinement that the finest surfaces may have
    seeds: int = _of_size(1, "{} surfaces of each kind")  # of each D and m named
    steps: int = _of_size(0, "{} steps")
    end: str = _of_kind("", "a sweep to {}")  # label of the last state, contact_area=0.1, or its kind, indentation
    separation: float = _of_kind(math.inf, "d/σ down to {}")  # that the last state of every surface may have
    law: str = _of_kind("std", "midpoint law {}")  # "std" or "variance", "" for any
    rtol: float = _of_size(math.inf, "residual up to {}")  # largest η/σ that the solver may leave
    kernel: str = _of_size("", "kernel {}")  # influence of an element
    L: float = _of_size(0.0, "L = {}")  # first side [length], of heights as midpoint displacement makes them
    bins: int = _of_size(0, "{} bins")  # of the density of the volumes
    states: tuple[tuple[str, str], ...] = _of_size(())  # dimension and label, as ("box_at", "pressure=2.4")
    optional: bool = False  # the claim can do without

    def unfit(self, run: ClaimRun) -> tuple[str, ...]:
        """Return every reason for which a run is refused, in words; none if it fits."""
        for reasons in (self._of_others, self._unrecorded, self._unlike, self._incomplete):
            if found := tuple(reasons(run)):
                return found
        return ()

    def _of_others(self, run: ClaimRun) -> Iterable[str]:
        """Yield why the surfaces of a run are of another kind."""
        if run.origin:
            yield run.origin

    def _unrecorded(self, run: ClaimRun) -> Iterable[str]:
        if absent := [name for name in self.holds if name not in run.dataset]:
            yield f"no {', '.join(map(symbol, absent))} recorded"

    def _unlike(self, run: ClaimRun) -> Iterable[str]:
        """Yield reasons of size, of the law, of the sweep and of records."""
        D, m = run.D, run.m
        if any(min(abs(wanted - value) for value in D) > SAME for wanted in self.D):
            yield f"D = {numbers_text(D)}, needs {numbers_text(self.D)}"
        if not {*self.m} <= {*m}:
            yield f"m = {numbers_text(m)}, needs {numbers_text(self.m)}"
        elif max(m) < self.finest:
            yield f"m = {numbers_text(m)}, needs m >= {self.finest}"
        if self._compares_any() and {"D": len(D), "m": len(m)}[self.by] < 2:
            yield f"one {self.by}, needs several"
        if run.seeds < self.seeds:
            yield f"{_count(run.seeds, 'surface')} of each kind, needs {self.seeds}"
        if run.steps < self.steps:
            yield f"{_count(run.steps, 'step')}, needs {self.steps}"
        if "bin" in run.dataset.sizes and run.dataset.sizes["bin"] < self.bins:
            yield f"density in {_count(run.dataset.sizes['bin'], 'bin')}, needs {self.bins}"
        yield from self._of_path(run)
        if self.law and run.law != self.law:
            yield f"midpoint law {run.law}, needs {self.law}"
        if self.end and self.end not in (run.end, run.end.split("=")[0]):
            end = f"sweep to {run.end}" if run.end else "no sweep"
            yield f"{end}, needs one to {self.end}"
        yield from self._of_solver(run)
        if self.steps:
            yield from self._of_model(run)
        if self.L and abs(run.L - self.L) > SAME * self.L:
            yield f"L = {run.L:g}, needs L = {self.L:g}"
        if self.L and run.scaled:
            yield "heights scaled to an Sq, needs them as midpoint displacement makes them"
        for dim, label in self.states:
            stored = run.dataset.coords[dim].values if dim in run.dataset.coords else ()
            if label not in map(str, stored):
                yield f"nothing recorded at {label}"

    def _of_path(self, run: ClaimRun) -> Iterable[str]:
        if "plastic_volume" in run.dataset:
            yield "pressures end at a hardness, needs elastic contact"
        if "leg" in run.dataset:
            yield "a path of legs, needs one sweep"

    def _of_model(self, run: ClaimRun) -> Iterable[str]:
        if run.study is None:
            return
        if (part := run.study.record.part) is not None:
            yield f"observes {part.label}, needs the whole surface"
        if run.study.kernel(run.study.surface.length_unit).lengths:
            yield "presses a layer, needs a half space"

    def _of_solver(self, run: ClaimRun) -> Iterable[str]:
        if run.steps and run.rtol > self.rtol * (1.0 + SAME):
            yield f"residual up to {run.rtol:g}, needs {self.rtol:g}"
        if self.kernel and run.study is not None and run.study.kernel().name != self.kernel:
            yield f"kernel {run.study.kernel().name}, needs {self.kernel}"

    def _compares_any(self) -> bool:
        """Return whether values of ``by`` are compared without being named."""
        return bool(self.by) and not {"D": self.D, "m": self.m}[self.by]

    def _incomplete(self, run: ClaimRun) -> Iterable[str]:
        """Yield reasons of missing cases, where only some of a study were computed."""
        D_asked = [cases.nearest(run.D, D) for D in self.D] or run.D
        m_asked = [*self.m, max(run.m)] if self.finest else list(self.m)
        pairs = itertools.product(D_asked, m_asked or run.m)
        count, D, m = min((run.computed(D=D, m=m), D, m) for D, m in pairs)
        if count < self.seeds:
            yield f"{_count(count, 'surface')} of D = {D:g}, m = {m} computed, needs {self.seeds}"
        elif run.shallowest > self.separation:
            yield f"d/σ down to {run.shallowest:g}, needs {self.separation:g}"

    def of(self, *holds: str, **changes: Any) -> Needs:
        """Return the same configuration for other stored variables, or otherwise changed."""
        return replace(self, holds=holds, **changes)

    def relaxed(self) -> Needs:
        """Return the configuration without its size: variables, comparison, law, and the plane or kind of the end."""
        sizes: dict[str, Any] = {field.name: field.default for field in fields(self) if "is_size" in field.metadata}
        sizes["D"] = self.D if len(self.D) == 1 else ()
        return replace(self, **sizes, end="" if "=" in self.end else self.end)

    def rank(self, run: ClaimRun) -> tuple[int, ...]:
        """Return the order of runs that fit: values compared, finest m, surfaces, D and m in all, steps."""
        compared = {"": 0, "D": len(run.D), "m": len(run.m)}[self.by]
        return compared, max(run.m), run.seeds, len(run.D), len(run.m), run.steps

    def __str__(self) -> str:
        """Return the configuration in words."""
        words = [", ".join(map(symbol, self.holds))] if self.holds else []
        words += [f"several {self.by}"] if self._compares_any() else []
        for row in fields(self):
            value = getattr(self, row.name)
            if row.metadata.get("words") and value and (value != row.default or row.name == "law"):
                words.append(row.metadata["words"].format(_text(value)))
        return "; ".join(words + [f"records at {label}" for _, label in self.states])


@dataclass(frozen=True)
class Rolled(Needs):
    """Configuration of a run of periodic surfaces with a roll-off and Gaussian heights."""

    law: str = ""
    rolloff: float = _of_size(1.0, "L/λ_r >= {}")
    ratios: tuple[float, ...] = _of_size((), "λ_s/δ = {}")  # among those of the run
    resolved: float = _of_size(0.0, "λ_s/δ >= {}")  # of the finest grid
    area: tuple[float, ...] = _of_size((), "steps between A* = {}")  # that the steps must reach

    def _of_others(self, run: ClaimRun) -> Iterable[str]:
        if run.spectral is None:
            yield "no surfaces with a spectrum"
        elif not run.spectral.periodic:
            yield f"{run.spectral.sides} surfaces, needs periodic ones"
        elif run.spectral.Ssk is not None or run.spectral.anisotropy != 1.0:
            yield "skewed or anisotropic surfaces, needs Gaussian isotropic ones"

    def _unlike(self, run: ClaimRun) -> Iterable[str]:
        assert run.spectral is not None
        yield from self._of_path(run)
        if run.spectral.rolloff < self.rolloff * (1.0 - SAME):
            yield f"L/λ_r = {run.spectral.rolloff:g}, needs {self.rolloff:g}"
        ratios = list(ratios_of(run).values())
        if any(min(abs(ratio - wanted) for ratio in ratios) > SAME for wanted in self.ratios):
            yield f"λ_s/δ = {numbers_text(ratios)}, needs {numbers_text(self.ratios)}"
        elif max(ratios) < self.resolved * (1.0 - SAME):
            yield f"λ_s/δ = {max(ratios):g}, needs {self.resolved:g}"
        yield from self._of_solver(run)
        yield from self._of_model(run)

    def _incomplete(self, run: ClaimRun) -> Iterable[str]:
        if reasons := list(super()._incomplete(run)):
            yield from reasons
        elif self.area:
            area = run.dataset["contact_area_fraction"]
            least, largest = float(area.min("step").max()), float(area.max("step").min())
            if least > self.area[0] * (1.0 + ROUND) or largest < self.area[1] * (1.0 - ROUND):
                yield f"needs steps from A* = {self.area[0]:g} to {self.area[1]:g}"

    def rank(self, run: ClaimRun) -> tuple[int, ...]:
        """Return the order of runs that fit: grids, finest grid, surfaces, steps."""
        return len(run.m), max(run.m), run.seeds, run.steps

    def __str__(self) -> str:
        """Return the configuration in words."""
        return f"periodic surfaces with a spectrum; {super().__str__()}"


@dataclass(frozen=True)
class Files(Needs):
    """Configuration of a run of given height files."""

    law: str = ""
    names: tuple[str, ...] = ()  # of files among the cases of the run
    sides: Sides = "periodic"
    origin: str = ""  # where to find the files, in words

    def _of_others(self, run: ClaimRun) -> Iterable[str]:
        stored = set(map(str, run.dataset["case"].values)) if "case" in run.dataset.dims and run.study else set()
        if not stored:
            yield "no heights from a file"
        elif absent := [name for name in self.names if name not in stored]:
            yield f"no file {', '.join(absent)}"

    def _unlike(self, run: ClaimRun) -> Iterable[str]:
        assert run.study is not None
        if run.study.surface.sides != self.sides:
            yield f"sides {run.study.surface.sides}, needs {self.sides}"
        yield from self._of_path(run)
        yield from self._of_solver(run)
        yield from self._of_model(run)

    def _incomplete(self, run: ClaimRun) -> Iterable[str]:
        return ()

    def relaxed(self) -> Files:
        """Return the configuration itself: a file has no size to relax."""
        return self

    def rank(self, run: ClaimRun) -> tuple[int, ...]:
        """Return the order of runs that fit: files, steps."""
        return run.dataset.sizes["case"], run.steps

    def __str__(self) -> str:
        """Return the configuration in words."""
        where = f" ({self.origin})" if self.origin else ""
        return f"{', '.join(self.names)}{where}, kernel {self.kernel}"


def ratios_of(run: ClaimRun) -> dict[int, float]:
    """Return λ_s/δ of each m of a run of surfaces with a spectrum."""
    assert run.spectral is not None
    return {m: 2.0**m / run.spectral.shortest_ratio for m in run.m}


def symbol(name: str) -> str:
    """Return the symbol of a stored variable, as A*."""
    return VARIABLES[name].symbol if name in VARIABLES else name


def _text(value: str | float | Sequence[float]) -> str:
    return value if isinstance(value, str) else numbers_text(np.atleast_1d(value).tolist())


def _count(number: int, noun: str) -> str:
    return f"{number} {noun if number == 1 else noun + 's'}"


# The paper's configurations -----------------------------------------------------------------------------------------

PAPER_D, PAPER_M = cases.SHOWN_D, cases.SHOWN_M  # Figs. 4b and 7 to 12b
PAPER_A = 0.1  # contact area in Figs. 8 to 11

_SWEEP = Needs(seeds=10, steps=60, end="mean-plane", rtol=1e-6, kernel="love")
BY_D = replace(_SWEEP, by="D", D=(2.1, 2.3, 2.5, 2.7, 2.9), finest=8)
"""Ten surfaces of each D at m = 8, pressed to the mean plane: Figs. 4a, 5, 6."""
BY_M = replace(_SWEEP, by="m", D=(PAPER_D,), m=(3, 4, 5, 6, 7, 8))
"""D = 2.3 at six m: Figs. 4b, 7, 12b. The paper has one surface; an interval takes ten."""
ONE_D = replace(_SWEEP, D=(PAPER_D,), finest=8)
"""Ten surfaces of D = 2.3 at m = 8."""
PRESSED = Needs(finest=5, seeds=10, steps=60, rtol=1e-6, kernel="love")
"""Ten surfaces of any D, pressed to any end."""
BOXES = replace(PRESSED, holds=("box_count",), D=(PAPER_D,), m=(PAPER_M,), finest=0)
"""Box counts of ten surfaces of D = 2.3 and m = 7."""
FIELD = replace(BOXES, holds=("gap",), seeds=1, end="contact_area=0.1")
"""The one surface of Figs. 8 to 11, D = 2.3 and m = 7, at A* = 0.1."""
DENSITY = {"L": 100.0, "bins": 50, "states": (("density_at", "last"),)}
"""What f(v) needs beside: volumes have units, so L and the heights count."""
MANY = replace(_SWEEP, D=(2.1, PAPER_D, 2.9), finest=7, seeds=100)
"""A hundred surfaces of three D."""
_STARRED = ("contact_area_fraction", "mean_pressure", "free_volume")
ALONE = (
    Needs(("heights",), D=(2.1, PAPER_D, 2.5, 2.9), m=(PAPER_M,)),
    BY_M.of(*_STARRED, seeds=1),
    FIELD.of(*_STARRED, end="indentation"),
)
"""What the paper shows and no claim needs: its surfaces, one surface by m, the start of contact."""
