"""The command line as ``python -m roughvol``."""

from __future__ import annotations

from roughvol.cli import main

if __name__ == "__main__":
    main(prog_name="roughvol")
