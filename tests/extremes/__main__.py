"""Run the whole matrix of extremes and write docs/explanation/notes/extremes.md (`make extremes`)."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

from roughvol import __version__
from tests.extremes.matrix import CELLS, RTOL
from tests.extremes.random_cases import LARGEST, SMALLEST

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "notes" / "extremes.md"
HEAD = f"""# Extremes

<!-- made by: make extremes, roughvol {__version__} -->

Written by `make extremes`; the quick part runs in `make test`. Every row is a surface pressed through several states.
In each state is checked: p ≥ 0, g ≥ 0, p g = 0; contact only within the rigid overlap; the residual η/σ, recomputed
by a convolution that is not the package's; V* = d/σ + mean(u)/σ; and that A* and p* rise and V* falls along the
loading. Up to 300 elements the pressures are those of the dense problem. Any warning is an error. Default:
η/σ ≤ {RTOL:g}. At m = 11 and 12 one state at half the way to d = 0 is solved from nothing, to
1e-6. Only its certified residual is checked: the other conditions do not change with m.

The rows `random` are studies drawn from the numbers 0, 1, 2 … (`tests/extremes/random_cases.py`): grids of
{SMALLEST} to {LARGEST} elements a side, square or not, a third each free, mirrored and periodic; heights that are
self-affine, cropped, white noise or in terraces; three kernels; half spaces and layers; with and without hardness;
tolerances of 1e-8 to 1e-3; ends at a pressure, an area, a free volume or a separation; paths up, down and up. Checked
is that each study is solved to its tolerance, and that each leg ends where the study says.

| what | value | largest η/σ | states | compared with | seconds |
|---|---|---|---|---|---|
"""
TAIL = """
## Limits of the input

Values beyond these are errors before any computation. The message has the value and the allowed ones.

| quantity | allowed | reason |
|---|---|---|
| D | 2 < D < 3 | outside, the recursion makes no fractal surface |
| m | 1 to 13 in a study, 14 from Python | memory: 4^m elements |
| grid | at least 3 × 3 | a texture needs an interior |
| range of heights | 0 (flat), or 1e-290 to 1.8e308 | below, Sq loses its digits; above, the range is no number |
| heights | finite | NaN and infinite heights are counted, and the first one is named |
| hardness | > 0, with method `fast` | Algorithm 1 has no upper bound of the pressure |
| η/σ asked for | at least 4e-16 max(1, Δ/σ) | the gap is the difference of two numbers as large as Δ/σ |
| method `paper` | m ≤ 6 | dense matrices of 4^m rows |
"""


def main() -> int:
    """Run every cell; print and write the table; return 1 if a cell failed."""
    rows, failed = [], 0
    for cell in CELLS:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                found = cell.run()
            eta = f"{found.residual:.0e}" if found.states else "-"
            row = f"| {cell.group} | {cell.name} | {eta} | {found.states} | {found.compared} | {found.seconds:.1f} |"
        except Exception as error:  # a failed cell belongs in the table
            failed += 1
            row = f"| {cell.group} | {cell.name} | | | **failed**: {type(error).__name__} {str(error)[:80]!r} | |"
        print(row, flush=True)
        rows.append(row)
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(HEAD + "\n".join(rows) + "\n" + TAIL, encoding="utf-8")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
