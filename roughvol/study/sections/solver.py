"""The section ``solver``: accuracy, kernel and method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field

from roughvol.study.sections.strict import Choice, Strict, default, optional

ACCURACY = {"draft": 1e-3, "standard": 1e-6, "reference": 1e-9}
"""Bound of the residual η/σ for each accuracy."""
EXPECTED = {"draft": (4e-4, 8e-4, 9e-5), "standard": (2e-5, 2e-6, 3e-8), "reference": (0.0, 2e-9, 2e-10)}
"""Largest errors of A*, p* (relative) and V*, rounded up, from `roughvol tradeoff configs/tradeoff.yaml`.

That of A* at standard is one element of m = 8. Other surfaces differ by a factor of a few. η/σ is a bound for V*.
"""
LOOSEST = 1e-2  # residual η/σ; a sweep with a looser one costs more, since its steps start from poor states
PAPER_MAX_M = 6  # the paper's algorithm has a dense matrix of 4^m rows


Tolerance = Annotated[float, Field(ge=1e-12, le=1e-1)]


class MaxError(Choice):
    """Largest allowed errors of any state. The solver ends each state as soon as they are certified."""

    EMPTY = "must name free_volume or mean_pressure"

    free_volume: Tolerance | None = optional("largest error of V* at the indentation of a state, 1e-12 to 1e-1")
    mean_pressure: Annotated[float, Field(ge=1e-9, le=1e-1)] | None = optional(
        "largest relative error of p* at the indentation of a state, 1e-9 to 1e-1"
    )


FreeKernel = Literal["love", "punch"]  # with influence coefficients: on surfaces with any sides
PeriodicKernel = Literal["fourier"]


@dataclass(frozen=True)
class NamedKernel:
    """A kernel of `contact.kernels` by its name, with its lengths in the unit of L and its numbers without a unit."""

    name: str
    lengths: tuple[tuple[str, float], ...] = ()
    numbers: tuple[tuple[str, float], ...] = ()

    @property
    def key(self) -> dict[str, Any]:
        """The same as plain data."""
        return {"name": self.name, **dict(self.lengths), **dict(self.numbers)}

    @property
    def label(self) -> str:
        """The kernel in words, as ``layer (thickness = 50)``."""
        made_of = ", ".join(f"{name} = {value:g}" for name, value in (*self.lengths, *self.numbers))
        return f"{self.name} ({made_of})" if made_of else self.name


class Solver(Strict):
    """Accuracy, kernel and method of the solver."""

    accuracy: Literal["draft", "standard", "reference"] = default(
        "standard", f"bound on the residual η/σ: {', '.join(f'{k} {v:g}' for k, v in ACCURACY.items())}"
    )
    rtol: Tolerance | None = optional("bound on the residual η/σ, 1e-12 to 1e-1; overrides accuracy")
    max_error: MaxError | None = optional("{free_volume, mean_pressure}: largest errors, instead of accuracy and rtol")
    kernel: Literal[FreeKernel, PeriodicKernel] = default(
        "love",
        "influence of an element: 'love' (uniform pressure) or 'punch' (rigid circular punch); 'fourier' "
        "(waves of the grid alone) on mirrored and periodic surfaces",
    )
    method: Literal["fast", "paper"] = default("fast", f"'fast', or 'paper': the dense Algorithm 1, m <= {PAPER_MAX_M}")

    @property
    def tolerance(self) -> float:
        """Bound of η/σ: ``rtol``, else the error of V* in ``max_error``, else that of ``accuracy``.

        η/σ bounds the error of V*, so the largest residual allowed is the error allowed.
        """
        if self.rtol is not None:
            return self.rtol
        if self.max_error is not None:
            return min(self.max_error.free_volume or LOOSEST, LOOSEST)
        return ACCURACY[self.accuracy]

    @property
    def pressure_error(self) -> float | None:
        """Bound of the relative error of p*; None without one."""
        return self.max_error.mean_pressure if self.max_error else None
