"""Write docs/reference/crossing.md: ``python -m tests.crossing``."""

from tests.crossing.table import PAGE, page

PAGE.write_text(page(), encoding="utf-8")
