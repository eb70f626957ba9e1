"""Options of a solve, and the constants of the solver and of its searches: three frozen records.

No constant changes the answer beyond the residual. Constants decide when something is worth its time.
`docs/explanation/notes/solver-notebook.md` has the measurements behind each constant, with their commands.
"""

from dataclasses import dataclass

from roughvol.errors import ContactError
from roughvol.surfaces.surface import real

METHODS = ("fast", "paper")
PRECISIONS = ("mixed", "double")


@dataclass(frozen=True)
class Tuning:
    """Constants of the solver and of its convolution."""

    dense_up_to: int = 240  # most candidates for a Cholesky factorisation in place of the iteration
    # Distance of the farthest neighbours in a row of the near field G, in spacings; at most √8.
    near_reach: float = 5.0**0.5
    # The same on a period of a plane, where half of the elements may be in contact.
    near_reach_periodic: float = 2.0**0.5
    block_side: int = 8  # elements along the side of a block of the far field
    # Most blocks for a factorisation of the operator between them. More are put into blocks again.
    factorised_up_to: int = 256
    least_pivot: float = 0.05  # least pivot of the near field of blocks, as a share of the diagonal coefficient
    lifted_share: float = 0.001  # least share of elements expected to be lifted clear, for an inverse without them
    # Least nodes of a grid for repeated searches for elements lifted clear; a mirrored patch counts with its images.
    lifted_again_from: int = 2**20
    lifted_rounds: int = 3  # most searches for elements lifted clear on these grids; twice as many on a mirrored patch
    cut_every: int = 2  # iterations between two cuts of negative pressures
    sum_terms: float = 5.0  # most terms per node of the grid, for a sum in place of the convolution of cut pressures
    # Gap predicted on a surface that yields, up to which an element is a candidate, over the advance.
    yield_margin: float = 0.2
    # Residual that ends the iteration, as a share of the tolerance. The verification finds a little more.
    safety: float = 0.9
    # Residual at which one more step is trusted unmeasured, over the residual that ends the iteration.
    last_step: float = 4.0
    iterations: int = 2000  # most iterations of a round with M⁻¹. A weaker inverse gets as many
    rounds: int = 60  # most rounds of iteration and verification of a solve
    single_from: float = 2e-9  # least tolerance η/σ for directions and convolutions of 32 bits
    # Most elements in the rigid overlap for a start there. Larger overlaps are approached by rough states.
    cold_up_to: int = 20_000
    cold_step: float = 1.15  # ratio of the indentations of successive rough states
    cold_rtol: float = 1e-3  # tolerance η/σ of the rough states
    # Least points of a transform of the whole grid, for transforms of the rectangle of the candidates alone.
    windows_from: int = 2**20
    cache: int = 2**18  # bytes transformed at a time, to stay in the cache of a processor
    # Least columns copied at a time, to use whole lines of the cache. A quarter of them is transformed at a time.
    columns_together: int = 16
    band: int = 1024  # rows copied at a time. Each lies on another page of memory on large grids
    gauss_seidel: int = 100_000  # most Gauss-Seidel sweeps for one contact set of the paper's Algorithm 1


TUNING = Tuning()


@dataclass(frozen=True)
class SearchTuning:
    """Constants of the searches. They change the number of solves, and the answer within its accuracy."""

    first: float = 1e-1  # residual η/σ of the first solve, which only has to be near
    following: float = 3e-2  # residual η/σ of the solves before the bracket
    # Residual over the width of the bracket. Looser solves save no convolutions, as more of them are needed.
    useful: float = 3e-4
    inside: float = 0.05  # least distance of a trial from the ends of the bracket, over its width
    least_growth: float = 1.02  # least ratio of successive indentations before the bracket
    # Largest ratio of successive indentations before the bracket; its root where nothing tells how far the value is.
    most_growth: float = 2.0
    # Solves with the least growth. It is squared at each further one, as an area may wait for one deep pit.
    patience: int = 3
    line_accuracy: float = 2.0**-4  # accuracy of a root on a line, over its distance to the nearest state
    # Residual over distance of two states whose line is half as good a start as that of exact states.
    clear: float = 0.1
    sure: float = 4.0  # residuals by which two solves of one state may differ in x
    accuracy: float = 1e-6  # relative accuracy of the indentation for an area or a pressure
    solves: int = 200  # most solves of a search


SEARCH_TUNING = SearchTuning()


@dataclass(frozen=True)
class Options:
    """How states are solved. A value that is not allowed raises `ContactError`.

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
    tuning, search : Tuning, SearchTuning
        Constants of the solver, and of the searches.
    """

    rtol: float = 1e-6
    method: str = "fast"
    precision: str = "mixed"
    pressure_error: float | None = None
    hardness: float | None = None
    tuning: Tuning = TUNING
    search: SearchTuning = SEARCH_TUNING

    def __post_init__(self) -> None:
        if not 0 < real("rtol", self.rtol, ContactError) <= 1:
            raise ContactError(f"rtol is {self.rtol}; allowed: 0 < rtol <= 1 (a bound on the residual η/σ)")
        for name, value, allowed in (("method", self.method, METHODS), ("precision", self.precision, PRECISIONS)):
            if value not in allowed:
                raise ContactError(f"{name} is {value!r}; allowed: {', '.join(allowed)}")
        if not isinstance(self.tuning, Tuning):
            raise ContactError(f"tuning is a {type(self.tuning).__name__}; allowed: Tuning; a SearchTuning is search=…")
        if not isinstance(self.search, SearchTuning):
            raise ContactError(f"search is a {type(self.search).__name__}; allowed: SearchTuning; a Tuning is tuning=…")
        error, hardness = self.pressure_error, self.hardness
        if error is not None and not 0 < real("pressure_error", error, ContactError) <= 0.1:
            raise ContactError(f"pressure_error is {error}; allowed: 0 < pressure_error <= 0.1")
        if hardness is not None and not real("hardness", hardness, ContactError) > 0.0:
            raise ContactError(f"hardness is {hardness}; allowed: hardness > 0, in the unit of p*")
        if hardness is not None and self.method != "fast":
            raise ContactError(f"method {self.method!r} has no hardness; allowed: 'fast'")


DEFAULT = Options()
