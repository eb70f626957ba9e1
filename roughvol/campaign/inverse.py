"""The load at which a leak has a given value, by solves of the cases of a run.

A read-off from a stored sweep is right to its interpolation (`analysis.read_off`). Here the states themselves are
solved: one state of every surface in each round, at the indentation that its last two states give for the pressure
sought. The pressure follows by the secant of log(leak) over log(pressure), inside a bracket as soon as there is one.
Several surfaces have the geometric mean of their leaks at one nominal pressure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from roughvol.campaign import path
from roughvol.campaign.one_case import HalfSpaces, half_space_of, one_thread, surface_of
from roughvol.contact.loading import Contact, Trials
from roughvol.errors import CampaignError
from roughvol.observables.levels import options_of
from roughvol.observables.regions import within
from roughvol.observables.transport import conduction
from roughvol.store.dataset import Dataset
from roughvol.study import Case, Study

AXES = ("x", "y")
TOLERANCE = 1e-9  # η/σ of the states solved, unless that of the study is smaller
ACCURACY = 1e-8  # of log(pressure), the last correction
APART = 1e-4  # of log(pressure), of a surface in the last round; its slope is known to better than this
NEAR = 1e-3  # of log(pressure): states that decide on which side the answer lies
LARGEST_STEP = 0.5  # of log(pressure) in a round
ROUNDS = 60


@dataclass(frozen=True)
class Refined:
    """A load found by solves.

    Attributes
    ----------
    nominal : float
        Nominal pressure at the E* and Sq of the study, in its unit.
    solves : int
        States solved, over all surfaces.
    """

    nominal: float
    solves: int


@dataclass(frozen=True)
class Point:
    """A solved state of one surface: indentation, log of the nominal pressure, log of the leak (-inf if closed)."""

    indentation: float
    pressure: float
    leak: float


@dataclass
class OneSurface:
    """A surface of the run, its stored states, and its solved ones."""

    trials: Trials
    case: Case
    axis: int
    per_starred: float  # nominal pressure of p* = 1
    per_flow: float  # leak of T* V*³ = 1
    stored: tuple[np.ndarray, np.ndarray, np.ndarray]  # log pressure, indentation, log leak (-inf: closed)
    points: list[Point] = field(default_factory=list)
    solved: list[Contact] = field(default_factory=list)

    def towards(self, pressure: float) -> Point:
        """Solve the state expected at a pressure, and return it."""
        indentation = self._indentation(pressure)
        contact = self.trials.at(indentation, *self._pair(indentation))
        self.solved = [*self.solved, contact][-3:]
        state = within(contact, self.case)
        flow = conduction(state.gap(), self.axis, periodic=state.periodic).coefficient * state.free_volume**3
        log_leak = math.log(flow * self.per_flow) if flow > 0.0 else -math.inf
        point = Point(indentation, math.log(state.mean_pressure * self.per_starred), log_leak)
        self.points = [*self.points, point][-3:]
        return point

    def slope(self) -> float:
        """Return d log(leak)/d log(pressure) at the last state, from its own states or from the stored ones."""
        here = self.points[-1]
        open_ = [one for one in self.points[:-1] if math.isfinite(one.leak) and one.pressure != here.pressure]
        if open_ and math.isfinite(here.leak):
            other = min(open_, key=lambda one: abs(one.pressure - here.pressure))
            slope = (other.leak - here.leak) / (other.pressure - here.pressure)
            if math.isfinite(slope) and slope < 0.0:
                return slope
        pressures, _, leaks = (values[np.isfinite(self.stored[2])] for values in self.stored)
        k = int(np.clip(np.searchsorted(pressures, here.pressure), 1, pressures.size - 1))
        return float((leaks[k] - leaks[k - 1]) / (pressures[k] - pressures[k - 1]))

    def _indentation(self, pressure: float) -> float:
        """Return the indentation expected at a pressure, on the line through the nearest two states."""
        near = sorted(self.points, key=lambda one: abs(one.pressure - pressure))[:2]
        if len(near) == 2 and near[0].pressure != near[1].pressure:
            one, other = near
            rate = (other.indentation - one.indentation) / (other.pressure - one.pressure)
            return one.indentation + rate * (pressure - one.pressure)
        pressures, indentations, _ = self.stored
        expected = float(np.interp(pressure, pressures, indentations))
        if near:  # the stored line, through the state solved
            expected += near[0].indentation - float(np.interp(near[0].pressure, pressures, indentations))
        return expected

    def _pair(self, indentation: float) -> tuple[Contact, Contact | None]:
        """Return the two known states from which to start: around the indentation, or below it."""
        known = sorted([self.trials.untouched, *self.solved], key=lambda contact: contact.approach)
        below = [contact for contact in known if contact.approach < indentation]
        above = [contact for contact in known if contact.approach >= indentation]
        if above:
            return above[0], below[-1] if below else None
        return below[-1], below[-2] if len(below) > 1 else None


def refine(
    study: Study, run: Dataset, axis: str, largest: float, start: float, *, scaled_from: float | None = None
) -> Refined:
    """Return the nominal pressure at which the leak of the mean surface has a value, by solves of all its cases.

    Parameters
    ----------
    study : Study
        Study of the run, with its height files.
    run : Dataset
        Its results, with leak rates.
    axis : str
        x or y.
    largest : float
        The leak in the unit of the run.
    start : float
        First guess of the pressure in the unit of the run: a read-off.
    scaled_from : float, optional
        Nominal pressure at another Sq. The Sq is then over that of the study as this pressure over the one returned,
        and the leak of a liquid is that ratio cubed times the leak of the study.

    Returns
    -------
    Refined
        Pressure at the E* and Sq of the study, right to 10⁻⁸ and to the residuals; and the number of solves.

    Raises
    ------
    CampaignError
        If the pressure is not found.
    ContactError, ConvergenceError, StudyError, SurfaceError
        If a case cannot be made or solved.
    """
    with one_thread():
        surfaces = list(_surfaces(study, run, axis))
        return _root(surfaces, math.log(largest), math.log(start), scaled_from and math.log(scaled_from))


def _root(surfaces: Sequence[OneSurface], wanted: float, start: float, scaled_from: float | None) -> Refined:
    x, low, high, solves = start, -math.inf, math.inf, 0
    for _ in range(ROUNDS):
        points = [one.towards(x) for one in surfaces]
        solves += len(points)
        slopes = [one.slope() for one in surfaces]
        at = [point.leak + slope * (x - point.pressure) for point, slope in zip(points, slopes, strict=True)]
        excess, slope = float(np.mean(at)) - wanted, float(np.mean(slopes))
        if scaled_from is not None:
            excess, slope = excess + 3.0 * (scaled_from - x), slope - 3.0
        apart = max(abs(point.pressure - x) for point in points)
        if apart <= NEAR:
            low, high = (x, high) if excess > 0.0 else (low, x)
        elif not math.isfinite(excess):  # closed at another pressure: once more
            continue
        change = -excess / slope if math.isfinite(excess) else math.nan
        if apart <= APART and (abs(change) <= ACCURACY or high - low <= ACCURACY):
            return Refined(math.exp(x + change if abs(change) <= ACCURACY else high), solves)
        following = x + min(max(change, -LARGEST_STEP), LARGEST_STEP)
        if not low < following < high:  # also where it is NaN: the way is closed
            following = 0.5 * (low + high) if math.isfinite(high - low) else x - 0.1 * LARGEST_STEP
        x = following
    message = f"the load is not found in {ROUNDS} rounds of solves; the last pressure was {math.exp(x):.9g}"
    raise CampaignError(message)


def _surfaces(study: Study, run: Dataset, axis: str) -> list[OneSurface]:
    """Return the surfaces of a run that have stored leaks."""
    first = run.isel(step=run["leg"].values == 1) if "leg" in run else run
    held: HalfSpaces = {}
    made = []
    for case in study.cases():
        row = first.sel(case=case.label) if case.file else first.sel(D=case.D, m=case.m, seed=case.seed)
        starred, leak = row["mean_pressure"].values, row[f"leak_rate_{axis}"].values
        kept = np.isfinite(leak) & (starred > 0.0)
        if not kept.any():
            continue
        surface = surface_of(case)
        half_space = half_space_of(surface, case.solver.kernel, 1, held)
        case = path.starred(case, surface)
        options = options_of(case, surface)
        options["rtol"] = min(options["rtol"], TOLERANCE)
        flow = (row[f"transmissivity_{axis}"] * row["free_volume"] ** 3).values
        per_starred = float(np.mean((row["nominal_pressure"].values / np.where(starred > 0.0, starred, np.nan))[kept]))
        open_ = kept & (leak > 0.0)
        if np.count_nonzero(open_) < 2:
            message = f"{case.label} has fewer than two open steps along {axis}: nothing to start from"
            raise CampaignError(message)
        order = np.argsort(starred[kept], kind="stable")
        approach = row["indentation"].values + (starred * _mean_compliance(surface.shape) if case.periodic else 0.0)
        with np.errstate(divide="ignore"):
            logs = np.log(starred[kept] * per_starred)[order], np.log(leak[kept])[order]
        stored = logs[0], approach[kept][order], logs[1]
        trials = Trials(surface, half_space, **options)
        ratio = leak[open_] / flow[open_]
        per_flow = float(ratio.mean())
        if np.ptp(ratio) > 1e-6 * per_flow:
            message = "the leak is not that of a liquid: it does not go with T* V*^3"
            raise CampaignError(message)
        made.append(OneSurface(trials, case, AXES.index(axis), per_starred, per_flow, stored))
    if not made:
        message = f"the run has no stored leak along {axis}"
        raise CampaignError(message)
    return made


def _mean_compliance(shape: tuple[int, int]) -> float:
    """Return mean(u)/σ per p* on a periodic surface, see `contact.periodic`."""
    return max(1.0, shape[1] / shape[0])
