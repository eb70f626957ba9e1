"""NetCDF: names of dimensions give the axes, coordinates the size; what is no map of numbers is refused."""

import numpy as np
import pytest
import xarray as xr
from height_files import HEIGHTS, HOLES, netcdf, refused, same
from netCDF4 import Dataset

from roughvol.surfaces.files import reading


def _grid(path):
    """A file with two dimensions and no variable yet."""
    stored = Dataset(path, "w")
    stored.createDimension("x", 6)
    stored.createDimension("y", 5)
    return stored


POINT = np.dtype([("height", "f8"), ("quality", "i4")])


@pytest.mark.parametrize(
    ("dims", "turned"),
    [
        (("x", "y"), False),
        (("y", "x"), True),
        (("lat", "lon"), True),
        (("scan_y", "scan_x"), True),
        (("row", "x"), True),
        (("y", "column"), True),
        (("row", "column"), False),
        (("x", "time"), False),
    ],
)
def test_names_of_dimensions_say_which_axis_is_x(tmp_path, dims, turned):
    xr.Dataset({"z": (dims, HEIGHTS.T if turned else HEIGHTS)}).to_netcdf(tmp_path / "z.nc")
    same(tmp_path / "z.nc", HEIGHTS)
    along = {dim: (dim, np.arange(n), {"axis": axis}) for dim, n, axis in (("p", 5, "Y"), ("q", 6, "X"))}
    xr.Dataset({"z": (("p", "q"), HEIGHTS.T)}, coords=along).to_netcdf(tmp_path / "attribute.nc")
    same(tmp_path / "attribute.nc", HEIGHTS)
    xr.Dataset({"z": (("time", "p", "q"), HEIGHTS.T[None])}, coords=along | {"time": [0.0]}).to_netcdf(
        tmp_path / "t.nc"
    )
    same(tmp_path / "t.nc", HEIGHTS)
    same(tmp_path / "t.nc", HEIGHTS, variable="z")


@pytest.mark.parametrize("kind", ["NETCDF3_CLASSIC", "NETCDF4"])
def test_a_grid_of_gmt_is_netcdf(tmp_path, kind):
    coordinates = {"lat": ("lat", np.arange(5.0)), "lon": ("lon", np.arange(6.0))}
    xr.Dataset({"z": (("lat", "lon"), HEIGHTS.T)}, coords=coordinates).to_netcdf(tmp_path / "z.grd", format=kind)
    found = reading.describe(tmp_path / "z.grd")
    assert (found.reader, found.sides, found.counted) == ("netCDF", (5.0, 4.0), True)
    same(tmp_path / "z.grd", HEIGHTS)


@pytest.mark.parametrize(
    ("x", "attributes", "pattern"),
    [
        (np.arange(6.0) ** 2, {"units": "um"}, "the coordinate x is not equidistant"),
        (np.arange(6.0), {"units": "degrees_east"}, "x:units has the unit 'degrees_east'"),
        (np.arange(6.0), {"units": "nm"}, "x is in nm, y in um"),
        (np.arange(6.0), {}, "x is in no unit, y in um"),
        (np.arange(6.0), {"units": "um", "length": 7.0}, "x:length is 7, its coordinate has a spacing of 1"),
        (np.arange(6.0), {"units": "um", "length": [1.0, 2.0]}, r"cannot be read as \.nc"),
        (np.array(list("abcdef"), dtype=object), {}, ""),
    ],
)
def test_coordinates_that_cannot_be_used_are_refused_or_ignored(tmp_path, x, attributes, pattern):
    coordinates = {"x": ("x", x, attributes), "y": ("y", np.arange(5.0), {"units": "um"})}
    xr.Dataset({"z": (("x", "y"), HEIGHTS)}, coords=coordinates).to_netcdf(tmp_path / "z.nc")
    if pattern:
        refused(tmp_path / "z.nc", pattern)
    else:  # words are no coordinates
        assert reading.describe(tmp_path / "z.nc").sides is None
    same(tmp_path / "z.nc", HEIGHTS, ignore_header=True)


@pytest.mark.parametrize(("positive", "sign"), [("up", 1.0), ("DOWN ", -1.0), (None, 1.0), ("east", 0.0)])
@pytest.mark.parametrize("kind", ["f8", "i2"])
def test_heights_may_be_positive_down(tmp_path, positive, sign, kind):
    path, heights = tmp_path / "z.nc", (1e3 * HEIGHTS).astype(kind)
    attributes = {} if positive is None else {"positive": positive}
    xr.Dataset({"z": (("y", "x"), heights.T, attributes)}).to_netcdf(path)
    if not sign:
        refused(path, "z:positive is 'east'; allowed: up and down")
        return
    same(path, sign * heights)
    found = reading.describe(path)
    assert found.read_as == ("labels, down" if sign < 0.0 else "labels")
    assert ["turned over" in note for note in found.notes] == [True] * (sign < 0.0)


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (lambda stored: stored.createCompoundType(POINT, "point"), np.zeros((), POINT)),
        (lambda stored: stored.createVLType("f8", "ragged"), np.zeros(3)),
        (lambda stored: stored.createEnumType("i1", "quality", {"bad": 0, "good": 1}), 0),
        (lambda stored: str, "high"),
        (lambda stored: "S1", "a"),
    ],
    ids=["compound", "ragged", "enumerated", "words", "letters"],
)
def test_what_holds_no_plain_numbers_is_refused(tmp_path, kind, value):
    with _grid(tmp_path / "z.nc") as stored:
        stored.createVariable("z", kind(stored), ("x", "y"))[0, 0] = value
    refused(tmp_path / "z.nc", r"z holds text, or values of a type of its own, not numbers")


def test_scaled_integers_are_unpacked_and_their_mask_is_kept(tmp_path):
    with _grid(tmp_path / "z.nc") as stored:
        packed = stored.createVariable("z", "i2", ("x", "y"))
        packed.scale_factor, packed.add_offset = 0.5, 10.0
        packed[...] = np.ma.masked_array(10.0 + 0.5 * np.arange(30).reshape(6, 5), HOLES)
    expected = np.where(HOLES, np.nan, 10.0 + 0.5 * np.arange(30).reshape(6, 5))
    same(tmp_path / "z.nc", expected, holes=True)
    netcdf(tmp_path / "z.nc", z=np.ma.masked_array(np.arange(30).reshape(6, 5), HOLES))
    same(tmp_path / "z.nc", 2.0 * (expected - 10.0), holes=True)


def test_a_mask_of_one_time_beside_heights_is_kept(tmp_path):
    both = {"heights": HEIGHTS[None], "mask": HOLES[None].astype("i1")}
    xr.Dataset({name: (("time", "x", "y"), values) for name, values in both.items()}).to_netcdf(tmp_path / "t.nc")
    same(tmp_path / "t.nc", np.where(HOLES, np.nan, HEIGHTS), holes=True)
