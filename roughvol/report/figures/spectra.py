"""The figure of the power spectral density, with the law asked for, and of the slope by scale.

It is a function of the dataset of a study with ``record: {psd: true}``.
"""

from __future__ import annotations

import numpy as np
from xarray import Dataset

from roughvol.report.figures.curves import shown
from roughvol.report.figures.families import Family, families, named, several
from roughvol.report.figures.style import GREY, PAGE, Drawing, axes, legend, marked, plain_ticks, unit_of
from roughvol.store.variants import study_in
from roughvol.study import SpectralSurface
from roughvol.surfaces.waves import density
from roughvol.typing import Array

ROUNDING = 1e-24  # of the largest density: waves beyond L/λ_s are zero but for rounding


def psd(ds: Dataset) -> Drawing:
    """Draw the radial power spectral density C^iso, and the root mean square slope of the waves up to each one.

    Means of the squares over the surfaces of each D, at the finest m. Dashed: the law of a study with a spectrum.
    Dotted: the deformed surface, at the last state of ``psd_at``. To see: a plateau up to L/λ_r, then a line of slope
    -2 - 2H up to L/λ_s; the slope grows up to the shortest wave. Load takes the long waves first.
    """
    fig, (left, right) = axes(PAGE, 3.0, 2, grid=True)
    members, title = families(ds, "D", "psd", "rms_slope_below")
    number, law, lacking = several(family.surfaces for family in members), "", ""
    loaded = _loaded_at(ds) if "psd_loaded" in ds else ""
    for order, family in enumerate(members):
        wave = _waves(family)
        every = marked(wave.size, order)
        for ax, name, power in ((left, "psd", 1.0), (right, "rms_slope_below", 2.0)):
            lines = ax.loglog(wave, _mean(family, name, power), label=family.label, markevery=every, **family.look)
            named(ax, lines, family)
            if loaded:
                under = _mean(family, f"{name}_loaded", power)
                reached = family.data[f"{name}_loaded"].isel(psd_at=-1).notnull().any("wave")
                lacking = lacking if bool(reached.all()) else ", where all surfaces reach it"
                lines = ax.loglog(wave, under, color=family.look["color"], ls=":", lw=1.3)
                named(ax, lines, family, curve=f"{family.label}, {loaded}")
        if (asked := _asked(ds, family, wave)).size:
            law = "dashed: the law of the study"
            lines = left.loglog(wave, asked, color=GREY, ls="--", lw=0.8, zorder=0)
            named(left, lines, family, curve=f"{family.label}, law of the study")
    fourth = unit_of(ds, "psd")
    left.set(xlabel=r"wave number $qL/2\pi$", ylabel=rf"$C^{{\mathrm{{iso}}}}$ [{fourth}]")
    right.set(xlabel=r"waves up to $qL/2\pi$", ylabel=r"root mean square slope $h'_{\mathrm{rms}}$")
    dotted = f"dotted: {loaded}{lacking}" if loaded else ""
    mean = "; ".join(filter(None, [title, f"mean of {number} surfaces" if number else ""]))
    for ax, dashed in ((left, law), (right, "")):
        plain_ticks(ax.xaxis)
        legend(ax, "\n".join(filter(None, [mean, ", ".join(filter(None, [dashed, dotted]))])))
    fig.shown = shown(members)
    return fig


def _mean(family: Family, name: str, power: float) -> Array:
    """Return the mean of a power over the surfaces, and its root; NaN where only rounding is left of it."""
    data = family.data[name]
    if "psd_at" in data.dims:
        data = data.isel(psd_at=-1)
    values = data.transpose("seed", "wave").values ** power
    mean: Array = values.mean(axis=0) ** (1.0 / power)
    return np.where(mean > ROUNDING * np.nanmax(mean, initial=0.0), mean, np.nan)


def _waves(family: Family) -> Array:
    """Return q L/2π of the rings, with L that of the whole surface; those of a region are fewer."""
    if "wave_number" not in family.data or family.data["wave_number"].isnull().all():  # of a list of regions, the whole
        return np.asarray(family.data["wave"].values, dtype=np.float64)
    wave_number: Array = family.data["wave_number"].isel(seed=0).values
    return wave_number * float(family.data["L"]) / (2.0 * np.pi)


def _loaded_at(ds: Dataset) -> str:
    """Return the last state under load in words."""
    kind, _, value = str(ds["psd_at"].values[-1]).partition("=")
    return "end of the sweep" if kind == "last" else f"{kind.replace('_', ' ')} {value}"


def _asked(ds: Dataset, family: Family, wave: Array) -> Array:
    """Return the law that a study asks for at the waves, empty without one."""
    study = study_in(ds)
    if study is None or not isinstance(study.surface, SpectralSurface) or study.surface.anisotropy > 1.0:
        return np.empty(0)
    values = density(study.surface.spectrum, 3.0 - family.value, float(ds["L"]), wave)
    return np.where(values > 0.0, values, np.nan)
