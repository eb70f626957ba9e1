"""How every figure looks: sizes, colours, markers, words on the axes, and how it is written to a file.

Line colours are equal steps in lightness, from near black to the lightest that keeps 3 : 1 against white (WCAG 2.2,
1.4.11). So their order survives a print in grey and every kind of colour blindness.
"""

from __future__ import annotations

import functools
import io
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from xarray import Dataset

from roughvol.errors import FolderError
from roughvol.observables.variables import QUANTITIES
from roughvol.store import stamped_file
from roughvol.surfaces.length_units import METRES, factor
from roughvol.typing import Array

_LETTERS = {r"^{\ast}": "*", r"\sigma": "σ", r"\Delta": "Δ", r"\delta": "δ", r"\mu": "µ", r"\leq": "≤", r"\sim": "~"}
_LETTERS |= {r"\cdot": "·", r"^{-1}": "⁻¹", r"^2": "²", r"^3": "³", r"\eta": "η", r"\lambda": "λ", r"\pi": "π"}
SCREEN = 160  # resolution in a notebook
COLUMN, PAGE, DPI = 3.5, 7.0, 300  # widths [inch] of a column and of a page, resolution for print
CONTACT = "#08306b"  # contact is this one flat dark blue wherever it shows in colour
GREY = "0.4"
MARKERS = "osD^vP<X>*"
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (5, 1.5, 1, 1.5)), (0, (1, 1.2)), (0, (2.5, 1.2)))
LIGHTEST = 0.584  # of matplotlib's CMRmap, made for print in grey: 3.1 : 1 against white
STEPS = 256  # at which the lightness of the map is taken
NOTE = 6.5  # points of the letters of a note
ROUNDING = 1e-6  # of a width
BOX = 1.2  # width over the size of the type: of the box for a letter that the font lacks
LEFT_FREE = 0.96  # of the width of a figure, for a line of a note
RAISED = {"2": "²", "3": "³"}  # the font has no others, nor a raised minus
WIDE = 62  # characters of a legend, lines included, that fit over a column
MANY = 30  # computed states of a curve, beyond which only some have a marker
SHORT = 4.0  # ratio of the ends of a logarithmic axis up to which its numbers are equally far apart
# multiples of powers of ten with a number, on an axis whose ends have less than this ratio
NUMBERS = {10.0: (1.0, 2.0, 3.0, 5.0, 7.0), 100.0: (1.0, 2.0, 5.0), math.inf: (1.0,)}
A, P, V = "contact_area_fraction", "mean_pressure", "free_volume"


def width_of(text: str, size: float, family: Sequence[str], weight: str = "normal") -> float:
    """Return the width of a text in type of a size [points]."""
    fonts = tuple(family)
    return size * sum(_advance(letter, fonts, weight) for letter in text)


@functools.cache
def _advance(letter: str, family: Sequence[str], weight: str) -> float:
    """Return the width of a letter over the size of the type; pairs of letters lie no farther apart."""
    font, large = get_font(findfont(FontProperties(family=list(family), weight=weight))), 100.0
    font.set_size(large, 72)
    index = font.get_char_index(ord(letter))
    return float(font.load_glyph(index).linearHoriAdvance) / 65536.0 / large if index else BOX


# a blank that is neither beside an equals sign nor between a number and letters
_BETWEEN = re.compile(r"(?<!=) (?!=)(?:(?<!\d )|(?![^\W\d_]))")


def wrapped(text: str, size: float, width: float, family: Sequence[str], weight: str = "normal") -> list[str]:
    """Return a text in lines of a width [points]; a wider word is broken. A number keeps its unit and its name."""

    def fits(line: str) -> bool:
        return width_of(line, size, family, weight) <= width + ROUNDING

    rows = [""]
    for word in (word for part in _BETWEEN.split(text) for word in ([part] if fits(part) else part.split(" "))):
        longer = f"{rows[-1]} {word}" if rows[-1] else word
        if fits(longer):
            rows[-1] = longer
            continue
        rows.append("")
        for letter in word:
            if rows[-1] and not fits(rows[-1] + letter):
                rows.append("")
            rows[-1] += letter
    return [row for row in rows if row] or [""]


def read_style(name: str) -> dict[Any, Any]:
    """Return the settings of matplotlib in a file beside this module."""
    return dict(mpl.rc_params_from_file(Path(__file__).with_name(f"{name}.mplstyle"), use_default_template=False))


STYLE = read_style("figures")
LABELS = {name: row.label for name, row in QUANTITIES.items() if row.label}


class Drawing(Figure):
    """A matplotlib figure that is saved in our style, whoever saves it.

    Attributes
    ----------
    shown : mapping
        Values of ``D``, ``m``, ``surfaces``, ``samples`` and ``area`` that it shows, for the note on its origin.
    sources : mapping
        Where the points of a line come from: ``D``, ``m``, ``seed``, ``case``, ``axis`` and the name ``curve``.
    """

    shown: Mapping[str, Sequence[float]] = MappingProxyType({})
    sources: Mapping[Line2D, Mapping[str, object]] = MappingProxyType({})
    style: Mapping[Any, Any] = MappingProxyType({})  # beside `STYLE`, as another type
    _noted = ""

    def set_size_inches(self, *args: Any, **kwargs: Any) -> None:
        """Set the size as matplotlib does, and break the note anew."""
        super().set_size_inches(*args, **kwargs)
        if self._noted:
            self.note(self._noted)

    def note(self, text: str) -> None:
        """Put a line on where the drawing comes from below it."""
        self._noted = text
        with mpl.rc_context(STYLE | dict(self.style)):
            room = 72.0 * LEFT_FREE * self.get_size_inches()[0]
            lines = "\n".join(wrapped(" ".join(text.split()), NOTE, room, mpl.rcParams["font.family"]))
            self.supxlabel(lines, x=0.01, ha="left", fontsize=NOTE, color=GREY, linespacing=1.1)

    def savefig(self, fname: Any, *, transparent: bool | None = None, **kwargs: Any) -> None:
        """Save as matplotlib does, with the fonts of `STYLE`: how text is embedded is decided when a file is written.

        A file is written whole, or stays as it was.

        Parameters
        ----------
        fname : str, path or file
            Where to; the suffix is the format.
        transparent : bool, optional
            Whether the background is left out.
        **kwargs
            Those of `matplotlib.figure.Figure.savefig`.

        Raises
        ------
        FolderError
            If the file cannot be written.
        ValueError
            If there is no such format.
        """
        with mpl.rc_context(STYLE | dict(self.style)):
            if not isinstance(fname, str | os.PathLike):
                super().savefig(fname, transparent=transparent, **kwargs)
                return
            path, content = Path(fname), io.BytesIO()
            if not path.parent.is_dir():
                raise FolderError(f"cannot write {path}: there is no folder {path.parent}")
            kind = kwargs.pop("format", None) or path.suffix.removeprefix(".")
            super().savefig(content, transparent=transparent, format=kind or None, **kwargs)
            default = "" if path.suffix else f".{kind or mpl.rcParams['savefig.format']}"
            stamped_file.store(path.with_name(path.name + default), content.getvalue())

    def _repr_png_(self) -> bytes:
        """Return the figure as it is shown in a notebook."""
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=SCREEN)
        return buffer.getvalue()


def plain(text: str) -> str:
    """Return a label without TeX, as ``dimensionless pressure p*``."""
    for tex, letter in _LETTERS.items():
        text = text.replace(tex, letter)
    return re.sub(r"\\(?:mathrm|bar|,)\s*|(?<!\\)[${}]", "", text).replace(r"\$", "$")


def canvas(width: float = COLUMN, height: float = 3.0) -> Drawing:
    """Return an empty figure that leaves room for everything around its axes; sizes in inches."""
    return Drawing(figsize=(width, height), layout="constrained", dpi=DPI)


def axes(
    width: float = COLUMN, height: float = 3.0, columns: int = 1, rows: int = 1, *, grid: bool = False
) -> tuple[Drawing, Any]:
    """Return a figure and its axes in rows, with the lines of a grid where they are wanted; sizes in inches."""
    fig = canvas(width, height)
    panels = fig.subplots(rows, columns)
    for ax in fig.axes:
        ax.grid(visible=grid)
    return fig, panels


def luminance(colours: Any) -> Array:
    """Return the relative luminance of a colour or of several, 0 for black to 1 for white (WCAG 2.2)."""
    rgb = mpl.colors.to_rgba_array(colours)[:, :3]
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return linear @ (0.2126, 0.7152, 0.0722)


def lightness(colours: Any) -> Array:
    """Return the CIE lightness L* of a colour or of several, 0 to 100: the grey in which it prints."""
    y = luminance(colours)
    return np.where(y > 0.008856, 116.0 * np.cbrt(y) - 16.0, 903.3 * y)


def looks(count: int) -> list[dict[str, Any]]:
    """Return as many colours, in equal steps of lightness, each with a marker."""
    places = np.linspace(0.0, LIGHTEST, STEPS)
    colours = mpl.colormaps["CMRmap"](places)
    grey = lightness(colours)
    wanted = np.linspace(12.0, grey[-1], max(count, 2))
    chosen = mpl.colormaps["CMRmap"](np.interp(wanted, grey, places))
    return [{"color": tuple(map(float, chosen[k])), "marker": MARKERS[k % len(MARKERS)]} for k in range(count)]


def unit_text(unit: str) -> str:
    """Return a unit as it is printed: ``um^3`` as µm³, ``mPa*s`` as mPa s."""
    words = re.sub(r"\bu(?=(?:m|s|g|N|Pa|bar|l|L)\b)", "µ", unit)
    raised: Callable[[re.Match[str]], str] = lambda power: RAISED.get(power[1], f"$^{{{power[1]}}}$")  # noqa: E731
    return re.sub(r"(?:\^|\*\*)(-?\d+)", raised, words).replace("*", " ")


def handy(size: float, unit: str | None) -> tuple[float, str]:
    """Return a factor and the unit in which a length is a number of one to three digits, as it is printed."""
    if unit not in METRES:
        return 1.0, "length"
    fitting = (one for one in ("pm", "nm", "um", "mm", "m") if 0.0 < size * factor(unit, one) < 1000.0)
    wanted = next(fitting, unit)
    return METRES[unit] / METRES[wanted], unit_text(wanted)


def unit_of(ds: Dataset, name: str) -> str:
    """Return the unit of a variable of a dataset as it is printed, ``length`` where lengths have no unit."""
    return unit_text(str(ds[name].attrs.get("units", "length" if name in ("L", "Sq", "heights") else "?")))


class _Plain(LogLocator):
    """Places of numbers on a logarithmic axis: multiples of each power of ten, or few at equal distances."""

    def __init__(self, steps: Sequence[float]) -> None:
        super().__init__(subs=steps or (1.0,))
        self._by_length = not steps

    def tick_values(self, vmin: float, vmax: float) -> Any:
        if vmax <= SHORT * vmin:
            return MaxNLocator(4).tick_values(vmin, vmax)
        if self._by_length:
            self.set_params(subs=next(steps for ratio, steps in NUMBERS.items() if vmax < ratio * vmin))
        return super().tick_values(vmin, vmax)


def plain_ticks(axis: Any, steps: Sequence[float] = ()) -> None:
    """Label a logarithmic axis with plain numbers: these multiples of each power of ten, or those of `NUMBERS`.

    On an axis up to `SHORT` the numbers are few and equally far apart.
    """
    axis.set_major_locator(_Plain(steps))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def marked(states: int, order: int = 0) -> Any:
    """Return which of the computed states of a curve have a marker: all, or some at equal distances on paper.

    These are shifted from curve to curve, so that curves that coincide can be seen apart.
    """
    return None if states <= MANY else (0.03 * (order % 4), 0.12)


def legend(ax: Axes, title: str, handles: Sequence[Any] | None = None) -> None:
    """Put the legend above the axes, where it cannot cover data, in as many columns as fit."""
    handles = ax.get_legend_handles_labels()[0] if handles is None else handles
    lengths = [len(re.sub(r"\\[a-z]+|[${}^_]", "", str(handle.get_label()))) for handle in handles]
    fit = max(1, WIDE // (6 + max(lengths, default=0)))
    rows = -(-len(lengths) // fit) or 1
    options: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "borderaxespad": 0.2}
    options |= {"handlelength": 1.8, "handletextpad": 0.4, "columnspacing": 0.9, "labelspacing": 0.3}
    options |= {"ncols": max(1, -(-len(lengths) // rows))}
    made = ax.legend(handles=handles, title=title.removeprefix("; ") or None, **options)
    made.get_title().set_multialignment("center")
