"""Read-offs from a stored sweep: the pressure, modulus or Sq at which the leak falls to a value, or the joint closes.

Starred numbers depend on E* and Sq through p* = p L/(E* Sq) alone, for surfaces of one shape and elastic contact. The
leak of a liquid at a pressure drop is T* V*³ times Sq³. So one sweep answers for every modulus and height. With p₀ the
pressure that belongs to the same p* at the E* and Sq of the study:

    pressure    p = p₀             where the leak at p₀ is the value
    modulus     E* times p/p₀      the same p₀; a larger E* leaks more
    Sq          Sq times p/p₀      where the leak at p₀ times (p/p₀)³ is the value; a larger Sq leaks more

Of several surfaces, the leakiest decides: p₀ is the largest of any surface. Every answer has the interval of its
reading (`leak_curve`). Errors of solver, grid, window and levelling come with a leak card at p₀ (`leak_budget`): where
the leak may be f times larger, the answer is up to where the stored leak is 1/f of the value.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from xarray import Dataset

from roughvol.analysis import closing, leak, leak_curve
from roughvol.analysis.at import check_load
from roughvol.analysis.closing import Span
from roughvol.analysis.derived import derived, is_pressed, lacks_states, nominal_pressure
from roughvol.analysis.leak_card import Card
from roughvol.analysis.leak_curve import Curve, LoadReading, axes, closings, curves, surfaces
from roughvol.analysis.legs import legs_of
from roughvol.analysis.parts import Part, factors_of
from roughvol.analysis.stored_run import Run
from roughvol.analysis.units import scales, sigma
from roughvol.errors import StudyError
from roughvol.observables.variables import LISTED, SOLVED
from roughvol.store.variants import study_in
from roughvol.study import Axis, Level, Quantity, convert, loads, read, refused
from roughvol.study.axes import choices
from roughvol.study.plain_data import finite
from roughvol.study.values.state_kinds import REACHED
from roughvol.study.values.units import unit_of
from roughvol.typing import Array

UNKNOWNS = ("pressure", "modulus", "Sq")
ONE_OF_EACH = ("D", "m", *LISTED)  # the surfaces of an answer are seeds or files
SOLVES_CLOSING = "record.transport.closing=true"
AROUND = 5  # loads of a study that narrows an answer, along each axis


@dataclass(frozen=True)
class Errors:
    """The errors of a leak card along one axis, or of its seal, as factors of the leak and of the closing load.

    ``leak`` and ``closing`` are the smallest and the largest number over the number; NaN where they are not known.
    ``solved`` has the closing loads of the surfaces.
    """

    parts: tuple[Part, ...]
    leak: tuple[float, float]
    closing_parts: tuple[Part, ...]
    closing: tuple[float, float]
    solved: tuple[Span, ...]


def errors_of(card: Card, axis: str) -> Errors:
    """Return the errors of a card along an axis, of a study with a seal those of the seal."""
    if card.seal is not None:
        seal = card.seal
        solved = (Span(seal.closing, seal.closing),) if math.isfinite(seal.closing) else ()
        closing = factors_of(seal.closing, seal.closing_interval)
        return Errors(seal.parts, factors_of(seal.leak, seal.interval), seal.closing_parts, closing, solved)
    (way,) = (way for way in card.ways if way.axis == axis)
    closes, leak = way.closing, factors_of(way.leak.value, way.interval)
    return Errors(way.parts, leak, closes.parts, factors_of(closes.value, closes.interval), closes.spans)


@dataclass(frozen=True)
class Answer:
    """The value along one axis, and its interval, in ``unit`` of the study.

    - ``value``: largest pressure of any surface, or smallest modulus. The heights of all surfaces change in proportion:
      Sq is that of the surface that decides. A pressure is infinite where the stored loads do not suffice, and 0 where
      the first step leaks less; modulus and Sq are 0 and infinite there.
    - ``low``, ``high``: interval of the reading; of a way that closes, the last open step and the first closed one
    - ``nominal``: pressure p₀ of the same p* at the E* and Sq of the study
    - ``times``: value over the E* or Sq of the study; 1 for a pressure
    - ``between``: p* of the two steps around the value
    - ``steps``: nominal pressures of these steps, with their unit in ``load_unit``
    - ``surface``: the leakiest surface, which decides
    - ``budget``: errors of a leak card that are in the interval
    """

    axis: str
    value: float
    low: float
    high: float
    unit: str
    nominal: LoadReading
    times: float
    between: tuple[float, float]
    surface: str
    surfaces: int
    budget: Errors | None = None
    steps: tuple[float, float] = (math.nan, math.nan)
    load_unit: str = "1"

    @property
    def found(self) -> bool:
        """Whether the value lies within the stored loads."""
        return 0.0 < self.nominal.value < math.inf


@dataclass(frozen=True, eq=False)
class _Needed:
    """The load that one surface needs, and what turns it into an answer."""

    surface: str
    load: LoadReading
    pressure: Array  # nominal, of the steps with a leak or a known way
    starred: Array
    Sq: float
    budget: Errors | None = None


def ask(
    run: Dataset,
    largest: float | None,
    unknown: str,
    *,
    pressure: float | None = None,
    errors: Mapping[str, Errors] | None = None,
) -> list[Answer]:
    """Return where the leak of the leakiest surface falls to a value, or its last way closes, along x and y.

    Nothing is solved. The run is as `checked` returns it. ``largest`` has the unit of the stored leak rates,
    ``pressure`` (for modulus and Sq) that of the study. Without ``largest`` the value is the solved closing load, or
    else that of the first closed step. Without units the pressure is then p*. ``errors`` are those of cards by axis,
    which the intervals then have. A `StudyError` refuses an unknown quantity, a missing pressure, a surface that
    yields, and a run that does not follow its ways.
    """
    _check_unknown(run, unknown, pressure)
    at = pressure or 0.0
    if largest is None:
        run = derived(run, study_in(run))
        if not leak.ways(run) and SOLVED not in run:
            message = "add closing: true, or percolation: every-step, to its record.transport"
            raise refused(f"the run does not follow its ways: {message}")
        return [_answer(run, axis, _closing(run, axis, errors), unknown, at) for axis in axes(run)]
    if unknown == "Sq" and (missing := [name for name in ("transmissivity", "free_volume") if name not in run]):
        raise refused(
            f"the run has no {missing[0]}, so the leak at another Sq is not known; allowed: for pressure or modulus"
        )
    if unknown == "Sq" and not _liquid(run):
        raise refused("the leak is not that of a liquid, and does not go with Sq^3; allowed: for pressure or modulus")
    if not largest > 0.0:
        closed = "a closed joint is asked for by --closed, in Python without leak_rate"
        raise refused(f"the leak is {largest:g}; allowed: > 0; {closed}")

    def log_wanted(log_pressures: Array) -> Array:
        """Return log of the largest leak, at p₀ and the Sq that belongs to it."""
        scaled = 3.0 * (math.log(at) - log_pressures) if unknown == "Sq" else 0.0 * log_pressures
        return np.asarray(math.log(largest) - scaled)

    def needed(curve: Curve, axis: str) -> _Needed:
        own = (errors or {}).get(axis)
        load = curve.load_where(log_wanted) if own is None else _load_with_errors(curve, log_wanted, own)
        return _Needed(curve.surface, load, curve.pressure, curve.starred, curve.Sq, own)

    found = curves(run)
    return [_answer(run, axis, [needed(curve, axis) for curve in found[axis]], unknown, at) for axis in found]


def _load_with_errors(curve: Curve, log_wanted: Callable[[Array], Array], errors: Errors) -> LoadReading:
    """Return the load of a leak with the errors of a card; from 0, and without an upper end, where they are unknown."""
    load, (least, most) = curve.load_where(log_wanted), errors.leak
    low, high = 0.0, math.inf
    if least > 0.0:
        low = curve.load_where(lambda logs: log_wanted(logs) - math.log(least)).low
    if math.isfinite(most):
        high = curve.load_where(lambda logs: log_wanted(logs) - math.log(most)).high
    if curve.closing.closes:  # a joint that is tight leaks less
        factor = errors.closing[1] if math.isfinite(errors.closing[1]) else math.inf
        closed = factor * curve.closing.closed_from
        high = max(load.value, closed if high >= curve.closing.closed_from else min(high, closed))
    return LoadReading(load.value, min(low, load.low), high, load.closing)


def checked(run: Dataset, *, leaks: bool = True) -> Dataset:
    """Return a run with its nominal pressures, where its modulus has a unit.

    Refused is a run whose leak is known at recorded states alone, lacks leak rates, or is of several kinds of surfaces.
    Leak rates and pressures are needed with ``leaks`` alone. A run without steps is refused as well.
    """
    if not is_pressed(run):
        raise refused(f"the run {lacks_states(run)}")
    if leak.is_lifted(run):
        states = "; ".join(run[leak.STATE].values.tolist()) if leak.STATE in run.dims else "not stored"
        raise refused(
            "record.fluid_pressure lifts the gap: the leak under fluid pressure is known at recorded states alone "
            f"({states}), and is not read off between states; roughvol show has it. More states: "
            "record.fluid_pressure.at, as {pressure: [0.1 MPa, 0.2 MPa]}"
        )
    if leaks and "leak_rate" not in run:
        raise refused("the run has no leak rates: record dimensional.leak_rate")
    several = [dim for dim in ONE_OF_EACH if run.sizes.get(dim, 1) > 1]
    if several:
        raise refused(_several(run, several))
    if (nominal := nominal_pressure(run, study_in(run))) is not None:
        run = run.assign(nominal_pressure=nominal)
    elif leaks:
        raise refused("the run needs pressures with units: give material a unit, as E: 10 MPa")
    return run


def _several(run: Dataset, names: Sequence[str]) -> str:
    """Return why a run with several labels of some dimensions is refused, and how a user chooses those of lists."""
    name, study = names[0], study_in(run)
    axis = next((listed for listed in (study.axes if study else ()) if listed.name == name), Axis(name, ()))
    held = ", ".join(axis.words(value).removeprefix(f"{name} = ") for value in run[name].values.tolist())
    labels = ", ".join(f"{one}={run[one].values.tolist()[0]!r}" for one in names)
    one_kind = f"surfaces of one kind at one value of each key, in Python ds.sel({labels})"
    message = f"the run has several {name} ({held}); allowed: {one_kind}"
    known = choices(study) if study else {}
    if not known.keys() >= set(names):  # a run of several D or m has none of one alone
        if study is not None and study.ensemble is None:
            single = " and ".join(names)
            message += f"; roughvol run STUDY --set name=NAME with a single {single} takes the stored cases"
        return message
    changes = [[shlex.quote(known[one][label]) for label in run[one].values.tolist()] for one in names]
    options = "; ".join(f"--set {' or '.join(of_one)}" for of_one in changes)
    return f"{message}; one combination opens by a change of each key: {options}"


def is_throughput(text: str) -> bool:
    """Return whether a leak has a unit of throughput, as 1e-4 mbar*l/s or 2 sccm: it is the leak of a gas."""
    try:
        return unit_of(read(text, "throughput")) is not None
    except ValueError:
        return False


def leaking(run: Dataset, unknown: str, leak: str = "") -> tuple[Dataset, float | None]:
    """Return a run as `of_gas` does if the unit of a leak is that of a gas, or it has the leak of a gas alone."""
    is_alone = "leak_rate" not in run and "gas_leak_rate" in run
    return of_gas(run, unknown) if is_alone or is_throughput(leak) else (run, None)


def of_gas(run: Dataset, unknown: str) -> tuple[Dataset, float]:
    """Return a run whose leak rates are those of its gas, and the temperature of the gas [K].

    The leak of a gas depends on p* alone where Sq stays: its mean free path over Sq is then the same.
    """
    if "gas_leak_rate" not in run:
        raise refused("the run has no leak of a gas: record transport.gas_flow and dimensional.gas_leak_rate")
    if "gas_transmissivity" not in run:
        raise refused("the run has no leak of a gas: no state of record.transport.gas_flow was reached")
    if unknown == "Sq":
        raise refused("the leak of a gas depends on its mean free path over Sq; allowed: for pressure, modulus")
    return run.assign(leak_rate=run["gas_leak_rate"]), float(run["gas_leak_rate"].attrs["temperature_K"])


def nominal_of(run: Dataset, level: Level) -> float:
    """Return the nominal pressure of a load in the unit of the study: of a pressure, a load, or ``last`` of leg 1.

    Refused are other states and legs, and a load that is another nominal pressure on each surface.
    """
    if level.leg not in (None, 1) or (level.kind == "last" and level.leg is None and path_words(run)):
        message = "read-offs are from leg 1, the first loading; allowed: loads there, as 'last, leg 1'"
        raise refused(f"{level.label}: {message}")
    if level.kind not in ("pressure", "load", "last"):
        raise refused(f"{level.label}: allowed: a load, as pressure=0.5MPa, load=20N or last")
    if level.value is not None and not level.value > 0.0:
        raise refused(f"{level.label}: allowed: a load > 0")
    if "nominal_pressure" not in run:
        raise refused(f"{level.label}: the run needs pressures with units: give material a unit, as E: 10 MPa")
    if level.kind == "pressure" and isinstance(level.value, Quantity):
        return convert(float(level.value), level.value.unit, str(run["nominal_pressure"].attrs["units"]))
    check_load(Run.of("", run).study, run, level)
    found = []
    for _, surface in surfaces(run):
        if level.value is None:
            found.append(float(surface["nominal_pressure"].max()))
            continue
        try:
            starred = scales(Run.of("", run), surface.expand_dims("seed"))[0].starred(level.kind, level.value)[1]
        except ValueError as error:
            raise refused(f"{level.label}: {error}") from error
        nominal, pressures = (surface[name].values for name in ("nominal_pressure", "mean_pressure"))
        found.append(starred * closing.load_per_starred(nominal, pressures))
    if max(found) - min(found) > REACHED * max(found):
        raise refused(f"{level.label}: another pressure on each surface; allowed: a pressure with its unit, as 0.5MPa")
    return float(np.mean(found))


def path_words(run: Dataset) -> str:
    """Return ``leg 1 of 3`` for a path of several legs, else nothing."""
    legs = len(legs_of(run))
    return f"leg 1 of {legs}" if legs > 1 else ""


def files_words(run: Dataset) -> str:
    """Return that several height files are taken as one joint; empty for other runs."""
    count = run.sizes.get("case", 1)
    return f"The {count} height files are taken as samples of one joint." if count > 1 else ""


def seal_words(run: Dataset) -> str:
    """Return of which seal the leak is; empty without a seal."""
    patch = leak_curve.patch_of(run)
    if patch is None:
        return ""
    n, m = patch.patches
    return f"The leak is that of the seal of {patch.seal.label} along {patch.seal.flow}, {n} × {m} patches."


def narrower(run: Dataset, answers: Sequence[Answer], *, closed: bool) -> list[str]:
    """Return the changes of the study, a name and a sweep, that solve states around the answers; for ``--set``.

    If the joint is asked to be ``closed``, its closing load is solved in the place of the states. Where an answer lies
    beyond the stored loads, the sweep goes on to its closing; so it does for a surface that yields, whose closing is
    solved within the sweep alone. Empty if the study does not take the changes.
    """
    unit = str(run["nominal_pressure"].attrs["units"]) if "nominal_pressure" in run else ""
    within = [_within(answer) for answer in answers if answer.found and answer.nominal.low < answer.nominal.high]
    found = sorted({float(f"{load:.5g}") for ends in within for load in np.geomspace(*ends, AROUND)})
    beyond, possible = any(map(is_beyond, answers)), list[str]()
    farther = beyond and (not closed or "plastic_volume" in run)
    if closed and SOLVED not in run and (found or beyond) and not farther:
        possible = [SOLVES_CLOSING]
    elif farther:  # a study of listed loads or of legs has no key sweep.to
        possible = ["sweep.to=percolation", f"sweep={{steps: {run.sizes['step']}, to: percolation}}"]
    elif found and not beyond:
        possible = [f"sweep={{pressures: [{', '.join(f'{load:g} {unit}'.strip() for load in found)}]}}"]
    suffix = "farther" if farther else "closing" if beyond else "closer"
    text = str(run.attrs.get("study", ""))
    for change in possible:
        try:
            changes = [f"name={loads(text, stored=True).name}_{suffix}", change]
            loads(text, stored=True, changes=changes)
        except StudyError:
            continue
        return changes
    return []


def _within(answer: Answer) -> tuple[float, float]:
    """Return the ends of the interval of a load; at an end that is not known, the step beside the load."""
    load, (before, after) = answer.nominal, answer.steps
    return load.low or before or load.value, load.high if math.isfinite(load.high) else after


def is_beyond(answer: Answer) -> bool:
    """Return whether an answer lies beyond the stored loads."""
    return not answer.found and answer.nominal.value != 0.0


def parts_of(answer: Answer) -> tuple[Part, ...]:
    """Return the parts of the error that the interval of an answer has beside that of the reading."""
    if answer.budget is None:
        return ()
    return answer.budget.closing_parts if answer.nominal.closing else answer.budget.parts


def record(answer: Answer, unknown: str) -> dict[str, Any]:
    """Return an answer as plain data; None where a number is not known or infinite."""
    nominal = answer.nominal
    found: dict[str, Any] = {
        "axis": answer.axis,
        "quantity": unknown,
        "value": answer.value if answer.found else None,
        "interval": [answer.low, answer.high],
        "unit": answer.unit,
        "closes_inside": nominal.closing,
        "mean_pressure_steps": answer.between,
        "nominal_pressure_steps": answer.steps,
        "errors": ["reading", *(part.name for part in parts_of(answer))],
        "surfaces": answer.surfaces,
        "leakiest": answer.surface,
    }
    if unknown != "pressure":
        found |= {
            "times_the_study": answer.times if answer.found else None,
            "nominal_pressure_at_the_study": nominal.value if answer.found else None,
            "nominal_pressure_interval": [nominal.low, nominal.high],
            "nominal_pressure_unit": answer.load_unit,
        }
    return {name: finite(value) for name, value in found.items()}


def _check_unknown(run: Dataset, unknown: str, pressure: float | None) -> None:
    if unknown not in UNKNOWNS:
        raise refused(f"unknown is {unknown!r}; allowed: {', '.join(UNKNOWNS)}")
    if unknown != "pressure" and "plastic_volume" in run:
        raise refused("pressures end at a hardness, so numbers do not depend on p* alone; allowed: for pressure")
    if unknown != "pressure" and not (pressure is not None and pressure > 0.0):
        raise refused(f"for {unknown} the load is needed, a pressure > 0, as pressure=0.1MPa")


def _liquid(run: Dataset) -> bool:
    """Return whether leaks go with T* V*³ on each surface."""
    flow = run["transmissivity"].sel(axis="x") * run["free_volume"] ** 3
    ratio = run["leak_rate"].sel(axis="x") / flow.where(flow > 0.0)
    return bool(
        (ratio.max("step") - ratio.min("step") <= 1e-6 * ratio.max("step")).where(flow.max("step") > 0, True).all()
    )


def _closing(run: Dataset, axis: str, errors: Mapping[str, Errors] | None) -> list[_Needed]:
    """Return the loads between which the last way of each surface closes."""
    load, found, own = closing.load_of(run), [], (errors or {}).get(axis)
    stored = closings(run, axis, load)
    solved = own.solved if own is not None and len(own.solved) == len(stored) else [span for _, span, _ in stored]
    for (name, _, surface), span in zip(stored, solved, strict=True):
        known = np.isfinite(surface[load].values)
        if ways := leak.ways(run):
            known &= np.isfinite(surface[ways].sel(axis=axis).values)
        pressure, starred = (surface[key].values[known] for key in (load, "mean_pressure"))
        reading = LoadReading.of(span) if own is None else _closing_with_errors(span, own)
        found.append(_Needed(name, reading, pressure, starred, float(sigma(surface)), own))
    return found


def _closing_with_errors(span: Span, errors: Errors) -> LoadReading:
    """Return the load at which a way closes with the errors of a card."""
    reading, (least, most) = LoadReading.of(span), errors.closing
    if not reading.closing:
        return reading
    low = least * span.open_up_to if math.isfinite(least) else 0.0
    high = most * span.closed_from if math.isfinite(most) else math.inf
    return LoadReading(reading.value, low, high, closing=True)


def _answer(run: Dataset, axis: str, needed: list[_Needed], unknown: str, pressure: float) -> Answer:
    """Return the answer of the surface that needs the largest load."""
    decides = max(needed, key=lambda surface: (surface.load.value, surface.load.low, surface.load.high))
    low, high = (max(getattr(surface.load, end) for surface in needed) for end in ("low", "high"))
    nominal = LoadReading(decides.load.value, low, high, decides.load.closing)
    between, steps = (_around(decides, nominal.value, along) for along in (decides.starred, decides.pressure))
    load_unit = str(run[closing.load_of(run)].attrs.get("units", "1"))
    rest = (decides.surface, len(needed), decides.budget, steps, load_unit)
    if unknown == "pressure":
        return Answer(axis, nominal.value, nominal.low, nominal.high, load_unit, nominal, 1.0, between, *rest)
    size, unit = _modulus(run) if unknown == "modulus" else (decides.Sq, str(run.attrs.get("length_unit", "")))
    at = (nominal.value, nominal.high, nominal.low)
    times, low, high = (math.inf if load == 0.0 else pressure / load for load in at)
    return Answer(axis, size * times, size * low, size * high, unit, nominal, times, between, *rest)


def _modulus(run: Dataset) -> tuple[float, str]:
    """Return the contact modulus of a study and its unit."""
    study = study_in(run)
    if study is None:
        return 1.0, "times the E* of the study"
    return study.material.contact_modulus, study.material.unit or ""


def _around(surface: _Needed, at: float, loads: Array) -> tuple[float, float]:
    """Return the loads of the steps around a nominal pressure; 0 before the first step, infinite beyond the last."""
    k = int(np.searchsorted(surface.pressure, at * (1.0 - REACHED)))
    low = float(loads[k - 1]) if k else 0.0
    return low, float(loads[k]) if k < loads.size else math.inf
