"""A stored run: its name, dataset and study."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self, TypeVar

from xarray import DataArray, Dataset

from roughvol.errors import DatasetError
from roughvol.store.variants import parts_of, study_in
from roughvol.study import GeneratedSurface, HeightFile, MadeSurface, SpectralSurface, Study

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
    keys = [key for key in (surface, "D", "m", "step") if key in dataset.coords]
    labels = {key: dataset.variables[key].values.ravel().tolist() for key in keys}
    for key, own in labels.items():
        if twice := [f"{key} = {label} twice" for label, count in Counter(own).items() if count > 1]:
            return twice[0]
    if isinstance(study.surface, HeightFile):
        files = {Path(file).name for file in study.surface.files or (study.surface.file,)}
        cases = [str(label) for label in labels.get("case", ())]
        first = tuple(f"{file} against " for file in files)  # of two bodies
        others = (label for label in cases if label not in files and not label.startswith(first))
        return next((f"case = {label}" for label in others), "")
    if not isinstance(study.surface, MadeSurface) or study.ensemble is not None:
        return ""
    named = {"D": study.surface.dimensions, "m": study.surface.m, "seed": study.surface.seeds}
    strange = ((key, label) for key in named for label in labels.get(key, ()) if label not in named[key])
    return next((f"{key} = {label if isinstance(label, str) else f'{label:g}'}" for key, label in strange), "")


@dataclass(frozen=True, eq=False)
class Run:
    """A stored study: its name, its dataset, and the study itself where its text can be read again."""

    name: str
    dataset: Dataset
    study: Study | None = None

    @classmethod
    def of(cls, name: str, dataset: Dataset) -> Self:
        """Return the run of a dataset as `dataset.read` gives it; a `DatasetError` if a dimension has no labels."""
        if (study := study_in(dataset)) is None:
            return cls(name, dataset)
        if foreign := _foreign(dataset, study):
            raise DatasetError(f"{name} has {foreign}, which its study does not name; allowed: the dataset of one run")
        surface = "case" if "case" in dataset.coords else "seed"
        labels = (*(axis.name for axis in study.axes), "L", surface, *map(str, dataset.dims))
        if lost := [label for label in labels if label not in dataset.coords]:
            raise DatasetError(f"{name} has lost its label of {lost[0]}; allowed: a choice without drop=True")
        if "step" in dataset.indexes and not dataset.indexes["step"].is_monotonic_increasing:
            raise DatasetError(f"{name} has its steps in another order; allowed: ascending, as ds.sortby('step')")
        return cls(name, dataset, study)

    @property
    def parts(self) -> list[Self]:
        """The run of each combination of the lists of its study; itself without lists."""
        parts = parts_of(self.dataset)
        if not parts[0].words:
            return [self]
        return [self.of(f"{self.name}, {part.words}", part.dataset) for part in parts]

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
    def rtol(self) -> float:
        """Largest residual η/σ that the solver was allowed to leave."""
        return self.study.solving.tolerance if self.study else math.inf

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
