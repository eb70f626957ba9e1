"""Progress of a run in a notebook: one line with a bar, drawn again as the run goes on."""

from __future__ import annotations

import html
import sys
import time
from typing import Any

from roughvol.campaign.batch import OnEvent, Progress

AFTER = 0.5  # seconds of a run before its bar appears
EVERY = 0.2  # seconds between two drawings


def progress() -> OnEvent | None:
    """Return a function that draws runs longer than `AFTER` seconds in the cell at work, None outside a notebook."""
    if "IPython" not in sys.modules:
        return None
    from IPython import get_ipython

    return Bar() if getattr(get_ipython(), "kernel", None) is not None else None


class Bar:
    """The output of one cell: text for a terminal, and the same with a bar in HTML."""

    def __init__(self) -> None:
        self._started, self._drawn = time.monotonic(), 0.0
        self._now: Progress | None = None
        self._handle: Any = None

    def __call__(self, now: Progress) -> None:
        """Draw the progress."""
        self._now, moment = now, time.monotonic()
        last = now.work >= 1.0
        if moment - self._started < AFTER or (moment - self._drawn < EVERY and not last):
            return
        self._drawn = moment
        if self._handle is None:
            from IPython.display import display

            self._handle = display(self, display_id=True)
        else:
            self._handle.update(self)

    def __repr__(self) -> str:
        return f"{self._now or 'starting'} · {time.monotonic() - self._started:.1f} s"

    def _repr_html_(self) -> str:
        work = self._now.work if self._now is not None else 0.0
        return f'<div><progress value="{work:.3f}" max="1"></progress> {html.escape(repr(self))}</div>'
