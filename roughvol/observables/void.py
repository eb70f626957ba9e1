"""The transport that a study asks for: quantities of the void between the surfaces, at the steps it names.

Quantities are stored along the steps of a sweep, NaN where they are not asked for. Fluxes are fields.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from roughvol.gap import clusters, quick_estimates, transport
from roughvol.gap.gas import conduction_of_gas
from roughvol.study import Gas, Level, Select, Transport
from roughvol.typing import Array, Index, Mask

Values = dict[str, Any]
AXES = (("x", 0), ("y", 1))
GAS_FLOW = "gas_flow"
EXPONENTS = {"transmissivity": 3.0, "diffusivity": 1.0}


class Void(Protocol):
    """What this module needs of a state of contact."""

    @property
    def periodic(self) -> bool:
        """Whether the gap is one period of a plane."""
        ...

    def gap(self) -> Array:
        """Return g/σ, exactly 0 in contact."""
        ...

    def contact(self) -> Mask:
        """Return where p > 0."""
        ...


def levels(asked: Transport) -> dict[str, dict[str, Level] | None]:
    """Return the levels by label of each quantity asked for; None for every step.

    Parameters
    ----------
    asked : Transport
        The section ``record.transport``.

    Returns
    -------
    dict
        Levels by label, or None, by name of the quantity.
    """
    states_of = {name: getattr(asked, name) for name in QUANTITIES}
    return {name: by_label(states) for name, states in states_of.items() if states is not None}


def by_label(states: Literal["every-step"] | Select) -> dict[str, Level] | None:
    """Return levels by their labels; None for every step.

    Parameters
    ----------
    states : 'every-step' or Select
        States of a quantity.

    Returns
    -------
    dict or None
        Levels by label.
    """
    return {level.label: level for level in states.levels} if isinstance(states, Select) else None


def stops_percolating(kind: str, state: Void) -> bool:
    """Return whether no open way is left along the axes that the end of a sweep names: percolation-x, -y or -both.

    Parameters
    ----------
    kind : str
        percolation-x, percolation-y or percolation-both.
    state : Void
        A state of contact.

    Returns
    -------
    bool
        Whether the sweep ends.
    """
    void = state.gap() > 0.0
    return not any(
        clusters.percolates(void, axis, periodic=state.periodic) for name, axis in AXES if kind.endswith((name, "both"))
    )


def leak_rates(state: Void) -> dict[str, float]:
    """Return the starred leak rates along x and y, T* V*³ times width over length of the region.

    Along the loading of one surface every gap falls, and so does the conductance of each element. The flow between two
    reservoirs then falls as well (Rayleigh's monotonicity law).

    Parameters
    ----------
    state : Void
        A state of contact, in its region.

    Returns
    -------
    dict
        Q 12 μ/(ΔP σ³) by axis [1].
    """
    gap = state.gap()
    rows, columns = gap.shape
    widths = {"x": columns / rows, "y": rows / columns}
    plates = float(gap.mean()) ** 3
    return {
        axis: transport.conduction(gap, n, periodic=state.periodic).coefficient * plates * widths[axis]
        for axis, n in AXES
    }


def of_state(state: Void, quantities: list[str], gas: Gas | None = None) -> tuple[Values, dict[str, float]]:
    """Return the numbers of the quantities, and the seconds that each took.

    Parameters
    ----------
    state : Void
        A state of contact, in its region.
    quantities : list of str
        Keys of `QUANTITIES`.
    gas : Gas, optional
        The gas of ``gas_flow``, its mean free path over σ.

    Returns
    -------
    dict
        Numbers by stored name; ``critical_position_*`` are a row and a column of the region, NaN if there is no way.
    dict
        Seconds by quantity; those of the first include the gap field.
    """
    if not quantities:
        return {}, {}
    started = time.perf_counter()
    gap = state.gap()
    values: Values = {}
    seconds: dict[str, float] = {}
    for name in quantities:
        if name == GAS_FLOW:
            values |= gas_flow(gap, gas, periodic=state.periodic)
        else:
            values |= QUANTITIES[name].of_gap(gap, state.contact, state.periodic)
        seconds[name] = time.perf_counter() - started - sum(seconds.values())
    values["transport_time"] = sum(seconds.values())
    return values, seconds


def size_classes(elements: int) -> Index:
    """Return the smallest sizes 1, 2, 4 … of the classes into which clusters and pockets are counted.

    Parameters
    ----------
    elements : int
        Number of elements of the region.

    Returns
    -------
    ndarray of int
        Smallest size of each class [elements].
    """
    return 2 ** np.arange(int(elements).bit_length(), dtype=np.int64)


def gas_flow(gap: Array, gas: Gas | None, *, periodic: bool) -> Values:
    """Return the flow of a gas along x and y, over that of viscous flow between plates, and Knudsen numbers.

    Parameters
    ----------
    gap : ndarray
        Gap over σ.
    gas : Gas
        Law, mean free path over σ, pressure of the outlet over that of the inlet.
    periodic : bool
        Whether the gap is one period of a plane.

    Returns
    -------
    dict
        Numbers by stored name.
    """
    assert gas is not None
    values: Values = {}
    for axis, n in AXES:
        flow = conduction_of_gas(gap, n, gas.law, gas.mean_free_path, gas.outlet, periodic=periodic)
        values |= {f"gas_transmissivity_{axis}": flow.coefficient, f"knudsen_number_{axis}": flow.knudsen}
    return values


def over_sigma(gas: Gas | None, sigma: float) -> Gas | None:
    """Return a gas with its mean free path over σ.

    Parameters
    ----------
    gas : Gas or None
        Mean free path in a unit of length.
    sigma : float
        σ in the same unit.

    Returns
    -------
    Gas or None
        The gas.
    """
    return None if gas is None else replace(gas, mean_free_path=gas.mean_free_path / sigma)


def flux(state: Void, gas: Gas | None = None) -> Values:
    """Return how much flows through each element, and in all, for a flow along x and along y, over that of plates.

    Parameters
    ----------
    state : Void
        A state of contact, in its region.
    gas : Gas, optional
        A gas, its mean free path over σ.

    Returns
    -------
    dict
        Fields and coefficients by stored name.
    """
    gap = state.gap()
    flows = {axis: transport.conduction(gap, n, periodic=state.periodic) for axis, n in AXES}
    values: Values = {f"flux_{axis}": np.hypot(*flow.flux) for axis, flow in flows.items()}
    if gas is not None:
        of_gas = gas_flow(gap, gas, periodic=state.periodic)
        values |= {f"flux_at_{name}": of_gas[name] for name in of_gas if name.startswith("gas_transmissivity")}
    return values | {f"flux_at_transmissivity_{axis}": flow.coefficient for axis, flow in flows.items()}


def _connectivity(gap: Array, contact: Callable[[], Mask], periodic: bool) -> Values:
    result = clusters.connectivity(gap, contact(), periodic=periodic)
    edges = np.append(size_classes(gap.size), np.iinfo(np.int64).max)
    return {
        "percolates_x": result.percolates_x,
        "percolates_y": result.percolates_y,
        "connected_volume_fraction": result.connected,
        "percolating_volume_fraction": result.percolating,
        "trapped_volume_fraction": result.trapped,
        "contact_clusters": result.contact_clusters.size,
        "trapped_pockets": result.trapped_pockets.size,
        "contact_clusters_by_size": np.histogram(result.contact_clusters, edges)[0],
        "trapped_pockets_by_size": np.histogram(result.trapped_pockets, edges)[0],
    }


def _constriction(gap: Array, contact: Callable[[], Mask], periodic: bool) -> Values:
    values: Values = {}
    for axis, n in AXES:
        narrowest = transport.constriction(gap, n, periodic=periodic)
        values[f"critical_gap_{axis}"] = narrowest.gap
        values[f"critical_position_{axis}"] = np.array(narrowest.element or (np.nan, np.nan))
    return values


def _conduction(name: str, gap: Array, contact: Callable[[], Mask], periodic: bool) -> Values:
    flows = {axis: transport.conduction(gap, n, EXPONENTS[name], periodic=periodic) for axis, n in AXES}
    values: Values = {f"{name}_{axis}": flow.coefficient for axis, flow in flows.items()}
    return values | {f"{name}_conservation_error": max(flow.conservation_error for flow in flows.values())}


def _cell(gap: Array, contact: Callable[[], Mask], periodic: bool) -> Values:
    return {f"cell_transmissivity_{axis}": transport.cell_conduction(gap, n) for axis, n in AXES}


def _estimates(gap: Array, contact: Callable[[], Mask], periodic: bool) -> Values:
    values: Values = {}
    for name, exponent in EXPONENTS.items():
        values[f"estimate_medium_{name}"] = quick_estimates.effective_medium(gap, exponent)
        values[f"estimate_corrected_{name}"] = quick_estimates.effective_medium(
            gap, exponent, closes_at=quick_estimates.CLOSES_AT
        )
        for axis, n in AXES:
            values[f"estimate_junction_{name}_{axis}"] = quick_estimates.single_junction(
                gap, n, exponent, periodic=periodic
            )
    return values


class Quantity(NamedTuple):
    """A quantity of the void, by the key that asks for it.

    Attributes
    ----------
    of_gap : gap field, a function for the contact mask, and whether they are one period ↦ numbers by stored name;
        `gas_flow` needs the gas as well, and is called by name.
    seconds : per state and node, both axes together, timed at m = 7 … 9.
    flow : whether it factorises, so that its cost grows faster than the nodes.
    """

    of_gap: Callable[[Array, Callable[[], Mask], bool], Values]
    seconds: float
    flow: bool = False


QUANTITIES = {
    "percolation": Quantity(_connectivity, 6e-8),
    "constriction": Quantity(_constriction, 5e-7),
    "transmissivity": Quantity(functools.partial(_conduction, "transmissivity"), 7e-6, flow=True),
    "diffusivity": Quantity(functools.partial(_conduction, "diffusivity"), 7e-6, flow=True),
    "cell_transmissivity": Quantity(_cell, 7e-6, flow=True),
    GAS_FLOW: Quantity(lambda gap, contact, periodic: {}, 1e-4, flow=True),
    "estimates": Quantity(_estimates, 2e-6),
}
