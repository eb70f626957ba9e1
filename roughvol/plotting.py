"""Figures by name, those of the package and those of the paper together: the Python form of ``roughvol plot``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roughvol import spellings
from roughvol.errors import DatasetError, meant
from roughvol.questions import opened
from roughvol.report.figures import content
from roughvol.reproduction.figures.registry import ALL as FIGURES
from roughvol.reproduction.figures.registry import NAMES
from roughvol.store.run_folder import slug
from roughvol.study import check_type

if TYPE_CHECKING:
    from roughvol.report.figures.content import Named
    from roughvol.report.figures.figure import Figure
    from roughvol.report.figures.style import Drawing
    from roughvol.store.dataset import Dataset
    from roughvol.study import Case
    from roughvol.typing import Changes

SHOWS_ONE = "{} shows one run; several, or lists, are overlaid in figures by content, {}"


def plot(
    results: Dataset | str | Path | Mapping[str, Dataset | str | Path],
    figure: str = "v_of_p",
    *,
    changes: Changes = (),
) -> Drawing:
    """Return one figure of a run, or of several runs or combinations of a study with lists overlaid.

    A notebook shows it where it is the last value of a cell.

    Parameters
    ----------
    results : Dataset, path, or mapping
        Dataset of `roughvol.run` or `roughvol.press`; a run: its folder, ``study.nc``, study file or name; or a
        dataset saved with ``to_netcdf``. Several by name.
    figure : str
        Name of the figure, as ``v_of_p``, ``leak_of_p`` or ``fig05``.
    changes : mapping, or sequence of text
        Settings of the study that choose a part of a run with lists, as ``["material.E=6 MPa"]``.

    Returns
    -------
    Drawing
        A matplotlib figure. ``savefig`` writes it.

    Raises
    ------
    DatasetError
        If there is no such figure, or the results lack a quantity that it draws.

    See Also
    --------
    roughvol.open : Opens the results of a run.

    Examples
    --------
    >>> import numpy as np
    >>> import roughvol
    >>> ds = roughvol.press(np.random.default_rng(0).normal(size=(16, 16)), L=1.0, E_star=1.0)
    >>> figure = roughvol.plot(ds, "v_of_p")
    >>> len(figure.axes)
    1
    """
    several = isinstance(results, Mapping) and not hasattr(results, "attrs")  # a dataset is a mapping with attributes
    each: Mapping[str, Any] = results if several else {"": results}  # type: ignore[assignment]
    if not each:
        raise DatasetError("plot takes one run or more, given an empty mapping")
    check_type(results, object, 'several runs are a mapping of their labels, as {"fine": "seal"}', but=(list, tuple))
    stored = [(str(name), opened(one, changes)) for name, one in each.items()]
    runs = content.parts([(name or run.name, run.dataset) for name, run in stored])
    check_type(figure, str, "a figure is text")
    check_known([figure], runs)
    found, refused = drawings(runs, [figure], alone=len(stored) == 1)
    if len(found) == 1 and not refused:
        return next(iter(found.values()))()
    raise DatasetError("\n".join(refused) or SHOWS_ONE.format(figure, content.IN_WORDS))


Draws = dict[str, "Callable[[], Drawing]"]


def drawings(runs: Sequence[Named], wanted: Sequence[str], *, alone: bool) -> tuple[Draws, list[str]]:
    """Return functions that draw the figures of runs by path, and why some of the figures wanted cannot be drawn.

    Without a figure wanted, those of `content.DRAWN` that the runs have are drawn, and of one study all others too.
    ``alone`` marks the combinations of one study.
    """
    found, refused = Draws(), list[str]()
    for name in wanted or [name for name in content.DRAWN if content.missing(name, runs) is None]:
        if name in content.NAMES or name not in FIGURES:
            reason = content.missing(name, runs)
            if reason is None:
                found[name] = partial(content.draw, name, runs)
        elif alone:
            reasons = [_add(found, FIGURES[name], name, run, runs) for run in runs]
            reason = "\n".join(dict.fromkeys(filter(None, reasons)))
        else:
            reason = SHOWS_ONE.format(name, content.IN_WORDS)
        refused += [reason] if reason else []
    for run in runs if alone and not wanted else ():
        reasons = [_add(found, figure, name, run, runs) for name, figure in FIGURES.items()]
        if all(reasons) and not found:
            raise DatasetError("\n".join(filter(None, reasons)))
    return found, refused


def _add(found: Draws, figure: Figure, name: str, run: Named, runs: Sequence[Named]) -> str | None:
    """Add a figure of a run, in a folder of its combination as ``E=5_MPa/``, or return why the figure is missing."""
    reason = figure.missing(run.dataset)
    if reason is None:
        folder = f"{slug(run.name)}/" if len(runs) > 1 else ""
        found[f"{folder}{name}"] = partial(figure, run.dataset)
    return reason


def needed(wanted: Sequence[str], cases: Sequence[Case]) -> tuple[str, ...]:
    """Return the ids of the cases that figures show, in the order of the study; all for figures by content.

    Raises
    ------
    DatasetError
        If there is no such figure; the message lists them.
    """
    wanted = [name.strip() for name in wanted]
    check_known(wanted)
    ids = {case.id for name in wanted for case in (FIGURES[name].cases(cases) if name in FIGURES else cases)}
    return tuple(case.id for case in cases if case.id in ids)


def check_known(wanted: Sequence[str], runs: Sequence[Named] = ()) -> None:
    """Raise `DatasetError` for names of no figure of the runs, with the nearest name and all names."""
    known = [*NAMES, *content.own_names(runs)]
    for name in wanted:
        if name not in known:
            if row := spellings.former("figure", name):
                raise DatasetError(f"figure {name!r} {row.message}")
            raise DatasetError(
                f"no figure {name!r}{meant(name, known)} (known: {', '.join(FIGURES)}; {content.IN_WORDS})"
            )
