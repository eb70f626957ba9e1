"""The tables of figures, one row a figure: drawing, caption, variables, cases.

`FIGURES` are drawn from a stored run by ``roughvol plot`` and ``roughvol report``, `TRADEOFF` by ``roughvol tradeoff``.
Where a figure names its surfaces, centre or band in its title, the caption leaves them to the title.
"""

from __future__ import annotations

from collections.abc import Callable

from xarray import Dataset

from roughvol.analysis import leak
from roughvol.report.figures import ensembles, seal, spectra, work_precision, yielding
from roughvol.report.figures.cases import by_D, by_m, single
from roughvol.report.figures.figure import Figure, table
from roughvol.report.figures.style import A, P, V

DIRECTIONS = (
    " Solid lines with filled marks run along x, dashed lines with hollow marks along y; × and + on the lower edge "
    "mark the first state at which x and y are closed."
)
PANELS = " The panels have pressure p*, contact area A* and free volume V* along x; the title names centre and band."

Refusal = Callable[[str, Dataset], str | None]


def _lifted(name: str, ds: Dataset) -> str | None:
    if leak.is_lifted(ds):
        return f"{name} shows the gap without fluid pressure; allowed with record.fluid_pressure: leak_of_p"
    return None


def _without(variable: str, words: str) -> Refusal:
    """Return the refusal of datasets without a variable."""
    return lambda name, ds: None if variable in ds else f"{name} needs {words}"


def _ladder(ladder: str) -> Refusal:
    """Return the refusal of datasets without a ladder of a trade-off."""

    def refuse(name: str, ds: Dataset) -> str | None:
        if "ladder" not in ds.coords:
            return f"{name} needs a dataset of `roughvol tradeoff`"
        if ladder not in ds["ladder"].values:
            return f"{name} needs the ladder {ladder!r}, which a height file does not have"
        return None

    return refuse


_ENSEMBLE = _without("ensemble_samples", "a study with a section 'ensemble'")
_PATH = _without("leg", "a path, as sweep: [{steps: 30, to: {pressure: 1}}, {steps: 30, to: {pressure: 0}}]")
_PSD = _without("psd", "the power spectral density: add record: {psd: true}")

FIGURES = table(
    Figure(
        seal.seal_volume,
        "Free volume connected to the sides of the patch, and trapped in pockets." + PANELS,
        (P, A, V, "connected_volume_fraction", "trapped_volume_fraction"),
    ),
    Figure(
        seal.seal_percolation,
        "Share of the surfaces on which void leads from side to side." + DIRECTIONS + PANELS,
        (P, A, V, "percolates"),
    ),
    Figure(
        seal.seal_transmissivity,
        "Transmissivity T*: flow with the cubed gap over that between smooth plates at the mean gap."
        + DIRECTIONS
        + PANELS,
        (P, A, V, "transmissivity"),
        refuse=_lifted,
    ),
    Figure(
        seal.seal_diffusivity,
        "Diffusivity D*: flow with the gap over that between smooth plates at the mean gap." + DIRECTIONS + PANELS,
        (P, A, V, "diffusivity"),
    ),
    Figure(
        seal.seal_leak_rate,
        "Leak rate of the patch at the pressure drop and viscosity above, in the unit of the study."
        + DIRECTIONS
        + PANELS,
        (P, A, V, "leak_rate"),
        refuse=_lifted,
    ),
    Figure(
        seal.seal_region,
        "Contact area A*, pressure p*, free volume V* and transmissivity T* inside central squares against their width "
        "over L, at a few states. The first three are over the value of the whole surface.",
        (A, "contact_area_fraction_within", "mean_pressure_within", "free_volume_within"),
        lambda cases: by_m(by_D(cases)),
    ),
    Figure(
        seal.seal_estimates,
        "Quick estimates of the transmissivity over the flow computed, against contact area A*: effective medium "
        "(left), single critical junction (right). The dashed line is agreement.",
        (A, "transmissivity", "estimate_medium_transmissivity", "estimate_junction_transmissivity"),
    ),
    Figure(
        seal.seal_map,
        "Flux along x over its mean at the recorded loads, on a logarithmic scale. The contact is blue; the circle "
        "marks the critical constriction.",
        (A, P, "flux", "gap", "critical_position"),
        single,
    ),
    Figure(
        yielding.path_loops,
        "Contact area A*, free volume V*, and leak or plastic volume against pressure p* on every leg of the path, by "
        "fractal dimension D. A dash pattern is a leg.",
        (P, A, V),
        refuse=_PATH,
        every_leg=True,
    ),
    Figure(
        yielding.yielded_map,
        "Plastic displacement over σ at the end of the path; white elements have not yielded.",
        ("heights", "residual_heights"),
        single,
        every_leg=True,
    ),
    Figure(
        ensembles.ensemble_cost,
        "Samples (left) and modelled cost (middle) on each refinement m; half-width of the 95 % interval over the mean "
        "against cost (right), after each round. Dotted lines are plain Monte Carlo, the grey line is the accuracy "
        "asked for.",
        cases=list,
        refuse=_ENSEMBLE,
    ),
    Figure(
        spectra.psd,
        "Left: radially averaged power spectral density of the undeformed surfaces by fractal dimension D; the dashed "
        "line is the law of the study, dotted lines are the deformed surface under load. Right: root mean square slope "
        "of the waves up to each wave number.",
        spectra.NEEDED,
        refuse=_PSD,
    ),
)

TRADEOFF = table(
    Figure(
        work_precision.tradeoff_precision,
        "Largest error of any state against the residual asked for (left) and against the seconds of a sweep (right). "
        "Dashed lines are the certified bounds; an error of zero is drawn at 1e-16.",
        refuse=_ladder("tolerance"),
    ),
    Figure(
        work_precision.tradeoff_resolution,
        "Relative difference to the finest refinement at the last state (left), and values over that of the finest "
        "(right), against m. Dotted lines are the errors of the named accuracies.",
        refuse=_ladder("resolution"),
    ),
    Figure(
        work_precision.tradeoff_settings,
        "Largest error of any state (left) and seconds of a sweep (right) for other numbers of steps, kernels and "
        "methods.",
        refuse=_ladder("steps"),
    ),
)
