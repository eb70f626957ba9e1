"""The finished steps of a long sweep on disk, so that a case that is killed goes on from there, bit for bit.

What is kept is plain data and arrays: nested mappings and lists are JSON in which ``{"array": k}`` stands for
the k-th array; the arrays follow in one npz. Nothing is ever pickled. A checkpoint that is damaged, or of another case,
is as good as none.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import io
import json
import platform
import time
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from roughvol._version import __version__
from roughvol.errors import DatasetError
from roughvol.store import stamped_file
from roughvol.study import Case

EVERY = 30.0  # seconds between two checkpoints of a case: writing one must cost little beside them
NODES = 1025**2  # from which on a case is worth it

State = dict[str, Any]

# What numpy, zipfile and json raise on bytes that nobody here has packed.
_UNREADABLE = (
    *(DatasetError, ValueError, LookupError, TypeError, AttributeError, EOFError, MemoryError, RecursionError),
    *(NotImplementedError, OverflowError, RuntimeError, zipfile.BadZipFile, zlib.error),
)


class Checkpoint:
    """Where the steps of one case are kept; ``numerics`` tells with what they are computed, see the function."""

    def __init__(self, path: Path, case: Case, numerics: str) -> None:
        self._path, self._labels = path, {"case": case.id, "key": case.key_text, "numerics": numerics}
        self._last = time.monotonic()

    def load(self) -> State | None:
        """Return what was kept, None if there is nothing that can be used."""
        try:
            content, labels = stamped_file.verified(self._path)
            return unpacked(content) if labels == self._labels else None
        except _UNREADABLE:
            return None

    def due(self) -> bool:
        """Return whether the last one is old enough."""
        return time.monotonic() - self._last >= EVERY

    def save(self, state: State) -> None:
        """Keep a state; that it cannot be kept is no reason to stop."""
        with contextlib.suppress(DatasetError):
            stamped_file.store(self._path, stamped_file.stamped(packed(state), self._labels))
        self._last = time.monotonic()


def numerics() -> str:
    """Return what decides on the last bit: versions and vector units; a sweep is not carried on by other ones.

    That of roughvol counts here, unlike in a finished case: the bits of one sweep come from one program.
    """
    names = ("numpy", "scipy", "pyfftw")
    versions = [f"{name} {importlib.metadata.version(name)}" for name in names]
    return ", ".join([f"roughvol {__version__}", *versions, platform.machine(), *_vector_units()])


def _vector_units() -> list[str]:
    """Return the vector units of this processor, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return [platform.processor()]
    flags = next(
        (line.split(":", 1)[1].split() for line in lines if line.lower().startswith(("flags", "features"))), []
    )
    return sorted(flag for flag in flags if flag.startswith(("sse", "avx", "fma", "asimd", "sve", "amx")))


def packed(state: State) -> bytes:
    """Return nested data and arrays as bytes."""
    arrays: list[Any] = []

    def plain(item: Any) -> Any:
        if isinstance(item, Mapping):
            return {str(name): plain(value) for name, value in item.items()}
        if isinstance(item, list | tuple):
            return [plain(value) for value in item]
        if item is None or type(item) in (bool, int, float, str):
            return item  # the JSON of a float is read back as the same float
        arrays.append(np.asarray(item))
        return {"array": len(arrays) - 1}

    text = np.frombuffer(json.dumps(plain(state)).encode(), dtype=np.uint8)
    stream = io.BytesIO()
    np.savez(stream, text=text, **{f"array{index}": array for index, array in enumerate(arrays)})
    return stream.getvalue()


def unpacked(content: bytes) -> State:
    """Return what `packed` was given; tuples have become lists."""
    with np.load(io.BytesIO(content), allow_pickle=False) as held:
        arrays = {name: held[name] for name in held.files}

    def rebuilt(item: Any) -> Any:
        if isinstance(item, dict):
            return (
                arrays[f"array{item['array']}"]
                if item.keys() == {"array"}
                else {n: rebuilt(v) for n, v in item.items()}
            )
        return [rebuilt(value) for value in item] if isinstance(item, list) else item

    return dict(rebuilt(json.loads(arrays["text"].tobytes())))
