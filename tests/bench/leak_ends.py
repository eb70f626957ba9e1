"""How near the end of a sweep at a leak rate comes to it: largest relative error over surfaces, by accuracy.

python -m tests.bench.leak_ends
"""

import tempfile
from pathlib import Path

import numpy as np

import roughvol
from roughvol.study import loads

TEXT = """
surface: {{D: [2.2, 2.5], m: [5, 6], seeds: 3, L: 100 um, Sq: 1 um}}
material: {{E_star: 10 MPa}}
solver: {{accuracy: {accuracy}}}
sweep: {{steps: 1, to: {{leak_rate: {rate} mm^3/s}}}}
record:
  transport: {{transmissivity: last}}
  dimensional: {{leak_rate: {{pressure_drop: 1 bar, viscosity: 1 mPa*s}}}}
"""


def main() -> None:
    """Print a line for each accuracy and leak rate."""
    with tempfile.TemporaryDirectory() as folder:
        for accuracy in ("draft", "standard", "reference"):
            for rate in (1e-2, 1e-4, 1e-6):
                study = loads(TEXT.format(accuracy=accuracy, rate=rate))
                ds = roughvol.run(study, out=Path(folder) / f"{accuracy}{rate}", jobs=1)
                error = np.abs(ds.leak_rate.max("axis") / rate - 1.0)
                largest, median = float(error.max()), float(error.median())
                print(f"{accuracy:9s}  {rate:g} mm^3/s  largest {largest:.1e}, median {median:.1e}")


if __name__ == "__main__":
    main()
