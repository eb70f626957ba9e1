"""Which figures there are, which of them a dataset can feed, and which cases of a study one draws.

The last is known before anything is computed.

The rules are those of the figures themselves: a comparison of D is at the finest m (Figs. 2 and 12a: at the m nearest
7), one of m at the D nearest 2.3, everything else shows the one surface nearest to D = 2.3, m = 7.

Cases are left out, never parts of one: what a case records belongs to its identity, so that one computed for a single
figure is the one that the study needs later. All it would save is the record: the solves are the same (see the table of
what each thing asked for costs in docs/tradeoff.md).
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence

from roughvol.errors import DatasetError
from roughvol.report.figures import content, ensembles, paper, seal, spectra, yielding
from roughvol.report.figures.paper import NEEDS, Draw
from roughvol.report.paper_rules import PAPER_D, PAPER_M, nearest, nearest_surface
from roughvol.store.dataset import Dataset
from roughvol.study import Case

Rule = Callable[[Sequence[Case]], list[Case]]


def figures() -> dict[str, tuple[Draw, Callable[[str, Dataset], str | None]]]:
    """Return what draws each figure, and what says why it cannot."""
    modules = (paper, seal, yielding, ensembles, spectra)
    return {name: (module.FIGURES[name], module.missing) for module in modules for name in module.FIGURES}


def drawable(results: Dataset, wanted: Sequence[str]) -> list[str]:
    """Return the figures that a dataset can feed: those wanted, or all that it can.

    Raises
    ------
    DatasetError
        If there is no such figure, one that is wanted cannot be drawn, or none can.
    """
    check_known(wanted)
    table = figures()
    reasons = {name: table[name][1](name, results) for name in wanted or table}
    lacking = [reason for reason in reasons.values() if reason]
    if lacking and (wanted or len(lacking) == len(reasons)):
        raise DatasetError("\n".join(lacking))
    return [name for name, reason in reasons.items() if not reason]


def needed(names: Sequence[str], cases: Sequence[Case]) -> tuple[str, ...]:
    """Return the ids of the cases that these figures draw, in the order of the study; of a height file, the one case.

    Raises
    ------
    DatasetError
        If there is no such figure; the message lists them.
    """
    names = [name.strip() for name in names]
    check_known(names)
    wanted = {case.id for name in names for case in _RULES[name](cases)}
    return tuple(case.id for case in cases if case.id in wanted)


def check_known(wanted: Sequence[str]) -> None:
    """Refuse names of no figure.

    Raises
    ------
    DatasetError
        With the nearest name, and all names.
    """
    table = (*figures(), *content.NAMES)
    for name in wanted:
        if name not in table:
            near = difflib.get_close_matches(name, table, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise DatasetError(f"no figure {name!r}{hint} (known: {', '.join(figures())}; {content.IN_WORDS})")


def _by_D(wish: float) -> Rule:
    def rule(cases: Sequence[Case]) -> list[Case]:
        levels = [case.m for case in cases if case.m is not None]
        if not levels:
            return list(cases)
        m = nearest(levels, wish)
        return [case for case in cases if case.m == m]

    return rule


def _by_m(cases: Sequence[Case]) -> list[Case]:
    values = [case.D for case in cases if case.D is not None]
    if not values:
        return list(cases)
    D = nearest(values, PAPER_D)
    return [case for case in cases if case.D == D]


def _one(cases: Sequence[Case]) -> list[Case]:
    return [cases[nearest_surface({k: (case.D, case.m) for k, case in enumerate(cases)})]]


_FINEST = 1e9
_RULES: dict[str, Rule] = {name: {"D": _by_D(_FINEST), "m": _by_m}.get(NEEDS[name][1], _one) for name in paper.FIGURES}
_RULES |= {"fig05": _by_D(_FINEST), "fig02": _by_D(PAPER_M), "fig12a": _by_D(PAPER_M)}
_RULES |= {name: _by_D(_FINEST) for name in seal.FIGURES}
_RULES |= {"path_loops": _by_D(_FINEST), "yielded_map": _one}
_RULES |= dict.fromkeys(ensembles.FIGURES, list) | dict.fromkeys(spectra.FIGURES, _by_D(_FINEST))
_RULES |= {"seal_map": _one, "seal_region": lambda cases: _by_m(_by_D(_FINEST)(cases))}
