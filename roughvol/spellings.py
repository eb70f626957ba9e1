"""Former spellings of public names, for studies, commands and Python.

Before version `until` a former spelling works, with a warning that has the new one. From then on it is refused with the
new one. docs/reference/promise.md says how long. Names that left before version 1.0 did not work on.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar, cast

import lazy_loader

from roughvol._version import __version__
from roughvol.errors import RoughvolDeprecation, warn
from roughvol.tables import table

Kind = Literal["key", "load", "variable", "attribute", "figure", "option", "answer", "exit code", "name", "entry point"]
F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True)
class Former:
    """A former spelling.

    - ``kind``: kind of the name. An answer is a key of ``--json``.
    - ``old``: a key with its sections, also with a value, as ``sweep.steps=auto``; an option behind its command; a
      Python name behind its module; an argument in brackets behind its function or class
    - ``new``: the new spelling, or what to do. Of an argument that works: the new argument alone.
    - ``since``, ``until``: the version that brought the new spelling, and the first that refuses the former one
    - ``values``: new values of a key or an argument by former ones. Other values stay.
    """

    kind: Kind
    old: str
    new: str
    since: str
    until: str
    values: Mapping[object, object] = field(default_factory=dict)

    @property
    def works(self) -> bool:
        """Whether this version takes it."""
        return _number(__version__) < _number(self.until)

    @property
    def message(self) -> str:
        """The state of the spelling and the new one."""
        if self.works:
            return f"is the former spelling of {self.new}, and works until version {self.until}"
        return f"left with version {self.until}; in its place: {self.new}"


FORMER = tuple(Former(**row | {"values": dict(row.get("values", ()))}) for row in table(__file__)["former"])


def of(kind: Kind) -> Iterator[Former]:
    """Yield the former spellings of a kind."""
    return (row for row in FORMER if row.kind == kind)


def former(kind: Kind, old: str) -> Former | None:
    """Return the row of a former spelling, None of another text."""
    return next((row for row in of(kind) if row.old == old), None)


def attach(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of the stub of a package, with its former names."""
    of_stub, names, every = lazy_loader.attach_stub(package, file)

    def attribute(name: str) -> Any:
        row = former("name", f"{package}.{name}")
        if row is None:
            return of_stub(name)
        warn([f"{row.old} {row.message}"], RoughvolDeprecation)  # an ImportError would not show the message
        if not row.works:
            raise AttributeError(f"{row.old} {row.message}")
        return of_stub(row.new.rpartition(".")[2])

    return attribute, names, every


def arguments(made: F) -> F:
    """Let a function or a class take its former arguments with a warning, or refuse them with the new ones."""
    decorated: Any = made
    call = decorated.__init__ if isinstance(made, type) else made
    present = inspect.signature(call).parameters

    @functools.wraps(call)
    def checked(*values: Any, **named: Any) -> Any:
        taken: dict[str, Any] = {}
        for name in named.keys() - present:
            end = f".{decorated.__name__}({name})"
            if row := next((row for row in of("name") if row.old.endswith(end)), None):
                message = f"{decorated.__name__}: argument {name} {row.message}"
                if not row.works:
                    raise TypeError(message)
                warn([message], RoughvolDeprecation)
                value = named.pop(name)
                taken[row.new] = row.values.get(value, value) if row.values else value
        return call(*values, **named, **taken)

    if not isinstance(made, type):
        return cast("F", checked)
    decorated.__init__ = checked
    return made


def _number(version: str) -> list[int]:
    """Return the numbers of a version."""
    return [int(part) for part in re.findall(r"\d+", version)[:3]]
