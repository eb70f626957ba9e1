"""The finished steps of a long sweep on disk: a killed case goes on from there, bit for bit.

A checkpoint is one npz of arrays and a JSON text. In the text, ``{"array": k}`` refers to the k-th array. Nothing is
pickled. A checkpoint that is damaged or of another case is ignored.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import io
import json
import platform
import time
from pathlib import Path
from typing import Any

import numpy as np

from roughvol._version import __version__
from roughvol.errors import DatasetError
from roughvol.store import stamped_file
from roughvol.store.provenance import COMPUTING
from roughvol.study import Case

EVERY = 30.0  # seconds between two checkpoints of a case
NODES = 1025**2  # smallest surface with checkpoints

State = dict[str, Any]


class Checkpoint:
    """The checkpoint of one case in a file, for the versions and vector units of `numerics`."""

    def __init__(self, path: Path, case: Case, numerics: str) -> None:
        self._path, self._labels = path, {"case": case.id, "key": case.key_text, "numerics": numerics}
        self._last = time.monotonic()

    def load(self) -> State | None:
        """Return the stored state, None without a usable one: the stamp shows every other case and every damage."""
        try:
            content, labels = stamped_file.verified(self._path)
            return unpacked(content) if labels == self._labels else None
        except (DatasetError, ValueError):  # a pickle under our stamp
            return None

    def due(self) -> bool:
        """Return whether the last checkpoint is older than `EVERY`."""
        return time.monotonic() - self._last >= EVERY

    def save(self, state: State) -> None:
        """Store a state. An error of the disk is ignored."""
        with contextlib.suppress(DatasetError):
            stamped_file.store(self._path, stamped_file.stamped(packed(state), self._labels))
        self._last = time.monotonic()


def numerics() -> str:
    """Return the versions and vector units that decide on the last bit of a sweep.

    Only equal ones continue a sweep. The version of roughvol counts, unlike in a finished case.
    """
    versions = [f"{name} {importlib.metadata.version(name)}" for name in COMPUTING]
    return ", ".join([f"roughvol {__version__}", *versions, platform.machine(), *_vector_units()])


def _vector_units() -> list[str]:
    """Return the vector units of this processor, or its name where the system lists none."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return [platform.processor()]
    flags = next((line.partition(":")[2] for line in lines if line.lower().startswith(("flags", "features"))), "")
    return sorted(flag for flag in flags.split() if flag.startswith(("sse", "avx", "fma", "asimd", "sve", "amx")))


def packed(state: State) -> bytes:
    """Return nested data and arrays as bytes."""
    arrays: list[Any] = []

    def reference(item: Any) -> dict[str, int]:
        """Return the place of an array, kept beside the text; the JSON of a float is read back as the same float."""
        arrays.append(np.asarray(item))
        return {"array": len(arrays) - 1}

    text = np.frombuffer(json.dumps(state, default=reference).encode(), dtype=np.uint8)
    stream = io.BytesIO()
    np.savez(stream, text=text, **{f"array{index}": array for index, array in enumerate(arrays)})
    return stream.getvalue()


def unpacked(content: bytes) -> State:
    """Return the argument of `packed`, with lists in place of tuples."""
    with np.load(io.BytesIO(content), allow_pickle=False) as held:
        arrays = {name: held[name] for name in held.files}

    def rebuilt(item: State) -> Any:
        return arrays[f"array{item['array']}"] if item.keys() == {"array"} else item

    return dict(json.loads(arrays["text"].tobytes(), object_hook=rebuilt))
