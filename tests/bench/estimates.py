"""Quick estimates of the transmissivity against the computed one, by contact area: ``python -m tests.bench.estimates``.

Interiors of five surfaces each of D = 2.1, 2.3, 2.5 at m = 7, swept until they close. Each row has the median of the
estimate over the flow, the median factor between them, and the states where one is closed and the other is not.
"""

from itertools import pairwise

import numpy as np

from roughvol.campaign.one_case import run_case
from roughvol.study import loads

TEXT = """
surface: {D: [2.1, 2.3, 2.5], m: 7, seeds: 5}
sweep: {steps: 16, to: percolation}
solver: {accuracy: draft}
record: {region: interior, transport: {transmissivity: every-step, estimates: every-step}}
"""
EDGES = (0.0, 0.05, 0.1, 0.2, 0.3, 0.415, 0.6)
NAMES = ("medium", "corrected", "junction")


def main() -> None:
    """Print a table."""
    rows = []
    for case in loads(TEXT).cases():
        run = run_case(case).squeeze()
        for axis in "xy":
            estimates = [run[f"estimate_{name}_transmissivity"] for name in NAMES[:2]]
            estimates.append(run["estimate_junction_transmissivity"].sel(axis=axis))
            flow = [run["contact_area_fraction"], run["transmissivity"].sel(axis=axis), *estimates]
            rows.append(np.stack([one.values for one in flow], axis=1))
    table = np.concatenate(rows)
    for low, high in pairwise(EDGES):
        area, flow, *estimates = table[(table[:, 0] >= low) & (table[:, 0] < high)].T
        words = []
        for name, estimate in zip(NAMES, estimates, strict=True):
            both = (flow > 0.0) & (estimate > 0.0)
            ratio = np.log(estimate[both] / flow[both])
            off = np.exp([np.median(ratio), np.median(np.abs(ratio))]) if both.any() else [np.nan, np.nan]
            words.append(f"{name} {off[0]:.2f} ({off[1]:.2f}, {int(((flow > 0) != (estimate > 0)).sum())} differ)")
        print(f"A* {low} to {high}, {area.size} states: {', '.join(words)}")


if __name__ == "__main__":
    main()
