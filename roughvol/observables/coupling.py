"""Fluid pressure that lifts a seal: the contact and the flow through it, solved together at a given load.

The total pressure on an element is the fluid pressure P plus an excess e, with

    e ≥ 0,    g = K (P + e) - ū ≥ 0,    e g = 0,    mean(P + e) = load,                            (1)

where P on open elements is the pressure of the flow through g. On open elements e = 0, so P acts. In contact the
pressure P + e is at least that of the fluid beside it: where it would be less, fluid enters and the contact opens.
With heights lowered by K P, (1) is the problem of dry contact for e, and its solver and certificate apply unchanged.
P beside contact and in pockets is that of `fluid_pressure`. Pressures are gauge pressures in the unit of p*.

One way: P of the dry gap, and the contact solved once more; the change is that of first order in P. Fully coupled: a
fixed point P = F(P), F(P) being the pressure of the flow through the gap under P. The problem coupled in this way:
Shvarts & Yastrebov, Tribol. Int. 126 (2018) 116.

Several fixed points may exist. The one returned is that of a joint pressed first and pressurised then. Inlet and outlet
rise together from zero to their values, in steps of at most `STEP` of the load, and each step starts from the state
before. Within a step the fluid pressure relaxes towards that of the flow,

    dP/dτ = F(P) - P,                                                                             (2)

by steps of the linearly implicit Euler method, which become Newton's where (2) is linear (pseudo-transient
continuation: Kelley & Keyes, SIAM J. Numer. Anal. 35 (1998) 508). F' follows from the linear response of the contact
(`contact.response`) and that of the flow (`FluidField.change`); its equations are solved by GMRES. Elements next to
closing may change P by F' of -10³: (2) is stiff, and iterations without F' do not settle there.

The joint opens where (2) leads to a contact that carries less than `OPENS` of the load, and the flow through its gap
carries more than the whole: contact is then lost from a solved state, as the inlet rises from one step to the next.
Nothing else is said to open. States above that inlet may exist for a joint pressed under pressure.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from roughvol.contact.loading import Compliance, Contact, Trials
from roughvol.contact.response import Response
from roughvol.contact.search import state_under
from roughvol.errors import ContactError, ConvergenceError
from roughvol.gap.fluid_pressure import LEAST, FluidField
from roughvol.gap.transport import conduction
from roughvol.observables.levels import scale_of
from roughvol.observables.regions import Values, View, window
from roughvol.observables.requests import flow_accuracy
from roughvol.observables.variables import AXES
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array

RTOL = 1e-10  # largest η/σ of the contacts: the fixed point needs digits
ACCURACY = 1e-6  # of P over the pressure drop, the largest change of an element in a round
STEP = 0.25  # largest rise of the inlet over the load from state to state
ROUNDS = 60  # solves of the contact until the change of P has halved
TRUST = 0.25  # largest error of the linear F over the change of P that is left
OPENS = 1e-3  # share of the load on a contact that is about to be lost
SOFTER = tuple(10.0**-digit for digit in range(1, 8))  # conductances of closed elements on the way to `LEAST`
FAILED = 2  # conductances without convergence and no state between them, from which a start is given up
LINEAR = 1e-3  # residual of the linear equations of a round over F(P) - P
KRYLOV = 60  # most vectors of their Krylov space


@dataclass(frozen=True, eq=False)
class Lifted:
    """A contact under load and fluid pressure: gap over σ (0 in contact), P and total P + e in the unit of p*.

    ``rounds`` counts solves under a new P. ``residual`` is η/σ or, if larger, the last change of P/drop when coupled.
    ``contact`` has the excess e alone. It is one of the ``trials`` on the surface lowered by K P.
    """

    gap: Array
    fluid: Array
    pressure: Array
    rounds: int
    residual: float
    contact: Contact
    trials: Trials

    @property
    def fluid_share(self) -> float:
        """Share of the load that the fluid on open elements carries."""
        return float(np.where(self.gap > 0.0, self.fluid, 0.0).sum() / self.pressure.sum())


def of_state(view: View) -> Values:
    """Return leak, gap and area of the region, and load, under the fluid pressure of a study at the load of a state."""
    case, surface, dry, half_space = view.case, view.surface, view.whole, view.half_space
    asked = case.record.fluid_pressure
    assert asked is not None
    scale = scale_of(case, surface)
    inlet, outlet = (scale.starred("pressure", value)[1] for value in (asked.inlet, asked.outlet))
    inside, accuracy = window(case, surface.shape), flow_accuracy(case.record)
    periodic = view.periodic
    along = []
    for axis in range(len(AXES)):
        both = Coupling(surface, half_space, axis, inlet, outlet, min(RTOL, case.solver.tolerance))
        last, values = None, {"fluid_leak_one_way": np.nan, "fluid_free_volume_one_way": np.nan}
        try:
            last = both.one_way(dry.mean_pressure, dry)
            values["fluid_leak_one_way"] = _leak(last.gap[inside], axis, periodic, accuracy)
            values["fluid_free_volume_one_way"] = float(last.gap[inside].mean())
        except Opening:  # to first order alone the fluid carries the load
            if asked.coupling == "one-way":
                raise
        if last is None or asked.coupling != "one-way":
            last = both.solve(dry.mean_pressure, dry)
        gap = last.gap[inside]
        values |= {
            "fluid_leak_dry": _leak(dry.gap()[inside], axis, periodic, accuracy),
            "fluid_leak": _leak(gap, axis, periodic, accuracy),
            "fluid_free_volume": float(gap.mean()),
            "fluid_contact_area": float(np.count_nonzero(gap == 0.0) / gap.size),
            "fluid_load_share": last.fluid_share,
            "fluid_rounds": last.rounds,
        }
        along.append(values | ({"fluid_gap": last.gap} if asked.fields else {}))
    both_axes = {name: [one[name] for one in along] for name in along[0]}
    return both_axes | {"fluid_at_inlet": inlet, "fluid_at_outlet": outlet}


def _leak(gap: Array, axis: int, periodic: bool, accuracy: float) -> float:
    """Return T* V*³."""
    return conduction(gap, axis, periodic=periodic, accuracy=accuracy).coefficient * float(gap.mean()) ** 3


def _check_pressed(load: float) -> None:
    if not load > 0.0:
        raise ContactError(f"the joint opens: it is pressed to p* = {load:.6g}. Allowed: a load above 0")


class Opening(ContactError):
    """The fluid carries the whole load, so contact is lost."""


class Coupling:
    """Elastic contact of one surface and flow along one axis, fluid pressures inlet > outlet ≥ 0 in the unit of p*.

    ``rtol`` is the largest η/σ of the contacts.
    """

    def __init__(
        self, surface: Surface, half_space: Compliance, axis: int, inlet: float, outlet: float = 0.0, rtol: float = RTOL
    ) -> None:
        if not 0.0 <= outlet < inlet < np.inf:
            raise ContactError(f"inlet {inlet:g}, outlet {outlet:g}; allowed: inlet > outlet >= 0")
        self.surface, self.half_space, self.axis = surface, half_space, axis
        self.inlet, self.outlet, self.rtol = inlet, outlet, rtol
        self.drop = inlet - outlet
        self.trials = Trials(surface, half_space, rtol=rtol)
        self.solves = 0  # of the contact under a fluid pressure

    def fluid_in(self, gap: Array) -> Array:
        """Return P of the flow through a gap, in the unit of p*."""
        shape = FluidField(gap, self.axis, periodic=self.surface.periodic).pressure
        return self.outlet + self.drop * shape

    def under(self, fluid: Array, load: float, near: Lifted, stiffness: float | None = None) -> Lifted:
        """Return the contact under a fluid pressure [p*], at a load that is the mean of the total pressure.

        The search starts from a contact near it, whose stiffness dp*/d(Δ'/σ) may be known. `Opening` if the fluid alone
        carries more than the load.
        """
        excess = load - float(fluid.mean())
        if not excess > 0.0:
            message = f"the mean fluid pressure is p* = {fluid.mean():.6g}; allowed: below the load, p* = {load:.6g}"
            raise Opening(message)
        self.solves += 1
        trials = self.trials.lowered(self.displacement((fluid / (np.pi * self.surface.intervals[0])).ravel()))
        begin = trials.moved(near.contact, near.trials)
        guess = begin.approach + ((excess - begin.mean_pressure) / stiffness if stiffness else 0.0)
        state = state_under(trials, excess, guess, begin, stiffness)
        return Lifted(state.gap(), fluid, fluid + state.pressure(), 1, state.residual, state, trials)

    def without_fluid(self, dry: Contact) -> Lifted:
        """Return a contact without fluid as one under P = 0."""
        pressure = dry.pressure()
        return Lifted(dry.gap(), np.zeros_like(pressure), pressure, 0, dry.residual, dry, self.trials)

    def one_way(self, load: float, dry: Contact) -> Lifted:
        """Return the contact under the fluid pressure of the dry gap, to first order in the fluid pressure."""
        _check_pressed(load)
        near = self.without_fluid(dry)
        return self.under(self.fluid_in(near.gap), load, near)

    def solve(self, load: float, dry: Contact) -> Lifted:
        """Return the coupled state of a joint pressed first and pressurised then, from the contact without fluid.

        A joint that opens is a `ContactError`; no state, and no proof of opening, a `ConvergenceError`.
        """
        _check_pressed(load)
        near = self.without_fluid(dry)
        fluid, reached, rounds, rises = self.fluid_in(near.gap), 0.0, 0, RISES
        while reached < 1.0:
            tried = set[tuple[float, Settle]]()
            for rise, settle in rises:
                share = min(reached + rise * STEP * load / self.inlet, 1.0)
                if (share, settle) in tried:
                    continue  # from the same state
                tried.add((share, settle))
                inlet, outlet = share * self.inlet, share * self.outlet
                at = Coupling(self.surface, self.half_space, self.axis, inlet, outlet, self.rtol)
                try:
                    state = settle(at, fluid * (share / (reached or 1.0)), load, near)
                except Opening as opening:
                    last = f"has a state at an inlet of p* = {reached * self.inlet:.6g}"
                    raise ContactError(
                        f"the joint opens: pressed to p* = {load:.6g} and pressurised then, it "
                        f"{last if reached else 'is closed without fluid'}, and at an inlet of p* = {inlet:.6g} the "
                        "fluid carries the whole load. Allowed: a lower inlet, or a higher load"
                    ) from opening
                except ConvergenceError as error:
                    unsettled = error
                    continue
                finally:
                    rounds += at.solves
                fluid, reached, rises = state.fluid, share, _after(rise, settle)
                break
            else:
                raise unsettled
        return replace(state, rounds=rounds)

    def _softened(self, fluid: Array, load: float, near: Lifted) -> Lifted:
        """Return the state to which P relaxes as closed elements conduct less and less; P then changes slowly at first.

        Starts are the fluid pressure, that of the dry gap, and that of a wide gap. Where a way is about to close, g³ is
        of the order of the conductance k of a closed element: P goes about with k^(1/3). Two states give the next P.
        """
        before = self.solves
        for start in (fluid, self.fluid_in(near.gap), self.fluid_in(np.ones(self.surface.shape))):
            known, failed = list[tuple[float, Array]](), 0
            for least in (*SOFTER, LEAST):
                at = least ** (1.0 / 3.0)
                following = np.clip(_on_line(known, at), self.outlet, self.inlet) if known else start
                try:
                    state = self._relaxed(following, load, near, least)
                except (ConvergenceError, Opening) as error:
                    last, failed = error, failed + isinstance(error, ConvergenceError)
                    if failed == FAILED:
                        break
                    continue
                known, failed = [*known[-1:], (at, state.fluid)], 0
                if least == LEAST:
                    return replace(state, rounds=self.solves - before)
        raise last

    def _relaxed(self, fluid: Array, load: float, near: Lifted, least: float = LEAST) -> Lifted:
        """Return the state to which a fluid pressure relaxes, closed elements having a given conductance."""
        mean = float(fluid.mean())
        if mean >= load:  # the fluid alone carries the load: damped back
            fluid = fluid * ((1.0 - OPENS) * load / mean)
        here, drag, shortened = Round(self, self.under(fluid, load, near), least), 0.0, False
        smallest, until = here.size, ROUNDS
        for rounds in itertools.count(1):
            state, fluid = here.state, here.state.fluid
            if here.size <= ACCURACY * self.drop:
                return replace(state, rounds=rounds, residual=max(state.residual, here.size / self.drop))
            if here.size <= 0.5 * smallest:
                smallest, until = here.size, rounds + ROUNDS
            elif rounds == until:
                break
            change, expected = here.step(drag)
            trial = fluid + change
            error = np.inf
            if trial.mean() < load:
                there = Round(self, self.under(trial, load, here.state, here.stiffness), least)
                error = float(np.linalg.norm(there.left - expected)) / here.norm
            elif load - fluid.mean() <= OPENS * load and (fluid + here.left).mean() >= load:
                raise Opening(f"contact is lost at an inlet of p* = {self.inlet:.6g}")
            if error > TRUST:
                drag, shortened = max(1.0, 4.0 * drag), True
                continue
            here = there
            if error < 0.5 * TRUST and not shortened:  # the step after a shortened one is no longer
                drag = drag / 4.0 if drag > 0.2 else 0.0
            shortened = False
        message = (
            f"no state of contact and flow is found at p* = {load:.6g} and an inlet of p* = {self.inlet:.6g}: the "
            f"fluid pressure still changes by {here.size / self.drop:.2g} of the drop, and it is not shown that the "
            "joint opens"
        )
        left, indentation = here.size / self.drop, near.contact.indentation
        raise ConvergenceError(message, indentation=indentation, iterations=rounds, residual=left)

    def displacement(self, pressure: Array) -> Array:
        """Return u over σ under a scaled pressure on every element, both flat."""
        elements = np.arange(pressure.size, dtype=np.intp)
        return self.half_space.displacement_above(np.zeros(pressure.size), elements, pressure)


class Round:
    """A contact under a fluid pressure P, F(P) - P of the flow through its gap (``left``), and the linear F about P.

    ``size`` is the largest |F(P) - P|, ``norm`` the root of the sum of its squares. Fluid in contact does not move the
    gap.
    """

    def __init__(self, coupling: Coupling, state: Lifted, least: float) -> None:
        self._coupling, self.state = coupling, state
        self._field = FluidField(state.gap, coupling.axis, periodic=coupling.surface.periodic, least=least)
        self.left = coupling.outlet + coupling.drop * self._field.pressure - state.fluid
        self.size, self.norm = float(np.abs(self.left).max()), float(np.linalg.norm(self.left))
        gap = state.gap.ravel()
        self._open, self._closed = np.flatnonzero(gap > 0.0), np.flatnonzero(gap == 0.0)
        right = self.left.ravel()[self._open]
        self._right = float(np.linalg.norm(right))
        self._basis, self._images = [right / (self._right or 1.0)], list[Array]()  # F' of the basis on every element
        self._projected = np.zeros((KRYLOV + 1, KRYLOV))  # F' in the basis

    @cached_property
    def _response(self) -> Response:
        """The linear response of the contact."""
        return Response(self._coupling.half_space, self._closed)

    @property
    def stiffness(self) -> float:
        """Stiffness dp*/d(Δ'/σ) of the contact."""
        coupling = self._coupling
        return float(np.pi * coupling.surface.intervals[0] * self._response.rates.sum() / self.state.gap.size)

    def step(self, drag: float) -> tuple[Array, Array]:
        """Return the change x of P with (1 + drag) x - F' x = F(P) - P, and F(P) - P after it by the linear F.

        GMRES on open elements. The Krylov space of F' is that of every drag, and is kept (Frommer & Glässner, SIAM J.
        Sci. Comput. 19 (1998) 15).
        """
        for count in range(1, KRYLOV + 1):
            if count > len(self._images):
                self._extend()
            matrix = (1.0 + drag) * np.eye(count + 1, count) - self._projected[: count + 1, :count]
            right = self._right * np.eye(count + 1)[0]
            weights = np.linalg.lstsq(matrix, right)[0]
            if np.linalg.norm(matrix @ weights - right) <= LINEAR * self._right:
                break
        images = zip(weights.tolist(), self._images, strict=False)  # the space may be larger
        of_flow = np.sum([weight * image for weight, image in images], axis=0).reshape(self.left.shape)
        change = (self.left + of_flow) / (1.0 + drag)
        return change, self.left - change + of_flow

    def _extend(self) -> None:
        """Add F' of the last vector of the basis, and the next orthogonal vector (Arnoldi)."""
        count = len(self._basis)
        image = self._change(self._basis[-1])
        new = image[self._open]
        for row, vector in enumerate(self._basis):
            self._projected[row, count - 1] = vector @ new
            new = new - self._projected[row, count - 1] * vector
        self._projected[count, count - 1] = norm = float(np.linalg.norm(new))
        self._images.append(image)
        self._basis.append(new / (norm or 1.0))

    def _change(self, fluid: Array) -> Array:
        """Return F' x on every element, flat, for the change x of P on open elements."""
        coupling, closed = self._coupling, self._closed
        q = np.zeros(coupling.surface.heights.size)
        q[self._open] = fluid / (np.pi * coupling.surface.intervals[0])
        rates = self._response.rates
        q[closed] = -self._response.pressure(coupling.displacement(q)[closed])
        indentation = -q.sum() / rates.sum()  # the load stays
        q[closed] += indentation * rates
        gap = coupling.displacement(q) - indentation
        gap[closed] = 0.0
        change: Array = (coupling.drop * self._field.change(gap.reshape(self.left.shape))).ravel()
        return change


def _on_line(known: list[tuple[float, Array]], at: float) -> Array:
    """Return the value at a place on the line through the last two known places, or the last value."""
    place, value = known[-1]
    if len(known) == 1:
        return value
    place_before, before = known[-2]
    return value + (at - place) / (place - place_before) * (value - before)


Settle = Callable[[Coupling, Array, float, Lifted], Lifted]

_HALVED = (1.0, 0.5, 0.25, 0.125)
_FARTHER = ((1.0, Coupling._softened), (2.0, Coupling._softened))
RISES: tuple[tuple[float, Settle], ...] = (
    *((rise, Coupling._relaxed) for rise in _HALVED),
    (_HALVED[-1], Coupling._softened),
    *_FARTHER,
)
"""Rises of the inlet over the largest, and how the state there is found: the next is tried where rounds are used up."""


def _after(rise: float, settle: Settle) -> tuple[tuple[float, Settle], ...]:
    """Return the rises after a state: up to twice the last.

    Where P has not relaxed within its rounds, it seldom does on the next rise: softened states come first from then on.
    """
    again = tuple((following, settle) for following in _HALVED if following <= 2.0 * rise)
    if settle is Coupling._softened:
        return (*again, (_HALVED[-1], Coupling._relaxed), *_FARTHER)
    return (*again, *RISES[len(_HALVED) :])
