"""A study as a whole, and its cases."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import PrivateAttr, SerializationInfo, ValidationInfo, model_serializer, model_validator

from roughvol.errors import Problem, RoughvolDeprecation, StudyError, each_problem, warn
from roughvol.study import axes
from roughvol.study.axes import Axis, Variant
from roughvol.study.case import Case
from roughvol.study.file import StudyFile
from roughvol.study.former import renamed
from roughvol.study.plain_data import KeyPath, Places, given, key_path, key_text, put, write
from roughvol.study.python_data import plain, refused
from roughvol.study.rules import RULES
from roughvol.study.sections.agreement import SAME, resolve
from roughvol.study.sections.ensemble import levels_below
from roughvol.study.sections.fluid import Gas
from roughvol.study.sections.height_file import HeightFile
from roughvol.study.sections.solver import NamedKernel, Solver
from roughvol.study.sections.strict import refuse_at
from roughvol.study.sections.surface import GeneratedSurface, MadeSurface, SpectralSurface, first_finest
from roughvol.study.validation import read_as, validated


class Study(StudyFile):
    """A study: surfaces, material, end of the sweep, accuracy, and stored quantities."""

    _places: Places = PrivateAttr(default_factory=Places)
    _axes: tuple[Axis, ...] = PrivateAttr(default=())
    _combined: tuple[Study, ...] = PrivateAttr(default=())  # the study of each combination of the lists

    @model_validator(mode="wrap")
    @classmethod
    def _of_lists(cls, data: Any, handler: Any, info: ValidationInfo) -> Any:
        """Check the rules across sections; take lists as axes. The study is that of their first items."""

        def read_one(one: Any) -> Any:
            return validated(axes.without_none(one), handler, RULES, info.context)

        if not isinstance(data, dict) or not axes.lists(data):
            return read_one(data)
        found, made = axes.read(data, read_one)
        whole: Study = made[0].model_copy()
        if whole.ensemble is not None:
            for name, items in axes.lists(data).items():
                refuse_at(axes.AXES[name], items, "an ensemble takes one value")
        whole._axes, whole._combined = found, tuple(made)
        return whole

    @model_serializer(mode="wrap")
    def _plain(self, handler: Any, info: SerializationInfo) -> dict[str, Any]:
        """Write lists; leave out the seeds and the tolerance where an ensemble decides them."""
        data: dict[str, Any] = handler(self)
        axes.write_lists(data, self._axes, self._combined, info.context)
        data = {name: value for name, value in data.items() if value is not None or name == "ensemble"}
        if self.ensemble is not None:
            data["surface"].pop("seeds", None)
            if self.solving != self.solver:  # its tolerance follows from the accuracy, when this is read again as well
                data["solver"] = {name: data["solver"][name] for name in ("kernel", "method")}
        return data

    def placing(self) -> AbstractContextManager[None]:
        """Add file and line to the problems of a `StudyError` raised inside."""
        return each_problem(self._places.of)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The lists in keys that take one value; empty without any."""
        return self._axes

    @property
    def variants(self) -> tuple[Variant[Study], ...]:
        """The studies of all combinations of the lists, the last list fastest; without lists the study itself."""
        for study in self._combined:
            study._places = self._places
        return axes.variants_of(self._axes, self._combined or (self,))

    def cases(self) -> tuple[Case, ...]:
        """Return the product over D, m and seeds, seeds fastest; each height file is one case.

        Combinations of lists follow each other. A case that several share appears once. A height file that cannot be
        read, or lacks a size or unit that the study does not give, is a `StudyError`.
        """
        if self._axes:
            each = (case for variant in self.variants for case in variant.study.cases())
            return tuple({case.id: case for case in each}.values())
        surface, material = self.surface, self.material
        hard, E_star, leak = material.indentation_hardness, material.contact_modulus, self.record.leak_rate
        case = functools.partial(
            Case,
            E_star=E_star,
            modulus_unit=material.unit,
            hardness=None if hard is None else hard / E_star,
            plastic=material.yields,
            sweep=self.sweep,
            solver=self.solving,
            record=self.record,
            sides=surface.sides,
            drive=None if leak is None else leak.rate,
        )
        if isinstance(surface, MadeSurface):
            return self._cases_of_made(case, surface)
        return self._cases_of_files(case, surface)

    def names_of_cases(self) -> dict[str, str]:
        """Return each case in words by id, of lists with the words that all combinations of the case share."""
        labels, shared = dict[str, str](), dict[str, list[str]]()
        for variant in self.variants:
            own = variant.words.split(", ")
            for case in variant.study.cases():
                labels[case.id] = case.label
                shared[case.id] = [words for words in shared.get(case.id, own) if words in own]
        return {id: ", ".join(filter(None, (*shared[id], label))) for id, label in labels.items()}

    def _cases_of_made(self, case: Callable[..., Case], surface: MadeSurface) -> tuple[Case, ...]:
        """Return the cases of surfaces made from seeds, from the case without its surface."""
        unit = surface.length_unit
        made = case(
            L=float(surface.L),
            length_unit=unit,
            height=surface.height,
            kernel=self.kernel(unit),
            gas=self._gas(unit),
            midpoint_law=surface.midpoint_law if isinstance(surface, GeneratedSurface) else None,
            spectrum=surface.spectrum if isinstance(surface, SpectralSurface) else None,
        )
        levels, seeds = surface.m, surface.seeds
        if self.ensemble is not None:  # one of each resolution; the campaign decides how many more
            levels, seeds = levels_below(first_finest(surface)), (self.ensemble.first_seed,)
        product = itertools.product(surface.dimensions, levels, seeds)
        return tuple(made.of_seed(D, m, seed) for D, m, seed in product)

    def _cases_of_files(self, case: Callable[..., Case], surface: HeightFile) -> tuple[Case, ...]:
        """Return the cases of height files, from the case without its surface; all have the L of the first."""
        found: list[Case] = []
        for scan in surface.each:
            named = functools.partial(_named, Path(scan.file).name if len(surface.files) > 1 else "")
            with self.placing(), each_problem(named):
                measured = resolve(scan)
                unit = measured.length_unit
                if unit is None:
                    self._check_without_unit(scan)
                L = found[0].L if found else measured.L
                if found and (found[0].length_unit != unit or abs(L - measured.L) > SAME * L):
                    first = f"{found[0].label} has {L:.9g} {found[0].length_unit or 'of no unit'}"
                    other = f"{Path(scan.file).name} has {measured.L:.9g} {unit or 'of no unit'}"
                    allowed = "one length and one unit, as by surface.crop and surface.unit"
                    raise refused(f"the files differ in L: {first}, {other}; allowed: {allowed}", "surface.files")
                made = case(kernel=self.kernel(unit), gas=self._gas(unit), **{**vars(measured), "L": L})
                if found and surface.L is not None and (rows := made.shape[0]) != (others := found[0].shape[0]):
                    nodes = f"{made.label} has {rows} nodes along x and {found[0].label} {others}"
                    made = replace(made, notes=(*made.notes, f"{nodes}, on the L of the study: their spacings differ"))
                if same := next((other for other in found if other.id == made.id), None):
                    both = f"{same.label} and {made.label}"
                    raise refused(f"{both} hold the same bytes and are one case by name: rename one", "surface.files")
                found.append(made)
        return tuple(found)

    def _check_without_unit(self, scan: HeightFile) -> None:
        """Refuse what needs the unit of length, which neither the study nor its files give."""
        study = self.model_copy(update={"surface": scan.unitless()})
        none = f"; {Path(scan.file).name} has no unit of length, surface.unit gives it"
        if problems := [Problem(text + none, key_text(path)) for rule in RULES for path, text in rule.problems(study)]:
            raise StudyError(problems)

    def kernel(self, unit: str | None = None) -> NamedKernel:
        """Return the kernel of the material if it has a length, else of the solver; its lengths are in ``unit``."""
        return self.material.kernel(self.solver.kernel, unit) or NamedKernel(self.solver.kernel)

    def _gas(self, unit: str | None) -> Gas | None:
        """Return the gas whose flow is recorded, its mean free path in a unit of length."""
        return None if self.fluid is None or unit is None else self.fluid.gas_in(unit)

    @property
    def solving(self) -> Solver:
        """The solver in force: of an ensemble as accurate as its request needs, unless the study gives a tolerance."""
        given = {"accuracy", "rtol", "max_error"} & self.solver.model_fields_set
        if self.ensemble is None or given:
            return self.solver
        return self.solver.model_copy(update={"rtol": self.ensemble.tolerance})

    def sample(self, D: float, m: int, seed: int) -> Case:
        """Return the case of one surface of an ensemble."""
        return self.cases()[0].of_seed(D, m, seed)

    def changed(self, **keys: Any) -> Study:
        """Return this study with other keys, as ``**{"surface.m": 7}``, checked as a file; None is the default."""
        data, problems = given(self.model_dump(mode="json")), dict[KeyPath, str]()
        for key, value in keys.items():
            if not (path := key_path(key)):
                raise refused("is no key of a study; allowed: a path, as surface.m", key)
            try:
                put(data, path, plain(value, problems, path))
            except ValueError as error:
                raise refused(str(error), key) from error
        former = renamed(data, problems, [key_path(key) for key in keys])
        same_files = not any(set(key_path(key)) & {"file", "files", "against"} or key == "surface" for key in keys)
        context = {"folder": Path(), "stored": same_files}
        study = read_as(type(self), given(data), problems, self._places, context)
        study._places = self._places
        warn(map(str, former), RoughvolDeprecation)
        return study

    def to_yaml(self) -> str:
        """Return the study as YAML with every default; `loads` of it gives an equal study."""
        return write(self.model_dump(mode="json"))

    def stored(self) -> str:
        """Return the study as YAML for files of results, with height files by name and not by absolute path.

        ``loads(text, stored=True)`` reads it without the height files.
        """
        return write(self._stored())

    def of_each_case(self) -> str:
        """Return `stored` with a number of seeds in place of 0, 1, 2 …: thousands of case files hold this text."""
        data = self._stored()
        seeds = data["surface"].get("seeds")
        if seeds and seeds == list(range(len(seeds))):
            data["surface"]["seeds"] = len(seeds)
        return write(data)

    def _stored(self) -> dict[str, Any]:
        return self.model_dump(mode="json", context={"stored": True})


def _named(file: str, problem: Problem) -> Problem:
    """Return a problem with the name of its file, of several, in its message."""
    return problem if file in problem.message else replace(problem, message=f"{file}: {problem.message}")


def json_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a study file.

    Returns
    -------
    dict
        Schema with the descriptions of all keys, for completion and checks in editors.
    """
    schema = axes.listable(Study.model_json_schema())
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
