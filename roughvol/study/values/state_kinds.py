"""A state of a sweep, by a quantity and its value."""

from __future__ import annotations

from dataclasses import dataclass

from roughvol.study.values.units import Quantity, Starred
from roughvol.study.yaml_text import number_text


@dataclass(frozen=True)
class Level:
    """A state of a sweep: ``last``, a plane, a step, or a quantity and its value."""

    kind: str
    value: float | None = None
    leg: int | None = None  # of a path, from 2; None for the first that reaches it

    @property
    def label(self) -> str:
        """Name of the state in datasets: ``last``, ``step=60``, ``contact_area=0.1``, ``pressure=0.5, leg 2``."""
        if self.leg is not None:
            return f"{Level(self.kind, self.value).label}, leg {self.leg}"
        if self.value is None:
            return self.kind
        if isinstance(self.value, Starred):
            return self.value.label
        return f"{self.kind}={self.value if isinstance(self.value, Quantity) else number_text(self.value)}"
