"""Kernels: displacement of the elements around one element under a unit pressure on it.

Lattice units, see `halfspace`: u = δ/(π E*) Σ K(i - k, j - l) p. K is even along both axes. Waves of pressure displace
a period of n × n' elements in proportion, u(q) = λ(q) p(q)::

    kernel love:     Love's coefficients summed over all images. With f = q δ/2π and sinc f = sin(π f)/(π f),
                     λ(f) = Σ_m sinc(f₁ + m₁) sinc(f₂ + m₂)/|f + m|        over all pairs m of whole numbers
    kernel punch:    the coefficients of the punch, summed in the same way
    kernel fourier:  λ(f) = 1/|f|, the half space 2/(E* q) itself, on the waves of the grid
    kernel layer:    an elastic layer bonded to a rigid base. 1/|f + m| becomes its λ(|f + m|), on elements or on waves

in units δ/(π E*). The displacement of a half space under a uniform pressure is infinite. It is replaced by λ(0) = π n,
n being the larger number of elements: the mean displacement over σ is p*, on a square. This number has no effect on
pressures and gaps. It only relabels the indentation,

    Δ' = Δ + mean(u) = Δ + p*        over σ,

where Δ is that of the mean planes, and Δ' is the approach at which the solver solves. The mean displacement of a layer
is finite, but Δ, d and Δ' have the same meaning: the rigid base comes nearer by Δ and by the compression of the layer
under the nominal pressure, p h (1 + ν)(1 - 2ν)/(E (1 - ν)), which no pressure and no gap depends on.

With λ(0) the inverse of the Love operator is an M-matrix (test_kernels), and docs/explanation/solver.md applies as it
stands. The inverse of the operator of a layer is none: its surface bulges beside a pressed element.
"""

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import scipy

from roughvol.errors import ContactError
from roughvol.typing import Array, Index, Shape

_SERIES_FROM = 64.0  # spacings; the two forms are equally exact there (test_kernels, love_kernel)
# The split of 1/r into near and far: erfc(r/2)/r vanishes to rounding beyond 13 spacings, and the transform of the
# rest, erfc(2π|f|)/|f|, beyond |f| = 1.
_WIDTH, _NEAR = 0.5, 13
_POINTS = 16  # of the Gauss-Legendre rule over an element; the far part is smooth
_DEEP = 4.0  # thicknesses in a wave from which on a layer is a half space: e^-50
LEAST_LAYER = 0.25  # spacings, of a layer on elements; of a thinner one too many aliases differ from the half space
_REACH = 200  # spacings; punch and Love differ by 0.02/r⁵ there


@dataclass(frozen=True)
class Kernel:
    """The elastic body as a half space sees it: influence coefficients, or displacement of waves.

    Two kernels of equal name and parameters are the same. Lengths are in spacings.

    Attributes
    ----------
    parameters : tuple of float
        Numbers of the elastic body, such as thickness and ν of a layer.
    coefficients : callable, optional
        (x, y) ↦ K at offsets ≥ 0. Default: none, for a kernel of periodic half spaces alone.
    spectrum : callable, optional
        (f₁, f₂) ↦ displacement under a unit wave of f periods per spacing, on a periodic half space; any value at 0.
        Default: the coefficients summed over images. They then differ from Love's as 1/r⁵ at most.
    waves : callable, optional
        |f| ↦ displacement under a unit wave over 1/|f|, for elements under uniform pressure; 1 from `reach` on.
    m_matrix : bool
        Whether K⁻¹ is an M-matrix, see solver.md: overlaps at the hardness are never undone on a leg of a path.
    """

    name: str
    parameters: tuple[float, ...] = ()
    coefficients: Callable[[Array, Array], Array] | None = field(default=None, compare=False, repr=False)
    spectrum: Callable[[Array, Array], Array] | None = field(default=None, compare=False, repr=False)
    waves: Callable[[Array], Array] | None = field(default=None, compare=False, repr=False)
    reach: float = field(default=0.0, compare=False)
    m_matrix: bool = field(default=False, compare=False)

    def quadrant(self, shape: Shape) -> Array:
        """Return K(i, j) for the offsets 0 ≤ i < rows, 0 ≤ j < columns."""
        if self.coefficients is None:
            allowed = ", ".join(kernel.name for kernel in KERNELS.values() if kernel.coefficients)
            raise ContactError(f"kernel is {self.name!r}; allowed on a free patch: {allowed}")
        row, column = (np.arange(float(n)) for n in shape)
        return np.ascontiguousarray(self.coefficients(row[:, None], column))


def love_kernel(x: Array, y: Array) -> Array:
    r"""Return Love's influence coefficients of a unit square element at offsets x, y ≥ 0 in spacings, off its edge.

    .. math:: K(x, y) = \int_{-1/2}^{1/2}\int_{-1/2}^{1/2} \frac{dξ\,dη}{\sqrt{(x-ξ)^2 + (y-η)^2}}

    The closed form loses digits as ε r². Beyond 64 spacings the multipole series up to fourth moments replaces it: the
    relative error is below 1e-13. A. E. H. Love, Phil. Trans. R. Soc. A 228 (1929) 377-420; K. L. Johnson, Contact
    Mechanics (1985), eq. 3.25.
    """
    x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    kernel = np.empty(x.shape)
    far = np.hypot(x, y) > _SERIES_FROM
    kernel[far] = _love_far(x[far], y[far])
    kernel[~far] = _love_near(x[~far], y[~far])
    return kernel


def _love_near(x: Array, y: Array) -> Array:
    """Return the closed form over the four corners, with ``log1p``, which keeps all digits along the axes."""
    a, b, c, d = x + 0.5, x - 0.5, y + 0.5, y - 0.5  # corner offsets; b, d ≥ -1/2
    ac, ad, bc, bd = np.hypot(a, c), np.hypot(a, d), np.hypot(b, c), np.hypot(b, d)

    def pair(s: Array, t_hi: Array, t_lo: Array, r_hi: Array, r_lo: Array) -> Array:
        # s ln[(t_hi + r_hi) / (t_lo + r_lo)]; the denominator is positive: t_lo ≥ -1/2, and s ≠ 0 at every node
        return s * np.log1p(((t_hi - t_lo) + (t_hi - t_lo) * (t_hi + t_lo) / (r_hi + r_lo)) / (t_lo + r_lo))

    # r_hi - r_lo = (t_hi² - t_lo²) / (r_hi + r_lo), as both share s: no cancellation in the difference of radii
    return pair(a, c, d, ac, ad) - pair(b, c, d, bc, bd) + pair(c, a, b, ac, bc) - pair(d, a, b, ad, bd)


def _love_far(x: Array, y: Array) -> Array:
    """Return 1/r + ∇²(1/r)/24 + fourth moments of a unit square."""
    x2, y2 = x * x, y * y
    r2 = x2 + y2
    r = np.sqrt(r2)
    # derivatives of 1/r in the plane: ∂⁴ₓ = (9 - 90 x²/r² + 105 x⁴/r⁴)/r⁵, ∂²ₓ∂²_y = (105 x² y²/r⁴ - 12)/r⁵
    r5 = r2 * r2 * r
    fourth_x = (9.0 - 90.0 * x2 / r2 + 105.0 * (x2 / r2) ** 2) / r5
    fourth_y = (9.0 - 90.0 * y2 / r2 + 105.0 * (y2 / r2) ** 2) / r5
    mixed = (105.0 * x2 * y2 / r2**2 - 12.0) / r5
    return 1.0 / r + 1.0 / (24.0 * r2 * r) + (fourth_x + fourth_y) / 1920.0 + mixed / 576.0


def punch_kernel(x: Array, y: Array) -> Array:
    """Return the coefficients of a punch, 2 on itself, 2 asin(1/(2 r)) on others, → 1/r; K⁻¹ is no M-matrix."""
    r = np.hypot(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
    kernel = np.full(r.shape, 2.0)
    away = r > 0
    kernel[away] = 2.0 * np.arcsin(0.5 / r[away])
    return kernel


def layer(thickness: float, nu: float, elements: bool = True) -> Kernel:
    r"""Return the kernel of an elastic layer bonded to a rigid base, of elements under uniform pressure or of waves.

    .. math:: λ(f) = \frac{1}{f} \frac{κ \sinh 2ζ - 2ζ}{κ \cosh 2ζ + 2ζ^2 + (1 + κ^2)/2}, κ = 3 - 4ν, ζ = 2πfh

    The thickness h is in spacings. Waves much shorter than h see a half space. Under much longer waves a compressible
    layer is a mattress of springs, λ = π h (1 - 2ν)/(1 - ν)². K. L. Johnson, Contact Mechanics (1985), p. 139.
    """
    least = LEAST_LAYER if elements else 0.0
    if not (0.0 < thickness < np.inf and thickness >= least and -1.0 < nu <= 0.5):
        allowed = f"thickness {f'>= {least}' if elements else '> 0'}, -1 < nu <= 0.5"
        raise ContactError(f"the layer has a thickness of {thickness:.6g} spacings, nu = {nu}; allowed: {allowed}")
    k = 3.0 - 4.0 * nu

    def waves(f: Array) -> Array:
        x = 4.0 * np.pi * np.minimum(f, _DEEP / thickness) * thickness  # 2ζ; a half space from there on
        x2 = x * x
        # sinh x - x without the loss of digits of long waves
        series = x * x2 / 6.0 * (1.0 + x2 / 20.0 * (1.0 + x2 / 42.0 * (1.0 + x2 / 72.0 * (1.0 + x2 / 110.0))))
        rest = np.where(x < 0.5, series, np.sinh(x) - x)
        ratio: Array = ((k - 1.0) * np.sinh(x) + rest) / (k * np.cosh(x) + 0.5 * x2 + 0.5 * (1.0 + k * k))
        return ratio

    parameters = (thickness, nu, float(elements))
    if elements:
        return Kernel("layer", parameters, waves=waves, reach=_DEEP / thickness)

    def spectrum(row: Array, column: Array) -> Array:
        f = _frequency(row, column)
        displacement: Array = waves(f) / f
        return displacement

    return Kernel("layer", parameters, spectrum=spectrum)


def _frequency(row: Array, column: Array) -> Array:
    """Return |f|, infinite for the mean."""
    f: Array = np.hypot(row, column)
    f[f == 0.0] = np.inf
    return f


LOVE = Kernel("love", coefficients=love_kernel, m_matrix=True)
PUNCH = Kernel("punch", coefficients=punch_kernel)
FOURIER = Kernel("fourier", spectrum=lambda row, column: 1.0 / _frequency(row, column))
KERNELS = {kernel.name: kernel for kernel in (LOVE, PUNCH, FOURIER)}
MADE: dict[str, Callable[..., Kernel]] = {"layer": layer}
"""Kernels with a length by name: lengths in spacings and numbers ↦ kernel."""


def kernel_of(kernel: Kernel | str, **made_of: float) -> Kernel:
    """Return a kernel, the kernel of a name, or the kernel made of lengths in spacings and numbers."""
    if isinstance(kernel, Kernel):
        return kernel
    if kernel in MADE:
        if not made_of:
            raise ContactError(f"kernel is {kernel!r}; allowed: roughvol.contact.kernels.{kernel}(…)")
        return MADE[kernel](**made_of)
    if kernel not in KERNELS:
        raise ContactError(f"kernel is {kernel!r}; allowed: {', '.join((*KERNELS, *MADE))}")
    return KERNELS[kernel]


def influence_matrix(influence: Array, elements: Index, *, mirrored: bool = False) -> Array:
    """Return K (n, n) between elements, by their flat indices on the grid of the coefficients.

    If `mirrored`, these are Kp of the doubled period, (rows + 1, columns + 1): K(i, k) = Kp(i - k) + Kp(i + k + 1).
    """
    if mirrored:
        nodes = influence.shape[0] - 1, influence.shape[1] - 1
        rows, columns = (_mirrored_offsets(x, n) for x, n in zip(np.divmod(elements, nodes[1]), nodes, strict=True))
        whole: Array = np.sum([influence[i, j] for i in rows for j in columns], axis=0)
        return whole
    width = np.int32(influence.shape[1])
    row, column = np.divmod(elements.astype(np.int32), width)
    offset = np.abs(np.subtract.outer(row, row))
    offset *= width
    across = np.subtract.outer(column, column)
    offset += np.abs(across, out=across)
    matrix: Array = influence.ravel().take(offset)
    return matrix


def _mirrored_offsets(place: Index, nodes: int) -> tuple[Index, Index]:
    """Return the offsets between elements along an axis, and those to their nearest images."""
    return np.abs(np.subtract.outer(place, place)), short_way(np.add.outer(place, place) + 1, nodes)


def short_way(offset: Index, nodes: int) -> Index:
    """Return offsets from 0 to 2n around the period of n elements and their images, the short way."""
    short: Index = np.minimum(offset, 2 * nodes - offset)
    return short


def periodic_spectrum(shape: Shape, kernel: Kernel = LOVE) -> Array:
    """Return λ [δ/(π E*)] of the waves of 0, 1, … periods, (rows // 2 + 1, columns // 2 + 1); λ(0) = π max(shape).

    K. L. Johnson, Contact Mechanics (1985), Section 13.2 (waves on a half space); P. P. Ewald, Ann. Phys. 369 (1921)
    253-287 (the sum over images, split in two that converge fast).
    """
    row, column = (np.arange(n // 2 + 1) / n for n in shape)
    if kernel.spectrum is not None:
        spectrum = kernel.spectrum(row[:, None], column)
    else:
        spectrum = _far_part(row[:, None], column, kernel) + _wave_sums(_near_part(), shape)
        if kernel.coefficients is not None and kernel != LOVE:  # images far away do not count in the difference
            reach = (_REACH + 1, _REACH + 1)
            spectrum += _wave_sums(kernel.quadrant(reach) - LOVE.quadrant(reach), shape)
    spectrum[0, 0] = math.pi * max(shape)
    return spectrum


def _far_part(row: Array, column: Array, kernel: Kernel) -> Array:
    """Return the sum over aliases of the waves of erf(r/2)/r, spread over elements; those beyond |f| = 1 vanish.

    Another body than a half space adds λ - 1/|f|, in an order that loses no digit of a small λ.
    """
    total = np.zeros(np.broadcast_shapes(row.shape, column.shape))
    aliases = sorted(range(-1 - math.ceil(kernel.reach), 1 + math.ceil(kernel.reach)), key=abs)
    for i, j in itertools.product(aliases, repeat=2):
        f = _frequency(row + i, column + j)
        turn = np.pi * f / _WIDTH
        waves = scipy.special.erfc(turn) if kernel.waves is None else kernel.waves(f) - scipy.special.erf(turn)
        total += np.sinc(row + i) * np.sinc(column + j) * waves / f
    return total


@functools.cache
def _near_part() -> Array:
    """Return the displacement by a unit element under erfc(r/2)/r: Love's, less a smooth integral. Offsets ≥ 0."""
    offset = np.arange(_NEAR + 1.0)
    node, weight = np.polynomial.legendre.leggauss(_POINTS)
    along = offset[:, None] - 0.5 * node
    r = np.hypot(along[:, None, :, None], along[None, :, None, :])
    smooth = np.where(
        r > 0.0, scipy.special.erf(_WIDTH * r) / np.where(r > 0.0, r, 1.0), 2.0 * _WIDTH / math.sqrt(math.pi)
    )
    return love_kernel(offset[:, None], offset) - 0.25 * np.einsum("ijkl,k,l->ij", smooth, weight, weight)


def _wave_sums(coefficients: Array, shape: Shape) -> Array:
    """Return Σ_r K(r) cos(2π f₁ r₁) cos(2π f₂ r₂) on the waves of the grid, K even and given for offsets ≥ 0."""
    twice = coefficients.copy()
    twice[1:] *= 2.0
    twice[:, 1:] *= 2.0
    reach = np.arange(len(coefficients))
    # the phase modulo one turn, exactly
    row, column = (np.cos(2.0 * np.pi * (np.outer(np.arange(n // 2 + 1), reach) % n) / n) for n in shape)
    sums: Array = row @ twice @ column.T
    return sums
