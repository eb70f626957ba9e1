"""Rules across the sections of a study: keys that exclude each other, and values that do not fit together.

They read plain data, so that a file with other faults gets all its problems at once.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args

from roughvol.study.sections import fluid, spectral
from roughvol.study.sections.ensemble import CLOSING, FEWEST_LEVELS, RECORDED_BY
from roughvol.study.sections.height_file import BARE_FORMATS, HEIGHT_FORMATS, HeightFile
from roughvol.study.sections.record import EVERY_STEP, SELECTORS, Record
from roughvol.study.sections.solver import PAPER_MAX_M, FreeKernel, PeriodicKernel
from roughvol.study.sections.strict import names
from roughvol.study.sections.sweep import Target
from roughvol.study.sections.targets import (
    end_of,
    lacking_units,
    levels_of,
    list_of,
    sections_of,
    steps_of,
)
from roughvol.study.values.numbers import whole
from roughvol.study.values.state_kinds import LISTS, STARRED, STATE_KINDS
from roughvol.study.values.units import has_unit, length_unit
from roughvol.study.yaml_text import KeyPath, number_text

FILES = {"file", "files"}  # keys of measured surfaces
MAX_CASES = 100_000  # cases of one study
DEFAULT_END = "mean-plane"  # end of a sweep that names none
DEFAULT_SEEDS = 10  # seeds of a surface that names none
UNPRESSED = ("heights", "residual_heights", "region", "texture", "psd", "all_legs")  # records that need no contact
PERIODIC_LEAST_M = 3  # smallest m of a periodic midpoint surface
BREAK_PERIOD = {"crop": None, "downsample": 1, "resample": "none", "low_pass": None}  # values that keep a period
SEVERAL_ARRAYS = (".npz", ".nc", ".tif", ".tiff", ".dat")  # formats of files with several arrays


def conflicts(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield key path and message of each conflict between keys.

    Parameters
    ----------
    data : dict
        A study as plain data, which may have other faults.

    Yields
    ------
    tuple
        Path of the key, and the message without it.
    """
    surface, record = _mapping(data, "surface"), _mapping(data, "record")
    yield from _dense_conflicts(data)
    yield from _file_conflicts(surface, _mapping(data, "surface", "against"))
    yield from _periodic_conflicts(surface, _mapping(data, "solver"), record)
    yield from _beyond_full_contact(data)
    yield from _path_conflicts(data)
    yield from _hardness_conflicts(data)
    yield from _unit_conflicts(surface, _mapping(data, "material"), record)
    yield from fluid.conflicts(data)
    yield from _target_conflicts(data)
    yield from _ensemble_conflicts(data)
    yield from spectral.conflicts(data)
    levels = [
        (*keys, kind)
        for keys in (("ensemble", "at"), *(("record", *path) for path in SELECTORS))
        for kind in _mapping(data, *keys)
    ]
    if _steps(data) == 0:
        yield from _without_contact(record)
    else:
        yield from _unreached_levels(data, levels)
    lists: list[tuple[str, ...]] = [("surface", name) for name in ("D", "H", "m", "n", "seeds")]
    lists += [("record", "box_counting", "thresholds"), ("record", "region_widths", "shares")]
    yield from _duplicates(data, [*lists, *levels])
    seeds = whole(surface.get("seeds", DEFAULT_SEEDS))
    axes = (("D", "H"), ("m", "n"), ("seeds",))
    counts = [sum(len(list(_numbers(surface.get(name)))) for name in axis) for axis in axes]
    cases = counts[0] * counts[1] * (seeds if isinstance(seeds, int) else counts[2])
    if cases > MAX_CASES:
        yield ("surface",), f"makes {cases} cases (D times m times seeds); allowed: at most {MAX_CASES}"


def _dense_conflicts(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield resolutions beyond the dense method of the paper."""
    if "paper" in (data.get("solver"), _mapping(data, "solver").get("method")):
        for path, m in _numbers(_mapping(data, "surface").get("m"), "surface", "m"):
            if m > PAPER_MAX_M:
                yield path, f"solver method 'paper' is dense and takes m <= {PAPER_MAX_M}, given {number_text(m)}"


def _without_contact(record: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield the recorded observables that need a contact, for a study without steps."""
    pressed = [name for name in Record.model_fields if name not in UNPRESSED]
    paths: list[KeyPath] = [(name,) for name in pressed if record.get(name) not in (None, False)]
    if _mapping(record, "texture").get("at") not in (None, "last"):  # texture before load needs no contact
        paths.append(("texture", "at"))
    if _mapping(record, "psd").get("at") is not None:
        paths.append(("psd", "at"))
    for path in paths:
        yield ("record", *path), "no contact to record: sweep.steps is 0"


def _unreached_levels(data: dict[str, Any], levels: Iterable[tuple[str, ...]]) -> Iterator[tuple[KeyPath, str]]:
    """Yield the levels of a quantity beyond the value at which the sweep ends."""
    ends = [end_of(leg) for _, leg in _legs(data)]
    for keys in levels:
        kind = keys[-1]
        sign = -1 if kind in STATE_KINDS and STATE_KINDS[kind].falls else 1
        lasts = [last for end in ends for _, last in _numbers(_steps(data) if kind == "step" else end.get(kind))]
        if len(lasts) < len(ends):  # a leg ends at another quantity
            continue
        last = max(lasts, key=lambda value: sign * value)
        for path, level in _numbers(_mapping(data, *keys[:-1])[kind], *keys):
            if sign * (level - last) > 1e-9 * max(1.0, abs(last)):
                yield path, f"{number_text(level)} is not reached: the sweep ends at {kind} {number_text(last)}"


def _path_conflicts(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield ends of legs that name no state or several, and legs that cannot follow each other."""
    legs = _legs(data)
    for path, leg in legs:
        one_end = list_of(leg) is None and isinstance(leg.get("to"), dict)
        if one_end and sum(value is not None for value in leg["to"].values()) != 1:
            yield (*path, "to"), f"must name exactly one of {', '.join(names(Target))}"
    if not isinstance(data.get("sweep"), list | tuple):
        return
    if data.get("ensemble") is not None:
        yield ("sweep",), "an ensemble takes one sweep, {steps, to}, and no list of legs"
    for kind in ("pressure", "indentation"):
        if legs and end_of(legs[0][1]).get(kind) == 0:
            yield ("sweep", 0, "to", kind), "must be > 0 on the first leg, which begins at first touch"
    for (_, before), (path, leg) in itertools.pairwise(legs):
        ends = [end_of(one) or one.get("to", DEFAULT_END) for one in (before, leg)]
        if ends[0] == ends[1]:
            yield (*path, "to"), "is the end of the leg before: the leg has no length"


def _hardness_conflicts(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield what needs a hardness that acts, and what excludes one."""
    yields = _yields(data)
    if _mapping(data, "record").get("residual_heights") is True and not yields:
        yield ("record", "residual_heights"), "no plastic displacement: give material.hardness"
    if yields and "paper" in (data.get("solver"), _mapping(data, "solver").get("method")):
        yield ("solver",), "solver method 'paper' takes no hardness; allowed: material.plastic: false"


def _yields(data: dict[str, Any]) -> bool:
    """Return whether a hardness acts."""
    material = _mapping(data, "material")
    return material.get("hardness") is not None and material.get("plastic") is not False


def _legs(data: dict[str, Any]) -> list[tuple[KeyPath, dict[str, Any]]]:
    """Return the legs of the sweep with their key paths; one without a list."""
    sweep = data.get("sweep")
    if isinstance(sweep, list | tuple):
        return [(("sweep", index), leg if isinstance(leg, dict) else {}) for index, leg in enumerate(sweep)]
    return [(("sweep",), _mapping(data, "sweep"))]


def _steps(data: dict[str, Any]) -> float:
    """Return the steps of all legs."""
    return sum(number for _, leg in _legs(data) for _, number in _numbers(steps_of(leg)))


def _duplicates(data: dict[str, Any], lists: Iterable[tuple[str, ...]]) -> Iterator[tuple[KeyPath, str]]:
    """Yield the numbers that a list holds twice."""
    for keys in lists:
        seen: set[float] = set()
        for path, number in _numbers(_mapping(data, *keys[:-1]).get(keys[-1]), *keys):
            if number in seen:
                yield path, f"duplicate value {number_text(number)}"
            seen.add(number)


def _file_conflicts(surface: dict[str, Any], against: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield conflicts between the keys of height files and the formats of these files."""
    bodies: list[tuple[KeyPath, dict[str, Any]]] = [(("surface",), surface), (("surface", "against"), against)]
    suffixes = {path: Path(str(body["file"])).suffix.lower() for path, body in bodies if "file" in body}
    for path, body in bodies:
        suffix = suffixes.get(path, "")
        if body.get("variable") is not None and suffix in HEIGHT_FORMATS and suffix not in SEVERAL_ARRAYS:
            yield (*path, "variable"), f"a {suffix} file holds one array without a name: omit 'variable'"
    if "file" not in surface or not set(suffixes.values()) <= {*BARE_FORMATS}:
        return  # other formats may have sizes and units
    if surface.get("L") is None and surface.keys() <= HeightFile.model_fields.keys():
        yield ("surface", "L"), f"missing, and the file has no size ({HeightFile.model_fields['L'].description})"
    if surface.get("unit") is not None or length_unit(surface.get("L")) is not None:
        return
    crop = surface["crop"] if isinstance(surface.get("crop"), dict) else {}
    lengths: list[tuple[KeyPath, Any]] = [(("low_pass",), surface.get("low_pass"))]
    lengths += [
        (("crop", axis), position)
        for axis, positions in crop.items()
        if isinstance(positions, list)
        for position in positions
    ]
    for key, length in lengths:
        if has_unit(length):
            yield ("surface", *key), f"has a unit ({length}) and L has none: give L with its unit, as L: 100 um"


def _periodic_conflicts(
    surface: dict[str, Any], solver: dict[str, Any], record: dict[str, Any]
) -> Iterator[tuple[KeyPath, str]]:
    """Yield the keys that a periodic surface excludes, and those that need one."""
    periodic = surface.get("periodic") is True
    cell = _mapping(record, "transport").get("cell_transmissivity") is not None
    if cell and (not periodic or record.get("region") is not None):
        message = "needs surface.periodic: true and no record.region: a part of a plane is no period"
        yield ("record", "transport", "cell_transmissivity"), message
    if not periodic:
        if (kernel := solver.get("kernel")) in get_args(PeriodicKernel):
            allowed = ", ".join(get_args(FreeKernel))
            yield ("solver", "kernel"), f"{kernel!r} needs surface.periodic: true; allowed on a free patch: {allowed}"
        return
    for path, m in _numbers(surface.get("m"), "surface", "m"):
        if m < PERIODIC_LEAST_M:
            yield path, f"a periodic surface takes m >= {PERIODIC_LEAST_M} (8 x 8 elements), given {number_text(m)}"
    for key, default in BREAK_PERIOD.items():
        if surface.get(key, default) != default:
            message = "changes or cuts the period of a periodic surface: treat the file beforehand, or omit it"
            yield ("surface", key), message
    if surface.get("level", "none") not in ("none", "mean"):
        yield ("surface", "level"), "a tilted or curved surface is not periodic; allowed with periodic: none, mean"


def _beyond_full_contact(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield negative separations of a periodic surface that does not yield: d is its mean gap."""
    if _mapping(data, "surface").get("periodic") is not True or _yields(data):
        return
    for path, kind, value in sections_of(data.get("sweep")):
        if kind == "separation" and str(value).lstrip().startswith("-"):
            message = "must be >= 0, given {}: d of a periodic surface is its mean gap, 0 at full contact"
            yield path, message.format(value if isinstance(value, str) else number_text(value))


def _unit_conflicts(
    surface: dict[str, Any], material: dict[str, Any], record: dict[str, Any]
) -> Iterator[tuple[KeyPath, str]]:
    """Yield units that are missing or given twice."""
    own, unit = length_unit(surface.get("L")), surface.get("unit")
    has_length = own is not None or unit is not None
    if own is not None and unit not in (None, own):
        yield ("surface", "unit"), f"L has a unit already ({surface['L']}): omit 'unit'"
    if has_unit(surface.get("Sq")) and not has_length:
        yield ("surface", "Sq"), f"has a unit ({surface['Sq']}) and L has none: give L with its unit, as L: 100 um"
    modulus = material.get("E_star", material.get("E"))
    if has_unit(material.get("hardness")) and not has_unit(modulus):
        yield ("material", "hardness"), "has a unit and the modulus has none: give both with units, or none"
    other = material.get("against")
    if isinstance(other, dict) and has_unit(other.get("E")) and not has_unit(modulus):
        yield ("material", "against", "E"), "has a unit and that of the first body has none: give both with units"
    fluid = record.get("fluid_pressure")
    if isinstance(fluid, dict):
        for name in ("inlet", "outlet"):
            if has_unit(fluid.get(name)) and not has_unit(modulus):
                yield ("record", "fluid_pressure", name), "has a unit and the modulus has none: give both with units"
        if material.get("hardness") is not None and material.get("plastic", True):
            yield ("record", "fluid_pressure"), "needs elastic contact: material.plastic is true and a hardness given"
    wanted = record.get("dimensional")
    for name in [key for key, value in wanted.items() if value is not None] if isinstance(wanted, dict) else ():
        if name == "pressure" and not has_unit(modulus):
            yield ("record", "dimensional", name), "needs the modulus with its unit, as material: {E_star: 100 GPa}"
        if name != "pressure" and not has_length and not FILES & surface.keys():
            yield ("record", "dimensional", name), "needs the unit of length, as surface: {L: 100 um}"
        needs = {"leak_rate": "transmissivity", "critical_gap": "constriction", "gas_leak_rate": "gas_flow"}.get(name)
        transport = record.get("transport")
        if needs and not (isinstance(transport, dict) and transport.get(needs) is not None):
            yield ("record", "dimensional", name), f"needs record.transport.{needs}"


def _target_conflicts(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield states of the sweep whose units cannot be converted, and loads on a part of the surface."""
    surface, material = _mapping(data, "surface"), _mapping(data, "material")
    modulus = material.get("E_star", material.get("E"))
    has_length = length_unit(surface.get("L")) is not None or surface.get("unit") is not None
    yield from lacking_units(data, modulus, has_length=has_length or bool(FILES & surface.keys()))
    if _mapping(data, "record", "dimensional").get("leak_rate") is None:
        for path, kind, value in sections_of(data.get("sweep")):
            if kind.startswith("leak_rate") and value is not None:
                message = (
                    "needs a fluid: record: {dimensional: {leak_rate: {pressure_drop: 1 bar, viscosity: 1 mPa*s}}}"
                )
                yield path, message
    for path, leg in _legs(data):
        if leg.get("equal") == "log pressure" and 0 in (leg.get("steps"), end_of(leg).get("pressure")):
            yield (*path, "equal"), "equal ratios of pressure need steps, and an end > 0"
    if _mapping(data, "record").get("region") is None:
        return
    for path, kind, _ in (*sections_of(data.get("sweep")), *levels_of(data.get("record"))):
        if kind == "load":
            yield path, "is a load on the whole surface, and states are those of record.region: give a pressure"


def _ensemble_conflicts(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield keys that an ensemble excludes, and means without scatter."""
    surface, sweep = _mapping(data, "surface"), _mapping(data, "sweep")
    for keys in (("surface", "m"), ("surface", "n")):
        if _mapping(data, keys[0]).get(keys[1]) == "auto" and data.get("ensemble") is None:
            yield keys, "'auto' needs the section 'ensemble', whose accuracy decides it"
    if not isinstance(data.get("ensemble"), dict):
        return
    if FILES & surface.keys():
        yield ("ensemble",), "needs generated surfaces (surface.D, surface.m): a file of heights is one surface"
        return
    if "seeds" in surface:
        yield ("surface", "seeds"), "cannot be given beside 'ensemble', which decides how many: leave it out"
    for name in ("m", "n"):
        if isinstance(surface.get(name), list) and len(surface[name]) > 1:
            yield ("surface", name), "must be one number beside 'ensemble': the finest resolution, or 'auto'"
    fewest = {"n": spectral.FEWEST << FEWEST_LEVELS - 1}
    if surface.get("periodic") is True:
        fewest["m"] = PERIODIC_LEAST_M + FEWEST_LEVELS - 1
    for name, least in fewest.items():
        for path, finest in _numbers(surface.get(name), "surface", name):
            if finest < least:
                yield path, f"must be at least {least} beside 'ensemble', which takes {FEWEST_LEVELS} levels or more"
    if sweep.get("steps") == 0:
        yield ("ensemble",), "there is no contact to average, since sweep.steps is 0"
    states = _mapping(data, "ensemble", "at")
    yield from _between_listed(sweep, states)
    short_names = {kind.stored: kind.name for kind in STARRED.values()}
    quantities = {name: short_names.get(name, name) for name in _mapping(data, "ensemble", "accuracy")}
    for name, quantity in quantities.items():
        if quantity in states:
            yield ("ensemble", "accuracy", name), f"is given by ensemble.at.{quantity}: its value there has no scatter"
        if list(quantities.values()).count(quantity) > 1:
            yield ("ensemble", "accuracy", name), f"is '{quantity}' by another name: give one of them"
    end = sweep.get("to", DEFAULT_END)
    yield from _unrecorded_means(list(quantities), end, _mapping(data, "record", "transport"))
    if states and quantities and quantities.keys() <= CLOSING.keys():
        yield ("ensemble", "at"), f"is of no use for {', '.join(quantities)} alone: leave it out"
    constant = {"separation"} if end == "mean-plane" else set(end) if isinstance(end, dict) else set()
    for name, quantity in quantities.items():
        if not states and quantity in constant:
            message = "is the same on every surface at the last step: name states in 'at'"
            yield ("ensemble", "accuracy", name), message


def _between_listed(sweep: dict[str, Any], states: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield states of an ensemble that its sweep does not list, between which no error is known."""
    name = list_of(sweep)
    if name is None:
        return
    for kind, levels in states.items():
        known = [value for _, value in _numbers(sweep[name])] if LISTS[name].name == kind else []
        for path, level in _numbers(levels, "ensemble", "at", kind):
            if level not in known:
                yield path, f"{number_text(level)} is not among sweep.{name}: list it there, or give steps and to"


def _unrecorded_means(quantities: list[str], end: Any, transport: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield quantities of the void whose numbers a study does not record at every step."""
    axis = "both" if end == "percolation" else end.get("percolation") if isinstance(end, dict) else None
    for name in quantities:
        key = RECORDED_BY.get(name)
        if key is None or transport.get(key) == EVERY_STEP:
            continue
        closing = CLOSING.get(name, "").removeprefix("percolation-")
        if closing and closing == axis:
            continue
        sweep = f"sweep.to: {{percolation: {closing}}}, or " if closing else ""
        yield ("ensemble", "accuracy", name), f"needs {sweep}record.transport.{key}: {EVERY_STEP}"


def _mapping(data: dict[str, Any], *path: str) -> dict[str, Any]:
    """Return the mapping at a key path; an empty one if there is none."""
    section: Any = data
    for part in path:
        section = section.get(part) if isinstance(section, dict) else None
    return section if isinstance(section, dict) else {}


def _numbers(value: Any, *path: str | int) -> Iterator[tuple[KeyPath, float]]:
    """Yield the numbers of a number or a list, each with its key path."""
    items = [((*path, index), item) for index, item in enumerate(value)] if isinstance(value, list) else [(path, value)]
    yield from ((where, item) for where, item in items if isinstance(item, int | float) and not isinstance(item, bool))
