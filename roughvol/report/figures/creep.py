"""The leak of a seal over time."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from xarray import Dataset

from roughvol.analysis.creep import History
from roughvol.report.figures.origin import fluid_note, origin, written
from roughvol.report.figures.style import COLUMN, DASHES, STYLE, Drawing, axes, legend, looks, unit_text
from roughvol.report.figures.ways import band_words


def drawing_of(over_time: History, run: Dataset) -> Drawing:
    """Return the leak along both axes over time: of several surfaces their range, of one surface the error."""
    leaks = over_time.leak.values()
    several = next(iter(leaks)).surfaces
    of_seal, number = ("the seal, ", run.sizes.get("seed", 1)) if over_time.seal else ("", several)
    bands = {
        axis: (leak.least, leak.most) if several > 1 else (leak.low, leak.high) for axis, leak in over_time.leak.items()
    }
    known = np.concatenate([np.isfinite(least + most) for least, most in bands.values()])
    shown = np.concatenate([*(leak.value for leak in leaks), *(least for least, _ in bands.values())])
    floor = 0.5 * float(shown[shown > 0.0].min(initial=np.inf))  # ends of 0 lie on the lower edge
    with mpl.rc_context(STYLE):
        fig, ax = axes(COLUMN, 2.8)
        for (axis, leak), look, dash in zip(over_time.leak.items(), looks(len(leaks)), DASHES, strict=False):
            median = np.where(leak.value > 0.0, leak.value, np.nan)
            ax.plot(over_time.seconds, median, ls=dash, color=look["color"], label=f"{of_seal}along ${axis}$")
            least, most = (np.maximum(ends, floor) for ends in bands[axis])
            ax.fill_between(over_time.seconds, least, most, color=look["color"], alpha=0.18, lw=0)
            closed = np.flatnonzero(leak.open == 0)
            if closed.size:
                first = float(over_time.seconds[closed[0]])
                ax.axvline(first, ls=":", lw=0.7, color=look["color"], label=f"closed along ${axis}$ from here on")
        ax.set(xscale="log", yscale="log", xlabel="time under load [s]")
        if np.isfinite(floor):
            ax.set_ylim(bottom=floor)
        ax.set_ylabel(f"leak [{unit_text(over_time.leak_unit)}]")
        load = f"at {over_time.pressure:.4g} {unit_text(over_time.pressure_unit)}"
        errors = "errors of leak cards" if over_time.has_errors else "error of the reading"
        errors = f"band: {errors}{'' if known.all() else ', where known'}" if known.any() else "its error is not known"
        legend(ax, f"{load}; {band_words([several]) or errors}")
        source = f"{origin(run, {'surfaces': [number]})}."
        fig.note(" ".join(filter(None, [source, over_time.seal, *written(run), *fluid_note(run)])))
    return fig
