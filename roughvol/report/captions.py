"""The captions of all figures by name, for the report: contents, units, lines and bands.

Starred quantities have no unit. Where a figure names its own surfaces, centre or band in its title, the caption leaves
that to the title.
"""

from __future__ import annotations

_BAND = " Thin lines are single surfaces; the band is one standard deviation to both sides of their mean."
_DIRECTIONS = (
    " Solid lines with filled marks run along x, dashed lines with hollow marks along y; × and + on the lower edge "
    "mark the first state at which x and y are closed."
)
_PANELS = " The panels have pressure p*, contact area A* and free volume V* along x; the title names centre and band."

CAPTIONS: dict[str, str] = {
    # the paper's
    "fig01": "The first half steps of random midpoint displacement. Arrows lead from the nodes averaged to the new "
    "node; colour is height, in the unit of L.",
    "fig02": "Surfaces of low, middle and high fractal dimension D on one vertical scale, heights over L. Sdq is the "
    "root mean square slope.",
    "fig03": "One surface at its finest refinements m on one vertical scale, heights over L. Each contains the nodes "
    "of the coarser ones.",
    "fig04a": "Real contact area fraction A* against dimensionless pressure p* by fractal dimension D." + _BAND,
    "fig04b": "Left: contact area A* against pressure p* by refinement m. Right: the slope A*/p* of each surface "
    "against the element spacing δ over L, with the fitted power law, the paper's 0.37 and Persson's D - 2.",
    "fig05": "Free volume V* against the separation d/σ of the mean planes, both dimensionless; the dashed line is "
    "V* = d/σ." + _BAND,
    "fig06a": "Free volume V* against pressure p* by fractal dimension D, both dimensionless." + _BAND,
    "fig06b": "Free volume V* against contact area A* by fractal dimension D, both dimensionless." + _BAND,
    "fig07a": "Free volume V* against pressure p* by refinement m, both dimensionless." + _BAND,
    "fig07b": "Free volume V* against contact area A* by refinement m, both dimensionless." + _BAND,
    "fig08": "A surface before contact and pressed, heights over σ from the undeformed mean plane. Elements in contact "
    "are dark blue; all of the deformation is drawn on the rough side.",
    "fig09": "Map of the free volume of each element, in the cubed unit of L. Elements in contact are dark blue.",
    "fig10": "Domains of small free volume, v ≤ v_th, in black. The threshold v_th rises from the contact alone to the "
    "largest volume v_max; the share of black elements is above each panel.",
    "fig11a": "Number of boxes of side r that meet the domain v ≤ v_th, by threshold; r in elements, both axes "
    "logarithmic.",
    "fig11b": "Local box dimension of the domains v ≤ v_th against the box side r in elements, by threshold. The "
    "dashed line is 2, the dimension of a plane.",
    "fig12a": "Probability density of the free volumes v of open elements by fractal dimension D. Volumes are in the "
    "cubed unit of L, densities in its inverse.",
    "fig12b": "Probability density of the free volumes v by refinement m, both axes logarithmic, in the cubed unit of "
    "L. Stars are the means of v and f; the line is their fit.",
    # beside the paper's
    "theory_separation": "Free volume V* against separation d/σ: computed mean (solid), V* = d/σ (dashed), with the "
    "compliance 0.9464 p* of a uniformly loaded square added (dash-dotted), and the bearing area of Gaussian heights "
    "(dotted).",
    "theory_bearing": "Free volume V* against contact area A*: computed, and by the bearing-area formula (Eq. 4) along "
    "the same loading, with and without its factor 1 - A*.",
    "theory_bins": "Free volume V* by the box dimensions of one field (Eqs. 7 to 10) against the number K of bins. The "
    "dashed line is the computed V*.",
    "theory_dimension": "Box dimension of the contact against pressure p* (left) and contact area A* (right), by "
    "fractal dimension D. Each marker is one surface at one recorded state.",
    "theory_persson": "Contact area A* against pressure p*, both axes logarithmic: mean over surfaces (solid), and "
    "Persson's theory with the root mean square slope of each surface (dashed).",
    "theory_start": "Pressure p* against indentation Δ/σ at the start of contact: computed states, the line of one "
    "element, and Hertz with the radius of the highest summit.",
    "readings_exponent": "Slope A*/p* against the element spacing δ over L under both readings of the midpoint law. "
    "Thin lines are single surfaces; the dashed lines have the paper's exponent 0.37.",
    "readings_fulcrum": "Spread of the mean density f(v) over D, relative to its mean, at each volume v in the cubed "
    "unit of L. A fulcrum would be a zero; the dotted line is v = 1, where the paper has it.",
    "full_contact": "Contact area A* (left) and free volume V* (right) against pressure p* up to full contact. Each "
    "line is one surface.",
    "volume_by_m": "Free volume V* on the mean plane against refinement m: as a mean over the elements, and as the "
    "paper's sum over L². Thin lines are single surfaces.",
    "shift": "Mean volume of the open elements against refinement m, in the cubed unit of L, with the shift of an "
    "element's area and that of δ^D. Thin lines are single surfaces; crosses are the paper's 8 and 2.",
    "seeds": "Distribution of single surfaces (bars) and of means of ten (outline): the exponent of A*/p* (left), V* "
    "at d = 0 of two neighbouring D (right).",
    # flow through the gap
    "seal_volume": "Free volume connected to the sides of the patch, and trapped in pockets." + _PANELS,
    "seal_percolation": "Share of the surfaces on which void leads from side to side." + _DIRECTIONS + _PANELS,
    "seal_transmissivity": "Transmissivity T*: flow with the cubed gap over that between smooth plates at the mean "
    "gap." + _DIRECTIONS + _PANELS,
    "seal_diffusivity": "Diffusivity D*: flow with the gap over that between smooth plates at the mean gap."
    + _DIRECTIONS
    + _PANELS,
    "seal_leak_rate": "Leak rate of the patch at the pressure drop and viscosity above, in the unit of the study."
    + _DIRECTIONS
    + _PANELS,
    "seal_region": "Contact area A*, pressure p*, free volume V* and transmissivity T* inside central squares against "
    "their width over L, at a few states. The first three are over the value of the whole surface.",
    "seal_estimates": "Quick estimates of the transmissivity over the flow computed, against contact area A*: "
    "effective medium (left), single critical junction (right). The dashed line is agreement.",
    "seal_map": "Flux along x over its mean at the recorded loads, on a logarithmic scale. The contact is blue; the "
    "circle marks the critical constriction.",
    # paths and yield
    "path_loops": "Contact area A*, free volume V*, and leak or plastic volume against pressure p* on every leg of the "
    "path, by fractal dimension D. A dash pattern is a leg.",
    "yielded_map": "Plastic displacement over σ at the end of the path; white elements have not yielded.",
    # ensembles
    "ensemble_cost": "Samples (left) and modelled cost (middle) on each refinement m; half-width of the 95 % interval "
    "over the mean against cost (right), after each round. Dotted lines are plain Monte Carlo, "
    "the grey line is the accuracy asked for.",
    # the spectrum of the surfaces
    "psd": "Left: radially averaged power spectral density of the undeformed surfaces by fractal dimension D; the "
    "dashed line is the law of the study, dotted lines are the deformed surface under load. Right: root mean square "
    "slope of the waves up to each wave number.",
    # speed against accuracy
    "tradeoff_precision": "Largest error of any state against the residual asked for (left) and against the seconds of "
    "a sweep (right). Dashed lines are the certified bounds; an error of zero is drawn at 1e-16.",
    "tradeoff_resolution": "Relative difference to the finest refinement at the last state (left), and values over "
    "that of the finest (right), against m. Dotted lines are the errors of the named accuracies.",
    "tradeoff_settings": "Largest error of any state (left) and seconds of a sweep (right) for other numbers of steps, "
    "kernels and methods.",
}


def caption(name: str, *, surfaces: int = 2, measured: bool = False) -> str:
    """Return the caption of a figure, its name where it has none.

    Parameters
    ----------
    name : str
        Name of the figure.
    surfaces : int
        Number of surfaces of a kind that it shows; a single one has no band.
    measured : bool
        Whether the surfaces come from files and have no D.
    """
    text = CAPTIONS.get(name, name)
    text = text.removesuffix(_BAND) if surfaces < 2 else text
    return text.replace(" by fractal dimension D", "") if measured else text
