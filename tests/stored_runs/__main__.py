"""Compute the studies with the checkout of a version: ``python -m tests.stored_runs VERSION FOLDER_OF_THE_CHECKOUT``.

They are added to the archive: the run folders as stored, and ``printed.json`` with what the version printed.
"""

import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from tests.stored_runs.archive import ARCHIVE, VERSIONS, studies, unpack


def main(version: str, checkout: Path) -> None:
    """Add the runs of a version to the archive."""
    with tempfile.TemporaryDirectory() as made:
        if ARCHIVE.exists():
            unpack(Path(made))
        folder = Path(made) / version
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        waves = np.add.outer(np.arange(13.0) ** 1.5, 1.7 * np.arange(11.0))
        np.save(folder / "worn.npy", 0.7 * np.sin(waves) + 0.05 * waves)
        printed = {}
        for name, study in studies(version).items():
            (folder / f"{name}.yaml").write_text(study["study"], encoding="utf-8")
            _call(checkout, folder, "run", f"{name}.yaml", "--jobs", "1")
            printed[name] = _printed(checkout, folder, name, study)
            if version == VERSIONS[0]:
                printed[name]["figures"] = _drawn(checkout, folder, name)
        (folder / "printed.json").write_text(json.dumps(printed, ensure_ascii=False), encoding="utf-8")
        with tarfile.open(ARCHIVE, "w:xz", preset=9) as archive:
            for path in sorted(Path(made).rglob("*")):
                archive.add(path, path.relative_to(made), recursive=False, filter=_plain)


def _plain(entry: tarfile.TarInfo) -> tarfile.TarInfo:
    """Return an entry without owner and date."""
    entry.uid = entry.gid = entry.mtime = 0
    entry.uname = entry.gname = ""
    return entry


def _printed(checkout: Path, folder: Path, name: str, study: dict[str, Any]) -> dict[str, Any]:
    """Return what a version prints of a run."""
    answers = {"show": json.loads(_call(checkout, folder, "show", name, "--at", study["at"], "--json"))}
    if "leak" in study:
        answers["ask"] = _call(checkout, folder, "ask", name, "--leak-rate", study["leak"])
    return answers


def _drawn(checkout: Path, folder: Path, name: str) -> list[str]:
    """Return the names of the figures that a version draws of a run."""
    figures = folder / "figures"
    _call(checkout, folder, "plot", name, "--out", "figures")
    found = sorted({path.stem for path in figures.rglob("*.png")})
    shutil.rmtree(figures)
    return found


def _call(checkout: Path, folder: Path, *words: str) -> str:
    """Return what a command of a version prints."""
    own = {"PYTHONPATH": str(checkout.resolve()), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "roughvol", *words]
    done = subprocess.run(command, cwd=folder, env=os.environ | own, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}: {done.stderr}")
    return done.stdout


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
