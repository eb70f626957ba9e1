"""The table of stored variables: dimensions, units, long name, symbol, kind, and the function each comes from.

A row is all that the store needs of a variable: fields are compressed, heights scaled and states found by the table.
See docs/observables.md for how to add one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Variable:
    """One row of the table.

    Attributes
    ----------
    dims : names of the dimensions; ``...`` for those of the case.
    units : units, ``length`` for that of the study.
    long_name : the variable in words.
    symbol : as in the paper or in ISO 25178-2.
    kind : "real", "count" (missing: NaN), "index" (missing: -1), "flag" (missing: False) or "text".
    height_power : power of the heights in it, where they are scaled and the plane is not.
    source : function, method or attribute in the package that gives the value, as ``surfaces.texture.Sq``.
    observable : label of the observable it belongs to, as ``percolation``; empty where every study stores it.
    """

    dims: str
    units: str
    long_name: str
    symbol: str
    kind: str = "real"
    height_power: int = 0
    source: str = ""
    observable: str = ""


def _rows(source: str, observable: str = "", /, **rows: Variable) -> dict[str, Variable]:
    """Return rows of one source and observable; ``{name}`` in the source is the name of the row."""
    return {name: replace(row, source=source.format(name=name), observable=observable) for name, row in rows.items()}


VARIABLES: dict[str, Variable] = {}
# coordinates
VARIABLES |= _rows(
    "study.cases.Case",
    D=Variable("D", "1", "fractal dimension of the surface", "D"),
    m=Variable("m", "1", "levels of midpoint displacement; 2^m + 1 nodes per side", "m", "index"),
    seed=Variable("seed", "1", "seed of the random stream of heights", "seed", "index"),
    case=Variable("case", "1", "height file", "case", "text"),
    L=Variable("", "length", "length of the first axis", "L"),
)
VARIABLES |= _rows(
    "observables.reduction.Reduction",
    step=Variable("step", "1", "loading step", "k", "index"),
)
VARIABLES |= _rows(
    "observables.reduction.of_surface",
    x=Variable("x", "1", "position along the first axis over L", "x/L"),
    y=Variable("y", "1", "position along the second axis over L", "y/L"),
)
VARIABLES |= _rows(
    "study.sweep.Legs.legs",
    leg=Variable("step", "1", "leg of the path, from 1", "leg", "index"),
)
VARIABLES |= _rows(
    "study.record.Select.levels",
    field_at=Variable("field_at", "1", "state at which fields are kept", "state", "text"),
    density_at=Variable("density_at", "1", "state of the density of element volumes", "state", "text"),
    box_at=Variable("box_at", "1", "state of the box counting", "state", "text"),
    flux_at=Variable("flux_at", "1", "state at which fluxes are kept", "state", "text"),
    texture_at=Variable("texture_at", "1", "state under load at which texture is taken", "state", "text"),
)
VARIABLES |= _rows(
    "observables.free_volume.volume_density",
    bin=Variable("bin", "1", "bin of the density", "k", "index"),
    edge=Variable("edge", "1", "edge of the bins of the density", "k", "index"),
)
VARIABLES |= _rows(
    "study.record.BoxCounting",
    threshold=Variable("threshold", "1", "threshold over the largest element volume", "v_th/v_max"),
)
VARIABLES |= _rows(
    "observables.box_counting.box_counts",
    r=Variable("r", "1", "side of the boxes in elements", "r/δ", "index"),
)
VARIABLES |= _rows(
    "observables.box_counting.local_dimension",
    r_mid=Variable("r_mid", "1", "geometric mean of two box sides in elements", "r/δ"),
)
VARIABLES |= _rows(
    "observables.void.size_classes",
    size=Variable("size", "1", "smallest size in elements of the class that ends below twice it", "n", "index"),
)
VARIABLES |= _rows(
    "observables.void.AXES",
    axis=Variable("axis", "1", "axis of the surface", "axis", "text"),
)
VARIABLES |= _rows(
    "study.record.RegionWidths",
    region_width=Variable("region_width", "1", "width of a central region over that of the surface", "w/L"),
)
VARIABLES |= _rows(
    "observables.recorded.asked",
    observable=Variable("observable", "1", "what a study records beside the numbers of every step", "q", "text"),
)
# per surface
VARIABLES |= _rows(
    "surfaces.surface.Surface.Sq",
    Sq=Variable("...", "length", "root mean square height about the mean plane", "Sq", height_power=1),
)
VARIABLES |= _rows(
    "surfaces.texture.Sdq",
    Sdq=Variable("...", "1", "root mean square slope", "Sdq", height_power=1),
)
VARIABLES |= _rows(
    "surfaces.surface.Surface.z_max",
    z_max=Variable("...", "length", "height of the highest point", "z_max", height_power=1),
)
VARIABLES |= _rows(
    "observables.reduction.of_surface",
    nodes_x=Variable("...", "1", "nodes along the first axis", "n_x", "count"),
    nodes_y=Variable("...", "1", "nodes along the second axis", "n_y", "count"),
)
VARIABLES |= _rows(
    "surfaces.surface.Surface.filled",
    filled_fraction=Variable("...", "1", "share of the nodes whose height was missing and filled", "n_f/n"),
)
VARIABLES |= _rows(
    "surfaces.surface.Surface.outliers",
    outliers_removed=Variable("...", "1", "number of measured heights taken out as outliers", "n_o", "count"),
)
VARIABLES |= _rows(
    "surfaces.surface.Surface.peak",
    peak_height=Variable("...", "1", "height of the highest point above the mean plane over Sq", "z_p/Sq"),
)
VARIABLES |= _rows(
    "surfaces.surface.Surface.peak_before",
    peak_height_before=Variable("...", "1", "the same with the outliers left in", "z_p,0/Sq"),
)
VARIABLES |= _rows(
    "surfaces.texture.hurst_spectrum",
    hurst_measured=Variable("...", "1", "Hurst exponent from the power spectrum", "H"),
)
VARIABLES |= _rows(
    "campaign.one_case.run_case",
    wall_time=Variable("...", "s", "wall-clock time spent on the case", "t"),
)
VARIABLES |= _rows(
    "observables.reduction.Reduction",
    observable_time=Variable("... observable", "s", "wall-clock time spent on it, all states together", "t_q"),
)
VARIABLES |= _rows(
    "observables.along_steps.AlongSteps",
    region_aspect=Variable("...", "1", "extent of the region observed along y over that along x", "W_y/W_x"),
)
VARIABLES |= _rows(
    "surfaces.surface.Surface.heights",
    heights=Variable("... x y", "length", "heights of the undeformed surface", "z", height_power=1),
)
VARIABLES |= _rows(
    "observables.pressures.central_pressure_ratio",
    central_pressure_ratio=Variable(
        "...", "1", "mean pressure in the central half of each side over that of the whole, last step", "p_c/p"
    ),
)
# per step
VARIABLES |= _rows(
    "contact.state.Contact.{name}",
    indentation=Variable("... step", "1", "far-field closing displacement from first touch over Sq", "Δ/σ"),
    separation=Variable("... step", "1", "rigid far-field separation of the mean planes over Sq", "d/σ"),
    contact_area_fraction=Variable("... step", "1", "fraction of elements in contact", "A*"),
    mean_pressure=Variable("... step", "1", "mean pressure times L/(E* Sq)", "p*"),
    free_volume=Variable("... step", "1", "mean gap over Sq", "V*"),
    iterations=Variable("... step", "1", "iterations of the solver", "iterations", "count"),
    convolutions=Variable("... step", "1", "convolutions in double precision, of the full grid", "n_64"),
    convolutions_fp32=Variable("... step", "1", "convolutions in single precision, of the full grid", "n_32"),
    residual=Variable("... step", "1", "largest violation of the contact conditions in the gap over Sq", "η/σ"),
    mean_pressure_bound=Variable("... step", "1", "certified bound of the relative error of p*", "|δp*|/p*"),
    converged=Variable("... step", "1", "the state was solved and met its residual", "converged", "flag"),
)
# where pressures end at a hardness
VARIABLES |= _rows(
    "contact.state.Contact.{name}",
    plastic_volume=Variable("... step", "1", "mean plastic displacement over Sq", "u_pl/σ"),
    plastic_area_fraction=Variable("... step", "1", "fraction of elements that have yielded", "A_pl*"),
)
VARIABLES |= _rows(
    "observables.plastic.residual",
    residual_heights=Variable(
        "... x y", "length", "heights less the plastic displacement, at the end of the path", "z - u_pl", height_power=1
    ),
)
# where a hardness is given for comparison alone
VARIABLES |= _rows(
    "observables.pressures.above",
    contact_above_hardness_fraction=Variable(
        "... step", "1", "share of the contact with a pressure above the hardness", "A_H/A"
    ),
    load_above_hardness_fraction=Variable(
        "... step", "1", "share of the load on elements with a pressure above the hardness", "F_H/F"
    ),
)
# of the void, at the steps a study selects; open: gap > 0; void 4-connected, contact 8-connected
VARIABLES |= _rows(
    "observables.transport.connectivity",
    "percolation",
    percolates_x=Variable("... step", "1", "1 if void leads from side to side along x, 0 if not", "Π_x", "count"),
    percolates_y=Variable("... step", "1", "1 if void leads from side to side along y, 0 if not", "Π_y", "count"),
    connected_volume_fraction=Variable("... step", "1", "free volume connected to a side over all", "V_con/V"),
    percolating_volume_fraction=Variable(
        "... step", "1", "free volume that percolates along x or y, over all", "V_per/V"
    ),
    trapped_volume_fraction=Variable("... step", "1", "free volume connected to no side over all", "V_tra/V"),
    contact_clusters=Variable("... step", "1", "clusters of contact", "n_c", "count"),
    trapped_pockets=Variable("... step", "1", "pockets of void connected to no side", "n_t", "count"),
    contact_clusters_by_size=Variable("... step size", "1", "clusters of contact in the class", "n_c(n)", "count"),
    trapped_pockets_by_size=Variable("... step size", "1", "pockets of void in the class", "n_t(n)", "count"),
)
VARIABLES |= _rows(
    "observables.transport.constriction",
    "constriction",
    critical_gap_x=Variable("... step", "1", "largest gap over Sq still open from side to side along x", "h_c,x/σ"),
    critical_gap_y=Variable("... step", "1", "largest gap over Sq still open from side to side along y", "h_c,y/σ"),
    critical_position_x=Variable("... step axis", "1", "position of the critical gap along x over L", "x_c,x/L"),
    critical_position_y=Variable("... step axis", "1", "position of the critical gap along y over L", "x_c,y/L"),
)
VARIABLES |= _rows(
    "observables.transport.conduction",
    "transmissivity",
    transmissivity_x=Variable("... step", "1", "flow along x with g^3, over that of plates at the mean gap", "T_x*"),
    transmissivity_y=Variable("... step", "1", "flow along y with g^3, over that of plates at the mean gap", "T_y*"),
    transmissivity_conservation_error=Variable("... step", "1", "inflow against outflow over the flow", "ε_T"),
)
VARIABLES |= _rows(
    "observables.transport.conduction",
    "diffusivity",
    diffusivity_x=Variable("... step", "1", "flow along x with g, over that of plates at the mean gap", "D_x*"),
    diffusivity_y=Variable("... step", "1", "flow along y with g, over that of plates at the mean gap", "D_y*"),
    diffusivity_conservation_error=Variable("... step", "1", "inflow against outflow over the flow", "ε_D"),
)
VARIABLES |= _rows(
    "observables.transport.effective_medium",
    "estimates",
    estimate_medium_transmissivity=Variable(
        "... step", "1", "effective-medium estimate of the transmissivity", "T_em*"
    ),
    estimate_medium_diffusivity=Variable("... step", "1", "effective-medium estimate of the diffusivity", "D_em*"),
)
VARIABLES |= _rows(
    "observables.transport.single_junction",
    "estimates",
    estimate_junction_transmissivity_x=Variable("... step", "1", "critical-junction estimate along x", "T_cj,x*"),
    estimate_junction_transmissivity_y=Variable("... step", "1", "critical-junction estimate along y", "T_cj,y*"),
    estimate_junction_diffusivity_x=Variable("... step", "1", "critical-junction estimate along x", "D_cj,x*"),
    estimate_junction_diffusivity_y=Variable("... step", "1", "critical-junction estimate along y", "D_cj,y*"),
)
VARIABLES |= _rows(
    "observables.void.of_state",
    transport_time=Variable("... step", "s", "wall-clock time spent on the quantities of the void", "t"),
)
# inside central regions of several widths
VARIABLES |= _rows(
    "observables.regions.of_state",
    "region_widths",
    contact_area_fraction_within=Variable(
        "... step region_width", "1", "fraction of the elements of the region in contact", "A*(w)"
    ),
    mean_pressure_within=Variable("... step region_width", "1", "mean pressure of the region times L/(E* Sq)", "p*(w)"),
    free_volume_within=Variable("... step region_width", "1", "mean gap of the region over Sq", "V*(w)"),
)
VARIABLES |= _rows(
    "observables.transport.conduction",
    "region_transmissivity",
    transmissivity_within_x=Variable(
        "... step region_width", "1", "flow along x with g^3 through the region, over that of plates", "T_x*(w)"
    ),
    transmissivity_within_y=Variable(
        "... step region_width", "1", "flow along y with g^3 through the region, over that of plates", "T_y*(w)"
    ),
)
# with units, in those that a study names; made from the starred ones when its cases are collected
VARIABLES |= _rows(
    "store.dimensional.in_units",
    nominal_pressure=Variable("... step", "pressure", "nominal contact pressure, p* E* Sq/L", "p"),
    free_volume_per_area=Variable("... step", "length", "free volume over the nominal area, V* Sq", "V/A_n"),
    mean_gap=Variable("... step", "length", "mean gap, V* Sq", "g_mean"),
    mean_plane_separation=Variable("... step", "length", "rigid far-field separation of the mean planes", "d"),
    critical_opening_x=Variable("... step", "length", "largest gap still open from side to side along x", "h_c,x"),
    critical_opening_y=Variable("... step", "length", "largest gap still open from side to side along y", "h_c,y"),
    leak_rate_x=Variable(
        "... step", "length^3/time", "volume flow along x, T_x* g_mean^3 pressure_drop W_y/(12 viscosity W_x)", "Q_x"
    ),
    leak_rate_y=Variable(
        "... step", "length^3/time", "volume flow along y, T_y* g_mean^3 pressure_drop W_x/(12 viscosity W_y)", "Q_y"
    ),
)
# at the states a study selects
VARIABLES |= _rows(
    "observables.levels.at_level",
    level_convolutions=Variable(
        "...", "1", "convolutions, of the full grid, for the states between two steps", "n_level"
    ),
)
VARIABLES |= _rows(
    "observables.transport.conduction",
    "flux_at",
    flux_at_transmissivity_x=Variable(
        "... flux_at", "1", "flow along x with g^3, over that of plates at the mean gap, at the state", "T_x*"
    ),
    flux_at_transmissivity_y=Variable(
        "... flux_at", "1", "flow along y with g^3, over that of plates at the mean gap, at the state", "T_y*"
    ),
)
VARIABLES |= _rows(
    "observables.transport.conduction",
    "flux_at",
    flux_x=Variable("... flux_at x y", "1", "flux with g^3 for a flow along x, over that of plates", "|q_x|"),
    flux_y=Variable("... flux_at x y", "1", "flux with g^3 for a flow along y, over that of plates", "|q_y|"),
)
VARIABLES |= _rows(
    "contact.state.Contact.{name}",
    "fields_at",
    gap=Variable("... field_at x y", "1", "gap over Sq, exactly 0 in contact", "g/σ"),
    pressure=Variable("... field_at x y", "1", "contact pressure times L/(E* Sq)", "p L/(E* σ)"),
)
VARIABLES |= _rows(
    "observables.free_volume.volume_density",
    "volume_density",
    volume_density=Variable(
        "... density_at bin", "length^-3", "probability density of element volumes", "f(v)", height_power=-1
    ),
    volume_density_edges=Variable(
        "... density_at edge", "length^3", "edges of the bins of element volumes", "v", height_power=1
    ),
)
VARIABLES |= _rows(
    "observables.free_volume.element_volumes",
    "box_counting",
    volume_max=Variable("... box_at", "length^3", "largest element volume", "v_max", height_power=1),
)
VARIABLES |= _rows(
    "observables.box_counting.box_counts",
    "box_counting",
    box_count=Variable("... box_at threshold r", "1", "boxes that meet the domain v ≤ v_th", "N(r)", "count"),
)
VARIABLES |= _rows(
    "observables.box_counting.local_dimension",
    "box_counting",
    local_dimension=Variable("... box_at threshold r_mid", "1", "local box dimension -d log N / d log r", "D_box"),
)
# texture, where a study asks for it: before load in the region, and of the deformed surface under load
VARIABLES |= _rows(
    "surfaces.texture.{name}",
    "texture",
    Sa=Variable("...", "length", "arithmetical mean height", "Sa", height_power=1),
    Ssk=Variable("...", "1", "skewness of the heights", "Ssk"),
    Sku=Variable("...", "1", "kurtosis of the heights, 3 for a Gaussian", "Sku"),
    Sp=Variable("...", "length", "maximum peak height above the mean plane", "Sp", height_power=1),
    Sv=Variable("...", "length", "maximum pit height below the mean plane", "Sv", height_power=1),
    Sz=Variable("...", "length", "maximum height, Sp + Sv", "Sz", height_power=1),
    Svi=Variable("...", "1", "valley fluid retention index", "Svi"),
    Sbi=Variable("...", "1", "surface bearing index", "Sbi"),
    hurst_structure=Variable("...", "1", "Hurst exponent from the structure function", "H_S"),
    material_ratio=Variable("... material_level", "1", "share of the heights at or above the level", "Smr(c)"),
    structure_function=Variable("... lag", "1", "mean square height difference over Sq^2", "S(l)/σ²"),
)
VARIABLES |= _rows(
    "observables.deformed.LEVELS",
    material_level=Variable("material_level", "1", "level above the mean plane over Sq", "c/σ"),
)
VARIABLES |= _rows(
    "observables.deformed.lags",
    lag=Variable("lag", "1", "distance of two nodes in elements", "l/δ", "index"),
)
_WHOLE = ("Sq", "Sdq", "hurst_measured")  # stored of the whole surface in any case
for _name in _WHOLE:
    _row = VARIABLES[_name]
    VARIABLES[f"{_name}_region"] = replace(
        _row,
        long_name=f"{_row.long_name}, of the region",
        symbol=f"{_row.symbol}(region)",
        source=_row.source.replace("surface.Surface", "texture"),
        observable="texture",
    )
for _name in (*_WHOLE, *(name for name, row in VARIABLES.items() if row.source == f"surfaces.texture.{name}")):
    _row = VARIABLES[_name]
    VARIABLES[f"{_name}_loaded"] = replace(
        _row,
        dims=_row.dims.replace("...", "... texture_at"),
        long_name=f"{_row.long_name}, of the deformed surface under load",
        symbol=f"{_row.symbol}(load)",
        source=_row.source.replace("surface.Surface", "texture"),
        observable="texture",
    )
    VARIABLES[f"{_name}_residual"] = replace(
        _row,
        long_name=f"{_row.long_name}, of the surface left by plastic displacement",
        symbol=f"{_row.symbol}(residual)",
        source=_row.source.replace("surface.Surface", "texture"),
        observable="texture",
    )

STATES = tuple(name for name, row in VARIABLES.items() if row.dims == name and name.endswith("_at"))
"""Dimensions along which recorded states are stored."""
OF_STATE = ("indentation", "separation", "contact_area_fraction", "mean_pressure", "free_volume")
for _dim in STATES:
    VARIABLES |= _rows(
        "observables.levels.reached",
        **{
            f"{_dim}_step": Variable(
                f"... {_dim}", "1", "first step at the state or beyond it, -1 if not reached", "k", "index"
            )
        },
    )
    # the numbers of the state itself: between two steps it is none of them
    VARIABLES |= {
        f"{_dim}_{_name}": replace(
            VARIABLES[_name], dims=f"... {_dim}", long_name=f"{VARIABLES[_name].long_name}, at the state"
        )
        for _name in OF_STATE
    }
# of an ensemble: means over all surfaces, at the states that a study asks for
_ENSEMBLE = {
    "ensemble_at": Variable("ensemble_at", "1", "state of the means over all surfaces", "state", "text"),
    "bound": Variable("bound", "1", "end of an interval", "bound", "text"),
    "round": Variable("round", "1", "round of samples", "k", "index"),
    "ensemble_samples": Variable("D m", "1", "samples of the ensemble on each level", "n_m", "count"),
    "ensemble_sample_cost": Variable("D m", "s", "modelled cost of one sample", "C_m"),
    "ensemble_cost": Variable("D", "s", "modelled cost of all samples", "C"),
    "ensemble_plain_cost": Variable("D", "s", "the same for plain Monte Carlo at the accuracy asked for", "C_0"),
    "ensemble_round_cost": Variable("D round", "s", "modelled cost of the samples up to each round", "C(k)"),
}
_OF_MEAN = {  # suffix: dimensions, what it is, symbol
    "mean": ("D ensemble_at", "mean over all surfaces of the {}", "<{}>"),
    "interval": ("D ensemble_at bound", "95 % interval of the mean over all surfaces of the {}", "<{}>"),
    "bias": ("D ensemble_at", "what the resolution leaves of the mean of the {}; missing: no limit", "b({})"),
    "freedom": ("D ensemble_at", "degrees of freedom of the interval of the {}", "ν({})"),
    "accuracy_asked": ("D ensemble_at", "half-width asked for of the mean of the {}", "h({})"),
    "step_error": ("D ensemble_at", "error between steps of the mean of the {}", "ε_k({})"),
    "solver_error": ("D ensemble_at", "certified error by the solver of the mean of the {}", "η({})"),
    "level_mean": ("D m ensemble_at", "mean on each level of the {}", "<{}>_m"),
    "level_variance": ("D m ensemble_at", "variance over surfaces on each level of the {}", "s²({})"),
    "level_residual": ("D m ensemble_at", "variance left by the next coarser level of the {}", "r²({})"),
    "level_correlation": ("D m ensemble_at", "correlation with the next coarser level of the {}", "ρ({})"),
    "level_samples": ("D m ensemble_at", "samples used on each level for the mean of the {}", "n({})"),
    "round_half_width": ("D ensemble_at round", "half-width of the interval after each round of the {}", "h_k({})"),
}
for _name in OF_STATE:
    _ENSEMBLE |= {
        f"{_name}_{_suffix}": Variable(
            _dims, "1", _title.format(VARIABLES[_name].long_name), _symbol.format(VARIABLES[_name].symbol)
        )
        for _suffix, (_dims, _title, _symbol) in _OF_MEAN.items()
    }
VARIABLES |= _rows("campaign.answered.variables", **_ENSEMBLE)
FIELDS = frozenset(name for name, row in VARIABLES.items() if row.dims.endswith(" x y"))
"""The large variables, compressed on disk."""
TIMES = frozenset(name for name, row in VARIABLES.items() if row.units == "s")
"""The only variables in which two equal runs differ."""
HEIGHT_POWERS = {name: row.height_power for name, row in VARIABLES.items() if row.height_power}
"""Power of the heights in each number that changes when they are scaled and the plane is not; v = g δ²."""
ALONG: dict[str, str] = {}
"""The first variable of each observable along the steps."""
for _name, _row in VARIABLES.items():
    if _row.observable and " step" in _row.dims:
        ALONG.setdefault(_row.observable, _name)
DTYPES = {"real": np.float64, "count": np.float64, "index": np.int64, "flag": np.bool_, "text": object}
MISSING: dict[str, Any] = {"real": np.nan, "count": np.nan, "index": -1, "flag": False, "text": ""}
