"""The leak of a seal over time."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np

from roughvol.analysis.creep import History
from roughvol.report.figures.style import COLUMN, DASHES, STYLE, Drawing, canvas, looks, unit_text


def drawing_of(over_time: History) -> Drawing:
    """Return the leak along both axes over time.

    Parameters
    ----------
    over_time : History
        A seal over time.

    Returns
    -------
    Drawing
        Leaks on logarithmic axes; a line ends where its way closes.
    """
    with mpl.rc_context(STYLE):
        fig = canvas(COLUMN, 2.6)
        ax = fig.subplots()
        for order, (axis, look) in enumerate(zip(over_time.leak, looks(2), strict=True)):
            leak = over_time.leak[axis]
            drawn = np.where(leak > 0.0, leak, np.nan)
            ax.plot(over_time.seconds, drawn, ls=DASHES[order], color=look["color"], label=f"along ${axis}$")
            closed = np.flatnonzero(leak == 0.0)
            if closed.size:
                at = float(over_time.seconds[closed[0]])
                ax.axvline(at, ls=":", lw=0.7, color=look["color"])
        ax.set(
            xscale="log",
            yscale="log",
            xlabel="time under load [s]",
            ylabel=f"leak [{unit_text(over_time.leak_unit)}]",
            title=f"at {over_time.pressure:.4g} {unit_text(over_time.pressure_unit)}",
        )
        ax.legend()
    return fig
