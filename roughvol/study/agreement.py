"""Measured heights with nothing left open: what the files give (size, units) beside what the study gives.

Where both give a length or a unit, they must agree. All lengths are stored in the unit of the study, else in that of
the first file that names one; heights in another unit are converted when they are read.
"""

from __future__ import annotations

import functools
import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from roughvol.errors import DatasetError, Problem, StudyError, SurfaceError
from roughvol.study.height_file import BARE_FORMATS, CounterBody, HeightFile
from roughvol.study.treatment import File, settled
from roughvol.study.yaml_text import number_text
from roughvol.surfaces.body import Body, Treatment
from roughvol.surfaces.length_units import METRES, factor

if TYPE_CHECKING:
    from roughvol.surfaces.files.description import Description

SAME = 1e-3  # by which lengths that the study and the files give may differ
LONGEST, FINEST = 0.1, 1e-11  # metres: beyond, a width or a spacing is no roughness scan


@dataclass(frozen=True)
class Measured:
    """Measured heights with nothing left open.

    Attributes
    ----------
    L : float
        Length of the first axis that is pressed: that of the file, or of what a crop and a new lattice leave of it.
    unit : str or None
        Unit of all lengths.
    bodies : tuple of Body
        The one or the two, with the units of their heights.
    treatment : Treatment
        What is done to each.
    sides : (float, float) or None
        Lengths of both axes of the whole map as the first file gives them, in the unit of all lengths; None if it
        gives none.
    notes : tuple of str
        What the user should look at.
    """

    L: float
    unit: str | None
    bodies: tuple[Body, ...]
    treatment: Treatment
    sides: tuple[float, float] | None = None
    notes: tuple[str, ...] = ()


_KEYS = ("surface", "surface.against")


def resolve(surface: HeightFile) -> Measured:
    """Return the section with what its files give filled in.

    Raises
    ------
    StudyError
        If a file cannot be read or described, if a length or a unit is missing, or if the files and the study do not
        agree.
    """
    told, bodies = [], []
    for key, asked in zip(_KEYS, surface.bodies, strict=False):
        sha256 = _digest(Path(asked.file), f"{key}.file")
        told.append(_described(asked, sha256, key))
        bodies.append(_body(surface, asked, sha256, told[-1], key))
    unit = _unit(surface, told, bodies)
    sides = [_sides(surface.L, one, unit) for one in told]
    L = surface.L if surface.L is not None else next((side[0] for side in sides if side), None)
    if L is None:
        _wrong(f"missing: {surface.file} does not give the length of its first axis", "surface.L")
    if surface.L is not None:
        for one, body, side in zip(told, bodies, sides, strict=True):
            _agrees(surface.L, unit, one, body, side)
    first, other = sides[0], sides[-1]
    if first and other and any(abs(a - b) > SAME * a for a, b in zip(first, other, strict=True)):
        said = " and ".join(" x ".join(f"{side:.6g}" for side in pair) for pair in (first, other))
        _wrong(f"the files differ in size, {said} {unit or ''}".rstrip(), "surface.against.file")

    def shape(place: int) -> tuple[int, int]:
        given = told[place]
        return given.shape if given else _shape(bodies[place], _KEYS[place])

    notes = _notes(float(L), unit, told)
    files = [File(body.file, one.sides if one else None) for body, one in zip(bodies, told, strict=True)]
    treatment, left, ratios = settled(surface, files, shape, float(L), unit)
    bodies = [replace(body, pixel_ratio=ratio) for body, ratio in zip(bodies, ratios, strict=True)]
    return Measured(left, unit, tuple(bodies), treatment, first, notes)


def _body(surface: HeightFile, body: HeightFile | CounterBody, sha256: str, told: Description | None, key: str) -> Body:
    """Return a body with the unit of its heights, as the file names it or else the study."""
    path = Path(body.file)
    given = body.heights_unit or surface.heights_unit
    own = told.heights_unit if told else None
    if own and body.heights_unit and own != body.heights_unit:
        _wrong(f"is {body.heights_unit}, but {path} has heights in {own}", f"{key}.heights_unit")
    if told and told.unit and not own and not given:
        _wrong(
            f"missing: {path} names {told.unit} for its coordinates, and no unit of its heights", f"{key}.heights_unit"
        )
    return Body(
        path,
        sha256,
        body.variable,
        own,
        body.mirror if isinstance(body, CounterBody) else "none",
        None if own else given,
        body.columns,
        body.header,
        told.read_as if told else None,
    )


def _unit(surface: HeightFile, told: list[Description | None], bodies: list[Body]) -> str | None:
    """Return the unit of all lengths: that of the study, else the first that a file names."""
    if surface.length_unit:
        return surface.length_unit
    unit = next((one.unit for one in told if one and one.unit), None)
    named = next((body for body in bodies if body.numbers_in), None)
    unknown = next((body for body in bodies if body.numbers_in is None), None)
    if named and unknown:
        _wrong(
            f"missing: {unknown.file} does not give its unit, the other file is in {named.numbers_in}", "surface.unit"
        )
    if named and unit is None and surface.L is not None:
        _wrong(
            f"has no unit, and the heights of {named.file.name} are in {named.numbers_in}: give L with its unit, as "
            "L: 100 um",
            "surface.L",
        )
    if named and unit is None and any(one and one.sides for one in told):
        _wrong(
            f"missing: {named.file} names no unit of its coordinates, heights are in {named.numbers_in}", "surface.unit"
        )
    return unit


def _sides(L: float | None, told: Description | None, unit: str | None) -> tuple[float, float] | None:
    """Return the lengths of both axes in the unit of all lengths."""
    if told is None or told.sides is None:
        return None
    scale = factor(told.unit, unit) if told.unit and unit else 1.0
    if told.counted and L is not None:
        scale = L / told.sides[0]
    return told.sides[0] * scale, told.sides[1] * scale


def _agrees(
    L: float, unit: str | None, told: Description | None, body: Body, sides: tuple[float, float] | None
) -> None:
    """Refuse a length that is not that of the file."""
    if told is None or sides is None or abs(L - sides[0]) <= SAME * sides[0]:
        return
    own = f"{told.sides[0] if told.sides else sides[0]:.6g} {told.unit or unit or ''}".rstrip()
    message = f"is {number_text(float(L))} {unit or ''}".rstrip() + f", but {body.file} gives {own} ({told.source})"
    nodes = told.shape[0]
    if abs(L - sides[0] * nodes / (nodes - 1)) <= SAME * L:
        message += f": L is the length between the outer of its {nodes} nodes, {nodes - 1} pixels"
    _wrong(f"{message}; leave L out, or header: ignore if the file is wrong", "surface.L")


def _notes(L: float, unit: str | None, told: list[Description | None]) -> tuple[str, ...]:
    notes = [note for one in told if one for note in one.notes]
    if any(one and one.counted for one in told):
        notes.append("the coordinates in the file count nodes, and no unit is named for them: is L right?")
    shape = next((one.shape for one in told if one), None)
    if unit and L * METRES[unit] > LONGEST:
        notes.append(
            f"L = {L:.6g} {unit} is longer than {LONGEST:g} m, too long for a scan of roughness: is the unit right?"
        )
    if unit and shape and L / (shape[0] - 1) * METRES[unit] < FINEST:
        notes.append(f"the spacing is {L / (shape[0] - 1):.3g} {unit}, less than an atom: is the unit right?")
    return tuple(notes)


def _digest(path: Path, key: str) -> str:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        _wrong(f"cannot read {path}: {error.strerror}", key)


def _described(body: HeightFile | CounterBody, sha256: str, key: str) -> Description | None:
    """Return what counts of what a file gives; None if it gives nothing beside its heights."""
    path = Path(body.file)
    if path.suffix.lower() in BARE_FORMATS:  # nothing, and numpy need not be imported to know it
        return None
    try:
        found = _asked(path, sha256, body.variable, body.columns, body.header == "ignore")
    except (DatasetError, SurfaceError) as error:
        _wrong(str(error), f"{key}.file")
    return replace(found, sides=None, unit=None, heights_unit=None) if body.header == "ignore" else found


def _shape(body: Body, key: str) -> tuple[int, int]:
    """Return the nodes of a file that gives nothing beside its heights."""
    try:
        return _asked(body.file, body.sha256, body.variable, body.columns, ignore_header=True).shape
    except (DatasetError, SurfaceError) as error:
        _wrong(str(error), f"{key}.file")


@functools.lru_cache(maxsize=64)
def _asked(path: Path, sha256: str, variable: str | None, columns: str | None, ignore_header: bool) -> Description:
    """Return what a file gives; asked again of the same content, without opening it."""
    from roughvol.surfaces.files import reading

    return reading.describe(path, variable, columns=columns, ignore_header=ignore_header)


def _wrong(message: str, key: str) -> NoReturn:
    raise StudyError([Problem(message, key)])
