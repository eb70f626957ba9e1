"""From Python: a map pressed in one call, a study as a dict, a study with changes and from standard input."""

import json
import os
import re
import warnings
from concurrent.futures import ThreadPoolExecutor
from decimal import Decimal
from fractions import Fraction
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pint
import pytest
import xarray as xr
from numpy.testing import assert_allclose

import roughvol
from roughvol.campaign import workers
from roughvol.errors import FolderError, StudyError
from roughvol.store import lock
from roughvol.study import loads, of_data, plain_data
from tests.campaign.kit import noise, table
from tests.kit import call, refused, succeeded

pytestmark = pytest.mark.usefixtures("here")

TINY = "surface: {D: 2.3, m: 4, seeds: 1}\nsweep: {steps: 2, to: {indentation: 1}}\n"
DATA = {"name": "tiny", "surface": {"D": 2.3, "m": 4, "seeds": 1}, "sweep": {"steps": 2, "to": {"indentation": 1}}}
UNITS = pint.get_application_registry()
SEAL: dict[str, Any] = {"L": "500 um", "E": "10 MPa", "nu": 0.5}


def _heights() -> np.ndarray:
    x = np.linspace(0.0, 2.0 * np.pi, 17)
    return np.sin(x)[:, None] + np.cos(3.0 * x)[None, :]


def test_press_gives_numbers_in_units_and_leaves_nothing_on_disk() -> None:
    ds = roughvol.press(_heights(), **SEAL, to={"pressure": "0.1 MPa"}, steps=1)
    assert_allclose(float(ds.nominal_pressure[-1]), 0.1, rtol=1e-5)
    assert ds.nominal_pressure.units == "MPa"
    assert ds.mean_gap.units == "um"
    assert_allclose(ds.mean_gap, ds.free_volume * ds.Sq)
    expected = 0.1 * 500 / (10 / 0.75 * float(ds.Sq))
    assert_allclose(float(ds.mean_pressure[-1]), expected, rtol=1e-5)
    assert os.listdir() == []  # noqa: PTH208


def test_threads_that_press_at_once_have_the_numbers_of_one_thread() -> None:
    """They shared one half space: most of them ended in solutions of NaN."""
    maps = [noise(seed, 33, 33) for seed in range(4)]

    def volumes(heights: Any) -> list[float]:
        return roughvol.press(heights, L=100.0, to={"contact_area": 0.4}, steps=2).free_volume.values.tolist()

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(volumes, maps)) == [volumes(heights) for heights in maps]


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_fork_of_a_process_that_has_pressed_presses_too() -> None:
    """It waited without end for threads of its parent: those of the half space, and a thread that presses."""
    options: dict[str, Any] = {"L": 100.0, "steps": 2}
    roughvol.press(noise(0, 60, 60), **options)
    fork = get_context("fork").Process(target=roughvol.press, args=(noise(0, 60, 60),), kwargs=options)
    with ThreadPoolExecutor(1) as pool:
        pool.submit(workers._one_at_a_time.acquire).result()  # as a thread that presses at the fork
        fork.start()
        fork.join(20)
        fork.kill()
        pool.submit(workers._one_at_a_time.release).result()
    assert fork.exitcode == 0


def test_a_dict_is_a_study() -> None:
    ds = roughvol.run(DATA, jobs=1)
    again = roughvol.run(load_text(), out="other", jobs=1)
    assert (ds.free_volume.values == again.free_volume.values).all()
    assert Path("runs/tiny/study.nc").is_file()
    finer = roughvol.run("tiny", jobs=1, changes={"name": "finer", "surface.m": 5})  # the study of a run
    assert finer.m.values.tolist() == roughvol.open("finer").m.values.tolist() == [5]
    Path("other/study.nc").unlink()
    assert (roughvol.run(Path("other"), jobs=1).free_volume.values == ds.free_volume.values).all()
    assert Path("other/study.nc").is_file()  # in its folder, not in that of its name
    with pytest.raises(StudyError, match=r'^run: study\["surface"\]\["D"\]: must be < 3, given 9'):
        roughvol.run({"surface": {"D": 9, "m": 4}})


def load_text() -> Path:
    Path("tiny.yaml").write_text(TINY, encoding="utf-8")
    return Path("tiny.yaml")


@pytest.mark.parametrize(("change", "part"), table("changes"))
def test_a_change_without_meaning_is_refused(change: str, part: str) -> None:
    assert part in refused("run", load_text(), "--set", change)


def test_a_study_comes_from_standard_input() -> None:
    succeeded("run", "-", "--set", "name=piped", "--jobs", "1", input=TINY)
    assert Path("runs/piped/study.nc").is_file()
    assert "<stdin>:1: surface.D" in call("check", "-", input="surface: {D: 9, m: 3}").stderr


OBJECTS = [
    {"E": 10 * UNITS.MPa, "nu": np.float64(0.5), "L": 500 * UNITS.micrometer, "to": {"pressure": 0.1 * UNITS.MPa}},
    {"E": 0.01 * UNITS.GPa, "nu": np.float32(0.5), "L": 0.5 * UNITS.mm, "to": {"pressure": 1.0 * UNITS.bar}},
    {"E": "10 MPa", "nu": Fraction(1, 2), "L": "500 um", "to": {"pressure": xr.DataArray(0.1, attrs={"units": "MPa"})}},
    {"E": "10 MPa", "nu": Decimal("0.5"), "L": "500 um", "to": {"pressure": "0.1 MPa"}},
    {"E": np.str_("10 MPa"), "nu": np.array(0.5), "L": "500 µm", "to": {"pressure": "0.1 MPa"}, "steps": np.int64(1)},
]


def test_numbers_of_other_libraries_are_numbers() -> None:
    expected = roughvol.press(_heights(), **SEAL, to={"pressure": "0.1 MPa"}, steps=1)
    for options in OBJECTS:
        ds = roughvol.press(_heights(), **{"steps": 1, "surface": {"heights_unit": "um"}, **options})
        assert_allclose(ds.free_volume, expected.free_volume, rtol=1e-6)
        assert_allclose(ds.nominal_pressure[-1] * {"MPa": 1.0, "GPa": 1e3}[ds.nominal_pressure.units], 0.1, rtol=1e-5)


def test_a_dict_holds_objects_of_numpy_pint_and_pathlib() -> None:
    np.save("z.npy", _heights())
    data = {
        "name": "objects",
        "surface": {"file": Path("z.npy"), "L": 500 * UNITS.um},
        "material": {"E": 10 * UNITS.MPa, "nu": np.float64(0.5)},
        "sweep": {"pressures": np.array([0.05, 0.1]) * UNITS.MPa},
        "record": {
            "fields_at": {"contact_area": np.array([0.01, 0.02])},
            "heights": np.bool_(True),
            "dimensional": {"pressure": UNITS.MPa, "free_volume": UNITS.mm**3 / UNITS.m**2},
        },
    }
    text = """
name: objects
surface: {file: z.npy, L: 500 µm}
material: {E: 10 MPa, nu: 0.5}
sweep: {pressures: [0.05 MPa, 0.1 MPa]}
record:
  fields_at: {contact_area: [0.01, 0.02]}
  heights: true
  dimensional: {pressure: MPa, free_volume: mm**3/m**2}
"""
    assert of_data(data) == loads(text)
    made = {"surface": {"D": np.linspace(2.1, 2.9, 3), "m": np.int8(4), "seeds": range(2)}}
    assert of_data(made) == loads("surface: {D: [2.1, 2.5, 2.9], m: 4, seeds: [0, 1]}")


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (1j, "complex"),
        ({1, 2}, "set"),
        (object(), "object"),
        (np.datetime64("2026-01-01"), "times of numpy"),
        (np.timedelta64(3, "s"), "times of numpy"),
        (np.array([3], "timedelta64[ns]"), "times of numpy"),
        (b"2.3", "bytes"),
        ([2.3, None], "given nothing"),
        (np.nan, "finite"),
        (10**5000, "finite number"),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_what_is_no_plain_data_is_refused_at_its_place(value: object, reason: str) -> None:
    with pytest.raises(StudyError, match=rf'^run: study\["surface"\]\["D"\](\[1\])?: .*{reason}'):
        roughvol.run({"surface": {"D": value, "m": 4}})


def test_problems_of_a_dict_name_keys_and_no_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plain_data, "MAX_BYTES", 2000)
    np.savetxt("z.txt", _heights())
    loop: dict[str, Any] = {"surface": {}}
    loop["surface"]["surface"] = loop
    for data, start in (
        ({"surface": {"m": 4}}, 'run: study["surface"]["D"]: missing'),
        (
            {"surface": {"D": 2.3, "m": 4}, "sweep": [{"steps": 2}, {"to": {"pressure": -1}}]},
            'run: study["sweep"][1]["to"]["pressure"]: must be >= 0, given -1',
        ),
        ({1: 2, "surface": {"D": 2.3, "m": 4}}, 'run: study["1"]: a key must be text, given 1 of the type int'),
        (loop, "run: study: nested too deep"),
        ({"surface": {"D": 2.3, "m": 4}, "comment": "n" * 2000}, "run: study: larger than"),
        ({"surface": {"file": "absent.npy", "L": 1}}, 'run: study["surface"]["file"]: no such file'),
        ({"surface": {"file": "z.txt"}, "sweep": {"steps": 2}}, 'run: study["surface"]["L"]: missing'),
    ):
        with pytest.raises(StudyError) as caught:
            roughvol.run(data)  # type: ignore[arg-type]
        assert str(caught.value).startswith(start)
        assert "<dict>" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"L": "5 apples"}, "L"),
        ({"L": np.array([1.0, 2.0])}, "L"),
        ({"E": "10 apples"}, "E"),
        ({"E": 1, "E_star": 2}, "E_star"),
        ({"nu": 7}, "nu"),
        ({"E": -1.0}, "E"),
        ({"hardness": 0}, "hardness"),
        ({"to": {"presure": 1}}, r'to\["presure"\]'),
        ({"to": "mean"}, "to"),
        ({"steps": -1}, "steps"),
        ({"sweep": {"steps": "x"}}, r'sweep\["steps"\]'),
        ({"record": {"texture": 3}}, r'record\["texture"\]'),
        ({"record": "texture"}, "record"),
        ({"fluid": {"gas": "helium"}}, r'fluid\["inlet"\]'),
        ({"solver": {"rtol": 2}}, r'solver\["rtol"\]'),
        ({"surface": {"level": "tile"}}, r'surface\["level"\]'),
        ({"surface": "tilt"}, "surface"),
        # an argument in two places
        ({"surface": {"L": 2}}, r'surface\["L"\]'),
        ({"surface": {"file": "x.npy"}}, r'surface\["file"\]'),
        ({"sweep": {"steps": 3}, "steps": 2}, "steps"),
        ({"record": {"dimensional": {"leak_rate": {"viscosity": 1}}}}, r'record\["dimensional"\]\["leak_rate"\]'),
    ],
)
def test_errors_of_press_name_its_arguments(options: dict[str, Any], argument: str) -> None:
    with pytest.raises(StudyError) as caught:
        roughvol.press(_heights(), **{"L": 1, "E": 1, "nu": 0.3, **options})
    assert re.search(rf"^press: argument {argument}(?!\w)", str(caught.value), re.M), str(caught.value)
    for word in ("<dict>", "/tmp", "--", ".npy"):
        assert word not in str(caught.value)


def test_doubts_are_warnings_of_one_class() -> None:
    """The limits of the model, once each, at the line of the caller."""
    heights = 100.0 * _heights()
    with pytest.warns(roughvol.RoughvolWarning) as seen:
        ds = roughvol.press(heights, **SEAL, steps=1)
    assert [str(one.message) for one in seen] == ds.attrs["warnings"].splitlines() != []
    assert any("rms slope" in str(one.message) for one in seen)
    assert {Path(one.filename).name for one in seen} == {Path(__file__).name}
    np.save("z.npy", heights)
    study = {"name": "steep", "surface": {"file": "z.npy", "L": "500 um"}, "sweep": {"steps": 1}}
    with pytest.warns(roughvol.RoughvolWarning, match="rms slope") as seen:
        ds = roughvol.run(study, jobs=1)
    assert [str(one.message) for one in seen] == ds.attrs["warnings"].splitlines()
    assert {Path(one.filename).name for one in seen} == {Path(__file__).name}
    assert issubclass(roughvol.RoughvolWarning, UserWarning)
    Path("steep.json").write_text(json.dumps(study), encoding="utf-8")
    with warnings.catch_warnings(action="error", category=roughvol.RoughvolWarning):  # printed, and once
        assert call("run", "steep.json", "--jobs", 1).stderr.count("rms slope") == 1


def test_files_set_aside_and_long_runs_are_warnings_too() -> None:
    roughvol.run(DATA, jobs=1)
    (file,) = Path("runs/tiny/cases").glob("*.nc")
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.warns(roughvol.RoughvolWarning, match=r"^set aside: .*truncated"):
        roughvol.run(DATA, jobs=1)


def test_press_keeps_the_gap_beside_other_numbers_with_units() -> None:
    dimensional = {"separation": "um", "pressure": "bar"}
    ds = roughvol.press(_heights(), **SEAL, steps=1, record={"dimensional": dimensional})
    assert (ds.nominal_pressure.units, ds.mean_gap.units, ds.mean_plane_separation.units) == ("bar", "um", "um")
    assert_allclose(ds.mean_gap, ds.free_volume * ds.Sq)


def test_nu_is_stated_where_press_takes_it_by_default() -> None:
    with pytest.warns(roughvol.RoughvolWarning, match=r"argument nu is not given: 0\.3 is taken"):
        ds = roughvol.press(_heights(), L="500 um", E="10 MPa", steps=1)
    assert "nu: 0.3" in ds.attrs["study"]
    assert "nu is not given" in ds.attrs["warnings"]
    given = roughvol.press(_heights(), L="500 um", E="10 MPa", nu=0.3, steps=1)
    assert "nu" not in given.attrs["warnings"]
    assert_allclose(ds.nominal_pressure, given.nominal_pressure)
    assert "nu" not in roughvol.press(_heights(), L=500, steps=0).attrs["warnings"]
    with pytest.raises(StudyError, match="nu: missing"):
        loads("surface: {D: 2.3, m: 4}\nmaterial: {E: 10 MPa}")


def test_a_folder_that_cannot_be_used_is_explained_by_arguments() -> None:
    roughvol.run(DATA, jobs=1)
    for other in ({**DATA, "sweep": {"steps": 3}}, loads("name: tiny\n" + TINY.replace("steps: 2", "steps: 3"))):
        with pytest.raises(FolderError, match="from Python: out=FOLDER, fresh=True"):
            roughvol.run(other, jobs=1)
    with lock.opened(Path("runs/tiny")), pytest.raises(FolderError, match=r"from Python out=FOLDER$"):
        roughvol.run(DATA, jobs=1)
