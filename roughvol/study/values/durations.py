"""Times of computing, as text."""

from __future__ import annotations


def duration(seconds: float) -> str:
    """Return seconds in s, min, h, days or years."""
    if seconds < 100:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    days = minutes / 1440
    return f"{minutes / 60:.1f} h" if days < 3 else f"{days:.0f} days" if days < 365 else f"{days / 365.25:.3g} years"
