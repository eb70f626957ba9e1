"""A study as understood by `roughvol check`: numbers of its surface, treatment, doubts."""

from __future__ import annotations

from roughvol.campaign.one_case import surface_of
from roughvol.study import Case, MadeSurface, Study
from roughvol.study.sections import treatment
from roughvol.surfaces import length_units, measured, texture
from roughvol.surfaces.body import Body
from roughvol.surfaces.files import reading
from roughvol.surfaces.files.description import Description
from roughvol.surfaces.surface import Surface

LARGEST_M = 10  # of a generated surface shown by `check`: 2^20 nodes


def shown(study: Study, measured: Surface | None) -> Surface | None:
    """Return the surface of the first case in the units of the study.

    Parameters
    ----------
    study : Study
        The study.
    measured : Surface or None
        Its surface, if read from files.

    Returns
    -------
    Surface or None
        None if it is generated and finer than `LARGEST_M`.
    """
    if measured is not None or not isinstance(study.surface, MadeSurface):
        return measured
    case = study.cases()[0]
    if case.m is None or case.m > LARGEST_M:
        return None
    surface = surface_of(case)
    height = study.surface.height
    return surface if height is None else surface.scaled(height)


def text(surface: Surface, case: Case, cases: int = 1) -> str:
    """Return a surface as comments of YAML: size, heights, readers, treatment.

    Parameters
    ----------
    surface : Surface
        The surface as pressed.
    case : Case
        Its case, the first of the study.
    cases : int
        Number of cases of the study.

    Returns
    -------
    str
        Lines that begin with ``#``.
    """
    unit = f" {case.length_unit}" if case.length_unit else ""
    (rows, columns), spacing = surface.shape, surface.spacing
    period, width = "one period of " if surface.periodic else "", spacing * surface.intervals[1]
    lines = [
        f"surface {period}{rows} x {columns} nodes, L = {surface.side:.6g}{unit} by {width:.6g}{unit}, "
        f"spacing {spacing:.6g}{unit}"
    ]
    if case.file is None:
        lines.append(case.label + f", the first of {cases} cases" * (cases > 1))
    roughness = f"Sq = {surface.Sq:.6g}{unit}, Sdq = {texture.Sdq(surface.with_neighbours, spacing):.4g}"
    if surface.Sq > 0.0:
        roughness += f", z_max/Sq = {surface.peak:.3g}, z_min/Sq = {surface.pit:.3g} (from the mean plane)"
    lines.append(roughness)
    descriptions = [
        reading.describe(body.file, body.variable, columns=body.columns, ignore_header=body.header == "ignore")
        for body in case.bodies
    ]
    if case.file is not None:
        lines += map(_reading, case.bodies, descriptions, [case.length_unit] * len(descriptions))
        share = surface.filled / (rows * columns)
        lines.append(f"missing {surface.filled} heights ({share:.2%})" + ", filled" * (surface.filled > 0))
    if surface.peak_before is not None:
        count = "1 outlier" if surface.outliers == 1 else f"{surface.outliers} outliers"
        lines.append(f"{count} removed; z_max/Sq was {surface.peak_before:.3g} and is {surface.peak:.3g}")
    steps = treatment.steps(case.treatment, case.length_unit)
    lines += [f"step {number}: {step}" for number, step in enumerate(steps, 1)]
    for body in case.bodies[1:]:
        turned = f", its axis {body.mirror} reversed" * (body.mirror != "none")
        lines.append(f"heights of {body.file.name} added{turned}")
    first, *others = lines
    return "\n".join([f"# {first}", *(f"#         {line}" for line in others)])


def _reading(body: Body, description: Description, wanted: str | None) -> str:
    """Return file, reader and unit of a body."""
    unit = f"in {wanted}, the unit of the study" if wanted else "without a unit"
    if body.numbers_in:
        unit = f"of {body.numbers_in} a count" if length_units.is_count(body.numbers_in) else f"in {body.numbers_in}"
        unit += f", converted to {wanted}" * (wanted is not None and body.numbers_in != wanted)
    return f"{body.file.name} read by {description.reader}, heights {unit}"


def notes(case: Case, surface: Surface) -> tuple[str, ...]:
    """Return the doubts of a case, and of heights that are absurd for its length."""
    return (*case.notes, *measured.notes(surface, case.length_unit))
