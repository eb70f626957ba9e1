"""How a study was understood: the numbers of its surface, what was done to it, and what to look at beforehand."""

from __future__ import annotations

from roughvol.campaign.one_case import surface_of
from roughvol.study import Case, GeneratedSurface, Study, treatment
from roughvol.surfaces import measured, texture
from roughvol.surfaces.body import Body
from roughvol.surfaces.files import reading
from roughvol.surfaces.files.description import Description
from roughvol.surfaces.surface import Surface

LARGEST_M = 10  # of a generated surface that is made only to be shown: a second, 2^20 nodes


def shown(study: Study, measured: Surface | None) -> Surface | None:
    """Return the surface of the first case in the units of the study, None if it is generated and large.

    Parameters
    ----------
    study : Study
        The study.
    measured : Surface or None
        Its surface, if that was read from files.
    """
    if measured is not None or not isinstance(study.surface, GeneratedSurface):
        return measured
    case = study.cases()[0]
    if case.m is None or case.m > LARGEST_M:
        return None
    surface = surface_of(case)
    height = study.surface.height
    return surface if height is None else surface.scaled(height)


def text(surface: Surface, case: Case, cases: int = 1) -> str:
    """Return comments on a surface for `roughvol check`: size, heights, who read it, what was done.

    Parameters
    ----------
    surface : Surface
        As it is pressed.
    case : Case
        Its case, the first of the study.
    cases : int
        How many the study has.
    """
    unit = f" {case.length_unit}" if case.length_unit else ""
    (rows, columns), spacing = surface.shape, surface.spacing
    said = [
        f"surface {rows} x {columns} nodes, L = {surface.side:.6g}{unit} by {spacing * (columns - 1):.6g}{unit}, "
        f"spacing {spacing:.6g}{unit}"
    ]
    if case.file is None:
        said.append(f"{case.label}" + f", the first of {cases} cases" * (cases > 1))
    roughness = f"Sq = {surface.Sq:.6g}{unit}, Sdq = {texture.Sdq(surface.heights, spacing):.4g}"
    if surface.Sq > 0.0:
        roughness += f", z_max/Sq = {surface.peak:.3g}, z_min/Sq = {surface.pit:.3g} (from the mean plane)"
    said.append(roughness)
    told = [
        reading.describe(body.file, body.variable, columns=body.columns, ignore_header=body.header == "ignore")
        for body in case.bodies
    ]
    if case.file is not None:
        said += map(_reading, case.bodies, told, [case.length_unit] * len(told))
        share = surface.filled / (rows * columns)
        said.append(f"missing {surface.filled} heights ({share:.2%})" + ", filled" * (surface.filled > 0))
    if surface.peak_before is not None:
        count = "1 outlier" if surface.outliers == 1 else f"{surface.outliers} outliers"
        said.append(f"{count} taken out; z_max/Sq was {surface.peak_before:.3g} and is {surface.peak:.3g}")
    steps = treatment.steps(case.treatment, case.length_unit)
    said += [f"step {number}: {step}" for number, step in enumerate(steps, 1)]
    for body in case.bodies[1:]:
        turned = f", its axis {body.mirror} reversed" * (body.mirror != "none")
        said.append(f"heights of {body.file.name} added{turned}")
    first, *others = said
    return "\n".join([f"# {first}", *(f"#         {line}" for line in others)])


def _reading(body: Body, told: Description, wanted: str | None) -> str:
    """Return which file it is, who read it, and in which unit its numbers are."""
    unit = f"in {wanted}, as the study has it" if wanted else "without a unit"
    if body.numbers_in:
        unit = f"in {body.numbers_in}" + f", converted to {wanted}" * (wanted is not None and body.numbers_in != wanted)
    return f"{body.file.name} read by {told.reader}, heights {unit}"


def notes(case: Case, surface: Surface) -> tuple[str, ...]:
    """Return what the user should look at: the notes of the case, and heights that are absurd for its length."""
    return (*case.notes, *measured.notes(surface, case.length_unit))
