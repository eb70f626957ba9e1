"""Write docs/reference/keys-and-variables.md, all keys of a study and all stored variables: `make reference`."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import groupby
from pathlib import Path

from roughvol.observables.variables import MEAN_ENDS, OF_STATE, OF_YIELD, STATES, VARIABLES
from roughvol.study.reference import Key, keys

MEANT = tuple(name.removesuffix("_bias") for name in VARIABLES if name.endswith("_bias"))
"""Quantities of an ensemble."""
PAGE = Path(__file__).parent / "reference" / "keys-and-variables.md"
HEAD = """# Keys and variables

Keys of a study file, and variables of `study.nc`. `make reference` writes this page from the schema and the table of
variables. `roughvol explain KEY` and `roughvol explain VARIABLE` describe a name on a terminal.

## Keys of a study
"""


def page() -> str:
    """Return the page of all keys and variables in Markdown."""
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
            lines += [_line(key) for key in _once(_of_form(inner, form))]
            lines.append("")
    lines += ["## Variables of study.nc", "", "Starred numbers have the unit 1; `length` is the unit of L.", ""]
    lines += ["| name | symbol | unit | meaning | along | with |", "|---|---|---|---|---|---|"]
    made = _made()
    alone = VARIABLES.keys() - {name for names in made.values() for name in names}
    lines += [_row(f"`{name}`", *_words(name), VARIABLES[name].observable) for name in VARIABLES if name in alone]
    lines += ["", "### Names made of others", ""]
    for bases, forms in groupby(made, key=lambda form: tuple(made[form].values())):
        lines += [f"With {', '.join(f'`{base}`' for base in bases)} for Q:", ""]
        lines += ["| name | symbol | unit | meaning | along |", "|---|---|---|---|---|"]
        for form in forms:
            name, base = min(made[form].items(), key=lambda item: len(VARIABLES[item[0]].dims))
            of, (symbol, units, meaning, along) = VARIABLES[base], _words(name)
            symbol, meaning = symbol.replace(of.symbol, "Q"), re.sub(f"(the )?{re.escape(of.long_name)}", "Q", meaning)
            units = units if len({VARIABLES[name].units for name in made[form]}) == 1 else "that of Q"
            lines.append(_row(f"`{form[0]}`", symbol, units, meaning, along.replace(base, "Q")))
        lines.append("")
    del lines[-1]
    return "\n".join(lines) + "\n"


def _of_form(keys: list[Key], form: str) -> list[Key]:
    """Return the keys of one form of a section, each followed by those inside it."""
    found, taken = [], False
    for key in keys:
        taken = key.form == form if key.path.count(".") == 1 else taken
        if taken:
            found.append(key)
    return found


def _once(keys: list[Key]) -> list[Key]:
    """Return the keys, those inside a key left out where an earlier key has the same inside."""
    found: list[Key] = []
    seen: dict[tuple[tuple[str, ...], ...], str] = {}
    for parent, group in groupby(keys, key=lambda key: key.path.rpartition(".")[0]):
        inner = list(group)
        rows = tuple((key.path.removeprefix(parent), key.values, str(key.default), key.description) for key in inner)
        same = seen.setdefault(rows, parent)
        if same == parent or parent.count(".") == 0:
            found += inner
        else:
            levels = f"levels by the keys of {same.partition('.')[2]}"
            words = re.sub("levels of step, .*?, load", levels, found[-1].description)
            found[-1] = replace(found[-1], description=words)
    return found


def _made() -> dict[tuple[str, str], dict[str, str]]:
    """Return the variables that are made of others, by the form of their name and the observable: name and base."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for name, row in VARIABLES.items():
        for end in (*MEAN_ENDS, *(f"_{number}" for number in (*OF_STATE, *OF_YIELD, "step")), "_loaded", "_residual"):
            bases = MEANT if end in MEAN_ENDS else VARIABLES if end in ("_loaded", "_residual") else STATES
            if name.endswith(end) and (base := name.removesuffix(end)) in bases:
                found.setdefault((f"Q{end}", row.observable), {})[name] = base
    return found


def _words(name: str) -> tuple[str, str, str, str]:
    row = VARIABLES[name]
    return row.symbol, row.units, row.long_name, row.dims


def _row(*cells: str) -> str:
    return "| " + " | ".join(map(_cell, cells)) + " |"


def _line(key: Key) -> str:
    return _row(f"`{key.path.partition('.')[2]}`", key.values, _code(key.default), key.description)


def _code(default: str | None) -> str:
    return "must be given" if default is None else "–" if default == "none" else f"`{default}`"


def _cell(text: str) -> str:
    return re.sub(r"([|*]|<(?=Q))", r"\\\1", text)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
