"""The power-law spectrum of a surface as a plain record, and its moments in closed form; loads without numpy.

Conventions: q = 2π/λ are wave numbers, k = q L/(2π) = L/λ their ratios to the lowest one of a period L. The isotropic
power spectral density is (Persson et al. 2005; Jacobs, Junge & Pastewka 2017; the Contact-Mechanics Challenge 2017)

    C(q) = C0                        q_L ≤ q < q_r     plateau
    C(q) = C0 (q/q_r)^(-2-2H)        q_r ≤ q < q_s     self-affine
    C(q) = 0                         elsewhere

with λ_L = L the period, λ_r the roll-off wavelength, λ_s the short cut-off wavelength, and H = 3 - D. The mean square
of the height is ∫ q C(q) dq/(2π), and a derivative adds a factor q².
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

Phases = Literal["gaussian", "random"]


@dataclass(frozen=True)
class Spectrum:
    """A power law between two wavelengths, its amplitude, and how the waves are drawn.

    Attributes
    ----------
    rolloff : L/λ_r ≥ 1; 1 for a power law without a plateau.
    cut : L/λ_s > rolloff.
    Sq : root mean square height of the period [length].
    slope : root mean square slope h'_rms of the period [1], instead of Sq.
    Ssk : skewness of the heights, None for Gaussian ones.
    anisotropy : wavelengths along x over those along y, ≥ 1.
    phases : "gaussian": amplitudes and phases are random. "random": the phases alone, amplitudes follow C(q).
    periodic : one period without a repeated edge; else a patch with it.

    See Also
    --------
    roughvol.surfaces.power_law_surface : Returns a surface with the spectrum.

    Examples
    --------
    >>> from roughvol.surfaces import Spectrum, power_law_surface
    >>> spectrum = Spectrum(rolloff=2.0, cut=8.0, Sq=0.5)
    >>> surface = power_law_surface(spectrum, hurst=0.8, n=16)
    >>> surface.shape, round(surface.Sq, 6)
    ((16, 16), 0.5)
    """

    rolloff: float
    cut: float
    Sq: float = 1.0
    slope: float | None = None
    Ssk: float | None = None
    anisotropy: float = 1.0
    phases: Phases = "gaussian"
    periodic: bool = True

    @property
    def key(self) -> dict[str, Any]:
        """Everything that changes the heights, as plain data; rounded, so that it is the same in any unit."""
        rounded = {name: float(f"{v:.12g}") if isinstance(v, float) else v for name, v in vars(self).items()}
        return rounded if self.slope is None else rounded | {"Sq": None}
