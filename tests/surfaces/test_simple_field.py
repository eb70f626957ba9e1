"""Gwyddion Simple Field: a size is that of all pixels, and what is damaged or no map of heights is refused by name."""

import pytest
from height_files import HEIGHTS, put, refusals_of, same, simple_field

from roughvol.surfaces.files import reading

FIELD = simple_field(HEIGHTS, "um")


def test_a_field_without_size_has_none(tmp_path):
    bare = FIELD.replace(b"XReal", b"Other")
    path = put(tmp_path / "z.gsf", bare)
    same(path, HEIGHTS)
    assert reading.describe(path).sides is None


@pytest.mark.parametrize("key", ["Title", "XYUnits", "ZUnits"])
def test_an_empty_field_of_the_header_takes_no_other(tmp_path, key):
    described, plain = (
        reading.describe(put(tmp_path / f"{name}.gsf", simple_field(HEIGHTS, "um", **{key: value})))
        for name, value in (("empty", ""), ("plain", "x" if key == "Title" else "um"))
    )
    assert described.sides == plain.sides
    assert described.shape == plain.shape


REFUSED = {
    "cut": (FIELD[:-4], "holds 116 bytes of heights; its header gives 6 x 5 of 4 bytes each"),
    "no nodes": (FIELD.replace(b"XRes = 6", b"XRes = 0"), "needed: XRes and YRes, whole numbers above 0"),
    "misspelt": (FIELD.replace(b"YRes", b"YSer"), "its header gives XRes, YSer, .* needed: XRes and YRes"),
    "a word": (simple_field(HEIGHTS, "um", XReal="wide"), "XReal wide, YReal 2.5; allowed: numbers"),
    "negative": (simple_field(HEIGHTS, "um", XReal=-1.0), "makes sides of -0.83.* by 2; allowed: finite and above 0"),
    "volts": (simple_field(HEIGHTS, "um", ZUnits="V"), "ZUnits has the unit 'V'; allowed: pm"),
    "phase": (simple_field(HEIGHTS, "um", Title="Phase"), "the field 'Phase' holds no heights, by its name"),
}
test_what_is_no_field_of_heights_is_refused = refusals_of(REFUSED, "z.gsf")
