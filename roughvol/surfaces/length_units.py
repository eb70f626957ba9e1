"""Units of length that a study or a height file may name, and the metres in each."""

from __future__ import annotations

import re

METRES = {"pm": 1e-12, "angstrom": 1e-10, "nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3}
_SPELLED = dict.fromkeys(("\u00b5m", "\u03bcm", "\u00b5", "micron", "microns"), "um")
_SPELLED |= dict.fromkeys(("\u00c5", "\u212b", "A", "angstroms"), "angstrom")
_PREFIXES = {"pico": "pm", "nano": "nm", "micro": "um", "milli": "mm", "centi": "cm", "kilo": "km", "": "m"}
_WORD = re.compile(rf"({'|'.join(_PREFIXES)})[-_ ]?met(?:er|re)s?", re.IGNORECASE)


def named(unit: str) -> str | None:
    """Return the name of a unit in `METRES` (``um`` for µm or micrometre), or None if it is no unit of length."""
    unit = unit.strip()
    if found := _WORD.fullmatch(unit):
        return _PREFIXES[found[1].lower()]
    unit = _SPELLED.get(unit, unit)
    return unit if unit in METRES else None


def is_count(unit: str) -> bool:
    """Return whether a unit of heights is the height of a count, as ``0.95 nm``."""
    return " " in unit


def factor(given: str, wanted: str) -> float:
    """Return the factor from numbers in one unit to numbers in another, a key of `METRES`; the first may be a count."""
    number, _, name = given.rpartition(" ")
    return float(number or 1.0) * METRES[name] / METRES[wanted]
