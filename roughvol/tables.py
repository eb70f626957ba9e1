"""Tables of data in TOML, beside the modules that read them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any


def table(module: str, name: str = "") -> dict[str, Any]:
    """Return the table beside a module, given by its ``__file__``; default: the table of the same name."""
    path = Path(module)
    return tomllib.loads(path.with_name(f"{name or path.stem}.toml").read_text(encoding="utf-8"))
