"""Fluid pressure that lifts a seal: the contact and the flow through it, solved together at a given load.

The total pressure on an element is the fluid pressure P plus an excess e, with

    e ≥ 0,    g = K (P + e) - ū ≥ 0,    e g = 0,    mean(P + e) = load,                            (1)

where P on open elements is the pressure of the flow through g. On open elements e = 0, so P acts. In contact the
pressure P + e is at least that of the fluid beside it: where it would be less, fluid enters and the contact opens.
With heights lowered by K P, (1) is the problem of dry contact for e, and its solver and certificate apply unchanged.
P beside contact and in pockets is that of `fluid_pressure`. Pressures are gauge pressures in the unit of p*.

One way: P of the dry gap, and the contact solved once more; the change is that of first order in P. Fully coupled: a
fixed point P = F(P) of both solvers, by Anderson's acceleration of depth `DEPTH` (J. ACM 12 (1965) 547). The problem
coupled in this way: Shvarts & Yastrebov, Tribol. Int. 126 (2018) 116.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from roughvol.contact.loading import Compliance, Contact, Trials
from roughvol.contact.pressed import state_under
from roughvol.errors import ContactError, ConvergenceError
from roughvol.observables.fluid_pressure import fluid_pressure
from roughvol.observables.regions import State, Within, window
from roughvol.observables.transport import conduction
from roughvol.study import Case, Scale
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array

RTOL = 1e-8  # largest η/σ of the contacts: the fixed point needs digits
ACCURACY = 1e-6  # of P over the pressure drop, the largest change of an element in a round
ROUNDS = 60
DEPTH = 4  # earlier rounds that Anderson's acceleration combines
LEAST_STEP, FIRST_STEP = 0.1, 1.0  # relaxation: halved where the change grows


@dataclass(frozen=True, eq=False)
class Lifted:
    """A contact under load and fluid pressure.

    Attributes
    ----------
    gap : array (rows, columns)
        Gap over σ of the undeformed surface; 0 in contact.
    fluid : array (rows, columns)
        P in the unit of p*.
    pressure : array (rows, columns)
        Total pressure P + e in the unit of p*.
    rounds : int
        Solves of the contact under a new fluid pressure.
    residual : float
        η/σ of the contact, and in a coupled state the change of P/drop in the last round; the larger.
    """

    gap: Array
    fluid: Array
    pressure: Array
    rounds: int
    residual: float

    @property
    def fluid_share(self) -> float:
        """Share of the load that the fluid on open elements carries."""
        return float(np.where(self.gap > 0.0, self.fluid, 0.0).sum() / self.pressure.sum())

    @property
    def contact_area_fraction(self) -> float:
        """Elements in contact over all."""
        return float(np.count_nonzero(self.gap == 0.0) / self.gap.size)


def of_state(case: Case, surface: Surface, state: State, half_space: Compliance) -> dict[str, Any]:
    """Return leak, gap, contact and load under the fluid pressure of a study, at the load of a state.

    The fluid flows through the whole surface. Leaks, gaps and areas are those of the region.

    Parameters
    ----------
    case : Case
        Names the fluid pressures; elastic contact.
    surface : Surface
        The surface pressed.
    state : Contact or Within
        The dry state in the region of the study.
    half_space : Compliance
        On which it was solved.

    Returns
    -------
    dict
        Numbers by stored name.

    Raises
    ------
    ContactError
        If the fluid alone carries more than the load.
    ConvergenceError
        If the fixed point is not reached.
    """
    asked = case.record.fluid_pressure
    assert asked is not None
    area = surface.heights.size * surface.spacing**2
    scale = Scale(case.E_star, surface.side, case.height or surface.Sq, area, case.modulus_unit, case.length_unit)
    inlet, outlet = (scale.starred("pressure", value)[1] for value in (asked.inlet, asked.outlet))
    dry = state.whole if isinstance(state, Within) else state
    inside = window(case, surface.shape)
    periodic = state.periodic
    values: dict[str, Any] = {"fluid_at_inlet": inlet, "fluid_at_outlet": outlet}
    for axis, name in enumerate(("x", "y")):
        both = Coupling(surface, half_space, axis, inlet, outlet, min(RTOL, case.solver.tolerance))
        first = both.one_way(dry.mean_pressure, dry)
        last = first if asked.coupling == "one-way" else both.solve(dry.mean_pressure, dry)
        gap = last.gap[inside]
        values |= {
            f"fluid_leak_dry_{name}": _leak(dry.gap()[inside], axis, periodic),
            f"fluid_leak_one_way_{name}": _leak(first.gap[inside], axis, periodic),
            f"fluid_leak_{name}": _leak(gap, axis, periodic),
            f"fluid_free_volume_one_way_{name}": float(first.gap[inside].mean()),
            f"fluid_free_volume_{name}": float(gap.mean()),
            f"fluid_contact_area_{name}": float(np.count_nonzero(gap == 0.0) / gap.size),
            f"fluid_load_share_{name}": last.fluid_share,
            f"fluid_rounds_{name}": last.rounds,
        }
        if asked.fields:
            values[f"fluid_gap_{name}"] = last.gap
    return values


def _leak(gap: Array, axis: int, periodic: bool) -> float:
    """Return T* V*³."""
    return float(conduction(gap, axis, periodic=periodic).coefficient * gap.mean() ** 3)


class Coupling:
    """Contact and flow of one surface along one axis.

    Parameters
    ----------
    surface : Surface
        The surface pressed; elastic contact.
    half_space : Compliance
        Of its shape.
    axis : int
        From inlet to outlet, 0 for x, 1 for y.
    inlet, outlet : float
        Fluid pressures at both sides in the unit of p*, inlet > outlet ≥ 0.
    rtol : float
        Largest η/σ of the contacts.

    Raises
    ------
    ContactError
        If the pressures are out of range.
    """

    def __init__(
        self, surface: Surface, half_space: Compliance, axis: int, inlet: float, outlet: float = 0.0, rtol: float = RTOL
    ) -> None:
        if not 0.0 <= outlet < inlet < np.inf:
            message = f"inlet {inlet:g}, outlet {outlet:g}; allowed: inlet > outlet >= 0"
            raise ContactError(message)
        self.surface, self.half_space, self.axis = surface, half_space, axis
        self.inlet, self.outlet, self.rtol = inlet, outlet, rtol

    def fluid_in(self, gap: Array) -> Array:
        """Return P of the flow through a gap, in the unit of p*."""
        shape = fluid_pressure(gap, self.axis, periodic=self.surface.periodic)
        return self.outlet + (self.inlet - self.outlet) * shape

    def under(self, fluid: Array, load: float, near: Contact) -> Lifted:
        """Return the contact under a given fluid pressure.

        Parameters
        ----------
        fluid : array (rows, columns)
            P in the unit of p*.
        load : float
            Mean of the total pressure, p*.
        near : Contact
            A state from which the indentation is guessed.

        Returns
        -------
        Lifted
            The state.

        Raises
        ------
        ContactError
            If the fluid alone carries more than the load.
        ConvergenceError
            If the contact is not found.
        """
        excess = load - float(fluid.mean())
        if not excess > 0.0:
            message = (
                f"the fluid carries the whole load: its mean pressure is p* = {fluid.mean():.6g}, the load p* = "
                f"{load:.6g}; the joint opens. Allowed: a lower inlet, or a higher load"
            )
            raise ContactError(message)
        surface, per_p = self.surface, 1.0 / (np.pi * self.surface.intervals[0])
        lift = self._displacement(fluid * per_p)
        lowered = Surface(
            surface.heights - surface.unit * (lift - lift.mean()), surface.spacing, periodic=surface.periodic
        )
        ratio = lowered.unit / surface.unit
        shift = (lowered.z_max - lowered.mean_height - surface.z_max + surface.mean_height) / surface.unit
        trials = Trials(lowered, self.half_space, rtol=self.rtol)
        state = state_under(trials, excess / ratio, (near.approach + shift) / ratio)
        gap = state.gap() * ratio
        return Lifted(gap, fluid, fluid + state.pressure() * ratio, 1, state.residual * ratio)

    def one_way(self, load: float, dry: Contact) -> Lifted:
        """Return the contact under the fluid pressure of the dry gap.

        Parameters
        ----------
        load : float
            Mean of the total pressure, p*.
        dry : Contact
            The contact without fluid at this load.

        Returns
        -------
        Lifted
            The state, at first order in the fluid pressure.
        """
        return self.under(self.fluid_in(dry.gap()), load, dry)

    def solve(self, load: float, near: Contact, fluid: Array | None = None) -> Lifted:
        """Return the coupled state.

        Near a closing there are two states: one pressed first and pressurised then, and one pressed under pressure.

        Parameters
        ----------
        load : float
            Mean of the total pressure, p*.
        near : Contact
            A state from which the indentation is guessed: the contact without fluid at this load.
        fluid : array (rows, columns), optional
            Fluid pressure to start from, that of another state. Default: that of the gap of ``near``.

        Returns
        -------
        Lifted
            The state, its fluid pressure that of the flow through its own gap.

        Raises
        ------
        ContactError
            If the fluid alone carries more than the load.
        ConvergenceError
            If the fixed point is not reached.
        """
        drop = self.inlet - self.outlet
        fluid = self.fluid_in(near.gap()) if fluid is None else fluid
        earlier: list[tuple[Array, Array]] = []
        step, last = FIRST_STEP, np.inf
        for rounds in range(1, ROUNDS + 1):
            state = self.under(fluid, load, near)
            change = self.fluid_in(state.gap) - fluid
            size = float(np.abs(change).max()) / drop
            if size <= ACCURACY:
                return Lifted(state.gap, fluid, state.pressure, rounds, max(state.residual, size))
            if size > last:  # a longer history misleads near a closing
                earlier, step = [], max(LEAST_STEP, 0.5 * step)
            last = size
            following = fluid + _accelerated(change, fluid, earlier, step)
            earlier = [*earlier, (fluid, change)][-DEPTH:]
            fluid = np.clip(following, self.outlet, self.inlet)
        message = (
            f"contact and flow do not settle at p* = {load:.6g}: the fluid pressure still changes by {size:.2g} of "
            "the drop"
        )
        raise ConvergenceError(message, indentation=near.indentation, iterations=ROUNDS, residual=size)

    def _displacement(self, pressure: Array) -> Array:
        elements = np.arange(pressure.size, dtype=np.intp)
        lift: Any = self.half_space.displacement_above(np.zeros(pressure.size), elements, pressure.ravel())
        displacement: Array = lift.reshape(pressure.shape)
        return displacement


def _accelerated(change: Array, fluid: Array, earlier: list[tuple[Array, Array]], step: float) -> Array:
    """Return the step of Anderson's acceleration from this round and earlier ones."""
    if not earlier:
        return step * change
    changes = np.stack([(change - other).ravel() for _, other in earlier], axis=1)
    fluids = np.stack([(fluid - other).ravel() for other, _ in earlier], axis=1)
    weights = np.linalg.lstsq(changes, change.ravel(), rcond=1e-10)[0]
    combined: Array = (step * change.ravel() - (fluids + step * changes) @ weights).reshape(fluid.shape)
    return combined
