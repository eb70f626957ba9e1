"""Run the whole matrix of extremes and write docs/explanation/notes/extremes.md (`make extremes`)."""

import re
import sys
import warnings
from pathlib import Path

from roughvol import __version__
from tests.extremes.matrix import CELLS, RTOL
from tests.extremes.random_cases import LARGEST, SMALLEST

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "notes" / "extremes.md"
VALUES = {"VERSION": __version__, "RTOL": f"{RTOL:g}", "SMALLEST": SMALLEST, "LARGEST": LARGEST}
TEMPLATE = (Path(__file__).parent / "page.md").read_text(encoding="utf-8")
HEAD, TAIL = re.sub(r"VERSION|RTOL|SMALLEST|LARGEST", lambda name: str(VALUES[name[0]]), TEMPLATE).split("ROWS\n")


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
