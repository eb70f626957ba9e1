"""Labelled, self-describing datasets: one table of every stored variable; build, write, read and combine them.

Conventions of the stored numbers
---------------------------------
Starred quantities are dimensionless (lengths over Sq, pressure times L/(E* Sq)); where the table says ``length``, the
file says the unit of the study, and ``length`` if that has none. Positions x and y are over L, so that a coarse lattice
lies on the nodes of a fine one.

A surface has the dimensions ``(D, m, seed)``, or ``(case,)`` when its heights come from a file; ``...`` in the table
stands for either. One case is stored with these dimensions of length 1. A study is the union of its cases by label;
what a case does not have (a state that was not reached, a node that a coarse lattice lacks) is

* NaN in real numbers and in counts (which the file holds as integers with a fill value),
* -1 in the step numbers ``*_step``,
* False in ``converged``, which is true only where a state was solved *and* met its residual.
"""

from __future__ import annotations

import datetime
import functools
import importlib.metadata
import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import netCDF4
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from xarray import Dataset
from xarray.backends import NetCDF4DataStore

from roughvol._version import __version__
from roughvol.errors import DatasetError
from roughvol.store import columns, stamped_file
from roughvol.store.columns import Arrays
from roughvol.store.stamped_file import FORMAT
from roughvol.store.variables import DTYPES, FIELDS, MISSING, TIMES, VARIABLES, Variable
from roughvol.study import Case, Region
from roughvol.surfaces.body import Body

__all__ = ["VARIABLES", "Dataset", "Variable", "build", "combine", "provenance", "read", "write"]

CLASSIC: Final = "NETCDF3_64BIT_DATA"  # of small cases: HDF5 takes twice the time, and five times the space
SMALL = 1 << 20  # bytes of a case up to which its values stand in its file a second time, as columns
REFERENCE = (
    "M. Paggi, Q.-C. He, Evolution of the free volume between rough surfaces in contact, "
    "Wear 336-337 (2015) 86-95, https://doi.org/10.1016/j.wear.2015.04.021"
)
CONVENTIONS = (
    "heights positive up; pressure positive in compression; non-periodic elastic half space, no friction; "
    "every node is a square element of side spacing = L/(rows-1); contact = elements with pressure > 0; "
    "starred: lengths over Sq, pressure times L/(E_star Sq), E_star = E/(1-nu^2); "
    "separation = (z_max - mean(z) - indentation)/Sq, the rigid far-field one; x and y over L; "
    "unit 'length' is that of L in the study, and arbitrary"
)


def build(case: Case, values: Mapping[str, ArrayLike], attributes: Mapping[str, str]) -> Dataset:
    """Return the labelled dataset of one case.

    Parameters
    ----------
    case : Case
        Gives the leading coordinates (D, m, seed, or the file) and L.
    values : mapping of name to array
        Coordinates and variables of the table, without the leading dimensions of the case.
    attributes : mapping
        Provenance, see `provenance`.

    Raises
    ------
    DatasetError
        If a name is not in the table, or an array does not have the dimensions the table gives it.
    """
    leading: dict[str, Any] = {"case": case.label} if case.file else {"D": case.D, "m": case.m, "seed": case.seed}
    labels: dict[str, Any] = {name: [label] for name, label in leading.items()} | {"L": case.L}
    found: dict[str, tuple[list[str], NDArray[Any]]] = {}
    for name, value in (labels | dict(values)).items():
        if name not in VARIABLES:
            message = f"{name!r} is not a stored variable; known are {', '.join(VARIABLES)}"
            raise DatasetError(message)
        array: NDArray[Any] = np.asarray(value, dtype=DTYPES[VARIABLES[name].kind])
        dims = VARIABLES[name].dims.split()
        if dims[:1] == ["..."]:
            dims = [*leading, *dims[1:]]
            array = array[(np.newaxis,) * len(leading)]
        if array.ndim != len(dims):
            message = f"{name} has dimensions ({', '.join(dims)}), got an array of shape {array.shape}"
            raise DatasetError(message)
        found[name] = (dims, array)
    return _described(Dataset(found, attrs=dict(attributes)))  # at once: each one added alone takes a millisecond


def combine(cases: Sequence[Dataset | Arrays], attributes: Mapping[str, str]) -> Dataset:
    """Return one dataset of many cases, aligned by label; what a case lacks is missing as the module's docstring says.

    Raises
    ------
    DatasetError
        If there is no case, or the cases differ in L (they would not be one study).
    """
    if not cases:
        message = "no case to combine"
        raise DatasetError(message)
    parts = [arrays_of(case) if isinstance(case, Dataset) else case for case in cases]
    sides = sorted({float(part["L"][1]) for part in parts})
    if len(sides) > 1:
        message = f"cases of one study share L, got {', '.join(f'{side:g}' for side in sides)}"
        raise DatasetError(message)
    held = set().union(*parts)
    names = [name for name in VARIABLES if name in held]
    dims = {dim: _union([part[dim][1] for part in parts if dim in part]) for dim in names if _is_dim(dim)}
    places = {dim: {label: index for index, label in enumerate(dims[dim].tolist())} for dim in dims}
    study = Dataset(coords={"L": sides[0]} | {dim: (dim, labels) for dim, labels in dims.items()})
    study.attrs = dict(attributes)
    wholes: dict[str, NDArray[Any]] = {}
    shaped: dict[str, tuple[str, ...]] = {}
    for part in parts:
        index = {dim: [places[dim][label] for label in part[dim][1].tolist()] for dim in part if dim in dims}
        spots: dict[tuple[str, ...], Any] = {}
        for name, (along, values) in part.items():
            if name in study.coords:
                continue
            if name not in wholes:  # all that hold it agree in its dimensions: the table gives them
                kind, shape = VARIABLES[name].kind, tuple(len(dims[dim]) for dim in along)
                wholes[name], shaped[name] = np.full(shape, MISSING[kind], dtype=DTYPES[kind]), along
            if along not in spots:
                spots[along] = np.ix_(*(index[dim] for dim in along))
            wholes[name][spots[along]] = values
    for name in names:
        if name in wholes:
            study[name] = (shaped[name], wholes[name])
    return _described(study)


def arrays_of(dataset: Dataset) -> Arrays:
    """Return the variables of a dataset by name: dimensions and values."""
    return {
        str(name): (tuple(map(str, variable.dims)), np.asarray(variable.values))
        for name, variable in dataset.variables.items()
    }


def to_bytes(dataset: Dataset) -> bytes:
    """Return a dataset as a stamped netCDF file, made in memory; behind a small case stand its columns."""
    labels = stamped_file.labels_of(dataset.attrs)
    small = bool(labels["case"]) and dataset.nbytes <= SMALL
    store = netCDF4.Dataset(
        "memory.nc", "w", format=CLASSIC if small and _fits_classic(dataset) else "NETCDF4", memory=4096
    )
    try:
        dataset.dump_to_store(NetCDF4DataStore(store), encoding=_encoding(dataset))
    finally:
        content = bytes(store.close())
    if small:
        block = columns.packed(arrays_of(dataset))
        content, labels = content + block, labels | {"columns": str(len(block))}
    return stamped_file.stamped(content, labels)


def _fits_classic(dataset: Dataset) -> bool:
    """Return whether the classic model holds all: no text, and whole numbers of 32 bits."""
    kinds = {variable.dtype.kind for variable in dataset.variables.values()}
    whole = [variable.values for variable in dataset.variables.values() if variable.dtype.kind == "i"]
    return kinds <= set("fib") and all(np.abs(values).max(initial=0) < 2**31 for values in whole)


def write(dataset: Dataset, path: Path) -> None:
    """Write a dataset, stamped, so that the file is either whole or not there.

    Raises
    ------
    FolderError
        If the folder cannot be written.
    """
    try:
        stamped_file.make_folder(path.parent)
    except OSError as error:
        raise stamped_file.cannot_write(path, error) from error
    stamped_file.store(path, to_bytes(dataset))


def read(path: Path) -> Dataset:
    """Return a stored dataset, loaded; its checksum is verified first: a library might crash on a damaged file.

    Raises
    ------
    DatasetError
        If the file is missing, truncated, altered, or was not written by roughvol.
    """
    if not path.is_file():
        message = f"no dataset at {path}"
        raise DatasetError(message)
    content, _ = stamped_file.verified(path)
    try:
        stored = netCDF4.Dataset("memory.nc", memory=content)
        try:
            dataset = xr.load_dataset(NetCDF4DataStore(stored))
        finally:
            if stored.isopen():
                stored.close()
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        message = f"{path} is damaged or no netCDF file ({error})"
        raise DatasetError(message) from error
    _check_format(dataset.attrs, path)
    return dataset


def read_arrays(path: Path) -> tuple[Arrays, stamped_file.Labels]:
    """Return the variables of a file as plain arrays, and its labels: for many files, where `read` takes too long.

    Variables that the table does not hold are left out: a later version stored them beside the same answers.

    Raises
    ------
    DatasetError
        As for `read`.
    """
    content, labels = stamped_file.verified(path)
    _check_format(labels, path)
    arrays: Arrays = {}
    try:
        if "columns" in labels:
            found = columns.unpacked(content[len(content) - int(labels["columns"]) :])
            for name, (dims, values) in found.items():
                if name not in VARIABLES:
                    continue
                arrays[name] = (dims, np.asarray(values, dtype=DTYPES[VARIABLES[name].kind]))
            return arrays, labels
        with netCDF4.Dataset("memory.nc", memory=content) as stored:
            stored.set_auto_maskandscale(False)
            for name, variable in stored.variables.items():
                if name not in VARIABLES:
                    continue
                arrays[name] = (variable.dimensions, _decoded(name, variable[...]))
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        message = f"{path} is damaged or no dataset of roughvol ({error})"
        raise DatasetError(message) from error
    return arrays, labels


def _decoded(name: str, values: NDArray[Any]) -> NDArray[Any]:
    array: NDArray[Any] = np.asarray(values, dtype=DTYPES[VARIABLES[name].kind])
    if VARIABLES[name].kind == "count":
        array[array == -1.0] = np.nan
    return array


def _check_format(attributes: Mapping[str, str], path: Path) -> None:
    found = attributes.get("format")
    if found != FORMAT:
        message = f"{path} is no dataset of roughvol: its format is {found!r}, not {FORMAT!r}"
        raise DatasetError(message)


def provenance(
    study: str,
    *,
    fft: Mapping[str, str],
    case: Case | None = None,
    ids: Iterable[str] = (),
    region: Region | None = None,
    length_unit: str | None = None,
    bodies: Iterable[Body] = (),
    versions: Mapping[str, int] | None = None,
) -> dict[str, str]:
    """Return the global attributes: what was asked, by which code, on which machine, when, and what to cite.

    Parameters
    ----------
    study : str
        The resolved study as YAML text, every default written out.
    fft : mapping
        What the half space says of its transforms: library version, planner, threads.
    case : Case, optional
        The one case in the file.
    ids : iterable of str
        The cases in the file of a whole study.
    region : Region, optional
        Of which part its observables are; that of the case, or the whole, if not given.
    length_unit : str, optional
        Unit of all lengths in the file; that of the case if not given, arbitrary if that has none.
    bodies : iterable of Body, optional
        The files of heights; those of the case if not given. Their names are stored, and the sha256 of their content.
    versions : mapping, optional
        Of a whole study: the versions of roughvol that computed its cases, each with the number of its cases.
    """
    attributes = {
        "title": "Free volume between rough surfaces in elastic contact",
        "format": FORMAT,
        "roughvol_version": __version__,
        "study": study,
        "conventions": CONVENTIONS,
        "references": REFERENCE,
        "libraries": _libraries(),
        "fft": json.dumps(dict(fft)),
        "host": platform.node(),
        "platform": platform.platform(),
        "cpu_count": str(os.cpu_count()),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    region = region or (case.record.region if case is not None else None)
    attributes["region"] = region.label if region is not None else Region().label
    if unit := length_unit or (case.length_unit if case is not None else None):
        attributes["length_unit"] = unit
    if case is not None and case.surface_text:
        attributes["surface"] = case.surface_text
    if files := [
        {"file": body.file.name, "sha256": body.sha256} for body in bodies or (case.bodies if case is not None else ())
    ]:
        attributes["height_files"] = json.dumps(files)
    if versions is not None:
        attributes["case_versions"] = json.dumps(dict(sorted(versions.items())))
    if case is not None:
        attributes |= {"case_id": case.id, "case": case.key_text}
    if ids := list(ids):
        attributes["case_ids"] = ids_text(ids)
    return attributes


@functools.cache
def _libraries() -> str:
    """Return the versions of the libraries; looking them up takes as long as a small sweep."""
    libraries = {name: importlib.metadata.version(name) for name in ("numpy", "scipy", "pyfftw", "xarray", "netCDF4")}
    libraries |= {"python": platform.python_version(), "netcdf-c": netCDF4.__netcdf4libversion__}
    return json.dumps(libraries | {"hdf5": netCDF4.__hdf5libversion__})


def ids_text(ids: Iterable[str]) -> str:
    """Return the ids of the cases of a study as its file holds them."""
    return json.dumps(list(ids))


def answers(dataset: Dataset) -> Dataset:
    """Return a dataset without attributes and without the times it holds: nothing else of two equal runs differs."""
    return dataset.drop_vars(TIMES, errors="ignore").drop_attrs(deep=False)


def at_state(case: Dataset, dim: str, place: int) -> Dataset:
    """Return one case at a state it records along a dimension, with the numbers of that state instead of its step's.

    Parameters
    ----------
    case : Dataset
        Of one surface, without dimensions of the case.
    dim : str
        ``field_at``, ``density_at``, ``box_at`` or ``flux_at``.
    place : int
        Of a state that was reached.
    """
    state = case.isel({dim: place})
    state = state.sel(step=int(state[f"{dim}_step"]))
    own = {str(name): str(name).removeprefix(f"{dim}_") for name in state.data_vars if str(name).startswith(f"{dim}_")}
    return state.assign({name: state[stored] for stored, name in own.items() if name in state.data_vars})


def _is_dim(name: str) -> bool:
    return VARIABLES[name].dims == name


def _union(labels: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Labels of all cases: numbers sorted, texts in the order in which they come."""
    together = np.concatenate(labels)
    if together.dtype.kind in "iuf":
        return np.unique(together)
    return np.array(list(dict.fromkeys(together.tolist())), dtype=object)


def _described(dataset: Dataset) -> Dataset:
    unit = dataset.attrs.get("length_unit", "length")
    for name, variable in dataset.variables.items():
        row = VARIABLES[str(name)]
        variable.attrs = {"units": row.units.replace("length", unit), "long_name": row.long_name, "symbol": row.symbol}
    return dataset.set_coords([str(name) for name in dataset.variables if name == "L" or _is_dim(str(name))])


def _encoding(dataset: Dataset) -> dict[str, dict[str, Any]]:
    """Return how to store it: counts as integers with a fill value, labels without one, fields compressed."""
    encoding: dict[str, dict[str, Any]] = {}
    for name in map(str, dataset.variables):
        if name in VARIABLES and VARIABLES[name].kind == "count":
            encoding[name] = {"dtype": "int32", "_FillValue": -1}
        elif name in dataset.coords:
            encoding[name] = {"_FillValue": None}
        elif name in FIELDS:
            encoding[name] = {"zlib": True, "complevel": 4, "shuffle": True}
    return encoding


_ALONG = {  # one of the numbers stored of each
    "percolation": "percolates_x",
    "constriction": "critical_gap_x",
    "transmissivity": "transmissivity_x",
    "diffusivity": "diffusivity_x",
    "estimates": "estimate_medium_transmissivity",
    "region_widths": "contact_area_fraction_within",
    "region_transmissivity": "transmissivity_within_x",
}


def unreached(results: Dataset) -> dict[str, int]:
    """Return in how many cases nothing is stored of what is asked for along the steps, since no state was reached."""
    counts = {}
    for name, stored in _ALONG.items():
        if name in results.get("observable", ()):
            asked = results["observable_time"].sel(observable=name).notnull()  # of the cases that are done
            if stored in results:
                found = results[stored].notnull()
                asked = asked & ~found.any([dim for dim in found.dims if dim not in asked.dims])
            counts[name] = int(asked.sum())
    return {name: count for name, count in counts.items() if count}
