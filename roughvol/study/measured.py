"""The section ``surface`` of a study of measured heights: one file, or two for two rough bodies, and their treatment.

What a file tells about itself (size, unit) is read when the cases are made, not before. The length of the study counts
if it is given, else that of the first file; the unit likewise, and numbers of a file with a unit are converted to it.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

from pydantic import Field, SerializationInfo, ValidationInfo, field_serializer, field_validator, model_serializer

from roughvol.errors import DatasetError, Problem, StudyError, SurfaceError
from roughvol.lengths import factor
from roughvol.study.quantities import Length, unit_of
from roughvol.study.settings import UNIT, LengthUnit, Strict, refuse, without_unused
from roughvol.study.yamltext import number_text, printable

if TYPE_CHECKING:
    from roughvol.heightfile import Description

HEIGHT_FORMATS = (".npy", ".npz", ".txt", ".csv", ".asc", ".nc")
EXTRA = "roughvol[measured]"  # with it, the formats of instruments

SAME = 1e-4  # by which the lengths that two files tell may differ and count as one

Levelling = Literal["none", "mean", "tilt", "quadratic"]
Missing = Literal["refuse", "nearest", "interpolate"]
Mirror = Literal["none", "x", "y"]

_FILE = (
    f"height field, one of {' '.join('*' + ending for ending in HEIGHT_FORMATS)}, or with {EXTRA} a file of an "
    "instrument (*.al3d *.sur *.x3p *.gwy ...), relative to the study file"
)
_VARIABLE = "name of the array inside an .npz or .nc file, or of the channel in a file of an instrument"


@dataclass(frozen=True)
class Body:
    """One rough body: its file, the sha256 of its content, and how its numbers are to be read.

    ``unit`` is that of the numbers, where the file tells it; ``mirror`` the axis that is reversed.
    """

    file: Path
    sha256: str
    variable: str | None = None
    unit: str | None = None
    mirror: Mirror = "none"


@dataclass(frozen=True)
class Treatment:
    """What is done to each body alike, in this order: levelled, missing heights filled, short waves filtered off."""

    level: Levelling = "none"
    missing: Missing = "refuse"
    low_pass: float | None = None

    @property
    def used(self) -> dict[str, Any]:
        """What is not left as it is."""
        return {name: value for name, value in vars(self).items() if value != getattr(UNTREATED, name)}

    def sentence(self, unit: str | None) -> str:
        """Return what is done, in words, for the file that holds the results; lengths in the unit of the study."""
        done = []
        if self.level != "none":
            done.append(f"least-squares {self.level} of the known heights taken off")
        if self.missing != "refuse":
            filling = {"nearest": "the nearest known one", "interpolate": "the mean of their neighbours"}[self.missing]
            done.append(f"missing heights filled with {filling}")
        if self.low_pass is not None:
            cut_off = f"{number_text(self.low_pass)} {unit or ''}".rstrip()
            done.append(
                f"waves shorter than {cut_off} taken off by the Gaussian filter of ISO 16610-61, "
                "its weights renormalised at the edges"
            )
        return "; ".join(done)


UNTREATED = Treatment()


class Located(str):
    """The absolute path of a height file, which keeps the text that the study names it by."""

    written: str

    def __new__(cls, path: str, written: str) -> Located:
        """Return the path with the text."""
        new = super().__new__(cls, path)
        new.written = written
        return new

    def __reduce__(self) -> tuple[Any, ...]:
        """Survive pickling."""
        return Located, (str(self), self.written)

    @property
    def portable(self) -> str:
        """The text, or the name of the file where the text is an absolute path."""
        return Path(self.written).name if Path(self.written).is_absolute() else self.written


def _found(value: str, info: ValidationInfo) -> str:
    """Return the absolute path of a height file that is there; of a stored study, the text."""
    context = info.context or {}
    if context.get("stored"):
        return Located(value, value)
    path = (context.get("folder", Path()) / value).absolute()
    if path.suffix.lower() not in HEIGHT_FORMATS and importlib.util.find_spec("SurfaceTopography") is None:
        refuse(
            "must end in one of {known}; for files of instruments: pip install '{extra}'",
            known=" ".join(HEIGHT_FORMATS),
            extra=EXTRA,
        )
    try:
        found = path.is_file()
    except (OSError, ValueError):  # a name too long, a folder that may not be entered
        found = False
    if not found:
        refuse("there is no such file ({path})", path=printable(str(path)))
    return Located(str(path), getattr(value, "written", value))


def _path_text(value: str, info: SerializationInfo) -> str:
    """Return the absolute path; in what is stored, no folder of this machine."""
    stored = bool((info.context or {}).get("stored"))
    return value.portable if stored and isinstance(value, Located) else str(value)


class CounterBody(Strict):
    """The second of two rough bodies, on the same lattice as the first."""

    file: str = Field(description=_FILE + "; heights positive out of its own body")
    variable: str | None = Field(default=None, description=_VARIABLE)
    mirror: Mirror = Field(
        default="none",
        description="'none': its node [i, j] faces node [i, j] of the first; 'x' or 'y': its first or second axis is "
        "reversed, as for two scans that each look onto their own surface, one body then turned over",
    )

    _file = field_validator("file")(_found)
    _text = field_serializer("file")(_path_text)


class HeightFile(Strict):
    """One surface read from a file of heights, square or not, or the sum of two that face each other."""

    file: str = Field(description=_FILE)
    L: Length | None = Field(
        default=None,
        description="length of the first axis, L > 0, in the unit of the heights; may be left out if the file tells "
        "its size, and counts instead of that if given",
    )
    variable: str | None = Field(default=None, description=_VARIABLE)
    unit: LengthUnit | None = Field(
        default=None, description=f"{UNIT}; heights of a file that tells its own unit are converted"
    )
    level: Levelling = Field(
        default="none",
        description="least-squares surface of the known heights that is taken off: 'none', their 'mean', a plane "
        "('tilt') or a 'quadratic'",
    )
    missing: Missing = Field(
        default="refuse",
        description="what becomes of missing heights: 'refuse' the file, take the 'nearest' known one, or 'interpolate'"
        " (each the mean of its neighbours)",
    )
    low_pass: Length | None = Field(
        default=None,
        description="cut-off wavelength of a Gaussian filter (ISO 16610-61) that takes off shorter ones, in the unit "
        "of L, from twice the spacing to the shorter side",
    )
    against: CounterBody | None = Field(
        default=None,
        description="{file, variable, mirror}: the other of two rough bodies; the heights are added",
    )

    _file = field_validator("file")(_found)
    _text = field_serializer("file")(_path_text)

    @property
    def length_unit(self) -> str | None:
        """Unit of L, of the heights and of all lengths stored, if the study names one."""
        return unit_of(self.L) or self.unit

    @property
    def bodies(self) -> tuple[HeightFile | CounterBody, ...]:
        """The one body or the two."""
        return (self,) if self.against is None else (self, self.against)

    @model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> dict[str, Any]:
        """Leave out what came later where it is not used."""
        data = without_unused(handler(self), "L", "unit", "against")
        return {name: value for name, value in data.items() if value != getattr(UNTREATED, name, object)}


@dataclass(frozen=True)
class Measured:
    """Measured heights with nothing left open: length of the first axis, unit of all lengths, bodies, treatment."""

    L: float
    unit: str | None
    bodies: tuple[Body, ...]
    treatment: Treatment


def resolve(surface: HeightFile) -> Measured:
    """Return the section with what its files tell filled in.

    Raises
    ------
    StudyError
        If a file cannot be read or described, if nobody tells a length or which unit the numbers have, or if two files
        do not fit.
    """
    keys = ("surface.file", "surface.against.file")
    bodies, told = [], []
    for key, body in zip(keys, surface.bodies, strict=False):
        path = Path(body.file)
        sha256 = _digest(path, key)
        try:
            description = _described(path, sha256, body.variable)
        except (DatasetError, SurfaceError) as error:
            _wrong(str(error), key)
        told.append(description)
        mirror = body.mirror if isinstance(body, CounterBody) else "none"
        bodies.append(Body(path, sha256, body.variable, description.unit if description else None, mirror))
    unit = surface.length_unit or next((body.unit for body in bodies if body.unit), None)
    unknown = [body.file for body in bodies if body.unit is None]
    if unit and not surface.length_unit and unknown:
        _wrong(f"missing: {unknown[0]} does not tell its unit, the other file is in {unit}", "surface.unit")
    sides = [
        one.side * (factor(one.unit, unit) if one.unit and unit else 1.0) if one and one.side else None for one in told
    ]
    L = next((side for side in (surface.L, *sides) if side is not None), None)
    if L is None:
        _wrong(f"missing: {surface.file} does not tell the length of its first axis", "surface.L")
    if surface.L is None and any(side and abs(side - L) > SAME * L for side in sides):
        _wrong(f"the files differ in length, {' and '.join(map(str, sides))}: give L to overrule them", keys[1])
    low_pass, own = surface.low_pass, unit_of(surface.low_pass)
    if low_pass is not None and own is not None:
        if unit is None:
            _wrong(f"has a unit ({low_pass}) and L has none: give both with theirs, as L: 100 um", "surface.low_pass")
        low_pass = float(low_pass) * factor(own, unit)
    treatment = Treatment(surface.level, surface.missing, None if low_pass is None else float(low_pass))
    return Measured(float(L), unit, tuple(bodies), treatment)


def _digest(path: Path, key: str) -> str:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        _wrong(f"cannot read {path}: {error.strerror}", key)


@functools.lru_cache(maxsize=64)
def _described(path: Path, sha256: str, variable: str | None) -> Description | None:
    """Return what a file tells about itself; asked again of the same content, without opening it."""
    if path.suffix.lower() in HEIGHT_FORMATS:  # nothing, and numpy need not be imported to know it
        return None
    from roughvol import heightfile

    return heightfile.describe(path, variable)


def _wrong(message: str, key: str) -> NoReturn:
    raise StudyError([Problem(message, key)])
