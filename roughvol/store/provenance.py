"""Attributes of stored files: the study, the code, the machine, conventions of the numbers, and the paper to cite."""

from __future__ import annotations

import datetime
import functools
import importlib.metadata
import json
import os
import platform
from collections.abc import Iterable, Mapping

import netCDF4

from roughvol._version import __version__
from roughvol.store.stamped_file import FORMAT
from roughvol.study import Case, Region
from roughvol.surfaces.body import Body

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
PERIODIC_CONVENTIONS = (
    CONVENTIONS.replace("non-periodic elastic half space", "periodic elastic half space, one period without its edge")
    .replace("spacing = L/(rows-1)", "spacing = L/rows")
    .replace("the rigid far-field one", "the mean gap less the plastic volume, displacements having no mean")
)


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
    periodic: bool | None = None,
) -> dict[str, str]:
    """Return the global attributes: study, code, machine, date, and the paper to cite.

    Parameters
    ----------
    study : str
        The resolved study as YAML text, every default written out.
    fft : mapping
        Library version, planner and threads of the transforms.
    case : Case, optional
        The one case in the file.
    ids : iterable of str
        The cases in the file of a whole study.
    region : Region, optional
        Part of the surface for the observables. Default: that of the case, or the whole.
    length_unit : str, optional
        Unit of all lengths in the file. Default: that of the case, or none.
    bodies : iterable of Body, optional
        The files of heights, stored by name and sha256. Default: those of the case.
    versions : mapping, optional
        Number of cases of a study by version of roughvol.
    periodic : bool, optional
        Whether surfaces are one period of a plane. Default: as that of the case.
    """
    if periodic is None:
        periodic = case is not None and case.periodic
    attributes = {
        "title": "Free volume between rough surfaces in elastic contact",
        "format": FORMAT,
        "roughvol_version": __version__,
        "study": study,
        "conventions": PERIODIC_CONVENTIONS if periodic else CONVENTIONS,
        "references": REFERENCE,
        "libraries": _libraries(),
        "fft": json.dumps(dict(fft)),
        "host": platform.node(),
        "platform": platform.platform(),
        "cpu_count": str(os.cpu_count()),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    if periodic:
        attributes["periodic"] = "true"
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
    """Return the ids of the cases of a study as stored in its file."""
    return json.dumps(list(ids))
