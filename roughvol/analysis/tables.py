"""Tables of a report: rows of text under a head, and numbers in four digits."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from xarray import Dataset, Variable

from roughvol.observables.variables import AXES, along

SMALLEST, LARGEST = 1e-4, 1e6  # numbers between them have no exponent
SLACK = 0.02  # of the last digit: a number that far beyond it is this number, as a search is no closer


@dataclass(frozen=True)
class Table:
    """Rows of text under a head, with a sentence above."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def under(self, words: str) -> Table:
        """Return the table with words in front of its title."""
        return replace(self, title=", ".join(filter(None, (words, self.title))))


def by_direction(ds: Dataset) -> dict[str, Variable]:
    """Return the variables of a dataset by name, those of each direction, as ``leak_rate_x``, in place of ``axis``."""
    columns: dict[str, Variable] = {}
    for name, variable in ds.variables.items():
        if "axis" not in variable.dims:
            columns[str(name)] = variable
        elif name != "axis":
            symbol = str(variable.attrs.get("symbol", name))
            for axis in AXES:
                part = columns[f"{name}_{axis}"] = variable.isel(axis=ds.indexes["axis"].get_loc(axis))
                part.attrs["symbol"] = along(symbol, axis)
    return columns


def spread(ds: Dataset) -> Dataset:
    """Return a dataset with the variables of `by_direction`."""
    columns = by_direction(ds)
    return Dataset(columns, attrs=ds.attrs).set_coords(columns.keys() & ds.coords.keys())


def number(value: float, digits: int = 4) -> str:
    """Return a number in four digits, as 0.06103 or 2.2e-5, in two 450; a dash where there is none."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    plain = f"{float(text):g}" if 1.0 <= abs(value) < 1e4 else text
    return _short_power(plain)


def _short_power(text: str) -> str:
    """Return a number in text with its power of ten without a plus and without leading zeros, as 2.2e-5 and 9.3e12."""
    return re.sub(r"e\+?(-?)0*", r"e\1", text)


def evenly(count: int, most: int) -> list[int]:
    """Return at most so many of ``count`` places, at even distances, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()


def range_text(counts: Sequence[int]) -> str:
    """Return the smallest and the largest of numbers, as ``4 to 10``."""
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"


def rounded(value: float, low: float, high: float, *, upwards: bool | None = None) -> str:
    """Return a number in the digits that its interval leaves, two to six of them: the nearest, or on one side.

    A number whose interval is not known has two digits. A number without error has four at most.
    """
    half = 0.5 * (high - low)
    if not (math.isfinite(value) and value != 0.0):
        return number(value)
    size, known = math.floor(math.log10(abs(value))), math.isfinite(half) and half > 0.0
    digits = 4 if half == 0.0 else 2
    if known:
        digits = min(max(size - math.floor(math.log10(half)) + 1, 2), 6)
    decimals = digits - 1 - size
    last = 10.0**-decimals
    if upwards is not None:
        value = last * (math.ceil(value / last - SLACK) if upwards else math.floor(value / last + SLACK))
    value = round(value, decimals)
    if not known:
        return number(value, digits)
    if not SMALLEST <= abs(value) < LARGEST:
        return _short_power(f"{value:.{digits - 1}e}")
    return f"{value:.{max(decimals, 0)}f}"


def with_interval(value: float, low: float, high: float, *, upwards: bool | None = None) -> tuple[str, str, str]:
    """Return a number as `rounded` does, and its interval in as many digits, rounded outwards."""
    sides = (value, upwards), (low, False), (high, True)
    first, second, third = (rounded(end, low, high, upwards=side) for end, side in sides)
    return first, second, third
