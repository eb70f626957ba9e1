"""Quantities of a user, as observables: what their functions get, and the rows of what they return."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from roughvol.errors import Problem, StudyError
from roughvol.observables.regions import Values, View
from roughvol.observables.variables import AXES, OF_TABLES, QUANTITIES, VARIABLES, Variable, columns_of, with_means
from roughvol.study import Case, Ensemble, Record
from roughvol.study.values.own import OwnQuantity
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array, Mask

OBSERVABLE = "own"


@dataclass(frozen=True, eq=False)
class SolvedState:
    """A solved state, as a function of a user gets it. Numbers have the units of the stored variables of their names.

    Attributes
    ----------
    gap : array (rows, columns)
        g/Sq in the region of the study, exactly 0 in contact. Axis 0 is x, axis 1 is y.
    pressure : array (rows, columns)
        p L/(E* Sq).
    contact : array (rows, columns) of bool
        Where p > 0.
    spacing : float
        Side of an element, in the unit of length of the study.
    Sq : float
        Root mean square height of the surface, in the unit of length of the study.
    E_star : float
        Contact modulus, in the unit of the study.
    mean_pressure : float
        p*.
    separation : float
        d/Sq.
    axis_names : tuple of str
        Names of the axes of the arrays.
    """

    gap: Array
    pressure: Array
    contact: Mask
    spacing: float
    Sq: float
    E_star: float
    mean_pressure: float
    separation: float
    axis_names: tuple[str, ...] = AXES


def values(view: View) -> Values:
    """Return what the functions of a study give at a state."""
    state, found = _state(view), Values()
    for name, quantity in _of(view.case.record).items():
        try:
            returned = quantity.function(state)
            value = np.ma.filled(np.ma.asarray(returned, dtype=np.float64), np.nan)  # a masked number is missing
        except (Exception, SystemExit) as error:
            where = f"at p* = {state.mean_pressure:.6g}"
            message = f"{quantity.target} fails {where} ({type(error).__name__}: {error})"
            raise StudyError([Problem(message, f"record.own.{name}")]) from error
        shape = tuple(len(along) for along in _coordinates(quantity).values())
        if returned is None or value.shape != shape:
            allowed = (
                f"{shape}, that of its coordinates" if shape else "a number, or an array with the attribute coordinates"
            )
            given = "nothing" if returned is None else f"shape {value.shape}"
            raise StudyError([Problem(f"{quantity.target} returns {given}; allowed: {allowed}", f"record.own.{name}")])
        found[name] = value
    return found


def labels(case: Case, surface: Surface) -> Values:
    """Return the coordinates of arrays."""
    found = [_coordinates(quantity) for quantity in _of(case.record).values()]
    return {dim: along for each in found for dim, along in each.items() if dim != "axis"}


def register(record: Record, ensemble: Ensemble | None = None) -> None:
    """Put the rows of the quantities of a study, and of their means, into the table of variables, or refuse them."""
    if not _of(record):
        return
    averaged = ensemble.accuracy.own if ensemble is not None else []
    known: dict[str, list[float]] = {}
    stored = [variable for variable, row in QUANTITIES.items() if row.observable != OBSERVABLE]
    taken = {*OF_TABLES, *stored, *itertools.chain(*map(columns_of, stored))}
    taken |= {
        f"{name}{end}" for name in (*taken, *_of(record)) for end in ("_range", "_count")
    }  # as `averages` has them
    described, problems = {}, []
    for name, quantity in _of(record).items():
        try:
            described[name] = row_of(name, quantity), _coordinates(quantity)
        except Exception as error:  # whatever the module of a user raises
            message = f"cannot import {quantity.target!r} ({type(error).__name__}: {error})"
            problems.append(Problem(message, f"record.own.{name}"))
    if problems:
        raise StudyError(problems)
    for name, quantity in _of(record).items():
        row, coordinates = described[name]
        if name in averaged and coordinates:
            message = f"{quantity.target} returns an array over {', '.join(coordinates)}; allowed: a number"
            raise StudyError([Problem(message, f"ensemble.accuracy.{name}")])
        for dim, along in coordinates.items():
            if message := _fault(name, dim, along, known):
                raise StudyError([Problem(f"{quantity.target} {message}", f"record.own.{name}")])
        rows = with_means(name, row) if name in averaged else {name: row}
        rows |= {
            dim: Variable(dim, "1", dim.replace("_", " "), dim, observable=OBSERVABLE)
            for dim in coordinates
            if dim != "axis"
        }
        for variable, made in rows.items():
            if variable in taken or (variable != name and variable in _of(record)):
                message = f"{variable} is the name of another number of tables or files: choose another name"
                raise StudyError([Problem(message, f"record.own.{name}")])
            QUANTITIES[variable] = VARIABLES[variable] = made


def _fault(name: str, dim: str, along: Any, known: dict[str, list[float]]) -> str:
    """Return the fault of a dimension and its labels, empty without one; ``known`` has those of other quantities."""
    if dim == "axis":
        return "" if len(along) == len(AXES) else f"has {len(along)} labels of axis; allowed: {' and '.join(AXES)}"
    if dim == name or not dim.isidentifier():
        return f"has the dimension '{dim}'; allowed: letters, digits and _, and not the name of the quantity"
    try:
        numbers = [float(label) for label in along]
    except (TypeError, ValueError):
        numbers = []
    if not numbers or not np.isfinite(numbers).all() or len(set(numbers)) < len(numbers):
        return f"has labels of {dim} that are equal or no finite numbers; allowed: finite numbers, each once"
    if known.setdefault(dim, numbers) != numbers:
        return f"has other labels of {dim} than another quantity: choose another dimension"
    return ""


def row_of(name: str, quantity: OwnQuantity) -> Variable:
    """Return the row of a quantity, from the attributes of its function."""
    function = quantity.function
    first = (function.__doc__ or "").strip().partition("\n")[0].rstrip(".")
    return Variable(
        dims=" ".join(["... step", *_coordinates(quantity)]),
        units=str(getattr(function, "units", "1")),
        long_name=str(getattr(function, "label", "") or first or name.replace("_", " ")),
        symbol=str(getattr(function, "symbol", name)),
        source=quantity.target,
        observable=OBSERVABLE,
        key=OBSERVABLE,
        touch=float(getattr(function, "touch", math.nan)),
    )


def _coordinates(quantity: OwnQuantity) -> Mapping[str, Any]:
    return dict(getattr(quantity.function, "coordinates", {}))


def _of(record: Record) -> Mapping[str, OwnQuantity]:
    return record.own or {}


def _state(view: View) -> SolvedState:
    arrays = view.gap, view.state.pressure(), view.contact
    for array in arrays:
        array.flags.writeable = False
    case, surface = view.case, view.surface
    state = view.state
    Sq = case.height or surface.Sq  # generated heights are scaled when they are stored
    return SolvedState(*arrays, surface.spacing, Sq, case.E_star, state.mean_pressure, state.separation)
