"""The wavy channel of Shvarts & Yastrebov, Tribol. Int. 126 (2018) 116: its closing load against the fluid pressures.

A sine across, flat along; a fluid flows along it while it is pressed. Loads rise under pressure until no way is open.

    python -m tests.bench.wavy_channel                        the table of docs/explanation/literature.md
    python -m tests.bench.wavy_channel --figure docs/pictures/wavy-channel.png
"""

import argparse
from pathlib import Path

import numpy as np

from roughvol.campaign.case_surface import one_thread
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import Trials
from roughvol.contact.search import state_under
from roughvol.errors import ConvergenceError
from roughvol.gap.clusters import percolates
from roughvol.observables.coupling import Coupling, Lifted
from roughvol.surfaces.surface import Surface

PRESSURES = ((0.1, 0.0), (0.2, 0.0), (0.4, 0.0), (0.6, 0.0), (0.2, 0.1), (0.4, 0.2))  # inlet, outlet


class Channel:
    """A sine of amplitude 1 across, one period wide. Pressures are over that of Westergaard (1939), π E* h/λ."""

    def __init__(self, along: int, across: int) -> None:
        z = np.tile(np.cos(2 * np.pi * np.arange(across) / across), (along, 1))
        self.surface = Surface(z, 1.0 / along, sides="periodic")
        self.half_space = HalfSpace(self.surface.shape, "fourier", sides="periodic")
        self.closed = np.pi * along / across / self.surface.unit
        self.near = state_under(Trials(self.surface, self.half_space, rtol=1e-9), 0.7 * self.closed, 1.0)

    def closing(self, inlet: float, outlet: float = 0.0, accuracy: float = 0.005) -> float:
        """Return the largest load with an open way, of loads that rise under pressure."""
        both = Coupling(self.surface, self.half_space, 0, inlet * self.closed, outlet * self.closed)
        fluid = np.full(self.surface.shape, inlet * self.closed)
        last, step = 0.9 + 0.4 * inlet, 0.08
        state = self._pressed(both, last, fluid)
        if not is_open(state):
            raise ValueError(f"closed at the first load, {last}")
        while step > accuracy:
            try:
                tried = self._pressed(both, last + step, state.fluid)
            except ConvergenceError:  # next to the closing
                step *= 0.5
                continue
            if is_open(tried):
                last, state = last + step, tried
            else:
                step *= 0.5
        return last

    def _pressed(self, both: Coupling, load: float, fluid: np.ndarray) -> Lifted:
        """Return the state of a joint that is pressed farther under the fluid pressure of another state."""
        try:
            return both._relaxed(fluid, load * self.closed, both.without_fluid(self.near))
        except ConvergenceError:
            return both._softened(fluid, load * self.closed, both.without_fluid(self.near))


def is_open(state: Lifted) -> bool:
    """Return whether a way leads along the channel."""
    return percolates(state.gap > 0.0, 0, periodic=True)


def main() -> None:
    """Print the closing loads, and draw them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--along", type=int, default=64)
    parser.add_argument("--across", type=int, default=8)
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    with one_thread():
        channel = Channel(given.along, given.across)
        closing = [channel.closing(*pressures, accuracy=1.5e-3) for pressures in PRESSURES]
    print("| inlet | outlet | closing load | (closing load - 1 - outlet)/(inlet - outlet) |")
    print("|---|---|---|---|")
    for (inlet, outlet), load in zip(PRESSURES, closing, strict=True):
        print(f"| {inlet} | {outlet} | {load:.3f} | {(load - 1 - outlet) / (inlet - outlet):.2f} |")
    if given.figure:
        _draw(closing, given.figure)


def _draw(closing: list[float], path: Path) -> None:
    import matplotlib as mpl

    from roughvol.report.figures.style import COLUMN, GREY, STYLE, canvas
    from roughvol.reproduction.figures.conditions import ACCENT

    dry = [(inlet, load) for (inlet, outlet), load in zip(PRESSURES, closing, strict=True) if outlet == 0.0]
    other = [(inlet, load) for (inlet, outlet), load in zip(PRESSURES, closing, strict=True) if outlet > 0.0]
    x, y = np.array(dry).T
    slope, start = np.polyfit(x, y, 1)
    with mpl.rc_context(STYLE):
        fig = canvas(COLUMN, 2.6)
        ax = fig.subplots()
        line = np.array([0.0, x.max()])
        ax.plot(line, start + slope * line, color=GREY, lw=0.8, label=f"{start:.2f} + {slope:.2f} × inlet")
        ax.plot(x, y, "o", color=ACCENT, label="outlet 0")
        ax.plot(*np.array(other).T, "s", mfc="none", color=ACCENT, label="outlet half of the inlet")
        ax.set(xlabel=r"inlet pressure over $\pi E^{\ast} h/\lambda$", ylabel="closing load over the same")
        ax.legend()
        fig.savefig(path)


if __name__ == "__main__":
    main()
