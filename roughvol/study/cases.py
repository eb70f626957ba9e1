"""A study, its cases, and the rules that join its sections."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import itertools
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, PrivateAttr, Tag, model_serializer, model_validator

from roughvol.errors import Problem, StudyError
from roughvol.study import ensemble as ensembles
from roughvol.study.agreement import resolve
from roughvol.study.ensemble import Ensemble
from roughvol.study.height_file import BARE_FORMATS, HEIGHT_FORMATS, HeightFile
from roughvol.study.material import ContactModulus, YoungPoisson, tag_material
from roughvol.study.record import SELECTORS, Record
from roughvol.study.sections import (
    PAPER_MAX_M,
    GeneratedSurface,
    Solver,
    Strict,
    Word,
    names,
    refuse,
    tag_surface,
    whole,
)
from roughvol.study.sweep import Legs, Sweep, Target, tag_sweep
from roughvol.study.targets import end_of, lacking_units, list_of, need_length, sections_of, steps_of
from roughvol.study.treatment import steps
from roughvol.study.units import convert, has_unit, length_unit
from roughvol.study.yaml_text import KeyPath, key_text, number_text, write
from roughvol.surfaces.body import UNTREATED, Body, Treatment

ANSWER_FORMAT = 3  # part of every case id: raise it when equal settings no longer give equal stored numbers
MAX_CASES = 100_000
SEVERAL_ARRAYS = (".npz", ".nc", ".tif", ".tiff", ".dat")


@dataclass(frozen=True)
class Case:
    """One surface pressed once: the picklable input of `campaign.run_case`.

    A generated surface has ``D``, ``m``, ``seed`` and ``midpoint_law``, a measured one ``bodies`` and ``treatment``.
    """

    L: float
    E_star: float
    sweep: Sweep | Legs
    solver: Solver
    record: Record
    D: float | None = None
    m: int | None = None
    seed: int | None = None
    midpoint_law: Literal["std", "variance"] | None = None
    bodies: tuple[Body, ...] = ()  # whose heights come from files: none, one, or two facing each other
    treatment: Treatment = UNTREATED
    length_unit: str | None = None  # of L, the heights and all stored lengths; None for an arbitrary one
    modulus_unit: str | None = None  # of E*, where the sweep has states with units
    hardness: float | None = None  # over E*
    plastic: bool = False  # pressures end at the hardness
    height: float | None = None  # Sq of the heights, where there is a hardness to compare with
    notes: tuple[str, ...] = ()  # on size and units of the files, for the user

    @property
    def key(self) -> dict[str, Any]:
        """Everything that changes the stored answer, as plain data.

        Names and E* are absent: no starred number depends on them. So is ``record.dimensional``: its values are made
        when the cases are collected.
        """
        surface: dict[str, Any]
        if self.bodies:
            # Heights with a unit of their own are converted to that of the study.
            unit = self.length_unit if any(body.numbers_in for body in self.bodies) else None
            surface = {"bodies": [body.key for body in self.bodies], "treatment": self.treatment.key, "unit": unit}
        else:
            surface = {"D": self.D, "m": self.m, "seed": self.seed, "midpoint_law": self.midpoint_law}
        record = self.record.model_dump(mode="json", exclude={"dimensional"})
        if not self.record.residual_heights:  # cases without them keep their id
            del record["residual_heights"]
        key: dict[str, Any] = {
            "format": ANSWER_FORMAT,
            "surface": {"L": self.L, **surface},
            "record": record,
        }
        if self.sweep.steps == 0:  # nothing is solved: target, solver and material change nothing
            return key | {"sweep": {"steps": 0}}
        solver, hardness = self.solver, self.hardness
        if self.sweep.has_units:  # cases without them keep their id
            modulus = convert(self.E_star, self.modulus_unit, "Pa") if self.modulus_unit else self.E_star
            key["units"] = {"E_star": float(f"{modulus:.12g}"), "length": self.length_unit}
        return key | {
            "sweep": self.sweep.model_dump(mode="json"),
            "solver": {
                "rtol": solver.tolerance,
                "pressure_error": solver.pressure_error,
                "kernel": solver.kernel,
                "method": solver.method,
            },
            # Rounded: the same in any unit.
            "material": {
                "hardness": None if hardness is None else float(f"{hardness:.12g}"),
                "Sq": self.height,
                **({"plastic": True} if self.plastic else {}),  # cases without it keep their id
            },
        }

    @property
    def file(self) -> Path | None:
        """The file of the first body, None for a generated surface."""
        return self.bodies[0].file if self.bodies else None

    @functools.cached_property
    def key_text(self) -> str:
        """The key as JSON, as stored in the file of the case."""
        return json.dumps(self.key, sort_keys=True, allow_nan=False)

    @functools.cached_property
    def id(self) -> str:
        """A readable prefix and 8 hexadecimal digits of the sha256 of the key: ``D2.30_m8_s003-1f9c2a7b``."""
        return f"{self._prefix}-{hashlib.sha256(self.key_text.encode()).hexdigest()[:8]}"

    @property
    def _prefix(self) -> str:
        if self.file is not None:
            return re.sub(r"[^A-Za-z0-9_.-]+", "_", self.file.stem).lstrip(".-")[:60] or "surface"
        return f"D{self._D_text}_m{self.m}_s{self.seed:03d}"

    @property
    def _D_text(self) -> str:
        text = f"{self.D:.2f}"
        return text if float(text) == self.D else repr(self.D)

    @property
    def label(self) -> str:
        """The case in words: ``D = 2.30, m = 8, seed 3``, or the names of the files."""
        if not self.bodies:
            return f"D = {self._D_text}, m = {self.m}, seed {self.seed}"
        return " against ".join(body.file.name for body in self.bodies)

    @property
    def surface_text(self) -> str:
        """The treatment of heights from files in words, empty for untreated ones."""
        sentences = ["; ".join(steps(self.treatment, self.length_unit))]
        for body in self.bodies[1:]:
            turned = f", its axis {body.mirror} reversed" if body.mirror != "none" else ""
            sentences.append(f"heights of {body.file.name} added{turned}")
        units = {body.file.name: body.numbers_in for body in self.bodies if body.numbers_in}
        sentences += [f"sizes and units in {body.file.name} ignored" for body in self.bodies if body.header]
        sentences += [f"numbers of {name} are in {unit}" for name, unit in units.items()]
        return "; ".join(filter(None, sentences))


class Places:
    """Lines of the keys in the text of a study. All are equal: they are no part of its identity."""

    def __init__(self, file: str = "", lines: dict[str, int] | None = None) -> None:
        self.file, self.lines = file, lines or {}

    def __eq__(self, other: object) -> bool:
        """Return True for any two."""
        return isinstance(other, Places)

    __hash__ = None  # type: ignore[assignment]

    def of(self, problem: Problem) -> Problem:
        """Return a problem with file and line. A missing key gets the line of its mapping."""
        if problem.file or not self.file:
            return problem
        key = problem.key
        while key and key not in self.lines:
            key = key.rpartition(".")[0]
        return replace(problem, line=self.lines.get(key), file=self.file)


class Study(Strict):
    """A study: surfaces, material, end of the sweep, accuracy, and stored quantities."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$", max_length=100)] = Field(
        default="study",
        description="letters, digits, _, - and dots, at most 100, a letter, digit or _ first; "
        "default: that of the study file",
    )
    surface: Annotated[
        Annotated[GeneratedSurface, Tag("<generated>")] | Annotated[HeightFile, Tag("<file>")],
        Discriminator(tag_surface),
    ] = Field(description="{D, m, L, seeds, midpoint_law} for generated surfaces, or {file, L, variable}")
    material: Annotated[
        Annotated[ContactModulus, Tag("<modulus>")] | Annotated[YoungPoisson, Tag("<young>")],
        Discriminator(tag_material),
    ] = Field(default=ContactModulus(), description="{E_star} or {E, nu}, optionally hardness")
    sweep: Annotated[Annotated[Sweep, Tag("<sweep>")] | Annotated[Legs, Tag("<path>")], Discriminator(tag_sweep)] = (
        Field(
            default=Sweep(),
            description="{steps, to}: number of steps and last state; or a list of these, legs up and down",
        )
    )
    solver: Annotated[Solver, Word("paper", (("method", "paper"),))] = Field(
        default=Solver(),
        description="{accuracy, rtol or max_error, kernel, method}; 'paper' is short for {method: paper}",
    )
    record: Record = Field(
        default=Record(),
        description=f"{{{', '.join(Record.model_fields)}}}",
    )

    ensemble: Ensemble | None = Field(
        default=None, description="{accuracy, at, budget, first_seed}: how accurate the mean over all surfaces is to be"
    )

    comment: str | None = Field(default=None, description="any text for readers; it changes no answer")

    _places: Places = PrivateAttr(default_factory=Places)

    @model_validator(mode="after")
    def _possible(self) -> Study:
        data = self.model_dump(mode="json")
        if self.ensemble is not None and "seeds" in self.surface.model_fields_set:
            data["surface"]["seeds"] = []
        problems = [f"{key_text(path)}: {message}" for path, message in conflicts(data)]
        if problems:
            refuse("{problems}", problems="\n".join(problems))
        return self

    @model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> dict[str, Any]:
        """Leave out the seeds and the tolerance where an ensemble decides them."""
        data: dict[str, Any] = handler(self)
        if self.comment is None:
            del data["comment"]
        if self.ensemble is not None:
            data["surface"].pop("seeds", None)
            if self.solving != self.solver:  # its tolerance follows from the accuracy, when this is read again as well
                data["solver"] = {name: data["solver"][name] for name in ("kernel", "method")}
        return data

    @contextlib.contextmanager
    def placing(self) -> Iterator[None]:
        """Add file and line to the problems of a `StudyError` raised inside."""
        try:
            yield
        except StudyError as error:
            raise StudyError([self._places.of(problem) for problem in error.problems]) from error

    def cases(self) -> tuple[Case, ...]:
        """Return the product over D, m and seeds, seeds fastest; each height file is one case.

        Raises
        ------
        StudyError
            If a height file cannot be read, or lacks a size or unit that the study does not give.
        """
        surface = self.surface
        E_star, sweep, solver, record = self.material.contact_modulus, self.sweep, self.solving, self.record
        hard = self.material.indentation_hardness
        hardness = None if hard is None else hard / E_star
        modulus_unit = self.material.unit if sweep.has_units else None
        if isinstance(surface, GeneratedSurface):
            law, L, unit = surface.midpoint_law, float(surface.L), surface.length_unit
            height = None if hardness is None and not sweep.has_units else surface.height
            product = itertools.product(surface.D, surface.m, surface.seeds)
            if self.ensemble is not None:  # one of each resolution; the campaign decides how many more
                finest = surface.m[0] if surface.m else ensembles.AUTO_FROM
                product = itertools.product(surface.D, ensembles.levels_below(finest), [self.ensemble.first_seed])
            case = Case(L, E_star, sweep, solver, record, length_unit=unit, hardness=hardness, height=height)
            case = replace(case, plastic=hardness is not None and self.material.plastic, modulus_unit=modulus_unit)
            return tuple(replace(case, D=D, m=m, seed=seed, midpoint_law=law) for D, m, seed in product)
        made: list[Case] = []
        for one in surface.each:
            with self.placing():
                measured = resolve(one)
                if measured.unit is None:
                    need_length(sweep, str(one.file))
                if made and (made[0].length_unit, made[0].L) != (measured.unit, measured.L):
                    own, first = (
                        f"{L:.9g} {unit or ''}".strip()
                        for L, unit in ((measured.L, measured.unit), (made[0].L, made[0].length_unit))
                    )
                    message = f"the files differ in L: {made[0].label} has {first}, {Path(one.file).name} has {own}"
                    raise StudyError([Problem(message, "surface.files")])
            made.append(
                Case(
                    measured.L,
                    E_star,
                    sweep,
                    solver,
                    record,
                    bodies=measured.bodies,
                    treatment=measured.treatment,
                    length_unit=measured.unit,
                    modulus_unit=modulus_unit,
                    hardness=hardness,
                    plastic=hardness is not None and self.material.plastic,
                    notes=measured.notes,
                )
            )
        return tuple(made)

    @property
    def solving(self) -> Solver:
        """The solver in force: of an ensemble as accurate as its request needs, unless the study gives a tolerance."""
        given = {"accuracy", "rtol", "max_error"} & self.solver.model_fields_set
        if self.ensemble is None or given:
            return self.solver
        return self.solver.model_copy(update={"rtol": self.ensemble.tolerance})

    def sample(self, D: float, m: int, seed: int) -> Case:
        """Return the case of one surface of an ensemble."""
        return replace(self._first, D=D, m=m, seed=seed)

    @functools.cached_property
    def _first(self) -> Case:
        return self.cases()[0]

    def to_yaml(self) -> str:
        """Return the study as YAML with every default; `loads` of it gives an equal study."""
        return write(self.model_dump(mode="json"))

    def stored(self) -> str:
        """Return the study as YAML for files of results, with height files by name and not by absolute path.

        ``loads(text, stored=True)`` reads it without the height files.
        """
        return write(self.model_dump(mode="json", context={"stored": True}))


def json_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a study file.

    Returns
    -------
    dict
        Schema with the descriptions of all keys, for completion and checks in editors.
    """
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Study.model_json_schema()}


def conflicts(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield key path and message of each conflict between keys, from plain data that may have other faults."""

    def mapping(*path: str) -> dict[str, Any]:
        section: Any = data
        for part in path:
            section = section.get(part) if isinstance(section, dict) else None
        return section if isinstance(section, dict) else {}

    surface, record = mapping("surface"), mapping("record")
    sweep = data.get("sweep")
    path = isinstance(sweep, list | tuple)
    legs = [leg if isinstance(leg, dict) else {} for leg in sweep or ()] if path else [mapping("sweep")]
    ends = [end_of(leg) for leg in legs]
    steps = sum(number for leg in legs for _, number in _numbers(steps_of(leg)))

    if "paper" in (data.get("solver"), mapping("solver").get("method")):
        for place, m in _numbers(surface.get("m"), "surface", "m"):
            if m > PAPER_MAX_M:
                yield place, f"solver method 'paper' is dense and takes m <= {PAPER_MAX_M}, given {number_text(m)}"
    yield from _file_conflicts(surface, mapping("surface", "against"))

    for index, (leg, end) in enumerate(zip(legs, ends, strict=True)):
        named = isinstance(leg.get("to"), dict) and list_of(leg) is None
        if named and sum(value is not None for value in end.values()) != 1:
            yield ("sweep", *([index] if path else []), "to"), f"must name exactly one of {', '.join(names(Target))}"
    if path:
        yield from _path_conflicts(data, legs, ends)
    yield from _unit_conflicts(surface, mapping("material"), record, data)
    yield from ensembles.conflicts(data)
    material = mapping("material")
    yields = material.get("hardness") is not None and material.get("plastic") is not False
    if record.get("residual_heights") is True and not yields:
        yield ("record", "residual_heights"), "no plastic displacement: give material.hardness"
    if yields and "paper" in (data.get("solver"), mapping("solver").get("method")):
        yield ("solver",), "solver method 'paper' takes no hardness; allowed: material.plastic: false"
    pressed = [name for name in Record.model_fields if name not in ("heights", "residual_heights", "region", "texture")]
    at = mapping("record", "texture").get("at")
    asked: list[KeyPath] = [(name,) for name in pressed if record.get(name) is not None]
    asked += [("texture", "at")] if at not in (None, "last") else []  # texture before load needs no contact
    for keys in asked if steps == 0 else ():
        yield ("record", *keys), "no contact to record: sweep.steps is 0"
    selectors = [("ensemble", "at"), *(("record", *path) for path in SELECTORS)]
    levels = [(*keys, kind) for keys in selectors for kind in mapping(*keys)]
    for keys in levels if steps != 0 else ():
        kind = keys[-1]
        sign = -1 if kind == "separation" else 1  # the separation falls on the way
        farthest = [last for end in ends for _, last in _numbers(steps if kind == "step" else end.get(kind))]
        for last in [max(farthest, key=lambda last: sign * last)] if len(farthest) == len(ends) else []:
            for place, level in _numbers(mapping(*keys[:-1])[kind], *keys):
                if sign * (level - last) > 1e-9 * max(1.0, abs(last)):
                    yield place, f"{number_text(level)} is not reached: the sweep ends at {kind} {number_text(last)}"

    lists = [("surface", "D"), ("surface", "m"), ("surface", "seeds"), ("record", "box_counting", "thresholds")]
    lists += [("record", "region_widths", "shares")]
    for keys in (*lists, *levels):
        seen: set[float] = set()
        for place, number in _numbers(mapping(*keys[:-1]).get(keys[-1]), *keys):
            if number in seen:
                yield place, f"duplicate value {number_text(number)}"
            seen.add(number)
    seeds = whole(surface.get("seeds", 10))
    counts = [len(list(_numbers(surface.get(name)))) for name in ("D", "m", "seeds")]
    cases = counts[0] * counts[1] * (seeds if isinstance(seeds, int) else counts[2])
    if cases > MAX_CASES:
        yield ("surface",), f"makes {cases} cases (D times m times seeds); allowed: at most {MAX_CASES}"


def _file_conflicts(surface: dict[str, Any], against: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield conflicts between the keys of height files and the formats of these files."""
    bodies: list[tuple[KeyPath, dict[str, Any]]] = [(("surface",), surface), (("surface", "against"), against)]
    suffixes = {path: Path(str(body["file"])).suffix.lower() for path, body in bodies if "file" in body}
    for path, body in bodies:
        suffix = suffixes.get(path, "")
        if body.get("variable") is not None and suffix in HEIGHT_FORMATS and suffix not in SEVERAL_ARRAYS:
            yield (*path, "variable"), f"a {suffix} file holds one array without a name: omit 'variable'"
    if "file" not in surface or not set(suffixes.values()) <= {*BARE_FORMATS}:
        return  # other formats may have sizes and units
    if surface.get("L") is None and surface.keys() <= HeightFile.model_fields.keys():
        yield ("surface", "L"), f"missing, and the file has no size ({HeightFile.model_fields['L'].description})"
    if surface.get("unit") is not None or length_unit(surface.get("L")) is not None:
        return
    crop = surface["crop"] if isinstance(surface.get("crop"), dict) else {}
    lengths: list[tuple[KeyPath, Any]] = [(("low_pass",), surface.get("low_pass"))]
    lengths += [
        (("crop", axis), position)
        for axis, positions in crop.items()
        if isinstance(positions, list)
        for position in positions
    ]
    for key, length in lengths:
        if has_unit(length):
            yield ("surface", *key), f"has a unit ({length}) and L has none: give L with its unit, as L: 100 um"


def _unit_conflicts(
    surface: dict[str, Any], material: dict[str, Any], record: dict[str, Any], data: dict[str, Any]
) -> Iterator[tuple[KeyPath, str]]:
    """Yield units that are missing or given twice."""
    own, unit = length_unit(surface.get("L")), surface.get("unit")
    has_length = own is not None or unit is not None
    if own is not None and unit not in (None, own):
        yield ("surface", "unit"), f"L has a unit already ({surface['L']}): omit 'unit'"
    if has_unit(surface.get("Sq")) and not has_length:
        yield ("surface", "Sq"), f"has a unit ({surface['Sq']}) and L has none: give L with its unit, as L: 100 um"
    modulus = material.get("E_star", material.get("E"))
    if has_unit(material.get("hardness")) and not has_unit(modulus):
        yield ("material", "hardness"), "has a unit and the modulus has none: give both with units, or none"
    from_file = bool({"file", "files"} & surface.keys())
    yield from lacking_units(data, modulus, has_length=has_length or from_file)
    if record.get("region") is not None:
        for path, kind, _ in sections_of(data.get("sweep")):
            if kind == "load":
                yield path, "is a load on the whole surface, and states are those of record.region: give a pressure"
    other = material.get("against")
    if isinstance(other, dict) and has_unit(other.get("E")) and not has_unit(modulus):
        yield ("material", "against", "E"), "has a unit and that of the first body has none: give both with units"
    wanted = record.get("dimensional")
    for name in [key for key, value in wanted.items() if value is not None] if isinstance(wanted, dict) else ():
        if name == "pressure" and not has_unit(modulus):
            yield ("record", "dimensional", name), "needs the modulus with its unit, as material: {E_star: 100 GPa}"
        if name != "pressure" and not has_length and not from_file:
            yield ("record", "dimensional", name), "needs the unit of length, as surface: {L: 100 um}"
        needs = {"leak_rate": "transmissivity", "critical_gap": "constriction"}.get(name)
        transport = record.get("transport")
        if needs and not (isinstance(transport, dict) and transport.get(needs) is not None):
            yield ("record", "dimensional", name), f"needs record.transport.{needs}"


def _path_conflicts(
    data: dict[str, Any], legs: list[dict[str, Any]], ends: list[dict[str, Any]]
) -> Iterator[tuple[KeyPath, str]]:
    """Yield the conflicts between the legs of a path."""
    if data.get("ensemble") is not None:
        yield ("sweep",), "an ensemble takes one sweep, {steps, to}, and no list of legs"
    for kind in ("pressure", "indentation"):
        if ends and ends[0].get(kind) == 0:
            yield ("sweep", 0, "to", kind), "must be > 0 on the first leg, which begins at first touch"
    for index in range(1, len(legs)):
        one, other = (end_of(leg) or leg.get("to", "mean-plane") for leg in (legs[index - 1], legs[index]))
        if one == other:
            yield ("sweep", index, "to"), "is the end of the leg before: the leg has no length"


def _numbers(value: Any, *path: str | int) -> Iterator[tuple[KeyPath, float]]:
    """Yield the numbers of a number or a list, each with its key path."""
    items = [((*path, index), item) for index, item in enumerate(value)] if isinstance(value, list) else [(path, value)]
    yield from ((where, item) for where, item in items if isinstance(item, int | float) and not isinstance(item, bool))
