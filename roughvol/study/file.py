"""The keys of a study file, section by section."""

from __future__ import annotations

from typing import Annotated

from pydantic import Discriminator, Field, Tag, model_validator

from roughvol.study.sections.ensemble import Ensemble, with_default_steps
from roughvol.study.sections.fluid import Fluid
from roughvol.study.sections.height_file import HeightFile
from roughvol.study.sections.material import ContactModulus, YoungPoisson, tag_material
from roughvol.study.sections.record import Record
from roughvol.study.sections.seal import Seal
from roughvol.study.sections.solver import Solver
from roughvol.study.sections.strict import Strict, default, optional
from roughvol.study.sections.surface import GeneratedSurface, SpectralSurface, tag_surface
from roughvol.study.sections.sweep import Legs, Sweep, tag_sweep
from roughvol.study.values.types import Word


class StudyFile(Strict):
    """The sections of a study file; `study.Study` has the rules across them, lists and cases."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$", max_length=100)] = default(
        "study",
        "name of the run and its folder: letters A-Z and a-z, digits, _, - and dots, at most 100, a letter, digit or _ "
        "first; default: that of the study file",
    )
    surface: Annotated[
        Annotated[GeneratedSurface, Tag("<generated>")]
        | Annotated[SpectralSurface, Tag("<spectrum>")]
        | Annotated[HeightFile, Tag("<file>")],
        Discriminator(tag_surface),
    ] = Field(
        description="{D, m, L, seeds, midpoint_law} for generated surfaces, {H, n, rolloff, cut, L, seeds} for those "
        "with a spectrum, or {file, L, variable}"
    )
    material: Annotated[
        Annotated[ContactModulus, Tag("<modulus>")] | Annotated[YoungPoisson, Tag("<young>")],
        Discriminator(tag_material),
    ] = default(ContactModulus(), "{E_star} or {E, nu}, optionally hardness, thickness, against")
    sweep: Annotated[Annotated[Sweep, Tag("<sweep>")] | Annotated[Legs, Tag("<path>")], Discriminator(tag_sweep)] = (
        default(Sweep(), "{steps, to}: number of steps and last state; or a list of these, legs up and down")
    )
    solver: Annotated[Solver, Word("paper", (("method", "paper"),))] = default(
        Solver(), "{accuracy, rtol or max_error, kernel, method}; 'paper' is short for {method: paper}"
    )
    record: Record = default(Record(), f"{{{', '.join(Record.model_fields)}}}")
    ensemble: Ensemble | None = optional("{accuracy, at, budget, first_seed}: accuracy of the mean over all surfaces")

    fluid: Fluid | None = optional("{gas, inlet, outlet, temperature, law}: the gas of record.transport.gas_flow")

    seal: Seal | None = optional("{length, width, flow}: the seal that the surfaces are patches of")

    comment: str | None = optional("any text for readers; it changes no answer")

    _steps_of_an_ensemble = model_validator(mode="before")(with_default_steps)
