"""Cases of a small surface, their states, and what is reduced of them."""

from __future__ import annotations

from collections.abc import Iterable

from numpy.typing import ArrayLike

from roughvol.campaign.case_surface import surface_of
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import Contact, sweep
from roughvol.observables.reduction import Reduction
from roughvol.observables.regions import Values
from roughvol.study import Case, loads

SURFACE = "surface: {D: 2.4, m: 4, seeds: [7], L: 3.0}\n"


def case_of(text: str, surface: str = SURFACE) -> Case:
    """Return the first case of a study of the small surface."""
    return loads(surface + text).cases()[0]


def states_of(case: Case, indentations: ArrayLike) -> list[Contact]:
    """Return its states at indentations."""
    surface = surface_of(case)
    return list(sweep(surface, HalfSpace(surface.shape), indentations))


def reduced(case: Case, contacts: Iterable[Contact]) -> Values:
    """Return what a study keeps of states."""
    surface = surface_of(case)
    reduction = Reduction(case, surface, HalfSpace(surface.shape))
    for contact in contacts:
        reduction.follow(contact)
    return reduction.values()
