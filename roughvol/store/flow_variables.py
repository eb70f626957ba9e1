"""Rows of the table of variables for gases and for quick estimates of a flow; part of `variables`."""

from __future__ import annotations

from roughvol.store.variable import Variable, rows

ROWS: dict[str, Variable] = {}
ROWS |= rows(
    "gap.quick_estimates.effective_medium",
    "estimates",
    estimate_medium_transmissivity=Variable(
        "... step", "1", "effective-medium estimate of the transmissivity", "T_em*"
    ),
    estimate_medium_diffusivity=Variable("... step", "1", "effective-medium estimate of the diffusivity", "D_em*"),
    estimate_corrected_transmissivity=Variable(
        "... step", "1", "effective-medium estimate of the transmissivity, closing at A* = 0.415", "T_em,c*"
    ),
    estimate_corrected_diffusivity=Variable(
        "... step", "1", "effective-medium estimate of the diffusivity, closing at A* = 0.415", "D_em,c*"
    ),
)
ROWS |= rows(
    "gap.quick_estimates.single_junction",
    "estimates",
    estimate_junction_transmissivity_x=Variable("... step", "1", "critical-junction estimate along x", "T_cj,x*"),
    estimate_junction_transmissivity_y=Variable("... step", "1", "critical-junction estimate along y", "T_cj,y*"),
    estimate_junction_diffusivity_x=Variable("... step", "1", "critical-junction estimate along x", "D_cj,x*"),
    estimate_junction_diffusivity_y=Variable("... step", "1", "critical-junction estimate along y", "D_cj,y*"),
)
ROWS |= rows(
    "gap.gas.conduction_of_gas",
    "gas_flow",
    gas_transmissivity_x=Variable(
        "... step", "1", "throughput of the gas along x over that of viscous flow between plates", "T_g,x*"
    ),
    gas_transmissivity_y=Variable(
        "... step", "1", "throughput of the gas along y over that of viscous flow between plates", "T_g,y*"
    ),
    knudsen_number_x=Variable(
        "... step", "1", "mean free path at the mean pressure over the critical gap along x", "Kn_x"
    ),
    knudsen_number_y=Variable(
        "... step", "1", "mean free path at the mean pressure over the critical gap along y", "Kn_y"
    ),
)
ROWS |= rows(
    "gap.gas.conduction_of_gas",
    "flux_at",
    flux_at_gas_transmissivity_x=Variable(
        "... flux_at", "1", "throughput of the gas along x over that of plates, at the state", "T_g,x*"
    ),
    flux_at_gas_transmissivity_y=Variable(
        "... flux_at", "1", "throughput of the gas along y over that of plates, at the state", "T_g,y*"
    ),
)
ROWS |= rows(
    "store.dimensional.in_units",
    gas_leak_rate_x=Variable(
        "... step",
        "throughput",
        "throughput of the gas along x, T_g,x* g_mean^3 (inlet^2 - outlet^2) W_y/(24 viscosity W_x)",
        "Q_g,x",
    ),
    gas_leak_rate_y=Variable(
        "... step",
        "throughput",
        "throughput of the gas along y, T_g,y* g_mean^3 (inlet^2 - outlet^2) W_x/(24 viscosity W_y)",
        "Q_g,y",
    ),
    flux_at_gas_leak_rate_x=Variable(
        "... flux_at", "throughput", "throughput of the gas along x, at the state", "Q_g,x"
    ),
    flux_at_gas_leak_rate_y=Variable(
        "... flux_at", "throughput", "throughput of the gas along y, at the state", "Q_g,y"
    ),
)
