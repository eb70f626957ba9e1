"""Columns: what is packed comes back to the bit, and bytes of another origin are an error and nothing else."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roughvol.store.columns import packed, unpacked


def test_what_is_packed_comes_back() -> None:
    arrays = {
        "real": (("x", "y"), np.array([[np.nan, -0.0, 1e-300], [np.inf, 0.1, -2.0]])),
        "turned": (("y", "x"), np.arange(6.0).reshape(2, 3).T),
        "other_end": (("x",), np.array([1, 2], dtype=">i4")),
        "true": (("step",), np.array([True, False, True])),
        "whole": ((), np.array(2**62 + 1)),
        "none": (("x", "y"), np.empty((0, 3))),
        "text": (("at",), np.array(["A* = 0.1", "é"], dtype=object)),
    }
    back = unpacked(packed(arrays))
    assert list(back) == list(arrays)
    for name, (dims, values) in arrays.items():
        assert back[name][0] == dims
        np.testing.assert_array_equal(back[name][1], values)
        assert back[name][1].dtype == values.dtype.newbyteorder("<")
    np.testing.assert_array_equal(np.signbit(back["real"][1]), np.signbit(arrays["real"][1]))


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=60), st.integers(0, 60))
def test_other_bytes_are_an_error(noise: bytes, length: int) -> None:
    for block in (noise, noise + b"%08d" % length):
        with pytest.raises(ValueError, match=r"."):
            unpacked(block)


@pytest.mark.parametrize(
    "head",
    [
        *([1], 5, None, "x", {"a": 1}, {"a": [["x"], "<f8"]}, {"a": [["x"], "O", [1]]}, {"a": [["x"], "<f8", [-1]]}),
        *(
            {"a": [["x"], "<f8", [1 << 60]]},
            {"a": [["x"], "<f8", ["x"]]},
            {"a": [["x"], "V8", [1]]},
            {"a": [1, "<f8", [1]]},
        ),
    ],
)
def test_a_head_that_promises_what_is_not_there_is_an_error(head: object) -> None:
    text = json.dumps(head).encode()
    with pytest.raises(ValueError, match=r"."):
        unpacked(b"\x00" * 8 + text + b"%08d" % len(text))
