"""What the tests of leak cards share."""

from roughvol.analysis.leak_card import Closing, Part, Way


def part_of(found: Way | Closing, name: str) -> Part:
    """Return a part of the error of the leak of a way, or of its closing load."""
    return next(part for part in found.parts if part.name == name)
