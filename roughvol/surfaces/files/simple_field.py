"""Height maps in Gwyddion Simple Field files (GSF): a header of text, zero bytes, and rows of 32-bit numbers.

Conventions: x runs along the rows, so the array is the transpose of the rows. XReal and YReal are the width and the
height of all pixels. A missing height is NaN.

Layout: Gwyddion user guide, "Gwyddion Simple Field file format".
"""

from __future__ import annotations

import re
from pathlib import Path

from roughvol.errors import DatasetError, SurfaceError
from roughvol.surfaces.files import description
from roughvol.surfaces.files.description import Description, HeightMap, Request

_MAGIC = b"Gwyddion Simple Field 1."
_HEAD = 1 << 16  # bytes searched for the end of the header
_HEIGHT_BYTES = 4
_FIELD = re.compile(r"^[ \t]*(\w+)[ \t]*=[ \t]*(.*?)[ \t\r]*$", re.MULTILINE)


def is_field(path: Path) -> bool:
    """Return whether a file starts with the name of the format."""
    return description.first_bytes(path, len(_MAGIC)) == _MAGIC


def opened(request: Request) -> HeightMap:
    """Return the map in a Gwyddion Simple Field; its heights are read on demand."""
    request.refuse_variable()
    path = request.path
    head, _, _ = description.first_bytes(path, _HEAD).partition(b"\0")
    start = len(head) + _HEIGHT_BYTES - len(head) % _HEIGHT_BYTES  # 1 to 4 zero bytes end the header
    given = dict(_FIELD.findall(head.decode("utf-8", errors="replace")))
    if not all(re.fullmatch(r"0*[1-9]\d*", given.get(key, "")) for key in ("XRes", "YRes")):
        raise DatasetError(f"its header gives {', '.join(given)}; needed: XRes and YRes, whole numbers above 0")
    title = given.get("Title", "")
    if description.names_no_heights(title):
        raise SurfaceError(f"the field {title!r} holds no heights, by its name")
    nx, ny = int(given["XRes"]), int(given["YRes"])
    sides = None
    if {"XReal", "YReal"} <= given.keys():
        try:
            sides = float(given["XReal"]) / nx * (nx - 1), float(given["YReal"]) / ny * (ny - 1)
        except ValueError:
            message = f"its header gives XReal {given['XReal']}, YReal {given['YReal']}; allowed: numbers"
            raise SurfaceError(message) from None
    described = Description(
        (nx, ny),
        sides,
        description.length_unit(given.get("XYUnits", ""), "XYUnits"),
        description.length_unit(given.get("ZUnits", ""), "ZUnits"),
        title,
        "Gwyddion Simple Field",
        source="XReal in its header" if sides else "",
    )
    return description.binary(path, described, "<f4", start, path.stat().st_size - start)
