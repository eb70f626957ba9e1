"""The section ``sweep`` of a study: the last state, listed states, and paths of legs; and states selected of a sweep.

Levels are dimensionless, or have a unit: ``indentation`` Δ/σ, ``separation`` d/σ, ``contact_area`` A*, ``free_volume``
V*, ``pressure`` p* = mean(p) L/(E* σ); ``mean_gap`` and ``load`` always have one.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

import pydantic
from pydantic import Field

from roughvol.errors import nearest_word
from roughvol.study.plain_data import KeyPath
from roughvol.study.sections.strict import Choice, Strict, default, optional, refuse_at
from roughvol.study.values.state_kinds import LISTS, OF_ALL, STATE_KINDS, Level
from roughvol.study.values.types import AS_TUPLE, WHOLE, AreaFraction, Many, Positive, StepNumber, Word, refuse
from roughvol.study.values.units import Flow, Gap, In, Length, Load, Position, Pressure, in_unit, text_of, unit_of


def levels_of(quantity: str) -> Any:
    """Return the field of the levels of a quantity."""
    return Field(default_factory=tuple, description=f"levels of {quantity}")


class Levels(Choice):
    """The last state, or levels of one or more quantities."""

    @pydantic.field_validator("*")
    @classmethod
    def _once(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        """Take a state once, as 0.5 MPa beside 500 kPa."""
        unit = next(filter(None, map(unit_of, values)), None)
        found: dict[float | str, float] = {}
        for value in values:
            found.setdefault(value if unit_of(value) is None else f"{in_unit(value, unit):.12g}", value)
        return tuple(found.values())

    @pydantic.model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> Any:
        return super()._plain(handler) or "last"

    @property
    def levels(self) -> tuple[Level, ...]:
        """Levels, kind by kind; ``Level("last")`` without any."""
        levels = (Level(kind, value) for kind, values in self.named.items() for value in values)
        return tuple(levels) or (Level("last"),)

    def placed(self, *place: str) -> Iterator[tuple[KeyPath, Level]]:
        """Yield the levels, each with its place in the study, from the place of the section."""
        for kind, values in self.named.items():
            for k, value in enumerate(values):
                yield (*place, kind, k), Level(kind, value)


class Select(Levels):
    """States to record: the last one, steps, or levels.

    Fields, densities and box counts are those of the state at the level, solved for them. Quantities along the steps
    are those of the first step at the level or beyond it.
    """

    step: Many[StepNumber] = Field(default_factory=tuple, description="step numbers, from 1 to sweep.steps")
    contact_area: Many[AreaFraction] = levels_of("A*, 0 < A* <= 1")
    pressure: Many[Pressure] = levels_of("p* > 0, or of p as 0.5 MPa")
    separation: Many[Position] = levels_of("d/σ, reached from above, or of d as 0.5 um")
    indentation: Many[Length] = levels_of("Δ/σ > 0, or of Δ as 2 um")
    free_volume: Many[Positive] = levels_of("V* > 0, reached from above")
    mean_gap: Many[Gap] = levels_of("the mean gap, as 1 um, reached from above")
    load: Many[Load] = levels_of(f"the load on the whole surface, as 20 N; {OF_ALL}")


Selector = Annotated[Select, Word("last")]
IN_WORDS = "'last', or levels of step, contact_area, pressure, separation, indentation, free_volume, mean_gap, load"

LengthOrZero = Annotated[float, Field(ge=0), In("length")]  # a leg that unloads may end at 0
PressureOrZero = Annotated[float, Field(ge=0), In("pressure")]


class Target(Choice):
    """The last state of a sweep, by a starred value, or by one with its unit."""

    model_config = pydantic.ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    percolation: Literal["x", "y", "both"] | None = optional("end without an open way along 'x', 'y' or 'both'")
    indentation: LengthOrZero | None = optional("end at this Δ/σ > 0, or Δ as 2 um; 0 on a later leg: no contact")
    contact_area: AreaFraction | None = optional("end at this A*, 0 < A* <= 1")
    pressure: PressureOrZero | None = optional("end at this p* > 0, or p as 0.5 MPa; 0 on a later leg: no contact")
    separation: Position | None = optional("end at this d/σ, negative beyond the mean plane, or d as 0.5 um")
    free_volume: Positive | None = optional("end at this V* > 0, which falls on loading")
    mean_gap: Gap | None = optional("end at this mean gap > 0, as 1 um")
    load: Load | None = optional(f"end at this load > 0 on the whole surface, as 20 N; {OF_ALL}")
    leak_rate: Flow | None = optional(
        "end where both leak rates have fallen to this, as 1e-3 mm^3/s; the fluid: record.dimensional.leak_rate"
    )
    leak_rate_x: Flow | None = optional("end where the leak rate along x has fallen to this")
    leak_rate_y: Flow | None = optional("end where the leak rate along y has fallen to this")

    @pydantic.model_validator(mode="after")
    def _one_state(self) -> Target:
        if len(self.named) != 1:
            refuse("must name exactly one of {known}", known=", ".join(type(self).model_fields))
        return self


def _listed(states: str, note: str = "") -> Any:
    """Return the field of a list of states with a step at each."""
    return default((), f"instead of steps and to: {states}, a step at each{note}")


PLANES, PERCOLATION = ("mean-plane", "summit-plane"), "percolation"


def _tag_to(value: Any) -> str:
    """Return the form of an end; an unknown word has the form of the most similar word."""
    is_plane = isinstance(value, str) and nearest_word(value, [*PLANES, PERCOLATION]) in PLANES
    return "<plane>" if is_plane else "<state>"


End = Annotated[
    Annotated[Literal["mean-plane", "summit-plane"], pydantic.Tag("<plane>")]
    | Annotated[Target, Word(PERCOLATION, (("percolation", "both"),), PLANES), pydantic.Tag("<state>")],
    pydantic.Discriminator(_tag_to),
]
_ENDS = (
    "last state: mean-plane (d = 0), summit-plane (at the mean height of the summits), percolation (no open way left), "
    "or one of {percolation: x|y|both}, {indentation: x}, {contact_area: x}, {pressure: x}, {separation: x}, "
    "{free_volume: x}, {mean_gap: 1 um}, {load: 20 N}, {leak_rate: 1e-3 mm^3/s}"
)


def _check_order(levels: Sequence[Any]) -> None:
    """Refuse listed levels that neither rise nor fall, or of which only some have a unit."""
    kind, given = STATE_KINDS[levels[0].kind], [level.value for level in levels]
    unit = unit_of(given[0])
    if any((unit_of(value) is None) != (unit is None) for value in given):
        refuse_at((kind.plural,), given, "either all values have a unit, or none")
    values = [in_unit(value, unit) for value in given]
    falls = values[:2] != sorted(values[:2])
    rule = "must rise or fall from value to value (up and down are two legs)"
    for index, (one, other) in enumerate(itertools.pairwise(values), start=1):
        if not (one > other if falls else one < other):
            refuse_at((kind.plural, index), text_of(given[index]), rule)


class Sweep(Strict):
    """Number of equal steps of indentation, and the last state; a leg of a path begins at the end of the leg before."""

    steps: Annotated[int, Field(ge=0, le=10_000), WHOLE] = default(
        60,
        "number of equal steps of indentation, 0 to 10000, of a leg from 1 on; 0: no contact; 20 in an ensemble "
        "without steps",
    )
    to: End = default("mean-plane", _ENDS)
    equal: Literal["indentation", "pressure", "log pressure"] = default(
        "indentation", "equal steps of 'indentation', 'pressure', or 'log pressure' (equal ratios from 'first')"
    )
    first: Pressure | None = optional(
        "p* or pressure of the first step on the first leg, with equal: log pressure; default: that of the "
        "last step over 1000"
    )
    pressures: Many[PressureOrZero] = _listed("p* > 0, on a later leg 0 too, or pressures as 0.1 MPa")
    loads: Many[Load] = _listed("loads on the whole surface, as 20 N", f"; {OF_ALL}")
    contact_areas: Many[AreaFraction] = _listed("A*")
    indentations: Many[LengthOrZero] = _listed("Δ/σ > 0, on a later leg 0 too, or lengths")
    separations: Many[Position] = _listed("falling d/σ or lengths")
    free_volumes: Many[Positive] = _listed("falling V*")
    mean_gaps: Many[Gap] = _listed("falling mean gaps, as 1 um")
    leak_rates: Many[Flow] = _listed("falling leak rates, as 1e-3 mm^3/s")

    @pydantic.model_validator(mode="before")
    @classmethod
    def _steps_of_a_list(cls, data: Any) -> Any:
        """Give the number of steps and the last state that follow from a list of states."""
        given = [name for name in LISTS if data.get(name) or data.get(name) == 0] if isinstance(data, dict) else []
        if not given:
            return data
        name, *others = given
        others += [key for key in ("steps", "to", "equal", "first") if key in data]
        if others:
            beside = ", ".join(f"'{key}'" for key in others)
            refuse("'{name}' makes a step of each value: omit {others}", name=name, others=beside)
        values = data[name] if isinstance(data[name], list | tuple) else [data[name]]
        return {**data, "steps": len(values), "to": {LISTS[name].name: values[-1]}}

    @pydantic.model_validator(mode="after")
    def _in_order(self) -> Sweep:
        if self.listed is not None:
            _check_order(self.listed)
        if self.first is not None and self.equal != "log pressure":
            refuse("'first' needs equal: log pressure")
        return self

    @pydantic.model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> Any:
        """Write a list of states alone, and none where there is none."""
        data = handler(self)
        given = [name for name in LISTS if data.get(name)]
        if given:
            return {given[0]: data[given[0]]}
        return {name: value for name, value in data.items() if name not in LISTS}

    @property
    def listed(self) -> tuple[Level, ...] | None:
        """The states of the steps where they are listed; None for steps equal in indentation."""
        return tuple(Level(kind.name, value) for name, kind in LISTS.items() for value in getattr(self, name)) or None

    @property
    def goals(self) -> tuple[Level, ...]:
        """The listed states, or else the last state: those of the last steps."""
        return self.listed or (self.target,)

    @property
    def has_units(self) -> bool:
        """Whether any state has a unit."""
        return any(unit_of(level.value) is not None for _, level in self.states())

    def states(self, place: KeyPath = ("sweep",)) -> Iterator[tuple[KeyPath, Level]]:
        """Yield the states with a value, each with its place in the study."""
        for k, level in enumerate(self.listed or ()):
            yield (*place, STATE_KINDS[level.kind].plural, k), level
        if self.listed is None and self.target.value is not None:
            yield (*place, "to", self.target.kind), self.target
        if self.first is not None:
            yield (*place, "first"), Level("pressure", self.first)

    @property
    def target(self) -> Level:
        """Last state of the sweep: a plane or the end of percolation (value None), or a starred value."""
        if isinstance(self.to, str):
            return Level(self.to)
        kind, value = next(iter(self.to.named.items()))
        return Level(f"{kind}-{value}") if kind == "percolation" else Level(kind, value)

    @property
    def legs(self) -> tuple[Sweep, ...]:
        """The legs of the path: this one."""
        return (self,)

    def step_of(self, level: Level) -> int | None:
        """Return the index of the step that is defined as a state: a listed state, or the end; None for other states.

        The solve of such a step may miss the state by more than `REACHED` where the residual asked for is large.

        Examples
        --------
        >>> Sweep(pressures=[0.1, 0.2]).step_of(Level("pressure", 0.2))
        1
        """
        first = self.steps - len(self.goals)
        return next((first + k for k, goal in enumerate(self.goals) if goal.same(level)), None)

    def goal_of(self, step: int) -> Level | None:
        """Return the state that a step is defined as, by its index; None for other steps."""
        from_end = self.steps - step
        return self.goals[-from_end] if from_end <= len(self.goals) else None


class Legs(pydantic.RootModel[tuple[Sweep, ...]]):
    """A path of legs, up and down."""

    model_config = pydantic.ConfigDict(strict=True, frozen=True)
    root: Annotated[tuple[Sweep, ...], AS_TUPLE, Field(min_length=1, max_length=100)] = Field(
        description="list of legs {steps, to}, each from the end of the one before"
    )

    @property
    def legs(self) -> tuple[Sweep, ...]:
        """The legs of the path."""
        return self.root

    @property
    def has_units(self) -> bool:
        """Whether any state has a unit."""
        return any(leg.has_units for leg in self.root)

    def states(self) -> Iterator[tuple[KeyPath, Level]]:
        """Yield the states with a value of all legs, each with its place in the study."""
        for number, leg in enumerate(self.root):
            yield from leg.states(("sweep", number))

    @property
    def steps(self) -> int:
        """Steps of all legs."""
        return sum(leg.steps for leg in self.root)

    @property
    def target(self) -> Level:
        """Last state of the last leg."""
        return self.root[-1].target


def tag_sweep(value: Any) -> str:
    """Return the tag of `Legs` for a list of legs, else that of `Sweep`."""
    return "<path>" if isinstance(value, list | tuple | Legs) else "<sweep>"
