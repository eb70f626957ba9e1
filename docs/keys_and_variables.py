"""Write docs/reference/keys-and-variables.md, all keys of a study and all stored variables: `make reference`."""

from __future__ import annotations

from pathlib import Path

from roughvol.observables.variables import VARIABLES
from roughvol.study.reference import Key, keys

PAGE = Path(__file__).parent / "reference" / "keys-and-variables.md"
HEAD = """# Reference

Keys of a study file, and variables of `study.nc`. `make reference` writes this page from the schema and the table of
variables; `roughvol explain KEY` and `roughvol explain VARIABLE` print one row of it.

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


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
