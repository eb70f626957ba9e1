"""Curves of families of surfaces on one axes: computed states of single surfaces, means and bands of several."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from roughvol.observables.at_state import at_state
from roughvol.report.figures.families import Curve, Family
from roughvol.report.figures.style import DASHES, legend, marked

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot(
    ax: Axes,
    some: Sequence[Family],
    members: Sequence[Sequence[Curve]],
    labels: tuple[str, str],
    title: str,
    *,
    common: bool = False,
    log: bool = False,
) -> None:
    """Draw the curves of every family, label the axes, and say above them what is shown.

    With `common`, the curves of a family have the same abscissae; else their mean is taken on a grid. With `log`,
    single surfaces are left out where they are zero.
    """
    for order, (family, each) in enumerate(zip(some, members, strict=True)):
        if len(each) == 1:
            ax.plot(*each[0], label=family.label, markevery=marked(len(each[0][0]), order), zorder=3, **family.look)
            continue
        abscissa = each[0][0]
        if not common:
            low, high = max(one[0][0] for one in each), min(one[0][-1] for one in each)
            abscissa = np.linspace(low, high, 200 if high > low else 0)
        rows = np.array([at_state(*one, abscissa) for one in each])
        mean, spread = rows.mean(axis=0), rows.std(axis=0, ddof=1)
        colour = family.look["color"]
        ax.fill_between(abscissa, mean - spread, mean + spread, color=colour, alpha=0.18, lw=0, zorder=2)
        for x, y in each:
            drawn = np.where(y > 0.0, y, np.nan) if log else y  # a logarithmic axis has no zero
            ax.plot(x, drawn, color=colour, lw=0.35, alpha=0.4, zorder=1)
        ax.plot(abscissa, mean, label=family.label, color=colour, ls=DASHES[order % len(DASHES)], zorder=3)
    counts = sorted({len(each) for each in members if len(each) > 1})
    if counts:
        surfaces = "-".join(map(str, dict.fromkeys((counts[0], counts[-1]))))
        title += f"; mean of {surfaces} surfaces, band ± 1 std. dev."
    ax.set(xlabel=labels[0], ylabel=labels[1])
    legend(ax, title)


def shown(some: Sequence[Family]) -> dict[str, list[float]]:
    """Return the D, m and numbers of surfaces that families show, for the note."""
    made = {key: [float(one.data[key]) for one in some if key in one.data] for key in ("D", "m")}
    return {key: sorted(set(values)) for key, values in made.items()} | {"surfaces": [one.surfaces for one in some]}
