"""Build the package, and install and run it in empty environments: each Python, the lowest and the newest libraries.

    python -m tests.publish --python python3.11 python3.12 --page

The lower bounds are those of pyproject.toml. A lowest library has a wheel for the Python. The tests are those of the
sdist, and the package is the installed one. `--json` keeps the rows, and `--rows` takes rows that another machine kept.
"""

import argparse
import itertools
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "explanation" / "notes" / "installed.md"
LIBRARIES = {"lowest": "lowest-direct", "newest": "highest"}
OLD = {"lowest": ("-W", "default::DeprecationWarning"), "newest": ()}  # old libraries call what newer ones deprecate
EXTRAS = ("measured", "cluster")  # extras of users, installed for the tests
TOOLS = ("pytest", "pytest-timeout", "hypothesis")
TESTS = (  # numbers: contact with tests/reference/rough_33x25.npz, flow, files of heights, what is written
    "contact/test_loading.py",
    "gap/test_network.py",
    "surfaces/test_reading.py",
    "study/test_units.py",
    "store/test_dataset.py",
    "test_own.py",
)
SEAL = ("--set", "surface.m=4", "--set", "seal={length: 120 mm, width: 2 mm}")
LOAD = ("--at", "pressure=0.05MPa")
PYTHON = """
import roughvol
ds = roughvol.open("seal")
assert float(ds.roughvol.at(pressure="0.05 MPa").free_volume.mean()) > 0
"""
HEAD = """# Installed with the lowest and the newest libraries

<!-- made by: make publish-check, roughvol {version} -->

Written by `make publish-check` ({date}, {machine}). The wheel is built from the sdist, and both pass
`twine check --strict`. `CITATION.cff` passes `cffconvert --validate`. Each row is an empty environment that uv fills,
from wheels alone. In an empty folder these succeed: {steps}.
After that, tests of the sdist run on the installed package, with the extras {extras}.

Lowest: the lower bounds of `pyproject.toml`, or the first later release with a wheel for this Python
(`uv pip compile --resolution lowest-direct --only-binary :all:`). Libraries of libraries are the newest in both rows.

| Python | libraries | install [s] | packages | from an empty folder | tests of the sdist |
|---|---|---|---|---|---|
"""


def called(*words: str | Path, cwd: Path | None = None) -> str:
    """Return the output of a program that succeeds; raise its last lines otherwise."""
    clean = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(
        [str(word) for word in words], cwd=cwd, env=clean, capture_output=True, text=True, check=False
    )
    if done.returncode:
        text = "\n".join((done.stdout + done.stderr).splitlines()[-60:])
        raise SystemExit(f"{' '.join(map(str, words))}\nexit code {done.returncode}\n{text}")
    return done.stdout


def uv(*words: str | Path, cwd: Path | None = None) -> str:
    """Return the output of uv, which resolves lowest versions as well as newest ones."""
    return called(sys.executable, "-m", "uv", "--quiet", "--system-certs", *words, cwd=cwd)


def extract(archive: Path, folder: Path) -> None:
    """Extract an archive; Python 3.11.0 to 3.11.3 have no filter."""
    with tarfile.open(archive) as held:
        held.extraction_filter = getattr(tarfile, "data_filter", None)
        held.extractall(folder)


def built(folder: Path) -> tuple[Path, Path]:
    """Return the unpacked sdist and the wheel that is built from the sdist; both pass the checks of PyPI."""
    uv("build", ROOT, "--out-dir", folder)
    (sdist,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    uv("tool", "run", "twine", "check", "--strict", sdist, wheel)
    uv("tool", "run", "cffconvert", "--validate", cwd=ROOT)
    extract(sdist, folder)
    return folder / sdist.name.removesuffix(".tar.gz"), wheel


def checked(python: str, libraries: str, source: Path, wheel: Path, folder: Path) -> dict[str, Any]:
    """Return the row of a Python with the lowest or the newest libraries; stop where a program fails."""
    uv("venv", "--python", python, folder / "env")
    own = folder / "env" / "bin"
    version = called(own / "python", "-c", "import platform; print(platform.python_version())").strip()
    pins = folder / "pins.txt"
    extras = [word for extra in EXTRAS for word in ("--extra", extra)]
    chosen = ("--resolution", LIBRARIES[libraries], "--only-binary", ":all:", "--python", own / "python")
    uv("pip", "compile", source / "pyproject.toml", *extras, *chosen, "--output-file", pins)
    install = ("pip", "install", "--python", own / "python", "--only-binary", ":all:", "--constraint", pins)
    start = time.monotonic()
    uv(*install, wheel)
    seconds = time.monotonic() - start
    packages = json.loads(uv("pip", "list", "--python", own / "python", "--format", "json"))
    work = folder / "work"
    work.mkdir()
    steps = {name: called(own / words[0], *words[1:], cwd=work) for name, words in smoke().items()}
    assert json.loads(steps["card"])["seal"]["leak"] > 0
    uv(*install, f"{wheel}[{','.join(EXTRAS)}]", *TOOLS)
    tests = folder / "sdist"
    shutil.copytree(source, tests, ignore=lambda place, names: {"roughvol"} if Path(place) == source else set())
    names = [f"tests/{name}" for name in TESTS]
    words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", *OLD[libraries])
    said = called(own / "python", *words, *names, cwd=tests)
    return {
        "python": version,
        "libraries": libraries,
        "seconds": seconds,
        "packages": len(packages) - 1,  # without roughvol
        "versions": {canonical(row["name"]): row["version"] for row in packages},
        "steps": list(steps),
        "tests": said.strip().splitlines()[-1].split(" in ")[0],
    }


def smoke() -> dict[str, tuple[str, ...]]:
    """Return the programs of the environment that are called in an empty folder, by name."""
    call = "roughvol"
    return {
        "init": (call, "init", "seal"),
        "run": (call, "run", "seal.yaml", *SEAL),
        "show": (call, "show", "seal", *LOAD),
        "plot": (call, "plot", "seal", "leak_of_p"),
        "card": (call, "card", "seal.yaml", *SEAL, *LOAD, "--jobs", "1", "--json"),
        "licences": (call, "licences", "--json"),
        "Python": ("python", "-c", PYTHON),
    }


def canonical(name: str) -> str:
    """Return the name of a package as indices compare names."""
    return re.sub(r"[-_.]+", "-", name).lower()


def pythons() -> list[str]:
    """Return the Python versions that the package names."""
    lines = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["classifiers"]
    return [line.rpartition(" :: ")[2] for line in lines if ":: Python :: 3." in line]


def without_row(rows: list[dict[str, Any]]) -> list[str]:
    """Return the Python versions, with lowest or newest libraries, that the package names and no row has."""
    tried = {(row["python"].rpartition(".")[0], row["libraries"]) for row in rows}
    return [" ".join(pair) for pair in itertools.product(pythons(), LIBRARIES) if pair not in tried]


def page(rows: list[dict[str, Any]]) -> str:
    """Return the page: environments, and the versions of the libraries that roughvol names."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    machine = f"{platform.machine()}, {platform.system()}"
    version = rows[0]["versions"]["roughvol"]
    steps = ", ".join(f"`{step}`" for step in rows[0]["steps"])
    extras = " and ".join(f"`{extra}`" for extra in EXTRAS)
    date = time.strftime("%Y-%m-%d", time.gmtime())
    lines = [HEAD.format(version=version, date=date, machine=machine, steps=steps, extras=extras).rstrip()]
    for row in rows:
        cells = (row["python"], row["libraries"], f"{row['seconds']:.0f}", row["packages"], "pass", row["tests"])
        lines.append(f"| {' | '.join(map(str, cells))} |")
    lines += [
        "",
        "Seconds depend on the load of the machine, and on the wheels that uv has downloaded before.",
        "",
        "## Versions",
        "",
    ]
    lines.append("| library | bound | " + " | ".join(f"{row['python']}, {row['libraries']}" for row in rows) + " |")
    lines.append("|---" * (2 + len(rows)) + "|")
    for requirement in project["dependencies"]:
        name, _, bound = requirement.partition(",")[0].partition(">=")
        lines.append(f"| {name} | {bound} | " + " | ".join(row["versions"][canonical(name)] for row in rows) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Check every environment, print the rows, and write the page where it is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--python", nargs="*", default=[sys.executable], help="interpreters; none, to write rows of --rows alone"
    )
    parser.add_argument("--libraries", nargs="+", default=list(LIBRARIES), choices=list(LIBRARIES))
    parser.add_argument("--json", type=Path, help="file that keeps the rows")
    parser.add_argument("--rows", type=Path, nargs="*", default=[], help="files of rows from another machine")
    parser.add_argument("--page", action="store_true", help="write docs/explanation/notes/installed.md")
    given = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory(prefix="roughvol_publish") as place:
        source, wheel = built(Path(place)) if given.python else (ROOT, ROOT)
        for python in given.python:
            for libraries in given.libraries:
                with tempfile.TemporaryDirectory(dir=place) as folder:
                    rows.append(checked(python, libraries, source, wheel, Path(folder)))
                print({key: value for key, value in rows[-1].items() if key != "versions"}, flush=True)
                if given.json:
                    given.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    for file in given.rows:
        rows += json.loads(file.read_text(encoding="utf-8"))
    if given.page and (absent := without_row(rows)):
        print(f"{PAGE.relative_to(ROOT)} stays as it is: no row of {', '.join(absent)}")
    elif given.page:
        rows.sort(key=lambda row: ([int(part) for part in row["python"].split(".")], row["libraries"]))
        PAGE.write_text(page(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
