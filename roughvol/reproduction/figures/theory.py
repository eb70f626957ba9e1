"""Figures of the report that the paper does not have: theory beside computation, second readings, many seeds.

Each is a function of the runs of a report (`Evidence`), since most compare several. It chooses them as the claims do,
by their variables, and raises `Lacking` where there is none.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roughvol.report.figures.cases import nearest
from roughvol.report.figures.style import GREY, LABELS, PAGE, Drawing, axes, legend, looks
from roughvol.reproduction import closed_forms, formulas
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims import density, shape, volume_formulas
from roughvol.reproduction.claims.area_and_volume import exponents
from roughvol.reproduction.claims.evidence import D_SIGMA, A, Evidence, P, V, area_slopes, at, common, require
from roughvol.reproduction.claims.many_seeds import FEW
from roughvol.reproduction.figures.conditions import ACCENT, SECOND, is_paper_surface
from roughvol.reproduction.figures.element_volumes import volume_label, volume_unit
from roughvol.reproduction.needs import PAPER_D, PAPER_M, Needs
from roughvol.store.dataset import recorded_state
from roughvol.surfaces import texture
from roughvol.typing import Array

END = "mean-plane"
POINTS = 200  # of a curve


def _mean(run: ClaimRun, x: str, y: str, D: float, m: int) -> tuple[Array, Array]:
    """Return the mean over surfaces of y on the range of x that all reach."""
    axis = run.values(x, D=D, m=m)
    grid = common([axis], POINTS)
    return grid, at(axis, run.values(y, D=D, m=m), grid).mean(axis=0)


def _count(run: ClaimRun, words: str = "") -> str:
    return "one surface" if run.seeds == 1 else f"{words}{run.seeds} surfaces"


def _noted(fig: Drawing, *runs: ClaimRun) -> Drawing:
    """Name the runs that a figure is drawn from below it."""
    names = list(dict.fromkeys(run.name for run in runs))
    fig.note(f"{'Run' if len(names) == 1 else 'Runs'} {', '.join(names)}.")
    return fig


def theory_separation(evidence: Evidence) -> Drawing:
    """V* against d/σ: the computed mean, V* = d/σ, V* = d/σ + 0.9464 p* (a uniformly loaded specimen), and Eq. 4.

    Dotted: the bearing area of Gaussian heights, the volume under a rigid plane. What lies above it is elastic.
    """
    run = evidence.best(Needs((V, P, D_SIGMA), end=END))
    m, ends = max(run.m), list(dict.fromkeys((run.D[0], run.D[-1])))
    fig, ax = axes()
    far = max(float(run.values(D_SIGMA, D=D, m=m).max()) for D in ends)
    line = np.linspace(0.0, far, POINTS)
    ax.plot(line, line, "k--", lw=0.8, label=r"$V^{\ast} = d/\sigma$")
    ax.plot(line, formulas.bearing_area_volume(line), "k:", lw=0.9, label="bearing area, Gaussian")
    for D, look in zip(ends, looks(len(ends)), strict=True):
        colour = look["color"]
        separation, volume = _mean(run, D_SIGMA, V, D, m)
        pressure = _mean(run, D_SIGMA, P, D, m)[1]
        ax.plot(separation, volume, color=colour, label=f"computed, $D = {D:g}$")
        compliant = separation + closed_forms.rectangle_mean_displacement((1.0, 1.0)) * pressure
        label = r"$d/\sigma + 0.9464\,p^{\ast}$" + f", $D = {D:g}$"
        ax.plot(separation, compliant, color=colour, ls="-.", lw=0.9, label=label)
    ax.set(xlabel=LABELS[D_SIGMA], ylabel=LABELS[V])
    legend(ax, f"$m = {m}$, {_count(run, 'mean of ')}")
    return _noted(fig, run)


def theory_bearing(evidence: Evidence) -> Drawing:
    """V* against A*: computed, and Eq. 4 along the same loading, with and without its factor 1 - A*.

    Eq. 4 is evaluated at the computed d/σ and A*, for Gaussian heights and for the heights of the surfaces.
    """
    run = evidence.best(Needs((V, A, D_SIGMA), D=(PAPER_D,), end=END))
    m = max(run.m)
    separation, area, volume = (run.values(name, D=PAPER_D, m=m) for name in (D_SIGMA, A, V))
    heights = [run.surface(PAPER_D, m, seed).heights for seed in run.seed_numbers()]
    own = np.array([formulas.bearing_area_volume(*pair) for pair in zip(separation, heights, strict=True)])
    gauss = formulas.bearing_area_volume(separation)
    grid = common([area], POINTS)
    fig, ax = axes()
    curves = (
        ("computed", volume, "k", "-"),
        ("Eq. 4, Gaussian", gauss * (1.0 - area), ACCENT, "-"),
        (r"Gaussian, without $1 - A^{\ast}$", gauss, ACCENT, "--"),
        ("Eq. 4, own heights", own * (1.0 - area), SECOND, "-"),
        (r"own heights, without $1 - A^{\ast}$", own, SECOND, "--"),
    )
    for label, values, colour, style in curves:
        ax.plot(grid, at(area, values, grid).mean(axis=0), color=colour, ls=style, label=label)
    ax.set(xlabel=LABELS[A], ylabel=LABELS[V], ylim=(0.0, None))
    legend(ax, f"$D = {PAPER_D:g}$, $m = {m}$, {_count(run, 'mean of ')}")
    return _noted(fig, run)


def theory_bins(evidence: Evidence) -> Drawing:
    """V* of Eqs. 7 to 10 from the box dimensions of one field, against the number K of bins.

    As printed (each element counted at the width of its bin) the sum falls as 1/K; counted at the volume of the bin
    it converges to the computed V* (dashed).
    """
    run = evidence.best(Needs(("gap",)))
    state = shape.field(run)
    fig, ax = axes()
    names = (r"$\sum n_k v_k$", "as printed", r"$\sum n_k v_k$, one dimension fitted")
    for kind, label, look in zip(volume_formulas.KINDS, names, looks(3), strict=True):
        ax.plot(volume_formulas.BINS, volume_formulas.estimates(state, *kind), label=label, **look)
    ax.axhline(state.numbers[V], color="k", ls="--", lw=0.8, label=r"computed $V^{\ast}$")
    ax.set(xscale="log", yscale="log", xlabel="number of bins $K$", ylabel=LABELS[V])
    ax.set_xticks(volume_formulas.BINS, list(map(str, volume_formulas.BINS)))
    ax.set_xticks([], minor=True)
    legend(ax, state.words.replace("A*", r"$A^{\ast}$"))
    return _noted(fig, run)


def theory_dimension(evidence: Evidence) -> Drawing:
    """Show the box dimension of the contact against pressure (left) and A* (right), by D: every surface and state.

    At equal pressure it rises with p* and falls with D. At equal area the difference between D is smaller, but there.
    """
    run = evidence.best(Needs(("box_count",), by="D"))
    m = max(run.m)
    labels = run.dataset["box_at"].values.tolist()
    fig, panels = axes(PAGE, 2.9, 2)
    for D, look in zip(run.D, looks(len(run.D)), strict=True):
        points = []
        for place, label in enumerate(labels):
            r, counts = shape.boxes(run, D, m, label)
            dimensions = shape.fitted_dimension(r, counts[:, 0])
            steps = run.dataset["box_at_step"].sel(D=D, m=m, box_at=label).values
            for k in np.flatnonzero(steps > 0):
                state = recorded_state(run.dataset.sel(D=D, m=m).isel(seed=k), "box_at", place, P, A)
                points.append((float(state[P]), float(state[A]), dimensions[k]))
        p, a, dimension = np.array(points).T
        for ax, x in zip(panels, (p, a), strict=True):
            ax.plot(x, dimension, ls="", alpha=0.6, label=f"$D = {D:g}$", **look)
    for ax, label in zip(panels, (LABELS[P], LABELS[A]), strict=True):
        ax.set(xscale="log", xlabel=label, ylabel="box dimension of the contact")
        legend(ax, f"$m = {m}$, {_count(run)} each")
    return _noted(fig, run)


def theory_persson(evidence: Evidence) -> Drawing:
    """Draw A* against p*: the mean over surfaces, and Persson's erf(√2 p/(E* h')) with the rms slope of each."""
    run = evidence.best(Needs((A, P), by="D", end=END))
    m = max(run.m)
    fig, ax = axes()
    for D, look in zip(run.D, looks(len(run.D)), strict=True):
        pressure, area = _mean(run, P, A, D, m)
        ax.plot(pressure, area, color=look["color"], label=f"$D = {D:g}$")
        sdq, sq = (run.values(name, D=D, m=m) for name in ("Sdq", "Sq"))
        laws = [formulas.persson_area(pressure, h, Sq=s, side=run.L) for h, s in zip(sdq, sq, strict=True)]
        ax.plot(pressure, np.mean(laws, axis=0), color=look["color"], ls="--", lw=0.9)
    ax.set(xlabel=LABELS[P], ylabel=LABELS[A], xscale="log", yscale="log", xlim=(1e-2, None), ylim=(1e-4, None))
    legend(ax, f"$m = {m}$; solid: computed, dashed: Persson")
    return _noted(fig, run)


def theory_start(evidence: Evidence) -> Drawing:
    """Show the start of contact: p* against Δ/σ, one element (p = Δ/H₀), and Hertz on the highest summit.

    Until a second element touches, the computed points lie on the line of one element: the lattice does not resolve
    the tip, whose radius (mean curvature of the highest node) is below the spacing.
    """
    runs = evidence.fit(Needs((P, "indentation"), end="indentation"))
    require(runs, "a sweep to a small indentation")
    run = runs[0]
    D, m, seed = run.D[0], max(run.m), run.seed_numbers()[0]
    surface = run.surface(D, m, seed)
    indentation, pressure = (run.values(name, D=D, m=m)[0] for name in ("indentation", P))
    elements = np.round(run.values(A, D=D, m=m)[0] * surface.heights.size)
    nodes, scale = surface.heights.size, surface.side / surface.Sq
    forces = [closed_forms.single_element_pressure(d * surface.Sq, surface.spacing) for d in indentation]
    element = [force / nodes * scale for force in forces]
    i, j = np.unravel_index(int(surface.heights.argmax()), surface.shape)
    i, j = (place + surface.periodic for place in (i, j))  # in the heights with their neighbours
    tip = surface.with_neighbours[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2]
    fig, ax = axes()
    ax.plot(indentation, pressure, "ko", ms=2.5, label="computed")
    ax.plot(indentation, element, color=ACCENT, label="one element")
    if tip.shape == (3, 3):
        radius = texture.summit_radius(tip, surface.spacing)
        area = nodes * surface.spacing**2
        forces = [closed_forms.hertz(d * surface.Sq, radius).force for d in indentation]
        label = rf"Hertz, $\rho = {radius / surface.spacing:.2f}\,\delta$"
        ax.plot(indentation, [force / area * scale for force in forces], color=SECOND, ls="--", label=label)
    second = np.flatnonzero(elements > 1)
    if second.size:
        ax.axvline(indentation[second[0]], color=GREY, lw=0.7, ls=":", label="second element")
    ax.set(xscale="log", yscale="log", xlabel=r"indentation $\Delta/\sigma$", ylabel=LABELS[P])
    legend(ax, f"$D = {D:g}$, $m = {m}$, one surface")
    return _noted(fig, run)


def readings_exponent(evidence: Evidence) -> Drawing:
    """A*/p* against the spacing under both readings of the midpoint law, for every surface, with the fitted exponents.

    The default (standard deviation divided) has the paper's exponent; the printed variance has nearly twice that.
    """
    fig, ax = axes()
    used_runs: list[ClaimRun] = []
    for law, look in zip(("std", "variance"), looks(2), strict=True):
        for run in evidence.fit(Needs((A, P), by="m", law=law, D=(PAPER_D,), end=END))[:1]:
            slopes, limit = area_slopes(run, [PAPER_D], run.m)
            spacing = np.array([2.0**-m for m in run.m])
            values = np.array([slopes[PAPER_D, m] for m in run.m])
            powers, _, used = exponents(run, PAPER_D, 4)
            label = rf"{law} divided: $n = {powers.mean():.2f}$ ($m = {used[0]}$ to ${used[-1]}$)"
            ax.plot(spacing, values, color=look["color"], lw=0.3, alpha=0.6)
            ax.plot(spacing, np.exp(np.log(values).mean(axis=1)), label=label, **look)
            centre = np.exp(np.log(values[-4:]).mean())
            law_037 = centre * (spacing / np.exp(np.log(spacing[-4:]).mean())) ** 0.37
            ax.plot(spacing, law_037, color=ACCENT, ls="--", lw=0.9, label="" if used_runs else "paper: 0.37")
            used_runs.append(run)
    require(used_runs, "runs of several m")
    slope = rf"$A^{{\ast}}/p^{{\ast}}$ (line through 0, $p^{{\ast}} \leq {limit:.2f}$)"
    ax.set(xlabel=r"spacing $\delta/L$", ylabel=slope, yscale="log")
    ax.set_xscale("log", base=2)
    legend(ax, f"$D = {PAPER_D:g}$")
    return _noted(fig, *used_runs)


def readings_fulcrum(evidence: Evidence) -> Drawing:
    """Show how much the mean f(v) spreads over D at each v under each reading: a fulcrum would be a zero.

    The paper sees it at v = 1 (dotted).
    """
    fig, ax = axes()
    sources = (
        ("std", "mean-plane", "default"),
        ("variance", "mean-plane", "variance law"),
        ("std", "summit-plane", "summit plane"),
    )
    volumes = np.linspace(0.02, 2.5, 80)
    drawn: list[ClaimRun] = []
    for (law, end, words), look in zip(sources, looks(3), strict=True):
        for run in evidence.fit(Needs((density.F, density.EDGES), by="D", law=law, end=end))[:1]:
            m = int(nearest(run.m, PAPER_M))
            data = {D: density.densities(run, D, m) for D in run.D}
            few = {D: pair for D, pair in data.items() if D <= 2.51}
            spreads = [density.fulcrum(density.values_by_D(data, v)) for v in volumes]
            ax.plot(volumes, spreads, color=look["color"], label=f"{words}, all $D$")
            if len(few) > 1:
                spreads = [density.fulcrum(density.values_by_D(few, v)) for v in volumes]
                ax.plot(volumes, spreads, color=look["color"], ls="--", lw=0.9, label=f"{words}, $D \\leq 2.5$")
            drawn.append(run)
    require(drawn, "densities for several D")
    if all(is_paper_surface(run.dataset) for run in drawn):
        ax.axvline(1.0, color=GREY, lw=0.7, ls=":")
    ax.set(xlabel=volume_label(drawn[0].dataset), ylabel="spread of $f(v)$ over $D$, relative", ylim=(0.0, None))
    legend(ax, "")
    return _noted(fig, *drawn)


def full_contact(evidence: Evidence) -> Drawing:
    """Draw A* and V* against p* on the way to full contact: A* = 1 and V* = 0 at a finite pressure."""
    runs = [run for run in evidence.fit(Needs((V, A, P))) if float(run.dataset[D_SIGMA].min()) < -10.0]
    require(runs, "a run pressed to full contact")
    run = runs[0]
    m = max(run.m)
    fig, panels = axes(PAGE, 2.9, 2)
    for D, look in zip(run.D, looks(len(run.D)), strict=True):
        for ax, y in zip(panels, (A, V), strict=True):
            for seed, (x, values) in enumerate(zip(run.values(P, D=D, m=m), run.values(y, D=D, m=m), strict=True)):
                label = "" if seed else f"$D = {D:g}$"
                ax.plot(x, values, color=look["color"], lw=0.7, alpha=0.8, label=label)
    for ax, y in zip(panels, (A, V), strict=True):
        ax.set(xlabel=LABELS[P], ylabel=LABELS[y], xscale="log")
        legend(ax, f"$m = {m}$, {_count(run)} each")
    return _noted(fig, run)


def volume_by_m(evidence: Evidence) -> Drawing:
    """V* on the mean plane against m: as a mean over the elements, and as the literal sum V/(L²σ).

    The decay of the literal sum is the factor (1 + 2^-m)², the elements that stick out of L².
    """
    run = evidence.best(Needs((V,), by="m", D=(PAPER_D,), end=END))
    values = np.array([run.last(V, D=PAPER_D, m=m) for m in run.m])
    factor = np.array([[(1.0 + 2.0**-m) ** 2] for m in run.m])
    fig, ax = axes()
    sums = (("mean over elements", values), (r"$V/(L^2\sigma)$", values * factor))
    for (label, volumes), look in zip(sums, looks(2), strict=True):
        ax.plot(run.m, volumes, color=look["color"], lw=0.3, alpha=0.5)
        ax.plot(run.m, volumes.mean(axis=1), label=label, **look)
    ax.set(xlabel="$m$", ylabel=LABELS[V] + " at $d = 0$", xticks=run.m)
    legend(ax, f"$D = {PAPER_D:g}$, {_count(run)}")
    return _noted(fig, run)


def shift(evidence: Evidence) -> Drawing:
    """Mean volume of the open elements against m, with a shift per m of 0.602 (area of an element) and of D log₁₀ 2.

    The thin lines are single surfaces; the paper's numbers are 8 at m = 6 and 2 at m = 7 (crosses).
    """
    run = evidence.best(Needs((density.F, density.EDGES), by="m", D=(PAPER_D,), end=END))
    means = np.array([volume for volume, _, _ in density.moments(run, PAPER_D).values()])
    fig, ax = axes()
    ax.plot(run.m, means, color=GREY, lw=0.4)
    centre, ms = np.exp(np.log(means).mean(axis=1)), np.array(run.m)
    ax.plot(ms, centre, "ko", label="computed")
    laws = [(2.0, r"$\delta^2$: 0.602 per $m$", SECOND, "-"), (PAPER_D, r"$\delta^D$: 0.692 per $m$", ACCENT, "--")]
    for power, words, colour, style in laws:
        ax.plot(ms, centre[0] * 2.0 ** (-power * (ms - ms[0])), color=colour, ls=style, label=words)
    if {6, 7} <= set(run.m) and is_paper_surface(run.dataset):
        ax.plot([6, 7], [8.0, 2.0], "x", color=ACCENT, ms=6, label="paper: 8 and 2")
    label = rf"mean volume $\overline{{v}}$ [{volume_unit(run.dataset)}]"
    ax.set(xlabel="$m$", ylabel=label, yscale="log", xticks=run.m)
    legend(ax, f"$D = {PAPER_D:g}$, $d = 0$")
    return _noted(fig, run)


def seeds(evidence: Evidence) -> Drawing:
    """How far few surfaces can mislead: single surfaces (bars) and means of ten (line), out of all of a run.

    Left the exponent of A*/p*, right V* at d = 0 of the smallest and the next D, which single surfaces confuse.
    """
    runs = [run for run in evidence.fit(Needs((A, P, V), by="m", end=END)) if run.seeds >= 3 * FEW]
    require(runs, f"a run of {3 * FEW} surfaces and several m")
    run = max(runs, key=lambda run: run.seeds)
    random = np.random.Generator(np.random.PCG64(1))
    sets = np.array([random.choice(run.seeds, FEW, replace=False) for _ in range(5000)])
    m, D = max(run.m), nearest(run.D, PAPER_D)
    fig, (left, right) = axes(PAGE, 2.9, 2)
    _histogram(left, exponents(run, D, len(run.m))[0], sets, looks(2)[0], "one surface", "ten surfaces")
    left.axvline(0.37, color=ACCENT, ls="--", lw=0.9, label="paper: 0.37")
    left.axvline(D - 2.0, color=GREY, ls=":", lw=0.9, label=f"Persson: {D - 2:.2f}")
    left.set(xlabel=rf"$n$ of $A^{{\ast}}/p^{{\ast}} \sim \delta^n$, $m = {run.m[0]}$ to ${m}$", ylabel="density")
    legend(left, f"$D = {D:g}$, {_count(run)}")
    for D, look in zip(run.D[:2], looks(3), strict=False):
        _histogram(right, run.last(V, D=D, m=m), sets, look, f"one, $D = {D:g}$", f"ten, $D = {D:g}$")
    right.set(xlabel=LABELS[V] + " at $d = 0$", ylabel="density")
    legend(right, f"$m = {m}$, {_count(run)} each")
    return _noted(fig, run)


def _histogram(ax: Any, values: Array, sets: NDArray[Any], look: dict[str, Any], one: str, ten: str) -> None:
    bins = max(10, round(math.sqrt(values.size)))
    ax.hist(values, bins=bins, density=True, color=look["color"], alpha=0.3, label=one)
    heights, edges = np.histogram(values[sets].mean(axis=1), bins=25, density=True)
    ax.stairs(heights, edges, color=look["color"], lw=1.1, label=ten)
