"""Height maps in text: rows of heights with or without a header, points x y z, and ESRI ASCII grids.

Conventions: without labels, each line is a row of the array, as numpy.savetxt writes it. A header with the size along
the lines (Width, ncols) makes that axis x, and the array the transpose of the text. Points and ESRI grids have
coordinates: both axes ascend with the index.

The readers of SurfaceTopography skip every line that is not numbers: a row with ``***`` is lost. They take no decimal
commas, semicolons, ESRI headers or NODATA values.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from roughvol.errors import SurfaceError
from roughvol.surfaces.files import plain_text, points, text_header
from roughvol.surfaces.files.description import Description, HeightMap, names_no_heights
from roughvol.surfaces.files.text_header import REMEDY, Header, not_understood
from roughvol.typing import Array

INSIST = "surface.columns: heights takes all numbers as heights"
_EVEN = 1e-6  # largest relative difference of steps of a coordinate


def opened(path: Path, columns: str | None = None, *, ignore_header: bool = False) -> HeightMap:
    """Return the map in a text file."""
    text = plain_text.split(path)
    header = text_header.parse(path, text.header, ignore=ignore_header)
    for comment in text.comments:
        if text_header.parse(path, [comment], ignore=True) != Header():
            message = f"{path}: line {comment[0]} is a header among the numbers: {comment[1][:80]!r}; allowed: one map"
            raise SurfaceError(message)
    if names_no_heights(header.channel) and not ignore_header:
        message = f"{path}: the channel {header.channel!r} holds no heights, by its name; if it does: header: ignore"
        raise SurfaceError(message)
    if header.esri:
        return _esri(text, header)
    complete = header.size and header.unit and header.heights_unit and not header.factor
    if header.unclear is not None and not complete and not ignore_header:
        error = not_understood(path, header.unclear, REMEDY)
        # SurfaceTopography multiplies a width by the size of a pixel where a header gives both
        raise SurfaceError(str(error)) if header.size else error
    numbers = plain_text.table(text)
    if columns == "heights" or header.size:
        return _matrix(path, numbers, header)
    if header.points or numbers.shape[1] == 3:
        return _points(path, numbers[:, :3], header)
    _refuse_coordinates(path, numbers)
    return _matrix(path, numbers, header)


def _map(
    header: Header, heights: Array, sides: tuple[float, float] | None, reader: str, read_as: str, counted: bool = False
) -> HeightMap:
    shape = heights.shape[0], heights.shape[1]
    return HeightMap(
        Description(shape, sides, reader=reader, read_as=read_as, counted=counted, **header.described), lambda: heights
    )


def _matrix(path: Path, numbers: Array, header: Header) -> HeightMap:
    if not header.size:
        return _map(header, numbers, None, "text, rows", "rows")
    columns, lines = numbers.T.shape
    sides = None
    if len(header.size) == 2:
        sides = header.size["width"] / columns * (columns - 1), header.size["height"] / lines * (lines - 1)
    return _map(header, numbers.T, sides, "text with a header", "header")


def _points(path: Path, numbers: Array, header: Header) -> HeightMap:
    try:
        heights, sides, counted = points.grid(numbers)
    except SurfaceError as error:
        message = f"{path}: looks like x y z points, but they are no regular grid: {error}; {INSIST}"
        raise SurfaceError(message) from error
    header.source = header.source or "its coordinates"
    return _map(header, heights, sides, "text, points x y z", "points", counted=counted and header.unit is None)


def _refuse_coordinates(path: Path, numbers: Array) -> None:
    """Refuse tables that hold coordinates among the heights."""
    rows, columns = numbers.shape
    for table, nodes, kind in ((numbers, columns, "columns"), (numbers.T, rows, "lines")):
        if 3 <= nodes <= 6 and len(table) >= 9:
            try:
                points.grid(table[:, :3])
            except SurfaceError:
                continue
            message = (
                f"{path}: looks like x y z points: the first two of its {nodes} {kind} form a grid; "
                f"give columns x y z alone; {INSIST}"
            )
            raise SurfaceError(message)
    if min(rows, columns) < 4 or not (_even(numbers[0, 1:]) and _even(numbers[1:, 0])):
        return
    if not all(_even(row) for row in numbers[1:, 1:]):
        message = f"{path}: the first line and the first column look like coordinates: delete them and give L; {INSIST}"
        raise SurfaceError(message)


def _even(values: Array) -> bool:
    steps = np.diff(values)
    return bool(
        steps[0] != 0.0 and np.isfinite(steps).all() and np.abs(steps - steps[0]).max() <= _EVEN * abs(steps[0])
    )


def _esri(text: plain_text.Text, header: Header) -> HeightMap:
    path, given = text.path, header.esri
    if not {"ncols", "nrows"} <= given.keys():
        raise SurfaceError(f"{path}: the header gives {', '.join(given)}; needed: ncols and nrows")
    if header.unclear is not None:
        raise not_understood(path, header.unclear)
    if not all(given[name].is_integer() and given[name] > 0.0 for name in ("ncols", "nrows")):
        message = f"{path}: ncols {given['ncols']:g}, nrows {given['nrows']:g}; allowed: whole numbers above 0"
        raise SurfaceError(message)
    rows, columns = int(given["nrows"]), int(given["ncols"])
    heights = plain_text.words(text)  # the numbers of a row may run over several lines
    if heights.size != rows * columns:
        raise SurfaceError(f"{path}: holds {heights.size} heights; its header gives {rows} x {columns}")
    heights[heights == given.get("nodata_value", -9999.0)] = math.nan
    cell = given.get("cellsize")
    dx, dy = given.get("dx", cell), given.get("dy", cell)
    sides = None if dx is None or dy is None else (dx * (columns - 1), dy * (rows - 1))
    grid = heights.reshape(rows, columns)[::-1].T  # lines run from north to south
    return _map(header, grid, sides, "ESRI ASCII grid", "esri")
