"""Loops over elements as compiled code: numba translates a function at its first call and keeps the result on disk.

The compiled code lies beside the module, or in the cache folder of the user. Without a folder that can be written, on a
full disk, and where a file is damaged, a process compiles anew. Sums keep their order, so the bits do not depend on the
width of a machine's registers. A compiled function calls compiled functions of its own module alone, since the code on
disk is renewed where its own module changes.
"""

import pickle
from collections.abc import Callable
from types import FunctionType
from typing import Any, TypeVar, cast

Loops = TypeVar("Loops", bound=Callable[..., Any])
UNUSABLE = (OSError, EOFError, pickle.UnpicklingError)  # of code on disk; loops over elements raise none of them


class _Compiled:
    """A function that is translated at its first call, so that numba is imported by flows alone."""

    def __init__(self, function: FunctionType) -> None:
        self.py_func = function
        self._translated: Callable[..., Any] | None = None

    def __call__(self, *arguments: Any) -> Any:
        try:
            return self._function(kept=True)(*arguments)
        except UNUSABLE:
            self._translated = self._function(kept=False)
            return self._translated(*arguments)

    def _function(self, *, kept: bool) -> Callable[..., Any]:
        """Return the function of numba; ``kept``: its code and that of the functions it calls are kept on disk."""
        if kept and self._translated is not None:
            return self._translated
        import numba

        own, names = self.py_func, dict(self.py_func.__globals__)
        parts = {name: part for name in own.__code__.co_names if isinstance(part := names.get(name), _Compiled)}
        names.update({name: part._function(kept=kept) for name, part in parts.items()})
        function = FunctionType(own.__code__, names, own.__name__, own.__defaults__)
        function.__qualname__, function.__module__ = own.__qualname__, own.__module__
        try:
            translated = numba.njit(cache=kept)(function)
        except RuntimeError:  # no folder for the compiled code
            translated = numba.njit(function)
        if kept:
            self._translated = translated
        return cast(Callable[..., Any], translated)


def compiled(function: Loops) -> Loops:
    """Return the function as compiled code."""
    return cast(Loops, _Compiled(cast(FunctionType, function)))
