"""What the tests of leak cards share."""

from roughvol.analysis.leak_card import Part, Way


def part_of(way: Way, name: str) -> Part:
    """Return a part of the error of the leak of a way."""
    return next(part for part in way.parts if part.name == name)
