"""The runs behind a leak card: a study at one load, the same on coarser grids, and with another levelling."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from roughvol.campaign import running
from roughvol.campaign.batch import Progress
from roughvol.campaign.one_case import surface_of
from roughvol.errors import Problem, StudyError
from roughvol.store.dataset import Dataset
from roughvol.study import HeightFile, Level, Scale, Study, loads, read
from roughvol.study.scale import ALWAYS, KINDS, STORED
from roughvol.study.spectral import MadeSurface
from roughvol.study.units import unit_of
from roughvol.study.yaml_text import write

FINE = "finest grid"
COARSER = (2, 4)  # spacings of the coarser grids over that of the finest
OTHER_LEVEL = {"none": "tilt", "mean": "tilt", "tilt": "quadratic", "quadratic": "tilt"}
LEAKS = tuple(kind for kind in KINDS if kind.startswith("leak_rate"))  # no states of a record
FEWEST_NODES = 30  # nodes of a side of the coarsest grid


def level_of(text: str, study: Study | None = None) -> Level:
    """Return the state that ``pressure=0.3``, ``pressure=0.5 MPa`` or ``last`` names.

    Parameters
    ----------
    text : str
        Name of a quantity and its starred value, or its value with a unit; or ``last``.
    study : Study, optional
        Gives modulus, L and Sq for a value with a unit.

    Returns
    -------
    Level
        The state, by a starred value.

    Raises
    ------
    StudyError
        If it names no state, or the study gives no starred value for it.
    """
    kind, _, value = text.partition("=")
    if text == "last":
        return Level("last")
    if kind in LEAKS:
        message = f'at is {text!r}, a leak rate: roughvol ask --leak-rate "{value}" finds its pressure'
        raise StudyError([Problem(message)])
    try:
        number = read(value, KINDS.get(kind, ("", ""))[0])
        known = kind in KINDS and math.isfinite(number) and (kind not in ALWAYS or unit_of(number) is not None)
    except ValueError as error:
        known, reason = False, f" ({error})"
    else:
        reason = ""
    if not known:
        kinds = ", ".join(kind for kind in KINDS if kind not in LEAKS)
        message = (
            f"at is {text!r}; allowed: last, or one of {kinds} with a number or a unit, as pressure=0.3 or "
            f'pressure="0.5 MPa"{reason}'
        )
        raise StudyError([Problem(message)])
    return Level(kind, number) if unit_of(number) is None else _starred(kind, number, text, study)


def _starred(kind: str, value: float, text: str, study: Study | None) -> Level:
    """Return a value with a unit as a starred one, equal for all surfaces of a study."""
    if study is None:
        message = f"at is {text!r}; a unit needs a study"
        raise StudyError([Problem(message)])
    levels = set()
    for case in study.cases():
        surface = surface_of(case)
        height = study.surface.height if isinstance(study.surface, MadeSurface) else None
        scale = Scale(
            case.E_star,
            surface.side,
            height or surface.Sq,
            surface.heights.size * surface.spacing**2,
            study.material.unit,
            case.length_unit,
        )
        try:
            starred, number = scale.starred(kind, value)
        except ValueError as error:
            raise StudyError([Problem(f"at: {error}")]) from error
        levels.add((starred, float(f"{number:.12g}")))
    if len(levels) > 1:
        message = (
            f"at is {text!r}: the surfaces differ in Sq, so that no starred value fits; give surface: {{Sq: 1 um}}"
        )
        raise StudyError([Problem(message)])
    return Level(*levels.pop())


def variants(study: Study, at: Level) -> dict[str, Study]:
    """Return the studies of a card by name: the finest grid first, coarser grids, another levelling.

    Parameters
    ----------
    study : Study
        One kind of surface: one D and m, or a file.
    at : Level
        The load of the card.

    Returns
    -------
    dict
        Studies by name.

    Raises
    ------
    StudyError
        If the study has several D or m, an ensemble, or no sweep.
    """
    surface = study.surface
    problems = []
    if study.ensemble is not None:
        problems.append(Problem("a leak card takes seeds, and no ensemble", "ensemble"))
    if study.sweep.steps == 0:
        problems.append(Problem("a leak card needs a load: sweep.steps is 0", "sweep.steps"))
    if not isinstance(surface, HeightFile) and max(len(surface.dimensions), len(surface.m)) > 1:
        problems.append(Problem("a leak card is of one kind of surface; allowed: one D and one m", "surface"))
    if problems:
        raise StudyError(problems)
    fine = _changed(study, at, {}, 1.0, "transmissivity")
    made = {FINE: fine}
    for factor in COARSER:
        keys = _coarser(study, factor)
        if keys is None:
            continue
        try:
            made[f"spacing × {factor}"] = _at_equal_pressure(study, at, keys)
        except StudyError:  # a grid too coarse for the waves of the surface; the card says what is not known
            break
    if isinstance(surface, HeightFile):
        other = OTHER_LEVEL[str(surface.level)]
        made[f"level: {other}"] = _at_equal_pressure(study, at, {"level": other})
    return made


def _coarser(study: Study, factor: int) -> dict[str, Any] | None:
    """Return the keys of the section ``surface`` for a coarser grid; None where it has too few nodes."""
    surface = study.surface
    if isinstance(surface, HeightFile):
        nodes = min(surface_of(study.cases()[0]).shape)
        return {"downsample": surface.downsample * factor} if nodes // factor >= FEWEST_NODES else None
    m = surface.m[0] - factor // 2
    key, value = ("m", m) if "m" in type(surface).model_fields else ("n", 2**m)
    return {key: value} if 2**m + 1 >= FEWEST_NODES else None


def _at_equal_pressure(study: Study, at: Level, keys: Mapping[str, Any]) -> Study:
    """Return the study with another surface, at the same nominal pressure p = p* E* Sq/L."""
    if not isinstance(study.surface, HeightFile):
        return _changed(study, at, keys, 1.0)
    steepness = []
    for one in (study, _changed(study, at, keys, 1.0)):
        surface = surface_of(one.cases()[0])
        steepness.append(surface.unit / surface.side)
    return _changed(study, at, keys, steepness[0] / steepness[1])


def _changed(study: Study, at: Level, keys: Mapping[str, Any], pressures: float, *further: str) -> Study:
    """Return the study with the records of a card, other keys of its surface, and its starred pressures times a factor.

    Parameters
    ----------
    further : str
        Quantities of the void at every step, beyond percolation and constriction.
    """
    data = study.model_dump(mode="json")
    value = at.value if at.value is None or at.kind != "pressure" else at.value * pressures
    wanted: Any = "last" if value is None else {at.kind: value}
    kept = {name: data["record"][name] for name in ("region", "dimensional") if data["record"].get(name) is not None}
    kept.get("dimensional", {}).pop("critical_gap", None)
    if study.gas_flow and "transmissivity" in further:
        further = (*further, "gas_flow")
    else:  # the budget is that of the liquid
        data.pop("fluid", None)
        kept.get("dimensional", {}).pop("gas_leak_rate", None)
    if "transmissivity" not in further or not kept.get("dimensional"):
        kept.pop("dimensional", None)
    steps = dict.fromkeys(("percolation", "constriction", *further), "every-step")
    data["record"] = {**kept, "transport": {**steps, "flux_at": wanted}, "fields_at": wanted}
    data["surface"] |= keys
    for leg in data["sweep"] if isinstance(data["sweep"], list) else [data["sweep"]]:
        # pressures with a unit are equal already
        if isinstance(leg.get("to"), dict) and isinstance(leg["to"].get("pressure"), float):
            leg["to"]["pressure"] *= pressures
        if "pressures" in leg:
            leg["pressures"] = [p * pressures if isinstance(p, float) else p for p in leg["pressures"]]
    with study.placing():
        return loads(write(data))


def compute(
    study: Study,
    at: Level,
    folder: Path,
    *,
    jobs: int | None = None,
    on_event: Callable[[Progress], None] | None = None,
    stopping: Callable[[], bool] = lambda: False,
) -> dict[str, Dataset]:
    """Return the runs of a card by name; finished ones are read.

    Parameters
    ----------
    study, at
        As in `variants`.
    folder : path
        Folder of the card; each run has a folder inside.
    jobs, on_event, stopping
        As in `running.run`.

    Returns
    -------
    dict
        Datasets by name, the finest grid first.

    Raises
    ------
    StudyError
        If the study has lists, or no surface reaches the load.
    """
    if study.axes:
        message = "a card shows one combination; allowed: one value in place of each list"
        raise StudyError([Problem(f"{axis.name}: {message}") for axis in study.axes])
    runs = {}
    for name, variant in variants(study, at).items():
        inside = folder / "runs" / at.label / name.replace(" × ", "_").replace(": ", "_").replace(" ", "_")
        runs[name] = running.run(variant, jobs=jobs, out=inside, on_event=on_event, stopping=stopping)
        if name == FINE:
            _check_reached(runs[name], at)
    return runs


def _check_reached(fine: Dataset, at: Level) -> None:
    """Refuse a card at a load that no surface reaches."""
    if "flux_at_transmissivity_x" in fine and bool(fine["flux_at_transmissivity_x"].notnull().any()):
        return
    reach = fine[STORED[at.kind]] if at.kind in STORED else fine["mean_pressure"]
    message = (
        f"at {at.label} is not reached: the steps of the sweep have {at.kind} {float(reach.min()):.4g} to "
        f"{float(reach.max()):.4g}; press farther, or ask for less"
    )
    raise StudyError([Problem(message)])
