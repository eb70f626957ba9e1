"""TIFF: one grey value a pixel, sizes from tags that are no defaults of printers, marks in the type of values."""

import numpy as np
import pytest
import tifffile
from height_files import HEIGHTS, HOLES, put, refused, same

from roughvol.surfaces.files import reading

GREY = HEIGHTS.T.astype("f4")
OME = (
    '<OME><Image><Pixels PhysicalSizeX="0.5" PhysicalSizeY="0.25" %s DimensionOrder="XYZCT" Type="float" SizeX="6" '
    'SizeY="5" SizeZ="1" SizeC="1" SizeT="1" ID="Pixels:0"><TiffData/></Pixels></Image></OME>'
)
REFUSED = {
    "colour": ("allowed: one grey value", lambda path: tifffile.imwrite(path, np.zeros((9, 9, 3), "u1"))),
    "8 bits": ("allowed: one grey value", lambda path: tifffile.imwrite(path, np.zeros((9, 9), "u1"))),
    "noise": ("cannot be read as .tif", np.random.default_rng(3).bytes(999)),
    "empty": ("cannot be read as .tif", b""),
    "absent": ("No such file", lambda path: None),
}


@pytest.mark.parametrize("name", list(REFUSED))
def test_a_tiff_without_heights_is_refused(tmp_path, name):
    pattern, content = REFUSED[name]
    refused(put(tmp_path / "z.tif", content), pattern)


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
