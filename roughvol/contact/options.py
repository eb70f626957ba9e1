"""Options of a solve: one frozen record for single states, sweeps, and searches."""

from __future__ import annotations

from dataclasses import dataclass

from roughvol.contact.tuning import TUNING, Tuning
from roughvol.errors import ContactError

METHODS = ("fast", "paper")
PRECISIONS = ("mixed", "double")


@dataclass(frozen=True)
class Options:
    """How states are solved.

    Attributes
    ----------
    rtol : float
        Bound of the residual η/σ, 0 < rtol ≤ 1; equation (2) of docs/explanation/solver.md.
    method : {"fast", "paper"}
        "paper" is the paper's Algorithm 1 on dense matrices, for at most 65 × 65 elements.
    precision : {"mixed", "double"}
        Precision of the convolutions inside the iteration: "mixed" has 32 bits where this loses no digit. The residual
        is in double precision with both.
    pressure_error : float, optional
        Bound of the relative error of p* at every state, 0 < pressure_error ≤ 0.1, in addition to `rtol`.
    hardness : float, optional
        Largest pressure H L/(E* σ), in the unit of p*. Default: elastic contact.
    tuning : Tuning
        Constants.

    Raises
    ------
    ContactError
        If a value is not allowed.
    """

    rtol: float = 1e-6
    method: str = "fast"
    precision: str = "mixed"
    pressure_error: float | None = None
    hardness: float | None = None
    tuning: Tuning = TUNING

    def __post_init__(self) -> None:
        if not 0 < self.rtol <= 1:
            raise ContactError(f"rtol is {self.rtol}; allowed: 0 < rtol <= 1 (a bound on the residual η/σ)")
        for name, value, allowed in (("method", self.method, METHODS), ("precision", self.precision, PRECISIONS)):
            if value not in allowed:
                raise ContactError(f"{name} is {value!r}; allowed: {', '.join(allowed)}")
        if self.pressure_error is not None and not 0 < self.pressure_error <= 0.1:
            raise ContactError(f"pressure_error is {self.pressure_error}; allowed: 0 < pressure_error <= 0.1")
        if self.hardness is not None and not self.hardness > 0.0:
            raise ContactError(f"hardness is {self.hardness}; allowed: hardness > 0, in the unit of p*")
        if self.hardness is not None and self.method != "fast":
            raise ContactError(f"method {self.method!r} has no hardness; allowed: 'fast'")


DEFAULT = Options()
