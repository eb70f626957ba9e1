"""Observables of the void between the surfaces: what it connects, where it is narrowest, and what flows through it."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from roughvol.gap import clusters, quick_estimates, transport
from roughvol.gap.gas import conduction_of_gas
from roughvol.gap.perimeter import contact_perimeter
from roughvol.observables.regions import window
from roughvol.observables.view import AXES, Values, View
from roughvol.study import Case
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array, Index

EXPONENTS = {"transmissivity": 3.0, "diffusivity": 1.0}


class Void(Protocol):
    """A state of contact, as far as its void."""

    @property
    def periodic(self) -> bool:
        """Whether the gap is one period of a plane."""
        ...

    def gap(self) -> Array:
        """Return g/σ, exactly 0 in contact."""
        ...


def stops_percolating(kind: str, state: Void) -> bool:
    """Return whether no open way is left along the axes that the end of a sweep names: percolation-x, -y or -both."""
    void = state.gap() > 0.0
    return not any(
        clusters.percolates(void, axis, periodic=state.periodic) for name, axis in AXES if kind.endswith((name, "both"))
    )


def leak_rates(state: Void) -> dict[str, float]:
    """Return the starred leak rates Q 12 μ/(ΔP σ³) along x and y, T* V*³ times width over length of the region.

    Along the loading of one surface every gap falls, and so does the conductance of each element. The flow between two
    reservoirs then falls as well (Rayleigh's monotonicity law).
    """
    gap = state.gap()
    rows, columns = gap.shape
    widths = {"x": columns / rows, "y": rows / columns}
    plates = float(gap.mean()) ** 3
    return {
        axis: transport.conduction(gap, n, periodic=state.periodic).coefficient * plates * widths[axis]
        for axis, n in AXES
    }


def size_classes(elements: int) -> Index:
    """Return the smallest sizes 1, 2, 4 … of the classes into which clusters and pockets are counted."""
    return 2 ** np.arange(int(elements).bit_length(), dtype=np.int64)


def sizes(case: Case, surface: Surface) -> Values:
    """Return the size classes of clusters and pockets."""
    rows, columns = window(case, surface.shape)
    return {"size": size_classes((rows.stop - rows.start) * (columns.stop - columns.start))}


def axes(case: Case, surface: Surface) -> Values:
    """Return the labels of the coordinates of a position."""
    return {"axis": [name for name, _ in AXES]}


def aspect(case: Case, surface: Surface) -> Values:
    """Return the extent of the region along y over that along x."""
    rows, columns = window(case, surface.shape)
    return {"region_aspect": (columns.stop - columns.start) / (rows.stop - rows.start)}


def perimeter(view: View) -> Values:
    """Return the edges between contact and void."""
    return {"contact_perimeter": contact_perimeter(view.contact, view.periodic)}


def percolation(view: View) -> Values:
    """Return percolation, connected and trapped volume, and clusters and pockets by size."""
    found = clusters.connectivity(view.gap, view.contact, periodic=view.periodic)
    edges = np.append(size_classes(view.gap.size), np.iinfo(np.int64).max)
    return {
        "percolates_x": found.percolates_x,
        "percolates_y": found.percolates_y,
        "connected_volume_fraction": found.connected,
        "percolating_volume_fraction": found.percolating,
        "trapped_volume_fraction": found.trapped,
        "contact_clusters": found.contact_clusters.size,
        "trapped_pockets": found.trapped_pockets.size,
        "contact_clusters_by_size": np.histogram(found.contact_clusters, edges)[0],
        "trapped_pockets_by_size": np.histogram(found.trapped_pockets, edges)[0],
    }


def constriction(view: View) -> Values:
    """Return the critical gap along x and y, and its position over L, NaN if there is no way."""
    origin = np.array([side.start for side in window(view.case, view.surface.shape)])
    values: Values = {}
    for axis, n in AXES:
        narrowest = transport.constriction(view.gap, n, periodic=view.periodic)
        values[f"critical_gap_{axis}"] = narrowest.gap
        element = np.array(narrowest.element or (np.nan, np.nan))
        values[f"critical_position_{axis}"] = (element + origin) / view.surface.intervals[0]
    return values


def transmissivity(view: View) -> Values:
    """Return the flow with g³ over that of plates."""
    return _conduction("transmissivity", view)


def diffusivity(view: View) -> Values:
    """Return the flow with g over that of plates."""
    return _conduction("diffusivity", view)


def _conduction(name: str, view: View) -> Values:
    flows = {axis: transport.conduction(view.gap, n, EXPONENTS[name], periodic=view.periodic) for axis, n in AXES}
    values: Values = {f"{name}_{axis}": flow.coefficient for axis, flow in flows.items()}
    return values | {f"{name}_conservation_error": max(flow.conservation_error for flow in flows.values())}


def cell_transmissivity(view: View) -> Values:
    """Return the flow with g³ through the endless plane."""
    return {f"cell_transmissivity_{axis}": transport.cell_conduction(view.gap, n) for axis, n in AXES}


def gas_flow(view: View) -> Values:
    """Return the flow of the gas over that of viscous flow between plates, and Knudsen numbers."""
    assert view.case.gas is not None
    sigma = view.case.height or view.surface.unit
    gas = replace(view.case.gas, mean_free_path=view.case.gas.mean_free_path / sigma)
    values: Values = {}
    for axis, n in AXES:
        flow = conduction_of_gas(view.gap, n, gas.law, gas.mean_free_path, gas.outlet, periodic=view.periodic)
        values |= {f"gas_transmissivity_{axis}": flow.coefficient, f"knudsen_number_{axis}": flow.knudsen}
    return values


def estimates(view: View) -> Values:
    """Return both coefficients by effective medium and by single junction."""
    values: Values = {}
    for name, exponent in EXPONENTS.items():
        values[f"estimate_medium_{name}"] = quick_estimates.effective_medium(view.gap, exponent)
        values[f"estimate_corrected_{name}"] = quick_estimates.effective_medium(
            view.gap, exponent, closes_at=quick_estimates.CLOSES_AT
        )
        for axis, n in AXES:
            values[f"estimate_junction_{name}_{axis}"] = quick_estimates.single_junction(
                view.gap, n, exponent, periodic=view.periodic
            )
    return values


def flux(view: View) -> Values:
    """Return the flux on the nodes of the whole surface, NaN outside the region, and the transmissivities."""
    flows = {axis: transport.conduction(view.gap, n, periodic=view.periodic) for axis, n in AXES}
    values: Values = {}
    for axis, flow in flows.items():
        values[f"flux_{axis}"] = np.full(view.surface.shape, np.nan)
        values[f"flux_{axis}"][window(view.case, view.surface.shape)] = np.hypot(*flow.flux)
    if view.case.gas is not None:
        of_gas = gas_flow(view)
        values |= {f"flux_at_{name}": of_gas[name] for name in of_gas if name.startswith("gas_transmissivity")}
    return values | {f"flux_at_transmissivity_{axis}": flow.coefficient for axis, flow in flows.items()}
