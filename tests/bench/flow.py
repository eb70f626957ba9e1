"""Memory and time of one flow through the gap over a cut surface: ``python -m tests.bench.flow M CLOSED``.

CLOSED is the share of closed elements. The gap is that of a cut, so nothing is solved but the flow.
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

from roughvol.gap.transport import conduction
from roughvol.surfaces.midpoint import random_midpoint_displacement


def main(m: int, closed: float) -> None:
    """Print the coefficient, its error of conservation, the growth of the resident set, and the seconds."""
    heights = random_midpoint_displacement(2.3, m, seed=0).heights
    gap = np.maximum(np.quantile(heights, 1.0 - closed) - heights, 0.0)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started = time.perf_counter()
    flow = conduction(gap, 0)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(
        f"{gap.shape[0]}^2 elements, {closed:.0%} closed: T* = {flow.coefficient!r}, conservation error "
        f"{flow.conservation_error:.1e}, peak {peak / 2**20:.2f} GiB ({(peak - before) * 1024 / gap.size:.0f} bytes an "
        f"element), {time.perf_counter() - started:.0f} s"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
