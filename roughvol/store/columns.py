"""Small arrays as plain bytes, to be read back a hundred times quicker than from netCDF: for campaigns of many cases.

    values, array after array | head (JSON: name, dimensions, type and shape of each) | length of the head (8 digits)

Texts stand in the head. Nothing is ever pickled, and nothing is read beyond the bytes given.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, tuple[tuple[str, ...], NDArray[Any]]]  # values by name, with their dimensions

KINDS = "biuf"  # of the values that are bytes: truth, whole and real numbers
DIGITS, ALIGNED = 8, 8


def packed(arrays: Mapping[str, tuple[tuple[str, ...], NDArray[Any]]]) -> bytes:
    """Return named arrays of numbers or texts, with their dimensions, as bytes."""
    head: dict[str, Any] = {}
    parts: list[bytes] = []
    for name, (dims, values) in arrays.items():
        if values.dtype.kind not in KINDS:
            head[name] = [dims, None, values.tolist()]
            continue
        array = values.astype(values.dtype.newbyteorder("<"), order="C")
        head[name] = [dims, array.dtype.str, array.shape]
        parts += [array.tobytes(), bytes(-array.nbytes % ALIGNED)]
    text = json.dumps(head).encode()
    return b"".join([*parts, text, b"%0*d" % (DIGITS, len(text))])


def unpacked(block: bytes) -> Arrays:
    """Return what was packed; numbers cannot be written to.

    Raises
    ------
    ValueError
        If the bytes are not of `packed`.
    """
    try:
        end = len(block) - DIGITS
        start = end - int(block[end:])
        if not 0 <= start <= end:
            message = "the length of the head is wrong"
            raise ValueError(message)
        arrays: Arrays = {}
        place, numbers = 0, memoryview(block)[:start]
        for name, (dims, kind, shape) in json.loads(block[start:end]).items():
            if kind is None:
                arrays[name] = (tuple(dims), np.array(shape, dtype=object))
                continue
            dtype = np.dtype(kind)
            if dtype.kind not in KINDS:
                message = f"{name} is of type {kind}"
                raise ValueError(message)
            count = math.prod(shape)
            if min(shape, default=0) < 0:
                message = f"{name} has shape {shape}"
                raise ValueError(message)
            values = np.frombuffer(numbers, dtype, count, place) if count else np.empty(0, dtype)
            arrays[name] = (tuple(dims), values.reshape(shape))
            place += -(-values.nbytes // ALIGNED) * ALIGNED
    except (AttributeError, TypeError, OverflowError, RecursionError) as error:
        message = f"these are no columns ({error})"
        raise ValueError(message) from error
    return arrays
