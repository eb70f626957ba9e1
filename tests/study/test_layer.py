"""An elastic layer as the material of a study."""

import numpy as np
import pytest
import xarray as xr

import roughvol
from roughvol.errors import StudyError
from roughvol.study import loads
from tests.campaign.kit import values_of

STUDY = """
name: layer
surface: {D: 2.3, m: 4, L: 160 um, Sq: 1 um, seeds: 1, sides: periodic}
material: {E: 10 MPa, nu: 0.3}
sweep: {pressures: [0.2 MPa, 0.5 MPa]}
"""


def pressed(tmp_path, **keys):
    """Return the run of the study with other keys, its lengths in mm."""
    study = loads(STUDY).changed(**{key.replace("__", "."): value for key, value in keys.items()})
    return roughvol.run(study, out=tmp_path / str(len(list(tmp_path.iterdir()))), jobs=1).squeeze()


def test_a_list_of_layers_has_the_numbers_of_each_layer(tmp_path):
    keys, layers = {"material.E": ["10 MPa", "30 MPa"]}, ["20 um", "0.05 mm", "none"]
    every = pressed(tmp_path, **keys, **{"material.thickness": layers})
    assert every.thickness.values.tolist() == [20.0, 50.0, np.inf]
    assert (every.thickness.attrs["units"], every.thickness.attrs["symbol"]) == ("um", "h")
    for label, one in zip(every.thickness, layers, strict=True):
        alone = pressed(tmp_path, **keys, **{"material.thickness": None if one == "none" else one})
        xr.testing.assert_identical(values_of(every.sel(thickness=label, drop=True)), values_of(alone))
    again = loads(every.attrs["study"])
    words = [axis.words(label) for axis in again.axes for label in axis.labels if axis.name == "thickness"]
    assert words == ["thickness = 20 um", "thickness = 50 um", "thickness = none"]


def test_a_layer_thinner_than_a_quarter_of_the_spacing_is_refused_before_the_run(tmp_path):
    words = r"material.thickness: the layer has a thickness of 0.1 spacings.*>= 0.25.*the spacing is 10 um"
    for thickness in ("1 um", ["1 um", "20 um"]):
        with pytest.raises(StudyError, match=words):
            roughvol.check(loads(STUDY).changed(**{"material.thickness": thickness}))
    assert pressed(tmp_path, **{"material.thickness": "1 um", "solver.kernel": "fourier"}).free_volume[-1] > 0.0


HEIGHTS = np.random.default_rng(0).normal(size=(12, 16))
ARGUMENTS = {"L": "80 um", "E": "10 MPa", "nu": 0.49, "sweep": {"pressures": "0.5 MPa"}}


@pytest.mark.parametrize(("thickness", "sides"), [("0.02 mm", "periodic"), (20, "mirrored")])
def test_press_has_the_numbers_of_the_study_of_the_layer(tmp_path, thickness, sides):
    ds = roughvol.press(HEIGHTS, **ARGUMENTS, thickness=thickness, surface={"sides": sides})
    study = {
        "name": "press",
        "surface": {"heights": HEIGHTS, "L": "80 um", "sides": sides},
        "material": {"E": "10 MPa", "nu": 0.49, "thickness": "20 um"},
        "sweep": {"pressures": "0.5 MPa"},
        "record": {"dimensional": {"pressure": "MPa", "mean_gap": "um"}},
    }
    run = roughvol.run(study, out=tmp_path / "run", jobs=1).isel(case=0)
    xr.testing.assert_identical(values_of(ds).drop_attrs(), values_of(run).drop_attrs())
    assert (ds.free_volume > roughvol.press(HEIGHTS, **ARGUMENTS, surface={"sides": sides}).free_volume).all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"surface": {"sides": "free"}}, "argument thickness: a layer needs surface.sides: mirrored or periodic"),
        ({"thickness": "1 MPa"}, "argument thickness: 'MPa' is a unit of pressure, not of length"),
        ({"thickness": "1 um"}, "argument thickness: the layer has a thickness of .* spacings.*>= 0.25"),
        ({"E": None, "nu": None, "E_star": 1.0}, "argument thickness: excluded by 'E_star'"),
    ],
)
def test_press_refuses_a_layer_as_the_study_does(arguments, words):
    with pytest.raises(StudyError, match=f"^press: {words}"):
        roughvol.press(HEIGHTS, **(ARGUMENTS | {"thickness": "20 um"} | arguments))


def test_the_label_of_a_layer_has_no_digits_of_rounding():
    study = loads(STUDY.replace("160 um", "1.6e-4 m")).changed(**{"material.thickness": "50 um"})
    assert study.kernel("m").label == "layer (thickness = 5e-05, nu = 0.3, elements = 1)"
