"""Errors. Each is a `RoughvolError` and a built-in exception."""

from __future__ import annotations

import contextlib
import difflib
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

INSIDE = (f"{Path(__file__).parent}{os.sep}", contextlib.__file__)  # files that are not the caller's


class RoughvolError(Exception):
    """Base of all errors raised on purpose. The command line turns it into a message and an exit code."""


class RoughvolWarning(UserWarning):
    """A doubt about a study or its results. The attribute ``warnings`` of the dataset has the same sentences.

    See Also
    --------
    roughvol.run, roughvol.press : Warn of limits of the model and of doubtful input.

    Examples
    --------
    >>> import warnings
    >>> import roughvol
    >>> heights = [[0.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 0.0, 0.0]]
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", roughvol.RoughvolWarning)
    ...     ds = roughvol.press(heights, L=2.0, steps=1)
    >>> len(ds.attrs["warnings"].splitlines()) > 0
    True
    """


class RoughvolDeprecation(RoughvolWarning, FutureWarning):
    """A former spelling that still works. The message has the place and the new spelling."""


def nearest_word(word: str, known: Iterable[str]) -> str | None:
    """Return the known word most similar to ``word``, ignoring case, at best one of its letters; None without one."""
    lower = {name.lower(): name for name in known}
    close = difflib.get_close_matches(word.lower(), lower, cutoff=0.65)
    return lower[min(close, key=lambda name: sorted(name) != sorted(word.lower()))] if close else None


def meant(word: str, known: Iterable[str]) -> str:
    """Return the question for the known word most similar to ``word``, for a message; empty without one."""
    return question(filter(None, [nearest_word(word, known)]))


def question(near: Iterable[str]) -> str:
    """Return the question for similar words, for a message; empty without a word."""
    words = " or ".join(f"'{word}'" for word in near)
    return f"; did you mean {words}?" if words else ""


def warn(sentences: Iterable[str], category: type[RoughvolWarning] = RoughvolWarning) -> None:
    """Warn at the line of the caller outside this package."""
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and frame.f_code.co_filename.startswith(INSIDE):
        frame, level = frame.f_back, level + 1
    for sentence in sentences:
        warnings.warn(sentence, category, stacklevel=level)


CHANGES = "changes"  # the argument of a call, and --set of a command, as the place of a problem


@dataclass(frozen=True)
class Problem:
    """One problem of a study: message with the allowed values, key path, and its place in a file or a call."""

    message: str
    key: str = ""
    line: int | None = None
    file: str = ""
    argument: str = ""  # of a call from Python, in place of file, line and key

    def __str__(self) -> str:
        """Return ``file:line: key: message`` without unknown parts, or ``argument: message``."""
        if self.argument:
            return f"{self.argument}: {self.message}"
        location = self.file + (f":{self.line}" if self.line is not None else "")
        return ": ".join(part for part in (location, self.key, self.message) if part)


class StudyError(RoughvolError, ValueError):
    """A study that cannot be run. ``problems`` has all its problems in the order of the file."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the problems: exceptions pickle the message alone."""
        return (type(self), (self.problems,))


@contextlib.contextmanager
def each_problem(changed: Callable[[Problem], Problem]) -> Iterator[None]:
    """Change every problem of a `StudyError` raised inside."""
    try:
        yield
    except StudyError as error:
        raise StudyError([changed(problem) for problem in error.problems]) from error


class SurfaceError(RoughvolError, ValueError):
    """Heights or parameters that make no surface."""


class ContactError(RoughvolError, ValueError):
    """An ill-posed contact problem. The message has the quantity, its value and the allowed values."""


class ConvergenceError(RoughvolError, RuntimeError):
    """A solve without convergence: indentation Δ/σ, number of iterations, residual η/σ."""

    def __init__(self, message: str, indentation: float, iterations: int, residual: float) -> None:
        self.indentation, self.iterations, self.residual = indentation, iterations, residual
        super().__init__(message, indentation, iterations, residual)

    def __str__(self) -> str:
        """Return the message, then the numbers."""
        numbers = f"{self.iterations} iterations, residual {self.residual:.3g}"
        return f"{self.args[0]} (indentation {self.indentation:.6g}, {numbers})"


class DatasetError(RoughvolError, OSError):
    """A stored file that is missing, unreadable, incomplete or of another kind."""


class FolderError(DatasetError):
    """A folder that no run can use: locked, of another study, full, read-only or gone."""


class ResourceError(RoughvolError, RuntimeError):
    """Lack of memory or disk. The message has the need and the amount available."""


class CampaignError(RoughvolError, RuntimeError):
    """A run with failed cases. The message lists them."""
