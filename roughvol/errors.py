"""What can go wrong, named: every error roughvol raises on purpose is one of these, and each is also a built-in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


class RoughvolError(Exception):
    """Base of every error raised on purpose; the command line turns it into one message and an exit code."""


@dataclass(frozen=True)
class Problem:
    """One thing wrong in a study file: where it stands (file, line, key path) and what is allowed there."""

    message: str
    key: str = ""
    line: int | None = None
    file: str = ""

    def __str__(self) -> str:
        """Return ``file:line: key: message`` with the parts that are known."""
        place = self.file + (f":{self.line}" if self.line is not None else "")
        return ": ".join(part for part in (place, self.key, self.message) if part)


class StudyError(RoughvolError, ValueError):
    """A study that cannot be run; ``problems`` holds all that is wrong with it, in the order of the file."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))


class SurfaceError(RoughvolError, ValueError):
    """Heights or surface parameters from which no surface can be made."""


class ContactError(RoughvolError, ValueError):
    """A contact problem that is not well posed: the message names the quantity, its value and what is allowed."""


class ConvergenceError(RoughvolError, RuntimeError):
    """A solve that did not reach its residual; carries the indentation, the iterations and the residual reached."""

    def __init__(self, message: str, *, indentation: float, iterations: int, residual: float) -> None:
        self.indentation, self.iterations, self.residual = indentation, iterations, residual
        super().__init__(message, indentation, iterations, residual)

    def __reduce__(self) -> tuple[object, ...]:
        """Survive the way back from a worker process, which pickles by ``args`` alone."""
        rebuild = (self.args[0], self.indentation, self.iterations, self.residual)
        return (_convergence_error, rebuild)

    def __str__(self) -> str:
        """Return the message with the numbers behind it."""
        return (
            f"{self.args[0]} (indentation {self.indentation:.6g}, {self.iterations} iterations, "
            f"residual {self.residual:.3g})"
        )


def _convergence_error(message: str, indentation: float, iterations: int, residual: float) -> ConvergenceError:
    return ConvergenceError(message, indentation=indentation, iterations=iterations, residual=residual)


class DatasetError(RoughvolError, OSError):
    """A stored file that is missing, unreadable, incomplete or not what its name says."""


class FolderError(DatasetError):
    """The folder of a run that cannot be used: locked, of another study, full, read-only or gone; it says which."""


class ResourceError(RoughvolError, RuntimeError):
    """What a run needs and cannot have: memory, disk; the message holds how much there is."""


class CampaignError(RoughvolError, RuntimeError):
    """A run in which some cases failed; the message lists them."""
