"""Height maps from the files of instruments, through the library SurfaceTopography (optional: roughvol[measured]).

Conventions: the first axis of the array is x of the file, and a missing height is NaN. Nodes are one pixel apart, so an
axis is one pixel shorter than all its pixels. The library recognises a format by its content. Two formats without any
mark (NMS, HGT) count only in files with this ending. HDF5 and MATLAB hold arrays of any meaning: of several, one is
named. MATLAB 7.3 stores an array in HDF5 with its axes in reverse order. Channels that are no heights by their kind,
unit or name are refused.

NMS has no unit of its pixels. The library takes the numbers for mm, the reader of surfalize for nm: 512 pixels of 312.5
are 160 m or 160 um. So the length of the axis is that of the study.
"""

from __future__ import annotations

import contextlib
import logging
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from roughvol.errors import SurfaceError
from roughvol.surfaces.files.description import (
    EXTRA,
    FEWEST,
    Description,
    HeightMap,
    NotRead,
    Request,
    array_name,
    length_unit,
    names_no_heights,
    position,
)
from roughvol.typing import Array

UNMARKED = ("nms", "hgt")
ARRAYS = ("h5", "mat")  # formats of arrays without meaning
UNSIZED = "nms"
HEIGHT = "height"  # kind of a channel
UNREAD = "in none of the formats that SurfaceTopography reads; save it as .x3p, or as text of points x y z"
PACKED = (".gz", ".bz2", ".xz", ".zip", ".7z")
SPREADSHEETS = (".xlsx", ".xls", ".ods")
TEXT = ("asc", "xyz")  # readers of text in the library
SILENT = logging.NullHandler()  # igor2, which tries every file, logs the bytes of files of other formats


def opened(request: Request) -> HeightMap:
    """Return the map in the file of an instrument."""
    path = request.path
    try:
        with warnings.catch_warnings(action="ignore"):  # the library warns that it runs without MPI
            from SurfaceTopography import open_topography
            from SurfaceTopography.Exceptions import CannotDetectFileFormat
    except ImportError as error:
        raise NotRead(f"is read through SurfaceTopography, which is not installed: {EXTRA}") from error
    ending = path.suffix.lower().removeprefix(".")
    logging.getLogger("igor2").addHandler(SILENT)
    with warnings.catch_warnings(action="ignore"):
        try:
            reader = request.files.enter_context(_recognised(open_topography, path, ending))
            if reader.format() in UNMARKED and ending != reader.format():
                raise CannotDetectFileFormat
        except CannotDetectFileFormat as error:
            raise NotRead(_unread(path.suffix.lower())) from error
        turned = reader.format() == "h5" and ending == "mat"  # MATLAB 7.3
        channel = _channel(reader, request.variable)
        description = _described(reader, channel, request.variable)
        if reader.format() == "h5":
            unit = _heights_unit(path, channel.name)
            description = description if request.ignore_header else replace(description, heights_unit=unit)
        if turned:
            description = replace(description, shape=description.shape[::-1])

    def heights() -> Array:
        # The library builds no map without a size. Any size does where the file gives none.
        size = None if channel.physical_sizes is not None else tuple(map(float, channel.nb_grid_pts))
        with warnings.catch_warnings(action="ignore"):
            values = channel.topography(physical_sizes=size).heights()
        known = np.ma.filled(np.ma.asarray(values, dtype=np.float64), np.nan)
        return known.T if turned else known

    return HeightMap(description, heights)


def _unread(ending: str) -> str:
    """Return the reason and the remedy of a file in no known format, by its ending."""
    if ending in PACKED:
        return "is packed; unpack it"
    return "is a spreadsheet; save its table as .csv" if ending in SPREADSHEETS else f"is damaged, or {UNREAD}"


def _recognised(open_topography: Any, path: Path, ending: str) -> Any:
    """Return the reader of a file. Files of an unmarked format may look like another one."""
    if ending in UNMARKED:
        with contextlib.suppress(Exception):
            return open_topography(str(path), format=ending)
    return open_topography(str(path))


def _channel(reader: Any, wanted: str | None) -> Any:
    """Return a channel of heights by name or number. Default: that of the format, or the first one."""
    channels = list(reader.channels)
    if reader.format() in ARRAYS:
        shapes = {data.name: tuple(data.nb_grid_pts or ()) for data in channels}
        wanted = array_name(wanted, shapes)
    maps = [data for data in channels if not _no_heights(data)]
    if wanted is None:
        default = reader.default_channel
        chosen = next((data for data in maps if data.index == default.index), maps[0] if maps else default)
    else:
        kinds = ((data, data.data_kind.value) for data in channels)
        named = ((data, "no heights" if kind == HEIGHT and data not in maps else kind) for data, kind in kinds)
        listing = ", ".join(f"{_label(data)} ({kind})" for data, kind in named)
        chosen = channels[position([data.name for data in channels], wanted, listing, "channel")]
    if reason := _no_heights(chosen):
        listing = ", ".join(map(_label, maps)) or "none"
        raise SurfaceError(f"{chosen.name} {reason}; channels of heights: {listing}")
    return chosen


def _label(data: Any) -> str:
    return f"{data.index}: {data.name}"


def _no_heights(data: Any) -> str:
    """Return why a channel is none of heights, empty if it may be one."""
    if data.data_kind.value != HEIGHT:
        return f"holds {data.data_kind.value}, not heights"
    if isinstance(data.unit, tuple):  # lateral and vertical unit: the library finds no heights in the second
        return "holds no heights: its unit is no length"
    return "holds no heights, by its name" if names_no_heights(data.name.rpartition("/")[2]) else ""


def _is_map(data: Any) -> bool:
    shape = data.nb_grid_pts or ()
    return data.dim == 2 and len(shape) == 2 and min(shape) >= FEWEST


def _described(reader: Any, channel: Any, wanted: str | None) -> Description:
    shape = tuple(channel.nb_grid_pts or ())
    if not _is_map(channel) or channel.is_uniform is False:
        raise SurfaceError(f"{channel.name} has nodes {shape}; allowed: a map of equidistant nodes, at least 3 x 3")
    unit = None if channel.unit is None else length_unit(channel.unit, channel.name)
    sides, unsized, sizes = None, "", channel.physical_sizes
    if sizes is not None:
        (x, y), (nx, ny) = (float(size) / n for size, n in zip(sizes, shape, strict=True)), shape
        sides = x * (nx - 1), y * (ny - 1)  # between the outer nodes
        if reader.format() == UNSIZED:
            would = f"in nm, L would be {1e-6 * sides[0]:.6g} um"
            unsized = f"its pixels are {1e-3 * x:.6g} by {1e-3 * y:.6g} of an unknown unit; {would}"
    notes: tuple[str, ...] = ()
    maps = [data for data in reader.channels if not _no_heights(data) and _is_map(data)]
    if wanted is None and len(maps) > 1:
        listing = ", ".join(map(_label, maps))
        notes = (f"holds {len(maps)} maps ({listing}); {channel.index} is read, variable names another",)
    return Description(
        (int(shape[0]), int(shape[1])),
        sides,
        None if unsized else unit,
        unit,
        channel.name,
        f"SurfaceTopography {reader.format()}",
        f"channel {channel.index}" if wanted is None and channel.index != reader.default_channel.index else None,
        "its header" if sides else "",
        bool(unsized),
        unsized,
        notes=notes,
    )


def _heights_unit(path: Path, name: str) -> str | None:
    """Return the unit of an array of HDF5 by its attribute, which the library passes over; refuse netCDF."""
    import h5py  # a requirement of SurfaceTopography

    with h5py.File(path) as stored:
        if "_NCProperties" in stored.attrs:  # a mark of netCDF 4
            raise SurfaceError("is a netCDF file: name it .nc, so that its axes, units and factors are read")
        attributes = stored[name].attrs
        key = next((key for key in ("units", "unit") if key in attributes), None)
        if key is None:
            return None
        values = np.ravel(attributes[key])  # an attribute may be an array of one text
        return length_unit(values[0] if values.size == 1 else attributes[key], f"{name}:{key}")
