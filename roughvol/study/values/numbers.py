"""Numbers of a study with their intervals."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, Field


def whole(value: Any) -> Any:
    """Return a number like 8.0 as an integer, other values unchanged."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


Whole = Annotated[int, BeforeValidator(whole)]
Dimension = Annotated[float, Field(gt=2, lt=3)]
Refinement = Annotated[Whole, Field(ge=1, le=13)]
Seed = Annotated[Whole, Field(ge=0, lt=2**63)]
Positive = Annotated[float, Field(gt=0)]
AreaFraction = Annotated[float, Field(gt=0, le=1)]
Fraction = Annotated[float, Field(ge=0, le=1)]
StepNumber = Annotated[Whole, Field(ge=1)]
