"""The states of stored surfaces at a load, on a step or between two steps.

A later leg begins at the last step of the leg before. Between two steps, a number lies on the monotone cubic of
`at_state` over the quantity of the level. A flow or an opening has the cubic of its logarithm. At a load this cubic is
over the logarithm of the load, so the leak there is the reading of `leak_curve`. A leak rate is at the load that has
this reading. A way that closes between two steps is open up to the second step, and its flow lies on the straight line
to 0 there. Where a study has its closing load solved, the way is open up to this load. Its flow and opening then fall
to 0 there on a straight line over p*. The inverse of a Knudsen number is read as an opening. Counts are those of the
step beyond. A state that a study records is the state solved for it; before the first step it has the numbers recorded
for it alone.

A step that misses a level by less than `level.REACHED` is the level. A sweep that ended at a target has reached this
target, and a listed load is the step solved for it. A surface whose sweep ended before a higher load is closed there if
its last state is closed. So is a surface without a step at or around a load that is at least its solved closing load.
Its flow is then 0, and its other numbers are missing. A level that no surface reaches is an error.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from xarray import Dataset

from roughvol.analysis import leak
from roughvol.analysis.closing import solved_loads
from roughvol.analysis.derived import P, V
from roughvol.analysis.legs import legs_of, steps_of
from roughvol.analysis.seal import Patch, with_leaks
from roughvol.analysis.stored_run import Run
from roughvol.analysis.tables import number
from roughvol.analysis.units import scales
from roughvol.errors import DatasetError
from roughvol.observables.at_state import at_state
from roughvol.observables.variables import AXES, OF_STATE, OF_YIELD, STATES, VARIABLES
from roughvol.study import STARRED, STATE_KINDS, Level, Quantity, Scale, Study, convert, parse
from roughvol.study.values.state_kinds import LOAD_OF_REGION, REACHED, slack
from roughvol.study.values.units import unit_of
from roughvol.typing import Array

KNUDSEN = "knudsen_number"  # a mean free path over an opening
BY_LOGARITHM = (*leak.FLOWS, "critical_opening", "critical_opening_dry", "critical_gap", KNUDSEN)
WAYS = ("open", "open_dry", "percolates")  # a way that closes between two steps is closed from the second step on
# in units, of starred numbers
MADE = {"nominal_pressure": P, "free_volume_per_area": V, "mean_gap": V, "mean_plane_separation": "separation"}
LEAK = "leak_rate"
LOAD_KINDS = ("pressure", "load")
HALVINGS = 40  # of the way between two steps: to 1e-12 of it
RULE = "Between steps: monotone cubics over the quantity asked for"
RULE_OF_FLOWS = (
    f"{RULE}, of a leak rate over the load; of a flow or an opening its logarithm, over log(load) at a load. A way "
    "that closes between two steps leaks along a straight line to 0 at the second, or at its solved closing load."
)


def check_load(study: Study | None, surfaces: Dataset, level: Level) -> None:
    """Refuse a load on states of a region, whose share is not known, and a load of a seal, which no patch carries."""
    if level.kind != "load" or study is None:
        return
    if study.record.part is not None:
        raise DatasetError(f"{level.label} {LOAD_OF_REGION}")
    patch = Patch.of(study, surfaces)
    if patch is not None and (words := patch.seal.overload(level, patch.sides, patch.unit, study.material)):
        raise DatasetError(words)


def _is_stored(level: Level) -> bool:
    """Return whether the quantity of a level is stored, or fixes a stored one."""
    return level.kind in STATE_KINDS and bool(STATE_KINDS[level.kind].stored)


def place_of(values: Array, value: float, slack: float, *, between: bool = True) -> float | None:
    """Return the position on the axis ``step`` where a surface first reaches a value, None if no two steps enclose it.

    Positions count from 0: 2.25 lies a quarter of the way from the third to the fourth step. ``values`` is NaN where no
    step was solved. A step has the value within ``slack``. Without ``between`` only steps count.
    """
    solved = np.flatnonzero(np.isfinite(values)).tolist()
    for k in solved:
        if abs(values[k] - value) <= slack:
            return float(k)
    for before, k in itertools.pairwise(solved) if between else ():
        low, high = float(values[before]), float(values[k])
        if min(low, high) < value < max(low, high):
            return float(before + (value - low) / (high - low) * (k - before))
    return None


def between(group: Dataset, seeds: list[int], places: list[float], over: Array, *, is_load: bool) -> Dataset:
    """Return the numbers along ``seed`` of surfaces, by index, at positions on the axis ``step``.

    ``over`` is the quantity of the level, of a leak rate the load (surfaces, steps), NaN off the leg. Where it
    ``is_load``, flows follow its logarithm.
    """
    rows = np.array(seeds, dtype=int)
    low, high = np.floor(places).astype(int), np.ceil(places).astype(int)
    between_steps, lifted = np.array(places) - low, leak.of_lifted_gap(group)
    values: dict[str, Any] = {}
    for name in group.data_vars:
        variable = group.variables[name]  # quicker than the array with its coordinates
        if set(variable.dims) == {"seed"}:
            values[str(name)] = ("seed", variable.values[rows], variable.attrs)
        along = [dim for dim in variable.dims if dim not in ("seed", "step")]
        if not {"seed", "step"} <= set(variable.dims) or along not in ([], ["axis"]):
            continue
        array = variable.transpose("seed", "step", *along).values
        before, after = array[rows, low], array[rows, high]
        share = between_steps.reshape(-1, *[1] * len(along))
        row = VARIABLES.get(str(name))
        if array.dtype.kind == "f":
            after = np.where(np.isnan(before), before, after)  # between a missing number and a known one: missing
        if name in lifted:
            after = np.where(share == 0.0, before, np.nan)
        elif (row is None or row.kind == "real") and name not in WAYS and array.dtype.kind == "f":
            with np.errstate(invalid="ignore"):  # between two infinite numbers
                mixed = np.where(before == after, before, before + share * (after - before))
            is_flow = name in BY_LOGARITHM
            curved = _curved(array[rows], over[rows], places, logarithm=is_flow, over_log=is_flow and is_load)
            after = np.where(share == 0.0, before, np.where(np.isfinite(curved), curved, mixed))
        elif name in WAYS:
            after = np.where(share == 0.0, before, np.fmax(before, after))
        values[str(name)] = (("seed", *along), after, variable.attrs)
    others = [name for name in group.coords if group.variables[name].dims not in ((), ("seed",), ("axis",))]
    # labels keep their index: for a new index xarray imports pint
    return group.coords.to_dataset().drop_vars(others).isel({"seed": rows}, missing_dims="ignore").assign(values)


def _curved(values: Array, over: Array, places: list[float], *, logarithm: bool, over_log: bool) -> Array:
    """Return numbers (surfaces, steps, …) at places on monotone cubics; NaN on a step, and beside a step without them.

    A cubic follows the two steps around the place, and the next step on each side where the quantity goes on alike. It
    is of the ``logarithm`` of the numbers. With ``over_log`` it is over the logarithm of the quantity where
    both steps have one.
    """
    found = np.full((values.shape[0], *values.shape[2:]), np.nan)
    for k, place in enumerate(places):
        low, high = math.floor(place), math.ceil(place)
        advance = over[k, high] - over[k, low]
        if low == high or not math.isfinite(advance):
            continue
        begin = low - int(low > 0 and (over[k, low] - over[k, low - 1]) * advance > 0.0)
        end = high + 1 + int(high + 1 < over.shape[1] and (over[k, high + 1] - over[k, high]) * advance > 0.0)
        x, at = over[k, begin:end], over[k, low] + (place - low) * advance
        if over_log and min(over[k, low], over[k, high]) > 0.0:
            x, at = np.log(np.where(x > 0.0, x, math.nan)), math.log(at)
        for column in np.ndindex(values.shape[2:]):
            numbers = values[(k, slice(begin, end), *column)]
            with np.errstate(divide="ignore", invalid="ignore"):  # beside a closed step
                y = np.log(numbers) if logarithm else numbers
            if np.isfinite(y[low - begin : high + 1 - begin]).all():
                read = float(at_state(x, y, at)[0])
                found[(k, *column)] = math.exp(read) if logarithm else read
    return found


@dataclass(frozen=True)
class State:
    """A state of the surfaces that share a row.

    ``data`` has the numbers along ``seed``: the surfaces that reach the state, then the ``closed`` surfaces that closed
    before. ``surfaces`` counts all surfaces. ``recorded`` is the label under which a study records the state, as
    ``pressure=0.5, leg 2``. ``apart`` is the largest factor between open flows of the two steps around the state, 1 on
    a step.
    """

    label: str
    data: Dataset
    surfaces: int
    closed: int = 0
    recorded: str = ""
    apart: float = 1.0

    @property
    def reached(self) -> int:
        """Number of surfaces that reach the state."""
        return int(self.data.sizes["seed"]) - self.closed

    @property
    def count(self) -> str:
        """The surfaces in words, as ``2 of 3 (1 closed before)``."""
        text = str(self.surfaces) if self.reached == self.surfaces else f"{self.reached} of {self.surfaces}"
        return f"{text} ({self.closed} closed before)" if self.closed else text


def at(run: Run, group: Dataset, level: Level) -> State:
    """Return `state_at` with the leak of the seal of the study."""
    state = state_at(run, group, level)
    return replace(state, data=with_leaks(run.study, group, state.data))


def state_at(run: Run, group: Dataset, level: Level) -> State:
    """Return the surfaces of a group that reach a level or closed before; a `DatasetError` if there are none.

    A level without a leg is on the first leg on which any surface reaches it. It is refused before the first step of
    leg 1: leg 1 passes it, and a later leg may have another state there. ``last`` is on the last leg. The label of the
    state names the leg of a path of several. A level with a unit needs a run with units.
    """
    legs = legs_of(group)
    check_load(run.study, group, level)
    if level.leg is not None and level.leg not in legs:
        raise DatasetError(f"{run.name} has no leg {level.leg}; allowed: {', '.join(map(str, legs))}")
    every = legs[-1:] if level.kind == "last" else legs
    searched = every if level.leg is None else [level.leg]
    reach: list[float] = []
    closed: State | None = None
    before = False
    for leg in searched:
        label = level.label if len(legs) == 1 or level.leg is not None else f"{level.label}, leg {leg}"
        state = _on_leg(run, group, replace(level, leg=None), leg, label, reach)
        if state is not None and state.reached:
            if before:
                later = f"allowed: a step there, or its leg, as '{level.label}, leg {leg}'"
                raise DatasetError(f"{run.name}: {level.label} lies before the first step of leg 1; {later}")
            return state
        closed = closed or state
        before = before or (leg == 1 and _is_before(level, reach))
    if closed is not None:
        return closed
    reach = reach or group["step"].values.astype(float).tolist()
    unit = f" {given}" if (given := unit_of(level.value)) else ""
    kind = level.kind if unit or level.kind not in STARRED else f"{level.kind} {STARRED[level.kind].symbol} ="
    raise DatasetError(
        f"{run.name} has no state at {level.label}: its steps have {kind} {number(min(reach))} to "
        f"{number(max(reach))}{unit}"
    )


def _is_before(level: Level, reach: Sequence[float]) -> bool:
    """Return whether a level lies before the first step of the first leg, whose values are given."""
    if not (_is_stored(level) and reach and level.value is not None):
        return False
    return level.value > max(reach) if STATE_KINDS[level.kind].falls else level.value < min(reach)


def _on_leg(run: Run, group: Dataset, level: Level, leg: int, label: str, reach: list[float]) -> State | None:
    """Return the surfaces at a level of a leg, None if there are none; add the values of the leg to ``reach``."""
    group = _inverse(group)
    on_leg = steps_of(group, leg)
    offset = int(on_leg[0])
    turn = int(offset > 0 and level.kind not in ("last", "step"))  # a leg begins where the leg before ends
    offset -= turn
    part = group.isel(step=slice(offset, int(on_leg[-1]) + 1))
    recorded, steps = _label(run, group, level, leg), group["step"].values[on_leg]
    own = _recorded(group, level, recorded, steps)
    flows = {} if level.kind == "last" else leak.recorded(group, recorded, steps)
    shut = leak.closed(part)
    # solved loads p* at which ways of the leg close or open, shape (surfaces, axes)
    crossings = np.transpose([solved_loads(group, axis, P, leg) for axis in group.indexes.get("axis", AXES)])
    beyond_closing = leg == 1 and level.kind in LOAD_KINDS
    is_load = level.kind in LOAD_KINDS or level.kind.startswith(LEAK)
    reached, places, beyond, alone = list[int](), list[float](), list[int](), list[int]()
    over = np.full((group.sizes["seed"], group.sizes["step"]), math.nan)
    for k, scale in enumerate(scales(run, group)):
        values, value, near = _path(run, part, k, level, scale, reach)
        over[k, offset : offset + values.size] = values
        solved = np.flatnonzero(np.isfinite(values))
        if not solved.size:
            continue
        is_recorded = bool(own) and math.isfinite(own[STATE_KINDS[level.kind].stored][k])
        if is_recorded:
            value = own[STATE_KINDS[level.kind].stored][k]
        if level.kind == "last":
            place: float | None = float(solved[-1])
        elif level.kind.startswith(LEAK):
            place = _of_leak(run, part, k, level, crossings[k])
        elif own or (place := _defined(run, level, leg, scale, solved.tolist(), turn)) is None:
            place = place_of(values, value, near, between=level.kind != "step")
        first = values[solved[0]]
        if place is None and is_recorded and (value > first if STATE_KINDS[level.kind].falls else value < first):
            place = float(solved[0])
            alone.append(len(reached))
        if place is not None:
            reached.append(k)
            places.append(place + offset)
        elif _is_stored(level):
            farther = value < values[solved].min() if STATE_KINDS[level.kind].falls else value > values[solved].max()
            shut[k] = (shut[k] & farther) | (beyond_closing & (crossings[k] <= value * (1.0 + REACHED)))
            beyond += [k] if shut[k].any() else []
    if not reached and not beyond:
        return None
    data = between(group, reached + beyond, [*places, *[float(offset)] * len(beyond)], over, is_load=is_load)
    if np.isfinite(crossings).any():
        _close_where_solved(data, group, reached, places, own, crossings[reached])
    _empty(data, group, alone)
    _take(data, own | flows, group, reached, places)
    if (ways := leak.ways(data)) in flows:
        for name in _of_ways(data):
            data[name].values[: len(reached)][flows[ways][reached] == 0.0] = 0.0
    if beyond:
        _close(data, len(reached), shut[beyond])
    apart = 1.0 if flows else _apart(group, reached, places)
    return State(label, _inverse(data), group.sizes["seed"], len(beyond), recorded, apart)


def _inverse(data: Dataset) -> Dataset:
    """Return numbers with the inverse of the Knudsen number, which is infinite where a way is closed."""
    if KNUDSEN not in data:
        return data
    with np.errstate(divide="ignore"):
        return data.assign({KNUDSEN: data[KNUDSEN].copy(data=1.0 / data[KNUDSEN].values)})


def _around(group: Dataset, name: str, reached: list[int], places: list[float]) -> tuple[Array, Array]:
    """Return a number of surfaces at the steps around places, the surfaces along the first axis."""
    steps = group.variables[name].transpose("seed", "step", ...).values
    low, high = (steps[reached, of(places).astype(int)] for of in (np.floor, np.ceil))
    return low, high


def _apart(group: Dataset, reached: list[int], places: list[float]) -> float:
    """Return the largest factor between the open flows of the steps around places."""
    logs = [0.0]
    for name in leak.FLOWS:
        if name in group and "step" in group.variables[name].dims:
            before, after = _around(group, name, reached, places)
            open_ = (before > 0.0) & (after > 0.0)
            logs.append(float(np.abs(np.log(after[open_] / before[open_])).max(initial=0.0)))
    return math.exp(max(logs))


def _close_where_solved(
    data: Dataset,
    group: Dataset,
    reached: list[int],
    places: list[float],
    own: Mapping[str, Array],
    closes: Array,
) -> None:
    """Let the flow and the opening of ways that close between two steps fall to 0 at their solved closing load.

    They lie on a straight line over p* from the open step.
    """
    count = len(reached)
    load = data[P].values[:count]
    if P in own:
        load = np.where(np.isfinite(own[P][reached]), own[P][reached], load)
    ends = [end[:, np.newaxis] for end in _around(group, P, reached, places)]
    for name in _of_ways(data):
        if "step" not in group.variables[name].dims:
            continue
        before, after = _around(group, name, reached, places)
        with np.errstate(divide="ignore", invalid="ignore"):  # a step may lie at the closing load
            share = np.clip((closes - load[:, None]) / (closes - np.where(before > 0.0, *ends)), 0.0, 1.0)
        last = np.maximum(before, after)  # of the open end
        inside = np.isfinite(share) & (np.minimum(before, after) == 0.0) & (last > 0.0)
        shrunk = (share > 0.0).astype(float) if name in WAYS else last * share
        data[name].values[:count][inside] = shrunk[inside]


def _of_ways(data: Dataset) -> list[str]:
    """Return the numbers along seed and axis that are 0 where a way of the dry gap is closed."""
    lifted = leak.of_lifted_gap(data)  # the fluid may keep these open
    names = [name for name in (*BY_LOGARITHM, *WAYS) if name in data and name not in lifted]
    return [name for name in names if data.variables[name].dims == ("seed", "axis")]


def _empty(data: Dataset, group: Dataset, alone: list[int]) -> None:
    """Leave out the numbers along the steps of recorded states before the first step."""
    for name, variable in data.data_vars.items() if alone else ():
        if variable.dtype.kind == "f" and "step" in group[name].dims:
            variable.values[alone] = np.nan


def recorded_labels(group: Dataset) -> list[str]:
    """Return the labels of the recorded states of a group, each once."""
    return list(dict.fromkeys(text for dim in STATES if dim in group.dims for text in group[dim].values.tolist()))


def _label(run: Run, group: Dataset, level: Level, leg: int) -> str:
    """Return the label of the recorded state of a level on a leg, in whatever unit a study gives it; else its own."""
    label = level.label if leg == 1 or level.kind in ("last", "step") else replace(level, leg=leg).label
    labels = recorded_labels(group)
    if label in labels or not _is_stored(level):
        return label
    by_surface = scales(run, group)
    states = [(text, found) for text in labels if _is_stored(found := parse(text)) and found.leg in (None, leg)]
    for text, found in sorted(states, key=lambda state: state[1].leg is None):
        if all(_same(scale, found, level) for scale in by_surface):
            return text
    return label


def _same(scale: Scale, one: Level, other: Level) -> bool:
    """Return whether two levels are one state of a surface."""
    (kind, value), (asked, wanted) = _starred(scale, one), _starred(scale, other)
    return kind == asked and abs(value - wanted) <= slack(kind, wanted)


def _starred(scale: Scale, level: Level) -> tuple[str, float]:
    """Return kind and value of a level as a starred number."""
    assert level.value is not None
    try:
        return scale.starred(level.kind, level.value)
    except ValueError as error:
        raise DatasetError(f"{level.kind} {error}") from error


def _path(
    run: Run, part: Dataset, k: int, level: Level, scale: Scale, reach: list[float]
) -> tuple[Array, float, float]:
    """Return the quantity of a level at each step of a surface, of a leak rate the load, its value, and its slack."""
    if level.kind in ("step", "last"):
        solved = np.isfinite(part.variables[P].transpose("seed", "step").values[k])
        return np.where(solved, part["step"].values.astype(float), np.nan), float(level.value or 0.0), 0.0
    if level.kind.startswith(LEAK):
        rates, value = _leak(run, part, k, level)
        values = rates.max(axis=0)
        reach += values[np.isfinite(values)].tolist()
        return part.variables[P].transpose("seed", "step").values[k], value, REACHED
    assert level.value is not None
    kind, value = _starred(scale, level)
    if (stored := STARRED[kind].stored) not in part:
        raise DatasetError(f"{run.name} has no {stored}; allowed: all variables of a run")
    values = part.variables[stored].transpose("seed", "step").values[k]
    unit = unit_of(level.value)
    one = 1.0 if unit is None else _starred(scale, replace(level, value=Quantity(1.0, unit)))[1]
    reach += (values[np.isfinite(values)] / one).tolist()
    return values, value, slack(kind, value)


def _defined(run: Run, level: Level, leg: int, scale: Scale, solved: list[int], first: int) -> float | None:
    """Return the place of the step that a leg defines as a level, its target or a listed load; else None."""
    legs = run.study.sweep.legs if run.study else ()
    if not 1 <= leg <= len(legs) or level.value is None or not _is_stored(level):
        return None
    defined = legs[leg - 1]
    targets = dict(enumerate(defined.listed, first)) if defined.listed is not None else {solved[-1]: defined.target}
    for place, target in targets.items():
        if target.value is not None and _is_stored(target) and place in solved and _same(scale, target, level):
            return float(place)
    return None


def _take(data: Dataset, own: dict[str, Array], group: Dataset, reached: list[int], places: list[float]) -> None:
    """Put the numbers of a recorded state in the place of those between two steps."""
    taken = {name: numbers[reached] for name, numbers in own.items()}
    for name, of in MADE.items():
        if name in data and of in taken:
            made, starred = (_around(group, one, reached, places)[::-1] for one in (name, of))
            known = starred[0] != 0.0  # V* is 0 in full contact
            with np.errstate(invalid="ignore"):  # 0 at both steps
                ratio = np.where(known, made[0], made[1]) / np.where(known, *starred)
            taken[name] = ratio * taken[of]
    for name, there in taken.items():
        if name not in data:  # a flow that no step has
            data[name] = ("seed", "axis"), np.full((data.sizes["seed"], len(AXES)), np.nan)
        known = np.isfinite(there)
        data[name].values[: len(reached)][known] = there[known]


def _close(data: Dataset, reached: int, shut: Array) -> None:
    """Give the surfaces beyond the end of a closed sweep the flow 0 along closed axes, and no other number."""
    zero = leak.zero_beyond(data)
    for name, variable in data.data_vars.items():
        beyond = variable.values[reached:]
        if variable.dtype.kind == "b":
            beyond[:] = False
        elif variable.dtype.kind == "f" and name not in ("Sq", "Sdq"):
            beyond[:] = np.nan
            if name in zero:
                beyond[shut] = 0.0


def _leak(run: Run, part: Dataset, k: int, level: Level) -> tuple[Array, float]:
    """Return the leak rates (axes of the level, steps) of a surface and that of the level, in the unit of the level."""
    assert level.value is not None
    unit = level.value.unit if isinstance(level.value, Quantity) else ""
    if leak.is_lifted(part):
        raise DatasetError(
            f"{run.name} has its leak under fluid pressure at recorded states alone: a state of {level.kind} is not "
            "known; allowed: loads of record.fluid_pressure.at"
        )
    if LEAK not in part:
        raise DatasetError(f"{run.name} has no {LEAK}: add record.dimensional.leak_rate to its study")
    rates = part[LEAK].isel(seed=k).sel(axis=_axes(level)).transpose("axis", "step")
    return rates.values * convert(1.0, str(part[LEAK].attrs["units"]), unit), float(level.value)


def _axes(level: Level) -> list[str]:
    """Return the axes of a leak rate, of which the largest counts."""
    return list(level.kind.removeprefix(LEAK).strip("_") or AXES)


def _of_leak(run: Run, part: Dataset, k: int, level: Level, crossing: Array) -> float | None:
    """Return the place of a leak rate, None without one.

    Between two steps it is that of the load from which on no way of the level leaks more. A way that closes at the
    second step is on the straight line to 0.
    """
    rates, value = _leak(run, part, k, level)
    loads, largest = part.variables[P].transpose("seed", "step").values[k], rates.max(axis=0)
    ends = crossing[part.indexes["axis"].get_indexer(_axes(level))]
    with np.errstate(divide="ignore"):
        logs = np.log(largest)
    if (step := place_of(logs, math.log(value), REACHED, between=False)) is not None:
        return step
    for before, after in itertools.pairwise(np.flatnonzero(np.isfinite(largest)).tolist()):
        low, high = sorted((before, after), key=lambda step: largest[step])
        if largest[low] < value < largest[high]:
            with np.errstate(divide="ignore", invalid="ignore"):
                shares = (ends - loads[high]) / (loads[low] - loads[high])  # of the way to the closed step
            closes = np.isfinite(shares) & (rates[:, low] == 0.0)
            to_low = np.where(closes, np.clip(shares, np.finfo(float).eps, 1.0), 1.0)
            around = [0.0, 1.0]
            for _ in range(HALVINGS):
                share = 0.5 * sum(around)
                straight = rates[:, high] + np.minimum(share / to_low, 1.0) * (rates[:, low] - rates[:, high])
                places = [high + share * (low - high)]
                curved = _curved(rates.T[np.newaxis], loads[np.newaxis], places, logarithm=True, over_log=True)[0]
                leaks = np.where(np.isfinite(curved), curved, straight)
                around[int(leaks.max() <= value)] = share
            return places[0]
    return None


def _recorded(group: Dataset, level: Level, label: str, steps: Array) -> dict[str, Array]:
    """Return the numbers of a recorded state by surface, NaN where no step of the leg has it; empty without one."""
    if not _is_stored(level):
        return {}
    stored = STATE_KINDS[level.kind].stored
    for dim in STATES:
        if dim in group.dims and label in (labels := group[dim].values.tolist()):
            place, held = {dim: labels.index(label)}, group.variables
            names = [name for name in (*OF_STATE, *OF_YIELD) if name in held]  # a user may have dropped some
            values = {name: held[key].isel(place).values for name in names if (key := f"{dim}_{name}") in held}
            if stored in values and f"{dim}_step" in held:
                on_leg = np.isin(held[f"{dim}_step"].isel(place).values, steps)
                return {name: np.where(on_leg, array, np.nan) for name, array in values.items()}
    return {}
