"""The library pyfftw, imported without dask.

pyfftw imports dask.array where dask is installed, for an interface that roughvol does not use. The import would take
half a second in each process.
"""

import sys

__all__ = ["pyfftw"]

_hidden = "dask" not in sys.modules
if _hidden:
    sys.modules["dask"] = None  # type: ignore[assignment]
try:
    import pyfftw
finally:
    if _hidden:
        del sys.modules["dask"]
