"""Stored files: what is written comes back, is described, is whole or not there; cases align by label."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_array_equal
from xarray.backends import NetCDF4DataStore

from roughvol.campaign.one_case import run_case
from roughvol.errors import DatasetError, FolderError
from roughvol.observables.variables import VARIABLES
from roughvol.store import dataset, provenance, run_folder, stamped_file
from roughvol.store.dataset import Dataset
from roughvol.study import Case, loads
from tests.kit import python
from tests.refused import refusals

FFT = {"library": "FFTW", "planner": "FFTW_ESTIMATE", "threads": "1"}
STEPS = 3


def _case(D: float = 2.3, m: int = 3, seed: int = 0, L: float = 100.0) -> Case:
    return loads(f"surface: {{D: {D}, m: {m}, seeds: [{seed}], L: {L}}}\nsweep: {{steps: {STEPS}}}").cases()[0]


def _values(m: int, seed: int = 0) -> dict[str, Any]:
    random = np.random.default_rng(seed)
    nodes, states = 2**m + 1, ["step=2", "contact_area=0.9"]
    per_step = {name: random.random(STEPS) for name, row in VARIABLES.items() if row.dims == "... step"}
    counts = [name for name in per_step if VARIABLES[name].kind == "count"]
    return {
        **per_step,
        **{name: random.integers(1, 9, STEPS) for name in counts},
        "converged": [True, True, False],
        "step": np.arange(1, STEPS + 1),
        "Sq": random.random(),
        "wall_time": 0.5,
        "x": np.arange(nodes) / (nodes - 1),
        "y": np.arange(nodes) / (nodes - 1),
        "heights": random.random((nodes, nodes)),
        "field_at": states,
        "field_at_step": [2, -1],
        "gap": np.stack([random.random((nodes, nodes)), np.full((nodes, nodes), np.nan)]),
        "box_at": ["last"],
        "box_at_step": [STEPS],
        "threshold": [0.0, 1.0],
        "r": 2 ** np.arange(m + 1),
        "box_count": random.integers(1, 99, (1, 2, m + 1)),
    }


def _build(D: float = 2.3, m: int = 3, seed: int = 0, L: float = 100.0) -> Dataset:
    case = _case(D, m, seed, L)
    return dataset.build(case, _values(m, seed), provenance.provenance("name: x\n", fft=FFT, cases=[case]))


def _of_study() -> dict[str, str]:
    return provenance.provenance("", fft=FFT, cases=[_case()], ids=["a"])


def test_table_is_complete_and_names_differ_by_more_than_case() -> None:
    assert all(row.units and row.long_name and row.symbol for row in VARIABLES.values())
    assert len({name.lower() for name in VARIABLES}) == len(VARIABLES)
    assert {row.kind for row in VARIABLES.values()} == {"real", "count", "index", "flag", "text"}
    dims = {dim for row in VARIABLES.values() for dim in row.dims.split()} - {"..."}
    assert all(VARIABLES[dim].dims == dim for dim in dims)


def test_whatever_is_stored_is_described_for_plain_xarray(tmp_path: Path) -> None:
    dataset.write(dataset.combine([_build(), _build(m=2)], _of_study()), tmp_path / "a.nc")
    with xr.open_dataset(tmp_path / "a.nc") as opened:
        for name, variable in opened.variables.items():
            row = VARIABLES[str(name)]
            assert (variable.attrs["units"], variable.attrs["symbol"]) == (row.units, row.symbol)
            assert variable.attrs["long_name"]
        assert set(opened.coords) >= {"D", "m", "seed", "step", "L", "x", "y", "field_at"}


def test_counts_are_integers_on_disk_and_missing_ones_are_not_a_number(tmp_path: Path) -> None:
    whole = dataset.combine([_build(m=3, seed=0), _build(m=2, seed=1)], {"format": dataset.FORMAT})
    dataset.write(whole, tmp_path / "a.nc")
    with netCDF4.Dataset(tmp_path / "a.nc") as raw:
        assert raw["iterations"].dtype == np.dtype("int32")
    stored = dataset.read(tmp_path / "a.nc")
    assert stored.iterations.sel(m=3, seed=0).notnull().all()
    assert stored.iterations.sel(m=3, seed=1).isnull().all()


def test_box_counts_of_a_period_are_means_also_on_disk(tmp_path: Path) -> None:
    case = loads(
        "{surface: {D: 2.3, m: 3, seeds: 1, sides: periodic}, sweep: {steps: 2, to: {contact_area: 0.1}}, "
        "record: {box_counting: {at: last}}}"
    ).cases()[0]
    result = run_case(case)
    counts = result["box_count"].sel(threshold=0.0).squeeze()
    assert float(counts.sel(r=4)) % 1.0 > 0.0  # the mean over all positions of the boxes
    dataset.write(result, tmp_path / "a.nc")
    assert_array_equal(dataset.read(tmp_path / "a.nc")["box_count"], result["box_count"])


def test_combine_aligns_by_label_and_says_what_is_missing() -> None:
    coarse, fine = _build(D=2.7, m=2, seed=4), _build(D=2.1, m=3, seed=0)
    both = dataset.combine([coarse, fine], {})
    assert dict(both.sizes) == {
        **{"D": 2, "m": 2, "seed": 2, "step": STEPS, "x": 9, "y": 9},
        **{"field_at": 2, "box_at": 1, "threshold": 2, "r": 4},
    }
    for part in (coarse, fine):
        for name, stored in part.data_vars.items():
            labels = {str(dim): part[dim] for dim in stored.dims}
            assert_array_equal(both[name].sel(labels), stored)
    nowhere = both.sel(D=2.7, m=3, seed=0)
    assert nowhere.free_volume.isnull().all()
    assert not nowhere.converged.any()
    assert (nowhere.field_at_step == -1).all()
    assert both.converged.dtype == bool
    # a coarse lattice lies on every other node of the fine one
    on_coarse = (np.indices((9, 9)) % 2 == 0).all(axis=0)
    assert_array_equal(both.heights.sel(D=2.7, m=2, seed=4).notnull(), on_coarse)


def test_combining_does_not_depend_on_the_order_of_the_cases() -> None:
    parts = [_build(D=D, seed=seed) for D in (2.1, 2.5) for seed in (0, 3)]
    xr.testing.assert_identical(dataset.combine(parts, {}), dataset.combine(parts[::-1], {}))


test_what_is_no_dataset_of_one_study_is_refused = refusals(
    DatasetError,
    (lambda: dataset.combine([_build(), _build(seed=1, L=1.0)], {}), "share L, got 1, 100"),
    (lambda: dataset.combine([], {}), "no case"),
    (lambda: dataset.build(_case(), {"free_volme": [1.0]}, {}), "'free_volme' is not a stored variable"),
    (lambda: dataset.build(_case(), {"Sq": [1.0]}, {}), r"Sq has dimensions \(D, m, seed\)"),
)


def test_provenance_names_study_case_code_machine_and_reference() -> None:
    case = _case()
    attributes = provenance.provenance("name: x\n", fft=FFT, cases=[case])
    assert json.loads(attributes["case"]) == json.loads(json.dumps(case.key))
    libraries = {"python", "numpy", "scipy", "pyfftw", "numba", "xarray", "netCDF4"}
    assert set(json.loads(attributes["libraries"])) >= libraries
    assert json.loads(attributes["fft"]) == FFT
    assert "10.1016/j.wear.2015.04.021" in attributes["references"]
    assert all(attributes[name] for name in ("roughvol_version", "study", "host", "cpu_count", "date", "conventions"))
    assert attributes["date"].endswith("+00:00")


def test_foreign_and_missing_files_are_errors(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no dataset at"):
        dataset.read(tmp_path / "nothing.nc")
    with pytest.raises(DatasetError, match="no dataset at"):
        dataset.read(tmp_path)
    (tmp_path / "text.nc").write_text("this is no netCDF file")
    (tmp_path / "empty.nc").touch()
    xr.Dataset({"a": 1.0}).to_netcdf(tmp_path / "foreign.nc")
    for name in ("text.nc", "empty.nc", "foreign.nc"):
        with pytest.raises(DatasetError, match=f"{name} does not end with a checksum"):
            dataset.read(tmp_path / name)
    content = stamped_file.stamped((tmp_path / "foreign.nc").read_bytes(), {})
    (tmp_path / "foreign.nc").write_bytes(content)
    with pytest.raises(DatasetError, match="format is None"):
        dataset.read(tmp_path / "foreign.nc")


def test_what_is_no_netcdf_behind_a_sound_stamp_is_an_error(tmp_path: Path) -> None:
    labels = run_folder.labels_for(_case())
    for content in (b"", b"nothing", b"CDF", b"CDF\x02", b"CDF\x02" + 90 * b"\x00\xff\x0b", b"\x89HDF\r\n\x1a\n"):
        (tmp_path / "a.nc").write_bytes(stamped_file.stamped(content, labels))
        with pytest.raises(DatasetError, match=r"a\.nc is damaged or no"):
            dataset.read_arrays(tmp_path / "a.nc")
    with pytest.raises(DatasetError, match=r"a\.nc is damaged or no"):
        dataset.read(tmp_path / "a.nc")


def test_every_flipped_bit_is_found_before_the_file_is_parsed(tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    dataset.write(_build(), path)
    content = path.read_bytes()
    for place in np.random.default_rng(3).integers(0, 8 * len(content), 50).tolist():
        spoilt = bytearray(content)
        spoilt[place // 8] ^= 1 << place % 8
        path.write_bytes(spoilt)
        with pytest.raises(DatasetError, match=r"a\.nc (has been altered|ends with|does not end with)"):
            dataset.read_arrays(path)


@pytest.mark.parametrize("large", [False, True])
def test_plain_arrays_are_those_of_the_dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, large: bool) -> None:
    if large:
        monkeypatch.setattr(dataset, "SMALL", 0)
    dataset.write(_build(), tmp_path / "a.nc")
    assert (tmp_path / "a.nc").read_bytes().startswith(b"\x89HDF" if large else b"CDF")
    (arrays, _, _), stored = dataset.read_arrays(tmp_path / "a.nc"), dataset.read(tmp_path / "a.nc")
    xr.testing.assert_identical(dataset.combine([arrays], stored.attrs), dataset.combine([stored], stored.attrs))
    xr.testing.assert_identical(dataset.combine([arrays], stored.attrs), stored)


def test_a_file_is_read_as_xarray_reads_it(tmp_path: Path) -> None:
    parts = [dataset.build(_case(D, 3), _values(3), {}) for D in (2.3, 2.7)]
    dataset.write(dataset.combine(parts, {"format": stamped_file.FORMAT, "case": "{}"}), path := tmp_path / "study.nc")
    plain = tmp_path / "plain.nc"
    plain.write_bytes(stamped_file.verified(path)[0])
    found, expected = dataset.read(path), xr.load_dataset(plain, engine="netcdf4")
    xr.testing.assert_identical(found, expected)
    assert list(found.variables) == list(expected.variables)
    for name, index in expected.indexes.items():
        assert (found.indexes[name].dtype, found[name].encoding.get("_FillValue")) == (
            index.dtype,
            expected[name].encoding.get("_FillValue"),
        )


def test_texts_and_seeds_of_any_size_are_stored(tmp_path: Path) -> None:
    case = _case(seed=2**62 + 1)
    values = _values(3) | {"field_at": ["höhe = 1 µm", "a"]}
    for built in (dataset.build(case, values, {"case_id": "a"}), dataset.build(_case(), values, {"case_id": "a"})):
        built.attrs["format"] = dataset.FORMAT
        dataset.write(built, tmp_path / "a.nc")
        arrays, _, _ = dataset.read_arrays(tmp_path / "a.nc")
        assert arrays["seed"][1].tolist() == built.seed.values.tolist()
        assert arrays["field_at"][1].tolist() == ["höhe = 1 µm", "a"]
        xr.testing.assert_identical(dataset.read(tmp_path / "a.nc"), built)


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()], ids=["disk", "ctrl-c"])
def test_a_broken_write_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    dataset.write(_build(), tmp_path / "a.nc")
    before = (tmp_path / "a.nc").read_bytes()

    def half(handle: int) -> None:
        raise error

    monkeypatch.setattr(os, "fsync", half)
    with pytest.raises((FolderError, KeyboardInterrupt), match=r"^$|No space left on device"):
        dataset.write(_build(seed=1), tmp_path / "a.nc")
    assert (tmp_path / "a.nc").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["a.nc"]


def test_leftovers_of_dead_processes_are_removed_and_nothing_else(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    alive = stamped_file.aside_of(tmp_path / "a.nc").name
    names = {alive, alive.replace(str(os.getpid()), str(dead.pid)), f".a.nc.elsewhere.{os.getpid()}.part"}
    others = {".mine.part", "a.nc", ".a.nc.x.y.part", ".study.nc.host.².part"}
    for name in names | others:
        (tmp_path / name).touch()
    stamped_file.remove_leftovers(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {alive} | others


def test_a_small_file_is_what_xarray_would_write(tmp_path: Path) -> None:
    text = "surface: {D: 2.3, m: 3, seeds: 1}\nsweep: {steps: 3}\nrecord: {transport: {percolation: every-step}}"
    case = loads(text).cases()[0]
    built = run_case(case)
    store = netCDF4.Dataset("memory.nc", "w", format="NETCDF3_64BIT_OFFSET", memory=4096)
    built.dump_to_store(NetCDF4DataStore(store), encoding=dataset._encoding(built))
    (tmp_path / "xarray.nc").write_bytes(bytes(store.close()))
    dataset.write(built, tmp_path / "ours.nc")
    theirs, ours = (xr.load_dataset(tmp_path / f"{name}.nc") for name in ("xarray", "ours"))
    xr.testing.assert_identical(theirs, ours)
    for name, variable in theirs.variables.items():
        assert variable.encoding.keys() == ours[name].encoding.keys()
        assert variable.encoding["dtype"] == ours[name].encoding["dtype"]


def test_the_file_of_a_case_does_not_need_a_dataset(monkeypatch: pytest.MonkeyPatch) -> None:
    case, attributes = _case(), provenance.provenance("name: x\n", fft=FFT, cases=[_case()])
    for most in (dataset.SMALL, 0):
        monkeypatch.setattr(dataset, "SMALL", most)
        built = dataset.to_bytes(dataset.build(case, _values(3), attributes))
        direct = dataset.case_bytes(case, _values(3), attributes)
        assert direct.startswith(b"CDF" if most else b"\x89HDF")
        assert len(direct) == len(built)
        assert direct == built or not most


def test_variables_of_an_older_version_along_x_and_y_are_joined(tmp_path: Path) -> None:
    """Names of version 0.13: a suffix for each direction, and `axis` for the coordinates of a position."""
    step, labels = np.array([1, 2]), np.array(["x", "y"], dtype=object)
    rate, words = np.array([3.0, 1.0, 4.0, 2.0]).reshape(2, 1, 1, 1, 2), {"units": "mm^3/s", "viscosity": "1 mPa*s"}
    old = {f"leak_rate_{axis}": (("D", "m", "seed", "step"), rate[k], words) for k, axis in enumerate("xy")}
    flux = np.arange(24.0).reshape(2, 1, 1, 1, 1, 3, 4)
    old |= {f"flux_{axis}": (("D", "m", "seed", "flux_at", "x", "y"), flux[k]) for k, axis in enumerate("xy")}
    place = np.arange(8.0).reshape(2, 1, 1, 1, 2, 2)
    old |= {f"critical_position_{a}": (("D", "m", "seed", "step", "axis"), place[k]) for k, a in enumerate("xy")}
    old["nodes_x"] = old["nodes_y"] = (("D", "m", "seed"), np.full((1, 1, 1), 5.0))
    coords = {"D": [2.3], "m": [2], "seed": [0], "step": step, "axis": labels, "flux_at": ["last"]}
    Dataset(old, coords=coords, attrs={"format": dataset.FORMAT}).to_netcdf(tmp_path / "saved.nc")
    read = dataset.read(tmp_path / "saved.nc", saved=True)
    assert set(read.data_vars) == {"leak_rate", "flux", "critical_position", "nodes_x", "nodes_y"}
    assert_array_equal(read.leak_rate.sel(axis="y").values.ravel(), [4.0, 2.0])
    assert words.items() <= read.leak_rate.attrs.items()
    assert_array_equal(read.flux.sel(axis="x").values.ravel(), flux[0].ravel())
    assert_array_equal(read.critical_position.sel(axis="y", coordinate="x").values.ravel(), [4.0, 6.0])
    for name in ("leak_rate", "flux", "critical_position"):
        assert " ".join(map(str, read[name].dims)) == VARIABLES[name].dims.replace("...", "D m seed")


THREADS = """
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import xarray as xr

from roughvol.store import dataset
from roughvol.surfaces.files import memory, reading


def turn(number):
    folder = Path(sys.argv[1]) / str(number)
    folder.mkdir()
    whole = xr.Dataset({f"v{k}": ("x", np.full(9, number + k)) for k in range(9)}, attrs={"format": "roughvol 1"})
    heights = xr.DataArray(np.full((5, 5), float(number)), dims=("x", "y"))
    for _ in range(4):
        dataset.write(whole, folder / "study.nc")
        assert dataset.read(folder / "study.nc").equals(whole)
        assert (reading.read(memory.write(heights, folder)) == number).all()
    return number


with ThreadPoolExecutor(4) as pool:
    assert list(pool.map(turn, range(4))) == list(range(4))
"""


def test_threads_write_and_read_at_once(tmp_path: Path) -> None:
    """In a process of its own: netcdf-c crashes where two threads are in it."""
    python("-c", THREADS, tmp_path)
