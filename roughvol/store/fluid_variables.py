"""Stored variables of a contact under the pressure of a fluid in its gap."""

from __future__ import annotations

from roughvol.store.variable import Variable, rows


def _along(axis: str) -> dict[str, Variable]:
    """Return the rows of a flow along an axis."""
    flow, under = f"along {axis}", f"under the pressure of a fluid that flows along {axis}"
    table = {  # name: long name, symbol
        "leak_dry": (f"flow {flow} without fluid pressure, T_{axis}* V*^3", "Q*_dry"),
        "leak_one_way": (f"flow {flow} in the gap under the fluid pressure of the dry gap, T_{axis}* V*^3", "Q*_1"),
        "leak": (f"flow {flow} in the gap {under}, T_{axis}* V*^3", "Q*"),
        "free_volume_one_way": (f"mean gap over Sq, under the fluid pressure of the dry gap, flow {flow}", "V*_1"),
        "free_volume": (f"mean gap over Sq, {under}", "V*"),
        "contact_area": (f"fraction of the elements in contact, {under}", "A*"),
        "load_share": (f"share of the load that the fluid carries, flow {flow}", "F_f/F"),
        "rounds": (f"solves of the contact until gap and fluid pressure agree, flow {flow}", "n"),
    }
    return {
        f"fluid_{name}_{axis}": Variable(
            "... fluid_at", "1", text, f"{symbol}({axis})", "count" if name == "rounds" else "real"
        )
        for name, (text, symbol) in table.items()
    }


FLUID = rows(
    "study.record.Select.levels",
    fluid_at=Variable("fluid_at", "1", "state taken under the pressure of a fluid", "state", "text"),
)
FLUID |= rows(
    "observables.coupling.of_state",
    "fluid_pressure",
    fluid_at_inlet=Variable("... fluid_at", "1", "fluid pressure at the inlet times L/(E* Sq)", "P_in*"),
    fluid_at_outlet=Variable("... fluid_at", "1", "fluid pressure at the outlet times L/(E* Sq)", "P_out*"),
    **_along("x"),
    **_along("y"),
)
FLUID |= rows(
    "observables.coupling.of_state",
    "fluid_pressure",
    fluid_gap_x=Variable("... fluid_at x y", "1", "gap over Sq under a fluid that flows along x", "g/σ"),
    fluid_gap_y=Variable("... fluid_at x y", "1", "gap over Sq under a fluid that flows along y", "g/σ"),
)
FLUID |= rows(
    "store.dimensional.in_units",
    fluid_leak_rate_x=Variable("... fluid_at", "length^3/time", "leak rate along x under fluid pressure", "Q_x(P)"),
    fluid_leak_rate_y=Variable("... fluid_at", "length^3/time", "leak rate along y under fluid pressure", "Q_y(P)"),
)
"""The rows; the state of a path has its own."""
