"""Transport through the gap of a contact: the critical constriction, and flow.

Conventions
-----------
A gap field holds g ≥ 0 on square elements, axis 0 is x and axis 1 is y. An element is open where g > 0; contact is
closed. The void is 4-connected (through the sides of elements), the solid 8-connected (through corners as well). A
flow is then stopped by a chain of closed elements and by nothing less. Either void leads from side to side in x, or
solid does in y, and never both.

Flow along an axis obeys div(k grad P) = 0 with the local conductance k = g^n. n = 3 is the lubrication equation, and
its coefficient is the transmissivity. n = 1 is diffusion through the gap. P = 1 and P = 0 are imposed on the outer
edges of the first and the last line of elements, half an element from their centres. Nothing flows through the two
other sides or into closed elements. Finite volumes: two open neighbours are joined by the harmonic mean of their k, a
reservoir and its neighbour by 2k. Coefficients are over those of two smooth plates at the mean gap, contact included,
between the same reservoirs. Neither the unit of g nor the spacing enters.

Functions take the gap [any length], shape (rows, columns), and the axis of the flow, 0 for x, 1 for y. A gap that is
no 2-D field of finite numbers ≥ 0, and an exponent n that is not positive, are a `ContactError`.

Of a periodic surface, one period lies between the reservoirs, and the two other sides are joined. `cell_conduction` has
no reservoirs: the pressure falls by the same mean gradient in every period, and flows are those of the endless plane.

Decades of conductance
----------------------
g³ easily spans more decades than a double has digits. With h_c the critical constriction, every path contains an
element of conductance ≤ h_c^n, and one path has none below. Conductances above `_WINDOW` times h_c^n
are set to that value. Elements that conduct less than 1/`_WINDOW` of h_c^n count as closed. Both change the coefficient
by about 1/`_WINDOW`, and the matrix gets a condition that a factorisation can bear. The coefficient is taken from the
dissipation Σ k (δP)², because the error of P enters it squared. P is solved for as the difference to the nearer of the
two reservoirs. The flow in wide waters before and behind a constriction then keeps its digits.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from roughvol.gap.clusters import SIDES, check_exponent, check_gap, endless, labelled, percolates, spanned
from roughvol.gap.network import SOLVES, flow_through, harmonic, inverse
from roughvol.typing import Array, Mask

_WINDOW = 1e7


class Constriction(NamedTuple):
    """The narrowest place of the widest way: its gap h_c (0 if there is no way) and its element, row and column."""

    gap: float
    element: tuple[int, int] | None


class Conduction(NamedTuple):
    """A stationary flow along an axis.

    Attributes
    ----------
    coefficient : flow over that between two smooth plates at the mean gap.
    conservation_error : the larger of |inflow - flow| and |outflow - flow| over the flow, which the dissipation gives.
    flux : shape (2, rows, columns), flux along x and y in the middle of each element, over that between the plates.
    """

    coefficient: float
    conservation_error: float
    flux: Array


def constriction(gap: Array, axis: int, *, periodic: bool = False) -> Constriction:
    """Return the critical constriction: the largest h_c such that the elements with g ≥ h_c still percolate.

    Elements are taken in the order of falling gap, equal ones row by row. Bisection on this order finds the one that
    completes the first path, exactly.

    See Also
    --------
    conduction : Returns the flow through the gap.

    Examples
    --------
    >>> import numpy as np
    >>> from roughvol.gap.transport import constriction
    >>> gap = np.ones((4, 6))
    >>> gap[:, 2] = 0.5  # a throat across the flow along y
    >>> constriction(gap, axis=1).gap
    0.5
    """
    return _critical(gap, axis, functools.partial(percolates, axis=axis, periodic=periodic))


def _critical(gap: Array, axis: int, connected: Callable[[Mask], bool]) -> Constriction:
    """Return the largest gap at which the elements as wide as that are connected along an axis."""
    check_gap(gap)
    order = np.argsort(-gap, axis=None, kind="stable")
    rank = np.empty(gap.size, dtype=np.intp)
    rank[order] = np.arange(gap.size)
    ranks = rank.reshape(gap.shape)
    # a path takes at least one element of every line across it
    low, high = int(ranks.min(axis=1 - axis).max()) - 1, int(np.count_nonzero(gap)) - 1
    if high <= low or not connected(ranks <= high):
        return Constriction(0.0, None)
    while high - low > 1:
        middle = (low + high) // 2
        if connected(ranks <= middle):
            high = middle
        else:
            low = middle
    row, column = divmod(int(order[high]), gap.shape[1])
    return Constriction(float(gap[row, column]), (row, column))


def conduction(gap: Array, axis: int, exponent: float = 3.0, *, periodic: bool = False) -> Conduction:
    """Return the flow of div(g^n grad P) = 0 along an axis over that of two smooth plates at the mean gap.

    Solved by a sparse factorisation on the clusters that percolate; boundary values and normalisation as at the top of
    this module. The two coefficients of Vallet et al. (2009): transmissivity with n = 3, diffusivity with n = 1.

    See Also
    --------
    constriction : Returns the narrowest place of the widest way.

    Examples
    --------
    >>> import numpy as np
    >>> from roughvol.gap.transport import conduction
    >>> round(float(conduction(np.full((4, 4), 2.0), axis=0).coefficient), 9)  # two smooth plates
    1.0
    """
    check_exponent(exponent)
    critical = constriction(gap, axis, periodic=periodic).gap
    if critical == 0.0:
        return Conduction(0.0, 0.0, np.zeros((2, *gap.shape)))
    along = gap if axis == 0 else gap.T
    flowing, k = _conductance(along, critical, exponent, functools.partial(spanned, periodic=periodic))
    down = np.vstack([2.0 * k[:1], harmonic(k[:-1], k[1:]), 2.0 * k[-1:]])
    across = harmonic(k, np.roll(k, -1, axis=1))[:, : k.shape[1] - (not periodic)]
    flow = flow_through(down, across, flowing)
    inflow, outflow = float(flow.down[0].sum()), float(flow.down[-1].sum())
    # over the flux between the plates, as many elements apart, under the same drop of pressure
    over_plates = _over_plates(gap, critical, exponent) * along.shape[0]
    aside = np.pad(flow.across, ((0, 0), (1, 0)), mode="wrap") if periodic else np.pad(flow.across, ((0, 0), (1, 1)))
    flux = 0.5 * over_plates * np.stack([flow.down[1:] + flow.down[:-1], aside[:, 1:] + aside[:, :-1]])
    return Conduction(
        coefficient=flow.dissipation * over_plates / along.shape[1],
        conservation_error=max(abs(inflow - flow.dissipation), abs(outflow - flow.dissipation)) / flow.dissipation,
        flux=flux if axis == 0 else flux[::-1].transpose(0, 2, 1),
    )


def cell_conduction(gap: Array, axis: int, exponent: float = 3.0) -> float:
    """Return the flow through the endless plane of a periodic gap over that between two plates at the mean gap.

    The representative cell: div(g^n grad P) = 0, with P falling by the same mean gradient along the axis in every
    period, and no mean gradient across. The coefficient is the dissipation per element, Σ k (δP)²/N at one unit of mean
    gradient, over (mean g)^n. It is 0 where no void leads on from period to period without end.
    """
    check_exponent(exponent)
    along = gap if axis == 0 else gap.T
    critical = _critical(along, 0, endless).gap
    if critical == 0.0:
        return 0.0
    flowing, k = _conductance(along, critical, exponent)
    labels, _ = labelled(flowing, SIDES, (True, True))
    size = int(flowing.sum())
    first = np.zeros(along.shape, dtype=np.bool_)  # P is free to a constant in every cluster: its first element is held
    first.ravel()[np.unique(labels, return_index=True)[1][int(not flowing.all()) :]] = True
    number = np.full(along.shape, -1)
    free = size - int(first.sum())
    number[flowing & ~first], number[first] = np.arange(free), np.arange(free, size)
    joints = []
    for shift in (0, 1):
        w = harmonic(k, np.roll(k, -1, axis=shift))
        joins = w > 0.0
        beside = np.roll(number, -1, axis=shift)
        joints.append((number[joins], beside[joins], w[joins], np.full(np.count_nonzero(joins), 1.0 - shift)))
    tail, head, w, drop = (np.concatenate(parts) for parts in zip(*joints, strict=True))
    solve = inverse(tail, head, w, size, free)
    p = np.zeros(size)
    for _ in range(SOLVES):
        flux = w * (drop + p[tail] - p[head])
        surplus: Any = np.bincount(head, flux, size) - np.bincount(tail, flux, size)
        p[:free] += solve(surplus)
    drops = drop + p[tail] - p[head]
    return float((w * drops) @ drops / gap.size * _over_plates(gap, critical, exponent))


def _conductance(
    gap: Array, critical: float, exponent: float, connected: Callable[[Mask], Mask] = np.asarray
) -> tuple[Mask, Array]:
    """Return the connected elements of the window of conductances, and k over its critical value, 0 elsewhere.

    Logarithms: powers of a ratio of gaps can leave the range of doubles.
    """
    with np.errstate(divide="ignore"):
        log_k = exponent * (np.log(gap) - np.log(critical))
    flowing = connected(log_k >= -np.log(_WINDOW))
    return flowing, np.where(flowing, np.exp(np.clip(log_k, -np.log(_WINDOW), np.log(_WINDOW))), 0.0)


def _over_plates(gap: Array, critical: float, exponent: float) -> float:
    """Return the critical conductance over that of the mean gap."""
    largest = gap.max()
    log_mean = np.log(largest) - np.log(critical) + np.log(np.mean(gap / largest))
    return float(np.exp(-exponent * log_mean))
