"""The one number of several surfaces: the convention of each quantity, its range, and the counts.

Patches are samples of one joint. A flow varies by decades between patches and is 0 where a patch is closed: its number
is the median over surfaces, with the 16 to 84 % range, and a closed surface counts as 0. A median of 0 is missing where
the surfaces without a value might open it. Every other quantity has the arithmetic mean over the surfaces that have a
value.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from xarray import DataArray, Dataset

from roughvol.observables.variables import row_of
from roughvol.typing import Array

RANGE = (0.16, 0.84)
END = "bound"
"""The dimension of the ends of a range and of an interval."""
BOUNDS = ("lower", "upper")
IN_WORDS = "median and 16-84 % range over the surfaces, closed surfaces counted as 0"


@dataclass(frozen=True, eq=False)
class Average:
    """The number of several surfaces, NaN without a value, the values that are known, and the number of surfaces."""

    value: float
    known: Array
    surfaces: int

    @property
    def count(self) -> int:
        """Return how many surfaces have a value."""
        return self.known.size

    @property
    def low(self) -> float:
        """Return the lower end of the range."""
        return self._end(RANGE[0])

    @property
    def high(self) -> float:
        """Return the upper end of the range."""
        return self._end(RANGE[1])

    def _end(self, share: float) -> float:
        return math.nan if math.isnan(self.value) else float(np.quantile(self.known, share))


def is_flow(name: str) -> bool:
    """Return whether the number of several surfaces is a median, as for ``leak_rate`` and ``leak_rate_x``."""
    row = row_of(name)
    return row is not None and row.averaged == "median"


def average(name: str, values: ArrayLike) -> Average:
    """Return the number of several surfaces; a value is NaN where a surface has none, 0 where its flow is closed."""
    all_values = np.atleast_1d(np.asarray(values, dtype=np.float64)).ravel()
    known = all_values[np.isfinite(all_values)]
    if known.size == 0:
        return Average(math.nan, known, all_values.size)
    is_median = is_flow(name)
    value = float(np.median(known) if is_median else known.mean())
    if is_median and value == 0.0 and 2 * np.count_nonzero(known == 0.0) <= all_values.size:
        value = math.nan
    return Average(value, known, all_values.size)


def averages(surfaces: Dataset, over: str = "seed") -> Dataset:
    """Return each variable without a dimension, beside ``<name>_range`` along ``bound`` and ``<name>_count``.

    An interval has no average: variables along ``bound`` are left out.
    """
    found: dict[str, DataArray] = {}
    surfaces = surfaces.drop_vars(END, errors="ignore")  # of an ensemble, one end may be chosen
    for key, variable in surfaces.data_vars.items():
        name = str(key)
        if over not in variable.dims or END in variable.dims or variable.dtype.kind not in "fib":
            continue
        values = variable.transpose(over, ...)
        numbers = np.apply_along_axis(partial(_numbers, name), 0, values.values.astype(float))
        dims, attrs = values.dims[1:], dict(variable.attrs)
        words = f"{'median' if is_flow(name) else 'mean'} over surfaces of {attrs.get('long_name', name)}"
        found[name] = DataArray(numbers[0], dims=dims, attrs=attrs | {"long_name": words})
        ends = attrs | {"long_name": f"16 and 84 % over surfaces of {attrs.get('long_name', name)}"}
        found[f"{name}_range"] = DataArray(numbers[1:3], {END: list(BOUNDS)}, (END, *dims), attrs=ends)
        found[f"{name}_count"] = DataArray(numbers[3].astype(int), dims=dims, attrs={"units": "1"})
    kept = {name: coord for name, coord in surfaces.coords.items() if over not in coord.dims}
    return Dataset(found, coords=kept, attrs=surfaces.attrs)


def _numbers(name: str, values: ArrayLike) -> tuple[float, float, float, int]:
    found = average(name, values)
    return found.value, found.low, found.high, found.count
