"""What the ladders of `tradeoff` say: what a digit costs, and which quantities are converged in the resolution."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from roughvol.analysis.tables import Table
from roughvol.report import terminal
from roughvol.report.document import Section
from roughvol.store.dataset import Dataset
from roughvol.store.tradeoff_variables import QUANTITIES, RUNG

HEAD = ("η/σ asked", "error of A*", "of p*", "of V*", "bound of p*", "units a step", "seconds")
FORMATS = (".0e", *[".1e"] * 4, ".1f", ".2f")  # of the columns
CONVERGED = 0.02  # largest change still to come, relative, of a quantity that is converged in m


@dataclass(frozen=True)
class Convergence:
    """What the last refinements say of a quantity at the finest m; changes are root mean squares over surfaces of a D.

    ``change`` is that of the last level relative to the quantity, ``ratio`` over the change before it, ``remaining``
    the sum of the geometric series still to come (infinite from a ratio of 1 on), ``scatter`` the relative standard
    deviation over the seeds (NaN for one).
    """

    D: float
    quantity: str
    change: float
    ratio: float
    remaining: float
    scatter: float

    @property
    def converged(self) -> bool:
        """Whether less than `CONVERGED` of the quantity is still to come."""
        return self.remaining <= CONVERGED


def rungs(ds: Dataset, ladder: str, precision: str | None = None) -> Dataset:
    """Return the rungs of a ladder of a trade-off, of one precision of the transforms where it is named."""
    kept = ds["ladder"].values == ladder
    if precision is not None:
        kept &= ds["precision"].values == precision
    return ds.isel({RUNG: np.flatnonzero(kept)})


def convergence(ds: Dataset) -> list[Convergence]:
    r"""Return how far A*, p* and V* of the last state are from their limits in m, by Richardson's argument.

    .. math:: \text{remaining} = c_M \frac{r}{1 - r}, \qquad r = c_M / c_{M-1}

    with the relative changes c of the last two refinements: the geometric series of those to come, if they go on
    shrinking as they last did.
    For each D apart: changes fall about as 2^(-m (3 - D)). Nothing is returned where there are fewer than three levels.
    """
    family = rungs(ds, "resolution")
    if family.sizes[RUNG] < 3:
        return []
    rows = []
    for D, quantity in itertools.product(np.unique(ds["D"].values), QUANTITIES):
        values = family[quantity].values[:, ds["D"].values == D]  # (level, surface)
        last = values[-1]
        changes = np.sqrt(np.mean((np.diff(values, axis=0) / last) ** 2, axis=1))
        ratio = float(changes[-1] / changes[-2]) if changes[-2] > 0.0 else 0.0
        remaining = float(changes[-1] * ratio / (1.0 - ratio)) if ratio < 1.0 else float("inf")
        scatter = float(last.std(ddof=1) / last.mean()) if last.size > 1 else float("nan")
        rows.append(Convergence(float(D), quantity, float(changes[-1]), ratio, remaining, scatter))
    return rows


def time_saved(ds: Dataset) -> float:
    """Return the share of time that one digit less of residual saves, between η/σ = 1e-3 and 1e-9 (mixed precision).

    It is from a straight line through log(seconds) of all surfaces together against the digits.
    """
    ladder = rungs(ds, "tolerance", "mixed")
    chosen = (ladder["rtol"].values <= 1.1e-3) & (ladder["rtol"].values >= 0.9e-9)
    seconds = ladder["seconds"].values[chosen].sum(axis=1)
    slope = np.polyfit(-np.log10(ladder["rtol"].values[chosen]), np.log(seconds), 1)[0]
    return float(1.0 - np.exp(-slope))


def summary(ds: Dataset) -> str:
    """Return the ladder of tolerances, the cost of a digit, and the convergence in m, as lines for a terminal."""
    ladder = rungs(ds, "tolerance", "mixed")
    names = ("contact_area_fraction_error", "mean_pressure_error", "free_volume_error", "mean_pressure_bound")
    worst = [ladder[name].max("surface").values for name in names]
    work = [ladder[name].mean("surface").values for name in ("units", "seconds")]
    rungs_of = zip(ladder["rtol"].values, *worst, *work, strict=True)
    rows = tuple(tuple(map(format, rung, FORMATS)) for rung in rungs_of)
    saved = 100.0 * time_saved(ds)
    sentences = [f"ten times less accuracy costs {abs(saved):.0f} per cent {'less' if saved > 0.0 else 'more'} time"]
    for part in convergence(ds):
        verdict = "converged" if part.converged else "NOT converged"
        to_come = f"{100 * part.remaining:.1f} %" if np.isfinite(part.remaining) else "no limit in sight"
        seeds = f", scatter of seeds {100 * part.scatter:.1f} %" if np.isfinite(part.scatter) else ""
        sentences.append(
            f"D = {part.D:g}: {QUANTITIES[part.quantity]} {verdict} in m (last change {100 * part.change:.1f} %, "
            f"ratio {part.ratio:.2f}, still to come {to_come}{seeds})"
        )
    return "\n".join(terminal.lines(Section(tables=(Table("", HEAD, rows),), items=tuple(sentences))))
