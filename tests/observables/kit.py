"""Cases of a small surface, their states, and what is reduced of them."""

from roughvol.campaign.case_surface import surface_of
from roughvol.campaign.one_case import run_case
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import sweep
from roughvol.observables.reduction import Reduction
from roughvol.store.dimensional import in_units
from roughvol.study import loads

SURFACE = "surface: {D: 2.4, m: 4, seeds: [7], L: 3.0}\n"


def case_of(text, surface=SURFACE):
    """Return the first case of a study of the small surface."""
    return loads(surface + text).cases()[0]


def answer(text, file="<string>"):
    """Return the answer of a study of one case, in its units, without writing it."""
    study = loads(text, file)
    (case,) = study.cases()
    return in_units(run_case(case), study, case.length_unit).squeeze()


def states_of(case, indentations):
    """Return its states at indentations."""
    surface = surface_of(case)
    return list(sweep(surface, HalfSpace(surface.shape), indentations))


def reduced(case, contacts):
    """Return what a study keeps of states."""
    surface = surface_of(case)
    reduction = Reduction(case, surface, HalfSpace(surface.shape))
    for contact in contacts:
        reduction.follow(contact)
    return reduction.values()
