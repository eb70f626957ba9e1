"""Grids of Surfer: text, Surfer 6 and Surfer 7, written as their descriptions have them, and read back."""

import struct

import numpy as np
import pytest
from height_files import HEIGHTS, HOLED, put, refusals_of, same, surfer_6, surfer_7, surfer_text

from roughvol.surfaces.files import reading
from tests.study.kit import surface_of

WRITERS = {"text": surfer_text, "Surfer 6": surfer_6, "Surfer 7": surfer_7}


@pytest.mark.parametrize("kind", list(WRITERS))
@pytest.mark.parametrize("suffix", [".GRD", ""])
def test_a_grid_has_its_axes_and_limits(tmp_path, kind, suffix):
    path = put(tmp_path / f"z{suffix}", WRITERS[kind](HOLED, (2.0, 4.5), (-1.0, 3.0)))
    found = reading.describe(path)
    assert (found.shape, found.sides) == ((6, 5), pytest.approx((2.5, 4.0), rel=1e-15))
    assert (found.unit, found.heights_unit, found.counted) == (None, None, False)
    assert found.reader == f"Surfer grid, {kind}"


@pytest.mark.parametrize("kind", list(WRITERS))
def test_coordinates_that_count_nodes_are_no_lengths(tmp_path, kind):
    path = put(tmp_path / "z.grd", WRITERS[kind](HEIGHTS, (0.0, 5.0), (0.0, 4.0)))
    assert reading.describe(path).counted
    surface = surface_of(tmp_path, "file: z.grd, L: 10 um, heights_unit: nm")
    assert (surface.side, surface.spacing) == (10.0, 2.0)
    assert np.abs(surface.heights - 1e-3 * HEIGHTS).max() < 1e-15


def test_numbers_of_a_text_may_run_over_lines_and_unknown_sections_are_passed_over(tmp_path):
    same(put(tmp_path / "text.grd", b"\r\n".join(surfer_text(HEIGHTS).split())), HEIGHTS)
    content = surfer_7(HEIGHTS, between=struct.pack("<4si7s", b"FLTI", 7, b"faults.")) + b"TAIL\3\0\0\0end"
    same(put(tmp_path / "z.grd", content), HEIGHTS)


@pytest.mark.parametrize(("version", "high"), [(1, np.nan), (2, 9.0)])
def test_the_blank_of_surfer_7_is_that_of_the_grid(tmp_path, version, high):
    """Version 1: blank at and above the value; version 2: at the value."""
    heights = np.where(np.arange(30).reshape(6, 5) == 0, 9.0, np.minimum(HOLED, 3.0))
    path = put(tmp_path / "z.grd", surfer_7(heights, version=version, blank=5.0))
    same(path, np.where(heights == 9.0, high, heights), holes=True)


NO_GRID = r"no Surfer grid.*allowed in \.grd: Surfer"
TEXT, SIX, SEVEN = (write(HEIGHTS) for write in WRITERS.values())
REFUSED = {
    "another": (b"HGPC1\0\0\1" + bytes(2000), NO_GRID),
    "noise": (np.random.default_rng(2).bytes(3000), NO_GRID),
    "empty": (b"", NO_GRID),
    "cut text": (TEXT[:-30], r"holds \d+ heights; its header gives 6 x 5"),
    "long text": (TEXT + b"1 2 3\n", r"holds 33 heights; its header gives 6 x 5"),
    "no header": (b"DSAA\n6 5\n0 1\n", "ends within its header"),
    "letters": (TEXT.replace(b"\n\n", b" x\n\n", 1), r"line 6: 'x' is no number"),
    "half nodes": (TEXT.replace(b"6 5", b"6.5 5"), r"gives 6\.5 x 5 nodes; allowed: whole numbers"),
    "negative nodes": (TEXT.replace(b"6 5", b"-6 -5"), r"gives -6 x -5 nodes; allowed: whole numbers"),
    "unknown nodes": (TEXT.replace(b"6 5", b"nan 5"), r"gives nan x 5 nodes; allowed: whole numbers"),
    "turned x": (surfer_text(HEIGHTS, (4.5, 2.0)), r"x from 4\.5 to 2; allowed: rising"),
    "infinite y": (surfer_text(HEIGHTS, y=(0.0, np.inf)), r"y from 0 to inf; allowed: rising"),
    "cut 6": (SIX[:-3], r"holds 117 bytes of heights; its header gives 6 x 5"),
    "short 6": (SIX[:40], "ends within its header"),
    "cut 7": (SEVEN[:-3], r"its section DATA has 240 bytes, the file 237"),
    "short 7": (SEVEN[:50], r"its section GRID has 72 bytes"),
    "no data 7": (SEVEN[:92], "needed: sections GRID and DATA"),
    "version 7": (surfer_7(HEIGHTS, version=3), r"version 3; allowed: 1 and 2"),
    "count 7": (SEVEN.replace(struct.pack("<2i", 5, 6), struct.pack("<2i", 5, 7)), r"240 bytes of heights; .* 7 x 5"),
}
test_a_grid_that_may_be_misread_is_refused_by_name = refusals_of(REFUSED, "z.grd")
