"""One case: a surface pressed once, and everything that determines its stored answer."""

from __future__ import annotations

import functools
import hashlib
import json
import re
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

from roughvol.study.sections.fluid import Gas
from roughvol.study.sections.record import Record
from roughvol.study.sections.solver import NamedKernel, Solver
from roughvol.study.sections.sweep import Legs, Sweep
from roughvol.study.sections.treatment import steps
from roughvol.study.values.units import convert
from roughvol.surfaces.body import UNTREATED, Body, Treatment
from roughvol.surfaces.spectrum import Spectrum
from roughvol.surfaces.surface import Sided
from roughvol.typing import Sides

ANSWER_FORMAT = 5  # part of every case id: raise it when equal settings no longer give equal stored numbers
OF_SURFACE = ("L", "D", "m", "seed", "midpoint_law", "periodic")


@dataclass(frozen=True)
class Case(Sided):
    """One surface pressed once: the picklable input of `campaign.run_case`.

    A generated surface has ``D``, ``m``, ``seed`` and ``midpoint_law``, or ``spectrum`` instead of the last. A measured
    one has ``bodies`` and ``treatment``.
    """

    L: float
    E_star: float
    sweep: Sweep | Legs
    solver: Solver
    kernel: NamedKernel
    record: Record
    D: float | None = None
    m: int | None = None
    seed: int | None = None
    midpoint_law: Literal["std", "variance"] | None = None
    spectrum: Spectrum | None = None  # with H = 3 - D and n = 2^m
    bodies: tuple[Body, ...] = ()  # whose heights come from files: none, one, or two facing each other
    nodes: tuple[int, int] = (0, 0)  # of heights from files, along x and y
    treatment: Treatment = UNTREATED
    length_unit: str | None = None  # of L, the heights and all stored lengths; None for an arbitrary one
    modulus_unit: str | None = None  # of E*; None for an arbitrary one
    hardness: float | None = None  # over E*
    plastic: bool = False  # pressures end at the hardness
    height: float | None = None  # Sq of the heights, where the study gives it
    notes: tuple[str, ...] = ()  # on size and units of the files, for the user
    sides: Sides = "free"
    drive: float | None = None  # ΔP/μ of the fluid [1/s]
    gas: Gas | None = None  # whose flow is recorded

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the fields alone: key and id name the answer format of the process that computes."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def key(self) -> dict[str, Any]:
        """Everything that changes the stored answer, as plain data; equal answers in other units have equal keys.

        Names are absent. So is ``record.dimensional``: its values are made when the cases are collected. Without steps
        nothing is solved: sweep, kernel, solver and material change nothing.
        """
        surface: dict[str, Any] = {name: getattr(self, name) for name in OF_SURFACE}
        if self.sides == "mirrored":
            surface["sides"] = self.sides
        surface["spectrum"] = None if self.spectrum is None else self.spectrum.key
        surface["bodies"] = [body.key for body in self.bodies]
        surface["treatment"] = self.treatment.key
        # Heights with a unit of their own are converted to that of the study.
        surface["unit"] = self.length_unit if any(body.numbers_in for body in self.bodies) else None
        return {"format": ANSWER_FORMAT, "surface": surface, **self._beside_surface}

    @functools.cached_property
    def _beside_surface(self) -> dict[str, Any]:
        """The parts of the key that do not belong to the surface."""
        record = self.record.model_dump(mode="json", exclude={"dimensional"})
        if self.record.own:
            record["own"] = {name: [own.target, own.version] for name, own in self.record.own.items()}
            record["own_units"] = [self.E_star, self.modulus_unit, self.length_unit, self.height]  # functions see them
        else:  # absent, so that cases without such quantities keep their ids
            record.pop("own")
        record["all_legs"] = self.record.all_legs and len(self.sweep.legs) > 1
        return {"record": record, "pressed": self._pressed if self.sweep.steps > 0 else None}

    def of_seed(self, D: float, m: int, seed: int) -> Case:
        """Return the case of another surface of the same study; both share the rest of the key, for speed."""
        case = replace(self, D=D, m=m, seed=seed)
        vars(case)["_beside_surface"] = self._beside_surface
        return case

    @property
    def _pressed(self) -> dict[str, Any]:
        """The part of the key that belongs to the sweep. E* and the unit of length enter where a state has a unit."""
        units = self.sweep.has_units or self.record.has_units
        follows_leak = any(level.kind.startswith("leak_rate") for _, level in self.sweep.states())
        sized = units or self.hardness is not None or self.gas is not None
        modulus = convert(self.E_star, self.modulus_unit, "Pa") if units and self.modulus_unit else None
        return {
            "sweep": self.sweep.model_dump(mode="json"),
            "kernel": self.kernel.key,
            "solver": {
                "rtol": self.solver.tolerance,
                "pressure_error": self.solver.pressure_error,
                "method": self.solver.method,
            },
            "material": {"E_star": _rounded(modulus), "hardness": _rounded(self.hardness), "plastic": self.plastic},
            "length": self.length_unit if units else None,
            "Sq": self.height if sized else None,
            "drive": _rounded(self.drive) if follows_leak else None,
            "gas": None if self.gas is None else asdict(self.gas),
        }

    @property
    def file(self) -> Path | None:
        """The file of the first body, None for a generated surface."""
        return self.bodies[0].file if self.bodies else None

    @property
    def shape(self) -> tuple[int, int]:
        """Number of nodes along x and y."""
        if self.m is None:
            return self.nodes
        nodes = 2**self.m + (not self.periodic)
        return nodes, nodes

    @functools.cached_property
    def key_text(self) -> str:
        """The key as JSON, as stored in the file of the case."""
        return json.dumps(self.key, sort_keys=True, allow_nan=False)

    @functools.cached_property
    def id(self) -> str:
        """A readable prefix and 8 hexadecimal digits of the sha256 of the key: ``D2.30_m8_s003-1f9c2a7b``."""
        if self.file is None:
            prefix = f"D{self._D_text}_m{self.m}_s{self.seed:03d}"
        else:
            prefix = re.sub(r"[^A-Za-z0-9_.-]+", "_", self.file.stem).lstrip(".-")[:60] or "surface"
        return f"{prefix}-{hashlib.sha256(self.key_text.encode()).hexdigest()[:8]}"

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
        sentences = steps(self.treatment, self.length_unit)
        sentences += [body.added for body in self.bodies[1:]]
        units = {body.file.name: body.numbers_in for body in self.bodies if body.numbers_in}
        sentences += [f"sizes and units in {body.file.name} ignored" for body in self.bodies if body.header]
        sentences += [f"numbers of {name} are in {unit}" for name, unit in units.items()]
        return "; ".join(sentences)


def _rounded(value: float | None) -> float | None:
    """Return a number with 12 digits: it is the same in any unit."""
    return None if value is None else float(f"{value:.12g}")
