"""Attributes of stored files: the study, the code, the machine, conventions of the numbers, and the paper to cite."""

from __future__ import annotations

import datetime
import functools
import importlib.metadata
import json
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence

import netCDF4

from roughvol._version import __version__
from roughvol.store.stamped_file import FORMAT
from roughvol.study import Case, Region
from roughvol.tables import table

COMPUTING = ("numpy", "scipy", "pyfftw", "numba")
"""Libraries that decide on the last bit of a number."""
MOST_NAMED = 3  # files of a step of the treatment
_TABLE = table(__file__)


def provenance(
    study: str,
    *,
    fft: Mapping[str, str],
    cases: Sequence[Case],
    ids: Iterable[str] = (),
    versions: Mapping[str, int] | None = None,
) -> dict[str, str]:
    """Return the global attributes: resolved study, code, machine, transforms, date, and the paper to cite."""
    case, ids = cases[0], list(ids)
    attributes = {
        "title": "Free volume between rough surfaces in elastic contact",
        "format": FORMAT,
        "roughvol_version": __version__,
        "study": study,
        "conventions": _TABLE["conventions"].format(**_TABLE[case.sides]),
        "references": _TABLE["references"],
        "libraries": _libraries(),
        "fft": json.dumps(dict(fft)),
        "host": platform.node(),
        "platform": platform.platform(),
        "cpu_count": str(os.cpu_count()),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "sides": case.sides,
        "region": (case.record.region or Region()).label,
    }
    files = [{"file": body.file.name, "sha256": body.sha256} for one in cases for body in one.bodies]
    optional = {
        "periodic": "true" * case.periodic,  # what readers of other versions look for
        "length_unit": case.length_unit,
        "surface": "; ".join(_treated(cases)),
        "height_files": json.dumps(files) if files else "",
        "case_versions": "" if versions is None else json.dumps(dict(sorted(versions.items()))),
    }
    attributes |= {name: text for name, text in optional.items() if text}
    return attributes | ({"case_ids": ids_text(ids)} if ids else {"case_id": case.id, "case": case.key_text})


def _treated(cases: Sequence[Case]) -> Iterator[str]:
    """Yield the steps of the treatment of all cases; before a step of some are their files, or the number of many."""
    found = dict[str, list[str]]()
    for case in cases:
        for step in filter(None, case.surface_text.split("; ")):
            found.setdefault(step, []).append(case.label)
    for step, of in found.items():
        every = len(of) == len(cases) or any(name in step for name in of)
        yield step if every else f"{', '.join(of) if len(of) <= MOST_NAMED else f'{len(of)} files'}: {step}"


@functools.cache
def _libraries() -> str:
    """Return the versions of the libraries; looking them up takes as long as a small sweep."""
    libraries = {name: importlib.metadata.version(name) for name in (*COMPUTING, "xarray", "netCDF4")}
    libraries |= {"python": platform.python_version(), "netcdf-c": netCDF4.__netcdf4libversion__}
    return json.dumps(libraries | {"hdf5": netCDF4.__hdf5libversion__})


def ids_text(ids: Iterable[str]) -> str:
    """Return the ids of the cases of a study as stored in its file."""
    return json.dumps(list(ids))
