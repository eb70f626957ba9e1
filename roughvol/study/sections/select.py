"""States that a study selects: the last one, steps, or levels of a quantity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from pydantic import (
    ConfigDict,
    Field,
    model_serializer,
)

from roughvol.study.sections.strict import Choice
from roughvol.study.values.numbers import AreaFraction, Positive, StepNumber
from roughvol.study.values.scale import OF_ALL
from roughvol.study.values.state_kinds import Level, Starred
from roughvol.study.values.units import Gap, Length, Load, Position, Pressure, Quantity, unit_of
from roughvol.study.values.words import Many, Word


class Select(Choice):
    """States to record: the last one, steps, or levels.

    Fields, densities and box counts are those of the state at the level, solved for them. Quantities along the steps
    are those of the first step at the level or beyond it.
    """

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    step: Many[StepNumber] = Field(default_factory=tuple, description="step numbers, from 1 to sweep.steps")
    contact_area: Many[AreaFraction] = Field(default_factory=tuple, description="levels of A*, 0 < A* <= 1")
    pressure: Many[Pressure] = Field(default_factory=tuple, description="levels of p* > 0, or of p as 0.5 MPa")
    separation: Many[Position] = Field(
        default_factory=tuple, description="levels of d/σ, reached from above, or of d as 0.5 um"
    )
    indentation: Many[Length] = Field(default_factory=tuple, description="levels of Δ/σ > 0, or of Δ as 2 um")
    free_volume: Many[Positive] = Field(default_factory=tuple, description="levels of V* > 0, reached from above")
    mean_gap: Many[Gap] = Field(
        default_factory=tuple, description="levels of the mean gap, as 1 um, reached from above"
    )
    load: Many[Load] = Field(
        default_factory=tuple, description=f"levels of the load on the whole surface, as 20 N; {OF_ALL}"
    )

    @model_serializer
    def _plain(self) -> Any:
        written = {
            kind: [str(value) if isinstance(value, Quantity) else value for value in values]
            for kind, values in self.named.items()
        }
        return written or "last"

    @property
    def levels(self) -> tuple[Level, ...]:
        """Levels, kind by kind; ``Level("last")`` without any."""
        levels = (Level(kind, value) for kind, values in self.named.items() for value in values)
        return tuple(levels) or (Level("last"),)

    def starred(self, of: Callable[[Level], Level]) -> Select:
        """Return the same states as starred numbers, each with its label in the study."""
        values: dict[str, tuple[float, ...]] = {}
        for level in self.levels:
            if level.value is None:
                return self
            new = of(level)
            value = new.value if unit_of(level.value) is None else Starred(new.value or 0.0, level.label)
            values[new.kind] = (*values.get(new.kind, ()), value or 0.0)
        return type(self).model_construct(None, **values)


Selector = Annotated[Select, Word("last")]
IN_WORDS = "'last', or levels of step, contact_area, pressure, separation, indentation, free_volume, mean_gap, load"
