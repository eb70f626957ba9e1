"""Observables of the void between the surfaces: what it connects, where it is narrowest, and what flows through it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from roughvol.errors import SurfaceError
from roughvol.gap import clusters, quick_estimates, transport
from roughvol.gap.gas import GasFlow, conduction_of_gas
from roughvol.gap.perimeter import contact_perimeter
from roughvol.observables.regions import State, Values, View, is_period, window
from roughvol.observables.requests import flow_accuracy
from roughvol.observables.variables import AXES
from roughvol.study import Case
from roughvol.surfaces.psd import waves
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array, Index, Sides

Found = TypeVar("Found")

SEARCHED = 1e-9  # accuracy of a flow whose value is searched for
EXPONENTS = {"transmissivity": 3.0, "diffusivity": 1.0}


def stops_percolating(kind: str, state: State) -> bool:
    """Return whether no open way is left along the axes that the end of a sweep names: percolation-x, -y or -both."""
    asked = [axis for axis, name in enumerate(AXES) if kind.endswith((name, "both"))]
    return not clusters.percolates(state.void(), *asked, periodic=state.periodic)


def leak_rates(state: State) -> dict[str, float]:
    """Return the starred leak rates Q 12 μ/(ΔP σ³) along x and y, T* V*³ times width over length of the region.

    Along a loading every gap falls, and so does the flow between two reservoirs (Rayleigh's monotonicity law).
    """
    gap = state.gap()
    rows, columns = gap.shape
    widths = {"x": columns / rows, "y": rows / columns}
    plates = float(gap.mean()) ** 3
    flows = dict(zip(AXES, _along(transport.conduction, gap, periodic=state.periodic, accuracy=SEARCHED), strict=True))
    return {axis: flow.coefficient * plates * widths[axis] for axis, flow in flows.items()}


def _along(function: Callable[..., Found], gap: Array, *more: Any, **options: Any) -> list[Found]:
    """Return what a function of a gap and an axis gives along x and y."""
    return [function(gap, axis, *more, **options) for axis in range(len(AXES))]


def size_classes(elements: int) -> Index:
    """Return the smallest sizes 1, 2, 4 … of the classes into which clusters and pockets are counted."""
    return 2 ** np.arange(int(elements).bit_length(), dtype=np.int64)


def sizes(case: Case, surface: Surface) -> Values:
    """Return the size classes of clusters and pockets."""
    rows, columns = window(case, surface.shape)
    return {"size": size_classes((rows.stop - rows.start) * (columns.stop - columns.start))}


def coordinates(case: Case, surface: Surface) -> Values:
    """Return the labels of the coordinates of a position."""
    return {"coordinate": list(AXES)}


def region(case: Case, surface: Surface) -> Values:
    """Return the extent of the region along y over that along x, and the numbers of waves on its sides.

    The numbers are NaN of a region that is no surface, as one of two rows.
    """
    rows, columns = window(case, surface.shape)
    aspect, numbers = (columns.stop - columns.start) / (rows.stop - rows.start), np.full(len(AXES), np.nan)
    with contextlib.suppress(SurfaceError):
        sides: Sides = "periodic" if is_period(case) else "free"
        numbers = waves(Surface(surface.heights[rows, columns], surface.spacing, sides=sides))
    return {"region_aspect": aspect, "region_waves": numbers}


def perimeter(view: View) -> Values:
    """Return the edges between contact and void."""
    return {"contact_perimeter": contact_perimeter(view.contact, view.periodic)}


def percolation(view: View) -> Values:
    """Return percolation, connected and trapped volume, and clusters and pockets by size."""
    found = clusters.connectivity(view.gap, view.contact, periodic=view.periodic)
    edges = np.append(size_classes(view.gap.size), np.iinfo(np.int64).max)
    return {
        "percolates": [found.percolates_x, found.percolates_y],
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
    elements = np.array([constriction.element or (np.nan, np.nan) for constriction in view.narrowest])
    positions = (elements + origin) / view.surface.intervals[0]
    return {"critical_gap": [constriction.gap for constriction in view.narrowest], "critical_position": positions}


def transmissivity(view: View) -> Values:
    """Return the flow with g³ over that of plates."""
    return _conduction("transmissivity", view)


def diffusivity(view: View) -> Values:
    """Return the flow with g over that of plates."""
    return _conduction("diffusivity", view)


def quarters(gap: Array) -> list[Array]:
    """Return the four quadrants of a field, row by row; of an odd number of nodes both halves have the middle node."""
    rows, columns = ((slice(nodes - nodes // 2), slice(nodes // 2, None)) for nodes in gap.shape)
    return [gap[row, column].copy() for row in rows for column in columns]


def quadrants(view: View) -> Values:
    """Return the flows with g³ through the quadrants over that of plates a distance σ apart."""
    accuracy = flow_accuracy(view.case.record)
    flows = [_along(transport.conduction, part, accuracy=accuracy) for part in quarters(view.gap)]
    plates = [part.mean() ** 3 for part in quarters(view.gap)]
    through = [[flow.coefficient * plate for flow in row] for row, plate in zip(flows, plates, strict=True)]
    return {"quadrant_flow": np.transpose(through)}


def of_quadrants(case: Case, surface: Surface) -> Values:
    """Return the numbers of the quadrants."""
    return {"quadrant": np.arange(4)}


def _conduction(name: str, view: View) -> Values:
    def solved(axis: int, start: Array | None) -> transport.Conduction:
        known: dict[str, Any] = {"start": start, "critical": view.narrowest[axis].gap}
        return transport.conduction(view.gap, axis, EXPONENTS[name], **known, **_of_flow(view))

    flows = _followed(name, view.pressures, solved)
    return {
        name: [flow.coefficient for flow in flows],
        f"{name}_error": max(flow.error for flow in flows),
        f"{name}_conservation_error": max(flow.conservation_error for flow in flows),
    }


def _followed(name: str, pressures: dict[str, Array], solved: Callable[[int, Array | None], Any]) -> list[Any]:
    """Return the flows along x and y from the ``pressures`` of the state before, which end as those of this state."""
    flows = []
    for axis, place in enumerate(AXES):
        flow = solved(axis, pressures.get(f"{name}_{place}"))
        if flow.pressure is not None:
            pressures[f"{name}_{place}"] = flow.pressure
        flows.append(flow)
    return flows


def _of_flow(view: View) -> dict[str, Any]:
    """Return what a flow has to know of a state beside its gap."""
    return {"periodic": view.periodic, "accuracy": flow_accuracy(view.case.record)}


def cell_transmissivity(view: View) -> Values:
    """Return the flow with g³ through the endless plane."""
    return {
        "cell_transmissivity": _along(transport.cell_conduction, view.gap, accuracy=flow_accuracy(view.case.record))
    }


def gas_flow(view: View) -> Values:
    """Return the flow of the gas over that of viscous flow between plates, and Knudsen numbers."""
    return _gas_flow(view, view.pressures)


def _gas_flow(view: View, pressures: dict[str, Array]) -> Values:
    assert view.case.gas is not None
    gas, sigma = view.case.gas, view.case.height or view.surface.unit
    of_gas = gas.law, gas.mean_free_path / sigma, gas.outlet

    def solved(axis: int, start: Array | None) -> GasFlow:
        return conduction_of_gas(view.gap, axis, *of_gas, start=start, **_of_flow(view))

    flows = _followed("gas", pressures, solved)
    return {
        "gas_transmissivity": [flow.coefficient for flow in flows],
        "gas_transmissivity_error": max(flow.error for flow in flows),
        "knudsen_number": [flow.knudsen for flow in flows],
    }


def estimates(view: View) -> Values:
    """Return both coefficients by effective medium and by single junction."""
    values: Values = {}
    for name, exponent in EXPONENTS.items():
        values[f"estimate_medium_{name}"] = quick_estimates.effective_medium(view.gap, exponent)
        values[f"estimate_corrected_{name}"] = quick_estimates.effective_medium(
            view.gap, exponent, closes_at=quick_estimates.CLOSES_AT
        )
        junctions = [
            quick_estimates.single_junction(view.gap, axis, exponent, critical=narrowest.gap)
            for axis, narrowest in enumerate(view.narrowest)
        ]
        values[f"estimate_junction_{name}"] = junctions
    return values


def flux(view: View) -> Values:
    """Return the flux on the nodes of the whole surface, NaN outside the region, and the transmissivities."""
    flows = _along(transport.conduction, view.gap, **_of_flow(view))
    whole = np.full((len(AXES), *view.surface.shape), np.nan)
    whole[:, *window(view.case, view.surface.shape)] = [np.hypot(*flow.flux) for flow in flows]
    values: Values = {"flux": whole, "flux_at_transmissivity": [flow.coefficient for flow in flows]}
    if view.case.gas is not None:
        values["flux_at_gas_transmissivity"] = _gas_flow(view, {})["gas_transmissivity"]
    return values
