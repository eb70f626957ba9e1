"""The section ``surface`` of surfaces that are made: by random midpoint displacement, or with a power-law spectrum.

The spectrum has a roll-off and a cut-off wavelength.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, model_serializer, model_validator

from roughvol.errors import nearest_word
from roughvol.study.sections.ensemble import AUTO_FROM, AUTO_TO
from roughvol.study.sections.strict import Strict, default, optional
from roughvol.study.values.types import WHOLE, Dimension, Many, ManyOrAuto, Positive, Refinement, Seed, refuse, whole
from roughvol.study.values.units import Length, LengthUnit, unit_of
from roughvol.surfaces.length_units import factor
from roughvol.surfaces.spectrum import Spectrum
from roughvol.typing import Sides

MAX_SEEDS = 10_000
UNIT = "unit of L, of the heights and of stored lengths; default: none"
SIDES = (
    "'free': nothing follows beyond the sides; 'mirrored': the mirror images of the surface; 'periodic': its next "
    "periods. Mirrored and periodic surfaces make an endless plane. A period has no repeated edge: L is δ times its "
    "nodes"
)
UNSAID = "unsaid"  # key of a context with the sides of a surface without the key
SPECTRAL = ("H", "n", "rolloff", "cut", "shortest", "slope", "Ssk", "anisotropy", "phases")  # keys of no other surface
FEWEST, MOST = 8, 8192  # nodes per side
STEEPEST = 3.0  # skewness
ROLLOFF_NODES = 8  # elements of λ_r on the first grid of `n: auto`: the power law has two octaves
CUT_NODES = 16  # elements of λ_s from which a mean that changes with n has no limit: the three below have all waves


def _count_in_schema(schema: dict[str, Any]) -> None:
    """Write the bounds of a number of seeds into a JSON schema."""
    schema["anyOf"][0] = {"type": "integer", "minimum": 1, "maximum": MAX_SEEDS}  # a number of seeds


def _counted(value: Any) -> Any:
    """Return the seeds 0 … n - 1 for a number n of seeds, other values unchanged."""
    value = whole(value)
    if not isinstance(value, int) or isinstance(value, bool):
        return value
    if not 1 <= value <= MAX_SEEDS:
        refuse("a number of seeds must be 1 to {most}", most=str(MAX_SEEDS))
    return tuple(range(value))


def _power_of_two(value: int) -> int:
    if value & (value - 1):
        refuse("must be a power of two, {low} to {high}", low=str(FEWEST), high=str(MOST))
    return value


Hurst = Annotated[float, Field(gt=0, lt=1)]
Nodes = Annotated[int, Field(ge=FEWEST, le=MOST), WHOLE, AfterValidator(_power_of_two)]


Seeds = Annotated[
    Many[Seed],
    BeforeValidator(_counted),
    Field(
        validate_default=True,
        json_schema_extra=_count_in_schema,
        description=f"number of seeds, 1 to {MAX_SEEDS} (10: seeds 0 to 9), or a list of seeds >= 0",
    ),
]


class Sized(Strict):
    """A surface with a length L, in a unit or none, and with sides."""

    if TYPE_CHECKING:  # fields, in the order of each section
        L: float | None
        unit: str | None
        sides: Sides

    @model_validator(mode="before")
    @classmethod
    def _unsaid(cls, data: Any, info: ValidationInfo) -> Any:
        """Give the sides of versions without the key to their studies."""
        return {**(info.context or {}).get(UNSAID, {}), **data} if isinstance(data, dict) else data

    @property
    def periodic(self) -> bool:
        """Whether the surface is one period of a plane."""
        return self.sides == "periodic"

    @property
    def length_unit(self) -> str | None:
        """Unit of all lengths; None for an arbitrary one."""
        return unit_of(self.L) or self.unit

    @property
    def has_length(self) -> bool:
        """Whether lengths have a unit; of a file that may have its own, true."""
        return self.length_unit is not None

    @property
    def is_isotropic(self) -> bool:
        """Whether the surfaces are made alike along x and y; not known of files."""
        return False

    def in_own_unit(self, length: float) -> float:
        """Return a length in the unit of L; a plain number is in that unit."""
        given = unit_of(length)
        if given is None or self.length_unit is None:
            return float(length)
        return float(length) * factor(given, self.length_unit)


class GeneratedSurface(Sized):
    """Surfaces by random midpoint displacement; every combination of D, m and seed is a case."""

    D: Many[Dimension] = Field(description="fractal dimension of the generated surface, 2 < D < 3; a number or a list")
    m: ManyOrAuto[Refinement] = Field(
        description="2^m + 1 nodes per side, 2^m of a period; 1 <= m <= 13; a number or a list; 'auto' for an ensemble"
    )
    L: Length = default(100.0, "lateral size, L > 0, as 100 or 100 um")
    seeds: Seeds = Field(default=10)  # type: ignore[arg-type]  # a number, see `_counted`
    midpoint_law: Literal["std", "variance"] = default(
        "std", "'std': each half step divides the standard deviation by 2^((3-D)/2); 'variance': the variance"
    )
    sides: Sides = default("free", SIDES)
    unit: LengthUnit | None = optional(UNIT)
    Sq: Length | None = optional("root mean square height, > 0, with its unit or in that of L; default: not scaled")

    @property
    def is_isotropic(self) -> bool:
        """True: x and y have the same displacements in the mean."""
        return True

    @property
    def height(self) -> float | None:
        """Sq of the scaled heights in the unit of L; None if they are not scaled."""
        return None if self.Sq is None else self.in_own_unit(self.Sq)

    @property
    def dimensions(self) -> tuple[float, ...]:
        """All D."""
        return self.D


class SpectralSurface(Sized):
    """Random surfaces with a power-law spectrum; every combination of H, n and seed is a case."""

    H: Many[Hurst] = default((), "Hurst exponent, 0 < H < 1; a number or a list")
    D: Many[Dimension] = default((), "fractal dimension instead of H, D = 3 - H, 2 < D < 3")
    n: ManyOrAuto[Nodes] = Field(
        description=f"nodes per side of the period, a power of two, {FEWEST} to {MOST}; n + 1 with the repeated edge "
        "of free and mirrored surfaces; a number or a list; 'auto' for an ensemble, with cut or shortest"
    )
    rolloff: float = Field(default=1.0, ge=1, description="L over the roll-off wavelength λ_r, >= 1; 1: no roll-off")
    cut: Annotated[float, Field(gt=1)] | None = optional(
        "L over the short cut-off wavelength λ_s, > rolloff, at most half the largest n; default: half the largest n"
    )
    shortest: Length | None = optional("λ_s instead of cut: a share of L as 0.01, or a length with its unit as 1 um")
    Sq: Length | None = optional("root mean square height of a period, > 0, with its unit or in that of L; default: 1")
    slope: Positive | None = optional("root mean square slope of the period instead of Sq, > 0")
    Ssk: Annotated[float, Field(ge=-STEEPEST, le=STEEPEST)] | None = optional(
        f"skewness of the heights, -{STEEPEST:g} to {STEEPEST:g}; default: Gaussian heights"
    )
    anisotropy: float = Field(default=1.0, ge=1, description="wavelengths along x over those along y, >= 1 and < cut")
    phases: Literal["gaussian", "random"] = default(
        "gaussian", "'gaussian': random amplitudes and phases; 'random': amplitudes as the spectrum, random phases"
    )
    L: Length = default(100.0, "length of the period, L > 0, as 100 or 100 um")
    seeds: Seeds = Field(default=10)  # type: ignore[arg-type]  # a number, see `_counted`
    unit: LengthUnit | None = optional(UNIT)
    sides: Sides = default("free", SIDES)

    @model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> dict[str, Any]:
        """Leave out the keys that were not given and have no default."""
        left_out = ("H", "D", "cut", "shortest", "Sq", "slope", "Ssk")
        written = handler(self).items()
        return {name: value for name, value in written if name not in left_out or value not in (None, (), [])}

    @property
    def is_isotropic(self) -> bool:
        """Whether wavelengths are alike along x and y."""
        return self.anisotropy == 1.0

    @property
    def dimensions(self) -> tuple[float, ...]:
        """All D, 3 - H."""
        return self.D or tuple(round(3.0 - H, 12) for H in self.H)  # the same surface by either name

    @property
    def m(self) -> tuple[int, ...]:
        """Levels, log2 n."""
        return tuple(n.bit_length() - 1 for n in self.n)

    @property
    def height(self) -> float | None:
        """None: the heights are made with their Sq and not scaled afterwards."""
        return None

    @property
    def shortest_ratio(self) -> float:
        """L over λ_s."""
        if self.cut is not None:
            return float(self.cut)
        if self.shortest is None:
            return max(self.n) / 2.0
        if unit_of(self.shortest) is None:
            return 1.0 / float(self.shortest)
        length = self.in_own_unit(self.shortest)
        return float(self.L) / length if length > 0.0 else math.inf  # too small for a float in the unit of L

    @property
    def spectrum(self) -> Spectrum:
        """The spectrum of all cases."""
        return Spectrum(
            rolloff=float(self.rolloff),
            cut=self.shortest_ratio,
            Sq=1.0 if self.Sq is None else self.in_own_unit(self.Sq),
            slope=self.slope,
            Ssk=self.Ssk,
            anisotropy=float(self.anisotropy),
            phases=self.phases,
            periodic=self.periodic,
        )


MadeSurface = GeneratedSurface | SpectralSurface
"""Surfaces that are made and not measured."""


def first_finest(surface: MadeSurface) -> int:
    """Return m or log2 n of the finest level with which an ensemble begins.

    Of 'auto': the smallest, with a spectrum the smallest whose elements show the power law.
    """
    if surface.m:
        return surface.m[0]
    if not isinstance(surface, SpectralSurface):
        return AUTO_FROM
    return min(max(AUTO_FROM, math.ceil(math.log2(ROLLOFF_NODES * surface.rolloff))), AUTO_TO)


def holds_all_waves(surface: MadeSurface, m: int) -> bool:
    """Return whether a level and the three below hold all waves, so that a limit would show.

    True of midpoint surfaces, which have no shortest wave.
    """
    return not isinstance(surface, SpectralSurface) or 2**m >= CUT_NODES * surface.shortest_ratio or m >= AUTO_TO


def tag_surface(value: Any) -> str:
    """Return the tag of the form of a section: of a spectrum, a file, or else of midpoint displacement."""
    if not isinstance(value, dict):
        forms = ((SpectralSurface, "<spectrum>"), (GeneratedSurface, "<generated>"))
        return next((tag for form, tag in forms if isinstance(value, form)), "<file>")
    if {"file", "files"} & value.keys():
        return "<file>"
    if not {"m", "midpoint_law"} & value.keys() and {*SPECTRAL} & value.keys():
        return "<spectrum>"
    hints = not {"D", "m"} & value.keys() and any(nearest_word(key, ["file", "variable"]) for key in value)
    return "<file>" if hints else "<generated>"
