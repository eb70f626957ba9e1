"""Files of heights as the descriptions of their formats have them, written without the readers under test.

Heights have x as their first axis; y rises with the second. NaN is a missing height.
"""

import io
import struct

import numpy as np
import pytest
from netCDF4 import Dataset

from roughvol.errors import RoughvolError
from roughvol.surfaces.files import reading

HEIGHTS = np.random.default_rng(8).normal(size=(6, 5)).astype("f4").astype(float)  # 6 nodes along x, 5 along y
HOLES = np.zeros(HEIGHTS.shape, dtype=bool)
HOLES[1, 2] = HOLES[4, 0] = HOLES[5, 4] = True
HOLED = np.where(HOLES, np.nan, HEIGHTS)
PIXEL = 0.5
POINTS = np.column_stack([*(PIXEL * axis.ravel() for axis in np.indices(HEIGHTS.shape)), HEIGHTS.ravel()])
SHUFFLED = POINTS[np.random.default_rng(0).permutation(len(POINTS))]
GWYDDION = "# Channel: Topography\n# Width: 3 µm\n# Height: 2.5 µm\n# Value units: nm\n"
GERMAN = "# Breite: 3 µm\n# Höhe: 2.5 µm\n# Einheiten: nm\n"  # Gwyddion in another language
ESRI = f"ncols 6\nNROWS 5\nxllcorner 0\nyllcorner 0\ncellsize {PIXEL}\nNODATA_value -9999\n"
SDF = (
    "aISO-1.0\nManufacID = roughvol\nCreateDate = 010120260000\nModDate = 010120260000\nNumPoints = 6\n"
    "NumProfiles = 5\nXscale = 0.5e-6\nYscale = 0.5e-6\nZscale = 1e-6\nZresolution = -1\nCompression = 0\n"
    "DataType = 7\nCheckType = 0\n*\n"
)


def put(path, content):
    """Write text, bytes, or what a function writes."""
    if callable(content):
        content(path)
    else:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def same(path, expected, variable=None, **options):
    heights = reading.read(path, variable, **options)
    assert np.array_equal(heights, expected, equal_nan=True)
    assert (heights.dtype, heights.flags.c_contiguous) == (np.float64, True)


def refused(path, pattern, variable=None, **options):
    """The file is refused in one message with its name, before heights are read if not for single heights."""
    call = reading.read if "missing or not finite" in pattern else reading.describe
    with pytest.raises(RoughvolError, match=pattern) as caught:
        call(path, variable, **options)
    assert str(path) in str(caught.value)


def refusals_of(table, file="{}"):
    """Return a test of rows (content, pattern) by name: each file is refused in these words."""

    @pytest.mark.parametrize("name", table)
    def test(tmp_path, name):
        content, pattern = table[name]
        refused(put(tmp_path / file.format(name), content), pattern)

    return test


def rows(numbers, between=" ", hole="nan"):
    cells = [[hole if np.isnan(number) else repr(float(number)) for number in row] for row in numbers]
    return "\n".join(between.join(row) for row in cells) + "\n"


def npy(array):
    """An array, or the header of one of a shape."""
    stream = io.BytesIO()
    if isinstance(array, tuple):
        header = {"descr": "<f8", "fortran_order": False, "shape": array}
        np.lib.format.write_array_header_1_0(stream, header)
    else:
        np.save(stream, array)
    return stream.getvalue()


def netcdf(path, **arrays):
    """Arrays without coordinates, masked where they are."""
    with Dataset(path, "w") as stored:
        for name, array in arrays.items():
            values = np.ma.asarray(array)
            dims = [f"{name}_{axis}" for axis in range(values.ndim)]
            for dim, size in zip(dims, values.shape, strict=True):
                stored.createDimension(dim, size)
            stored.createVariable(name, values.dtype, dims)[...] = values


def library(path, heights=HEIGHTS, pixel=(PIXEL, PIXEL)):
    """A file that SurfaceTopography writes, in um: .gwy, .nc, .x3p, or its matrix of text."""
    sizes = heights.shape[0] * pixel[0], heights.shape[1] * pixel[1]
    map_ = pytest.importorskip("SurfaceTopography").Topography(heights, sizes, unit="µm")
    name = {".nc": "netcdf", ".txt": "matrix"}.get(path.suffix, path.suffix[1:])
    getattr(map_, f"to_{name}")(str(path))
    return path


BLANK = 1.70141e38
X, Y = (2.0, 4.5), (-1.0, 1.0)  # limits of a grid of 6 x 5 nodes


def surfer_text(heights, x=X, y=Y):
    """Rows of constant y, the lowest y first."""
    rows = "\n\n".join(" ".join("1.70141e+038" if np.isnan(z) else repr(float(z)) for z in row) for row in heights.T)
    nx, ny = heights.shape
    limits = f"{x[0]} {x[1]}\n{y[0]} {y[1]}\n{np.nanmin(heights)} {np.nanmax(heights)}"
    return f"DSAA\n{nx} {ny}\n{limits}\n{rows}\n".encode("ascii")


def surfer_6(heights, x=X, y=Y):
    head = struct.pack("<4s2h6d", b"DSBB", *heights.shape, *x, *y, np.nanmin(heights), np.nanmax(heights))
    return head + np.where(np.isnan(heights), BLANK, heights).T.astype("<f4").tobytes()


def surfer_7(heights, x=X, y=Y, version=2, blank=BLANK, between=b""):
    nx, ny = heights.shape
    spacing = (x[1] - x[0]) / (nx - 1), (y[1] - y[0]) / (ny - 1)
    numbers = (x[0], y[0], *spacing, np.nanmin(heights), np.nanmax(heights), 0.0, blank)
    data = np.where(np.isnan(heights), blank, heights).T.astype("<f8").tobytes()
    return (
        struct.pack("<4sii", b"DSRB", 4, version)
        + between
        + struct.pack("<4si2i8d", b"GRID", 72, ny, nx, *numbers)
        + struct.pack("<4si", b"DATA", len(data))
        + data
    )


def simple_field(heights, unit, **other):
    """Gwyddion Simple Field: rows along x, their size that of all pixels."""
    nx, ny = heights.shape
    fields = {"XRes": nx, "YRes": ny, "XReal": PIXEL * nx, "YReal": PIXEL * ny, "XYUnits": unit, "ZUnits": unit} | other
    head = "Gwyddion Simple Field 1.0\n" + "".join(f"{key} = {value}\n" for key, value in fields.items())
    return head.encode() + bytes(4 - len(head.encode()) % 4) + heights.T.astype("<f4").tobytes()


def nms(heights, dx, dy):
    """NanoFocus: counts of 16 bits between the limits of z, the first line of the image first."""
    low, high = float(heights.min()), float(heights.max())
    head = bytearray(3468)
    struct.pack_into("<2I", head, 0, 2, 1)
    struct.pack_into("<2d", head, 16, low, high)
    struct.pack_into("<2I2d", head, 1368, *heights.shape, dx, dy)
    counts = np.rint((heights.T - low) / (high - low) * 65534).astype("<u2")
    return bytes(head) + counts.tobytes() + bytes(heights.size)


def wsxm(heights, size):
    """WSxM: rows in the order of rising y, the numbers of a row in the order of falling x; sizes in um, heights in nm.

    https://spmimages.ftmc.uam.es/file-specifications; y falls with the index of an image, so it is that of the caller.
    """
    numbers = 1e3 * heights.T[:, ::-1]
    text = (
        "WSxM file copyright Nanotec Electronica\r\nSxM Image file\r\nImage header size: 0\r\n\r\n"
        f"[Control]\r\n\r\n    X Amplitude: {size[0]} µm\r\n    Y Amplitude: {size[1]} µm\r\n\r\n"
        f"[General Info]\r\n\r\n    Image Data Type: double\r\n"
        f"    Number of columns: {heights.shape[0]}\r\n    Number of rows: {heights.shape[1]}\r\n"
        f"    Z Amplitude: {float(np.ptp(numbers))} nm\r\n\r\n"
        f"[Miscellaneous]\r\n\r\n    Maximum: {numbers.max()}\r\n    Minimum: {numbers.min()}\r\n\r\n[Header end]\r\n"
    )
    return text.encode("latin-1") + numbers.astype("<f8").tobytes()
