"""What a file gives and what the study gives: both agree, or the study is refused with both values."""

import re
from pathlib import Path

import numpy as np
import pytest
import tifffile

from roughvol.campaign import case_surface, interpretation
from roughvol.errors import StudyError
from roughvol.study import loads
from roughvol.surfaces.midpoint import random_midpoint_displacement
from tests.study.kit import case_of, table

HEIGHTS = random_midpoint_displacement(2.3, 2, seed=1).heights  # 5 x 5
X, Y = (axis.ravel() for axis in np.indices(HEIGHTS.shape))
MAPS = table("maps.toml")
WIDE = "# Width: 125 µm\n# Height: 125 µm\n# Value units: nm\n"


def _rows(numbers: np.ndarray) -> str:
    return "\n".join(" ".join(repr(float(number)) for number in row) for row in numbers) + "\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    np.save(tmp_path / "bare.npy", HEIGHTS)
    (tmp_path / "full.txt").write_text(WIDE + _rows(HEIGHTS.T), encoding="utf-8")
    (tmp_path / "named.txt").write_text("# heights in nm\n" + _rows(HEIGHTS), encoding="utf-8")
    points = np.column_stack([25.0 * X, 25.0 * Y, HEIGHTS.ravel()])
    (tmp_path / "points.xyz").write_text(_rows(points), encoding="utf-8")
    (tmp_path / "lateral.csv").write_text("x [um] y [um] z\n" + _rows(points), encoding="utf-8")
    (tmp_path / "counted.xyz").write_text(_rows(np.column_stack([X, Y, HEIGHTS.ravel()])), encoding="utf-8")
    return tmp_path


def test_a_file_and_a_study_that_do_not_agree_are_refused(folder: Path) -> None:
    for surface, key, said in MAPS["agreement"]:
        with pytest.raises(StudyError, match=said) as caught:
            case_of(folder, surface)
        assert [problem.key for problem in caught.value.problems] == [key], surface


def test_heights_come_in_the_unit_of_L(folder: Path) -> None:
    for surface, L, unit, scale in MAPS["units"]:
        case = case_of(folder, surface)
        assert (case.L, case.length_unit) == (pytest.approx(L, rel=1e-12), unit or None), surface
        heights = case_surface.surface_of(case).heights
        np.testing.assert_allclose(heights, scale * HEIGHTS, rtol=1e-12, err_msg=surface)


def test_the_second_body_takes_the_unit_of_the_first_unless_it_has_its_own(folder: Path) -> None:
    for keys, scale in (("", 1e-3), (", heights_unit: um", 1.0)):
        case = case_of(folder, f"file: bare.npy, L: 7 um, heights_unit: nm, against: {{file: bare.npy{keys}}}")
        np.testing.assert_allclose(case_surface.surface_of(case).heights, (1e-3 + scale) * HEIGHTS, rtol=1e-12)


def test_the_height_of_a_count_is_one_more_unit(folder: Path) -> None:
    study = loads("surface: {file: bare.npy, L: 7 um, heights_unit: 0.950 nm}", folder / "study.yaml")
    assert study.cases()[0].surface_text == "numbers of bare.npy are in 0.95 nm"
    assert "heights_unit: 0.95 nm" in study.to_yaml()


def test_counts_without_a_height_draw_a_warning(folder: Path) -> None:
    tifffile.imwrite(folder / "counts.tif", np.arange(30, dtype="u2").reshape(6, 5))
    said = "counts.tif holds counts, taken as heights in um; heights_unit: 0.95 nm would be the height of a count"
    assert case_of(folder, "file: counts.tif, L: 1000 um").notes == (said,)
    for unit in ("nm", "0.95 nm"):
        assert not case_of(folder, f"file: counts.tif, L: 10 um, heights_unit: {unit}").notes
    tifffile.imwrite(folder / "heights.tif", np.arange(30, dtype="f4").reshape(6, 5))
    assert not case_of(folder, "file: heights.tif, L: 100 um").notes


def test_what_is_ignored_is_stored_in_words(folder: Path) -> None:
    text = case_of(folder, "file: full.txt, L: 7 nm, header: ignore").surface_text
    assert text == "sizes and units in full.txt ignored"


def test_a_number_names_a_channel(folder: Path) -> None:
    np.savez(folder / "two.npz", a=HEIGHTS, b=2.0 * HEIGHTS)
    cases = [case_of(folder, f"file: two.npz, L: 1, variable: {name}") for name in ("1", "'1'", "b")]
    assert [case.bodies[0].variable for case in cases] == ["1", "1", "b"]
    assert all(np.array_equal(case_surface.surface_of(case).heights, 2.0 * HEIGHTS) for case in cases)


# What the user should look at


def _notes(folder: Path, surface: str) -> tuple[str, ...]:
    case = case_of(folder, surface)
    return interpretation.notes([case], case_surface.surface_of(case))


def test_an_absurd_size_is_noted(folder: Path) -> None:
    for surface, said in MAPS["absurd"]:
        assert [note for note in _notes(folder, surface) if re.search(said, note)], surface
    for surface in ("file: full.txt", "file: points.xyz, unit: um", "file: bare.npy, L: 7"):
        assert _notes(folder, surface) == ()
    agreed = _notes(folder, "file: counted.xyz, L: 4 um")  # the nodes are 1 um apart, as the study says
    assert not [note for note in agreed if "count nodes" in note]


def test_what_a_file_contradicts_is_placed_in_the_study(tmp_path: Path) -> None:
    text = "# Width: 10 µm\n# Height: 10 µm\n# Value units: m\n" + "\n".join(["1e-8\t2e-8\t1e-8\t0"] * 4)
    (tmp_path / "scan.txt").write_text(text, encoding="utf-8")
    study = "name: x\nsurface:\n  file: scan.txt\n  L: 100 nm\n"
    with pytest.raises(StudyError, match=re.escape(f"{tmp_path / 'study.yaml'}:4: surface.L: ")):
        loads(study, tmp_path / "study.yaml").cases()
    assert loads(study, tmp_path / "study.yaml") == loads("\n" + study, tmp_path / "study.yaml")


@pytest.mark.parametrize(
    ("rest", "key"),
    [
        ("material: {E: 10 MPa, nu: 0.3, thickness: 50 nm}", "material.thickness"),
        ("material: {E: [5 MPa, 10 MPa], nu: 0.3, thickness: 50 nm}", "material.thickness"),
        ("sweep: {to: {mean_gap: 1 um}}", "sweep.to.mean_gap"),
        ("record: {fields_at: {separation: 1 um}}", "record.fields_at.separation[0]"),
        ("record: {dimensional: {mean_gap: um}}", "record.dimensional.mean_gap"),
        ("seal: {length: 12 mm, width: 200}", "seal.length"),
    ],
)
def test_a_length_with_a_unit_is_refused_beside_a_file_without_one(folder: Path, rest: str, key: str) -> None:
    with pytest.raises(StudyError, match=re.escape(f"study.yaml:2: {key}: ")):
        case_of(folder, "file: points.xyz, L: 100", rest)
    assert case_of(folder, "file: points.xyz, L: 100 um", rest).length_unit == "um"


def test_files_of_one_length_but_for_rounding_are_cases_of_one_length(folder: Path) -> None:
    for name, origin in (("near.xyz", 0.0), ("far.xyz", 17.3)):
        points = np.column_stack([origin + 0.1 * X, 0.1 * Y, HEIGHTS.ravel()])
        (folder / name).write_text("x [um] y [um] z [um]\n" + _rows(points), encoding="utf-8")
    near, far = loads("surface: {files: [near.xyz, far.xyz]}", folder / "study.yaml").cases()
    assert near.L == far.L == pytest.approx(0.4, rel=1e-12)
    alone = case_of(folder, "file: far.xyz")
    assert alone.L != far.L
    np.testing.assert_array_equal(*(case_surface.surface_of(case).heights for case in (far, alone)))
    (folder / "wide.xyz").write_text("x [um] y [um] z [um]\n" + _rows(points * [1.002, 1.002, 1.0]), encoding="utf-8")
    differ = r"the files differ in L: near\.xyz has 0\.4 um, wide\.xyz has 0\.4008 um; allowed: one length"
    with pytest.raises(StudyError, match=differ):
        loads("surface: {files: [near.xyz, wide.xyz]}", folder / "study.yaml").cases()
    (folder / "mm.xyz").write_text("x [mm] y [mm] z [um]\n" + _rows(points * [1e-3, 1e-3, 1.0]), encoding="utf-8")
    with pytest.raises(StudyError, match=r"has 0\.4 um, mm\.xyz has 0\.0004 mm; .* surface\.unit"):
        loads("surface: {files: [near.xyz, mm.xyz]}", folder / "study.yaml").cases()
    for name in ("a b.xyz", "a_b.xyz"):
        (folder / name).write_bytes((folder / "near.xyz").read_bytes())
    with pytest.raises(StudyError, match=r"a b\.xyz and a_b\.xyz hold the same bytes and are one case by name"):
        loads("surface: {files: [a b.xyz, a_b.xyz]}", folder / "study.yaml").cases()
