"""A study as a whole, the cases it makes, and the rules that no section shows alone."""

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
from roughvol.study.record import Record
from roughvol.study.sections import (
    PAPER_MAX_M,
    GeneratedSurface,
    Solver,
    Strict,
    Sweep,
    Target,
    Word,
    names,
    refuse,
    tag_surface,
    whole,
    without_unused,
)
from roughvol.study.treatment import steps
from roughvol.study.units import has_unit, length_unit
from roughvol.study.yaml_text import KeyPath, key_text, number_text, write
from roughvol.surfaces.body import UNTREATED, Body, Treatment

ANSWER_FORMAT = 2  # part of every case id: raise it when equal settings no longer give equal stored numbers
LATER = ("transport", "region", "region_widths")
DERIVED = ("dimensional",)  # of the section record: made from what is stored, when cases are collected
MAX_CASES = 100_000
SEVERAL_ARRAYS = (".npz", ".nc", ".tif", ".tiff", ".dat")


@dataclass(frozen=True)
class Case:
    """One surface pressed once: everything `campaign.run_case` needs, picklable.

    Set are either ``D``, ``m``, ``seed`` and ``midpoint_law``, or ``file``, ``sha256`` (of its content), ``variable``
    and what else `bodies` holds, with the second of two rough bodies as ``against``.
    """

    L: float
    E_star: float
    sweep: Sweep
    solver: Solver
    record: Record
    D: float | None = None
    m: int | None = None
    seed: int | None = None
    midpoint_law: Literal["std", "variance"] | None = None
    file: Path | None = None
    sha256: str | None = None
    variable: str | None = None
    file_unit: str | None = None  # of the numbers in the file, where it tells one
    pixel_ratio: float | None = None  # side of the pixels in the file along y over that along x, if they are resampled
    against: Body | None = None
    treatment: Treatment = UNTREATED
    length_unit: str | None = None  # of L, the heights and all lengths stored; None for an arbitrary one
    hardness: float | None = None  # over E*
    height: float | None = None  # the Sq to which heights are scaled, where there is a hardness to compare with
    reading: tuple[tuple[str, str], ...] = ()  # of the first body: heights_unit, columns, header, read_as where used
    notes: tuple[str, ...] = ()  # on size and units of the files, for the user

    @property
    def key(self) -> dict[str, Any]:
        """What changes the stored answer, as plain data; neither names nor E*, which no starred number depends on."""
        surface: dict[str, Any]
        if self.file is None:
            surface = {"D": self.D, "m": self.m, "seed": self.seed, "midpoint_law": self.midpoint_law}
        else:
            surface = {"sha256": self.sha256, "variable": self.variable, **self.treatment.used}
            if self.against is not None:
                other = self.against
                named = {"sha256": other.sha256, "variable": other.variable, "mirror": other.mirror}
                surface["against"] = named | other.reading
            surface |= self.bodies[0].reading if self.bodies else {}
            if self.treatment.resample != "none":
                surface["pixel_ratio"] = [body.pixel_ratio for body in self.bodies]
            if any(body.numbers_in for body in self.bodies):  # their numbers are converted to this one
                surface["unit"] = self.length_unit
        key = {
            "format": ANSWER_FORMAT,
            "surface": {"L": self.L, **surface},
            "record": self._recorded,
        }
        if self.sweep.steps == 0:  # nothing is solved, so neither the end of the sweep nor the solver matters
            return {**key, "sweep": {"steps": 0}}
        if self.hardness is not None:
            key["material"] = {"hardness": float(f"{self.hardness:.12g}"), "Sq": self.height}  # in any unit the same
        solver: dict[str, Any] = {
            "rtol": self.solver.tolerance,
            "kernel": self.solver.kernel,
            "method": self.solver.method,
        }
        if self.solver.pressure_error is not None:
            solver["pressure_error"] = self.solver.pressure_error
        return {**key, "sweep": self.sweep.model_dump(mode="json"), "solver": solver}

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The rough bodies whose heights come from files: none, one, or two facing each other."""
        if self.file is None or self.sha256 is None:
            return ()
        named: dict[str, Any] = dict(self.reading)
        first = Body(self.file, self.sha256, self.variable, self.file_unit, pixel_ratio=self.pixel_ratio, **named)
        return (first,) if self.against is None else (first, self.against)

    @property
    def _recorded(self) -> dict[str, Any]:
        """The section ``record``; keys that came later count only where they are used, so that other ids stay."""
        record = self.record.model_dump(mode="json")
        return {name: value for name, value in without_unused(record, *LATER).items() if name not in DERIVED}

    @property
    def key_text(self) -> str:
        """The key as the files of the case hold it."""
        return json.dumps(self.key, sort_keys=True)

    @functools.cached_property
    def id(self) -> str:
        """A readable prefix and 8 hexadecimal digits of the sha256 of `key`: ``D2.30_m8_s003-1f9c2a7b``."""
        text = json.dumps(self.key, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return f"{self._prefix}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"

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
        """The case in words: ``D = 2.30, m = 8, seed 3``, or the name of the file."""
        if self.file is None:
            return f"D = {self._D_text}, m = {self.m}, seed {self.seed}"
        return " against ".join(body.file.name for body in self.bodies)

    @property
    def surface_text(self) -> str:
        """What is done to heights from files, in words; empty if they are pressed as they stand there."""
        said = ["; ".join(steps(self.treatment, self.length_unit))]
        if self.against is not None:
            turned = f", its axis {self.against.mirror} reversed" if self.against.mirror != "none" else ""
            said.append(f"heights of {self.against.file.name} added{turned}")
        units = {body.file.name: body.numbers_in for body in self.bodies if body.numbers_in}
        said += [f"sizes and units in {body.file.name} ignored" for body in self.bodies if body.header]
        said += [f"numbers of {name} are in {unit}" for name, unit in units.items()]
        return "; ".join(filter(None, said))


class Places:
    """Lines of the keys in the text of a study; no part of its identity, so all are equal."""

    def __init__(self, file: str = "", lines: dict[str, int] | None = None) -> None:
        self.file, self.lines = file, lines or {}

    def __eq__(self, other: object) -> bool:
        """Return True for any two."""
        return isinstance(other, Places)

    __hash__ = None  # type: ignore[assignment]

    def of(self, problem: Problem) -> Problem:
        """Return a problem with file and line, where it has none; a missing key is placed where its mapping begins."""
        if problem.file or not self.file:
            return problem
        key = problem.key
        while key and key not in self.lines:
            key = key.rpartition(".")[0]
        return replace(problem, line=self.lines.get(key), file=self.file)


class Study(Strict):
    """A study: which surfaces, pressed how far, solved how accurately, and what is stored."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$", max_length=100)] = Field(
        default="study",
        description="letters, digits, _, - and dots, at most 100, a letter, digit or _ first; "
        "if left out, that of the study file",
    )
    surface: Annotated[
        Annotated[GeneratedSurface, Tag("<generated>")] | Annotated[HeightFile, Tag("<file>")],
        Discriminator(tag_surface),
    ] = Field(description="{D, m, L, seeds, midpoint_law} for generated surfaces, or {file, L, variable}")
    material: Annotated[
        Annotated[ContactModulus, Tag("<modulus>")] | Annotated[YoungPoisson, Tag("<young>")],
        Discriminator(tag_material),
    ] = Field(default=ContactModulus(), description="{E_star} or {E, nu}, and hardness if known")
    sweep: Sweep = Field(default=Sweep(), description="{steps, to}: how far the surfaces are pressed")
    solver: Annotated[Solver, Word("paper", (("method", "paper"),))] = Field(
        default=Solver(),
        description="{accuracy, rtol or max_error, kernel, method}; the word 'paper' is short for {method: paper}",
    )
    record: Record = Field(
        default=Record(),
        description="{heights, fields_at, box_counting, volume_density, transport, region, region_widths, dimensional}",
    )

    ensemble: Ensemble | None = Field(
        default=None, description="{accuracy, at, budget, first_seed}: how accurate the mean over all surfaces is to be"
    )

    _places: Places = PrivateAttr(default_factory=Places)

    @model_validator(mode="after")
    def _possible(self) -> Study:
        data = self.model_dump(mode="json")
        if self.ensemble is not None and "seeds" in self.surface.model_fields_set:
            data["surface"]["seeds"] = []
        found = [f"{key_text(path)}: {message}" for path, message in conflicts(data)]
        if found:
            refuse("{found}", found="\n".join(found))
        return self

    @model_serializer(mode="wrap")
    def _plain(self, handler: Any) -> dict[str, Any]:
        """Leave out what came later where it is not used, and the seeds where an ensemble decides them."""
        data: dict[str, Any] = without_unused(handler(self), "ensemble")
        if self.ensemble is not None:
            data["surface"].pop("seeds", None)
            if self.solving != self.solver:  # its tolerance follows from the accuracy, when this is read again as well
                data["solver"] = {name: data["solver"][name] for name in ("kernel", "method")}
        return data

    @contextlib.contextmanager
    def placing(self) -> Iterator[None]:
        """Give the problems of a `StudyError` raised inside their file and line."""
        try:
            yield
        except StudyError as error:
            raise StudyError([self._places.of(problem) for problem in error.problems]) from error

    def cases(self) -> tuple[Case, ...]:
        """Return the product over D, m and seeds, seeds running fastest; a height file is one case.

        Raises
        ------
        StudyError
            If a height file cannot be read, or does not tell what the study leaves to it.
        """
        surface = self.surface
        E_star, sweep, solver, record = self.material.contact_modulus, self.sweep, self.solving, self.record
        hard = self.material.indentation_hardness
        hardness = None if hard is None else hard / E_star
        if isinstance(surface, GeneratedSurface):
            law, L, unit = surface.midpoint_law, float(surface.L), surface.length_unit
            height = None if hardness is None else surface.height
            product = itertools.product(surface.D, surface.m, surface.seeds)
            if self.ensemble is not None:  # one of each resolution; the campaign decides how many more
                finest = surface.m[0] if surface.m else ensembles.AUTO_FROM
                product = itertools.product(surface.D, ensembles.levels_below(finest), [self.ensemble.first_seed])
            one = Case(L, E_star, sweep, solver, record, length_unit=unit, hardness=hardness, height=height)
            return tuple(replace(one, D=D, m=m, seed=seed, midpoint_law=law) for D, m, seed in product)
        with self.placing():
            measured = resolve(surface)
        first, *others = measured.bodies
        case = Case(
            measured.L,
            E_star,
            sweep,
            solver,
            record,
            file=first.file,
            sha256=first.sha256,
            variable=first.variable,
            file_unit=first.unit,
            pixel_ratio=first.pixel_ratio,
            against=others[0] if others else None,
            treatment=measured.treatment,
            length_unit=measured.unit,
            hardness=hardness,
            reading=tuple(first.reading.items()),
            notes=measured.notes,
        )
        return (case,)

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
        """Return the study with every default written out; `loads` of it gives an equal study."""
        return write(self.model_dump(mode="json"))

    def stored(self) -> str:
        """Return the study as files of results hold it: height files by the text that names them, no absolute path.

        ``loads(text, stored=True)`` reads it without those files.
        """
        return write(self.model_dump(mode="json", context={"stored": True}))


def json_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a study file, for editors."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Study.model_json_schema()}


def conflicts(data: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield what no key shows alone: key path and message. Works on plain data, whatever else is wrong with it."""

    def mapping(*path: str) -> dict[str, Any]:
        here: Any = data
        for part in path:
            here = here.get(part) if isinstance(here, dict) else None
        return here if isinstance(here, dict) else {}

    surface, record, steps = mapping("surface"), mapping("record"), mapping("sweep").get("steps", 60)

    if "paper" in (data.get("solver"), mapping("solver").get("method")):
        for path, m in _numbers(surface.get("m"), "surface", "m"):
            if m > PAPER_MAX_M:
                yield path, f"solver method 'paper' is dense and takes m <= {PAPER_MAX_M}, given {number_text(m)}"
    yield from _file_conflicts(surface, mapping("surface", "against"))

    end = mapping("sweep", "to")
    if isinstance(mapping("sweep").get("to"), dict) and sum(value is not None for value in end.values()) != 1:
        yield ("sweep", "to"), f"must name exactly one of {', '.join(names(Target))}"
    yield from _unit_conflicts(surface, mapping("material"), record)
    yield from ensembles.conflicts(data)
    pressed = ("fields_at", "box_counting", "volume_density", "transport", "region_widths", "dimensional")
    for name in pressed if steps == 0 else ():
        if record.get(name) is not None:
            yield ("record", name), "there is no contact to record, since sweep.steps is 0"
    selectors: list[tuple[str, ...]] = [
        ("record", "fields_at"),
        ("record", "box_counting", "at"),
        ("record", "volume_density", "at"),
        ("record", "region_widths", "at"),
        ("record", "region_widths", "transmissivity"),
    ]
    selectors += [("record", "transport", quantity) for quantity in mapping("record", "transport")]
    selectors.append(("ensemble", "at"))
    levels = [(*place, kind) for place in selectors for kind in mapping(*place)]
    for place in levels if steps != 0 else ():
        kind = place[-1]
        for _, last in _numbers(steps if kind == "step" else end.get(kind)):
            sign = -1 if kind == "separation" else 1  # the separation falls on the way
            for path, level in _numbers(mapping(*place[:-1])[kind], *place):
                if sign * (level - last) > 1e-9 * max(1.0, abs(last)):
                    yield path, f"{number_text(level)} is not reached: the sweep ends at {kind} {number_text(last)}"

    lists = [("surface", "D"), ("surface", "m"), ("surface", "seeds"), ("record", "box_counting", "thresholds")]
    lists += [("record", "region_widths", "shares")]
    for place in (*lists, *levels):
        seen: set[float] = set()
        for path, number in _numbers(mapping(*place[:-1]).get(place[-1]), *place):
            if number in seen:
                yield path, f"{number_text(number)} stands in the list twice"
            seen.add(number)
    seeds = whole(surface.get("seeds", 10))
    counts = [len(list(_numbers(surface.get(name)))) for name in ("D", "m", "seeds")]
    cases = counts[0] * counts[1] * (seeds if isinstance(seeds, int) else counts[2])
    if cases > MAX_CASES:
        yield ("surface",), f"makes {cases} cases (D times m times seeds), at most {MAX_CASES} are allowed"


def _file_conflicts(surface: dict[str, Any], against: dict[str, Any]) -> Iterator[tuple[KeyPath, str]]:
    """Yield what files of heights need that their endings show."""
    bodies: list[tuple[KeyPath, dict[str, Any]]] = [(("surface",), surface), (("surface", "against"), against)]
    suffixes = {path: Path(str(body["file"])).suffix.lower() for path, body in bodies if "file" in body}
    for path, body in bodies:
        suffix = suffixes.get(path, "")
        if body.get("variable") is not None and suffix in HEIGHT_FORMATS and suffix not in SEVERAL_ARRAYS:
            yield (*path, "variable"), f"a {suffix} file holds one array, without a name: leave 'variable' out"
    if "file" not in surface or not set(suffixes.values()) <= {*BARE_FORMATS}:
        return  # other files may give what the study does not
    if surface.get("L") is None and surface.keys() <= HeightFile.model_fields.keys():
        yield ("surface", "L"), f"missing, and the file does not give it ({HeightFile.model_fields['L'].description})"
    if surface.get("unit") is not None or length_unit(surface.get("L")) is not None:
        return
    crop = surface["crop"] if isinstance(surface.get("crop"), dict) else {}
    lengths: list[tuple[KeyPath, Any]] = [(("low_pass",), surface.get("low_pass"))]
    lengths += [
        (("crop", axis), place) for axis, places in crop.items() if isinstance(places, list) for place in places
    ]
    for key, length in lengths:
        if has_unit(length):
            yield ("surface", *key), f"has a unit ({length}) and L has none: give both with theirs, as L: 100 um"


def _unit_conflicts(
    surface: dict[str, Any], material: dict[str, Any], record: dict[str, Any]
) -> Iterator[tuple[KeyPath, str]]:
    """Yield where a unit is missing, or given twice."""
    own, unit = length_unit(surface.get("L")), surface.get("unit")
    has_length = own is not None or unit is not None
    if own is not None and unit not in (None, own):
        yield ("surface", "unit"), f"L has its unit already ({surface['L']}): leave 'unit' out"
    if has_unit(surface.get("Sq")) and not has_length:
        yield ("surface", "Sq"), f"has a unit ({surface['Sq']}) and L has none: give both with theirs, as L: 100 um"
    modulus = material.get("E_star", material.get("E"))
    if has_unit(material.get("hardness")) and not has_unit(modulus):
        yield ("material", "hardness"), "has a unit and the modulus has none: give both with theirs, or none"
    other = material.get("against")
    if isinstance(other, dict) and has_unit(other.get("E")) and not has_unit(modulus):
        yield ("material", "against", "E"), "has a unit and that of the first body has none: give both with theirs"
    wanted = record.get("dimensional")
    for name in [key for key, value in wanted.items() if value is not None] if isinstance(wanted, dict) else ():
        if name == "pressure" and not has_unit(modulus):
            yield ("record", "dimensional", name), "needs the modulus with its unit, as material: {E_star: 100 GPa}"
        if name != "pressure" and not has_length and surface.get("file") is None:
            yield ("record", "dimensional", name), "needs the unit of length, as surface: {L: 100 um}"
        needs = {"leak_rate": "transmissivity", "critical_gap": "constriction"}.get(name)
        transport = record.get("transport")
        if needs and not (isinstance(transport, dict) and transport.get(needs) is not None):
            yield ("record", "dimensional", name), f"is made from record.transport.{needs}, which is not asked for"


def _numbers(value: Any, *path: str | int) -> Iterator[tuple[KeyPath, float]]:
    """Yield the numbers of a number or a list, each with its key path."""
    items = [((*path, index), item) for index, item in enumerate(value)] if isinstance(value, list) else [(path, value)]
    yield from ((where, item) for where, item in items if isinstance(item, int | float) and not isinstance(item, bool))
