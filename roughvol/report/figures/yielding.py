"""Figures of a path of legs and of plastic displacement, each a function of a dataset.

Curves are by D at the largest m, or by file. A colour is a family, a dash pattern a leg. Several surfaces are drawn by
the means of both coordinates at every step, leaks by their median.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from xarray import Dataset

from roughvol.analysis.average import averages
from roughvol.analysis.closing import solved_loads
from roughvol.analysis.leak import counted, is_lifted
from roughvol.analysis.legs import along
from roughvol.analysis.tables import spread
from roughvol.observables.variables import columns_of
from roughvol.report.figures.curves import shown
from roughvol.report.figures.families import families, named, own, several, single
from roughvol.report.figures.origin import fluid_text, patch_note
from roughvol.report.figures.style import DASHES, GREY, LABELS, PAGE, A, Drawing, P, V, axes, unit_of
from roughvol.report.figures.ways import closed_handles, closing
from roughvol.typing import Array

# Further panels, where they are stored: variable, label, and whether the axis is logarithmic.
FURTHER = (
    ("leak_rate", "leak rate along ${}$", True),
    ("transmissivity", r"transmissivity $T^{{\ast}}$ along ${}$", True),
    ("plastic_volume", r"plastic volume $\bar{{u}}_\mathrm{{pl}}/\sigma$", False),
)
NOMINAL = "nominal_pressure"


def path_loops(ds: Dataset) -> Drawing:
    """Draw contact area, free volume, and leak or plastic volume over pressure, leg by leg.

    To see: elastic contact retraces. A surface that has yielded has more contact and less free volume on the way down
    than at the same pressure on the way up, and leaks less.
    """
    ds = counted(ds)
    some, title = families(ds, "D", P, V)
    load = NOMINAL if NOMINAL in ds else P
    further = next((row for row in FURTHER if row[0] in ds and bool(ds[row[0]].notnull().any())), None)
    names = [(A, LABELS[A], False), (V, LABELS[V], False)]
    if further is not None:
        names += [(name, further[1].format(name[-1]), further[2]) for name in columns_of(further[0])]
    rows = 2 if len(names) > 3 else 1
    fig, panels = axes(PAGE, 2.5 * rows + 0.6, len(names) // rows, rows)
    panels = panels.ravel()
    legs = np.unique(ds["leg"].values).astype(int).tolist()
    drawn_as = {  # dash patterns come again in a wider line
        leg: {"ls": DASHES[(leg - 1) % len(DASHES)], "lw": 1.1 + 0.9 * ((leg - 1) // len(DASHES))} for leg in legs
    }
    ends: list[tuple[Any, ...]] = []
    for family in some:
        for leg, line in drawn_as.items():
            part = averages(spread(along(family.data, leg))[[load, *(name for name, *_ in names)]])
            for ax, (name, _, logarithmic) in zip(panels, names, strict=True):
                computed = part[name].notnull().values
                x, y = part[load].values[computed], part[name].values[computed]
                drawn = np.where(y > 0.0, y, np.nan) if logarithmic else y  # a logarithmic axis has no zero
                lines = ax.plot(x, drawn, color=family.look["color"], **line)
                axis = name[-1] if logarithmic else None
                named(ax, lines, family, curve=f"{family.label}, leg {leg}", axis=axis)
                if axis:
                    solved = [] if is_lifted(ds) else solved_loads(family.data, axis, load, leg)
                    middle = np.sort([*solved, np.nan])[len(solved) // 2]  # from it on the median is closed
                    ends += [(ax, axis, family.look["color"], *end, family) for end in _ends(x, y, middle)]
    for ax, (name, label, logarithmic) in zip(panels, names, strict=True):
        unit = unit_of(ds, "leak_rate") if name.startswith("leak_rate") else ""
        below = LABELS[P] if load == P else f"nominal pressure $p$ [{unit_of(ds, NOMINAL)}]"
        ax.set(xlabel=below, ylabel=f"{label} [{unit}]" if unit else label)
        ax.set_yscale("log" if logarithmic else "linear")
    for ax, direction, colour, *end in ends:
        ax.set_ylim(bottom=ax.get_ylim()[0])  # marks stay on the edge
        closing(ax, direction, colour, *end)
    handles = [Line2D([], [], color=family.look["color"], label=family.label) for family in some]
    handles += [Line2D([], [], color=GREY, label=f"leg {leg}", **line) for leg, line in drawn_as.items()]
    handles += closed_handles({direction for _, direction, *_ in ends}, "closed")
    number = several(family.surfaces for family in some)
    words = [title, f"mean of {number} surfaces, of leaks the median" if number else ""]
    if further is not None and further[0] == "leak_rate":
        of_patch = (note.lower().removesuffix(".") for note in patch_note([ds], [further[0]]))
        words += [fluid_text(ds), *of_patch]
    fig.legend(handles=handles, title="; ".join(filter(None, words)) or None, loc="outside upper center", ncols=8)
    fig.shown = shown(some)
    return fig


def _ends(load: Array, flow: Array, solved: float) -> Iterator[tuple[tuple[float, float], float]]:
    """Yield the open state next to each closing or opening along a leg, and the load at which it closes or opens.

    This is the solved closing load between the open and the closed state, or the load of the closed state.
    """
    for k in np.flatnonzero((flow[1:] > 0.0) != (flow[:-1] > 0.0)).tolist():
        open_, shut = (k, k + 1) if flow[k] > 0.0 else (k + 1, k)
        low, high = sorted((float(load[open_]), float(load[shut])))
        yield (float(load[open_]), float(flow[open_])), solved if low <= solved <= high else float(load[shut])


def yielded_map(ds: Dataset) -> Drawing:
    """Draw the plastic displacement of one surface at the end of its path, over σ.

    To see: yield is on the summits of the loaded regions, and flattens them.
    """
    case, name = single(ds, "heights", "residual_heights")
    depth = own(case["heights"] - case["residual_heights"]) / float(case["Sq"])
    fig, ax = axes(PAGE * 0.55, 3.4)
    yielded = np.where(depth.values > 0.0, depth.values, np.nan)
    x, y = depth["x"].values, depth["y"].values
    half = x[1] / 2  # a node is the centre of its element
    extent = (-half, x[-1] + half, -half, y[-1] + half)
    image = ax.imshow(yielded.T, origin="lower", extent=extent, cmap="viridis_r", interpolation="none")
    share = float(np.isfinite(yielded).mean())
    if share:
        fig.colorbar(image, ax=ax, label=r"plastic displacement $u_\mathrm{pl}/\sigma$", shrink=0.85)
    ax.set(xlabel="$x/L$", ylabel="$y/L$", title=f"{name}: yielded on {share:.1%} of the elements, white elsewhere")
    fig.shown = {"D": [float(case["D"])], "m": [float(case["m"])]} if "D" in case.coords else {}
    return fig
