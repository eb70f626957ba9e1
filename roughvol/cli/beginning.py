"""The first hour: an example study in the current folder, and the keys and variables in words."""

from __future__ import annotations

import difflib
import json
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem

from roughvol import cli_text
from roughvol.cli.group import examples, main
from roughvol.cli.options import SET, Completed
from roughvol.cli.output import say
from roughvol.errors import FolderError, StudyError
from roughvol.store import stamped_file

if TYPE_CHECKING:
    from roughvol.observables.variables import Variable
    from roughvol.study.reference import Key

WIDTH = 100
SCAN = "scan.txt"
TO_FILL_IN = {"L": "500 um", "unit": "um", "heights_unit": "um"}  # what a height map may lack, with an example
HEAD = """# Reference

Keys of a study file, and variables of `study.nc`. `make reference` writes this page from the schema and the table of
variables; `roughvol explain KEY` and `roughvol explain VARIABLE` print one row of it.

## Keys of a study
"""


def _examples_with(context: click.Context, option: click.Parameter, start: str) -> Completed:
    """Return the names of examples with this start, or let the shell complete a height map."""
    return [name for name in _examples() if name.startswith(start)] or [CompletionItem(start, type="file")]


def _keys_with(context: click.Context, option: click.Parameter, start: str) -> list[str]:
    """Return the keys, variables and gases with this start."""
    return [name for name in _explained() if name.startswith(start)]


def _explained() -> list[str]:
    """Return all names that `explain` describes."""
    from roughvol.observables.variables import VARIABLES
    from roughvol.study.reference import keys
    from roughvol.study.sections.fluid import SUBSTANCES

    return list(dict.fromkeys([*(key.path for key in keys()), *VARIABLES, *SUBSTANCES]))


@main.command(
    epilog=examples(
        "roughvol init                list the examples",
        "roughvol init seal           write seal.yaml into the current folder",
        "roughvol init face.xyz       write face.yaml, a study of this height map",
        "roughvol init face.npy --set surface.L='500 um' --set surface.heights_unit=um",
    )
)
@click.argument("example", required=False, shell_complete=_examples_with, metavar="[EXAMPLE|FILE]")
@click.option("--list", "listing", is_flag=True, help="List the examples and write nothing.")
@SET
def init(example: str | None, listing: bool, changes: tuple[str, ...]) -> None:
    """Write the study EXAMPLE, or the study of the height map FILE, into the current folder, or list the examples.

    Sizes and units come from FILE. What it lacks is left to fill in. Files that exist are not overwritten.
    """
    known = _examples()
    if example is None or listing:
        say(cli_text.table(("example", "content"), [(name, _title(text)) for name, text in known.items()]))
        say("write one with: roughvol init EXAMPLE; the study of a height map with: roughvol init FILE")
        return
    if example not in known and Path(example).is_file():
        _write_study_of_map(Path(example), known["scan"], changes)
        return
    if example not in known:
        near = difflib.get_close_matches(example, known, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise click.UsageError(f"no example and no height map {example!r}{hint} (examples: {', '.join(known)})")
    if changes:
        message = "--set changes the study of a height map; an example is changed by: roughvol run EXAMPLE.yaml --set …"
        raise click.UsageError(message)
    files = {f"{example}.yaml": known[example]}
    if example == "scan":
        files[SCAN] = _heights()
    _write_new(files)
    say(f"next: roughvol run {example}.yaml, then roughvol show {example}")


def _write_new(files: dict[str, str]) -> None:
    """Write files into the current folder, or none if any of them is there."""
    if present := [name for name in files if Path(name).exists()]:
        raise FolderError(f"already in {Path.cwd()}: {', '.join(present)}; nothing was written")
    for name, text in files.items():
        stamped_file.store(Path(name), text.encode())
        say(f"wrote {name}")


def _write_study_of_map(path: Path, example: str, changes: Sequence[str]) -> None:
    """Write the study of a height map, as that of the example; lengths and units that it lacks are to be filled in."""
    from roughvol.study import loads

    name = re.sub(r"[^A-Za-z0-9_-]+", "_", path.stem).strip("_-")[:100] or "map"
    surface = {"file": str(path), "level": "tilt"}
    rest = [line for line in example.splitlines() if not line.startswith(("#", "name:", "surface:"))]

    def study(keys: Mapping[str, str]) -> str:
        section = ", ".join(f"{key}: {_quoted(value)}" for key, value in (surface | given | dict(keys)).items())
        return "\n".join([f"name: {name}", f"surface: {{{section}}}", *rest]) + "\n"

    if other := [change for change in changes if not change.startswith("surface.")]:
        message = f"--set {other[0]}: allowed are keys of surface; give the others in the study that is written"
        raise click.UsageError(message)
    # lengths and units on trial, to learn what the file lacks
    given = {key.removeprefix("surface."): value for key, _, value in (change.partition("=") for change in changes)}
    absent: dict[str, str] = {}
    while True:
        try:
            case = loads(study(absent), f"{name}.yaml").cases()[0]
            lacking = [] if case.length_unit else ["unit"]
        except StudyError as error:
            keys = [problem.key.removeprefix("surface.") for problem in error.problems if "missing" in problem.message]
            lacking = [key for key in keys if key in TO_FILL_IN and key not in absent]
            if not lacking:
                raise
        absent |= {key: TO_FILL_IN[key] for key in lacking}
        if not lacking:
            break
    head = [
        f"# The height map {path}. Give material, end of the sweep and fluid; roughvol explain has all keys.",
        f"#   roughvol check {name}.yaml --look",
        f"#   roughvol run {name}.yaml",
        f"#   roughvol card {name}.yaml",
    ]
    to_fill_in = {key: f"FILL IN, as {value}" for key, value in absent.items()}
    _write_new({f"{name}.yaml": "\n".join([*head, study(to_fill_in)])})
    if absent:
        say(f"fill in {' and '.join(f'surface.{key}' for key in absent)}, which {path} does not give")
    say(f"next: roughvol check {name}.yaml --look")


def _quoted(text: str) -> str:
    """Return a text for a flow mapping of YAML, in quotes where it needs them."""
    return text if re.fullmatch(r"[\w./ ]*\w", text) else json.dumps(text, ensure_ascii=False)


def _examples() -> dict[str, str]:
    """Return the text of the examples of this package by name."""
    folder = resources.files("roughvol") / "examples"
    names = sorted(path.name for path in folder.iterdir() if path.name.endswith(".yaml"))
    return {name.removesuffix(".yaml"): (folder / name).read_text(encoding="utf-8") for name in names}


def _title(text: str) -> str:
    return text.splitlines()[0].removeprefix("# ")


def _heights() -> str:
    """Return a small map as text: 65 x 65 heights in um on a slight slope, Sq = 2 um."""
    from roughvol.surfaces.midpoint import random_midpoint_displacement

    surface = random_midpoint_displacement(2.3, 6, side=500.0, seed=1).scaled(2.0)
    heights = surface.heights - surface.heights.mean()
    rows, columns = heights.shape
    tilted = [[heights[i, j] + 0.02 * i + 0.01 * j for j in range(columns)] for i in range(rows)]
    lines = [" ".join(f"{height:.4f}" for height in row) for row in tilted]
    return "\n".join(lines) + "\n"


@main.command(
    epilog=examples(
        "roughvol explain                      the sections of a study",
        "roughvol explain surface.file         a key: values, default, meaning",
        "roughvol explain free_volume          a variable of study.nc",
        "roughvol explain helium               a gas: viscosity, molar mass, mean free path",
    )
)
@click.argument("name", required=False, shell_complete=_keys_with)
@click.option("--markdown", is_flag=True, help="Print all keys and variables as one page.")
def explain(name: str | None, markdown: bool) -> None:
    """Describe NAME: a key of a study, a section, a stored variable, or a gas."""
    from roughvol.observables.variables import VARIABLES
    from roughvol.study.reference import keys
    from roughvol.study.sections.fluid import SUBSTANCES

    if markdown:
        say(page(), nl=False)
        return
    if name is None:
        for key in keys():
            if "." not in key.path:
                _say_key(key)
        say("more: roughvol explain KEY, as surface.file; roughvol explain VARIABLE, as free_volume")
        return
    name = name.strip().strip(".")
    exact = [key for key in keys() if key.path == name]
    inside = [key for key in keys() if key.path.rpartition(".")[0] == name]
    other = [key for key in keys() if not exact and key.path.rpartition(".")[2] == name]
    if name in SUBSTANCES:
        _say_gas(name)
        return
    if not exact and not other and name not in VARIABLES:
        near = difflib.get_close_matches(name, _explained(), n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(near)}? " if near else ""
        raise click.UsageError(f"no key and no variable {name!r}; {hint}roughvol explain lists the sections")
    if name in VARIABLES:
        _say_variable(name, VARIABLES[name])
    for key in exact:
        _say_key(key)
    listed = {key.path: _short(key.description) for key in reversed(inside or other)}
    if listed:
        rows = list(reversed(listed.items()))
        say(textwrap.indent(cli_text.table(("key", "meaning"), rows), "  "))


def _short(text: str) -> str:
    return textwrap.shorten(text, WIDTH - 20, placeholder=" …")


def _say_key(key: Key) -> None:
    say(key.path + (f"   ({key.form})" if key.form else ""))
    for title, text in _facts(key):
        lines = textwrap.wrap(text, WIDTH, initial_indent=f"  {title:8s} ", subsequent_indent=" " * 11)
        say("\n".join(lines))


def _facts(key: Key) -> Iterator[tuple[str, str]]:
    yield "meaning", key.description
    yield "values", key.values
    yield "default", "must be given" if key.default is None else key.default


def _say_variable(name: str, row: Variable) -> None:
    say(f"{name}   {row.symbol}   variable of study.nc")
    from roughvol.store.record_key import record_key

    needs = record_key(name) or "every study, or as docs/reference/observables.md describes"
    along = row.dims.replace("...", "D m seed (or case)") or "none, one number"
    facts = (
        ("meaning", row.long_name),
        ("units", row.units),
        ("along", along),
        ("stored", needs),
        ("from", row.source),
    )
    for title, text in facts:
        say(f"  {title:8s} {text}")


def _say_gas(name: str) -> None:
    from roughvol.study.sections.fluid import SUBSTANCES, Fluid

    row, gas = SUBSTANCES[name], Fluid(gas=name, inlet="1 bar", outlet="0 bar")  # type: ignore[arg-type]
    facts = (
        ("gas", f"fluid: {{gas: {name}, inlet: 2 bar, outlet: 1 bar}}"),
        ("viscosity", f"{1e6 * gas.viscosity:.4g} uPa*s at {gas.temperature}"),
        (
            "stored",
            f"{1e6 * row.viscosity:.4g} uPa*s at {row.reference:g} K, Sutherland's constant {row.sutherland:g} K",
        ),
        ("molar mass", f"{1e3 * row.molar_mass:.5g} g/mol"),
        ("free path", f"{1e9 * gas.mean_free_path(1e5):.3g} nm at 1 bar and {gas.temperature}"),
        ("from", "White, Viscous Fluid Flow (2006); docs/how-to/gas-leak.md"),
    )
    click.echo(name)
    for title, text in facts:
        click.echo(f"  {title:10s} {text}")


def page() -> str:
    """Return the page of all keys and variables in Markdown."""
    from roughvol.observables.variables import VARIABLES
    from roughvol.study.reference import keys

    lines = [HEAD]
    for section in (key for key in keys() if "." not in key.path):
        lines += [f"### {section.path}", "", f"{_cell(section.description)}.", ""]
        inner = [key for key in keys() if key.path.startswith(f"{section.path}.")]
        if not inner:
            lines += [f"Values: {_cell(section.values)}. Default: {_code(section.default)}.", ""]
            continue
        forms = list(dict.fromkeys(key.form for key in inner if key.path.count(".") == 1))
        for form in forms:
            lines += [f"**{form}**", ""] if form else []
            lines += ["| key | values | default | meaning |", "|---|---|---|---|"]
            lines += [_line(key) for key in _of_form(inner, form)]
            lines.append("")
    lines += ["## Variables of study.nc", "", "Starred numbers have the unit 1; `length` is the unit of L.", ""]
    lines += ["| name | symbol | unit | meaning | along | with |", "|---|---|---|---|---|---|"]
    for name, row in VARIABLES.items():
        cells = (f"`{name}`", row.symbol, row.units, row.long_name, row.dims, row.observable)
        lines.append("| " + " | ".join(_cell(cell) for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _of_form(keys: list[Key], form: str) -> list[Key]:
    """Return the keys of one form of a section, each followed by those inside it."""
    found, taken = [], False
    for key in keys:
        taken = key.form == form if key.path.count(".") == 1 else taken
        if taken:
            found.append(key)
    return found


def _line(key: Key) -> str:
    name = f"`{key.path.partition('.')[2]}`" + (f" ({key.form})" if key.form and key.path.count(".") > 1 else "")
    cells = (name, _cell(key.values), _code(key.default), _cell(key.description))
    return "| " + " | ".join(cells) + " |"


def _code(default: str | None) -> str:
    return "must be given" if default is None else "–" if default == "none" else f"`{default}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("*", "\\*")
