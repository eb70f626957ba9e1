"""Loops over elements as compiled code: numba translates a function at its first call and keeps the result on disk.

The compiled code lies beside the module, or in the cache folder of the user. Without a folder that can be written,
every process compiles anew. Sums keep their order, so the bits do not depend on the width of a machine's registers.
A compiled function calls compiled functions of its own module alone, since the code on disk is renewed where its own
module changes.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

Loops = TypeVar("Loops", bound=Callable[..., Any])


class _Compiled:
    """A function that is translated at its first call, so that numba is imported by flows alone."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.py_func = function
        self._translated: Callable[..., Any] | None = None

    def __call__(self, *arguments: Any) -> Any:
        if self._translated is None:
            names = self.py_func.__globals__
            parts = {name: part for name, part in names.items() if isinstance(part, _Compiled)}
            names.update({name: part.translated() for name, part in parts.items() if part.py_func.__globals__ is names})
        return self.translated()(*arguments)

    def translated(self) -> Callable[..., Any]:
        """Return the function of numba."""
        if self._translated is None:
            import numba

            try:
                self._translated = numba.njit(cache=True)(self.py_func)
            except RuntimeError:  # no folder for the compiled code
                self._translated = numba.njit(self.py_func)
        return self._translated


def compiled(function: Loops) -> Loops:
    """Return the function as compiled code."""
    return cast(Loops, _Compiled(function))
