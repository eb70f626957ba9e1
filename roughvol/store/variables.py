"""The table of stored variables: dimensions, units, long name, symbol, kind, and the function each comes from.

A row is all that the store needs of a variable: fields are compressed, heights scaled and states found by the table.
See docs/observables.md for how to add one. Rows that follow from others are in `derived_variables`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from roughvol.store import axis_variables, derived_variables, flow_variables, fluid_variables
from roughvol.store.variable import Variable, rows

VARIABLES: dict[str, Variable] = {}
# coordinates
VARIABLES |= rows(
    "study.one_case.Case",
    D=Variable("D", "1", "fractal dimension of the surface", "D"),
    m=Variable("m", "1", "levels of midpoint displacement; 2^m + 1 nodes per side", "m", "index"),
    seed=Variable("seed", "1", "seed of the random stream of heights", "seed", "index"),
    case=Variable("case", "1", "height file", "case", "text"),
    L=Variable("", "length", "length of the first axis", "L"),
)
VARIABLES |= rows("observables.reduction.Reduction", step=Variable("step", "1", "loading step", "k", "index"))
VARIABLES |= rows(
    "observables.reduction.of_surface",
    x=Variable("x", "1", "position along the first axis over L", "x/L"),
    y=Variable("y", "1", "position along the second axis over L", "y/L"),
)
VARIABLES |= rows("study.sweep.Legs.legs", leg=Variable("step", "1", "leg of the path, from 1", "leg", "index"))
VARIABLES |= rows(
    "study.record.Select.levels",
    field_at=Variable("field_at", "1", "state at which fields are kept", "state", "text"),
    density_at=Variable("density_at", "1", "state of the density of element volumes", "state", "text"),
    box_at=Variable("box_at", "1", "state of the box counting", "state", "text"),
    flux_at=Variable("flux_at", "1", "state at which fluxes are kept", "state", "text"),
    texture_at=Variable("texture_at", "1", "state under load at which texture is taken", "state", "text"),
    psd_at=Variable("psd_at", "1", "state under load at which the spectrum is taken", "state", "text"),
)
VARIABLES |= rows(
    "gap.free_volume.volume_density",
    bin=Variable("bin", "1", "bin of the density", "k", "index"),
    edge=Variable("edge", "1", "edge of the bins of the density", "k", "index"),
)
VARIABLES |= rows(
    "study.record.BoxCounting",
    threshold=Variable("threshold", "1", "threshold over the largest element volume", "v_th/v_max"),
)
VARIABLES |= rows(
    "gap.box_counting.box_counts",
    r=Variable("r", "1", "side of the boxes in elements", "r/δ", "index"),
)
VARIABLES |= rows(
    "gap.box_counting.local_dimension",
    r_mid=Variable("r_mid", "1", "geometric mean of two box sides in elements", "r/δ"),
)
VARIABLES |= rows(
    "observables.void.size_classes",
    size=Variable("size", "1", "smallest size in elements of the class that ends below twice it", "n", "index"),
)
VARIABLES |= rows(
    "observables.void.AXES",
    axis=Variable("axis", "1", "axis of the surface", "axis", "text"),
)
VARIABLES |= rows(
    "study.record.RegionWidths",
    region_width=Variable("region_width", "1", "width of a central region over that of the surface", "w/L"),
)
VARIABLES |= rows(
    "observables.recorded.asked",
    observable=Variable("observable", "1", "what a study records beside the numbers of every step", "q", "text"),
)
# per surface
VARIABLES |= rows(
    "surfaces.surface.Surface.Sq",
    Sq=Variable("...", "length", "root mean square height about the mean plane", "Sq", height_power=1),
)
VARIABLES |= rows(
    "surfaces.texture.Sdq",
    Sdq=Variable("...", "1", "root mean square slope", "Sdq", height_power=1),
)
VARIABLES |= rows(
    "surfaces.surface.Surface.z_max",
    z_max=Variable("...", "length", "height of the highest point", "z_max", height_power=1),
)
VARIABLES |= rows(
    "observables.reduction.of_surface",
    nodes_x=Variable("...", "1", "nodes along the first axis", "n_x", "count"),
    nodes_y=Variable("...", "1", "nodes along the second axis", "n_y", "count"),
)
VARIABLES |= rows(
    "surfaces.surface.Surface.filled",
    filled_fraction=Variable("...", "1", "share of the nodes whose height was missing and filled", "n_f/n"),
)
VARIABLES |= rows(
    "surfaces.surface.Surface.outliers",
    outliers_removed=Variable("...", "1", "number of measured heights taken out as outliers", "n_o", "count"),
)
VARIABLES |= rows(
    "surfaces.surface.Surface.peak",
    peak_height=Variable("...", "1", "height of the highest point above the mean plane over Sq", "z_p/Sq"),
)
VARIABLES |= rows(
    "surfaces.surface.Surface.peak_before",
    peak_height_before=Variable("...", "1", "the same with the outliers left in", "z_p,0/Sq"),
)
VARIABLES |= rows(
    "surfaces.texture.hurst_spectrum",
    hurst_measured=Variable("...", "1", "Hurst exponent from the power spectrum", "H"),
)
VARIABLES |= rows(
    "campaign.one_case.run_case",
    wall_time=Variable("...", "s", "wall-clock time spent on the case", "t"),
)
VARIABLES |= rows(
    "observables.reduction.Reduction",
    observable_time=Variable("... observable", "s", "wall-clock time spent on it, all states together", "t_q"),
)
VARIABLES |= rows(
    "observables.along_steps.AlongSteps",
    region_aspect=Variable("...", "1", "extent of the region observed along y over that along x", "W_y/W_x"),
)
VARIABLES |= rows(
    "surfaces.surface.Surface.heights",
    heights=Variable("... x y", "length", "heights of the undeformed surface", "z", height_power=1),
)
VARIABLES |= rows(
    "observables.pressures.central_pressure_ratio",
    central_pressure_ratio=Variable(
        "...", "1", "mean pressure in the central half of each side over that of the whole, last step", "p_c/p"
    ),
)
# per step
VARIABLES |= rows(
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
VARIABLES |= rows(
    "gap.perimeter.contact_perimeter",
    contact_perimeter=Variable("... step", "1", "edges between contact and void times L over the area", "S_d L/A_n"),
)
# where pressures end at a hardness
VARIABLES |= rows(
    "contact.state.Contact.{name}",
    plastic_volume=Variable("... step", "1", "mean plastic displacement over Sq", "u_pl/σ"),
    plastic_area_fraction=Variable("... step", "1", "fraction of elements that have yielded", "A_pl*"),
)
VARIABLES |= rows(
    "observables.plastic.residual",
    residual_heights=Variable(
        "... x y", "length", "heights less the plastic displacement, at the end of the path", "z - u_pl", height_power=1
    ),
)
# where a hardness is given for comparison alone
VARIABLES |= rows(
    "observables.pressures.above",
    contact_above_hardness_fraction=Variable(
        "... step", "1", "share of the contact with a pressure above the hardness", "A_H/A"
    ),
    load_above_hardness_fraction=Variable(
        "... step", "1", "share of the load on elements with a pressure above the hardness", "F_H/F"
    ),
)
# of the void, at the steps a study selects; open: gap > 0; void 4-connected, contact 8-connected
VARIABLES |= rows(
    "gap.clusters.connectivity",
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
VARIABLES |= rows(
    "gap.transport.constriction",
    "constriction",
    critical_gap_x=Variable("... step", "1", "largest gap over Sq still open from side to side along x", "h_c,x/σ"),
    critical_gap_y=Variable("... step", "1", "largest gap over Sq still open from side to side along y", "h_c,y/σ"),
    critical_position_x=Variable("... step axis", "1", "position of the critical gap along x over L", "x_c,x/L"),
    critical_position_y=Variable("... step axis", "1", "position of the critical gap along y over L", "x_c,y/L"),
)
VARIABLES |= rows(
    "gap.transport.conduction",
    "transmissivity",
    transmissivity_x=Variable("... step", "1", "flow along x with g^3, over that of plates at the mean gap", "T_x*"),
    transmissivity_y=Variable("... step", "1", "flow along y with g^3, over that of plates at the mean gap", "T_y*"),
    transmissivity_conservation_error=Variable("... step", "1", "inflow against outflow over the flow", "ε_T"),
)
VARIABLES |= rows(
    "gap.transport.cell_conduction",
    "cell_transmissivity",
    cell_transmissivity_x=Variable(
        "... step", "1", "flow along x with g^3 in the endless plane, over that of plates", "T_cx*"
    ),
    cell_transmissivity_y=Variable(
        "... step", "1", "flow along y with g^3 in the endless plane, over that of plates", "T_cy*"
    ),
)
VARIABLES |= rows(
    "gap.transport.conduction",
    "diffusivity",
    diffusivity_x=Variable("... step", "1", "flow along x with g, over that of plates at the mean gap", "D_x*"),
    diffusivity_y=Variable("... step", "1", "flow along y with g, over that of plates at the mean gap", "D_y*"),
    diffusivity_conservation_error=Variable("... step", "1", "inflow against outflow over the flow", "ε_D"),
)
VARIABLES |= flow_variables.ROWS
VARIABLES |= rows(
    "observables.void.of_state",
    transport_time=Variable("... step", "s", "wall-clock time spent on the quantities of the void", "t"),
)
# inside central regions of several widths
VARIABLES |= rows(
    "observables.regions.of_state",
    "region_widths",
    contact_area_fraction_within=Variable(
        "... step region_width", "1", "fraction of the elements of the region in contact", "A*(w)"
    ),
    mean_pressure_within=Variable("... step region_width", "1", "mean pressure of the region times L/(E* Sq)", "p*(w)"),
    free_volume_within=Variable("... step region_width", "1", "mean gap of the region over Sq", "V*(w)"),
)
VARIABLES |= rows(
    "gap.transport.conduction",
    "region_transmissivity",
    transmissivity_within_x=Variable(
        "... step region_width", "1", "flow along x with g^3 through the region, over that of plates", "T_x*(w)"
    ),
    transmissivity_within_y=Variable(
        "... step region_width", "1", "flow along y with g^3 through the region, over that of plates", "T_y*(w)"
    ),
)
# with units, in those that a study names; made from the starred ones when its cases are collected
VARIABLES |= rows(
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
    flux_at_leak_rate_x=Variable("... flux_at", "length^3/time", "volume flow along x, at the state", "Q_x"),
    flux_at_leak_rate_y=Variable("... flux_at", "length^3/time", "volume flow along y, at the state", "Q_y"),
)
# at the states a study selects
VARIABLES |= rows(
    "observables.levels.at_level",
    level_convolutions=Variable(
        "...", "1", "convolutions, of the full grid, for the states between two steps", "n_level"
    ),
)
VARIABLES |= rows(
    "gap.transport.conduction",
    "flux_at",
    flux_at_transmissivity_x=Variable(
        "... flux_at", "1", "flow along x with g^3, over that of plates at the mean gap, at the state", "T_x*"
    ),
    flux_at_transmissivity_y=Variable(
        "... flux_at", "1", "flow along y with g^3, over that of plates at the mean gap, at the state", "T_y*"
    ),
)
VARIABLES |= rows(
    "gap.transport.conduction",
    "flux_at",
    flux_x=Variable("... flux_at x y", "1", "flux with g^3 for a flow along x, over that of plates", "|q_x|"),
    flux_y=Variable("... flux_at x y", "1", "flux with g^3 for a flow along y, over that of plates", "|q_y|"),
)
VARIABLES |= rows(
    "contact.state.Contact.{name}",
    "fields_at",
    gap=Variable("... field_at x y", "1", "gap over Sq, exactly 0 in contact", "g/σ"),
    pressure=Variable("... field_at x y", "1", "contact pressure times L/(E* Sq)", "p L/(E* σ)"),
)
VARIABLES |= rows(
    "gap.free_volume.volume_density",
    "volume_density",
    volume_density=Variable(
        "... density_at bin", "length^-3", "probability density of element volumes", "f(v)", height_power=-1
    ),
    volume_density_edges=Variable(
        "... density_at edge", "length^3", "edges of the bins of element volumes", "v", height_power=1
    ),
)
VARIABLES |= rows(
    "gap.free_volume.element_volumes",
    "box_counting",
    volume_max=Variable("... box_at", "length^3", "largest element volume", "v_max", height_power=1),
)
VARIABLES |= rows(
    "gap.box_counting.box_counts",
    "box_counting",
    box_count=Variable("... box_at threshold r", "1", "boxes that meet the domain v ≤ v_th", "N(r)", "count"),
)
VARIABLES |= rows(
    "gap.box_counting.local_dimension",
    "box_counting",
    local_dimension=Variable("... box_at threshold r_mid", "1", "local box dimension -d log N / d log r", "D_box"),
)
# texture, where a study asks for it: before load in the region, and of the deformed surface under load
VARIABLES |= rows(
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
VARIABLES |= rows(
    "observables.deformed.LEVELS",
    material_level=Variable("material_level", "1", "level above the mean plane over Sq", "c/σ"),
)
VARIABLES |= rows(
    "observables.deformed.lags",
    lag=Variable("lag", "1", "distance of two nodes in elements", "l/δ", "index"),
)
VARIABLES |= derived_variables.SPECTRUM | fluid_variables.FLUID

STATES = tuple(name for name, row in VARIABLES.items() if row.dims == name and name.endswith("_at"))
"""Dimensions along which recorded states are stored."""
VARIABLES |= axis_variables.ROWS | derived_variables.of_parts(VARIABLES)
VARIABLES |= derived_variables.at_states(VARIABLES, STATES)
VARIABLES |= derived_variables.of_ensembles(VARIABLES)

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
