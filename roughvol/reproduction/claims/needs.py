"""The configuration that a claim needs of a run, as data, and why a run does not have it.

A claim of the paper is about surfaces of certain D and m, so many of them, pressed so far in so many steps. A run that
is smaller, coarser or ends elsewhere answers another question; it is refused, by name and with the reason.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from roughvol.observables.variables import VARIABLES
from roughvol.report.figures.cases import nearest
from roughvol.reproduction.paper_rules import PAPER_D, PAPER_M

if TYPE_CHECKING:
    from roughvol.analysis.stored_run import Run

SAME = 1e-9  # largest difference of two equal D, L or tolerances


@dataclass(frozen=True)
class Needs:
    """Configuration that a run must have; a default asks for nothing.

    Attributes
    ----------
    holds : tuple of str
        Stored variables.
    by : {"", "D", "m"}
        What is compared: at least two values, and the run with the most of them is taken first.
    D : tuple of float
        Fractal dimensions that must be among those of the run.
    m : tuple of int
        Refinements that must be among those of the run.
    finest : int
        Smallest refinement that the finest surfaces of the run may have.
    seeds : int
        Surfaces of each D and m named.
    steps : int
        Steps of the sweep.
    ends : tuple of str
        Labels of the states at which the sweep may end (``mean-plane``, ``contact_area=0.1``), or their kinds
        (``indentation`` for any ``indentation=…``); empty for any.
    separation : float
        Largest d/σ that the last state of every surface may have.
    law : {"std", "variance", ""}
        Midpoint law, "" for any.
    rtol : float
        Largest residual η/σ that the solver may leave.
    kernel : {"love", "punch"}
        Influence of an element, where there is a sweep.
    L : float
        Length of the first axis [length], with heights as midpoint displacement makes them; 0 for any.
    bins : int
        Bins of the density of the volumes.
    states : tuple of (str, str)
        Dimension and label of the states that must be recorded, as ``("box_at", "pressure=2.4")``.
    optional : bool
        The claim can do without.
    """

    holds: tuple[str, ...] = ()
    by: str = ""
    D: tuple[float, ...] = ()
    m: tuple[int, ...] = ()
    finest: int = 0
    seeds: int = 1
    steps: int = 0
    ends: tuple[str, ...] = ()
    separation: float = math.inf
    law: str = "std"
    rtol: float = math.inf
    kernel: str = "love"
    L: float = 0.0
    bins: int = 0
    states: tuple[tuple[str, str], ...] = ()
    optional: bool = False

    def unfit(self, run: Run) -> tuple[str, ...]:
        """Return every reason for which a run is refused, in words; none if it fits."""
        if run.origin:
            return (run.origin,)
        absent = [name for name in self.holds if name not in run.dataset]
        if absent:
            return (f"no {', '.join(symbol(name) for name in absent)} recorded",)
        return (*self._small(run), *self._unlike(run)) or tuple(self._incomplete(run))

    def _small(self, run: Run) -> Iterable[str]:
        """Yield reasons of size: too few values, surfaces, steps or bins."""
        D, m = run.D, run.m
        if any(min(abs(wanted - value) for value in D) > SAME for wanted in self.D):
            yield f"D = {listed(D)}, needs {listed(self.D)}"
        if not {*self.m} <= {*m}:
            yield f"m = {listed(m)}, needs {listed(self.m)}"
        elif max(m) < self.finest:
            yield f"m = {listed(m)}, needs m >= {self.finest}"
        if self._asks_for_several() and {"D": len(D), "m": len(m)}[self.by] < 2:
            yield f"one {self.by}, needs several"
        if run.seeds < self.seeds:
            yield f"{_count(run.seeds, 'surface')} of each kind, needs {self.seeds}"
        if run.steps < self.steps:
            yield f"{_count(run.steps, 'step')}, needs {self.steps}"
        if "bin" in run.dataset.sizes and run.dataset.sizes["bin"] < self.bins:
            yield f"density in {_count(run.dataset.sizes['bin'], 'bin')}, needs {self.bins}"

    def _unlike(self, run: Run) -> Iterable[str]:
        """Yield reasons of kind: law, end of the sweep, solver, records."""
        if "plastic_volume" in run.dataset:
            yield "pressures end at a hardness, needs elastic contact"
        if "leg" in run.dataset:
            yield "a path of legs, needs one sweep"
        if self.law and run.law != self.law:
            yield f"midpoint law {run.law}, needs {self.law}"
        if self.ends and not any(run.end == end or run.end.startswith(f"{end}=") for end in self.ends):
            ends = f"sweep to {run.end}" if run.end else "no sweep"
            yield f"{ends}, needs one to {' or '.join(self.ends)}"
        if run.steps and run.rtol > self.rtol * (1.0 + SAME):
            yield f"residual up to {run.rtol:g}, needs {self.rtol:g}"
        if self.steps and run.study is not None and run.study.solver.kernel != self.kernel:
            yield f"kernel {run.study.solver.kernel}, needs {self.kernel}"
        if self.steps and run.study is not None and run.study.record.region is not None:
            yield f"observes {run.study.record.region.label}, needs the whole surface"
        if self.L and abs(run.L - self.L) > SAME * self.L:
            yield f"L = {run.L:g}, needs L = {self.L:g}"
        if self.L and run.scaled:
            yield "heights scaled to an Sq, needs them as midpoint displacement makes them"
        for dim, label in self.states:
            stored = run.dataset.coords[dim].values if dim in run.dataset.coords else ()
            if label not in map(str, stored):
                yield f"nothing recorded at {label}"

    def _asks_for_several(self) -> bool:
        """Return whether values of ``by`` are compared without being named."""
        named = {"": (), "D": self.D, "m": self.m}[self.by]
        return bool(self.by) and not named

    def _incomplete(self, run: Run) -> Iterable[str]:
        """Yield reasons of missing cases, where only some of a study were computed."""
        D_asked = [nearest(run.D, D) for D in self.D] or run.D
        m_asked = [*self.m, max(run.m)] if self.finest else list(self.m)
        pairs = itertools.product(D_asked, m_asked or run.m)
        count, D, m = min((run.computed(D=D, m=m), D, m) for D, m in pairs)
        if count < self.seeds:
            yield f"{_count(count, 'surface')} of D = {D:g}, m = {m} computed, needs {self.seeds}"
        elif run.shallowest > self.separation:
            yield f"d/σ down to {run.shallowest:g}, needs {self.separation:g}"

    def of(self, *holds: str, **changes: Any) -> Needs:
        """Return the same configuration for other stored variables, or otherwise changed."""
        return dataclasses.replace(self, holds=holds, **changes)

    def relaxed(self) -> Needs:
        """Return the configuration without its size: variables, comparison, law, and the plane of the end."""
        kept = {name: getattr(self, name) for name in ("holds", "by", "law", "separation", "optional")}
        planes = tuple(end for end in self.ends if end.endswith("-plane"))
        return Needs(**kept, ends=planes, D=self.D if len(self.D) == 1 else ())

    def rank(self, run: Run) -> tuple[int, ...]:
        """Return the order of runs that fit: values compared, finest m, surfaces, D and m in all, steps."""
        compared = {"": 0, "D": len(run.D), "m": len(run.m)}[self.by]
        return compared, max(run.m), run.seeds, len(run.D), len(run.m), run.steps

    def __str__(self) -> str:
        """Return the configuration in words."""
        needs = [
            (bool(self.holds), ", ".join(symbol(name) for name in self.holds)),
            (bool(self.D), f"D = {listed(self.D)}"),
            (bool(self.m), f"m = {listed(self.m)}"),
            (self._asks_for_several(), f"several {self.by}"),
            (self.finest > 0, f"m >= {self.finest}"),
            (self.seeds > 1, f"{self.seeds} surfaces of each kind"),
            (self.steps > 0, f"{self.steps} steps"),
            (bool(self.ends), f"a sweep to {' or '.join(self.ends)}"),
            (self.separation < math.inf, f"d/σ down to {self.separation:g}"),
            (bool(self.law), f"midpoint law {self.law}"),
            (self.rtol < math.inf, f"residual up to {self.rtol:g}"),
            (self.L > 0.0, f"L = {self.L:g}"),
            (self.bins > 0, f"{self.bins} bins"),
        ]
        words = [text for is_asked, text in needs if is_asked]
        return "; ".join(words + [f"records at {label}" for _, label in self.states])


def symbol(name: str) -> str:
    """Return the symbol of a stored variable, as A*."""
    return VARIABLES[name].symbol if name in VARIABLES else name


def listed(values: Iterable[float]) -> str:
    """Return numbers with commas between them."""
    return ", ".join(f"{value:g}" for value in values)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun if number == 1 else noun + 's'}"


# The paper's configurations -----------------------------------------------------------------------------------------

_SWEEP = Needs(seeds=10, steps=60, ends=("mean-plane",), rtol=1e-6)
BY_D = dataclasses.replace(_SWEEP, by="D", D=(2.1, 2.3, 2.5, 2.7, 2.9), finest=8)
"""Ten surfaces of each D at m = 8, pressed to the mean plane: Figs. 4a, 5, 6."""
BY_M = dataclasses.replace(_SWEEP, by="m", D=(PAPER_D,), m=(3, 4, 5, 6, 7, 8))
"""D = 2.3 at six m: Figs. 4b, 7, 12b. The paper has one surface; an interval takes ten."""
ONE_D = dataclasses.replace(_SWEEP, D=(PAPER_D,), finest=8)
"""Ten surfaces of D = 2.3 at m = 8."""
FIELD = Needs(holds=("gap",), D=(PAPER_D,), m=(PAPER_M,), steps=60, ends=("contact_area=0.1",), rtol=1e-6)
"""The one surface of Figs. 8 to 11, D = 2.3 and m = 7, at A* = 0.1."""
BOXES = Needs(holds=("box_count",), D=(PAPER_D,), m=(PAPER_M,), seeds=10, steps=60, rtol=1e-6)
"""Box counts of ten such surfaces."""
DENSITY = {"L": 100.0, "bins": 50, "states": (("density_at", "last"),)}
"""What f(v) needs beside: volumes have units, so L and the heights count."""
MANY = dataclasses.replace(_SWEEP, D=(2.1, PAPER_D, 2.9), finest=7, seeds=100)
"""A hundred surfaces of three D."""
_PRESSED = ("contact_area_fraction", "mean_pressure", "free_volume")
ALONE = (
    Needs(("heights",), D=(2.1, PAPER_D, 2.5, 2.9), m=(PAPER_M,)),
    BY_M.of(*_PRESSED, seeds=1),
    Needs(_PRESSED, D=(PAPER_D,), m=(PAPER_M,), steps=60, ends=("indentation",), rtol=1e-6),
)
"""What the paper shows and no claim needs: its surfaces, one surface by m, the start of contact."""
