"""One figure of datasets, by its name: the Python form of ``roughvol plot``."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from roughvol.errors import DatasetError
from roughvol.store import StoredRun
from roughvol.store.dataset import with_case

if TYPE_CHECKING:
    from roughvol.report.figures.style import Drawing
    from roughvol.store.dataset import Dataset


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
    from roughvol.report.figures import content, origin, selection

    selection.check_known([figure])
    if isinstance(results, str | Path) or not isinstance(results, Mapping) or hasattr(results, "attrs"):
        one = _opened(results)  # type: ignore[arg-type]  # a dataset is a mapping with attributes
        opened = content.parts(origin.run_name(one), one, alone=True)
    else:
        named = [(str(name), _opened(one)) for name, one in results.items()]
        opened = [part for name, one in named for part in content.parts(name, one, alone=len(named) == 1)]
    if figure in content.NAMES:
        draw = partial(content.draw, figure, opened)
    elif len(opened) == 1:
        selection.drawable(opened[0].dataset, [figure])
        draw = partial(selection.figures()[figure][0], opened[0].dataset)
    else:
        message = f"{figure} shows one run; several, or lists, are overlaid in figures by content, {content.IN_WORDS}"
        raise DatasetError(message)
    return draw()


def _opened(one: Dataset | str | Path) -> Dataset:
    """Return a dataset, or that of a run."""
    if isinstance(one, str | Path):
        return StoredRun.open(one).dataset
    return with_case(one)
