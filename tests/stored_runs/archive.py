"""The archive of stored runs, and their studies."""

from __future__ import annotations

import tarfile
import tomllib
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
ARCHIVE = HERE / "runs.tar.xz"
VERSIONS = ("0.11.1", "0.12.0", "0.13.0", "0.14.0", "0.15.0", "0.16.0")


def studies(version: str) -> dict[str, dict[str, Any]]:
    """Return the studies that a version can compute, by name."""
    table = tomllib.loads((HERE / "studies.toml").read_text(encoding="utf-8"))
    return {name: row for name, row in table.items() if version in row.get("versions", VERSIONS)}


def unpack(folder: Path) -> None:
    """Unpack the runs of every version into a folder: ``VERSION/runs/NAME``."""
    with tarfile.open(ARCHIVE) as archive:
        archive.extractall(folder, filter="data")
