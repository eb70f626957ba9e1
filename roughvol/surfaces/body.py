"""Measured bodies as plain records: the file of one body, and the treatment of its heights."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

Mirror = Literal["none", "x", "y"]
Columns = Literal["heights"]
Header = Literal["ignore"]
Levelling = Literal["none", "mean", "tilt", "quadratic"]
Missing = Literal["refuse", "nearest", "interpolate"]
Resampling = Literal["none", "square"]
Nodes = tuple[tuple[int, int], tuple[int, int]]


def digest(file: Path) -> str:
    """Return the sha256 of the content of a file."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@dataclass(frozen=True)
class Body:
    """One rough body: its file, the sha256 of its content, and the reading of its numbers.

    Attributes
    ----------
    unit : unit of the heights in the file, where the file names it.
    heights_unit : the same, where the study names it.
    mirror : the axis that is reversed.
    read_as : layout of a text, part of the identity of a case.
    pixel_ratio : side of the pixels along y over that along x, where they are resampled.
    """

    file: Path
    sha256: str
    variable: str | None = None
    unit: str | None = None
    mirror: Mirror = "none"
    heights_unit: str | None = None
    columns: Columns | None = None
    header: Header | None = None
    read_as: str | None = None
    pixel_ratio: float | None = None

    @property
    def numbers_in(self) -> str | None:
        """Unit of the heights in the file, named by the file or by the study; None for that of the study."""
        return self.unit or self.heights_unit

    @property
    def added(self) -> str:
        """The addition of the heights to those of the first body, in words."""
        turned = f", its axis {self.mirror} reversed" if self.mirror != "none" else ""
        return f"heights of {self.file.name} added{turned}"

    @property
    def key(self) -> dict[str, Any]:
        """Everything that changes the heights, as plain data; the content of the file gives ``unit``."""
        return {name: value for name, value in vars(self).items() if name not in ("file", "unit")}


@dataclass(frozen=True)
class Treatment:
    """The treatment of the heights, equal for each body.

    The attributes are in the order of treatment.

    Attributes
    ----------
    crop : first and last node along x and along y.
    outliers : sigma, and nodes a side of the window.
    downsample : nodes a side of the blocks that are averaged.
    resample : whether oblong pixels are made square.
    level : degree of the surface taken off.
    missing : rule for missing heights.
    low_pass : cut-off wavelength [unit of the study].
    """

    level: Levelling = "none"
    missing: Missing = "refuse"
    low_pass: float | None = None
    crop: Nodes | None = None
    outliers: tuple[float, int] | None = None
    downsample: int = 1
    resample: Resampling = "none"

    @property
    def key(self) -> dict[str, Any]:
        """The treatment as plain data."""
        return dict(vars(self))

    @property
    def filling(self) -> Literal["nearest", "interpolate"] | None:
        """The filling of unknown heights, None if all are known. Removed outliers are always filled."""
        if self.missing != "refuse":
            return self.missing
        return None if self.outliers is None else "interpolate"


UNTREATED = Treatment()
