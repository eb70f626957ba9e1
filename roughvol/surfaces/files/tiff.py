"""Height maps in TIFF: one grey value for each pixel, through the library tifffile (optional: roughvol[measured]).

Conventions: x is the axis along the lines of the image, so the array is its transpose. The size comes from the tags of
ImageJ, OME or GeoTIFF, or from a resolution per centimetre or inch. The resolutions of screens and printers do not
count. TIFF has no unit of grey values.
"""

from __future__ import annotations

import contextlib
import logging
import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.errors import DatasetError, SurfaceError
from roughvol.surfaces.files.description import EXTRA, Description, HeightMap, Request, length_unit

_PICTURES = (1, 72, 96, 100, 120, 144, 150, 200, 240, 300, 350, 360, 400, 600, 720, 1200, 2400)  # dots per inch
_INCH, _CENTIMETRE = 2, 3
_PIXEL_SCALE, _NODATA = 33550, 42113  # tags of GeoTIFF and GDAL


@contextlib.contextmanager
def damage() -> Iterator[dict[str, None]]:
    """Yield the damaged parts of a TIFF that tifffile finds in this thread, each once, in place of its log."""
    log, found, thread = logging.getLogger("tifffile"), dict[str, None](), logging.makeLogRecord({}).thread

    def of_another_thread(record: logging.LogRecord) -> bool:
        if record.thread == thread:
            found[" ".join(record.getMessage().split())[:200]] = None
        return record.thread != thread

    log.addFilter(of_another_thread)
    try:
        yield found
    finally:
        log.removeFilter(of_another_thread)


def opened(request: Request) -> HeightMap:
    """Return the map in a TIFF file."""
    variable = request.variable
    try:
        from tifffile import TiffFile
    except ImportError as error:
        raise DatasetError(f"is read through tifffile, which is not installed: {EXTRA}") from error
    stored = request.files.enter_context(TiffFile(request.path))
    pages = len(stored.pages)
    if variable is not None and not (variable.isdecimal() and int(variable) < pages):
        raise DatasetError(f"has no page {variable!r}; allowed: 0 to {pages - 1}")
    number = int(variable or 0)
    page = stored.pages[number]
    if len(page.shape) != 2 or page.dtype is None or page.dtype.kind not in "fiu" or page.dtype.itemsize < 2:
        found = f"page {number} has shape {page.shape} and values of type {page.dtype}"
        raise SurfaceError(f"{found}; allowed: one grey value of at least 16 bits for each pixel")
    pixel, unit, source = (None, None, "") if request.ignore_header else _pixel(stored, page)
    rows, columns = page.shape

    def heights() -> NDArray[Any]:
        image = page.asarray()
        return np.where(_missing(image, _tag(page, _NODATA)), math.nan, image).astype(np.float64).T

    described = Description(
        (columns, rows),
        None if pixel is None else (pixel[0] * (columns - 1), pixel[1] * (rows - 1)),
        unit,
        channel=f"page {number}",
        reader="tifffile",
        read_as="tiff",
        source=source,
        counts=page.dtype.kind in "iu",
        notes=(f"has {pages} pages; page {number} is read",) * (pages > 1 and variable is None),
    )
    return HeightMap(described, heights)


def _missing(image: NDArray[Any], nodata: Any) -> NDArray[np.bool_]:
    """Return the pixels with the value of GDAL_NODATA. A float32 image holds it rounded to its own type."""
    try:
        mark = float(nodata)
    except (TypeError, ValueError):  # no such tag
        return np.zeros(image.shape, dtype=bool)
    with np.errstate(over="ignore"):
        return np.asarray(image == (image.dtype.type(mark) if image.dtype.kind == "f" else mark))


def _tag(page: Any, code: int) -> Any:
    tag = page.tags.get(code)
    return None if tag is None else tag.value


def _pixel(stored: Any, page: Any) -> tuple[tuple[float, float] | None, str | None, str]:
    """Return the sides of a pixel along x and y, their unit, and the tag that gives them."""
    ome = stored.ome_metadata
    if ome:
        found = dict(reversed(re.findall(r'PhysicalSize([XY](?:Unit)?)="([^"]+)"', ome)))  # the first of each counts
        if {"X", "Y"} <= found.keys():
            x = length_unit(found["XUnit"], "PhysicalSizeXUnit") if "XUnit" in found else "um"  # default of OME
            y = length_unit(found["YUnit"], "PhysicalSizeYUnit") if "YUnit" in found else x
            if x != y:
                raise SurfaceError(f"x is in {x or 'pixels'}, y in {y or 'pixels'}; allowed: one unit for both")
            return (float(found["X"]), float(found["Y"])), x, "PhysicalSizeX of OME"
    scale = _tag(page, _PIXEL_SCALE)
    if scale is not None:
        return (float(scale[0]), float(scale[1])), None, "tag ModelPixelScale"
    fractions = [_tag(page, code) for code in (282, 283)]  # XResolution, YResolution: pixels per unit
    if any(value is None or not value[0] or not value[1] for value in fractions):
        return None, None, ""
    resolution = [value[0] / value[1] for value in fractions]
    imagej = (stored.imagej_metadata or {}).get("unit")
    if imagej:
        unit = length_unit(imagej.replace("\\u00B5", "\u00b5"), "the unit of ImageJ")
        pixel = None if unit is None else (1.0 / resolution[0], 1.0 / resolution[1])
        return pixel, unit, "XResolution in the unit of ImageJ"
    centimetres = {_INCH: 2.54, _CENTIMETRE: 1.0}.get(int(_tag(page, 296) or 0))
    if centimetres is None or any(
        math.isclose(value * 2.54 / centimetres, dpi, rel_tol=1e-3) for value in resolution for dpi in _PICTURES
    ):
        return None, None, ""
    return (centimetres / resolution[0], centimetres / resolution[1]), "cm", "tag XResolution"
