"""Sizes and units of measured heights, from the study and its files.

Where both give a length or a unit, they must agree. All lengths are stored in the unit of the study. Default:
the unit of the first file with one. Heights in another unit are converted on reading.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from roughvol.errors import DatasetError, SurfaceError
from roughvol.study.plain_data import number_text
from roughvol.study.python_data import refused
from roughvol.study.sections.height_file import CounterBody, HeightFile
from roughvol.study.sections.treatment import settled
from roughvol.surfaces.body import Body, Treatment, digest
from roughvol.surfaces.length_units import METRES, factor

if TYPE_CHECKING:
    from roughvol.surfaces.files.description import Description

SAME = 1e-3  # allowed relative difference between lengths of study and file, and of several files
LONGEST, FINEST = 0.1, 1e-11  # m; largest width and smallest spacing of a roughness scan


@dataclass(frozen=True)
class Measured:
    """Measured heights with size, units and treatment resolved, and doubts for the user.

    ``L`` is the length of the first axis as pressed, after crop and resampling; ``length_unit`` is that of all lengths.
    ``nodes`` are those of the heights as pressed, along x and y.
    """

    L: float
    nodes: tuple[int, int]
    length_unit: str | None
    bodies: tuple[Body, ...]
    treatment: Treatment
    notes: tuple[str, ...] = ()


_KEYS = ("surface", "surface.against")


def resolve(surface: HeightFile) -> Measured:
    """Return the section completed by its files; refuse files that disagree with it or lack a length or a unit."""
    descriptions, bodies = [], []
    for key, section in zip(_KEYS, surface.bodies, strict=False):
        sha256 = _digest(Path(section.file), f"{key}.file")
        description = _described(section, sha256, key)
        if surface.L is None and description.unsized:
            silent = f"{section.file} does not give the length of its axes"
            raise refused(f"missing: {silent}: {description.unsized}", "surface.L")
        descriptions.append(description)
        bodies.append(_body(surface, section, sha256, description, key))
    unit = _unit(surface, descriptions, bodies)
    sides = [_sides(surface, description, unit) for description in descriptions]
    L = surface.L if surface.L is not None else next((side[0] for side in sides if side), None)
    if L is None:
        raise refused(f"missing: {surface.file} does not give the length of its first axis", "surface.L")
    for description, body, side in zip(descriptions, bodies, sides, strict=True):
        if side and surface.L is not None:
            _agrees(surface.L, unit, description, body.file, side[0], surface.periodic)
    first, other = sides[0], sides[-1]
    if first and other and any(abs(a - b) > SAME * a for a, b in zip(first, other, strict=True)):
        sizes = " and ".join(" x ".join(f"{side:.6g}" for side in pair) for pair in (first, other))
        raise refused(f"the files differ in size, {sizes} {unit or ''}".rstrip(), "surface.against.file")
    notes = _notes(float(L), unit, descriptions, bodies, given=surface.L)
    treatment, left, nodes, ratios = settled(surface, descriptions, float(L), unit)
    bodies = [replace(body, pixel_ratio=ratio) for body, ratio in zip(bodies, ratios, strict=True)]
    return Measured(left, nodes, unit, tuple(bodies), treatment, notes)


def _body(surface: HeightFile, body: HeightFile | CounterBody, sha256: str, description: Description, key: str) -> Body:
    """Return a body with the unit of its heights, from the file or else from the study."""
    path = Path(body.file)
    given = body.heights_unit or surface.heights_unit
    own = description.heights_unit
    if own and body.heights_unit and own != body.heights_unit:
        raise refused(f"is {body.heights_unit}, but {path} has heights in {own}", f"{key}.heights_unit")
    if description.unit and not own and not given:
        given_in = f"{path} has coordinates in {description.unit}"
        raise refused(f"missing: {given_in}, and no unit of its heights", f"{key}.heights_unit")
    mirror = body.mirror if isinstance(body, CounterBody) else "none"
    read_as = description.read_as
    return Body(path, sha256, body.variable, own, mirror, None if own else given, body.columns, body.header, read_as)


def _unit(surface: HeightFile, descriptions: list[Description], bodies: list[Body]) -> str | None:
    """Return the unit of all lengths: that of the study, else the first in the files."""
    if surface.length_unit:
        return surface.length_unit
    unit = next((text.unit for text in descriptions if text.unit), None)
    named = next((body for body in bodies if body.numbers_in), None)
    unknown = next((body for body in bodies if body.numbers_in is None), None)
    heights = f"the heights of {named.file.name} are in {named.numbers_in}" if named else ""
    if named and unknown:
        raise refused(f"missing: {heights}, and {unknown.file} does not give its unit", "surface.unit")
    if named and unit is None and surface.L is not None:
        raise refused(f"has no unit, and {heights}: add the unit, as L: 100 um", "surface.L")
    if named and unit is None and any(text.sides for text in descriptions):
        raise refused(f"missing: {heights}, and its coordinates have no unit", "surface.unit")
    return unit


def _sides(surface: HeightFile, description: Description, unit: str | None) -> tuple[float, float] | None:
    """Return the lengths of both axes in the unit of all lengths. A period is one pixel longer than its nodes."""
    if description.sides is None:
        return None
    x, y = description.sides
    if surface.periodic:
        x, y = (side * nodes / (nodes - 1) for side, nodes in zip((x, y), description.shape, strict=True))
    scale = factor(description.unit, unit) if description.unit and unit else 1.0
    if description.counted and surface.L is not None:
        scale = surface.L / x
    return x * scale, y * scale


def _agrees(L: float, unit: str | None, description: Description, file: Path, side: float, periodic: bool) -> None:
    """Refuse an L that differs from the length of the first axis in the file."""
    if description.sides is None or abs(L - side) <= SAME * side:
        return
    own = f"{description.sides[0]:.6g} {description.unit or unit or ''}".rstrip()
    given = f"{number_text(float(L))} {unit or ''}".rstrip()
    message = f"is {given}, but {file} gives {own} ({description.source})"
    nodes = description.shape[0]
    if periodic:
        message += f" between its outer nodes, so a period of {number_text(float(f'{side:.6g}'))}"
    elif abs(L - side * nodes / (nodes - 1)) <= SAME * L:
        message += f": L is the length between the outer of its {nodes} nodes, {nodes - 1} pixels"
    raise refused(f"{message}; omit L, or give header: ignore if the file is wrong", "surface.L")


def _notes(
    L: float, unit: str | None, descriptions: list[Description], bodies: list[Body], *, given: float | None
) -> tuple[str, ...]:
    notes = [note for text in descriptions for note in text.notes]
    for text, body in zip(descriptions, bodies, strict=True):
        if text.counts and body.numbers_in is None:
            taken = f"heights in {unit}" if unit else "heights"
            advice = "heights_unit: 0.95 nm would be the height of a count"
            notes.append(f"{body.file.name} holds counts, taken as {taken}; {advice}")
    counted = [text.sides[0] for text in descriptions if text.counted and not text.unsized and text.sides]
    if any(given is None or abs(given - side) > SAME * side for side in counted):
        notes.append("the coordinates in the file count nodes and have no unit: is L right?")
    spacing = L / (descriptions[0].shape[0] - 1)
    if unit and L * METRES[unit] > LONGEST:
        doubt = f"longer than {LONGEST:g} m, too long for a scan of roughness: is the unit right?"
        notes.append(f"L = {L:.6g} {unit} is {doubt}")
    if unit and spacing * METRES[unit] < FINEST:
        notes.append(f"the spacing is {spacing:.3g} {unit}, less than an atom: is the unit right?")
    return tuple(notes)


def _digest(path: Path, key: str) -> str:
    try:
        return digest(path)
    except OSError as error:
        raise refused(f"cannot read {path}: {error.strerror}", key) from error


def _described(body: HeightFile | CounterBody, sha256: str, key: str) -> Description:
    """Return nodes, size and units of a file, without the size and units that the study ignores."""
    ignored = body.header == "ignore"
    try:
        description = _description(Path(body.file), sha256, body.variable, body.columns, ignored)
    except (DatasetError, SurfaceError) as error:
        several = isinstance(body, HeightFile) and body.files
        raise refused(str(error), f"{key}.files" if several else f"{key}.file") from error
    return replace(description, sides=None, unit=None, heights_unit=None) if ignored else description


@functools.lru_cache(maxsize=64)
def _description(path: Path, sha256: str, variable: str | None, columns: str | None, ignored: bool) -> Description:
    """Return size and units of a file; equal content is read once."""
    from roughvol.surfaces.files import reading

    return reading.describe(path, variable, columns=columns, ignore_header=ignored)
