"""TIFF: one grey value a pixel, sizes from tags that are no defaults of printers, marks in the type of values."""

import logging

import numpy as np
import pytest
import tifffile
from height_files import HEIGHTS, HOLES, put, refusals_of, refused, same

from roughvol.surfaces.files import reading

GREY = HEIGHTS.T.astype("f4")
OME = (
    '<OME><Image><Pixels PhysicalSizeX="0.5" PhysicalSizeY="0.25" %s DimensionOrder="XYZCT" Type="float" SizeX="6" '
    'SizeY="5" SizeZ="1" SizeC="1" SizeT="1" ID="Pixels:0"><TiffData/></Pixels></Image></OME>'
)
REFUSED = {
    "colour": (lambda path: tifffile.imwrite(path, np.zeros((9, 9, 3), "u1")), "allowed: one grey value"),
    "8 bits": (lambda path: tifffile.imwrite(path, np.zeros((9, 9), "u1")), "allowed: one grey value"),
    "noise": (np.random.default_rng(3).bytes(999), "cannot be read as .tif"),
    "empty": (b"", "cannot be read as .tif"),
    "absent": (lambda path: None, "No such file"),
}
test_a_tiff_without_heights_is_refused = refusals_of(REFUSED, "z.tif")


@pytest.mark.parametrize(
    ("tags", "sides", "unit"),
    [
        ({}, None, None),
        ({"resolution": (300, 300), "resolutionunit": "INCH"}, None, None),
        ({"resolution": (5e3, 5e3), "resolutionunit": "CENTIMETER"}, (1e-3, 8e-4), "cm"),
        ({"resolution": (2, 4), "imagej": True, "metadata": {"unit": "um"}}, (2.5, 1.0), "um"),
        ({"resolution": (2, 4), "imagej": True, "metadata": {"unit": "pixel"}}, None, None),
        ({"description": OME % 'PhysicalSizeXUnit="nm"'}, (2.5, 1.0), "nm"),
        ({"description": OME % ""}, (2.5, 1.0), "um"),
        ({"extratags": [(33550, "d", 3, (2.0, 3.0, 0.0), True)]}, (10.0, 12.0), None),
    ],
)
def test_a_tiff_gives_its_size_where_a_tag_is_no_default(tmp_path, tags, sides, unit):
    path = tmp_path / "z.ome.tif"
    tifffile.imwrite(path, GREY, **({"metadata": None} | tags))
    found = reading.describe(path)
    assert (found.sides, found.unit) == (None if sides is None else pytest.approx(sides, rel=1e-6), unit)


def test_a_tiff_with_another_unit_along_y_is_refused(tmp_path):
    path = tmp_path / "z.ome.tif"
    description = OME % 'PhysicalSizeXUnit="nm" PhysicalSizeYUnit="um"'
    tifffile.imwrite(path, GREY, metadata=None, description=description)
    refused(path, "x is in nm, y in um; allowed: one unit for both")
    assert reading.describe(path, ignore_header=True).sides is None


def _without(tag):
    """Return a writer of a TIFF whose tags (all for None) have a data type that does not exist."""

    def write(path):
        tifffile.imwrite(path, GREY, resolution=(2e4, 2e4), resolutionunit="CENTIMETER", metadata=None)
        content = bytearray(path.read_bytes())
        first = int.from_bytes(content[4:8], "little")
        for entry in range(first + 2, first + 2 + 12 * int.from_bytes(content[first : first + 2], "little"), 12):
            if tag in (None, int.from_bytes(content[entry : entry + 2], "little")):
                content[entry + 2 : entry + 4] = (99).to_bytes(2, "little")
        path.write_bytes(bytes(content))

    return write


def test_a_damaged_tiff_is_refused_in_one_message(tmp_path, caplog, capfd):
    refused(put(tmp_path / "z.tif", _without(None)), "allowed: one grey value")
    assert caplog.records == []
    assert capfd.readouterr() == ("", "")


def test_a_tiff_that_is_read_in_spite_of_a_damaged_tag_has_a_note(tmp_path, caplog):
    path = put(tmp_path / "z.tif", _without(282))
    (note,) = reading.describe(path).notes
    assert note.startswith("z.tif is damaged, and read without: ")
    assert "TiffTag 282" in note
    assert np.array_equal(reading.read(path), GREY.T)
    assert caplog.records == []
    logging.getLogger("tifffile").warning("after")  # the log is silent while a file is read alone
    assert [record.message for record in caplog.records] == ["after"]


def test_a_page_is_named_by_its_number(tmp_path):
    path = tmp_path / "z.tif"
    tifffile.imwrite(path, np.stack([GREY, 2.0 * GREY]), photometric="minisblack")
    assert reading.describe(path).notes == ("z.tif has 2 pages; page 0 is read",)
    same(path, 2.0 * HEIGHTS, "1")
    for name in ("2", "first"):
        refused(path, f"has no page '{name}'; allowed: 0 to 1", name)


@pytest.mark.parametrize(
    ("kind", "text", "stored"),
    [
        ("f4", "-3.4028234663852886e+38", -3.4028234663852886e38),
        ("f4", "-3.40282e+38", -3.4028234663852886e38),  # as written with six digits
        ("f4", "-9.9999", -9.9999),
        ("f4", "1e+39", np.inf),  # beyond the type of the image
        ("f4", "nan", np.nan),
        ("i4", "-2147483648", -2147483648),
    ],
)
def test_nodata_is_compared_in_the_type_of_the_image(tmp_path, kind, text, stored):
    path = tmp_path / "z.tif"
    image = np.arange(30).reshape(6, 5).astype(kind)
    image[HOLES] = np.array(stored).astype(kind)
    tifffile.imwrite(path, image.T, extratags=[(42113, "s", 0, text, True)])
    same(path, np.where(HOLES, np.nan, np.arange(30.0).reshape(6, 5)), holes=True)
