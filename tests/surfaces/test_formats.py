"""One scan in many formats: the same map, the same pressures in MPa, the same flow along x and along y."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import tifffile
import xarray as xr
from written import nms, surfer_6, surfer_7, surfer_text, wsxm

from roughvol.campaign import one_case
from roughvol.study import loads
from roughvol.surfaces.files import reading
from roughvol.surfaces.midpoint import random_midpoint_displacement

MAP = 0.3 * random_midpoint_displacement(2.3, 3, seed=3).heights[:, :7]  # 9 nodes along x, 7 along y, in um
PIXEL = 0.5
NX, NY = MAP.shape
X, Y = PIXEL * np.arange(NX), PIXEL * np.arange(NY)
POINTS = np.array([(x, y, z) for x, row in zip(X, MAP, strict=True) for y, z in zip(Y, row, strict=True)])
SHUFFLED = POINTS[np.random.default_rng(0).permutation(len(POINTS))]
GWYDDION = f"# Channel: Topography\n# Width: {NX * PIXEL:.2f} µm\n# Height: {NY * PIXEL:.2f} µm\n# Value units: m\n"
HW = f"h={NY} w={NX}\npixel size = {PIXEL * 1e-6:g} m\nheight conversion factor (-> m) = 1e-9\n"
ESRI = f"ncols {NX}\nnrows {NY}\nxllcorner 0\nyllcorner 0\ncellsize {PIXEL}\n"
SDF = (
    "aISO-1.0\nManufacID = roughvol\nCreateDate = 010120260000\nModDate = 010120260000\n"
    f"NumPoints = {NX}\nNumProfiles = {NY}\nXscale = {PIXEL * 1e-6}\nYscale = {PIXEL * 1e-6}\nZscale = 1e-6\n"
    "Zresolution = -1\nCompression = 0\nDataType = 7\nCheckType = 0\n*\n"
)


def rows(numbers: np.ndarray, between: str = " ") -> str:
    return "\n".join(between.join(f"{number:.12g}" for number in row) for row in numbers) + "\n"


def _text(text: str, encoding: str = "utf-8") -> Callable[[Path], Any]:
    return lambda path: path.write_text(text, encoding=encoding)


def _surfer(write: Callable[..., bytes]) -> Callable[[Path], Any]:
    return lambda path: path.write_bytes(write(MAP, (7.0, 7.0 + X[-1]), (-3.0, Y[-1] - 3.0)))


def _grid(dims: tuple[str, str], unit: str, scale: float, down: bool = False, **more: str) -> Callable[[Path], Any]:
    def write(path: Path) -> None:
        heights = MAP if dims == ("x", "y") else MAP.T
        y = Y[::-1] if down else Y
        values = scale * (heights[::-1] if down else heights)
        coordinates = {"x": ("x", X, {"units": "um"}), "y": ("y", y, {"units": "um"})}
        xr.Dataset({"h": (dims, values, {"units": unit, **more})}, coords=coordinates).to_netcdf(path)

    return write


def _library(name: str) -> Callable[[Path], Any]:
    def write(path: Path) -> None:
        topography = pytest.importorskip("SurfaceTopography").Topography
        getattr(topography(MAP, (NX * PIXEL, NY * PIXEL), unit="µm"), name)(str(path))

    return write


def _hdf5(path: Path) -> None:
    with pytest.importorskip("h5py").File(path, "w") as stored:
        stored["scan/z"], stored["scan/quality"] = MAP, np.ones(MAP.shape)


# name -> writer of the file, and further keys of the study
FORMATS: dict[str, tuple[Callable[[Path], Any], str]] = {
    "z.npy": (lambda path: np.save(path, MAP), "L: 4 um"),
    "z.npz": (lambda path: np.savez(path, z=MAP, L=4.0), "L: 4 um"),
    "rows.txt": (_text(rows(MAP)), "L: 4 um"),
    "ended.dat": (_text(rows(MAP, ";").replace("\n", ";\n")), "L: 4 um"),
    "decimal-commas.csv": (_text(rows(MAP, ";").replace(".", ",")), "L: 4 um"),
    "decimal-commas.txt": (_text(rows(MAP, "\t").replace(".", ",")), "L: 4 um"),
    "named.txt": (_text("# heights in nm\n" + rows(1e3 * MAP)), "L: 4 um"),
    "nanometres.txt": (_text(rows(1e3 * MAP)), "L: 4 um, heights_unit: nm"),
    "gwyddion.txt": (_text(GWYDDION + rows(1e-6 * MAP.T)), ""),
    "latin.txt": (_text(GWYDDION + rows(1e-6 * MAP.T), "latin-1"), ""),
    "utf-16.txt": (_text(GWYDDION + rows(1e-6 * MAP.T), "utf-16"), ""),
    "german.txt": (
        _text(
            GWYDDION.replace("Width", "Breite").replace("Height", "Höhe").replace("Value units", "Einheiten")
            + rows(1e-6 * MAP.T)
        ),
        "",
    ),
    "hw.txt": (_text(HW + rows(1e3 * MAP.T)), ""),
    "grid.asc": (_text(ESRI + rows(MAP.T[::-1])), "unit: um"),
    "points.xyz": (_text(rows(SHUFFLED)), "unit: um"),
    "points.txt": (_text(rows(SHUFFLED, "\t")), "unit: um"),
    "points.dat": (_text(rows(POINTS[::-1], ",")), "unit: um"),
    "points.asc": (_text(rows(SHUFFLED)), "L: 4 um, heights_unit: um"),
    "points.csv": (_text("X [µm];Y [µm];Z [nm]\n" + rows(SHUFFLED * [1, 1, 1e3], ";")), ""),
    "points": (_text(rows(SHUFFLED)), "unit: um"),
    "xy.nc": (_grid(("x", "y"), "um", 1.0), ""),
    "yx.nc": (_grid(("y", "x"), "nm", 1e3), ""),
    "down.nc": (_grid(("y", "x"), "um", 1.0, down=True), ""),
    "depths.nc": (_grid(("y", "x"), "um", -1.0, positive="down"), ""),
    "z.h5": (_hdf5, "L: 4 um, variable: scan/z"),
    "z.mat": (lambda path: scipy.io.savemat(path, {"z": MAP, "L": 4.0}), "L: 4 um"),
    "image.stp": (lambda path: path.write_bytes(wsxm(MAP[:, ::-1], "double", (NX * PIXEL, NY * PIXEL))), ""),
    "image.nms": (lambda path: path.write_bytes(nms(MAP, 500.0, 500.0)), "L: 4 um"),
    "library.nc": (_library("to_netcdf"), ""),
    "library.x3p": (_library("to_x3p"), ""),
    "library.gwy": (_library("to_gwy"), ""),
    "library.txt": (_library("to_matrix"), ""),
    "iso.sdf": (_text(SDF + rows(MAP.T) + "*\nend\n*\n"), ""),
    "iso.txt": (_text(SDF + rows(MAP.T) + "*\nend\n*\n"), ""),
    "text.grd": (_surfer(surfer_text), "unit: um"),
    "surfer-6.grd": (_surfer(surfer_6), "unit: um"),
    "surfer-7.grd": (_surfer(surfer_7), "unit: um"),
    "image.tif": (lambda path: tifffile.imwrite(path, MAP.T), "L: 4 um"),
    "counts.tif": (
        lambda path: tifffile.imwrite(path, np.rint((MAP.T - MAP.min()) / 5e-5).astype("u2")),
        "L: 4 um, heights_unit: 0.05 nm",
    ),
    "imagej.tif": (
        lambda path: tifffile.imwrite(
            path, MAP.T.astype("f4"), imagej=True, resolution=(2.0, 2.0), metadata={"unit": "um"}
        ),
        "heights_unit: um",
    ),
    "tagged.tif": (
        lambda path: tifffile.imwrite(path, MAP.T, resolution=(2e4, 2e4), resolutionunit="CENTIMETER"),
        "heights_unit: um",
    ),
}
REST = """
material: {E: 210 GPa, nu: 0.3}
sweep: {steps: 2}
record: {transport: {transmissivity: {step: [1]}}}
"""


def _pressed(folder: Path, name: str) -> dict[str, np.ndarray]:
    write, keys = FORMATS[name]
    write(folder / name)
    (case,) = loads(f"surface: {{file: {name}, {keys}}}{REST}", folder / "study.yaml").cases()
    stored = one_case.run_case(case)
    scale = case.E_star * stored["Sq"].item() / case.L
    along = ("transmissivity_x", "transmissivity_y")
    pressures = {"pressure": scale * stored["mean_pressure"].values}
    return pressures | {name: stored[name].values for name in along}


@functools.cache
def _reference(folder: Path) -> dict[str, np.ndarray]:
    return _pressed(folder, "z.npy")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("formats")


@pytest.mark.parametrize("name", list(FORMATS))
def test_one_scan_gives_the_same_pressures_in_every_format(folder: Path, name: str) -> None:
    expected = _reference(folder)
    found = _pressed(folder, name)
    assert np.all(expected["pressure"] > 0.0)
    assert not np.allclose(expected["transmissivity_x"], expected["transmissivity_y"], rtol=0.01)
    for quantity, values in expected.items():
        np.testing.assert_allclose(found[quantity], values, rtol=1e-3, err_msg=quantity)


def test_every_format_is_described_by_the_reader_that_the_docs_name(folder: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "measured.md").read_text(encoding="utf-8")
    for name, (write, keys) in FORMATS.items():
        write(folder / name)
        description = reading.describe(folder / name, keys.partition("variable: ")[2] or None)
        assert description.shape == MAP.shape
        assert description.reader.split(",")[0].removeprefix("SurfaceTopography ") in page, name
