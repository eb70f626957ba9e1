"""The tables of figures, one row a figure: drawing, cases, refusals; captions and variables in ``registry.toml``.

`FIGURES` are drawn from a stored run by ``roughvol plot`` and ``roughvol report``, `TRADEOFF` by ``roughvol tradeoff``.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from xarray import Dataset

from roughvol.analysis import leak
from roughvol.report.figures import ensembles, seal, spectra, work_precision, yielding
from roughvol.report.figures.cases import Rule, by_D, by_m, single
from roughvol.report.figures.figure import Figure, Refusal, none_refused, table
from roughvol.report.figures.style import Drawing

_FILE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def _lifted(name: str, ds: Dataset) -> str | None:
    if leak.is_lifted(ds):
        return f"{name} shows the gap without fluid pressure; allowed with record.fluid_pressure: leak_of_p"
    return None


def _without(variable: str, words: str) -> Refusal:
    """Return the refusal of datasets without a variable."""
    return lambda name, ds: None if variable in ds else f"{name} needs {words}"


def _ladder(ladder: str) -> Refusal:
    """Return the refusal of datasets without a ladder of a trade-off."""

    def refuse(name: str, ds: Dataset) -> str | None:
        if "ladder" not in ds.coords:
            return f"{name} needs a dataset of `roughvol tradeoff`"
        if ladder not in ds["ladder"].values:
            return f"{name} needs the ladder {ladder!r}, which a height file does not have"
        return None

    return refuse


_ENSEMBLE = _without("ensemble_samples", "a study with a section 'ensemble'")
_PATH = _without("leg", "a path, as sweep: [{steps: 30, to: {pressure: 1}}, {steps: 30, to: {pressure: 0}}]")
_PSD = _without("psd", "the power spectral density: add record: {psd: true}")


def _row(draw: Callable[[Any], Drawing], cases: Rule = by_D, refuse: Refusal = none_refused) -> Figure:
    """Return the row of a figure, with its caption and its variables from the file beside this module."""
    row = dict(_FILE["figures"][draw.__name__])
    caption = " ".join([row.pop("caption"), *(_FILE["shared"][name] for name in row.pop("shared", ()))])
    return Figure(draw, caption, tuple(row.pop("needs", ())), cases, refuse, **row)


FIGURES = table(
    _row(seal.seal_volume),
    _row(seal.seal_percolation),
    _row(seal.seal_transmissivity, refuse=_lifted),
    _row(seal.seal_diffusivity),
    _row(seal.seal_leak_rate, refuse=_lifted),
    _row(seal.seal_region, lambda cases: by_m(by_D(cases))),
    _row(seal.seal_estimates),
    _row(seal.seal_map, single),
    _row(yielding.path_loops, refuse=_PATH),
    _row(yielding.yielded_map, single),
    _row(ensembles.ensemble_cost, list, _ENSEMBLE),
    _row(spectra.psd, refuse=_PSD),
)

TRADEOFF = table(
    _row(work_precision.tradeoff_precision, refuse=_ladder("tolerance")),
    _row(work_precision.tradeoff_resolution, refuse=_ladder("resolution")),
    _row(work_precision.tradeoff_settings, refuse=_ladder("steps")),
)
