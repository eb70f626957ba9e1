"""Results opened from Python: runs by folder, file or name, and datasets that a user has saved."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import roughvol
from roughvol.errors import DatasetError, FolderError, StudyError
from roughvol.store.dataset import Dataset
from tests.kit import said

STUDY = {"name": "tiny", "surface": {"D": 2.3, "m": 4, "seeds": 2}, "sweep": {"steps": 3, "to": {"indentation": 1}}}


@pytest.fixture
def run(here: Path) -> Dataset:
    return roughvol.run(STUDY, jobs=1)


def test_a_run_opens_by_folder_file_name_and_study(run: Dataset) -> None:
    Path("tiny.yaml").write_text(roughvol.load("runs/tiny/study.yaml").to_yaml(), encoding="utf-8")
    for name in ("runs/tiny", Path("runs/tiny"), "runs/tiny/study.nc", "tiny", "tiny.yaml"):
        xr.testing.assert_identical(roughvol.open(name), run)
    xr.testing.assert_identical(roughvol.open(), run)  # the latest


def test_what_is_no_run_is_refused_with_its_name(run: Dataset) -> None:
    with pytest.raises(DatasetError, match="no results of 'absent'"):
        roughvol.open("absent")
    Path("other.yaml").write_text("name: tiny\nsurface: {D: 2.3, m: 5, seeds: 2}\n", encoding="utf-8")
    with pytest.raises(FolderError, match=r"surface\.m"):
        roughvol.open("other.yaml")
    file = Path("runs/tiny/study.nc")
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(DatasetError, match=r"truncated.*; to make it anew: roughvol run runs/tiny$"):
        roughvol.open("tiny")


def test_load_of_a_run_leads_to_open(run: Dataset) -> None:
    for name in ("runs/tiny", "runs/tiny/study.nc", "tiny"):
        with pytest.raises(StudyError, match=rf"roughvol\.open\('{name}'\)"):
            roughvol.load(name)
    with pytest.raises(StudyError, match=r"cannot read the study: No such file or directory$"):
        roughvol.load("absent.yaml")


def test_a_saved_dataset_opens_and_draws(here: Path) -> None:
    heights = np.random.default_rng(0).normal(size=(17, 17))
    pressed = roughvol.press(heights, L="500 um", E="10 MPa", nu=0.5, to={"pressure": "0.5 MPa"}, steps=4)
    pressed.to_netcdf("x.nc")
    opened = roughvol.open("x.nc")
    xr.testing.assert_allclose(opened, pressed)
    lines = [roughvol.plot(one, "v_of_p").axes[0].lines[0].get_xydata() for one in ("x.nc", opened, pressed)]
    assert all(np.array_equal(line, lines[0]) for line in lines)
    assert len(said("show", "x.nc", "--csv").splitlines()) == 5


def test_a_saved_run_opens_in_any_format(run: Dataset) -> None:
    run.to_netcdf("all.nc")
    xr.testing.assert_allclose(roughvol.open("all.nc"), run)
    run.to_netcdf("classic.nc", format="NETCDF3_64BIT", engine="scipy")
    assert np.array_equal(roughvol.open("classic.nc").free_volume, run.free_volume)
    assert roughvol.plot({"a": "all.nc", "b": "classic.nc"}, "v_of_p").axes


def test_what_is_no_saved_dataset_is_refused_with_the_reason(run: Dataset) -> None:
    xr.Dataset({"a": ("x", np.arange(3.0))}).to_netcdf("other.nc")
    with pytest.raises(DatasetError, match=r"other\.nc is no dataset of roughvol"):
        roughvol.open("other.nc")
    run.to_netcdf("whole.nc")
    whole = Path("whole.nc").read_bytes()
    Path("cut.nc").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DatasetError, match=r"cut\.nc is damaged or no netCDF file"):
        roughvol.plot("cut.nc")
    Path("text.nc").write_text("no netCDF", encoding="utf-8")
    with pytest.raises(DatasetError, match=r"text\.nc does not end with a checksum"):
        roughvol.open("text.nc")
    stamped = Path("runs/tiny/study.nc").read_bytes()
    altered = bytearray(stamped)
    altered[len(altered) // 2] ^= 1
    Path("copy.nc").write_bytes(altered)
    with pytest.raises(DatasetError, match=r"copy\.nc has been altered"):
        roughvol.open("copy.nc")
    Path("runs/tiny/study.nc").write_bytes(whole)  # saved over the results
    with pytest.raises(DatasetError, match="truncated, or not a file of roughvol"):
        roughvol.open("tiny")
