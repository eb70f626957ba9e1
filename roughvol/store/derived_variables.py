"""Stored variables that follow from others: texture of parts, numbers at states, and means of an ensemble."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from roughvol.store.variable import Variable, rows

OF_STATE = ("indentation", "separation", "contact_area_fraction", "mean_pressure", "free_volume")
"""Numbers that every state has, between two steps as well."""
OF_WHOLE = ("Sq", "Sdq", "hurst_measured")
"""Texture of the whole surface, stored in every study."""

OF_ENSEMBLE = {
    "ensemble_at": Variable("ensemble_at", "1", "state of the means over all surfaces", "state", "text"),
    "bound": Variable("bound", "1", "end of an interval", "bound", "text"),
    "round": Variable("round", "1", "round of samples", "k", "index"),
    "ensemble_samples": Variable("D m", "1", "samples of the ensemble on each level", "n_m", "count"),
    "ensemble_surfaces": Variable("D", "1", "surfaces without a solve, as control variates", "N", "count"),
    "ensemble_sample_cost": Variable("D m", "s", "modelled cost of one sample", "C_m"),
    "ensemble_cost": Variable("D", "s", "modelled cost of all samples", "C"),
    "ensemble_plain_cost": Variable("D", "s", "the same for plain Monte Carlo at the accuracy asked for", "C_0"),
    "ensemble_round_cost": Variable("D round", "s", "modelled cost of the samples up to each round", "C(k)"),
}
OF_VOID = {  # name: long name, symbol
    "connected_volume_fraction": ("free volume connected to a side over all", "V_con/V"),
    "transmissivity": ("flow with g^3 over that of plates at the mean gap, mean of both axes", "T*"),
    "log_leak_rate": ("decimal logarithm of T* V*^3, mean of both axes", "log10(T* V*^3)"),
    "percolation_pressure": ("mean pressure at which no way is left along x or y", "p_c*"),
    "percolation_pressure_x": ("mean pressure at which no way is left along x", "p_c,x*"),
    "percolation_pressure_y": ("mean pressure at which no way is left along y", "p_c,y*"),
}
"""Quantities of the void whose means an ensemble estimates."""
OF_MEAN = {  # suffix: dimensions, long name, symbol
    "mean": ("D ensemble_at", "mean over all surfaces of the {}", "<{}>"),
    "interval": ("D ensemble_at bound", "95 % interval of the mean over all surfaces of the {}", "<{}>"),
    "bias": ("D ensemble_at", "bias by the resolution of the mean of the {}; missing: no limit", "b({})"),
    "freedom": ("D ensemble_at", "degrees of freedom of the interval of the {}", "ν({})"),
    "accuracy_asked": ("D ensemble_at", "half-width asked for of the mean of the {}", "h({})"),
    "step_error": ("D ensemble_at", "error between steps of the mean of the {}", "ε_k({})"),
    "step_error_high": ("D ensemble_at", "whether that error passes h/10, of the {}", "ε_k({}) > h/10"),
    "solver_error": ("D ensemble_at", "certified error by the solver of the mean of the {}", "η({})"),
    "level_mean": ("D m ensemble_at", "mean on each level of the {}", "<{}>_m"),
    "level_variance": ("D m ensemble_at", "variance over surfaces on each level of the {}", "s²({})"),
    "level_residual": ("D m ensemble_at", "variance left by the next coarser level of the {}", "r²({})"),
    "level_correlation": ("D m ensemble_at", "correlation with the next coarser level of the {}", "ρ({})"),
    "level_samples": ("D m ensemble_at", "samples used on each level for the mean of the {}", "n({})"),
    "round_half_width": ("D ensemble_at round", "half-width of the interval after each round of the {}", "h_k({})"),
}
SPECTRUM = rows(
    "surfaces.psd.spectral",
    "",
    wave=Variable("wave", "1", "ring of wave numbers, q L/2π with L that of the region", "qL/2π", "index"),
    wave_number=Variable("... wave", "length^-1", "wave number of the ring in the region", "q"),
    psd=Variable("... wave", "length^4", "radially averaged power spectral density", "C^iso(q)", height_power=2),
    rms_height=Variable("...", "length", "root mean square height of all waves", "h_rms", height_power=1),
    rms_slope=Variable("...", "1", "root mean square slope of all waves", "h'_rms", height_power=1),
    rms_curvature=Variable(
        "...", "length^-1", "root mean square of the mean curvature of all waves", "h''_rms", height_power=1
    ),
    rms_height_below=Variable(
        "... wave", "length", "root mean square height of the waves up to the ring", "h_rms(q)", height_power=1
    ),
    rms_slope_below=Variable(
        "... wave", "1", "root mean square slope of the waves up to the ring", "h'_rms(q)", height_power=1
    ),
    rms_curvature_below=Variable(
        "... wave", "length^-1", "root mean square curvature of the waves up to the ring", "h''_rms(q)", height_power=1
    ),
    nayak_parameter=Variable("...", "1", "Nayak's parameter m_0 m_4/m_2^2", "α"),
)
"""The spectrum of the undeformed surface in the region, where a study asks for it."""
SPECTRUM |= rows(
    "surfaces.psd.spectral",
    "psd",
    **{
        f"{name}_loaded": replace(
            row,
            dims=row.dims.replace("...", "... psd_at"),
            long_name=f"{row.long_name}, of the deformed surface under load",
            symbol=f"{row.symbol}(load)",
        )
        for name, row in SPECTRUM.items()
        if not name.startswith("wave")
    },
)
FLAGS = {"step_error_high": "flag"}


def of_parts(table: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return the texture of a region, of the surface under load, and of the surface left by plastic displacement.

    Parameters
    ----------
    table : mapping
        Rows by name, with those of ``surfaces.texture``.

    Returns
    -------
    dict
        Rows ``…_region``, ``…_loaded`` and ``…_residual``.
    """
    region = {
        f"{name}_region": replace(
            _texture(table[name]),
            long_name=f"{table[name].long_name}, of the region",
            symbol=f"{table[name].symbol}(region)",
        )
        for name in OF_WHOLE
    }
    texture = [name for name, row in table.items() if row.source == f"surfaces.texture.{name}" and name not in OF_WHOLE]
    loaded = {
        f"{name}_loaded": replace(
            _texture(table[name]),
            dims=table[name].dims.replace("...", "... texture_at"),
            long_name=f"{table[name].long_name}, of the deformed surface under load",
            symbol=f"{table[name].symbol}(load)",
        )
        for name in (*OF_WHOLE, *texture)
    }
    residual = {
        f"{name}_residual": replace(
            _texture(table[name]),
            long_name=f"{table[name].long_name}, of the surface left by plastic displacement",
            symbol=f"{table[name].symbol}(residual)",
        )
        for name in (*OF_WHOLE, *texture)
    }
    return region | loaded | residual


def _texture(row: Variable) -> Variable:
    """Return a row of the observable ``texture``, from the function of heights."""
    return replace(row, source=row.source.replace("surface.Surface", "texture"), observable="texture")


def at_states(table: Mapping[str, Variable], dims: Iterable[str]) -> dict[str, Variable]:
    """Return the step and the numbers at each recorded state.

    Parameters
    ----------
    table : mapping
        Rows by name, with `OF_STATE`.
    dims : iterable of str
        Dimensions along which states are recorded, as ``field_at``.

    Returns
    -------
    dict
        Rows ``<dim>_step``, and ``<dim>_<name>`` of each of `OF_STATE`.
    """
    derived: dict[str, Variable] = {}
    for dim in dims:
        step = Variable(f"... {dim}", "1", "first step at the state or beyond it, -1 if not reached", "k", "index")
        derived |= rows("observables.levels.reached", **{f"{dim}_step": step})
        derived |= {
            f"{dim}_{name}": replace(table[name], dims=f"... {dim}", long_name=f"{table[name].long_name}, at the state")
            for name in OF_STATE
        }
    return derived


def of_ensembles(table: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return the means over all surfaces with their intervals, errors, levels and costs.

    Parameters
    ----------
    table : mapping
        Rows by name, with `OF_STATE`.

    Returns
    -------
    dict
        Rows `OF_ENSEMBLE`, and ``<name>_<suffix>`` of each of `OF_STATE`, `OF_VOID` and `OF_MEAN`.
    """
    averaged = {name: (table[name].long_name, table[name].symbol) for name in OF_STATE} | OF_VOID
    of_mean = {
        f"{name}_{suffix}": Variable(
            dims, "1", title.format(averaged[name][0]), symbol.format(averaged[name][1]), FLAGS.get(suffix, "real")
        )
        for name in averaged
        for suffix, (dims, title, symbol) in OF_MEAN.items()
    }
    return rows("campaign.answered.variables", **OF_ENSEMBLE, **of_mean)
