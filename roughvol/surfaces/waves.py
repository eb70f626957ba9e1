"""Random surfaces with a power-law spectrum: Gaussian heights, or skewed ones with the same spectrum.

Conventions: the field is z(x) = Σ c_k exp(2πi k·x/L) over wave vectors k = (i, j) of whole numbers, with c_{-k} the
conjugate of c_k. The waves are those of `spectrum`, k_e < L/λ_s with k_e = √((ε i)² + j²) and ε the anisotropy. A grid
of n × n nodes, L/n apart, holds the waves of |k| < n/2: coarser grids are the same field with the high waves cut.

SurfaceTopography (``fourier_synthesis``) and rfgen make such fields too. They draw their random numbers for the whole
grid, so equal seeds on two grids are other surfaces. GSTools sums modes node by node, for covariance models without a
roll-off and a cut-off. Here the numbers are drawn wave by wave, low waves first: levels of an ensemble are nested. For
other height distributions rfgen orders ranks (IAAFT). The transform here is smooth, and gives Ssk itself.
"""

from __future__ import annotations

import functools
import math

import numpy as np
import scipy
from numpy.typing import NDArray

from roughvol.errors import SurfaceError
from roughvol.surfaces.spectrum import Spectrum
from roughvol.surfaces.surface import Surface, positive, real, whole
from roughvol.typing import Array, Index

Waves = NDArray[np.complex128]  # shape (2R + 1, R + 1): rows i = 0 … R, -R … -1, columns j = 0 … R

LARGEST_N = 2**13
STRONGEST = 3.0  # parameter of the translation; beyond, the skewness of most fields no longer grows
REPEATED = 2  # translations
NEAR = 0.5


def power_law_surface(spectrum: Spectrum, hurst: float, n: int, *, side: float = 1.0, seed: int = 0) -> Surface:
    """Return a random surface with a power-law spectrum (see `spectrum` for the law, λ_L, λ_r and λ_s).

    The amplitudes are ``|c_k|² ~ C(k_e) (a² + b²)/2`` with standard normal a and b, and the phases those of a + i b.
    With ``phases="random"`` (a² + b²)/2 is 1. The period is scaled to Sq or to h'_rms, exactly: all its waves count,
    also those that a coarse grid cannot hold. The sample mean is zero.

    A skewness is given by a translation field: a monotone transform of the Gaussian field, whose waves then get their
    amplitudes back. The spectrum is exactly that of the Gaussian field of the same seed. The skewness is exact to 1e-8
    on the grid of the smallest power of two n ≥ 2 L/λ_s. The rest of the height distribution is near Pearson's type III
    and not exactly it: the mean kurtosis is 3 + 1.5 Ssk² to 10 %
    for abs(Ssk) ≤ 1.

    Parameters
    ----------
    spectrum : Spectrum
        Roll-off, cut-off, amplitude, skewness, anisotropy, phases, and whether one period or a patch.
    hurst : float
        Hurst exponent, 0 < H < 1.
    n : int
        Nodes per side of the period, even, 8 … 8192.
    side : float
        Length L of the period [length]; the spacing is L/n.
    seed : int
        Seed ≥ 0. The stream is drawn ring by ring of max(abs(i), abs(j)) and depends on nothing else. Equal seeds have
        the same low waves at any n, and are matched pairs in H and all parameters.

    Returns
    -------
    Surface
        Heights of shape (n, n) if periodic. Else of shape (n + 1, n + 1): the closed period, whose last row and column
        repeat the first.

    Raises
    ------
    SurfaceError
        If an argument lies outside its interval, or no translation of this field has the skewness.

    See Also
    --------
    random_midpoint_displacement : Returns a surface by midpoint displacement.

    Examples
    --------
    >>> from roughvol.surfaces import Spectrum, power_law_surface
    >>> surface = power_law_surface(Spectrum(rolloff=4, cut=16), hurst=0.8, n=32, side=100.0, seed=1)
    >>> surface.shape, round(surface.scaled(0.5).Sq, 6)
    ((32, 32), 0.5)
    """
    hurst, side = real("H", hurst), positive("side", side)
    n, seed = whole("n", n, 8, LARGEST_N), whole("seed", seed, 0)
    _check(spectrum, hurst, n)
    waves = skewed(_scaled(gaussian_waves(spectrum, hurst, seed), spectrum, side), spectrum)
    heights = _on_grid(waves, n)
    if not spectrum.periodic:
        return Surface(np.pad(heights, (0, 1), mode="wrap"), side / n)
    return Surface(heights, side / n, sides="periodic")


def gaussian_waves(spectrum: Spectrum, hurst: float, seed: int) -> Waves:
    """Return the waves of a Gaussian field of any amplitude, c_k = √C(k_e) (a + i b)/√2."""
    radius = math.ceil(spectrum.cut) - 1
    # Generator and bit generator are both named: `default_rng` may change its mind between versions.
    normal = np.random.Generator(np.random.PCG64(seed)).standard_normal
    waves = np.zeros((2 * radius + 1, radius + 1), dtype=np.complex128)
    for ring in range(1, radius + 1):
        # The order is part of what a seed means: changing it changes every surface.
        drawn = normal((4 * ring, 2)).view(np.complex128)[:, 0]
        waves[np.arange(-ring, ring + 1), ring] = drawn[: 2 * ring + 1]
        waves[ring, :ring] = drawn[2 * ring + 1 : 3 * ring + 1]
        waves[-ring, 1:ring] = drawn[3 * ring + 1 :]
    waves[radius + 1 :, 0] = waves[radius:0:-1, 0].conj()  # z is real
    law = _moduli(spectrum, hurst)
    if spectrum.phases == "random":
        return _with_moduli(waves, law)
    return waves * (law / math.sqrt(2.0))


def density(spectrum: Spectrum, hurst: float, side: float, wave: Array) -> Array:
    """Return the isotropic power spectral density of the law at k = q L/(2π), from the waves that a period has.

    An integral in place of their sum counts no wave below k = 1. C0 would be 1.7 times as large without a roll-off.
    """
    moduli = _scaled(_moduli(spectrum, hurst).astype(np.complex128), spectrum, side)
    plateau = side * float(moduli[0, 1].real)  # √C0, from C = |c_k|² L²
    law: Array = (plateau * np.maximum(wave / spectrum.rolloff, 1.0) ** (-1.0 - hurst)) ** 2
    return np.where((wave >= 1.0) & (wave < spectrum.cut), law, 0.0)


def _moduli(spectrum: Spectrum, hurst: float) -> Array:
    """Return √C(k_e) of all waves, of any amplitude."""
    i, j = _indices(math.ceil(spectrum.cut) - 1)
    ratio = np.hypot(spectrum.anisotropy * i, j)
    law = np.maximum(ratio, spectrum.rolloff) ** (-1.0 - hurst)
    law[(ratio >= spectrum.cut) | (ratio == 0.0)] = 0.0
    return law


def share_below(spectrum: Spectrum, hurst: float, seed: int, cut: float) -> float:
    """Return the share of Sq, or of the slope where it is given, that the waves of k_e < ``cut`` of a field have."""
    waves = gaussian_waves(spectrum, hurst, seed)  # a translation keeps their amplitudes
    i, j = _indices(waves.shape[1] - 1)
    power = np.abs(waves) ** 2 * (1.0 if spectrum.slope is None else i * i + j * j)
    low = np.where(np.hypot(spectrum.anisotropy * i, j) < cut, power, 0.0)
    return math.sqrt(_total(low) / _total(power))


def skewed(waves: Waves, spectrum: Spectrum) -> Waves:
    """Return the waves of a field with the skewness of a spectrum and the amplitudes of the given one.

    A translation is z ↦ f_s(z/σ) followed by the given amplitudes with the phases of its waves. It is repeated twice.
    f_s is Wilson and Hilferty's cube (1931), the nearly exact map from a normal variable to one of Pearson's type III
    of skewness s,

        f_s(y) = (2/s) ((1 + s y/6 - s²/36)³ - 1),

    monotone in y for every s. The parameter s is searched for until Ssk of the result is met.
    """
    if spectrum.Ssk is None:
        return waves
    wanted, moduli = spectrum.Ssk, np.abs(waves)
    n = _smallest_grid(spectrum.cut)
    deviation = math.sqrt(_total(moduli**2))

    def translated(parameter: float) -> Waves:
        turned = waves
        for _ in range(REPEATED):
            turned = _with_moduli(_off_grid(_translation(_on_grid(turned, n) / deviation, parameter), waves), moduli)
        return turned

    @functools.cache
    def excess(parameter: float) -> float:
        return float(np.mean((_on_grid(translated(parameter), n) / deviation) ** 3)) - wanted

    below, above = max(wanted - NEAR, -STRONGEST), min(wanted + NEAR, STRONGEST)  # most often the parameter is there
    if not excess(below) <= 0.0 <= excess(above):
        below, above = -STRONGEST, STRONGEST
    if not excess(below) <= 0.0 <= excess(above):
        low, high = wanted + excess(below), wanted + excess(above)
        raise SurfaceError(f"Ssk = {wanted:g} is out of reach of these waves; allowed: {low:.2f} to {high:.2f}")
    return translated(scipy.optimize.brentq(excess, below, above, xtol=1e-11, rtol=1e-11))


def _translation(y: Array, s: float) -> Array:
    """Return f_s(y) of `skewed`, written so that it is y at s = 0."""
    u = s * y / 6.0 - s * s / 36.0
    result: Array = (y - s / 6.0) * (1.0 + u + u * u / 3.0)
    return result


def _scaled(waves: Waves, spectrum: Spectrum, side: float) -> Waves:
    """Return waves scaled to Sq or to h'_rms of the period."""
    power = np.abs(waves) ** 2
    if spectrum.slope is not None:
        i, j = _indices(waves.shape[1] - 1)
        slope = 2.0 * math.pi / side * math.sqrt(_total(power * (i * i + j * j)))
        return waves * (spectrum.slope / slope)
    return waves * (spectrum.Sq / math.sqrt(_total(power)))


def _total(values: Array) -> float:
    """Return the sum over all waves: those of j > 0 count for their conjugates as well."""
    return float(values[:, 0].sum() + 2.0 * values[:, 1:].sum())


def _indices(radius: int) -> tuple[Array, Array]:
    """Return i and j of the waves, to broadcast."""
    return _rows(radius).astype(np.float64)[:, None], np.arange(radius + 1, dtype=np.float64)[None, :]


def _rows(radius: int) -> Index:
    """Return i of the rows of waves, 0 … R, -R … -1."""
    return np.concatenate([np.arange(radius + 1), np.arange(-radius, 0)])


def _smallest_grid(cut: float) -> int:
    """Return the smallest power of two that is at least twice L/λ_s."""
    return max(8, 2 ** math.ceil(math.log2(2.0 * cut)))


def _on_grid(waves: Waves, n: int) -> Array:
    """Return the heights on a grid of n × n nodes, from its waves of |k| < n/2."""
    radius = waves.shape[1] - 1
    held = min(radius, n // 2 - 1)
    rows = _rows(held)
    grid = np.zeros((n, n // 2 + 1), dtype=np.complex128)
    part = waves[rows, : held + 1]
    if radius > held:
        part = np.where(np.hypot(rows[:, None], np.arange(held + 1)) < n / 2, part, 0.0)
    grid[rows, : held + 1] = part
    return np.fft.irfft2(grid, s=(n, n), norm="forward")


def _off_grid(heights: Array, like: Waves) -> Waves:
    """Return the waves of heights, those that another field has."""
    radius = like.shape[1] - 1
    return np.fft.rfft2(heights, norm="forward")[_rows(radius), : radius + 1]


def _with_moduli(waves: Waves, moduli: Array) -> Waves:
    """Return the phases of waves with other moduli."""
    own = np.abs(waves)
    own[own == 0.0] = 1.0
    return waves * (moduli / own)


def _check(spectrum: Spectrum, hurst: float, n: int) -> None:
    """Refuse what lies outside its interval."""
    rolloff, cut, stretch = (real(name, getattr(spectrum, name)) for name in ("rolloff", "cut", "anisotropy"))
    finite = math.isfinite(cut) and math.isfinite(stretch)
    rules = (
        (0.0 < hurst < 1.0, f"H must be in (0, 1), got {hurst!r}"),
        (n % 2 == 0, f"n must be even, got {n!r}"),
        (rolloff >= 1.0, f"rolloff = L/λ_r must be >= 1, got {rolloff!r}"),
        (
            finite and rolloff < cut <= LARGEST_N / 2,
            f"cut = L/λ_s must be > rolloff = {rolloff:g} and <= {LARGEST_N // 2}, got {cut!r}",
        ),
        (finite and 1.0 <= stretch < cut, f"anisotropy must be >= 1 and < cut = {cut:g}, got {stretch!r}"),
        (spectrum.phases in ("gaussian", "random"), f"phases must be 'gaussian' or 'random', got {spectrum.phases!r}"),
    )
    for holds, message in rules:
        if not holds:
            raise SurfaceError(message)
    positive("Sq", spectrum.Sq)
    if spectrum.slope is not None:
        positive("slope", spectrum.slope)
    if spectrum.Ssk is not None and not math.isfinite(real("Ssk", spectrum.Ssk)):
        raise SurfaceError(f"Ssk must be finite, got {spectrum.Ssk!r}")
