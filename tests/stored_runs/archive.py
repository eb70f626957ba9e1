"""The archive of stored runs, and their studies.

``0.11.1/studies.json`` has the keys of the schema of 0.11.1 with values and defaults, and studies of its configs, pages
and tests that have every key, each with the study that 0.11.1 loaded.
"""

import json
import tarfile
import tomllib
from pathlib import Path
from typing import Any

from tests.publish import extract

HERE = Path(__file__).parent
ARCHIVE = HERE / "runs.tar.xz"
VERSIONS = ("0.11.1", "0.12.0", "0.13.0", "0.14.0", "0.15.0", "0.16.0")


def studies(version: str) -> dict[str, dict[str, Any]]:
    """Return the studies that a version can compute, by name."""
    table = tomllib.loads((HERE / "studies.toml").read_text(encoding="utf-8"))
    return {name: row for name, row in table.items() if version in row.get("versions", VERSIONS)}


def unpack(folder: Path) -> None:
    """Unpack the runs of every version into a folder: ``VERSION/runs/NAME``."""
    extract(ARCHIVE, folder)


def of_oldest() -> dict[str, Any]:
    """Return the keys of the oldest version, and its studies."""
    with tarfile.open(ARCHIVE) as archive:
        stored = archive.extractfile(f"{VERSIONS[0]}/studies.json")
        found: dict[str, Any] = json.load(stored)
    return found
