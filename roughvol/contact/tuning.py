"""The constants of the contact solver: one frozen record, passed in as an argument.

None of them changes the answer beyond the residual asked for. They decide when something is worth its time.
`docs/solver-notebook.md` has the measurements behind each, with their commands.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tuning:
    """All constants of the solver and of its convolution.

    Attributes
    ----------
    dense_up_to : int
        Candidates up to which a Cholesky factorisation replaces the iteration.
    near_reach : float
        Distance of the farthest neighbours in a row of the near field G, in spacings; at most √8.
    block_side : int
        Elements along the side of a block of the far field.
    factorised_up_to : int
        Blocks up to which the operator between them is factorised, instead of put into blocks again.
    least_pivot : float
        Least pivot of the near field of blocks, as a share of the diagonal coefficient.
    lifted_share : float
        Share of the elements expected to be lifted clear, from which on the inverse is made without them.
    lifted_again_from : int
        Nodes of the grid from which on elements lifted clear are looked for more than once.
    lifted_rounds : int
        Times that they are looked for there, at most.
    cut_every : int
        Iterations from one cut of negative pressures to the next.
    sum_terms : float
        Terms of a sum per node of the grid, up to which a sum replaces the convolution of cut pressures.
    safety : float
        Residual of the iteration that ends it, as a share of the tolerance; the verification finds a little more.
    last_step : float
        Residual of the iteration, over the one that ends it, that one more step is trusted to remove unmeasured.
    iterations : int
        Iterations after which a solve is given up.
    rounds : int
        Rounds of iteration and verification after which a solve is given up.
    single_from : float
        Tolerance η/σ from which on directions and their convolutions are of 32 bits.
    cold_up_to : int
        Elements in the rigid overlap up to which a solve without states before it starts there.
    cold_step : float
        Ratio of successive indentations of the states on the way to a larger overlap.
    cold_rtol : float
        Tolerance η/σ of these states.
    windows_from : int
        Points of a transform of the whole grid from which on transforms cover only the rectangle of the candidates.
    cache : int
        Bytes transformed at a time, to stay in the cache of a processor.
    columns_together : int
        Columns copied at a time at least, to use whole lines of the cache; a quarter of them transformed at a time.
    band : int
        Rows copied at a time, each on another page of memory on large grids.
    """

    dense_up_to: int = 240
    near_reach: float = 5.0**0.5
    block_side: int = 8
    factorised_up_to: int = 256
    least_pivot: float = 0.05
    lifted_share: float = 0.001
    lifted_again_from: int = 2**20
    lifted_rounds: int = 3
    cut_every: int = 2
    sum_terms: float = 5.0
    safety: float = 0.9
    last_step: float = 4.0
    iterations: int = 2000
    rounds: int = 60
    single_from: float = 2e-9
    cold_up_to: int = 20_000
    cold_step: float = 1.15
    cold_rtol: float = 1e-3
    windows_from: int = 2**20
    cache: int = 2**18
    columns_together: int = 16
    band: int = 1024


TUNING = Tuning()
