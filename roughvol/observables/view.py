"""A state as an observable sees it: of a study, on a surface, through the region of the study."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from roughvol.contact.loading import Compliance, Contact
from roughvol.observables.regions import State, within
from roughvol.study import Case
from roughvol.surfaces.surface import Surface
from roughvol.typing import Array, Mask

Values = dict[str, Any]
"""Numbers and arrays by stored name."""


@dataclass(frozen=True)
class View:
    """One state of a sweep.

    Attributes
    ----------
    case : what to record, and of which region.
    surface : the whole surface; its Sq is the unit of lengths.
    whole : the state on the whole surface.
    half_space : on which the state was solved.
    """

    case: Case
    surface: Surface
    whole: Contact
    half_space: Compliance

    @cached_property
    def state(self) -> State:
        """The state in the region."""
        return within(self.whole, self.case)

    @property
    def periodic(self) -> bool:
        """Whether the region is one period of a plane."""
        return self.state.periodic

    @cached_property
    def gap(self) -> Array:
        """Gap g/σ in the region, exactly 0 in contact."""
        return self.state.gap()

    @cached_property
    def contact(self) -> Mask:
        """Where p > 0 in the region."""
        return self.state.contact()
