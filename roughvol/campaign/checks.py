"""Checks of the surfaces of a study before a run: its height files, units and regions."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from roughvol.campaign import path, workers
from roughvol.campaign.case_surface import kernel_on, surface_of
from roughvol.contact.halfspace import LEAST_PERIOD
from roughvol.errors import ContactError, DatasetError, Problem, StudyError, SurfaceError
from roughvol.observables import regions
from roughvol.observables.levels import starred
from roughvol.observables.own import register
from roughvol.study import Case, MadeSurface, Region, Study
from roughvol.study.plain_data import key_text
from roughvol.study.sections.seal import check_alike
from roughvol.surfaces.surface import Surface, intervals

READ_HERE = (".npy", ".npz", ".txt", ".csv", ".xyz", ".asc")  # their readers do not crash
READ_SECONDS, READ_RATE = 60.0, 1e6  # time allowed to read a file: seconds, and bytes per further second


def check_surfaces(study: Study, made: Collection[Path] = ()) -> Surface | None:
    """Read the height files of a study once, before anything is computed or written.

    Libraries in C read netCDF and the formats of instruments. A damaged file may crash or hang them. They read in a
    process apart, for a limited time. A `StudyError` refuses units, regions and functions that cannot be used.

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
    """
    given = study.surface
    with study.placing():
        register(study.record, study.ensemble)
        if study.ensemble is not None and study.ensemble.accuracy.own:  # functions that fail do so before the run
            from roughvol.campaign.one_case import arrays_of_case  # it imports xarray

            arrays_of_case(study.cases()[0])
    if isinstance(given, MadeSurface):
        with study.placing():
            cases = study.cases()
            alike = {(case.shape, case.kernel, case.D): case for case in cases}
            for case in alike.values():
                _check_shape(case)
            for case in cases:
                kinds = {level.kind for _, level in case.sweep.states()} if case.sides != "free" else set()
                if "indentation" in kinds or ("separation" in kinds and case in alike.values()):
                    _check_depth(case, surface_of(case))  # full contact is at a Δ/σ of each surface, and at d = 0
        return None
    files = [Path(body.file) for one in given.each for body in one.bodies]
    here = all(file in made or file.suffix.lower() in READ_HERE for file in files)
    case, *others = study.cases()
    try:
        with study.placing():
            surface = None if here else _read_apart(study, files)
            surface = surface or surface_of(case)
            _check_shape(case)
            _check_depth(case, surface)
            for other in others:
                if here:
                    _check_depth(other, surface_of(other))
                _check_shape(other)
            if study.seal is not None:
                check_alike([[intervals(nodes, one.periodic) for nodes in one.shape] for one in (case, *others)])
                study.seal.check(patch_sides(case), case.length_unit)
    except (DatasetError, SurfaceError) as error:
        if made:  # an argument of Python, which the caller names
            raise
        key = "surface.file" if len(given.each) == 1 else "surface.files"
        body = given.against
        if body is not None and body.file != given.file and str(error).startswith(f"{body.file}: "):
            key = "surface.against.file"
        key = next((f"surface.{step}" for step in ("outliers", "low_pass") if f": {step}" in str(error)), key)
        with study.placing():
            raise StudyError([Problem(str(error), key)]) from error
    return surface


def patch_sides(case: Case) -> tuple[float, float]:
    """Return the lengths along x and y of the patch that a case observes: its surface, or a region of it."""
    rows, columns = (intervals(nodes, case.periodic) for nodes in case.shape)
    return (case.record.region or Region()).sides(case.L, case.L * columns / rows)


def _check_depth(case: Case, surface: Surface) -> None:
    """Refuse a sweep beyond full contact."""
    swept = [(place, starred(level, case, surface)) for place, level in case.sweep.states()]
    for _, level in case.record.levels():  # of a flat surface, a unit is refused
        starred(level, case, surface)
    for place, level in swept:
        try:
            path.level_on(level, surface, plastic=case.plastic)
        except ContactError as error:
            raise StudyError([Problem(str(error), key_text(place))]) from error


def _check_shape(case: Case) -> None:
    """Refuse a grid with too few elements for a period, for a layer, or for the regions of the study."""
    rows, columns = case.shape
    if case.periodic and min(rows, columns) < LEAST_PERIOD:
        message = f"{case.label} has {rows} x {columns} heights; a period needs {LEAST_PERIOD} x {LEAST_PERIOD}"
        raise StudyError([Problem(message, "surface.sides")])
    spacing = case.L / intervals(rows, case.periodic)
    try:
        kernel_on(spacing, case)
    except ContactError as error:
        words = f"{error}; the spacing is {spacing:.6g} {case.length_unit or ''}".rstrip()
        raise StudyError([Problem(words, "material.thickness")]) from error
    regions.check(case)


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


def read_surface(study: Study, tell: Callable[[None], None], stopping: Callable[[], bool]) -> Surface:
    """Return the surface of the first case, and read all: the task of a process that may crash or never end."""
    first, *others = study.cases()
    for case in others:
        surface_of(case)
    return surface_of(first)
