"""The drawings of a leak card: leak against load, map of the flux, error budget; and the card as a page of print."""

from __future__ import annotations

import math
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, LogNorm
from xarray import Dataset

from roughvol.analysis.leak_budget import AXES, Card, leaks, state_of, unit_leaks
from roughvol.analysis.tables import number
from roughvol.observables.at_state import at_state
from roughvol.report.figures.origin import first_leg
from roughvol.report.figures.style import (
    CONTACT,
    DASHES,
    GREY,
    LABELS,
    PAGE,
    STYLE,
    Drawing,
    P,
    canvas,
    looks,
    plain_ticks,
    unit_text,
)

A4 = (8.27, 11.69)
CROWDED = 50.0  # largest factor from which on only its powers of ten are labelled
FLUX_RANGE = (1e-2, 1e2)  # of the flux over its mean


def drawing_of(card: Card, fine: Dataset) -> Drawing:
    """Return the three drawings of a card side by side.

    Parameters
    ----------
    card : Card
        The card.
    fine : Dataset
        The run on the finest grid.

    Returns
    -------
    Drawing
        Leak against load, map of the flux, error budget.
    """
    with mpl.rc_context(STYLE):
        fig = canvas(PAGE * 1.35, 3.0)
        _draw(fig.subplots(1, 3, width_ratios=(1.1, 1.0, 1.0)), card, fine)
    return fig


def page_of(card: Card, fine: Dataset) -> Drawing:
    """Return the card as one page of A4: facts, leaks with their budget, drawings, warnings.

    Parameters
    ----------
    card, fine
        As in `drawing_of`.

    Returns
    -------
    Drawing
        One page.
    """
    with mpl.rc_context(STYLE):
        fig = Drawing(figsize=A4, layout="constrained", dpi=150)
        engine = fig.get_layout_engine()
        if engine is not None:
            engine.set(rect=(0.03, 0.02, 0.94, 0.96))  # type: ignore[call-arg]
        parts: Any = fig.subfigures(3, 1, height_ratios=(1.25, 1.0, 1.0))
        top, middle, bottom = parts
        _text(top, card)
        _draw(middle.subplots(1, 3, width_ratios=(1.1, 1.0, 1.0)), card, fine)
        lines = [*card.warnings] or ["No limit of the model is passed."]
        words = "\n".join(f"•  {_wrapped(line, 125)}" for line in lines)
        bottom.text(0.06, 0.95, "Limits of the model", fontsize=11, weight="bold", va="top")
        bottom.text(0.06, 0.86, words, fontsize=8, va="top")
    return fig


def _text(figure: Any, card: Card) -> None:
    """Write title, facts, leaks and budget."""
    figure.text(0.06, 0.97, f"Leak card: {card.title}", fontsize=16, weight="bold", va="top")
    facts = "\n".join(f"{name}:  {value}" for name, value in card.facts)
    figure.text(0.06, 0.86, facts, fontsize=9.5, va="top", linespacing=1.5 if len(card.facts) < 7 else 1.2)
    for column, way in enumerate(card.ways):
        x = 0.06 + 0.47 * column
        figure.text(x, 0.52, f"Along {way.axis}", fontsize=11, weight="bold", va="top")
        lines = [headline(card, column), f"closes: {way.closing}", ""]
        lines += [f"{part.name}: {_factor(part.factor)}  {_wrapped(part.words, 58)}" for part in way.parts]
        figure.text(x, 0.46, "\n".join(lines), fontsize=8.5, va="top", linespacing=1.4)


def headline(card: Card, column: int) -> str:
    """Return the leak along an axis with its interval, in words.

    Parameters
    ----------
    card : Card
        The card.
    column : int
        Number of the axis.

    Returns
    -------
    str
        Leak, unit and interval.
    """
    way = card.ways[column]
    if not way.leak > 0.0:
        return "closed: no leak at this load"
    low, high = way.interval
    unit = f" {unit_text(way.unit)}" if way.unit else " (T* V*³)"
    unknown = [part.name for part in way.parts if not math.isfinite(part.factor)]
    beyond = f"; {' and '.join(unknown)} not known" if unknown else ""
    return f"{way.leak:.3g}{unit}, between {low:.2g} and {high:.2g}{beyond}"


def _factor(factor: float) -> str:
    return f"×÷ {number(factor)}" if math.isfinite(factor) else "unknown"


def _wrapped(text: str, width: int) -> str:
    """Return text in lines of a width, further ones indented."""
    lines, line = [], ""
    for word in text.split():
        if line and len(line) + len(word) >= width:
            lines.append(line)
            line = word
        else:
            line = f"{line} {word}".strip()
    return "\n     ".join([*lines, line])


def _draw(panels: Any, card: Card, fine: Dataset) -> None:
    left, middle, right = panels
    _against_load(left, card, fine)
    _flux_map(middle, fine)
    _budget(right, card)


def _against_load(ax: Axes, card: Card, fine: Dataset) -> None:
    """Draw the leak of the mean surface over the load, and the interval at the load of the card."""
    first = first_leg(fine)
    cases = [dim for dim in ("D", "m", "seed", "case") if dim in first.dims]
    loads = "nominal_pressure" if "nominal_pressure" in first else P
    pressure = first[loads].mean(cases).values
    state = float(fine["flux_at_mean_pressure"].mean())
    starred = first[P].mean(cases).values
    at = float(at_state(starred, pressure, np.clip(state, starred[0], starred[-1]), straight=True)[0])
    for order, (axis, way, look) in enumerate(zip(AXES, card.ways, looks(2), strict=True)):
        factors, _ = unit_leaks(fine, axis)
        starred = (first[f"transmissivity_{axis}"] * first["free_volume"] ** 3).values.reshape(-1, pressure.size)
        with np.errstate(divide="ignore"):
            mean = np.exp(np.log(starred * factors[:, None]).mean(axis=0))
        drawn = np.where(mean > 0.0, mean, np.nan)
        ax.plot(pressure, drawn, ls=DASHES[order], color=look["color"], label=f"along ${axis}$")
        if way.leak > 0.0:
            low, high = way.interval
            error = np.array([[way.leak - low], [high - way.leak]])
            beside = at + (order - 0.5) * 0.02 * float(pressure[-1])  # so that two intervals can be seen apart
            ax.errorbar([beside], [way.leak], yerr=error, fmt=look["marker"], color=look["color"], capsize=3)
    unit = card.ways[0].unit
    load = LABELS[P] if loads == P else f"nominal pressure [{unit_text(str(fine[loads].attrs['units']))}]"
    ax.set(yscale="log", xlabel=load, ylabel=f"leak [{unit_text(unit)}]" if unit else r"leak $T^{\ast} V^{\ast 3}$")
    ax.legend()


def _flux_map(ax: Axes, fine: Dataset) -> None:
    """Draw the flux along x over its mean on the first surface that reaches the load."""
    state = state_of(fine, int(np.flatnonzero(np.isfinite(leaks(fine, "x")))[0]))
    flux, gap = (state[name].transpose("x", "y").values for name in ("flux_x", "gap"))
    mean = np.nanmean(flux)
    image = np.where(flux > 0.0, flux / mean, np.nan) if mean > 0.0 else np.full(flux.shape, np.nan)
    extent = (0.0, 1.0, 0.0, (flux.shape[1] - 1) / (flux.shape[0] - 1))
    shown: dict[str, Any] = {"origin": "lower", "extent": extent, "interpolation": "none"}
    ax.imshow(np.where(gap == 0.0, 1.0, np.nan).T, cmap=ListedColormap([CONTACT]), **shown)
    drawn = ax.imshow(image.T, norm=LogNorm(*FLUX_RANGE, clip=True), cmap="YlOrRd", **shown)
    ax.figure.colorbar(drawn, ax=ax, label="flux along $x$ over its mean", shrink=0.8)
    ax.set(xlabel="$x/L$", ylabel="$y/L$", title="where it leaks; contact blue")


def _budget(ax: Axes, card: Card) -> None:
    """Draw the parts of the error as factors."""
    names = list(dict.fromkeys(part.name for way in card.ways for part in way.parts)) or ["no leak"]
    for order, (way, look) in enumerate(zip(card.ways, looks(2), strict=True)):
        factors = {part.name: part.factor for part in way.parts}
        for row, name in enumerate([*names, "together"]):
            factor = way.factor if name == "together" else factors.get(name, math.nan)
            place = row + 0.2 - 0.4 * order
            if way.parts and math.isfinite(factor):
                ax.barh(place, max(factor, 1.0 + 1e-9) - 1.0, left=1.0, height=0.35, color=look["color"])
            elif way.parts and name in factors:
                ax.text(1.02, place, "unknown", fontsize=7, va="center", color=GREY)
    ax.set(xscale="log", xlabel="factor of the leak")
    ax.set_yticks(range(len(names) + 1), [*names, "together"])
    ax.set_xlim(1.0, None)
    plain_ticks(ax.xaxis, (1.0, 2.0, 5.0) if ax.get_xlim()[1] < CROWDED else (1.0,))
    ax.invert_yaxis()
