"""Lines can be seen and told apart, in colour, in grey and by the colour-blind; text stays text in every file."""

import re
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from matplotlib import font_manager

from roughvol.errors import DatasetError
from roughvol.report.figures import content, style
from roughvol.reproduction.figures.conditions import ACCENT, SECOND
from roughvol.reproduction.figures.registry import FIGURES

pytestmark = pytest.mark.layout  # every figure is saved once with its layout

LEAST_CONTRAST = 3.0  # WCAG 2.2, 1.4.11
# Machado, Oliveira and Fernandes (2009), severity 1, on linear RGB
BLIND = {
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def _lab(colour: object, seen: object = np.eye(3)) -> np.ndarray:
    rgb = np.array(mpl.colors.to_rgb(colour))  # type: ignore[arg-type]
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    to_xyz = [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
    xyz = np.array(to_xyz) @ np.clip(np.array(seen) @ linear, 0.0, 1.0) / [0.95047, 1.0, 1.08883]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


def contrast(colour: object) -> float:
    """Return the contrast of a colour against white, 1 to 21."""
    return 1.05 / (float(style.luminance(colour)[0]) + 0.05)


def test_contrast_is_that_of_the_standard() -> None:
    assert contrast("k") == pytest.approx(21.0)
    assert contrast("w") == pytest.approx(1.0)
    assert contrast("#777777") == pytest.approx(4.48, abs=0.01)  # the example that every checker has
    assert style.lightness("#777777") == pytest.approx(50.0, abs=0.1)
    assert style.lightness("k") == 0.0


@pytest.mark.parametrize("count", [1, 2, 3, 5, 6, 10])
def test_every_line_colour_is_seen_on_white(count: int) -> None:
    colours = [look["color"] for look in style.looks(count)]
    assert min(map(contrast, (*colours, ACCENT, SECOND, style.GREY, style.CONTACT))) >= LEAST_CONTRAST


@pytest.mark.parametrize("count", [2, 3, 5, 6, 10])
def test_colours_are_in_equal_steps_of_grey(count: int) -> None:
    grey = style.lightness([look["color"] for look in style.looks(count)])
    assert np.all(np.diff(grey) > 0.0)
    assert np.diff(grey).min() > 0.9 * (grey[-1] - grey[0]) / (count - 1)
    assert grey[-1] - grey[0] > 45.0


@pytest.mark.parametrize("seen", BLIND)
def test_neighbours_are_told_apart_by_the_colour_blind(seen: str) -> None:
    colours = [_lab(look["color"], BLIND[seen]) for look in style.looks(6)]
    differences = [np.linalg.norm(one - other) for k, one in enumerate(colours) for other in colours[:k]]
    assert min(differences) > 9.0  # 2.3 is just noticeable


@pytest.mark.parametrize(
    ("unit", "printed"),
    [
        ("um^3", "µm³"),
        ("mm^3/s", "mm³/s"),
        ("mPa*s", "mPa s"),
        ("length^-3", "length$^{-3}$"),
        ("nm*um^2", "nm µm²"),
        ("um", "µm"),
        ("unit", "unit"),
        ("MPa", "MPa"),
    ],
)
def test_units_are_printed_as_they_are_read(unit: str, printed: str) -> None:
    assert style.unit_text(unit) == printed


@pytest.fixture(scope="module")
def curve() -> xr.Dataset:
    step = np.arange(1, 6)
    dims = ("D", "m", "seed", "step")
    values = {"mean_pressure": 0.3 * step, "contact_area_fraction": 0.01 * step}
    variables = {name: (dims, along[None, None, None]) for name, along in values.items()}
    return xr.Dataset(variables, {"D": [2.3], "m": [5], "seed": [0], "step": step, "L": 1.0}).set_coords("L")


def test_text_stays_text_in_every_format(curve: xr.Dataset, tmp_path: Path) -> None:
    figure = FIGURES["fig04a"](curve)
    figure.set_layout_engine(None)
    for suffix in ("pdf", "svg", "eps"):
        figure.savefig(tmp_path / f"fig04a.{suffix}")
    pdf, svg = (tmp_path / "fig04a.pdf").read_bytes(), (tmp_path / "fig04a.svg").read_text(encoding="utf-8")
    kinds = set(re.findall(rb"/Subtype */(Type3|CIDFontType2|TrueType|Type0)", pdf))
    assert kinds
    assert b"Type3" not in kinds
    letters = "".join(re.findall(r">([^<>]+)</(?:text|tspan)>", svg)).replace("\xa0", "")
    assert "dimensionlesspressure" in letters  # a label with a formula has an element for each letter
    assert "realcontactareafraction" in letters
    assert '<path id="STIX' not in svg
    postscript = (tmp_path / "fig04a.eps").read_text(encoding="latin-1")
    assert "/FontType 3" not in postscript
    assert "/FontType 42" in postscript
    assert "'STIXGeneral'" in svg.replace("&quot;", "'")


def test_saving_and_a_figure_that_fails_leave_no_trace_in_matplotlib(curve: xr.Dataset, tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    style.axes()[0].savefig(tmp_path / "empty.svg")
    with pytest.raises(DatasetError):
        FIGURES["fig04a"](curve.drop_vars("mean_pressure"))
    assert dict(mpl.rcParams) == before


def test_the_font_has_every_letter_of_a_unit() -> None:
    font = font_manager.get_font(font_manager.findfont(style.STYLE["font.family"][0]))
    for unit in ("um^3", "mm^2", "length^-3", "m^4", "mPa*s", "1/um"):
        plain = re.sub(r"\$.*?\$", "", style.unit_text(unit))
        assert {ord(letter) for letter in plain} <= font.get_charmap().keys()


def test_a_note_is_broken_for_the_size_of_the_figure() -> None:
    fig, few = style.canvas(), style.canvas(1.2)
    for made in (fig, few):
        made.note("Run seal: D = 2.3, m = 5, L = 100 µm, 2 surfaces. Leg 1 of a path; path_loops draws every leg.")
    fig.set_size_inches(1.2, 3.0)
    assert fig.get_supxlabel() == few.get_supxlabel()
    assert len(fig.get_supxlabel().splitlines()) > 2


def test_a_number_keeps_its_unit_where_a_line_ends() -> None:
    family = ["DejaVu Sans"]
    text = "Pressure drop 10 mbar, 3 of 3 surfaces."
    room = style.width_of("Pressure drop 10 m", 8.0, family)
    assert style.wrapped(text, 8.0, room, family) == ["Pressure drop", "10 mbar, 3 of", "3 surfaces."]
    assert (
        style.wrapped("flux on m = 6, seed 0", 8.0, style.width_of("flux on m =", 8.0, family), family)[1] == "m = 6,"
    )
    assert style.wrapped("10 mbar", 8.0, style.width_of("mbar", 8.0, family), family) == [
        "10",
        "mbar",
    ]  # of a narrow column


def test_a_line_of_a_legend_ends_neither_in_a_range_nor_in_a_formula() -> None:
    for words in range(60):
        for line in content.wrapped(f"{'a ' * words}region x/L_x 0 to 1, y/L_y 0 to 1, $T^{{* }}$").splitlines():
            assert line.count("0 to 1") == line.count("to")
            assert line.count("$") % 2 == 0
