"""Curves of families of surfaces on one axes: computed states of single surfaces, means and bands of several."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from roughvol.report.figures.families import Curve, Family, mean_and_band, named, several
from roughvol.report.figures.style import DASHES, legend, marked

INK = 8.0  # opacity of all lines of single surfaces together: 40 % of each of 20, less of each where they are more
OPACITY = 0.4  # largest, of the line of a single surface


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
    """Draw the curves of every family, label the axes, and put the title above them.

    With `common`, the curves of a family have the same abscissae; else their mean is taken on a grid. With `log`,
    single surfaces are left out where they are zero.
    """
    for order, (family, curves) in enumerate(zip(some, members, strict=True)):
        colour = family.look["color"]
        if len(curves) == 1:
            marks = marked(len(curves[0][0]), order)
            lines = ax.plot(*curves[0], label=family.label, markevery=marks, zorder=3, **family.look)
            named(ax, lines, family)
            continue
        if common:
            abscissa, rows = curves[0][0], np.array([y for _, y in curves])
            mean, spread = rows.mean(axis=0), rows.std(axis=0, ddof=1)
        else:
            abscissa, mean, spread = mean_and_band(curves, 200)
        ax.fill_between(abscissa, mean - spread, mean + spread, color=colour, alpha=0.18, lw=0, zorder=2)
        opacity = min(OPACITY, INK / len(curves))
        for surface, (x, y) in enumerate(curves):
            drawn = np.where(y > 0.0, y, np.nan) if log else y  # a logarithmic axis has no zero
            lines = ax.plot(x, drawn, color=colour, lw=0.35, alpha=opacity, zorder=1)
            named(ax, lines, family, surface)
        lines = ax.plot(abscissa, mean, label=family.label, color=colour, ls=DASHES[order % len(DASHES)], zorder=3)
        named(ax, lines, family)
    if surfaces := several(map(len, members)):
        title += f"; mean of {surfaces} surfaces, band ± 1 std. dev."
    ax.set(xlabel=labels[0], ylabel=labels[1])
    legend(ax, title)


def shown(some: Sequence[Family]) -> dict[str, list[float]]:
    """Return the D, m and numbers of surfaces that families show, for the note."""
    made = {key: [float(family.data[key]) for family in some if key in family.data] for key in ("D", "m")}
    surfaces: list[float] = [family.surfaces for family in some]
    return {key: sorted(set(values)) for key, values in made.items()} | {"surfaces": surfaces}
