"""YAML text to plain data (text, numbers, lists, mappings), and values to text for messages.

The rules are those of YAML 1.2: ``1e-8`` is a number, ``on`` is text. Anchors, aliases and tags are refused.
"""

from __future__ import annotations

import functools
import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

import yaml

from roughvol.errors import CHANGES, Problem
from roughvol.tables import table

MAX_BYTES, MAX_DEPTH = 1 << 20, 20
STORED_BYTES = 1 << 24  # of the study of a run, which has every default and every file of a pattern

TOO_LARGE = f"larger than {MAX_BYTES // 1024} KiB: heights belong in a file of their own (surface.file)"

PLAIN = table(__file__)

BREAKS = "[\x85\u2028\u2029]"  # YAML has them beside \n and \r

KeyPath = tuple[str | int, ...]


class UnreadableError(Exception):
    """Text without data; ``line`` is the line at which reading ended, None if unknown."""

    def __init__(self, message: str, line: int | None = None) -> None:
        self.line = line
        super().__init__(message)


def text_in(path: str | Path, what: str) -> str:
    """Return the text in a file of at most `MAX_BYTES`; UnreadableError has the reason, and the line of a fault."""
    try:
        with Path(path).open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise UnreadableError(TOO_LARGE)
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UnreadableError("not text in UTF-8", content[: error.start].count(b"\n") + 1) from error
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        raise UnreadableError(f"cannot read {what}: {getattr(error, 'strerror', None) or error}") from error


def is_file(path: Path) -> bool:
    """Return whether a file exists; no error of a name too long, of a null character, or of a folder without access."""
    return os.path.isfile(path)  # noqa: PTH113


class Reading:
    """Line and column of every key path of a text, and its problems."""

    def __init__(self, form: str = "a study is a mapping (key: value) with at least the key 'surface'") -> None:
        self.form = form
        self.marks: dict[KeyPath, tuple[int, int]] = {}
        self.problems: dict[KeyPath, str] = {}

    def read(self, text: str, most: int = MAX_BYTES) -> dict[str, Any]:
        """Return the data of a text of at most so many bytes; raise UnreadableError unless it is a mapping."""
        if len(text.encode("utf-8", "surrogatepass")) > most:
            raise UnreadableError(TOO_LARGE)
        try:
            node = _Loader(text).get_single_node()
        except yaml.YAMLError as error:
            mark, position = getattr(error, "problem_mark", None), getattr(error, "position", 0)
            parts = [getattr(error, name, None) for name in ("context", "problem", "reason")]
            message = ", ".join(filter(None, parts)) or str(error)
            message = f"not YAML: {next((plain for words, plain in PLAIN.items() if words in message), message)}"
            raise UnreadableError(message, (mark.line if mark else text.count("\n", 0, position)) + 1) from error
        except (ValueError, OverflowError, LookupError) as error:  # PyYAML does not check escapes and directives
            raise UnreadableError(f"not YAML: {error}") from error
        data = None if node is None else self._build(node, ())
        if not isinstance(data, dict):
            message = f"{self.form}, given {show(data)}"
            raise UnreadableError(message, None if node is None else node.start_mark.line + 1)
        return data

    def _build(self, node: Any, path: KeyPath) -> Any:
        self.marks.setdefault(path, (node.start_mark.line + 1, node.start_mark.column))
        kind = "" if node.tagged else node.tag.removeprefix("tag:yaml.org,2002:")
        if isinstance(node, yaml.SequenceNode) and kind == "seq":
            return [self._build(item, (*path, index)) for index, item in enumerate(node.value)]
        if isinstance(node, yaml.MappingNode) and kind == "map":
            return self._mapping(node, path)
        if isinstance(node, yaml.ScalarNode) and kind in ("null", "bool", "str", "int", "float"):
            return self._scalar(node.value, kind, path)
        self.problems[path] = f"the tag {show(node.tag)} is not allowed: a study is plain data"
        return None

    def _mapping(self, node: Any, path: KeyPath) -> dict[str, Any]:
        data: dict[str, Any] = {}
        for key_node, value_node in node.value:
            is_word = isinstance(key_node, yaml.ScalarNode) and key_node.value.isprintable()
            key = key_node.value if is_word else "?"
            key_path, first = (*path, key), self.marks.get((*path, key))
            self.marks[key_path] = (key_node.start_mark.line + 1, key_node.start_mark.column)
            if not is_word:
                self.problems[key_path] = "a key must be a word"
            elif first:
                self.problems[key_path] = f"duplicate key, first in line {first[0]}"
            else:
                data[key] = self._build(value_node, key_path)
        return data

    def _scalar(self, text: str, kind: str, path: KeyPath) -> Any:
        value: Any = {"null": None, "bool": text.lower() == "true"}.get(kind, text)
        if kind in ("int", "float"):
            try:
                value = int(text) if kind == "int" else float(text)
                sound = math.isfinite(value)
            except (ValueError, OverflowError):  # too many digits
                sound = False
        else:
            sound = text.encode("utf-8", "ignore").decode() == text  # False for half of a surrogate pair
        if not sound:
            allowed = "a finite number" if kind in ("int", "float") else "text in UTF-8"
            self.problems[path] = f"must be {allowed}, given {_short(printable(text))}"
        return value if sound else None


def write(data: dict[str, Any]) -> str:
    """Return plain data as YAML; `Reading` gives equal data."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, default_flow_style=None, width=110)


def inline(value: Any) -> str:
    """Return a value of plain data as YAML in one line, as ``{pressure: 0.1 MPa}``."""
    form: dict[str, Any] = {"sort_keys": False, "allow_unicode": True, "default_flow_style": True, "width": math.inf}
    return str(yaml.dump([value], Dumper=_Dumper, **form)).strip()[1:-1]


def number_text(value: float) -> str:
    """Return the shortest exact text of a number: ``0.1``, ``60``, ``1e-09``."""
    if isinstance(value, int):
        return str(value)
    return f"{value:g}" if float(f"{value:g}") == value else repr(value)


def finite(value: Any) -> Any:
    """Return plain data for JSON: keys as text, and None in the place of a number that is not finite."""
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


def printable(text: str) -> str:
    """Return a text with escapes for characters that cannot be printed."""
    return text if text.isprintable() else repr(text)[1:-1]


def _short(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


def show(value: Any) -> str:
    """Return a value as in a study file, at most 60 characters."""
    if isinstance(value, dict | list | tuple):
        return ("a " if value else "an empty ") + ("mapping" if isinstance(value, dict) else "list")
    if value is None or isinstance(value, bool):
        return "nothing" if value is None else str(value).lower()
    return _short(number_text(value) if isinstance(value, int | float) else repr(value))


def key_text(path: KeyPath) -> str:
    """Return a key path as text: ``surface.D[1]``."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{_short(printable(part))}" for part in path)
    return "".join(parts).removeprefix(".")


def key_path(text: str) -> KeyPath:
    """Return the key path of a text, as of ``surface.D[1]``; empty if it is none."""
    path = _parts(text)
    return path if key_text(path) == text.strip() else ()


def _parts(text: str) -> KeyPath:
    found = re.findall(r"\[(\d+)\]|([^.\[\]]+)", text.strip())
    return tuple(int(index) if index else word.strip() for index, word in found)


def put(data: Any, path: KeyPath, value: Any) -> Any:
    """Set a key of plain data, and return what holds it; mappings on its path are made.

    ValueError: the path leads through another value.
    """
    for place, key in enumerate(path):
        inside = isinstance(data, list) and isinstance(key, int) and key < len(data)
        if not inside and not (isinstance(data, dict) and isinstance(key, str)):
            where = key_text(path[:place]) or "a study"
            beyond = isinstance(data, list) and isinstance(key, int)
            kind = f"has {len(data)} items" if beyond else f"is no {'list' if isinstance(key, int) else 'mapping'}"
            raise ValueError(f"{where} {kind} in the study")
        if place == len(path) - 1:
            data[key] = value
        else:
            if isinstance(data, dict) and data.get(key) is None:  # the study of a run names sections without keys
                data[key] = {}
            data = data[key]
    return data


def given(data: Any) -> Any:
    """Return plain data without keys that have no value."""
    if not isinstance(data, dict):
        return data
    return {key: given(value) for key, value in data.items() if value is not None}


_SCALARS = (
    ("null", r"(?:~|null|Null|NULL|)\Z", ("", *"~nN")),
    ("bool", r"(?:true|True|TRUE|false|False|FALSE)\Z", "tTfF"),
    ("int", r"[-+]?[0-9]+\Z", "-+0123456789"),
    ("float", r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?\Z", "-+.0123456789"),
    ("float", r"(?:[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))\Z", "-+."),
)
_RESOLVERS: dict[str, list[tuple[str, re.Pattern[str]]]] = {}


def _stop(message: str, event: Any) -> NoReturn:
    raise UnreadableError(message, event.start_mark.line + 1)


class _Loader(yaml.SafeLoader):
    """A loader with the scalars of YAML 1.2, limited depth, and no references. A node knows whether it has a tag."""

    yaml_implicit_resolvers = _RESOLVERS
    depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()
        if getattr(event, "anchor", None) is not None:
            _stop("anchors (&) and aliases (*) are not allowed: repeat the value", event)
        if self.depth >= MAX_DEPTH:
            _stop(f"nested more than {MAX_DEPTH} levels deep", event)
        self.depth += 1
        node: Any = super().compose_node(parent, index)
        node.tagged = event.tag is not None
        self.depth -= 1
        return node


class _Dumper(yaml.SafeDumper):
    """A dumper with quotes where `_Loader` needs them, and without aliases."""

    yaml_implicit_resolvers = _RESOLVERS

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def text(self, data: str) -> yaml.ScalarNode:
        """Return a text, in double quotes where it has breaks that YAML reads as a space or a line feed."""
        return self.represent_scalar("tag:yaml.org,2002:str", data, '"' if re.search(BREAKS, data) else None)


for _kind, _pattern, _first in _SCALARS:
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_kind}", re.compile(_pattern), list(_first))
_Dumper.add_representer(str, _Dumper.text)


@dataclass(frozen=True)
class Arguments:
    """The arguments of a call from Python, for messages: each stands for a part of a study.

    ``names`` has the argument for a key, as "E" for "material.E"; the empty key is the study. ``call`` may be empty.
    """

    call: str
    names: Mapping[str, str] = field(default_factory=dict)

    def of(self, key: str) -> str:
        """Return the argument that holds a key, as ``run: study["surface"]["L"]``."""
        parts = _parts(key)
        for end in range(len(parts), -1, -1):
            name = self.names.get(key_text(parts[:end]))
            if name is not None:
                items = "".join(f'["{part}"]' if isinstance(part, str) else f"[{part}]" for part in parts[end:])
                return self._in_call(f"{name}{items}")
        return self._in_call(key)

    def _in_call(self, argument: str) -> str:
        return f"{self.call}: {argument}" if self.call else argument


@dataclass
class Places:
    """Where the keys of a study stand: lines of a file, the option --set, or arguments of a call.

    All are equal: they are no part of the identity of a study. ``marks`` has line and column of each key, ``changed``
    the keys and sections of --set.
    """

    file: str = field(default="", compare=False)
    marks: Mapping[KeyPath, tuple[int, int]] = field(default_factory=dict, compare=False)
    arguments: Arguments | None = field(default=None, compare=False)
    changed: tuple[str, ...] = field(default=(), compare=False)

    def mark(self, key: KeyPath) -> tuple[int, int]:
        """Return line and column of a key, or of the nearest mapping that holds it."""
        while key and key not in self.marks:
            key = key[:-1]
        return self.marks.get(key, (1, 0))

    @functools.cached_property
    def _lines(self) -> dict[str, int]:
        return {key_text(key): line for key, (line, _) in self.marks.items()}

    def of(self, problem: Problem) -> Problem:
        """Return a problem with its place. A missing key gets the line of its mapping."""
        if problem.file or problem.argument:
            return problem
        key = problem.key
        if any(key == one or key.startswith((f"{one}.", f"{one}[")) for one in self.changed):
            return replace(problem, file=CHANGES)
        if self.arguments is not None:
            return replace(problem, argument=self.arguments.of(problem.key))
        while key and key not in self._lines:
            key = key.rpartition(".")[0]
        return replace(problem, line=self._lines.get(key), file=self.file)
