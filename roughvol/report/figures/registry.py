"""The tables of figures, ``figures.toml``, one row a figure: drawing, caption, variables, cases; and what is refused.

`FIGURES` are drawn from a stored run by ``roughvol plot`` and ``roughvol report``, `TRADEOFF` by ``roughvol tradeoff``.
"""

from __future__ import annotations

from xarray import Dataset

from roughvol.analysis import leak
from roughvol.report.figures import ensembles, seal, spectra, work_precision, yielding
from roughvol.report.figures.figure import Figure, Refusal, figures_of


def _lifted(name: str, ds: Dataset) -> str | None:
    if leak.is_lifted(ds):
        return f"{name} shows the gap without fluid pressure; allowed with record.fluid_pressure: leak_of_p"
    return None


def _without(variable: str, words: str) -> Refusal:
    """Return the refusal of datasets without a variable."""
    return lambda name, ds: None if variable in ds else f"{name} needs {words}"


def _unmapped(name: str, ds: Dataset) -> str | None:
    """Return the refusal of datasets without a state that has both fields."""
    if {"flux_at", "field_at"} <= set(ds.coords) and not seal.mapped(ds):
        return f"{name} needs flux and gap at one state that is reached: give record.fields_at the states of flux_at"
    return None


def _ladder(ladder: str) -> Refusal:
    """Return the refusal of trade-offs without a ladder."""
    words = f"needs the ladder {ladder!r}, which a height file does not have"
    return lambda name, ds: None if ladder in ds["ladder"].values else f"{name} {words}"


REFUSALS = {
    "seal_transmissivity": _lifted,
    "seal_leak_rate": _lifted,
    "seal_map": _unmapped,
    "path_loops": _without("leg", "a path, as sweep: [{steps: 30, to: {pressure: 1}}, {steps: 30, to: {pressure: 0}}]"),
    "ensemble_cost": _without("ensemble_samples", "a study with a section 'ensemble'"),
    "psd": _without("psd", "the power spectral density: add record: {psd: true}"),
    "tradeoff_precision": _ladder("tolerance"),
    "tradeoff_resolution": _ladder("resolution"),
    "tradeoff_settings": _ladder("steps"),
}
"""Why a dataset cannot be drawn, beside a variable that it lacks, by figure."""
FIGURES: dict[str, Figure] = figures_of(__file__, (seal, yielding, ensembles, spectra), refusals=REFUSALS)
TRADEOFF: dict[str, Figure] = figures_of(__file__, (work_precision,), refusals=REFUSALS)
