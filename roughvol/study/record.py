"""The section ``record`` of a study: stored quantities, their states, and the region observed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal, get_args, get_type_hints

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
    field_validator,
    model_serializer,
    model_validator,
)
from pydantic_core import core_schema

from roughvol.study.sections import (
    AreaFraction,
    Choice,
    Fraction,
    Level,
    Many,
    Positive,
    StepNumber,
    Strict,
    Whole,
    Word,
    refuse,
)
from roughvol.study.units import In, Quantity, Starred, UnitOf, convert, in_unit, unit_of
from roughvol.study.yaml_text import number_text


class Select(Choice):
    """States to record: the last one, steps, or levels.

    Fields, densities and box counts are those of the state at the level, solved for them. Quantities along the steps
    are those of the first step at the level or beyond it.
    """

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    step: Many[StepNumber] = Field(default_factory=tuple, description="step numbers, from 1 to sweep.steps")
    contact_area: Many[AreaFraction] = Field(default_factory=tuple, description="levels of A*, 0 < A* <= 1")
    pressure: Many[Annotated[Positive, In("pressure")]] = Field(
        default_factory=tuple, description="levels of p* > 0, or of p as 0.5 MPa"
    )
    separation: Many[Annotated[float, In("length")]] = Field(
        default_factory=tuple, description="levels of d/σ, reached from above, or of d as 0.5 um"
    )
    indentation: Many[Annotated[Positive, In("length")]] = Field(
        default_factory=tuple, description="levels of Δ/σ > 0, or of Δ as 2 um"
    )
    free_volume: Many[Positive] = Field(default_factory=tuple, description="levels of V* > 0, reached from above")
    mean_gap: Many[Annotated[Positive, In("length", needed=True)]] = Field(
        default_factory=tuple, description="levels of the mean gap, as 1 um, reached from above"
    )
    load: Many[Annotated[Positive, In("force", needed=True)]] = Field(
        default_factory=tuple, description="levels of the load on the whole surface, as 20 N"
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
_STATES = "'last', or levels of step, contact_area, pressure, separation, indentation, free_volume, mean_gap, load"


class BoxCounting(Strict):
    """Box counting of the domains v <= threshold × max(v)."""

    at: Selector = Field(default=Select(), description=f"states: {_STATES}")
    thresholds: Many[Fraction] = Field(
        default=(0.0, 0.1, 0.25, 0.5, 1.0), description="fractions of the largest element volume, 0 to 1; a list"
    )


class VolumeDensity(Strict):
    """The density f(v) of the free volume per element."""

    bins: Annotated[Whole, Field(ge=1, le=10_000)] = Field(default=50, description="number of bins, 1 to 10000")
    at: Selector = Field(default=Select(), description=f"states: {_STATES}")
    include_contact: bool = Field(default=False, description="include elements in contact (v = 0): true or false")


class Switch:
    """Accept true for the defaults of a mapping and false for nothing, and show both in the JSON schema."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.no_info_before_validator_function(self._spelled_out, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [{"type": "boolean"}, handler(schema["schema"])]}

    @staticmethod
    def _spelled_out(value: Any) -> Any:
        if isinstance(value, bool):
            return {} if value else None
        if not isinstance(value, dict | BaseModel | None):
            refuse("must be true, false or a mapping (key: value)")
        return value


class Texture(Strict):
    """The texture before load, and of the deformed surface under load."""

    at: Selector = Field(default=Select(), description=f"the states under load to take it at: {_STATES}")


class Psd(Strict):
    """The spectrum before load, and of the deformed surface where states are named."""

    at: Selector | None = Field(
        default=None, description=f"states under load to take it at: {_STATES}; default: before load alone"
    )

    @model_serializer
    def _plain(self) -> Any:
        return True if self.at is None else {"at": self.at}


EVERY_STEP = "every-step"


def _tag_states(value: Any) -> str:
    return "<every>" if value == EVERY_STEP else "<states>"


States = Annotated[
    Annotated[Literal["every-step"], Tag("<every>")] | Annotated[Selector, Tag("<states>")], Discriminator(_tag_states)
]
_WHEN = f"'{EVERY_STEP}', {_STATES}"


class Transport(Choice):
    """Quantities of the void between the surfaces, each with its states."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    percolation: States | None = Field(
        default=None, description=f"percolation, connected and trapped volume, clusters, pockets: {_WHEN}"
    )
    constriction: States | None = Field(default=None, description=f"critical gap and its position, x and y: {_WHEN}")
    transmissivity: States | None = Field(default=None, description=f"flow of div(g^3 grad P) = 0, x and y: {_WHEN}")
    diffusivity: States | None = Field(default=None, description=f"flow of div(g grad P) = 0, x and y: {_WHEN}")
    cell_transmissivity: States | None = Field(
        default=None,
        description=f"flow of div(g^3 grad P) = 0 through the endless plane of a periodic surface: {_WHEN}",
    )
    estimates: States | None = Field(
        default=None, description=f"both coefficients by effective medium and by single junction: {_WHEN}"
    )
    flux_at: Selector | None = Field(default=None, description=f"flux of div(g^3 grad P) = 0 as fields: {_STATES}")

    @model_validator(mode="after")
    def _asks_for_something(self) -> Transport:
        if not self.named:
            refuse("must name at least one of {known}", known=", ".join(type(self).model_fields))
        return self


class Region(Strict):
    """A rectangle of the surface, as shares of its sides."""

    x: tuple[Fraction, Fraction] = Field(
        default=(0.0, 1.0), description="[from, to] along the first axis over its length, 0 <= from < to <= 1"
    )
    y: tuple[Fraction, Fraction] = Field(
        default=(0.0, 1.0), description="[from, to] along the second axis over its length, 0 <= from < to <= 1"
    )

    @field_validator("x", "y", mode="before")
    @classmethod
    def _two(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple) or len(value) != 2:
            refuse("must be two numbers, [from, to]")
        return tuple(value)

    @field_validator("x", "y")
    @classmethod
    def _rising(cls, value: tuple[float, float]) -> tuple[float, float]:
        if value[0] >= value[1]:
            refuse("must rise, from < to")
        return value

    @property
    def label(self) -> str:
        """Region in words, for datasets."""
        return "x/L_x {} to {}, y/L_y {} to {}".format(*map(number_text, (*self.x, *self.y)))


class RegionWidths(Strict):
    """A*, p*, V* and transmissivity inside central squares of several widths, from one solution."""

    shares: Many[AreaFraction] = Field(
        default=(1.0, 0.75, 0.5, 0.25),
        description="widths of the central squares over that of the surface, 0 to 1",
    )
    at: States = Field(default=EVERY_STEP, validate_default=True, description=f"states of A*, p* and V*: {_WHEN}")
    transmissivity: States | None = Field(default=None, description=f"states of the transmissivity, x and y: {_WHEN}")


class LeakRate(Strict):
    """Volume flow of an incompressible liquid through the gap: pressure drop, viscosity, unit."""

    pressure_drop: Annotated[Positive, In("pressure", needed=True)] = Field(
        description="pressure difference between two sides of the region, > 0, with its unit as 1 bar"
    )
    viscosity: Annotated[Positive, In("viscosity", needed=True)] = Field(
        description="dynamic viscosity, > 0, with its unit as 1 mPa*s"
    )
    unit: Annotated[str, UnitOf("flow")] = Field(default="mm^3/s", description="unit of the leak rate, as mm^3/s")

    @property
    def drive(self) -> float:
        """ΔP/μ times 1 m³, in the unit of the leak rate."""
        return convert(self.rate, "m^3/s", self.unit)

    @property
    def rate(self) -> float:
        """ΔP/μ [1/s]."""
        drop, viscosity = in_unit(self.pressure_drop, "Pa"), in_unit(self.viscosity, "Pa*s")
        assert drop is not None
        assert viscosity is not None
        return drop / viscosity


class Dimensional(Choice):
    """Quantities stored with a unit beside the starred value. They need no further solution."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1})

    pressure: Annotated[str, UnitOf("pressure")] | None = Field(
        default=None, description="store the nominal contact pressure p* E* Sq/L in this unit, as MPa"
    )
    free_volume: Annotated[str, UnitOf("volume per area")] | None = Field(
        default=None, description="store the free volume over the nominal area in this unit, as mm^3/m^2"
    )
    mean_gap: Annotated[str, UnitOf("length")] | None = Field(
        default=None, description="store the mean gap V* Sq in this unit, as um"
    )
    separation: Annotated[str, UnitOf("length")] | None = Field(
        default=None, description="store the separation d of the mean planes in this unit, as um"
    )
    critical_gap: Annotated[str, UnitOf("length")] | None = Field(
        default=None, description="store the critical gaps along x and y in this unit, as um"
    )
    leak_rate: LeakRate | None = Field(
        default=None, description="store the leak rates along x and y: {pressure_drop: 1 bar, viscosity: 1 mPa*s, unit}"
    )

    @model_validator(mode="after")
    def _asks_for_something(self) -> Dimensional:
        if not self.named:
            refuse("must name at least one of {known}", known=", ".join(type(self).model_fields))
        return self


INTERIOR = (("x", (0.25, 0.75)), ("y", (0.25, 0.75)))  # the central half of each side


class Record(Strict):
    """Quantities stored beside the numbers of every step."""

    heights: bool = Field(default=False, description="store the heights: true or false")
    residual_heights: bool = Field(
        default=False, description="store the heights left by plastic displacement, at the end: true or false"
    )
    fields_at: Selector | None = Field(default=None, description=f"gap and pressure as fields: {_STATES}")
    box_counting: BoxCounting | None = Field(default=None, description="box counting; {}: defaults")
    volume_density: VolumeDensity | None = Field(
        default=None, description="density of the element volumes; {}: defaults"
    )
    texture: Annotated[Texture | None, Switch()] = Field(
        default=None,
        description="texture before load and of the deformed surface (Sa, Ssk, Sku, Sp, Sv, Sz, Svi, Sbi, material "
        "ratio, structure function): true, false or {at: states}",
    )
    psd: Annotated[Psd | None, Switch()] = Field(
        default=None,
        description="power spectral density before load and of the deformed surface, root mean square height, slope "
        "and curvature by scale, and Nayak's parameter: true (before load), false or {at: states}",
    )
    transport: Transport | None = Field(
        default=None,
        description="quantities of the void, each with its states",
    )
    region: Annotated[Region, Word("interior", INTERIOR)] | None = Field(
        default=None,
        description="region of all observables but heights and fields: 'interior' (the central half of each side) or "
        "{x: [from, to], y: [from, to]}; default: the whole surface",
    )
    region_widths: RegionWidths | None = Field(
        default=None,
        description="A*, p*, V* and transmissivity of central squares of several widths; {}: defaults",
    )
    dimensional: Dimensional | None = Field(
        default=None, description="quantities stored with units too: pressure, free_volume, mean_gap, leak_rate …"
    )

    all_legs: bool = Field(
        default=False,
        description="true: levels are taken on every leg of a path, that of a further leg as 'pressure=0.5, leg 2'; "
        "false: on the first leg that reaches them",
    )

    @property
    def selects(self) -> dict[tuple[str, ...], Select]:
        """The states of each key that selects some."""
        found = {}
        for path in SELECTORS:
            here: Any = self
            for part in path:
                here = here and getattr(here, part)
            if isinstance(here, Select):
                found[path] = here
        return found

    def key(self, *, legs: bool) -> dict[str, Any]:
        """Return everything that changes a stored case, as plain data; later keys only where they are set."""
        record = self.model_dump(mode="json", exclude={"dimensional"})
        for name in ("residual_heights", "psd"):
            if not record[name]:
                del record[name]
        if self.psd is not None and self.region is not None:  # it was of the whole surface before
            record["psd"] = {"at": self.psd.at and record["psd"]["at"]}
        if not record["all_legs"] or not legs:
            del record["all_legs"]
        return record

    @property
    def has_units(self) -> bool:
        """Whether any level has a unit."""
        return any(unit_of(level.value) is not None for select in self.selects.values() for level in select.levels)

    def starred(self, of: Callable[[Level], Level]) -> Record:
        """Return the record with all levels as starred numbers."""
        record = self
        for (name, *inner), select in self.selects.items():
            new: Any = select.starred(of)
            if inner:
                new = getattr(record, name).model_copy(update={inner[0]: new})
            record = record.model_copy(update={name: new})
        return record


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the records that an annotation holds, in unions and behind ``Annotated``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _models(argument)


def _selectors() -> Iterator[tuple[str, ...]]:
    """Yield the path of every key of `Record` that selects states."""
    for name, annotation in get_type_hints(Record, include_extras=True).items():
        for model in _models(annotation):
            if issubclass(model, Select):
                yield (name,)
                continue
            for inner, hint in get_type_hints(model, include_extras=True).items():
                if any(issubclass(part, Select) for part in _models(hint)):
                    yield name, inner


SELECTORS = tuple(_selectors())
"""Paths of the keys of the section ``record`` that select states."""
