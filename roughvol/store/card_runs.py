"""The runs behind a leak card: the finest grid, coarser grids, and another levelling, at one load."""

from __future__ import annotations

from dataclasses import dataclass

from roughvol.store.dataset import Dataset
from roughvol.study import Level


@dataclass(frozen=True, eq=False)
class Pressed:
    """A run that records the state, ``level``, at the load of a card.

    ``words`` is its difference from the finest run, as ``twice the spacing`` or ``level: tilt``.
    """

    words: str
    dataset: Dataset
    level: Level


@dataclass(frozen=True, eq=False)
class CardRuns:
    """The runs of one height file, or of the seeds of one kind of surface.

    ``coarser`` has the runs at 2 and 4 times the spacing, as far as the grid has nodes for them. ``levelled`` is on the
    grid of `before_levelling`. ``no_coarser`` and ``no_levelled`` say which of these runs failed, and why.
    """

    fine: Pressed
    coarser: tuple[Pressed, ...] = ()
    levelled: Pressed | None = None
    no_coarser: str = ""
    no_levelled: str = ""

    @property
    def before_levelling(self) -> Pressed:
        """The run with the levelling of the study on the grid of ``levelled``: twice the spacing, if there is one."""
        return self.coarser[0] if self.coarser else self.fine
