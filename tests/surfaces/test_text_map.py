"""Text of other programs: faults are refused by line, and no row is lost or taken for heights."""

import numpy as np
import pytest
from height_files import GERMAN, GWYDDION, HEIGHTS, HOLED, POINTS, put, refusals_of, refused, rows, same

from roughvol.surfaces import length_units
from roughvol.surfaces.files import reading
from tests.study.kit import case_of

X, Y = POINTS[:, 0], POINTS[:, 1]
TURNED = rows(HEIGHTS.T)
INSIST = r".*surface\.columns: heights"


@pytest.mark.parametrize(
    ("between", "first", "last"), [(";", "", ""), ("\t", "", "\t"), (",", ",", ","), (";", ";", ";")]
)
def test_empty_cells_are_holes_also_at_the_ends_of_a_line(tmp_path, between, first, last):
    lines = "".join(f"{first}{line}{last}\n" for line in rows(HOLED, between, "").splitlines())
    same(put(tmp_path / "z.csv", lines), HOLED, holes=True)


@pytest.mark.parametrize("suffix", [".txt", ""])
def test_three_columns_that_are_no_grid_are_refused_unless_the_user_insists(tmp_path, suffix):
    path = put(tmp_path / f"z{suffix}", rows(HEIGHTS[:, :3]))
    refused(path, f"looks like x y z points, but {INSIST}")
    same(path, HEIGHTS[:, :3], columns="heights")


ALONG, ACROSS = np.indices((12, 12))
GROOVES = np.sin(ALONG) + 0.25 * ACROSS
SLOPE = np.round(0.31 * ALONG + 0.17 * ACROSS + 0.04 * np.sin(3 * ALONG * ACROSS), 1)
LATE = np.vstack([np.zeros((60, 4)), np.full((3, 4), 0.5)])
WHOLE = np.vstack([np.tile([3.0, 1.0, 4.0, 2.0], (60, 1)), np.full((1, 4), 0.5)])
QUOTED = rows(HEIGHTS, ";").replace(".", ",").replace(";", '","')
READ = {
    "tilted grooves": (rows(GROOVES, ";"), GROOVES),
    "tilted grooves along y": (rows(GROOVES.T, ";"), GROOVES.T),
    "a coarsely printed slope": (rows(SLOPE), SLOPE),
    "a minus sign of typesetting": (rows(HEIGHTS).replace("-", "\u2212"), HEIGHTS),
    "decimal commas that begin late": (60 * "0 0 0 0\n" + 3 * "0,5 0,5 0,5 0,5\n", LATE),
    "quoted cells of decimal commas": ("\n".join(f'"{line}"' for line in QUOTED.splitlines()), HEIGHTS),
    "whole numbers between commas": ("1,7,0,2\n" * 3, np.tile([1.0, 7.0, 0.0, 2.0], (3, 1))),
    "points below a width": ("# Width: 9 um\n# Height: 9 um\nx y z\n" + rows(POINTS), HEIGHTS),
    "points of named columns": ("y [um];z;x [um]\n" + rows(np.column_stack([Y, POINTS[:, 2], X]), ";"), HEIGHTS),
    "whole numbers before decimal commas": (60 * "3 1 4 2\n" + "0,5 0,5 0,5 0,5\n", WHOLE),
    "infinite heights at an edge": ("inf inf 1 2 3\n" + rows(HEIGHTS), np.vstack([[np.nan] * 2 + [1, 2, 3], HEIGHTS])),
}


@pytest.mark.parametrize("name", READ)
def test_numbers_in_rows_are_heights(tmp_path, name):
    text, expected = READ[name]
    same(put(tmp_path / "z.txt", text), expected, holes=True)


OF_PROGRAMS = ["-1.#IND", "1.#QNAN00", "#DIV/0!", "#N/A", "No Data", "NoData", "no_data", "invalid", "***", "BAD", "--"]


@pytest.mark.parametrize("mark", [*OF_PROGRAMS, "NaN", "inf", "-9999", "1e38"])
@pytest.mark.parametrize("between", [" ", "\t", ";", ","])
def test_marks_of_other_programs_are_missing_heights(tmp_path, mark, between):
    first = np.where(np.arange(5) == 0, np.nan, HOLED)  # in the first line, too
    same(put(tmp_path / "z.txt", rows(first, between, mark) + f"# {mark}\n"), first, holes=True)


@pytest.mark.parametrize("mark", ["-1,#IND", "1,#QNAN00", "1.#INF"])
@pytest.mark.parametrize("between", [" ", "\t", ";"])
@pytest.mark.parametrize("place", [0, 2, -1])
def test_marks_beside_decimal_commas_are_missing_heights(tmp_path, mark, between, place):
    holed = HEIGHTS.copy()
    holed[1, place] = np.nan
    text = rows(HEIGHTS, between).replace(".", ",").splitlines()
    cells = text[1].split(between)
    cells[place] = mark
    text[1] = between.join(cells)
    same(put(tmp_path / "z.txt", "\n".join(text)), holed, holes=True)


def test_rounded_and_shifted_coordinates_are_a_grid(tmp_path):
    points = POINTS + np.array([1e3, -2e3, 0.0])
    points[:, :2] += 1e-10 * np.random.default_rng(2).normal(size=(len(points), 2))
    same(put(tmp_path / "z.xyz", rows(points)), HEIGHTS)
    assert reading.describe(tmp_path / "z.xyz").sides == pytest.approx((2.5, 2.0))


WAVES = np.cos(np.arange(36.0)).reshape(4, 9)
NO_GRID = "looks like x y z points, but they are no regular grid: "
UNKNOWN = "line 1 is not understood: "
RULER = "the first %s looks like coordinates: delete it"
REFUSED = {
    "bent.xyz": (rows(np.column_stack([X + np.sqrt(X), Y, X])), f"{NO_GRID}x is not equidistant"),
    "twice.xyz": (rows(np.vstack([POINTS, POINTS[:1]])), f"{NO_GRID}1 nodes have several of the 31 points"),
    "line.xyz": (rows(np.column_stack([X, 0 * Y + 2.0, X])), f"{NO_GRID}y is 2 everywhere"),
    "diagonal.xyz": (rows(np.column_stack([X, X, X])[::5]), f"{NO_GRID}6 points lie on a grid of 6 x 6 nodes"),
    "unplaced.xyz": (rows(np.where(np.arange(3) == 1, np.nan, POINTS)), f"{NO_GRID}a coordinate is missing"),
    "narrow.xyz": (rows(POINTS[X < 0.6]), f"{NO_GRID}x takes 2 values"),
    "quality.txt": (rows(np.column_stack([POINTS, X])), "looks like x y z points: the first two of its 4 columns"),
    "across.txt": (rows(POINTS.T), "looks like x y z points: the first two of its 3 lines"),
    "corner.csv": (
        rows(np.vstack([np.r_[np.nan, Y[:5]], np.column_stack([X[::5], HEIGHTS])]), ";", ""),
        "first line and the first column look like coordinates",
    ),
    "numbered.csv": (rows(np.column_stack([np.arange(6), HEIGHTS]), ";"), "the first column only counts: delete it"),
    "named.csv": (rows(np.vstack([np.arange(1, 6), HEIGHTS]), ";"), "the first line only counts: delete it"),
    "ruled.csv": (rows(np.vstack([0.5 * np.arange(9), WAVES]), ";"), RULER % "line"),
    "printed.csv": (rows(np.vstack([np.round(np.arange(9) / 3, 1), WAVES]), ";"), RULER % "line"),
    "printed.txt": (rows(np.column_stack([np.round(np.arange(9) / 7, 2), WAVES.T])), RULER % "column"),
    "size.txt": ("# Scan size: 8 um\n" + TURNED, f"{UNKNOWN}'# Scan size: 8 um'.*header: ignore"),
    "lateral.txt": ("# lateral unit um\n" + TURNED, UNKNOWN),
    "pixel.txt": ("# pixel size = 0.5\n" + TURNED, UNKNOWN),
    "factor.txt": ("# height conversion factor (-> m) = 1e-9\n" + TURNED, UNKNOWN),
    "both sizes.txt": (
        "# Width: 3 µm\n# Height: 2 µm\npixel size = 0.5 m\nUnit Data = m\n" + TURNED,
        "line 3 is not understood",
    ),
    "both factors.txt": (GWYDDION + "height conversion factor (-> m) = 1e-9\n" + TURNED, "line 5 is not understood"),
    "mark.txt": (GERMAN + TURNED.replace("\n", "\n*** 1 2 3 4 5\n", 1), f"{UNKNOWN}'# Breite: 3 µm'"),
    "half a size.txt": (GERMAN.replace(": 2.5 µm", "") + TURNED, f"{UNKNOWN}'# Breite: 3 µm'"),
    "counts.txt": ("h=5 w=7\n" + TURNED, f"{UNKNOWN}'h=5 w=7'"),
    "title.csv": ("a,b,c,d,e\n" + TURNED.replace(" ", ","), f"{UNKNOWN}'a,b,c,d,e'"),
    "latin.txt": (b"# \xb5m\n1 2 3\n", f"{UNKNOWN}'# µm'"),
    "two.csv": (2 * (rows(HEIGHTS, ";") + "\n"), "line 8 begins another map of 6 lines, behind an empty line"),
    "empty line.csv": (rows(HEIGHTS, ";") + ";;;;\n", "line 7 holds empty cells alone; delete it"),
    "empty columns.csv": (rows(HEIGHTS, ";").replace("\n", ";;\n"), "the last column holds empty cells alone"),
    "thousands.csv": ("1,234;5;1,002\n" * 3, "line 1 may hold commas between thousands"),
    "footer.csv": (rows(HEIGHTS, ";") + "\nend of data\n", "line 8 holds no numbers: 'end of data'; delete it"),
    "footer.txt": (TURNED + "end of data\n", "line 6 holds no numbers: 'end of data'; delete it"),
    "blocks.txt": (2 * (GWYDDION + TURNED), "line 10 is a header among the numbers: '# Channel: Topography'"),
    "short.txt": (TURNED[:-20], r"line 5 holds \d numbers, most lines 6; delete it if it is no row"),
    "marked.txt": (
        TURNED.rpartition(" ")[0] + " gone",
        "line 5: 'gone' is no number; a missing height is an empty cell",
    ),
    "both.csv": (TURNED.replace(" ", ";").replace(".", ",", 3), "line 1 holds both commas and points"),
    "close.csv": ("0,13,-0,5,1,06,2,5\n" * 4, "line 1 holds commas in its numbers and between them"),
    "commas.csv": (TURNED.replace(".", ",").replace(" ", ", "), "line 1 holds commas in its numbers and between them"),
    "inches.txt": ("# heights in inch\n" + TURNED, r"line 1 \(# heights in inch\) has the unit 'inch'; allowed: pm"),
    "microinches.txt": ("# x step 5 microinch\n" + TURNED, UNKNOWN),
    "letter.txt": (TURNED.replace("\n", " 1O\n", 1), "line 1"),
    "volts.txt": (GWYDDION.replace("nm", "V") + TURNED, r"line 4 \(# Value units: V\) has the unit 'V'"),
    "no width.txt": (GWYDDION.replace("3 µm", "0 µm") + TURNED, r"# Width: 0 µm.* makes sides of 0 by 2;"),
    "tiny.txt": (GWYDDION.replace("3 µm", "6e-400 µm") + TURNED, "makes sides of 0 by 2; allowed: finite"),
    "deflection.txt": (GWYDDION.replace("Topography", "Deflection") + TURNED, "'Deflection' holds no heights, by its"),
    "units.csv": ("X [µm];Y [nm];Z [nm]\n" + rows(POINTS, ";"), "line 1 .* is in nm, another size in um"),
    "cells.asc": ("ncols 6\nnrows 5\ncellsize -1\n" + TURNED, r"cellsize -1\) makes sides of -5 by -4"),
    "half.asc": ("ncols 6.5\nnrows 5\ncellsize 1\n" + TURNED, r"ncols 6\.5, nrows 5; allowed: whole numbers"),
    "none.asc": ("ncols nan\nnrows 5\ncellsize 1\n" + TURNED, "ncols nan, nrows 5; allowed: whole numbers"),
    "words.asc": ("ncols 6\nnrows five\n" + TURNED, r"header gives ncols; needed: ncols and nrows"),
    "titled.asc": ("ncols 6\nnrows 5\na title\n" + TURNED, "line 3 is not understood: 'a title'"),
    "cut.asc": ("ncols 6\nnrows 5\ncellsize 1\n" + rows(HEIGHTS.T[:2]), "holds 12 heights; its header gives 5 x 6"),
    "huge.asc": ("ncols 1000000000\nnrows 1000000000\ncellsize 1\n1 2 3\n", "holds 3 heights"),
    "empty.xyz": ("", "holds no numbers"),
    "list.txt": (repr(HEIGHTS.tolist()), "holds no numbers, or words in each line of them; allowed: numbers alone"),
    "nothing.txt": ("# none yet\n", "holds no numbers"),
}
test_text_that_may_be_misread_is_refused_by_line = refusals_of(REFUSED)


@pytest.mark.parametrize("line", [0, 2])
@pytest.mark.parametrize("ignored", [False, True])
def test_a_row_with_an_unknown_mark_is_no_header(tmp_path, line, ignored):
    lines = rows(HEIGHTS).splitlines()
    lines[line] = "gone " + lines[line].partition(" ")[2]
    refused(put(tmp_path / "z.txt", "\n".join(lines)), f"line {line + 1}: 'gone' is no number", ignore_header=ignored)


@pytest.mark.parametrize(
    "head", ["# Scan size: 8 um\n", "a b c\n", "h=5 w=7\n", "# pixel size = 0.5\n", "# Value units: V\n"]
)
def test_a_header_may_be_passed_over(tmp_path, head):
    same(put(tmp_path / "z.txt", head + rows(HEIGHTS)), HEIGHTS, ignore_header=True)


def test_a_header_that_gives_all_needs_no_other_line(tmp_path):
    path = put(tmp_path / "z.txt", "# Objective 50x, stylus 2 um\n# h=7 w=9, h = 0.5\n" + GWYDDION + TURNED)
    found = reading.describe(path)
    assert (found.sides, found.unit, found.heights_unit) == ((2.5, 2.0), "um", "nm")
    assert "# Width: 3 µm" in found.source
    assert reading.describe(put(path, "# Width: 3 µm\n" + TURNED)).sides is None


@pytest.mark.parametrize(("width", "height"), [("3 µm", "2500 nm"), ("3e-3 mm", "2,5 µm"), ("3 micrometres", "2.5")])
def test_each_size_may_have_a_prefix_of_its_own(tmp_path, width, height):
    path = put(tmp_path / "z.txt", f"# Width: {width}\n# Height: {height}\n# Value units: nm\n" + TURNED)
    assert abs(case_of(tmp_path, "file: z.txt, unit: um").L - 2.5) < 1e-12
    found = reading.describe(path)
    assert [side * length_units.factor(found.unit, "um") for side in found.sides or ()] == pytest.approx([2.5, 2.0])


@pytest.mark.parametrize(
    "head", ["X [µm];Y [µm];Z [nm]", "x (um); y (um); height (nm)", '"x/um";"y/um";"z/nm"', "# x_um;y_um;z_nm"]
)
def test_names_of_columns_may_carry_units(tmp_path, head):
    found = reading.describe(put(tmp_path / "z.csv", f"{head}\n{rows(POINTS, ';')}".encode("latin-1")))
    assert (found.sides, found.unit, found.heights_unit) == ((2.5, 2.0), "um", "nm")
