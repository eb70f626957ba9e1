"""A figure as the row of a table: its variables, its drawing, its caption, and the cases that it shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType, ModuleType
from typing import Any

import matplotlib as mpl
from xarray import Dataset

from roughvol.analysis.legs import first_leg
from roughvol.errors import DatasetError
from roughvol.report.figures.cases import CASES, Rule, by_D
from roughvol.report.figures.origin import dry_note, lacking, leg_note, origin, patch_note, written
from roughvol.report.figures.style import STYLE, Drawing
from roughvol.tables import table

BAND = " Thin lines are single surfaces; the band is one standard deviation to both sides of their mean."


Refusal = Callable[[str, Dataset], str | None]


@dataclass(frozen=True)
class Figure:
    """A figure of one dataset: call it with the dataset.

    Attributes
    ----------
    draw : callable
        Draws a dataset; its name is that of the figure.
    caption : str
        Contents, units, lines and bands. Starred quantities have no unit.
    needs : tuple of str
        Stored variables that one case must hold.
    cases : callable
        Cases of a study that the figure shows.
    refuse : callable, optional
        Further reason why a dataset cannot be drawn, from the name and the dataset, or None.
    every_leg : bool
        Whether all legs of a path are drawn. Default: the first leg, which loads the virgin surface.
    """

    draw: Callable[[Any], Drawing]
    caption: str
    needs: tuple[str, ...] = ()
    cases: Rule = by_D
    refuse: Refusal | None = None
    every_leg: bool = False

    @property
    def name(self) -> str:
        """Name of the figure."""
        return self.draw.__name__

    def missing(self, ds: Dataset) -> str | None:
        """Return why the figure cannot be drawn from a dataset, or None if it can."""
        refused = self.refuse and self.refuse(self.name, ds)
        return refused or (lacking(self.name, ds, self.needs) if self.needs else None)

    def origin(self, ds: Dataset, drawn: Mapping[str, Sequence[float]]) -> str:
        """Return the note of the figure: the run, and the surfaces that are drawn."""
        return f"{origin(ds, drawn)}."

    def words(self, *, surfaces: int = 2, measured: bool = False) -> str:
        """Return the caption; a single surface has no band, and surfaces from files have no D."""
        text = self.caption.removesuffix(BAND) if surfaces < 2 else self.caption
        return text.replace(" by fractal dimension D", "") if measured else text

    def __call__(self, ds: Any) -> Drawing:
        """Return the figure of a dataset with its note, or raise `DatasetError` where it cannot be drawn."""
        if reason := self.missing(ds):
            raise DatasetError(reason)
        with mpl.rc_context(STYLE):
            figure = self.draw(ds if self.every_leg else first_leg(ds))
            if "L" in ds:
                leg = [] if self.every_leg else leg_note(ds, self.needs)
                gap = [*dry_note([ds]), *patch_note([ds], self.needs)]
                figure.note(" ".join([self.origin(ds, figure.shown), *leg, *written(ds), *gap]))
            return figure


def figures_of(
    registry: str,
    modules: Sequence[ModuleType],
    kind: type[Figure] = Figure,
    refusals: Mapping[str, Refusal] = MappingProxyType({}),
) -> dict[str, Any]:
    """Return the figures that modules draw, by name; ``figures.toml`` beside a registry has their rows."""
    tables = table(registry, "figures")
    found = {}
    for module in modules:
        for name, row in tables[module.__name__.rpartition(".")[2]].items():
            sentences = [row.pop("caption"), *(tables["shared"][key] for key in row.pop("shared", ()))]
            caption = " ".join(sentences) + (BAND if row.pop("band", False) else "")
            given: dict[str, Any] = {
                key: tuple(value) if isinstance(value, list) else value for key, value in row.items()
            }
            given["cases"] = CASES[given.get("cases", "by_D")]
            found[name] = kind(getattr(module, name), caption, refuse=refusals.get(name), **given)
    return found
