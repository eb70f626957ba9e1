"""Checks of a study before anything is computed: its files, its size, and where it leaves the model."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from roughvol.campaign import cost, resources, validity, workers
from roughvol.campaign.one_case import surface_of
from roughvol.campaign.resources import cores
from roughvol.errors import DatasetError
from roughvol.observables import regions
from roughvol.store import dimensional, ledger
from roughvol.study import Case, GeneratedSurface, Study
from roughvol.surfaces import texture
from roughvol.surfaces.surface import Surface


def check_surfaces(study: Study) -> Surface | None:
    """Read the height files of a study once, so that a bad one is known before anything is computed or written.

    Libraries in C read netCDF and the formats of instruments. A damaged file may crash them or keep them for ever, so
    they read in a process of their own first, for a limited time.

    Raises
    ------
    SurfaceError, DatasetError
        If its heights are not a surface, or cannot be read.
    StudyError
        If the study wants lengths in units that nothing tells, or regions that hold too few elements.
    """
    given = study.surface
    if isinstance(given, GeneratedSurface):
        cases = study.cases()
        with study.placing():
            dimensional.check(cases[0])
            for m, case in {case.m: case for case in cases if case.m is not None}.items():
                regions.check(case, (2**m + 1, 2**m + 1))
        return None
    files = [Path(body.file) for body in given.bodies]
    here = all(file.suffix.lower() in READ_HERE for file in files)
    surface = None if here else _read_apart(study, files)
    case = study.cases()[0]
    with study.placing():
        dimensional.check(case)
        surface = surface or surface_of(case)
        regions.check(case, surface.shape)
    return surface


def foreseen(study: Study, surface: Surface | None = None) -> list[validity.Finding]:
    """Return where a study will leave the model, as far as that is known before anything is computed.

    Parameters
    ----------
    study : Study
        The study.
    surface : Surface, optional
        The surface from its height file, as `check_surfaces` returns it; read if not given. Of generated surfaces the
        roughest is made, that of the first seed, and at most at m = `LOOKED_AT`: its slope only grows with m.
    """
    case, given = study.cases()[0], study.surface
    held = validity.setting(study)
    if case.sweep.steps == 0:
        return []
    if not held.scaled:
        return validity.before(held, case.sweep.target, Sq=math.nan, Sdq=math.nan, L=case.L)
    size = 1.0
    if isinstance(given, GeneratedSurface):
        surface = surface_of(replace(case, D=max(given.D), m=min(max(given.m, default=case.m or 0), LOOKED_AT)))
        size = (given.height or surface.Sq) / surface.Sq
    surface = surface or surface_of(case)
    Sdq = size * texture.Sdq(surface.heights, surface.spacing)
    return validity.peak(held, surface.peak) + validity.before(
        held, case.sweep.target, Sq=size * surface.Sq, Sdq=Sdq, L=surface.side
    )


LOOKED_AT = 10  # m up to which a surface is made for its slope alone; 1025² takes a tenth of a second
READ_HERE = (".npy", ".npz", ".txt", ".csv", ".xyz", ".asc")  # by code that does not crash
READ_SECONDS = 60.0  # a file may take so long to be read, and
READ_RATE = 1e6  # a second more for so many bytes


def _read_apart(study: Study, files: Sequence[Path]) -> Surface:
    """Return the surface of a study, read in a process of its own within a limited time."""
    ended: list[tuple[Surface, BaseException | None]] = []
    names, began = " or ".join(map(str, files)), time.monotonic()
    allowed = READ_SECONDS + sum(file.stat().st_size for file in files) / READ_RATE

    def late() -> bool:
        if time.monotonic() - began > allowed:
            message = f"{names}: cannot be read: the library for this format is still reading after {allowed:.0f} s"
            raise DatasetError(message)
        return False

    workers.each(
        _read,
        [study],
        jobs=1,
        on_message=lambda message: None,
        on_end=lambda task, surface, error: ended.append((surface, error)),
        stopping=late,
    )
    surface, error = ended[0]
    if isinstance(error, workers.Lost):
        message = f"{names}: cannot be read: the library for this format crashes on it, it is damaged"
        raise DatasetError(message) from error
    if error is not None:
        raise error
    return surface


def _read(study: Study, tell: workers.Tell) -> Surface:
    return surface_of(study.cases()[0])


def check_fits(
    place: Path,
    cases: Mapping[str, Case],
    shape: tuple[int, int] | None,
    *,
    fresh: Collection[str],
    wanted: Collection[str],
    here: bool,
) -> None:
    """Refuse to begin what this machine cannot hold, by the cases that have no file yet."""
    there = ledger.files(place / "cases", ".nc")
    left = [case for id, case in cases.items() if id in wanted and (id in fresh or id not in there)]
    if not left:
        return
    nodes = [resources.nodes_of(case, shape) for case in left]
    disk = sum(resources.disk_of(case, n) for case, n in zip(left, nodes, strict=True))
    disk += sum(resources.disk_of(case, resources.nodes_of(case, shape)) for case in cases.values())  # study.nc
    resources.check_fits(left, nodes, disk, place, here=here)


def slow(cases: Sequence[Case], shape: tuple[int, int] | None, jobs: int | None) -> list[str]:
    """Return a warning if it will take very long."""
    told = cost.warning_of(cases, [resources.nodes_of(case, shape) for case in cases], jobs or cores())
    return [f"warning: {told}"] if told else []
