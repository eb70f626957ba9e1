"""The section ``surface`` of measured heights: one file, or two for two rough bodies, and their treatment.

Sizes and units in a file are read when the cases are made, see `sections.agreement`.
"""

from __future__ import annotations

import importlib.util
import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import pydantic
from pydantic import Field

from roughvol.study.plain_data import is_file, printable
from roughvol.study.sections.strict import Strict, default, optional, refuse_at
from roughvol.study.sections.surface import SIDES, UNIT, Sized
from roughvol.study.values.types import AS_TUPLE, TWO, WHOLE, refuse
from roughvol.study.values.units import RISING, HeightsUnit, In, Length, LengthUnit
from roughvol.surfaces.body import Columns, Header, Levelling, Mirror, Missing, Resampling
from roughvol.typing import Sides

BARE_FORMATS = (".npy", ".npz")  # formats without size and unit
HEIGHT_FORMATS = (*BARE_FORMATS, ".nc", ".txt", ".csv", ".xyz", ".dat", ".asc", ".grd", ".gsf", ".tif", ".tiff")
MOST_FILES = 10_000  # of a pattern, as seeds
NO_FILE = "no such file ({path})"
ABSENT = "absent"  # key of a context in which files need not exist
EXTRA = "roughvol[measured]"  # adds the formats of instruments

_FILE = (
    f"height field, one of {' '.join('*' + suffix for suffix in HEIGHT_FORMATS)}, or with {EXTRA} a file of an "
    "instrument (*.al3d *.sur *.x3p *.gwy ...), relative to the study file"
)
_VARIABLE = "array (.npz, .nc, .h5, .mat), channel of an instrument file, or page of a TIFF: its name, or number from 0"
_HEIGHTS_UNIT = "unit of the heights, if the file has none, or the height of a count with its unit, as 0.95 nm"
_COLUMNS = "'heights': all columns of a text are heights, even three as of points x y z"
_HEADER = "'ignore': use L and heights_unit of the study instead of sizes and units in the file"


class Located(str):
    """Absolute path of a height file with its text in the study."""

    written: str

    def __new__(cls, path: str, written: str) -> Located:
        """Return the path with the text."""
        new = super().__new__(cls, path)
        new.written = written
        return new

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the text too."""
        return Located, (str(self), self.written)

    @property
    def portable(self) -> str:
        """Text in the study; for an absolute path, the name of the file."""
        return Path(self.written).name if Path(self.written).is_absolute() else self.written


def _located(value: str, info: pydantic.ValidationInfo) -> str:
    """Return the absolute path of an existing height file; of a stored study, the text."""
    context = info.context or {}
    if context.get("stored"):
        return Located(value, value)
    path = (context.get("folder", Path()) / value).absolute()
    if path.suffix.lower() not in HEIGHT_FORMATS and importlib.util.find_spec("SurfaceTopography") is None:
        refuse(f"must end in one of {' '.join(HEIGHT_FORMATS)}; for files of instruments: pip install '{EXTRA}'")
    if not is_file(path) and not context.get(ABSENT):
        refuse(NO_FILE, path=printable(str(path)))
    return Located(str(path), value)


def is_absent(error: Mapping[str, Any]) -> bool:
    """Return whether an error of pydantic is a file that does not exist."""
    return "path" in error.get("ctx", {}) and error["msg"] == NO_FILE.format(**error["ctx"])


def _matching(value: Any, info: pydantic.ValidationInfo) -> list[str]:
    """Return the files of a list, or those that a pattern matches, by name; relative to the study file."""
    if isinstance(value, list | tuple) and value:
        return list(value)
    if not isinstance(value, str):
        refuse_at(("files",), value, "must be a pattern or a list of files")
    folder, pattern = (info.context or {}).get("folder", Path()), Path(value)
    base, names = folder, value
    if pattern.is_absolute():  # which Path.glob does not take
        base, names = Path(pattern.anchor), str(pattern.relative_to(pattern.anchor))
    try:  # glob.iglob would go round a folder that links to itself
        matches = filter(is_file, base.glob(names) if Path(names).name else ())
        found = sorted(itertools.islice(matches, MOST_FILES + 1))
    except (ValueError, OSError) as error:
        refuse_at(("files",), value, "no pattern ({reason})", reason=str(error))
    if len(found) > MOST_FILES:
        refuse_at(("files",), value, "matches more than {most} files", most=str(MOST_FILES))
    if not found:
        refuse_at(("files",), value, "no file matches {pattern}", pattern=printable(str(folder / value)))
    return [str(path if pattern.is_absolute() else path.relative_to(folder)) for path in found]


def _path_text(value: str, info: pydantic.SerializationInfo) -> str:
    """Return the absolute path; for stored studies, the portable text."""
    stored = bool((info.context or {}).get("stored"))
    return value.portable if stored and isinstance(value, Located) else str(value)


HeightPath = Annotated[str, pydantic.PlainSerializer(_path_text), pydantic.AfterValidator(_located)]


def _number(value: Any) -> Any:
    """Return the number of a channel as text, other values unchanged."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) and value >= 0 else value


Variable = Annotated[
    str,
    pydantic.BeforeValidator(_number),
    pydantic.WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "integer", "minimum": 0}]}),
]
_FILES = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}


def _odd(value: int) -> int:
    if value % 2 == 0:
        refuse("must be odd: the node is in the middle")
    return value


Position = Annotated[float, Field(ge=0), In("length")]
Part = Annotated[tuple[Position, Position], TWO, RISING]


class Crop(Strict):
    """A rectangle of a measured map, as shares of its sides or lengths with a unit."""

    x: Part = default((0.0, 1.0), "part [from, to] of axis x: shares 0 <= from < to <= 1, or lengths [1 um, 3 um]")
    y: Part = default((0.0, 1.0), "part [from, to] of axis y: shares 0 <= from < to <= 1, or lengths [1 um, 3 um]")


class Outliers(Strict):
    """Single heights far from the median of their neighbourhood."""

    sigma: Annotated[float, Field(ge=3, le=1000)] = default(
        6.0, "distance from the local median in robust standard deviations of the map, 3 to 1000"
    )
    window: Annotated[int, Field(ge=3, le=101), WHOLE, pydantic.AfterValidator(_odd)] = default(
        5, "nodes a side of the neighbourhood, odd, 3 to 101"
    )


class CounterBody(Strict):
    """The second of two rough bodies, on the same lattice as the first."""

    file: HeightPath = Field(description=_FILE + "; heights positive out of its own body")
    variable: Variable | None = optional(_VARIABLE)
    heights_unit: HeightsUnit | None = optional(_HEIGHTS_UNIT + "; default: surface.heights_unit, then that of L")
    columns: Columns | None = optional(_COLUMNS)
    header: Header | None = optional(_HEADER)
    mirror: Mirror = default(
        "none",
        "'none': node [i, j] faces node [i, j] of the first; 'x' or 'y': this axis reversed, as of one of two scans "
        "from above, turned over",
    )


def _one_or_several(schema: dict[str, Any]) -> None:
    """Write into a JSON schema that files stand in place of file."""
    schema["required"].remove("file")
    schema["anyOf"] = [{"required": ["file"]}, {"required": ["files"]}]


class HeightFile(Sized):
    """A surface from a height file, or the sum of two that face each other."""

    model_config = pydantic.ConfigDict(json_schema_extra=_one_or_several)

    file: HeightPath = Field(description=f"{_FILE}; several: files")
    files: Annotated[tuple[HeightPath, ...], AS_TUPLE, pydantic.WithJsonSchema(_FILES)] = default(
        (), "instead of file: a pattern as scans/*.al3d, or a list, each file a case; all of one length and unit"
    )
    L: Length | None = optional(
        "length of the first axis, L > 0, with its unit or in that of the heights; default: size in the "
        "file, with which it must agree"
    )
    variable: Variable | None = optional(_VARIABLE)
    unit: LengthUnit | None = optional(f"{UNIT}, or that of the file; heights in other units are converted")
    heights_unit: HeightsUnit | None = optional(_HEIGHTS_UNIT + "; default: that of L")
    columns: Columns | None = optional(_COLUMNS)
    header: Header | None = optional(_HEADER)
    crop: Crop | None = optional("{x: [from, to], y: [from, to]}: part of the map to press; L is that of the whole map")
    outliers: Outliers | None = optional("{sigma, window}: remove single spikes; {}: 6 and 5 nodes")
    downsample: Annotated[int, Field(ge=1, le=1000), WHOLE] = default(1, "nodes a side of a block mean, 1 to 1000")
    resample: Resampling = default("none", "'none', or 'square': interpolate oblong pixels onto square ones")
    level: Levelling = default(
        "none", "least-squares surface subtracted from the known heights: 'none', 'mean', plane ('tilt') or 'quadratic'"
    )
    missing: Missing = default(
        "refuse", "missing heights: 'refuse', take the 'nearest' known one, or 'interpolate' by the mean of neighbours"
    )
    low_pass: Length | None = optional(
        "cut-off wavelength of a Gaussian low-pass filter (ISO 16610-61), with its unit or in that of L, "
        "from twice the spacing to the shorter side; default: no filter"
    )
    sides: Sides = default("mirrored", SIDES)
    against: CounterBody | None = optional("{file, variable, mirror}: second of two rough bodies; heights are added")
    _unitless: bool = pydantic.PrivateAttr(default=False)

    @pydantic.model_validator(mode="before")
    @classmethod
    def _found(cls, data: Any, info: pydantic.ValidationInfo) -> Any:
        """Give the first of several files as the file."""
        if not isinstance(data, dict) or data.get("files") is None:
            return data
        files = _matching(data["files"], info)
        if "file" in data:
            refuse("'files' excludes 'file': give one of them")
        return {**data, "file": files[0], "files": files}

    @pydantic.field_validator("files")
    @classmethod
    def _of_several_names(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        names = [Path(file).name for file in value]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            refuse("two files have one name, and cases are labelled by it: {names}", names=", ".join(twice))
        return value

    @pydantic.model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> Any:
        """Write either the one file or all of several."""
        data = handler(self)
        del data["file" if self.files else "files"]
        return data

    @property
    def each(self) -> tuple[HeightFile, ...]:
        """The section for each of its files."""
        if not self.files:
            return (self,)
        return tuple(self.model_copy(update={"file": file, "files": ()}) for file in self.files)

    @property
    def may_have_units(self) -> bool:
        """Whether the files are of formats with size and unit."""
        return bool(self.files) or any(Path(body.file).suffix.lower() not in BARE_FORMATS for body in self.bodies)

    @property
    def has_length(self) -> bool:
        """Whether lengths have a unit, or may have that of a file."""
        return self.length_unit is not None or (self.may_have_units and not self._unitless)

    def unitless(self) -> HeightFile:
        """Return the same section, of files that are known to have no unit."""
        known = self.model_copy()
        known._unitless = True
        return known

    @property
    def bodies(self) -> tuple[HeightFile | CounterBody, ...]:
        """One body or two."""
        return (self,) if self.against is None else (self, self.against)
