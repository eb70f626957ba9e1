"""Labelled datasets of the variables in the table: build, write, read and combine them.

Conventions of the stored numbers
---------------------------------
Starred quantities are dimensionless: lengths over Sq, pressure times L/(E* Sq). The unit ``length`` of the table is
replaced by that of the study, if it has one. Positions x and y are over L.

A surface has the dimensions ``(D, m, seed)``, or ``(case,)`` if its heights come from a file. The table writes ``...``
for either. A case has these dimensions with length 1. A study is the union of its cases by label. Missing values
(states not reached, nodes absent from a coarse lattice) are

* NaN in real numbers and in counts (integers with a fill value in the file),
* -1 in the step numbers ``*_step``,
* False in ``converged``, which is true only where a state was solved *and* met its residual.

Case files of up to `SMALL` bytes are netCDF-3, quick to read. Larger ones are netCDF-4 with compressed fields.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import netCDF4
import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from xarray import Dataset
from xarray.backends import NetCDF4DataStore, StoreBackendEntrypoint

from roughvol.errors import DatasetError
from roughvol.observables.variables import ALONG, AXES, DTYPES, FIELDS, MISSING, VARIABLES
from roughvol.store import small_file, stamped_file
from roughvol.store.stamped_file import FORMAT
from roughvol.study import Case
from roughvol.surfaces.files.netcdf import ONE_AT_A_TIME

__all__ = ["Arrays", "Dataset", "build", "combine", "read", "write"]

Arrays = dict[str, tuple[tuple[str, ...], NDArray[Any]]]  # dimensions and values of variables by name

CHANGED = "a function of record.own that changed needs another attribute version, or --fresh, from Python fresh=True"
COORDS = ("L", "leg")  # coordinates beside those of the dimensions
SMALL = 1 << 20  # bytes of values up to which the file of a case is netCDF-3


def build(case: Case, values: Mapping[str, ArrayLike], attributes: Mapping[str, str]) -> Dataset:
    """Return the labelled dataset of one case, from values by stored name without the dimensions of the case."""
    arrays: dict[str, Any] = dict(small_file.arrays_of_case(case, values))
    arrays |= {name: (name, _index(labels)) for name, (along, labels) in arrays.items() if along == (name,)}
    return _described(Dataset(arrays, attrs=dict(attributes)))  # at once: each one added alone takes a millisecond


def combine(cases: Sequence[Dataset | Arrays], attributes: Mapping[str, str]) -> Dataset:
    """Return one dataset of many cases, aligned by label, with the missing values of the module's docstring."""
    if not cases:
        raise DatasetError("no case to combine")
    parts = [arrays_of(case) if isinstance(case, Dataset) else case for case in cases]
    sides = sorted({float(part["L"][1]) for part in parts})
    if len(sides) > 1:
        raise DatasetError(f"cases of one study share L, got {', '.join(f'{side:g}' for side in sides)}")
    held = set().union(*parts)
    names = [name for name in VARIABLES if name in held]
    dims = {dim: _union([part[dim][1] for part in parts if dim in part]) for dim in names if _is_dim(dim)}
    positions = {dim: {label: index for index, label in enumerate(dims[dim].tolist())} for dim in dims}
    wholes: Arrays = {}
    for part in parts:
        index = {dim: [positions[dim][label] for label in part[dim][1].tolist()] for dim in part if dim in dims}
        slots: dict[tuple[str, ...], Any] = {}
        for name, (along, values) in part.items():
            if name == "L" or along == (name,):
                continue
            if not dims.keys() >= set(along) or wholes.get(name, (along,))[0] != along:
                raise DatasetError(f"{name} has other dimensions in some cases of the run: {CHANGED}")
            if name not in wholes:
                kind, shape = VARIABLES[name].kind, tuple(len(dims[dim]) for dim in along)
                wholes[name] = along, np.full(shape, MISSING[kind], dtype=DTYPES[kind])
            if along not in slots:
                slots[along] = np.ix_(*(index[dim] for dim in along))
            wholes[name][1][slots[along]] = values
    coords = {"L": sides[0]} | {dim: (dim, _index(labels)) for dim, labels in dims.items()}
    return _described(Dataset({name: wholes[name] for name in names if name in wholes}, coords, attributes))


def arrays_of(dataset: Dataset) -> Arrays:
    """Return the variables of a dataset by name: dimensions and values."""
    return {
        str(name): (tuple(map(str, variable.dims)), np.asarray(variable.values))
        for name, variable in dataset.variables.items()
    }


def case_bytes(case: Case, values: Mapping[str, ArrayLike], attributes: Mapping[str, str]) -> bytes:
    """Return `to_bytes` of `build`, without a dataset if the case is small."""
    arrays = small_file.arrays_of_case(case, values)
    if not small_file.fits(arrays, SMALL):
        return to_bytes(build(case, values, attributes))
    return stamped_file.stamped(small_file.content(arrays, COORDS, attributes), stamped_file.labels_of(attributes))


def to_bytes(dataset: Dataset) -> bytes:
    """Return a dataset as a stamped netCDF file, made in memory."""
    arrays, labels = arrays_of(dataset), stamped_file.labels_of(dataset.attrs)
    if "case_id" in dataset.attrs and small_file.fits(arrays, SMALL):
        return stamped_file.stamped(small_file.content(arrays, COORDS, dataset.attrs), labels)
    held: list[tuple[Any, Any]] = []  # values until all variables are defined: HDF5 is slow where both alternate
    writer: Any = SimpleNamespace(add=lambda source, target, region=None: held.append((source, target)))
    with ONE_AT_A_TIME:
        store = netCDF4.Dataset("memory.nc", "w", format="NETCDF4", memory=4096)
        store.set_fill_off()  # every value is written
        try:
            dataset.dump_to_store(NetCDF4DataStore(store), encoding=_encoding(dataset), writer=writer)
            for source, target in held:
                target[...] = source
        finally:
            content = bytes(store.close())
    return stamped_file.stamped(content, labels)


def write(dataset: Dataset, path: str | Path) -> None:
    """Write a dataset to a stamped file that is either whole or absent.

    Raises
    ------
    FolderError
        If the folder cannot be written.

    Examples
    --------
    >>> import roughvol
    >>> from roughvol.store import dataset
    >>> ds = roughvol.run({"name": "one", "surface": {"D": 2.3, "m": 3, "seeds": 1}, "sweep": {"steps": 2}}, jobs=1)
    >>> dataset.write(ds, "copy.nc")
    >>> dataset.read("copy.nc").equals(ds)
    True
    """
    stamped_file.write(Path(path), to_bytes(dataset))


def read(path: str | Path, *, saved: bool = False) -> Dataset:
    """Return a stored dataset, loaded. Its checksum is verified first: a damaged file may crash a library.

    With ``saved``, a file without a checksum is read as well: one that a user wrote with ``to_netcdf``.

    Raises
    ------
    DatasetError
        If the file is missing, truncated, altered, or was not written by roughvol.
    """
    path = Path(path)
    content, labels = stamped_file.read(path) if saved else stamped_file.verified(path)
    try:
        dataset = _opened(content)
    except (OSError, ValueError, RuntimeError, LookupError, TypeError) as error:
        raise DatasetError(f"{path} is damaged or no netCDF file ({error})") from error
    _check_format(dataset.attrs, path)
    if labels is not None:
        _check_stamp(dataset.attrs, labels, path)
    return _with_axis(dataset)


def _with_axis(dataset: Dataset) -> Dataset:
    """Return a dataset of version 0.13 or older, with variables ``…_x`` and ``…_y``, as one with the dimension axis."""
    if "critical_position_x" in dataset:
        dataset = dataset.rename(axis="coordinate")  # of a position
    joined: dict[str, xr.Variable] = {}
    for name in (name for name, row in VARIABLES.items() if " axis" in row.dims and f"{name}_x" in dataset):
        row, pair = VARIABLES[name], [dataset.variables[f"{name}_{axis}"] for axis in AXES]
        behind = row.dims.partition(" axis")[2].split()
        before = [dim for dim in pair[0].dims if dim not in behind]
        joined[name] = xr.Variable.concat(pair, "axis").transpose(*before, "axis", *behind)
        joined[name].attrs |= {"symbol": row.symbol, "long_name": row.long_name}
    if not joined:
        return dataset
    apart = [f"{name}_{axis}" for name in joined for axis in AXES]
    return dataset.assign(joined).assign_coords(axis=list(AXES)).drop_vars(apart)  # at once: each takes a millisecond


def _opened(content: bytes) -> Dataset:
    """Return a loaded dataset. In memory, netcdf-c reads past the end of some netCDF-3 files; scipy does not."""
    if not content.startswith(b"CDF"):
        with ONE_AT_A_TIME:
            stored = netCDF4.Dataset("memory.nc", memory=content)
            try:
                # without an engine, all installed packages are asked for theirs
                options: dict[str, Any] = {"engine": StoreBackendEntrypoint, "create_default_indexes": False}
                return _indexed(xr.load_dataset(NetCDF4DataStore(stored), **options))
            finally:
                if stored.isopen():
                    stored.close()
    dataset = xr.load_dataset(io.BytesIO(content), engine="scipy")
    short = {str(name): v.astype("int64") for name, v in dataset.variables.items() if v.dtype == "int32"}
    return dataset.assign(short)  # netCDF-3 has no longer integers


def _indexed(dataset: Dataset) -> Dataset:
    """Return a dataset with the indexes of its dimensions."""
    labels = {str(dim): dataset.variables[dim] for dim in dataset.dims if dim in dataset.variables}
    return dataset.assign_coords({n: (n, _index(row.values), row.attrs, row.encoding) for n, row in labels.items()})


def _index(labels: NDArray[Any]) -> pd.Index:
    """Return the index of a dimension, of pandas: to make it of an array, xarray imports pint."""
    return pd.Index(labels, dtype=object if labels.dtype.kind == "O" else None)


def read_arrays(path: Path) -> tuple[Arrays, dict[str, str], stamped_file.Labels]:
    """Return the variables of a file as plain arrays, its attributes and its labels; quicker than `read`.

    Variables outside the table are left out: a later version may have stored them beside the same answers.
    """
    content, labels = stamped_file.verified(path)
    _check_format(labels, path)
    try:
        if content.startswith(b"CDF"):
            from scipy.io import netcdf_file  # slow to import, and not needed for study.nc

            file = netcdf_file(io.BytesIO(content), mmap=False)
            texts = {name: value.decode() for name, value in file._attributes.items() if isinstance(value, bytes)}
            arrays = _decoded(file.variables)
        else:
            with ONE_AT_A_TIME, netCDF4.Dataset("memory.nc", memory=content) as stored:
                stored.set_auto_maskandscale(False)
                texts = {name: str(stored.getncattr(name)) for name in stored.ncattrs()}
                arrays = _decoded(stored.variables)
    except (OSError, ValueError, RuntimeError, LookupError, TypeError) as error:
        raise DatasetError(f"{path} is damaged or no dataset of roughvol ({error})") from error
    _check_stamp(texts, labels, path)
    return arrays, texts, labels


def _decoded(variables: Mapping[str, Any]) -> Arrays:
    """Return stored variables as those of a dataset."""
    arrays: Arrays = {}
    for name, variable in variables.items():
        if name not in VARIABLES:
            continue
        dims, values = variable.dimensions, np.asarray(variable[...])
        if values.dtype.kind == "S":  # netCDF-3 holds texts as characters along one more dimension
            dims, texts = dims[:-1], np.strings.decode(values.view(f"S{values.shape[-1]}")[..., 0], "utf-8")
            values = texts.astype(object)
        array: NDArray[Any] = np.asarray(values, dtype=DTYPES[VARIABLES[name].kind])
        if VARIABLES[name].kind == "count":
            array[array == -1.0] = np.nan
        arrays[name] = (dims, array)
    return arrays


def _check_format(attributes: Mapping[str, str], path: Path) -> None:
    if (theirs := attributes.get("format")) != FORMAT:
        raise DatasetError(f"{path} is no dataset of roughvol: its format is {theirs!r}, not {FORMAT!r}")


def _check_stamp(attributes: Mapping[str, str], labels: stamped_file.Labels, path: Path) -> None:
    """Refuse content with the stamp of another dataset. Labels of other versions, more or fewer, do not count."""
    own = stamped_file.labels_of(attributes)
    for name in ("case", "key", "study", "format_of_answers"):
        if name in labels and name in own and labels[name] != own[name]:
            difference = f"{name} is {labels[name]!r}, in its content {own[name]!r}"
            raise DatasetError(f"{path} has the stamp of another dataset: {difference}")


def recorded_state(case: Dataset, dim: str, index: int, *names: str) -> Dataset:
    """Return one case at a recorded state, as of ``field_at``: its numbers, or some, in place of those of the step."""
    if names:
        own_names = [f"{dim}_{name}" for name in names if f"{dim}_{name}" in case]
        case = case[[f"{dim}_step", *names, *own_names]]
    state = case.isel({dim: index})
    state = state.sel(step=int(state[f"{dim}_step"]))
    own = {str(name): str(name).removeprefix(f"{dim}_") for name in state.data_vars if str(name).startswith(f"{dim}_")}
    return state.assign({name: state[stored] for stored, name in own.items() if name in state.data_vars})


def _is_dim(name: str) -> bool:
    return VARIABLES[name].dims == name


def _union(labels: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return the labels of all cases: numbers sorted, texts in the order of the cases."""
    together = np.concatenate(labels)
    if together.dtype.kind in "iuf":
        return np.unique(together)
    return np.array(list(dict.fromkeys(together.tolist())), dtype=object)


def _described(dataset: Dataset) -> Dataset:
    """Give every variable the units, name and symbol of the table."""
    unit = dataset.attrs.get("length_unit", "length")
    for name, variable in dataset.variables.items():
        variable.attrs = small_file.words_of(VARIABLES[str(name)], unit)
    return dataset.set_coords([str(name) for name in dataset.variables if name in COORDS or _is_dim(str(name))])


def _encoding(dataset: Dataset) -> dict[str, dict[str, Any]]:
    """Return the encoding: counts as integers with a fill value, labels without one, fields compressed."""
    encoding: dict[str, dict[str, Any]] = {}
    for name in map(str, dataset.variables):
        if name in VARIABLES and VARIABLES[name].kind == "count":
            encoding[name] = {"dtype": "int32", "_FillValue": -1}
        elif name in dataset.coords:
            encoding[name] = {"_FillValue": None}
        elif name in FIELDS:
            encoding[name] = {"zlib": True, "complevel": 4, "shuffle": True}
    return encoding


def unreached(results: Dataset) -> dict[str, int]:
    """Return the number of cases per observable that reached none of its states along the steps."""
    counts = {}
    for name, stored in ALONG.items():
        if name in results.get("observable", ()):
            asked = results["observable_time"].sel(observable=name).notnull()  # of the cases that are done
            if stored in results:
                reached = results[stored].notnull()
                asked = asked & ~reached.any([dim for dim in reached.dims if dim not in asked.dims])
            counts[name] = int(asked.sum())
    return {name: count for name, count in counts.items() if count}
