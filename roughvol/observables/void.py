"""What a study keeps of the void between the surfaces: the quantities it names, at the steps it names.

Everything is stored along the steps of a sweep, missing (NaN) where it was not asked for; fluxes are fields.
"""

from __future__ import annotations

import time
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from roughvol.observables import transport
from roughvol.study import Level, Select, Transport
from roughvol.typing import Array, Mask

Values = dict[str, Any]
AXES = (("x", 0), ("y", 1))
EXPONENTS = {"transmissivity": 3.0, "diffusivity": 1.0}
QUANTITIES = ("percolation", "constriction", "transmissivity", "diffusivity", "estimates")


class Void(Protocol):
    """What this module needs of a state of contact."""

    def gap(self) -> Array:
        """Return g/σ, exactly 0 in contact."""
        ...

    def contact(self) -> Mask:
        """Return where p > 0."""
        ...


def levels(asked: Transport) -> dict[str, dict[str, Level] | None]:
    """Return the levels by label of each quantity asked for; None stands for every step."""
    wanted = {name: getattr(asked, name) for name in QUANTITIES}
    return {name: by_label(states) for name, states in wanted.items() if states is not None}


def by_label(states: Literal["every-step"] | Select) -> dict[str, Level] | None:
    """Return the levels that states stand for by their labels; None stands for every step."""
    return {level.label: level for level in states.levels} if isinstance(states, Select) else None


def stops_percolating(kind: str, state: Void) -> bool:
    """Return whether no open way is left along the axes that the end of a sweep names: percolation-x, -y or -both."""
    void = state.gap() > 0.0
    return not any(transport.percolates(void, axis) for name, axis in AXES if kind.endswith((name, "both")))


def of_state(state: Void, quantities: list[str]) -> tuple[Values, dict[str, float]]:
    """Return the numbers of the quantities, and the seconds that each took.

    Parameters
    ----------
    state : Void
        A state of contact, in its region.
    quantities : list of str
        Of `QUANTITIES`.

    Returns
    -------
    mapping
        Numbers by stored name; ``critical_position_*`` are a row and a column of the region, NaN if there is no way.
    mapping
        Seconds by quantity; the first also bears the making of the gap field.
    """
    if not quantities:
        return {}, {}
    started = time.perf_counter()
    gap = state.gap()
    values: Values = {}
    seconds: dict[str, float] = {}
    for name in quantities:
        if name == "percolation":
            values |= _connectivity(gap, state.contact())
        elif name == "constriction":
            values |= _constriction(gap)
        elif name == "estimates":
            values |= _estimates(gap)
        else:
            flows = {axis: transport.conduction(gap, n, EXPONENTS[name]) for axis, n in AXES}
            values |= {f"{name}_{axis}": flow.coefficient for axis, flow in flows.items()}
            values[f"{name}_conservation_error"] = max(flow.conservation_error for flow in flows.values())
        seconds[name] = time.perf_counter() - started - sum(seconds.values())
    values["transport_time"] = sum(seconds.values())
    return values, seconds


def size_classes(elements: int) -> NDArray[np.int64]:
    """Return the smallest sizes 1, 2, 4 … of the classes into which clusters and pockets are counted."""
    return 2 ** np.arange(int(elements).bit_length(), dtype=np.int64)


def flux(state: Void) -> Values:
    """Return how much flows through each element, and in all, for a flow along x and along y, over that of plates."""
    gap = state.gap()
    flows = {axis: transport.conduction(gap, n) for axis, n in AXES}
    values: Values = {f"flux_{axis}": np.hypot(*flow.flux) for axis, flow in flows.items()}
    return values | {f"flux_at_transmissivity_{axis}": flow.coefficient for axis, flow in flows.items()}


def _connectivity(gap: Array, contact: Mask) -> Values:
    found = transport.connectivity(gap, contact)
    edges = np.append(size_classes(gap.size), np.iinfo(np.int64).max)
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


def _constriction(gap: Array) -> Values:
    values: Values = {}
    for axis, n in AXES:
        found = transport.constriction(gap, n)
        values[f"critical_gap_{axis}"] = found.gap
        values[f"critical_position_{axis}"] = np.array(found.element or (np.nan, np.nan))
    return values


def _estimates(gap: Array) -> Values:
    values: Values = {}
    for name, exponent in EXPONENTS.items():
        values[f"estimate_medium_{name}"] = transport.effective_medium(gap, exponent)
        for axis, n in AXES:
            values[f"estimate_junction_{name}_{axis}"] = transport.single_junction(gap, n, exponent)
    return values
