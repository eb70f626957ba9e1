"""What the tests of height files share: a library that looks less long for points."""

import functools
import inspect
import warnings

import pytest


@pytest.fixture(scope="session", autouse=True)
def _short_headers():
    """Look for points behind 20 lines and not 200: SurfaceTopography does, three times over, in each unknown file."""
    read = getattr(_reader_of_points(), "_read", len)
    with pytest.MonkeyPatch.context() as patch:
        if "max_header_rows" in inspect.signature(read).parameters:
            patch.setattr(_reader_of_points(), "_read", functools.partialmethod(read, max_header_rows=20))
        yield


def _reader_of_points():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the library warns that it runs without MPI
        try:
            from SurfaceTopography.IO.XYZ import XYZReader
        except ImportError:
            return None
    return XYZReader
