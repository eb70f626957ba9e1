"""Former keys of a study: they are taken with a warning, or refused with the new key (`roughvol.spellings`)."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from roughvol import spellings
from roughvol.errors import Problem
from roughvol.study.plain_data import KeyPath, key_text, show, write


def renamed(
    data: dict[str, Any], problems: dict[KeyPath, str], changed: Collection[KeyPath] = (), *, written: bool = False
) -> list[Problem]:
    """Give former keys of plain data their new names, in place, and return what to warn of.

    Refused keys are added to ``problems``. ``changed`` are keys that replace others of the data, also under their new
    names. With ``written``, the data are those of a run, in the keys of the version that wrote them: words that left
    are left out.
    """
    said = []
    for row in spellings.of("key"):
        key, _, value = row.old.partition("=")
        *section, last = key.split(".")
        new = row.new.rpartition(".")[2]
        for inside, mapping in _mappings(data, section, ()):
            if last not in mapping or (value and str(mapping[last]) != value):
                continue
            place = (*inside, last)
            if not (row.works or written):
                problems.setdefault(place, row.message)
                continue
            given = mapping.pop(last)
            if not row.works and value:
                continue
            meant = row.values.get(given, given) if isinstance(given, bool | str) else given
            if place in changed:
                mapping[new] = meant
            elif mapping.setdefault(new, meant) != meant:
                problems[*inside, new] = f"contradicts {last}: {show(given)}; give {new} alone"
            if written:
                continue
            text = write({new: meant}).strip("{}\n")
            said.append(Problem(f"{row.message}: write {text}", key_text(place)))
    return said


def _mappings(data: Any, section: list[str], path: KeyPath) -> Iterator[tuple[KeyPath, dict[str, Any]]]:
    """Yield the mappings of a section with their places: one, or those of a list."""
    if isinstance(data, list):
        for index, item in enumerate(data):
            yield from _mappings(item, section, (*path, index))
    elif isinstance(data, dict) and not section:
        yield path, data
    elif isinstance(data, dict) and section[0] in data:
        yield from _mappings(data[section[0]], section[1:], (*path, section[0]))
