"""A stored run, as claims see it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
from xarray import DataArray, Dataset

from roughvol.errors import DatasetError
from roughvol.store.variants import parts_of, study_in
from roughvol.study import GeneratedSurface, HeightFile, MadeSurface, SpectralSurface, Study
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array

Part = TypeVar("Part")
Answer = TypeVar("Answer")


def answers(
    parts: Iterable[Part], answer: Callable[[Part], Answer]
) -> tuple[list[tuple[Part, Answer]], list[DatasetError]]:
    """Return the parts of a run that have an answer, each with its answer, and the errors of the other parts.

    Raise the first error if no part has an answer.
    """
    found, errors = [], list[DatasetError]()
    for part in parts:
        try:
            found.append((part, answer(part)))
        except DatasetError as error:
            errors.append(error)
    if errors and not found:
        raise errors[0]
    return found, errors


def _foreign(dataset: Dataset, study: Study) -> str:
    """Return a label of surfaces that are not of a study, as of several runs joined by a user; empty without one.

    Joined runs keep the study of the first, and so its modulus.
    """
    surface = "case" if isinstance(study.surface, HeightFile) else "seed"
    known = {*(axis.name for axis in study.axes), "D", "m", surface, "step"}
    dims = dataset["mean_pressure"].dims if "mean_pressure" in dataset else ()
    if foreign := [str(dim) for dim in dims if dim not in known]:
        return f"a dimension {foreign[0]}"
    if isinstance(study.surface, HeightFile):
        files = {Path(file).name for file in study.surface.files or (study.surface.file,)}
        cases = [str(label) for label in np.ravel(dataset["case"])] if "case" in dataset.coords else []
        twice = next((f"case = {label} twice" for label in cases if cases.count(label) > 1), "")
        others = (label for label in cases if label.partition(" against ")[0] not in files)
        return twice or next((f"case = {label}" for label in others), "")
    if not isinstance(study.surface, MadeSurface) or study.ensemble is not None:
        return ""
    named = {"D": study.surface.dimensions, "m": study.surface.m, "seed": study.surface.seeds}
    labels = ((key, label) for key in named if key in dataset.coords for label in np.ravel(dataset[key]).tolist())
    return next((f"{key} = {label:g}" for key, label in labels if not np.isin(label, named[key])), "")


@dataclass(frozen=True, eq=False)
class Run:
    """A stored study: its name, its dataset, and the study itself where its text can be read again."""

    name: str
    dataset: Dataset
    study: Study | None = None

    @classmethod
    def of(cls, name: str, dataset: Dataset) -> Run:
        """Return the run of a dataset as `dataset.read` gives it; a `DatasetError` if a dimension has no labels."""
        if (study := study_in(dataset)) is None:
            return cls(name, dataset)
        if foreign := _foreign(dataset, study):
            raise DatasetError(f"{name} has {foreign}, which its study does not name; allowed: the dataset of one run")
        surface = "case" if "case" in dataset.coords else "seed"
        labels = (*(axis.name for axis in study.axes), "L", surface, *map(str, dataset.dims))
        if lost := [label for label in labels if label not in dataset.coords]:
            raise DatasetError(f"{name} has lost its label of {lost[0]}; allowed: a choice without drop=True")
        return cls(name, dataset, study)

    @property
    def parts(self) -> list[Run]:
        """The run of each combination of the lists of its study; itself without lists."""
        parts = parts_of(self.dataset)
        if not parts[0].words:
            return [self]
        return [Run.of(f"{self.name}, {part.words}", part.dataset) for part in parts]

    @property
    def generated(self) -> GeneratedSurface | None:
        """How the surfaces were made, None if they were read from a file."""
        surface = self.study.surface if self.study else None
        return surface if isinstance(surface, GeneratedSurface) else None

    @property
    def spectral(self) -> SpectralSurface | None:
        """The spectrum that the surfaces were made with, None for other surfaces."""
        surface = self.study.surface if self.study else None
        return surface if isinstance(surface, SpectralSurface) else None

    @property
    def law(self) -> str:
        """Midpoint law, empty for surfaces from files."""
        return self.generated.midpoint_law if self.generated else ""

    @property
    def end(self) -> str:
        """Where the sweep ends, empty where nothing was pressed."""
        return self.study.sweep.target.label if self.study and self.study.sweep.steps else ""

    @property
    def origin(self) -> str:
        """Where the heights come from, empty of free patches by midpoint displacement."""
        if self.generated is not None:
            return "" if self.generated.sides == "free" else f"{self.generated.sides} surfaces"
        if self.spectral is not None:
            return "surfaces with a spectrum"
        return "heights from a file" if "case" in self.dataset.dims else "its study cannot be read again"

    @property
    def steps(self) -> int:
        """Steps of the sweep, 0 where nothing was pressed."""
        if self.study is not None:
            return self.study.sweep.steps
        return int(self.dataset.sizes.get("step", 0))

    @property
    def rtol(self) -> float:
        """Largest residual η/σ that the solver was allowed to leave."""
        return self.study.solving.tolerance if self.study else math.inf

    @property
    def scaled(self) -> bool:
        """Whether the heights were scaled to an Sq that the study names."""
        return self.generated is not None and self.generated.height is not None

    @property
    def shallowest(self) -> float:
        """Largest d/σ of a last state."""
        return float(self.dataset["separation"].isel(step=-1).max()) if "separation" in self.dataset else math.inf

    def computed(self, *, D: float, m: int) -> int:
        """Return how many surfaces of one D and m are stored."""
        return int(self._counts.sel(D=D, m=m))

    @cached_property
    def _counts(self) -> DataArray:
        return self.dataset["Sq"].notnull().sum("seed")

    @property
    def L(self) -> float:
        """Length of the first axis [length]."""
        return float(self.dataset["L"])

    @property
    def D(self) -> list[float]:
        """Fractal dimensions, increasing."""
        return [float(D) for D in self.dataset["D"].values]

    @property
    def m(self) -> list[int]:
        """Refinements, increasing."""
        return [int(m) for m in self.dataset["m"].values]

    @property
    def seeds(self) -> int:
        """Number of surfaces of each D and m."""
        return int(self.dataset.sizes["seed"])

    def values(self, name: str, *, D: float, m: int) -> Array:
        """Return a stored variable of one D and m, the surfaces along the first axis."""
        case = self.dataset[name].sel(D=D, m=m)
        return np.asarray(case.transpose("seed", ...).values, dtype=np.float64)

    def last(self, name: str, *, D: float, m: int) -> Array:
        """Return a variable at the last step, shape (seeds,)."""
        return self.values(name, D=D, m=m)[:, -1]

    def surface(self, D: float, m: int, seed: int) -> Surface:
        """Return the surface of a case, made again from its labels (nothing of it needs to be stored)."""
        periodic = self.generated is not None and self.generated.periodic
        made = random_midpoint_displacement(D, m, side=self.L, seed=seed, law=self.law, periodic=periodic)
        height = self.generated.height if self.generated else None
        return made if height is None else made.scaled(height)

    def seed_numbers(self) -> list[int]:
        """Return the seeds."""
        return [int(seed) for seed in self.dataset["seed"].values]
