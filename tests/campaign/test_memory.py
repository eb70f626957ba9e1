"""Heights in memory: masks, labels, units and sizes of an array are those of the surface that is pressed."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pint
import pytest
import xarray as xr
from numpy.testing import assert_allclose

import roughvol
from roughvol.errors import CampaignError, DatasetError, RoughvolError, StudyError, SurfaceError
from roughvol.store.run import study_of
from roughvol.study import load
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.treatment import fill
from tests.kit import said

pytestmark = pytest.mark.usefixtures("here")

PIXEL = 0.5
MAP = 0.2 * random_midpoint_displacement(2.3, 4, seed=3).heights[:, :13]  # 17 nodes along x, 13 along y, in um
X, Y = (PIXEL * np.arange(nodes) for nodes in MAP.shape)
UNITS = pint.get_application_registry()
MATERIAL = {"E": "10 MPa", "nu": 0.5}


def _grid(dims: tuple[str, str] = ("x", "y"), unit: str = "um", scale: float = 1.0) -> xr.DataArray:
    """Return the map with its labels, with the axes in an order."""
    lengths = {"x": ("x", X, {"units": "um"}), "y": ("y", Y, {"units": "um"})}
    return xr.DataArray(scale * MAP, dims=("x", "y"), coords=lengths, attrs={"units": unit}).transpose(*dims)


def _heights(heights: Any, **options: Any) -> xr.DataArray:
    """Return the stored heights of a map that is not pressed."""
    return roughvol.press(heights, **MATERIAL, steps=0, record={"heights": True}, **options).heights


def _turned(heights: xr.DataArray) -> xr.DataArray:
    return heights.isel(y=slice(None, None, -1))


def _topography(**options: Any) -> Any:
    library = pytest.importorskip("SurfaceTopography")
    sizes = tuple(nodes * PIXEL for nodes in MAP.shape)
    return library.Topography(options.pop("heights", MAP), sizes, unit="µm", **options)


LABELLED = {
    "axes x, y": lambda: _grid(),
    "axes y, x": lambda: _grid(("y", "x")),
    "heights in nm": lambda: _grid(("y", "x"), "nm", 1e3),
    "y falls along its axis": lambda: _turned(_grid(("y", "x"))),
    "axes named by CF": lambda: _grid(("y", "x")).rename(x="lon", y="lat"),
    "depths": lambda: (-_grid(("y", "x"))).assign_attrs(units="um", positive="down"),
    "one coordinate": lambda: _grid(("y", "x")).drop_vars("y"),
    "a quantity of pint inside": lambda: _grid(("y", "x")).copy(data=_grid(("y", "x")).data * UNITS.micrometer),
    "a Topography": _topography,
    "a Topography in nm": lambda: _topography().to_unit("nm"),
}


@pytest.mark.parametrize("name", LABELLED)
def test_labels_give_axes_size_and_units(name: str) -> None:
    found = _heights(LABELLED[name]())
    unit, scale = ("nm", 1e3) if name == "a Topography in nm" else ("um", 1.0)
    assert (found.units, float(found.L)) == (unit, pytest.approx(8.0 * scale))
    assert_allclose(found, scale * MAP, rtol=1e-9, atol=1e-12 * scale)
    assert_allclose(found.y, np.arange(13) / 16)  # of the length along x


FORMS = {
    "a list": MAP.tolist(),
    "single precision of eighths": np.round(MAP * 64).astype("f4") / 64,
    "whole numbers": np.round(MAP * 64).astype("i2"),
    "a quantity in nm": 1e3 * MAP * UNITS.nanometer,
    "axes of other names": xr.DataArray(MAP, dims=("scan", "fast"), attrs={"units": "um"}),
    "a Variable of axes y, x": xr.Variable(("y", "x"), MAP.T, {"units": "um"}),
    "a DataFrame": pd.DataFrame(MAP),
    "axes x and another": xr.DataArray(MAP.T, dims=("line", "x")),
}


@pytest.mark.parametrize("name", FORMS)
def test_numbers_without_size_are_those_of_a_map_of_side_L(name: str) -> None:
    found = _heights(FORMS[name], L="8 um")
    expected = {"single": np.round(MAP * 64) / 64, "whole ": np.round(MAP * 64)}.get(name[:6], MAP)
    assert (found.units, float(found.L)) == ("um", 8.0)
    assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


HOLES = np.zeros(MAP.shape, dtype=bool)
HOLES[3:5, 6] = HOLES[10, 2] = True
MASKED = {
    "masked": lambda: np.ma.masked_array(np.where(HOLES, 1e3, MAP), HOLES),
    "NaN": lambda: np.where(HOLES, np.nan, MAP),
    "masked whole numbers": lambda: np.ma.masked_array(np.where(HOLES, 999, np.round(1e3 * MAP)).astype(int), HOLES),
    "labelled": lambda: _grid().where(~HOLES).transpose("y", "x"),
    "a Topography": lambda: _topography(heights=np.ma.masked_array(np.where(HOLES, 1e3, MAP), HOLES)),
    "a masked quantity": lambda: UNITS.Quantity(np.ma.masked_array(np.where(HOLES, 1e3, MAP), HOLES), "um"),
}


@pytest.mark.parametrize("name", MASKED)
def test_a_mask_is_missing_heights(name: str) -> None:
    heights = MASKED[name]()
    size = {} if name in ("labelled", "a Topography") else {"L": "8 um"}
    unit = {"heights_unit": "nm"} if "whole" in name else {}
    with pytest.raises(SurfaceError, match=r"^press: argument heights: 3 heights are missing .*row 3, column 6"):
        _heights(heights, **size)
    found = _heights(heights, **size, surface={"missing": "nearest", **unit})
    assert_allclose(found, fill(np.where(HOLES, np.nan, MAP), "nearest"), rtol=0.0, atol=6e-4 if unit else 1e-12)


def test_a_path_is_read_as_in_a_study() -> None:
    _grid(("y", "x")).rename("h").to_netcdf("scan.nc")
    for path in ("scan.nc", Path("scan.nc")):
        assert_allclose(_heights(path), MAP, rtol=1e-9)
    with pytest.raises(StudyError, match=r"^press: argument heights: no such file"):
        _heights("absent.nc")
    Path("scan.txt").write_text("nothing\n", encoding="utf-8")
    with pytest.raises(RoughvolError, match=r"scan\.txt"):
        _heights("scan.txt", L=1)


def test_oblong_pixels_are_refused_and_resampled() -> None:
    oblong = _grid().assign_coords(y=("y", 1.5 * Y, {"units": "um"}))
    with pytest.raises(StudyError, match="resample"):
        _heights(oblong)
    assert _heights(oblong, surface={"resample": "square"}).shape == (17, 19)


def test_L_agrees_with_the_coordinates() -> None:
    counted = _grid().assign_coords(x=np.arange(17), y=np.arange(13))  # nodes are counted: L gives the size
    shares = {"x": ("x", X / 8.0, {"units": "1"}), "y": ("y", Y / 8.0, {"units": "1"})}  # as datasets here have them
    for heights, L in ((_grid(), 8.001), (counted, 8.0), (xr.DataArray(MAP, dims=("x", "y"), coords=shares), 8.0)):
        assert float(_heights(heights, L=f"{L} um").L) == L
    with pytest.raises(StudyError, match=r"^press: argument L: is 9 um, but argument heights gives 8 um \(coordinates"):
        _heights(_grid(), L="9 um")
    with pytest.raises(StudyError, match=r"^press: argument L: missing, and the heights have no size"):
        _heights(MAP)


@pytest.mark.parametrize(
    ("heights", "reason"),
    [
        (MAP + 1j, r"complex128"),
        (MAP > 0.0, r"bool"),
        (MAP.astype(str), r"<U"),
        (MAP.astype(object), r"object"),
        ("not a map", r"must end in|no such file"),
        (None, r"object"),
        (MAP[0], r"shape \(13,\)"),
        (MAP[:2, :2], r"heights have shape \(2, 2\); allowed: two dim"),
        (MAP[np.newaxis], r"shape \(1, 17, 13\)"),
        ([[1.0, 2.0], [3.0]], r"no array: .*allowed: rows of one length"),
        (xr.Dataset({"z": (("x", "y"), MAP)}), r"Dataset .* variables: z"),
        (xr.DataArray(MAP[np.newaxis], dims=("band", "y", "x")), r"band 1, y 17, x 13"),
        (xr.DataArray(MAP, dims=("a b", "a_b")), r"a b 17, a_b 13; allowed: two with names of their own"),
        (_grid() * (1 + 1j), r"complex"),
        (_grid(unit="V"), r"'V'"),
        (_grid().assign_coords(x=("x", X**2, {"units": "um"})), r"not equidistant"),
        (_grid().assign_coords(x=("x", X, {"units": "mm"})), r"x is in mm, y in um"),
        (MAP * UNITS.megapascal, r"'MPa'"),
        ([row * UNITS.nanometer for row in MAP], r"each row .* is a quantity; allowed: one quantity"),
        ([[height * UNITS.nanometer for height in row] for row in MAP], r"each row .* is a quantity"),
        (roughvol.surfaces.Surface(MAP, 0.5), r"a Surface .* surface\.heights, and L"),
        (pd.DataFrame(MAP, index=X), r"DataFrame .*to_numpy"),
    ],
)
def test_what_is_no_map_of_heights_is_refused_by_name(heights: Any, reason: str) -> None:
    with pytest.raises((SurfaceError, StudyError), match=rf"^press: argument heights: .*{reason}"):
        _heights(heights, L="8 um")


def test_a_line_is_no_map() -> None:
    library = pytest.importorskip("SurfaceTopography")
    with pytest.raises(SurfaceError, match="UniformLineScan is no map"):
        _heights(library.UniformLineScan(MAP[:, 0], 8.5))


def test_a_periodic_topography_is_pressed_as_the_surface_section_says() -> None:
    with pytest.warns(roughvol.RoughvolWarning, match=r"periodic Topography, pressed mirrored.*surface\.sides") as seen:
        _heights(_topography(periodic=True))
    assert {one.filename for one in seen if issubclass(one.category, roughvol.RoughvolWarning)} == {__file__}
    period = roughvol.press(_topography(periodic=True), **MATERIAL, steps=0, surface={"sides": "periodic"})
    assert (float(period.L), period.sides) == (8.5, "periodic")


def test_the_order_of_an_array_in_memory_is_no_part_of_its_identity() -> None:
    """Equal heights, transposed twice by a user, were refused as those of another study."""
    orders = (MAP, np.asfortranarray(MAP))
    assert len({roughvol.press(heights, L=1.0, steps=0).case_ids for heights in orders}) == 1


def test_run_takes_heights_in_memory_and_keeps_them_beside_its_results() -> None:
    study: dict[str, Any] = {
        "name": "kept",
        "surface": {"heights": _grid(("y", "x"))},
        "material": MATERIAL,
        "sweep": {"steps": 2},
        "record": {"heights": True},
    }
    assert_allclose(roughvol.run(study, jobs=1).heights[0], MAP, rtol=1e-9)
    (id,) = {path.stem for path in Path("runs/kept/cases").glob("*.nc")}
    for again in (load("runs/kept/study.yaml"), study_of("kept")[0]):
        assert again.cases()[0].id == id  # the file of heights is beside the study
    assert said("status", "kept").startswith("runs/kept: 1 of 1 cases finished")
    said("run", "kept", "--set", "name=finer", "--set", "sweep.steps=3", "--jobs", "1")
    assert "heights.nc read by" in said("check", "finer")
    Path("runs/finer/study.nc").unlink()  # as of a run that was interrupted
    said("run", "finer", "--set", "name=finest", "--set", "sweep.steps=4", "--jobs", "1")
    assert "heights.nc read by" in said("check", "finest")
    before = Path("runs/kept/cases").stat().st_mtime_ns
    roughvol.run(study, jobs=1)
    assert Path("runs/kept/cases").stat().st_mtime_ns == before  # nothing is computed twice
    with pytest.raises(DatasetError, match="another study"):
        roughvol.run({**study, "surface": {"heights": _grid(scale=2.0)}}, jobs=1)
    assert_allclose(_heights("runs/kept/heights.nc"), MAP, rtol=1e-9)  # the first ones stay
    for surface, words in (
        ({"heights": MAP, "file": "runs/kept/heights.nc"}, r'\["heights"\]: excluded by'),
        ({"heights": MAP * 1j, "L": 1}, r'\["heights"\]: heights are of the type complex128'),
        ({"file": MAP, "L": 1}, r'\["file"\]: .*shape \(17, 13\).*surface\.heights'),
    ):
        with pytest.raises((StudyError, SurfaceError), match=rf'^run: study\["surface"\]{words}'):
            roughvol.run({"surface": surface})
    with pytest.raises(CampaignError, match="workers do not have the heights"):
        roughvol.run(study, scheduler="127.0.0.1:8786")


def test_two_bodies_in_memory() -> None:
    against = {"heights": np.ma.masked_array(MAP, HOLES), "mirror": "x"}
    with pytest.raises(
        SurfaceError, match=r'^press: argument surface\["against"\]\["heights"\]: 3 heights are missing'
    ):
        _heights(MAP, L="8 um", surface={"against": against})
    both = _heights(MAP, L="8 um", surface={"against": {"heights": MAP, "mirror": "x"}})
    assert_allclose(both, MAP + MAP[::-1], rtol=1e-9, atol=1e-12)
