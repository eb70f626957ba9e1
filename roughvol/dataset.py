"""Labelled, self-describing datasets: one table of every stored variable; build, write, read and combine them.

Conventions of the stored numbers
---------------------------------
Starred quantities are dimensionless (lengths over Sq, pressure times L/(E* Sq)); a unit called ``length`` is that in
which the study gives L. Positions x and y are over L, so that a coarse lattice lies on the nodes of a fine one.

A surface has the dimensions ``(D, m, seed)``, or ``(case,)`` when its heights come from a file; ``...`` in the table
stands for either. One case is stored with these dimensions of length 1. A study is the union of its cases by label;
what a case does not have (a state that was not reached, a node that a coarse lattice lacks) is

* NaN in real numbers and in counts (which the file holds as integers with a fill value),
* -1 in the step numbers ``*_step``,
* False in ``converged``, which is true only where a state was solved *and* met its residual.
"""

from __future__ import annotations

import contextlib
import datetime
import importlib.metadata
import json
import os
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from xarray import Dataset

from roughvol._version import __version__
from roughvol.errors import DatasetError
from roughvol.study import Case

__all__ = ["VARIABLES", "Dataset", "Variable", "build", "combine", "provenance", "read", "write"]

FORMAT = "roughvol 1"  # of the files: names, dimensions and units as in the table below
REFERENCE = (
    "M. Paggi, Q.-C. He, Evolution of the free volume between rough surfaces in contact, "
    "Wear 336-337 (2015) 86-95, https://doi.org/10.1016/j.wear.2015.04.021"
)
CONVENTIONS = (
    "heights positive up; pressure positive in compression; non-periodic elastic half space, no friction; "
    "every node is a square element of side spacing = L/(rows-1); contact = elements with pressure > 0; "
    "starred: lengths over Sq, pressure times L/(E_star Sq), E_star = E/(1-nu^2); "
    "separation = (z_max - mean(z) - indentation)/Sq, the rigid far-field one; x and y over L; "
    "unit 'length' is that of L in the study"
)


@dataclass(frozen=True)
class Variable:
    """One row of the table: dimensions (``...`` stands for those of the case), units, what it is, its symbol, its kind.

    ``kind`` is "real", "count" (missing: NaN), "index" (missing: -1), "flag" (missing: False) or "text".
    """

    dims: str
    units: str
    long_name: str
    symbol: str
    kind: str = "real"


VARIABLES: dict[str, Variable] = {
    # coordinates
    "D": Variable("D", "1", "fractal dimension of the surface", "D"),
    "m": Variable("m", "1", "levels of midpoint displacement; 2^m + 1 nodes per side", "m", "index"),
    "seed": Variable("seed", "1", "seed of the random stream of heights", "seed", "index"),
    "case": Variable("case", "1", "height file", "case", "text"),
    "L": Variable("", "length", "length of the first axis", "L"),
    "step": Variable("step", "1", "loading step", "k", "index"),
    "x": Variable("x", "1", "position along the first axis over L", "x/L"),
    "y": Variable("y", "1", "position along the second axis over L", "y/L"),
    "field_at": Variable("field_at", "1", "state at which fields are kept", "state", "text"),
    "density_at": Variable("density_at", "1", "state of the density of element volumes", "state", "text"),
    "box_at": Variable("box_at", "1", "state of the box counting", "state", "text"),
    "bin": Variable("bin", "1", "bin of the density", "k", "index"),
    "edge": Variable("edge", "1", "edge of the bins of the density", "k", "index"),
    "threshold": Variable("threshold", "1", "threshold over the largest element volume", "v_th/v_max"),
    "r": Variable("r", "1", "side of the boxes in elements", "r/δ", "index"),
    "size": Variable("size", "1", "smallest size in elements of the class that ends below twice it", "n", "index"),
    "axis": Variable("axis", "1", "axis of the surface", "axis", "text"),
    "flux_at": Variable("flux_at", "1", "state at which fluxes are kept", "state", "text"),
    "r_mid": Variable("r_mid", "1", "geometric mean of two box sides in elements", "r/δ"),
    # per surface
    "Sq": Variable("...", "length", "root mean square height about the mean plane", "Sq"),
    "Sdq": Variable("...", "1", "root mean square slope", "Sdq"),
    "z_max": Variable("...", "length", "height of the highest point", "z_max"),
    "hurst_measured": Variable("...", "1", "Hurst exponent from the structure function", "H"),
    "wall_time": Variable("...", "s", "wall-clock time spent on the case", "t"),
    "heights": Variable("... x y", "length", "heights of the undeformed surface", "z"),
    # per step
    "indentation": Variable("... step", "1", "far-field closing displacement from first touch over Sq", "Δ/σ"),
    "separation": Variable("... step", "1", "rigid far-field separation of the mean planes over Sq", "d/σ"),
    "contact_area_fraction": Variable("... step", "1", "fraction of elements in contact", "A*"),
    "mean_pressure": Variable("... step", "1", "mean pressure times L/(E* Sq)", "p*"),
    "free_volume": Variable("... step", "1", "mean gap over Sq", "V*"),
    "iterations": Variable("... step", "1", "iterations of the solver", "iterations", "count"),
    "convolutions": Variable("... step", "1", "convolutions in double precision", "convolutions", "count"),
    "convolutions_fp32": Variable("... step", "1", "convolutions in single precision", "convolutions fp32", "count"),
    "residual": Variable("... step", "1", "largest violation of the contact conditions in the gap over Sq", "η/σ"),
    "converged": Variable("... step", "1", "the state was solved and met its residual", "converged", "flag"),
    # of the void, at the steps a study selects; open: gap > 0; void 4-connected, contact 8-connected
    "percolates_x": Variable("... step", "1", "1 if void leads from side to side along x, 0 if not", "Π_x", "count"),
    "percolates_y": Variable("... step", "1", "1 if void leads from side to side along y, 0 if not", "Π_y", "count"),
    "connected_volume_fraction": Variable("... step", "1", "free volume connected to a side over all", "V_con/V"),
    "percolating_volume_fraction": Variable(
        "... step", "1", "free volume that percolates along x or y, over all", "V_per/V"
    ),
    "trapped_volume_fraction": Variable("... step", "1", "free volume connected to no side over all", "V_tra/V"),
    "contact_clusters": Variable("... step", "1", "clusters of contact", "n_c", "count"),
    "trapped_pockets": Variable("... step", "1", "pockets of void connected to no side", "n_t", "count"),
    "contact_clusters_by_size": Variable("... step size", "1", "clusters of contact in the class", "n_c(n)", "count"),
    "trapped_pockets_by_size": Variable("... step size", "1", "pockets of void in the class", "n_t(n)", "count"),
    "critical_gap_x": Variable("... step", "1", "largest gap over Sq still open from side to side along x", "h_c,x/σ"),
    "critical_gap_y": Variable("... step", "1", "largest gap over Sq still open from side to side along y", "h_c,y/σ"),
    "critical_position_x": Variable("... step axis", "1", "position of the critical gap along x over L", "x_c,x/L"),
    "critical_position_y": Variable("... step axis", "1", "position of the critical gap along y over L", "x_c,y/L"),
    "transmissivity_x": Variable("... step", "1", "flow along x with g^3, over that of plates at the mean gap", "T_x*"),
    "transmissivity_y": Variable("... step", "1", "flow along y with g^3, over that of plates at the mean gap", "T_y*"),
    "transmissivity_conservation_error": Variable("... step", "1", "inflow against outflow over the flow", "ε_T"),
    "diffusivity_x": Variable("... step", "1", "flow along x with g, over that of plates at the mean gap", "D_x*"),
    "diffusivity_y": Variable("... step", "1", "flow along y with g, over that of plates at the mean gap", "D_y*"),
    "diffusivity_conservation_error": Variable("... step", "1", "inflow against outflow over the flow", "ε_D"),
    "estimate_medium_transmissivity": Variable(
        "... step", "1", "effective-medium estimate of the transmissivity", "T_em*"
    ),
    "estimate_medium_diffusivity": Variable("... step", "1", "effective-medium estimate of the diffusivity", "D_em*"),
    "estimate_junction_transmissivity_x": Variable("... step", "1", "critical-junction estimate along x", "T_cj,x*"),
    "estimate_junction_transmissivity_y": Variable("... step", "1", "critical-junction estimate along y", "T_cj,y*"),
    "estimate_junction_diffusivity_x": Variable("... step", "1", "critical-junction estimate along x", "D_cj,x*"),
    "estimate_junction_diffusivity_y": Variable("... step", "1", "critical-junction estimate along y", "D_cj,y*"),
    "transport_time": Variable("... step", "s", "wall-clock time spent on the quantities of the void", "t"),
    # at the states a study selects
    "flux_at_step": Variable("... flux_at", "1", "step of the state, -1 where it was not reached", "k", "index"),
    "flux_x": Variable("... flux_at x y", "1", "flux with g^3 for a flow along x, over that of plates", "|q_x|"),
    "flux_y": Variable("... flux_at x y", "1", "flux with g^3 for a flow along y, over that of plates", "|q_y|"),
    "field_at_step": Variable("... field_at", "1", "step of the state, -1 where it was not reached", "k", "index"),
    "gap": Variable("... field_at x y", "1", "gap over Sq, exactly 0 in contact", "g/σ"),
    "pressure": Variable("... field_at x y", "1", "contact pressure times L/(E* Sq)", "p L/(E* σ)"),
    "density_at_step": Variable("... density_at", "1", "step of the state, -1 where it was not reached", "k", "index"),
    "volume_density": Variable("... density_at bin", "length^-3", "probability density of element volumes", "f(v)"),
    "volume_density_edges": Variable("... density_at edge", "length^3", "edges of the bins of element volumes", "v"),
    "box_at_step": Variable("... box_at", "1", "step of the state, -1 where it was not reached", "k", "index"),
    "volume_max": Variable("... box_at", "length^3", "largest element volume", "v_max"),
    "box_count": Variable("... box_at threshold r", "1", "boxes that meet the domain v ≤ v_th", "N(r)", "count"),
    "local_dimension": Variable("... box_at threshold r_mid", "1", "local box dimension -d log N / d log r", "D_box"),
}
FIELDS = (
    "heights",
    "gap",
    "pressure",
    "flux_x",
    "flux_y",
)  # the large ones, compressed; smooth doubles still shrink by a tenth or more
_DTYPES = {"real": np.float64, "count": np.float64, "index": np.int64, "flag": np.bool_, "text": object}
_MISSING: dict[str, Any] = {"real": np.nan, "count": np.nan, "index": -1, "flag": False, "text": ""}


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
    dataset = Dataset(attrs=dict(attributes))
    for name, value in (labels | dict(values)).items():
        if name not in VARIABLES:
            message = f"{name!r} is not a stored variable; known are {', '.join(VARIABLES)}"
            raise DatasetError(message)
        array: NDArray[Any] = np.asarray(value, dtype=_DTYPES[VARIABLES[name].kind])
        dims = VARIABLES[name].dims.split()
        if dims[:1] == ["..."]:
            dims = [*leading, *dims[1:]]
            array = array[(np.newaxis,) * len(leading)]
        if array.ndim != len(dims):
            message = f"{name} has dimensions ({', '.join(dims)}), got an array of shape {array.shape}"
            raise DatasetError(message)
        dataset[name] = (dims, array)
    return _described(dataset)


def combine(cases: Sequence[Dataset], attributes: Mapping[str, str]) -> Dataset:
    """Return one dataset of many cases, aligned by label; what a case lacks is missing as the module's docstring says.

    Raises
    ------
    DatasetError
        If there is no case, or the cases differ in L (they would not be one study).
    """
    if not cases:
        message = "no case to combine"
        raise DatasetError(message)
    sides = sorted({float(case["L"]) for case in cases})
    if len(sides) > 1:
        message = f"cases of one study share L, got {', '.join(f'{side:g}' for side in sides)}"
        raise DatasetError(message)
    names = [name for name in VARIABLES if any(name in case.variables for case in cases)]
    dims = {dim: _union([case[dim].values for case in cases if dim in case.coords]) for dim in names if _is_dim(dim)}
    coords = {"L": sides[0]} | {dim: (dim, labels) for dim, labels in dims.items()}
    study = Dataset(coords=coords, attrs=dict(attributes))
    for name in names:
        if name in study.coords:
            continue
        kind = VARIABLES[name].kind
        holders = [case[name] for case in cases if name in case.variables]
        # All holders agree in their dimensions: the table gives them.
        shape = tuple(len(dims[str(dim)]) for dim in holders[0].dims)
        whole: NDArray[Any] = np.full(shape, _MISSING[kind], dtype=_DTYPES[kind])
        for part in holders:
            whole[np.ix_(*(_places(dims[str(dim)], part[dim].values) for dim in part.dims))] = part.values
        study[name] = (holders[0].dims, whole)
    return _described(study)


def write(dataset: Dataset, path: Path) -> None:
    """Write a dataset so that the file is either whole or not there: aside, to the disk, then renamed.

    Raises
    ------
    DatasetError
        If the folder cannot be written.
    """
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            dataset.to_netcdf(aside, format="NETCDF4", engine="netcdf4", encoding=_encoding(dataset))
            with aside.open("rb") as stream:
                os.fsync(stream.fileno())
            aside.replace(path)
        finally:
            aside.unlink(missing_ok=True)
    except OSError as error:
        message = f"cannot write {path}: {error}"
        raise DatasetError(message) from error


def read(path: Path) -> Dataset:
    """Return a stored dataset, loaded and its file closed.

    Raises
    ------
    DatasetError
        If the file is missing, truncated, no netCDF, or not of roughvol.
    """
    if not path.is_file():
        message = f"no dataset at {path}"
        raise DatasetError(message)
    try:
        dataset = xr.load_dataset(path, engine="netcdf4")
    except (OSError, ValueError, RuntimeError, KeyError) as error:
        message = f"{path} is damaged or no netCDF file ({error})"
        raise DatasetError(message) from error
    found = dataset.attrs.get("format")
    if found != FORMAT:
        message = f"{path} is no dataset of this version of roughvol: its format is {found!r}, not {FORMAT!r}"
        raise DatasetError(message)
    return dataset


def remove_leftovers(folder: Path) -> None:
    """Remove what processes that were killed while writing have left; files still being written are left alone."""
    for aside in folder.glob(".*.part"):
        with contextlib.suppress(ValueError, PermissionError):
            try:
                os.kill(int(aside.name.split(".")[-2]), 0)  # signal 0 asks whether the process lives
            except ProcessLookupError:
                aside.unlink(missing_ok=True)


def stored_key(path: Path) -> dict[str, Any]:
    """Return the key of the case in a file, everything in it having been read once.

    Raises
    ------
    DatasetError
        If the file cannot be read whole, or holds no case.
    """
    try:
        return dict(json.loads(read(path).attrs["case"]))
    except (KeyError, ValueError) as error:
        message = f"{path} holds no case of a study"
        raise DatasetError(message) from error


def provenance(
    study: str, *, fft: Mapping[str, str], case: Case | None = None, ids: Iterable[str] = ()
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
    """
    libraries = {name: importlib.metadata.version(name) for name in ("numpy", "scipy", "pyfftw", "xarray", "netCDF4")}
    libraries |= {"python": platform.python_version(), "netcdf-c": netCDF4.__netcdf4libversion__}
    libraries |= {"hdf5": netCDF4.__hdf5libversion__}
    attributes = {
        "title": "Free volume between rough surfaces in elastic contact",
        "format": FORMAT,
        "roughvol_version": __version__,
        "study": study,
        "conventions": CONVENTIONS,
        "references": REFERENCE,
        "libraries": json.dumps(libraries),
        "fft": json.dumps(dict(fft)),
        "host": platform.node(),
        "platform": platform.platform(),
        "cpu_count": str(os.cpu_count()),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    if region := case.record.region if case is not None else None:
        attributes["region"] = region.label
    if case is not None:
        attributes |= {"case_id": case.id, "case": json.dumps(case.key, sort_keys=True)}
    if ids := list(ids):
        attributes["case_ids"] = ids_text(ids)
    return attributes


def ids_text(ids: Iterable[str]) -> str:
    """Return the ids of the cases of a study as its file holds them."""
    return json.dumps(list(ids))


def _is_dim(name: str) -> bool:
    return VARIABLES[name].dims == name


def _union(labels: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Labels of all cases: numbers sorted, texts in the order in which they come."""
    together = np.concatenate(labels)
    if together.dtype.kind in "iuf":
        return np.unique(together)
    return np.array(list(dict.fromkeys(together.tolist())), dtype=object)


def _places(whole: NDArray[Any], part: NDArray[Any]) -> NDArray[np.intp]:
    place = {label: index for index, label in enumerate(whole.tolist())}
    return np.array([place[label] for label in part.tolist()], dtype=np.intp)


def _described(dataset: Dataset) -> Dataset:
    for name, variable in dataset.variables.items():
        row = VARIABLES[str(name)]
        variable.attrs = {"units": row.units, "long_name": row.long_name, "symbol": row.symbol}
    return dataset.set_coords([str(name) for name in dataset.variables if name == "L" or _is_dim(str(name))])


def _encoding(dataset: Dataset) -> dict[str, dict[str, Any]]:
    """Return how to store it: counts as integers with a fill value, labels without one, fields compressed."""
    encoding: dict[str, dict[str, Any]] = {}
    for name in map(str, dataset.variables):
        if VARIABLES[name].kind == "count":
            encoding[name] = {"dtype": "int32", "_FillValue": -1}
        elif name in dataset.coords:
            encoding[name] = {"_FillValue": None}
        elif name in FIELDS:
            encoding[name] = {"zlib": True, "complevel": 4, "shuffle": True}
    return encoding
