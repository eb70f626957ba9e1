"""The tables of the paper's figures, one row a figure: drawing, caption, variables, cases, conditions of the paper.

`FIGURES` are Figs. 1 to 12, each drawn from one run. `COMPARISONS` are theories, second readings and many seeds, each
drawn from the runs of a report.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import matplotlib as mpl

from roughvol.report.figures import registry
from roughvol.report.figures.cases import by_D, by_m, single
from roughvol.report.figures.figure import BAND, Figure, table
from roughvol.report.figures.style import D_SIGMA, STYLE, A, Drawing, P, V
from roughvol.reproduction.figures import paper, theory
from roughvol.reproduction.figures.conditions import LAST, PaperFigure
from roughvol.reproduction.paper_rules import PAPER_A, PAPER_D, PAPER_M

by_D_at_7 = partial(by_D, wish=PAPER_M)
of_D: dict[str, Any] = {"by": "D", "m": (8,), "surfaces": 10, "end": LAST}
of_m: dict[str, Any] = {"cases": by_m, "by": "m", "D": (PAPER_D,), "end": LAST}
of_state: dict[str, Any] = {"cases": single, "D": (PAPER_D,), "m": (PAPER_M,), "area": PAPER_A}


class Comparison(Figure):
    """A figure of several runs: call it with the `Evidence` of a report; it raises `Lacking` where no run fits."""

    def __call__(self, evidence: Any) -> Drawing:
        """Return the figure of the runs of a report."""
        with mpl.rc_context(STYLE):
            return self.draw(evidence)


FIGURES: dict[str, Any] = table(
    PaperFigure(
        paper.fig01,
        "The first half steps of random midpoint displacement. Arrows lead from the nodes averaged to the new node; "
        "colour is height, in the unit of L.",
        ("heights",),
        cases=single,
        by="recursion",
    ),
    PaperFigure(
        paper.fig02,
        "Surfaces of low, middle and high fractal dimension D on one vertical scale, heights over L. Sdq is the root "
        "mean square slope.",
        ("heights",),
        cases=by_D_at_7,
        by="D",
        D=(2.1, 2.5, 2.9),
        m=(7,),
    ),
    PaperFigure(
        paper.fig03,
        "One surface at its finest refinements m on one vertical scale, heights over L. Each contains the nodes of "
        "the coarser ones.",
        ("heights",),
        cases=by_m,
        by="m",
        m=(5, 6, 7, 8),
    ),
    PaperFigure(
        paper.fig04a,
        "Real contact area fraction A* against dimensionless pressure p* by fractal dimension D." + BAND,
        (A, P),
        **of_D,
    ),
    PaperFigure(
        paper.fig04b,
        "Left: contact area A* against pressure p* by refinement m. Right: the slope A*/p* of each surface against "
        "the element spacing δ over L, with the fitted power law, the paper's 0.37 and Persson's D - 2.",
        (A, P),
        surfaces=1,
        **of_m,
    ),
    PaperFigure(
        paper.fig05,
        "Free volume V* against the separation d/σ of the mean planes, both dimensionless; the dashed line is V* = "
        "d/σ." + BAND,
        (D_SIGMA, V),
        D=(2.1, 2.9),
        end=LAST,
    ),
    PaperFigure(
        paper.fig06a,
        "Free volume V* against pressure p* by fractal dimension D, both dimensionless." + BAND,
        (P, V),
        **of_D,
    ),
    PaperFigure(
        paper.fig06b,
        "Free volume V* against contact area A* by fractal dimension D, both dimensionless." + BAND,
        (A, V),
        **of_D,
    ),
    PaperFigure(
        paper.fig07a,
        "Free volume V* against pressure p* by refinement m, both dimensionless." + BAND,
        (P, V),
        surfaces=1,
        **of_m,
    ),
    PaperFigure(
        paper.fig07b,
        "Free volume V* against contact area A* by refinement m, both dimensionless." + BAND,
        (A, V),
        surfaces=1,
        **of_m,
    ),
    PaperFigure(
        paper.fig08,
        "A surface before contact and pressed, heights over σ from the undeformed mean plane. Elements in contact are"
        " dark blue; all of the deformation is drawn on the rough side.",
        ("heights", "gap"),
        **of_state,
    ),
    PaperFigure(
        paper.fig09,
        "Map of the free volume of each element, in the cubed unit of L. Elements in contact are dark blue.",
        ("gap",),
        **of_state,
    ),
    PaperFigure(
        paper.fig10,
        "Domains of small free volume, v ≤ v_th, in black. The threshold v_th rises from the contact alone to the "
        "largest volume v_max; the share of black elements is above each panel.",
        ("gap",),
        **of_state,
    ),
    PaperFigure(
        paper.fig11a,
        "Number of boxes of side r that meet the domain v ≤ v_th, by threshold; r in elements, both axes logarithmic.",
        ("box_count",),
        **of_state,
    ),
    PaperFigure(
        paper.fig11b,
        "Local box dimension of the domains v ≤ v_th against the box side r in elements, by threshold. The dashed "
        "line is 2, the dimension of a plane.",
        ("local_dimension",),
        **of_state,
    ),
    PaperFigure(
        paper.fig12a,
        "Probability density of the free volumes v of open elements by fractal dimension D. Volumes are in the cubed "
        "unit of L, densities in its inverse.",
        ("volume_density", "volume_density_edges"),
        cases=by_D_at_7,
        by="D",
        m=(7,),
        end=LAST,
    ),
    PaperFigure(
        paper.fig12b,
        "Probability density of the free volumes v by refinement m, both axes logarithmic, in the cubed unit of L. "
        "Stars are the means of v and f; the line is their fit.",
        ("volume_density", "volume_density_edges"),
        m=(3, 4, 5, 6, 7, 8),
        **of_m,
    ),
)

COMPARISONS = table(
    Comparison(
        theory.theory_separation,
        "Free volume V* against separation d/σ: computed mean (solid), V* = d/σ (dashed), with the compliance 0.9464 "
        "p* of a uniformly loaded square added (dash-dotted), and the bearing area of Gaussian heights (dotted).",
    ),
    Comparison(
        theory.theory_bearing,
        "Free volume V* against contact area A*: computed, and by the bearing-area formula (Eq. 4) along the same "
        "loading, with and without its factor 1 - A*.",
    ),
    Comparison(
        theory.theory_bins,
        "Free volume V* by the box dimensions of one field (Eqs. 7 to 10) against the number K of bins. The dashed "
        "line is the computed V*.",
    ),
    Comparison(
        theory.theory_dimension,
        "Box dimension of the contact against pressure p* (left) and contact area A* (right), by fractal dimension D."
        " Each marker is one surface at one recorded state.",
    ),
    Comparison(
        theory.theory_persson,
        "Contact area A* against pressure p*, both axes logarithmic: mean over surfaces (solid), and Persson's theory"
        " with the root mean square slope of each surface (dashed).",
    ),
    Comparison(
        theory.theory_start,
        "Pressure p* against indentation Δ/σ at the start of contact: computed states, the line of one element, and "
        "Hertz with the radius of the highest summit.",
    ),
    Comparison(
        theory.readings_exponent,
        "Slope A*/p* against the element spacing δ over L under both readings of the midpoint law. Thin lines are "
        "single surfaces; the dashed lines have the paper's exponent 0.37.",
    ),
    Comparison(
        theory.readings_fulcrum,
        "Spread of the mean density f(v) over D, relative to its mean, at each volume v in the cubed unit of L. A "
        "fulcrum would be a zero; the dotted line is v = 1, where the paper has it.",
    ),
    Comparison(
        theory.full_contact,
        "Contact area A* (left) and free volume V* (right) against pressure p* up to full contact. Each line is one "
        "surface.",
    ),
    Comparison(
        theory.volume_by_m,
        "Free volume V* on the mean plane against refinement m: as a mean over the elements, and as the paper's sum "
        "over L². Thin lines are single surfaces.",
    ),
    Comparison(
        theory.shift,
        "Mean volume of the open elements against refinement m, in the cubed unit of L, with the shift of an "
        "element's area and that of δ^D. Thin lines are single surfaces; crosses are the paper's 8 and 2.",
    ),
    Comparison(
        theory.seeds,
        "Distribution of single surfaces (bars) and of means of ten (outline): the exponent of A*/p* (left), V* at d "
        "= 0 of two neighbouring D (right).",
    ),
)

ALL: dict[str, Figure] = FIGURES | registry.FIGURES
"""The figures of one run, those of the paper first."""
