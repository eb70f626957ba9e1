"""The section ``surface`` of surfaces by random midpoint displacement."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_serializer

from roughvol.study.sections.strict import Strict, nearest
from roughvol.study.values.numbers import Dimension, Refinement, Seed, whole
from roughvol.study.values.units import Length, LengthUnit, unit_of
from roughvol.study.values.words import Auto, Many, refuse
from roughvol.surfaces.length_units import factor

MAX_SEEDS = 10_000
UNIT = "unit of L, of the heights and of stored lengths; default: none"


def count_in_schema(schema: dict[str, Any]) -> None:
    """Write the bounds of a number of seeds into a JSON schema."""
    schema["anyOf"][0] = {"type": "integer", "minimum": 1, "maximum": MAX_SEEDS}  # a number of seeds


def counted(value: Any) -> Any:
    """Return the seeds 0 … n - 1 for a number n of seeds, other values unchanged."""
    value = whole(value)
    if not isinstance(value, int) or isinstance(value, bool):
        return value
    if not 1 <= value <= MAX_SEEDS:
        refuse("a number of seeds must be 1 to {most}", most=str(MAX_SEEDS))
    return tuple(range(value))


class GeneratedSurface(Strict):
    """Surfaces by random midpoint displacement; every combination of D, m and seed is a case."""

    D: Many[Dimension] = Field(description="fractal dimension of the generated surface, 2 < D < 3; a number or a list")
    m: Annotated[Many[Refinement], Auto()] = Field(
        description="2^m + 1 nodes per side, whole, 1 <= m <= 13; a number or a list; 'auto' for an ensemble"
    )
    L: Length = Field(default=100.0, description="lateral size, L > 0, as 100 or 100 um")
    seeds: Many[Seed] = Field(
        default=10,
        validate_default=True,
        json_schema_extra=count_in_schema,
        description=f"number of seeds, 1 to {MAX_SEEDS} (10: seeds 0 to 9), or a list of seeds >= 0",
    )
    midpoint_law: Literal["std", "variance"] = Field(
        default="std", description="quantity divided by 2^((3-D)/2) in each half step: 'std' or 'variance'"
    )
    periodic: bool = Field(
        default=False,
        description="true: the surface is one period of a plane, without a repeated edge, on a periodic half space; "
        "L is the period; 2^m nodes per side",
    )
    unit: LengthUnit | None = Field(default=None, description=UNIT)
    Sq: Length | None = Field(
        default=None,
        description="root mean square of the stored heights, > 0, with its unit or in that of L; default: not scaled",
    )

    @property
    def length_unit(self) -> str | None:
        """Unit of all lengths; None for an arbitrary one."""
        return unit_of(self.L) or self.unit

    @property
    def height(self) -> float | None:
        """Sq of the scaled heights in the unit of L; None if they are not scaled."""
        given = unit_of(self.Sq)
        if self.Sq is None or given is None or self.length_unit is None:
            return self.Sq
        return float(self.Sq) * factor(given, self.length_unit)

    @model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> dict[str, Any]:
        """Write 'auto' where an ensemble chooses m."""
        data: dict[str, Any] = handler(self)
        return data if self.m else data | {"m": "auto"}

    @property
    def dimensions(self) -> tuple[float, ...]:
        """All D."""
        return self.D

    _count = field_validator("seeds", mode="before")(counted)


def tag_surface(value: Any) -> str:
    """Return the tag of `height_file.HeightFile` for keys of a file, else that of `GeneratedSurface`."""
    if not isinstance(value, dict):
        return "<generated>" if isinstance(value, GeneratedSurface) else "<file>"
    hints = not {"D", "m"} & value.keys() and any(nearest(key, ["file", "variable"]) for key in value)
    return "<file>" if {"file", "files"} & value.keys() or hints else "<generated>"
