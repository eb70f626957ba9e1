"""Figures by name, those of the package and those of the paper together: the Python form of ``roughvol plot``."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from roughvol.errors import DatasetError

if TYPE_CHECKING:
    from roughvol.report.figures.figure import Figure
    from roughvol.report.figures.style import Drawing
    from roughvol.store.dataset import Dataset
    from roughvol.study import Case


def plot(results: Dataset | str | Path | Mapping[str, Dataset | str | Path], figure: str = "v_of_p") -> Drawing:
    """Return one figure of a run, or of several runs or combinations of a study with lists overlaid.

    A notebook shows it where it is the last value of a cell.

    Parameters
    ----------
    results : Dataset, path, or mapping
        Dataset of `roughvol.run` or `roughvol.press`; a run: its folder, ``study.nc``, study file or name; or a
        dataset saved with ``to_netcdf``. Several by name.
    figure : str
        Name of the figure, as ``v_of_p``, ``leak_of_p`` or ``fig05``.

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
    from roughvol.report.figures import content, origin

    check_known([figure])
    if isinstance(results, str | Path) or not isinstance(results, Mapping) or hasattr(results, "attrs"):
        one = _opened(results)  # type: ignore[arg-type]  # a dataset is a mapping with attributes
        opened = content.parts(origin.run_name(one), one, alone=True)
    else:
        named = [(str(name), _opened(one)) for name, one in results.items()]
        opened = [part for name, one in named for part in content.parts(name, one, alone=len(named) == 1)]
    if figure in content.NAMES:
        return content.draw(figure, opened)
    if len(opened) == 1:
        return figures()[figure](opened[0].dataset)
    raise DatasetError(
        f"{figure} shows one run; several, or lists, are overlaid in figures by content, {content.IN_WORDS}"
    )


def figures() -> dict[str, Figure]:
    """Return the figures of one run by name: those of the paper, then those of the package."""
    from roughvol.reproduction.figures.registry import ALL

    return ALL


def needed(names: Sequence[str], cases: Sequence[Case]) -> tuple[str, ...]:
    """Return the ids of the cases that figures show, in the order of the study; all for figures by content.

    Raises
    ------
    DatasetError
        If there is no such figure; the message lists them.
    """
    names, known = [name.strip() for name in names], figures()
    check_known(names)
    wanted = {case.id for name in names for case in (known[name].cases(cases) if name in known else cases)}
    return tuple(case.id for case in cases if case.id in wanted)


def check_known(wanted: Sequence[str]) -> None:
    """Raise `DatasetError` for names of no figure, with the nearest name and all names."""
    from roughvol.report.figures import content

    table = (*figures(), *content.NAMES)
    for name in wanted:
        if name not in table:
            near = difflib.get_close_matches(name, table, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise DatasetError(f"no figure {name!r}{hint} (known: {', '.join(figures())}; {content.IN_WORDS})")


def _opened(one: Dataset | str | Path) -> Dataset:
    """Return a dataset, or that of a run."""
    from roughvol.store import StoredRun
    from roughvol.store.dataset import with_case

    return StoredRun.open(one).dataset if isinstance(one, str | Path) else with_case(one)
