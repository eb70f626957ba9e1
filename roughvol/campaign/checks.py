"""Checks of a study before a run: its files, its size, and the limits of the model."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from roughvol.campaign import cost, doubts, path, resources, validity, workers
from roughvol.campaign.one_case import surface_of
from roughvol.contact.halfspace import LEAST_PERIOD
from roughvol.errors import DatasetError, Problem, StudyError
from roughvol.observables import regions
from roughvol.store import dimensional, run_folder
from roughvol.study import Case, MadeSurface, Study
from roughvol.surfaces import texture
from roughvol.surfaces.surface import Surface

LOOKED_AT = 10  # largest m of a surface made for its slope alone
READ_HERE = (".npy", ".npz", ".txt", ".csv", ".xyz", ".asc")  # their readers do not crash
READ_SECONDS, READ_RATE = 60.0, 1e6  # time allowed to read a file: seconds, and bytes per further second


def check_surfaces(study: Study, made: Collection[Path] = ()) -> Surface | None:
    """Read the height files of a study once, before anything is computed or written.

    Libraries in C read netCDF and the formats of instruments. A damaged file may crash or hang them. They read in a
    process of their own, for a limited time.

    Parameters
    ----------
    study : Study
        Study to check.
    made : collection of Path
        Files that this process has written itself, and reads itself.

    Returns
    -------
    Surface or None
        The surface from the height file; None for generated surfaces.

    Raises
    ------
    SurfaceError, DatasetError
        If the heights cannot be read, or are not a surface.
    StudyError
        If the study asks for units it does not define, or for regions of too few elements.
    """
    given = study.surface
    if isinstance(given, MadeSurface):
        cases = study.cases()
        with study.placing():
            dimensional.check(cases[0])
            for nodes, case in {case.nodes_per_side: case for case in cases}.items():
                regions.check(case, (nodes or 0, nodes or 0))
        return None
    files = [Path(body.file) for one in given.each for body in one.bodies]
    here = all(file in made or file.suffix.lower() in READ_HERE for file in files)
    surface = None if here else _read_apart(study, files)
    case, *others = study.cases()
    with study.placing():
        dimensional.check(case)
        surface = surface or surface_of(case)
        _check_shape(case, surface.shape)
        for other in others if here else ():
            _check_shape(other, surface_of(other).shape)
    return surface


def _check_shape(case: Case, shape: tuple[int, int]) -> None:
    """Refuse a height file with too few elements for a period, or for the regions of the study."""
    if case.periodic and min(shape) < LEAST_PERIOD:
        message = f"{case.label} has {shape[0]} x {shape[1]} heights; a period needs {LEAST_PERIOD} x {LEAST_PERIOD}"
        raise StudyError([Problem(message, "surface.periodic")])
    regions.check(case, shape)


def foreseen(study: Study, surface: Surface | None = None) -> list[validity.Finding]:
    """Return the limits of the model that a study will exceed, as far as known before a run.

    Parameters
    ----------
    study : Study
        The study.
    surface : Surface, optional
        The surface from its height file, as `check_surfaces` returns it. Default: read here.

    Returns
    -------
    list of Finding
        Of generated surfaces, the roughest of the first seed is judged, at m ≤ `LOOKED_AT`: its slope grows with m.
    """
    if study.axes:
        found = (finding for variant in study.variants for finding in foreseen(variant.study))
        return list({finding.sentence: finding for finding in found}.values())
    case, given = study.cases()[0], study.surface
    held = validity.setting(study)
    if case.sweep.steps == 0:
        return []
    if not held.scaled:
        return validity.before(held, case.sweep.legs[0].target, Sq=math.nan, Sdq=math.nan, L=case.L)
    size = 1.0
    if isinstance(given, MadeSurface):
        surface = surface_of(
            replace(case, D=max(given.dimensions), m=min(max(given.m, default=case.m or 0), LOOKED_AT))
        )
        size = (given.height or surface.Sq) / surface.Sq
    surface = surface or surface_of(case)
    case = path.starred(case, surface)
    Sdq = size * texture.Sdq(surface.with_neighbours, surface.spacing)
    return validity.peak(held, surface.peak) + validity.before(
        held, case.sweep.legs[0].target, Sq=size * surface.Sq, Sdq=Sdq, L=surface.side
    )


def doubtful(study: Study, surface: Surface | None = None) -> list[str]:
    """Return the numbers of a study that may be meant in another way, see `doubts`.

    Parameters
    ----------
    study : Study
        The study.
    surface : Surface, optional
        Surface of its first case, in the units of the study. Default: made or read here.

    Returns
    -------
    list of str
        Sentences.
    """
    if study.axes:
        found = (sentence for variant in study.variants for sentence in doubtful(variant.study, surface))
        return list(dict.fromkeys(found))
    case, given = study.cases()[0], study.surface
    several = isinstance(given, MadeSurface) or len(given.each) > 1
    if surface is None:
        surface = surface_of(case if case.m is None else replace(case, m=min(case.m, LOOKED_AT)))
        height = given.height if isinstance(given, MadeSurface) else None
        surface = surface if height is None else surface.scaled(height)
    return doubts.sentences(study, [surface.Sq], surface.side, case.length_unit, about="about " * several)


def _read_apart(study: Study, files: Sequence[Path]) -> Surface:
    """Return the surface of a study, read in a process of its own for a limited time."""
    results: list[tuple[Surface, BaseException | None]] = []
    names, began = " or ".join(map(str, files)), time.monotonic()
    allowed = READ_SECONDS + sum(file.stat().st_size for file in files) / READ_RATE

    def late() -> bool:
        if time.monotonic() - began > allowed:
            message = f"{names}: cannot be read: the library for this format is still reading after {allowed:.0f} s"
            raise DatasetError(message)
        return False

    workers.each(
        read_surface,
        [study],
        jobs=1,
        on_message=lambda message: None,
        on_end=lambda task, surface, error: results.append((surface, error)),
        stopping=late,
    )
    surface, error = results[0]
    if isinstance(error, workers.Lost):
        message = f"{names}: cannot be read: the library for this format crashes on it, it is damaged"
        raise DatasetError(message) from error
    if error is not None:
        raise error
    return surface


def read_surface(study: Study, tell: workers.Tell) -> Surface:
    """Return the surface of the first case; read all: the task of a process that may crash or never end."""
    first, *others = study.cases()
    for case in others:
        surface_of(case)
    return surface_of(first)


def check_missing_cases_fit(
    folder: Path,
    cases: Mapping[str, Case],
    shape: tuple[int, int] | None,
    *,
    fresh: Collection[str],
    wanted: Collection[str],
    here: bool,
) -> None:
    """Refuse a run whose missing cases exceed memory or disk, see `resources.check_resources`."""
    stored = run_folder.stored_ids(folder)
    left = [case for id, case in cases.items() if id in wanted and (id in fresh or id not in stored)]
    if not left:
        return
    nodes = [resources.nodes_of(case, shape) for case in left]
    disk = sum(resources.disk_of(case, n) for case, n in zip(left, nodes, strict=True))
    disk += sum(resources.disk_of(case, resources.nodes_of(case, shape)) for case in cases.values())  # study.nc
    resources.check_resources(left, nodes, disk, folder, here=here)


def slow(cases: Sequence[Case], shape: tuple[int, int] | None, jobs: int | None) -> list[str]:
    """Return a warning if the run will take very long."""
    warning = cost.warning_of(cases, [resources.nodes_of(case, shape) for case in cases], jobs or resources.cores())
    return [f"warning: {warning}"] if warning else []
