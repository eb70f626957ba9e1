"""The section ``ensemble``: the accuracy of the mean over all surfaces, in place of a number of seeds."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import AfterValidator, ConfigDict, Field, PlainSerializer, PlainValidator, WithJsonSchema, model_validator

from roughvol.study.plain_data import KeyPath, number_text
from roughvol.study.sections.strict import Choice, default, optional, refuse_at
from roughvol.study.sections.sweep import Levels, levels_of
from roughvol.study.values.state_kinds import LISTS, STARRED, Level
from roughvol.study.values.types import AreaFraction, Many, Seed, Word, refuse
from roughvol.study.values.units import Length, Position, Pressure, Time, Written

CLOSING = {  # end of a sweep that gives each quantity without a state
    "percolation_pressure": "percolation-both",
    "percolation_pressure_x": "percolation-x",
    "percolation_pressure_y": "percolation-y",
}
"""Pressures at which the void closes. They belong to no state of ``at``."""

RECORDED_BY = {
    "connected_volume_fraction": "percolation",
    "transmissivity": "transmissivity",
    "log_leak_rate": "transmissivity",
} | dict.fromkeys(CLOSING, "percolation")
"""Keys of ``record.transport`` that quantities of the void need, at every step."""

PERCENT = r"^[0-9.]+(e[-+]?[0-9]+)? *%$"
TIGHTEST = 1e-5  # smallest relative accuracy
WIDEST = 0.5  # largest relative accuracy
RTOL_SHARE = 1e-2  # residual of the solver over the accuracy
TIGHTEST_RTOL = 1e-9  # smallest residual of the solver
LOOSEST_RTOL = 1e-3  # largest residual of the solver
COARSEST = 4  # m of the coarsest level; there a sweep takes as long as its file
FEWEST_LEVELS = 3  # levels that show whether a mean converges
AUTO_FROM = 7  # smallest finest level of `m: auto`
AUTO_TO = 12  # largest finest level of `m: auto`
STEPS = 20  # steps of an ensemble that gives none


class Accuracy(Written):
    """A half-width of an interval: absolute, or relative to the mean as 1 %, with the value 0.01."""

    @property
    def relative(self) -> bool:
        """Whether it is a share of the mean."""
        return self.text.endswith("%")

    def of(self, mean: float) -> float:
        """Return the absolute half-width for a mean."""
        return float(self) * abs(mean) if self.relative else float(self)


def plain_form(value: Accuracy) -> Any:
    """Return an accuracy as in a study: an absolute one as a number, others as text."""
    return value.text if value.relative else float(value)


def _accuracy(value: Any) -> Accuracy:
    """Return the accuracy of a number, or of the text of a number and %."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        if not 0.0 < (number := float(value)) < math.inf:
            refuse("must be > 0")
        return Accuracy(number, number_text(number))
    parts = re.fullmatch(r"([0-9]+\.?[0-9]*(?:e[-+]?[0-9]+)?)\s*%", value.strip() if isinstance(value, str) else "")
    if parts is None:
        refuse("must be a number > 0, or a number > 0 with % behind it")
    share = round(float(parts[1]) / 100.0, 15)
    if not TIGHTEST <= share <= WIDEST:
        refuse("must be {low} % to {high} %", low=number_text(100 * TIGHTEST), high=number_text(100 * WIDEST))
    return Accuracy(share, f"{number_text(round(100.0 * share, 12))} %")


def _absolute(width: Accuracy) -> Accuracy:
    """Refuse a share as the accuracy of a logarithm."""
    if width.relative:
        refuse("must be a number > 0, as 0.05 for 12 % of the leak: a share of a logarithm is no share of the leak")
    return width


HalfWidth = Annotated[
    Accuracy,
    PlainValidator(_accuracy),
    PlainSerializer(plain_form),
    WithJsonSchema({"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"type": "string", "pattern": PERCENT}]}),
]
LogHalfWidth = Annotated[
    HalfWidth, AfterValidator(_absolute), WithJsonSchema({"type": "number", "exclusiveMinimum": 0})
]


def _mean(quantity: str, width: str = "relative as 1 % or absolute as 0.01") -> Any:
    """Return the field of the accuracy of a mean."""
    return optional(f"{quantity}: half-width of the 95 % interval of its mean, {width}")


class Accuracies(Choice):
    """The quantities to average, each with the accuracy of its mean; other names are those of ``record.own``."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, HalfWidth]
    EMPTY = "names no quantity: {known}"

    free_volume: HalfWidth | None = _mean("V*")
    contact_area: HalfWidth | None = _mean("A*")
    pressure: HalfWidth | None = _mean("p*")
    separation: HalfWidth | None = _mean("d/σ")
    indentation: HalfWidth | None = _mean("Δ/σ")
    connected_volume_fraction: HalfWidth | None = _mean("share of V* connected to a side; record.transport.percolation")
    transmissivity: HalfWidth | None = _mean("T*, mean of both axes; record.transport.transmissivity")
    log_leak_rate: LogHalfWidth | None = _mean(
        "log10(T* V*^3), mean of both axes; record.transport.transmissivity", "absolute as 0.05"
    )
    percolation_pressure: HalfWidth | None = _mean("p* at which no way is left along x or y; sweep.to: percolation")
    percolation_pressure_x: HalfWidth | None = _mean("p* at which no way is left along x; sweep.to: {percolation: x}")
    percolation_pressure_y: HalfWidth | None = _mean("p* at which no way is left along y; sweep.to: {percolation: y}")

    @model_validator(mode="before")
    @classmethod
    def _by_stored_name(cls, value: Any) -> Any:
        """Accept the names of the stored variables as well."""
        if not isinstance(value, dict):
            return value
        short = {kind.stored: name for name, kind in STARRED.items()}
        for name, accuracy in value.items():
            if short.get(name, name) != name and short[name] in value:
                refuse_at((name,), accuracy, "is '{name}' by another name: give one of them", name=short[name])
        return {short.get(name, name): accuracy for name, accuracy in value.items()}

    @property
    def own(self) -> list[str]:
        """Names of quantities of the user."""
        return list(self.model_extra or {})


class States(Levels):
    """The states of the means: the last step, or levels of one or more quantities."""

    pressure: Many[Pressure] = levels_of("p* > 0, or of p as 0.5 MPa")
    separation: Many[Position] = levels_of("d/σ, or of d as 0.5 um")
    contact_area: Many[AreaFraction] = levels_of("A*, 0 < A* <= 1")
    indentation: Many[Length] = levels_of("Δ/σ > 0, or of Δ as 2 um")


class Ensemble(Choice):
    """Means over all surfaces to an accuracy; the campaign plans the seeds of each level."""

    accuracy: Accuracies = Field(
        description="{free_volume: 1 %}: each quantity, or name of record.own, with the half-width of its 95 % interval"
    )
    at: Annotated[States, Word("last")] = default(
        States(), "'last', or levels of pressure, separation, contact_area, indentation at which the means are taken"
    )
    budget: Time | None = optional("time after which no further samples begin, as 10 min")
    first_seed: Seed = default(0, "first seed; another one gives an independent answer")

    def states(self) -> Iterator[tuple[KeyPath, Level]]:
        """Yield the states with a value, each with its place in the study."""
        return self.at.placed("ensemble", "at")

    @property
    def tolerance(self) -> float:
        """Sufficient residual η/σ of the solver: a hundredth of the accuracy, as a power of ten.

        Requests of the same power share their samples.
        """
        least = RTOL_SHARE * min(self.accuracy.named.values())
        return min(max(10.0 ** math.floor(math.log10(least) + 1e-9), TIGHTEST_RTOL), LOOSEST_RTOL)


def with_default_steps(data: Any) -> Any:
    """Return the data of a study, with `STEPS` where an ensemble is given without a number of steps."""
    if not isinstance(data, dict) or data.get("ensemble") is None:
        return data
    sweep = data.get("sweep", {})
    if not isinstance(sweep, dict) or "steps" in sweep or any(map(sweep.get, LISTS)):
        return data
    return {**data, "sweep": {"steps": STEPS, **sweep}}


def levels_below(m: int) -> tuple[int, ...]:
    """Return the levels of an ensemble.

    Parameters
    ----------
    m : int
        Finest level.

    Returns
    -------
    tuple of int
        m of all levels, coarsest first.
    """
    return tuple(range(max(1, min(COARSEST, m - FEWEST_LEVELS + 1)), m + 1))
