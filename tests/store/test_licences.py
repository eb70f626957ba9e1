"""Licences of installed packages: what is needed, the licence of each, and the libraries that wheels bundle."""

import json
import sys
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import roughvol
from roughvol.errors import DatasetError
from roughvol.store import licences
from tests.kit import call, said

STANZA = """Name: OpenBLAS
Files: solver.libs/libopenblas*.so
License: BSD-3-Clause

Name: Fonts
Files: solver/fonts/*
Description: without a library
License:
  OFL-1.1
"""


def installed(place: Path, name: str, lines: str, files: dict[str, str] | None = None) -> None:
    """Write the metadata and the files of a package."""
    folder = place / f"{name}-1.0.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text(f"Metadata-Version: 2.4\nName: {name}\nVersion: 1.0\n{lines}")
    for path, text in (files or {}).items():
        (place / path).parent.mkdir(parents=True, exist_ok=True)
        (place / path).write_text(text)
    (folder / "RECORD").write_text("".join(f"{path},,\n" for path in files or {}))


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A roughvol that needs a solver, which bundles libraries, and has an installed extra and one that is not."""
    installed(
        tmp_path,
        "roughvol",
        "License-Expression: MIT\nProvides-Extra: reading\nProvides-Extra: other\nRequires-Dist: Solver[fast]>=1\n"
        'Requires-Dist: reader; extra == "reading"\nRequires-Dist: nowhere; extra == "other"\n'
        'Requires-Dist: absent; sys_platform == "nowhere"\n',
    )
    bundled = ("libopenblas-0a1b2c3d.so.0", "libfftw3f-0a1b2c3d4e.so.3.5.5", "libmystery.so")
    files = {f"solver.libs/{name}": "" for name in bundled} | {"solver-1.0.dist-info/licenses/LICENSE.txt": STANZA}
    lines = 'License: BSD\nProvides-Extra: fast\nRequires-Dist: speed; extra == "fast"\nRequires-Dist: roughvol\n'
    installed(tmp_path, "solver", lines, files)
    installed(tmp_path, "speed", "Classifier: License :: OSI Approved :: MIT License\nLicense: Copyright\n all of us\n")
    installed(tmp_path, "reader", "License: UNKNOWN\n")
    monkeypatch.setattr(sys, "path", [str(tmp_path)])


@pytest.mark.usefixtures("packages")
def test_packages_are_followed_through_extras_and_their_wheels_are_searched() -> None:
    rows = {row.name: row for row in licences.licences()}
    assert {name: (*row.needed_by, row.licence, row.terms) for name, row in rows.items()} == {
        "roughvol": ("roughvol", "MIT", "permissive"),
        "solver": ("roughvol", "BSD", "copyleft"),
        "speed": ("roughvol", "MIT License", "permissive"),
        "reader": ("reading", "unknown", "unknown"),
    }
    assert rows["solver"].parts == {
        "Fonts": "OFL-1.1",
        "libfftw3f": "GPL-2.0-or-later",
        "libmystery": "unknown",
        "libopenblas": "BSD-3-Clause",
    }
    assert rows["solver"].deciding == ("GPL-2.0-or-later",)


def test_a_package_that_is_not_installed_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    with pytest.raises(DatasetError, match=r"not installed; allowed: pip install"):
        licences.licences()


TERMS = {
    "permissive": [
        *("MIT", "BSD-3-Clause AND 0BSD AND MIT AND Zlib AND CC0-1.0", "Python Software Foundation License"),
        *("FTL OR GPL-2.0-or-later", "MIT AND (FTL OR GPL-2.0-or-later)"),
    ],
    "copyleft": [
        *("GPL-2.0-or-later", "AGPL-3.0-only", "BSD License, GNU General Public License v3 (GPLv3)"),
        *("MIT AND GPL-2.0-or-later", "MIT AND (FTL OR (MIT AND GPL-2.0-or-later)) AND GPL-3.0-only"),
    ],
    "limited copyleft": [
        "GNU Lesser General Public License v3 or later (LGPLv3+)",
        *("GPL-3.0-or-later WITH GCC-exception-3.1", "MPL-2.0"),
    ],
    "unknown": ["House rules", "MIT AND House rules"],
}


@pytest.mark.parametrize(("terms", "licence"), [(terms, one) for terms, rows in TERMS.items() for one in rows])
def test_terms(terms: str, licence: str) -> None:
    assert licences.terms(licence) == terms


@pytest.fixture(scope="module")
def rows() -> list[licences.Licence]:
    """Of the installed packages; their files are searched once."""
    return roughvol.licences()


def test_the_installed_packages_are_those_of_the_markers(rows: list[licences.Licence]) -> None:
    """An independent walk, which evaluates each marker, finds the packages that an installation needs."""
    waiting, seen = [("roughvol", "")], set()
    while waiting:
        name, extra = waiting.pop()
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        for requirement in map(Requirement, metadata.requires(name) or ()):
            if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
                waiting += [(canonicalize_name(requirement.name), one) for one in ("", *requirement.extras)]
    found = {canonicalize_name(row.name) for row in rows if row.needed_by == ("roughvol",)}
    assert found >= {name for name, _ in seen}
    assert {name for name in found - {name for name, _ in seen} if name in ("pytest", "sphinx", "ruff")} == set()


def test_every_library_beside_a_needed_package_is_a_part_and_known(rows: list[licences.Licence]) -> None:
    needed = [row for row in rows if row.needed_by == ("roughvol",)]
    for row in needed:
        paths = [path for path in metadata.files(row.name) or () if ".libs/" in path.as_posix()]
        names = {path.name.removeprefix("lib").split("-")[0].split(".so")[0] for path in paths}
        assert names <= {part.removeprefix("lib").split("-")[0] for part in row.parts}
    assert [row.name for row in needed if row.terms == licences.UNKNOWN] == []


def test_the_command_prints_the_licences(rows: list[licences.Licence], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(roughvol, "licences", lambda: rows)
    answer = json.loads(said("licences", "--json"))["rows"]
    assert [(row["name"], row["licence"], row["parts"], row["terms"]) for row in answer] == [
        (row.name, row.licence, row.parts, row.terms) for row in rows
    ]
    text = call("licences").stdout
    lines = text.splitlines()
    assert len([line for line in lines if not line.startswith("  ")]) >= len(rows) + 2
    (last,) = (line for line in lines if line.startswith("copyleft, "))
    assert all(row.name in last for row in rows if row.terms == "copyleft")
