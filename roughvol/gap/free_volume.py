"""The free volume under a rough surface in contact: element volumes, their total, their density, their domains.

Conventions: g ≥ 0 is the gap at each node and δ the spacing. v = g δ² is the free volume of the element around the
node [length³], exactly 0 in contact. Contact is the active set (p > 0) handed in as a mask, never a comparison of
floats.
"""

from typing import NamedTuple

import numpy as np

from roughvol.typing import Array, Mask


class VolumeDensity(NamedTuple):
    """Density f(v) of element volumes on K bins: ``edges`` (K + 1) [length³] and ``density`` (K) [1/length³]."""

    edges: Array
    density: Array


def element_volumes(gap: Array, spacing: float, contact: Mask) -> Array:
    """Return the free volume of each element, v = g δ² (the paper's Section 2), exactly 0 on the contact."""
    return np.where(contact, 0.0, gap * spacing**2)


def free_volume(gap: Array, Sq: float) -> float:
    """Return the dimensionless free volume, V* = mean(g)/σ; Sq is 1 for a gap already divided by σ.

    The paper's V/(L² σ) with V = Σ v over the (2^m + 1)² elements is this times (1 + 2^-m)²: its elements cover more
    than L².
    """
    return float(np.mean(gap / Sq))


def volume_density(
    volumes: Array, contact: Mask, bins: int = 50, include_contact: bool = False, upper: float | None = None
) -> VolumeDensity:
    """Return the probability density f(v) of the element volumes, ∫ f dv = 1 (the paper's Section 4, Fig. 12).

    Equal bins over [0, v_max or `upper`], the last one closed. Elements in contact (v = 0) are left out by default:
    their share is A*, a single value and no density. Full contact has no volume to distribute: all NaN.
    """
    counted = volumes.ravel() if include_contact else volumes[~contact]
    end = float(counted.max(initial=0.0)) if upper is None else upper
    if counted.size == 0 or end == 0.0:
        return VolumeDensity(np.full(bins + 1, np.nan), np.full(bins, np.nan))
    numbers, edges = np.histogram(counted, bins=bins, range=(0.0, end))
    return VolumeDensity(edges, numbers / (counted.size * np.diff(edges)))


def domain(volumes: Array, threshold: float, contact: Mask) -> Mask:
    """Return the free volume domain, D(v ≤ v_th) together with the contact (the paper's Section 3.2, Fig. 10).

    At v_th = 0 it is the contact alone, without open elements whose gap happens to be 0, as at first touch.
    """
    return contact.copy() if threshold == 0.0 else (volumes <= threshold) | contact
