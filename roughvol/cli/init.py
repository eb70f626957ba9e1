"""The command `init`: an example study, or the study of a height map, in the current folder."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from importlib import resources
from itertools import takewhile
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from roughvol.cli.options import SET, Completed, command
from roughvol.cli.output import say
from roughvol.errors import FolderError, StudyError, SurfaceError, meant
from roughvol.report import terminal
from roughvol.store import stamped_file
from roughvol.study.plain_data import is_file

SCAN = "scan.txt"
TO_FILL_IN = {"L": "500 um", "unit": "um", "heights_unit": "um"}  # what a height map may lack, with an example
DECIDED = {"resample": "square", "missing": "interpolate"}  # what oblong pixels and unknown heights need
COUNT = "0.95 nm"  # the height of a count
READABLE = "um"  # the unit of a study of a map that is far smaller than the unit in its file
FAR_SMALLER = 0.1
SIDES = "# sides: mirrored, the map is a part of a joint; free, a block of its size; periodic, one period of a plane"
HEAD = """# The height map{s} {paths}. Give material, end of the sweep and fluid; roughvol explain has all keys.
#   roughvol check {name}.yaml --look
#   roughvol run {name}.yaml
#   roughvol card {name}.yaml
"""


def _examples_with(context: click.Context, option: click.Parameter, start: str) -> Completed:
    """Return the names of examples with this start, or let the shell complete a height map."""
    return [name for name in _examples() if name.startswith(start)] or [CompletionItem(start, type="file")]


@command
@click.argument("names", nargs=-1, shell_complete=_examples_with, metavar="[EXAMPLE|FILE]")
@click.option("--list", "listing", is_flag=True, help="List the examples and write nothing.")
@SET
def init(names: tuple[str, ...], listing: bool, changes: tuple[str, ...]) -> None:
    """Write the study EXAMPLE, or the study of the height map FILE, into the current folder, or list the examples.

    Several maps make one study. Sizes and units come from FILE. What it lacks is left to fill in. Oblong pixels are
    resampled, and missing heights interpolated. --set takes keys of the section surface, for a FILE alone. Files that
    exist are not overwritten.
    """
    known = _examples()
    if not names or listing:
        titles = [(name, text.splitlines()[0].removeprefix("# ")) for name, text in known.items()]
        say(terminal.aligned(("example", "content"), titles))
        say("write one with: roughvol init EXAMPLE; the study of a height map with: roughvol init FILE")
        return
    example, *others = names
    if not known.keys() & names and all(is_file(Path(name)) for name in names):
        _write_study_of_maps([Path(name) for name in names], known["scan"], changes)
        return
    if others:
        example = next((name for name in names if not is_file(Path(name))), example)
        raise click.UsageError(f"{example!r} is no height map; allowed are one example, or one height map or several")
    if example not in known:
        near = meant(example, known)
        raise click.UsageError(f"no example and no height map {example!r}{near} (examples: {', '.join(known)})")
    if changes:
        message = "--set changes the study of a height map; an example is changed by: roughvol run EXAMPLE.yaml --set …"
        raise click.UsageError(message)
    _write_new({f"{example}.yaml": known[example]} | ({SCAN: _heights()} if example == "scan" else {}))
    say(f"next: roughvol run {example}.yaml, then roughvol show {example}")


def _examples() -> dict[str, str]:
    """Return the text of the examples of this package by name."""
    files = (path for path in (resources.files("roughvol") / "examples").iterdir() if path.name.endswith(".yaml"))
    return {path.name.removesuffix(".yaml"): path.read_text("utf-8") for path in sorted(files, key=lambda f: f.name)}


def _heights() -> str:
    """Return a small map as text: 65 x 65 heights in um on a slight slope, Sq = 2 um."""
    from roughvol.surfaces.midpoint import random_midpoint_displacement

    surface = random_midpoint_displacement(2.3, 6, side=500.0, seed=1).scaled(2.0)
    heights = surface.heights - surface.heights.mean()
    rows, columns = heights.shape
    tilted = [[heights[i, j] + 0.02 * i + 0.01 * j for j in range(columns)] for i in range(rows)]
    lines = [" ".join(f"{height:.4f}" for height in row) for row in tilted]
    return "\n".join(lines) + "\n"


def _write_new(files: Mapping[str, str]) -> None:
    """Write files into the current folder, or none if any of them is there or cannot be written."""
    if present := [name for name in files if Path(name).exists()]:
        raise FolderError(f"already in {Path.cwd()}: {', '.join(present)}; nothing was written")
    try:
        for name, text in files.items():
            stamped_file.store(Path(name), text.encode())
    except FolderError:
        for path in filter(Path.exists, map(Path, files)):  # on a read-only disk, to remove nothing fails too
            path.unlink()
        raise
    for name in files:
        say(f"wrote {name}")


def _write_study_of_maps(paths: Sequence[Path], example: str, changes: Sequence[str]) -> None:
    """Write the study of height maps, as that of the example; lengths and units that they lack are to be filled in."""
    from roughvol.study.plain_data import printable, write
    from roughvol.study.reading import set_key

    if other := [change for change in changes if not change.startswith("surface.")]:
        message = f"--set {other[0]}: allowed are keys of surface; give the others in the study that is written"
        raise click.UsageError(message)
    files, several = [str(path) for path in paths], len(paths) > 1
    letters = takewhile(lambda of_each: len(set(of_each)) == 1, zip(*(path.stem for path in paths), strict=False))
    stem = "".join(letter for letter, *_ in letters)  # with which all names begin
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", stem).strip("_-")[:100] or ("maps" if several else "map")
    of_files: dict[str, Any] = {"files": files} if several else {"file": files[0]}
    given: dict[str, Any] = {"name": name, "surface": of_files | {"level": "tilt"}}
    if not any(change.startswith("surface.periodic") for change in changes):
        given["surface"]["sides"] = "mirrored"
    for change in changes:
        set_key(given, change)
    rest = [line for line in example.splitlines() if not line.startswith(("#", "name:", "surface:"))]

    def study(keys: Mapping[str, str]) -> str:
        section = write({"surface": given["surface"] | keys})
        return "\n".join([write({"name": name}).strip("{}\n"), f"{SIDES}\n{section.strip()}", *rest]) + "\n"

    absent: dict[str, str] = {}
    while lacking := _lacking(study(absent), f"{name}.yaml", given["surface"].keys(), absent):
        absent |= lacking
    if small := _small(study(absent), f"{name}.yaml", absent.keys() | given["surface"].keys()):
        given["surface"]["unit"] = READABLE
    to_fill_in = {key: f"FILL IN, as {value}" for key, value in absent.items() if key in TO_FILL_IN}
    text = study({key: to_fill_in.get(key, value) for key, value in absent.items()})
    head = HEAD.format(paths=", ".join(map(printable, files)), name=name, s="s" * several)
    _write_new({f"{name}.yaml": head + text})
    for key in filter(DECIDED.get, absent):
        say(f"with surface.{key}: {absent[key]}, which the heights need")
    if small:
        say(f"with surface.unit: {READABLE}, as its L is {small} in {files[0]}")
    if to_fill_in:
        who = "not all maps give" if several else f"{files[0]} does not give"
        say(f"fill in {' and '.join(f'surface.{key}' for key in to_fill_in)}, which {who}")
    say(f"next: roughvol check {name}.yaml --look")


def _lacking(study: str, file: str, given: Set[str], absent: Mapping[str, str]) -> dict[str, str]:
    """Return the keys of lengths, units and treatment that a study of a map lacks, with an example of each.

    Keys that are given, or known to be absent, are not among them. Heights that are counts have the unit of a count.
    """
    from roughvol.campaign.case_surface import surface_of
    from roughvol.study import loads
    from roughvol.surfaces.files import reading

    known = given | absent.keys()
    try:
        cases = loads(study, file).cases()
    except StudyError as error:
        keys = [problem.key.removeprefix("surface.") for problem in error.problems if "missing" in problem.message]
        keys = keys or ["unit"] * any("the unit of length" in problem.message for problem in error.problems)
        examples = TO_FILL_IN | DECIDED
        if lacking := {key: examples[key] for key in keys if key in examples and key not in known}:
            return lacking
        raise StudyError([replace(problem, file="", line=None) for problem in error.problems]) from None  # not written
    for case in cases:
        body = case.bodies[0]
        ignored = body.header == "ignore"
        try:
            surface_of(case)
        except SurfaceError as error:  # others are those of `roughvol check`, but for a file that holds no heights
            if "surface.missing" in str(error) and "missing" not in known:
                return {"missing": DECIDED["missing"]}
            reading.read(body.file, body.variable, holes=True, columns=body.columns, ignore_header=ignored)
        described = reading.describe(body.file, body.variable, columns=body.columns, ignore_header=ignored)
        if described.counts and "heights_unit" not in given and absent.get("heights_unit") != COUNT:
            return {"heights_unit": COUNT}
    return {}


def _small(study: str, file: str, known: Set[str]) -> str:
    """Return the length of a map that is far smaller than its unit, which only the file gives; else nothing."""
    from roughvol.study import loads
    from roughvol.surfaces.length_units import METRES

    case = loads(study, file).cases()[0]
    unit = case.length_unit
    if known & {"L", "unit"} or unit is None or METRES[unit] <= METRES[READABLE] or case.L >= FAR_SMALLER:
        return ""
    return f"{case.L:.6g} {unit}"
