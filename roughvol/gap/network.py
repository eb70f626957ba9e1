"""The linear problem of a flow: pressures on nodes that are joined by conductances, some of them held.

Σ w (P_i - P_j) over the neighbours j of node i = b_i: a symmetric M-matrix. Up to `DIRECT` unknowns it is factorised
(SuperLU). Its memory grows faster than the unknowns. Beyond, conjugate gradients are preconditioned by smoothed
aggregation (pyamg, an optional dependency), in memory proportional to the unknowns. gas-leak.md has the measured
memory.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse import linalg as sparse_linalg

from roughvol.errors import ContactError, ConvergenceError
from roughvol.typing import Array, Index, Mask

DIRECT = 2_000_000  # unknowns
EXTRA = "pip install 'roughvol[large]'"
REDUCTION = 1e-8  # of the residual in one solve with multigrid; callers refine
ITERATIONS = 400  # of conjugate gradients; a solve without convergence is an error
# an M-matrix needs no pivoting, so the order may follow the sparsity alone
_SPLU: dict[str, Any] = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}


def inverse(tail: Index, head: Index, weight: Array, nodes: int, free: int) -> Callable[[Array], Array]:
    """Return the function from the inflow of every node to the pressures of the free nodes.

    The first ``free`` nodes are free, the others held at 0. A joint leads from its tail to its head with a conductance
    > 0. More than `DIRECT` unknowns without pyamg are a `ContactError`.
    """
    diagonal: Any = np.bincount(tail, weight, nodes) + np.bincount(head, weight, nodes)
    if free > DIRECT:
        return _multigrid(tail, head, weight, diagonal[:free])
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))  # a held node may have no neighbour
    off, own = -weight * scale[tail] * scale[head], np.arange(nodes)
    places = np.concatenate([own, tail, head]), np.concatenate([own, head, tail])
    matrix = sparse.csc_matrix((np.concatenate([np.ones(nodes), off, off]), places))[:free, :free]
    factor = sparse_linalg.splu(matrix, **_SPLU)
    return lambda inflow: scale[:free] * factor.solve((scale * inflow)[:free])


def needs_multigrid(unknowns: float) -> bool:
    """Return whether a flow of that many unknowns is beyond the direct solver."""
    return unknowns > DIRECT


def check_multigrid(unknowns: int) -> None:
    """Refuse a flow beyond the direct solver where pyamg is not installed."""
    if needs_multigrid(unknowns):
        _pyamg(unknowns)


def _pyamg(unknowns: int) -> Any:
    try:
        import pyamg
    except ImportError as error:
        needs = f"a flow through {unknowns} elements needs pyamg, the direct solver takes up to {DIRECT}"
        raise ContactError(f"{needs}: {EXTRA}, or record a smaller region") from error
    return pyamg


def _multigrid(tail: Index, head: Index, weight: Array, diagonal: Array) -> Callable[[Array], Array]:
    free = diagonal.size
    pyamg = _pyamg(free)
    inner = (tail < free) & (head < free)
    one, other, off = tail[inner].astype(np.int32), head[inner].astype(np.int32), -weight[inner]
    del inner
    upper = sparse.csr_matrix((off, (one, other)), shape=(free, free))
    del one, other, off
    matrix = sparse.csr_matrix(upper + upper.T + sparse.dia_matrix((diagonal[None], [0]), shape=(free, free)))
    del upper
    # conductances of one element spread over decades: weak joints (below 0.03) must not be aggregated
    strength = ("symmetric", {"theta": 0.03})
    hierarchy = pyamg.smoothed_aggregation_solver(matrix, strength=strength, max_coarse=500)

    def solve(inflow: Array) -> Array:
        residuals: list[float] = []
        options = {"tol": REDUCTION, "accel": "cg", "maxiter": ITERATIONS, "residuals": residuals}
        pressure: Array = hierarchy.solve(inflow[:free], **options)
        left = residuals[-1] / residuals[0] if residuals[0] > 0.0 else 0.0
        if not left <= 10 * REDUCTION:
            message = f"the flow through {free} open elements did not converge, residual {left:.1e} of the first"
            raise ConvergenceError(message, indentation=np.nan, iterations=len(residuals) - 1, residual=left)
        return pressure

    return solve


SOLVES = 3  # the first solves, the second gives u the digits that P has not, the third takes rounding off


class Flow(NamedTuple):
    """Fluxes through the faces of a field of shape (rows, columns), for a drop of pressure from 1 to 0.

    Attributes
    ----------
    down : shape (rows + 1, columns), from the inlet to the outlet.
    across : shape (rows, columns - 1), or one column more with the faces between the last and the first of a period.
    dissipation : power, which equals the flow.
    pressure : shape (rows, columns), NaN where nothing flows.
    """

    down: Array
    across: Array
    dissipation: float
    pressure: Array


def flow_through(down: Array, across: Array, flowing: Mask) -> Flow:
    """Return the flow along axis 0 between P = 1 and P = 0 through the faces of connected elements.

    Unknown is u = P - R with R = 0 or 1, whichever is nearer. Where P differs from a reservoir by less than rounding, u
    and the flux it drives still have all their digits.

    Parameters
    ----------
    down : ndarray, shape (rows + 1, columns)
        Conductances ≥ 0 of the faces across axis 0, those to the reservoirs included.
    across : ndarray, shape (rows, columns - 1) or (rows, columns)
        Conductances ≥ 0 of the faces across axis 1; with as many columns as elements, opposite sides are joined.
    flowing : ndarray of bool, shape (rows, columns)
        Elements that conduct; no face of another one has a conductance.

    Returns
    -------
    Flow
        Fluxes, their dissipation, and pressures.
    """
    size = int(np.count_nonzero(flowing))
    rows, columns = flowing.shape
    kind = np.int32 if size < 2**31 - 2 else np.int64
    number = np.full((rows + 2, columns), size, dtype=kind)  # the inlet follows the elements, the outlet the inlet
    number[-1] = size + 1
    number[1:-1][flowing] = np.arange(size, dtype=kind)
    beside = np.roll(number[1:-1], -1, axis=1)[:, : across.shape[1]]
    joins_down, joins_across = down > 0.0, across > 0.0
    tail = np.concatenate([number[:-1][joins_down], number[1:-1, : beside.shape[1]][joins_across]])
    head = np.concatenate([number[1:][joins_down], beside[joins_across]])
    w = np.concatenate([down[joins_down], across[joins_across]])
    del number, beside
    solve = inverse(tail, head, w, size + 2, size)
    u, nearer = np.zeros(size + 2), np.zeros(size + 2)
    nearer[size] = 1.0

    def drops() -> Array:
        return (nearer[tail] - nearer[head]) + (u[tail] - u[head])

    for attempt in range(SOLVES):
        flux = w * drops()
        surplus: Any = np.bincount(head, flux, size + 2) - np.bincount(tail, flux, size + 2)
        u[:size] += solve(surplus)
        if attempt == 0:
            nearer[:size] = u[:size] > 0.5
            u[:size] -= nearer[:size]
    flux = w * drops()
    through, aside = np.zeros(down.shape), np.zeros(across.shape)
    through[joins_down], aside[joins_across] = np.split(flux, [np.count_nonzero(joins_down)])
    pressure = np.full(flowing.shape, np.nan)
    pressure[flowing] = nearer[:size] + u[:size]
    return Flow(through, aside, float(flux @ drops()), pressure)


def harmonic(a: Array, b: Array) -> Array:
    """Return 2ab/(a + b), 0 where one of them is."""
    both = (a > 0.0) & (b > 0.0)
    mean: Array = np.divide(2.0 * a * b, a + b, out=np.zeros(a.shape), where=both)
    return mean
