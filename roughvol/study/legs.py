"""Paths of a sweep: legs up and down, each from the end of the one before."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Discriminator, Field, RootModel, Tag

from roughvol.study.sections import Level, Sweep, Target, Whole, Word, tag_end


def _as_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


class LegTarget(Target):
    """The last state of a leg. Indentation and pressure may fall to zero."""

    indentation: Annotated[float, Field(ge=0)] | None = Field(default=None, description="end at this Δ/σ >= 0")
    pressure: Annotated[float, Field(ge=0)] | None = Field(
        default=None, description="end at this p* >= 0; 0 is where contact is lost"
    )


class Leg(Sweep):
    """A leg of a path: number of equal steps of indentation from the end of the leg before, and the last state."""

    steps: Annotated[Whole, Field(ge=1, le=10_000)] = Field(
        default=60, description="number of equal steps of indentation on this leg, 1 to 10000"
    )
    to: Annotated[
        Annotated[Literal["mean-plane", "summit-plane"], Tag("<plane>")]
        | Annotated[LegTarget, Word("percolation", (("percolation", "both"),)), Tag("<state>")],
        Discriminator(tag_end),
    ] = Field(
        default="mean-plane",
        description="last state of the leg: mean-plane, summit-plane, percolation, or one of {percolation: x|y|both}, "
        "{indentation: x}, {contact_area: x}, {pressure: x}, {separation: x}, {free_volume: x}",
    )


class Legs(RootModel[tuple[Leg, ...]]):
    """A path of legs, up and down."""

    model_config = ConfigDict(strict=True, frozen=True)
    root: Annotated[tuple[Leg, ...], BeforeValidator(_as_tuple), Field(min_length=1, max_length=100)] = Field(
        description="list of legs {steps, to}, each from the end of the one before"
    )

    @property
    def legs(self) -> tuple[Leg, ...]:
        """The legs of the path."""
        return self.root

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
