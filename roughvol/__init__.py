"""roughvol: the free volume between rough surfaces in elastic contact."""

from __future__ import annotations

from typing import Any

from roughvol._version import __version__

__all__ = ["__version__", "load", "run"]


def __getattr__(name: str) -> Any:
    """Import on first use, so that ``import roughvol`` (and ``roughvol --help``) stays quick."""
    if name == "run":
        from roughvol.campaign import run

        return run
    if name == "load":
        from roughvol.study import load

        return load
    message = f"module 'roughvol' has no attribute {name!r}"
    raise AttributeError(message)
