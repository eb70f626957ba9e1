"""A stored run as claims see it: how its surfaces were made and pressed, and its numbers by D and m."""

from __future__ import annotations

import math

import numpy as np

from roughvol.analysis.stored_run import Run
from roughvol.study.values.state_kinds import STATE_KINDS, parse
from roughvol.study.values.units import unit_of
from roughvol.surfaces.midpoint import random_midpoint_displacement
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array


class ClaimRun(Run):
    """A stored study, with what claims ask of it."""

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
    def scaled(self) -> bool:
        """Whether the heights were scaled to an Sq that the study names."""
        return self.generated is not None and self.generated.height is not None

    @property
    def shallowest(self) -> float:
        """Largest d/σ of a last state."""
        return float(self.dataset["separation"].isel(step=-1).max()) if "separation" in self.dataset else math.inf

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


def state_words(at: str) -> str:
    """Return a state in symbols: p* = 0.1, or p = 0.1 MPa."""
    kind, _, value = at.partition("=")
    if kind not in STATE_KINDS:
        return at
    symbol = STATE_KINDS[kind].symbol
    return f"{symbol if unit_of(parse(at).value) is None else symbol.split('/')[0].rstrip('*')} = {value}"
