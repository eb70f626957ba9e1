"""From a study file to a `Study`, or to all its problems.

Text becomes plain data with line numbers (`plain_data`), then records (pydantic). `validation` adds the
broken rules across sections. All problems are sorted by line.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roughvol.errors import CHANGES, Problem, RoughvolDeprecation, StudyError, warn
from roughvol.study import plain_data
from roughvol.study.former import renamed
from roughvol.study.plain_data import Arguments, KeyPath, Places, Reading, UnreadableError, key_text, printable, show
from roughvol.study.python_data import changes_of, check_type, plain, refused
from roughvol.study.sections.strict import names
from roughvol.study.sections.surface import UNSAID
from roughvol.study.study import Study
from roughvol.study.validation import models_of, read_as

if TYPE_CHECKING:
    from roughvol.typing import Changes

NO_FILES = ("<string>", "<stdin>")
A_STUDY = "a study is a file, a mapping or a Study"
RESULTS, RUNS = (".nc",), (".", "runs")  # suffix of results, and folders of runs
STUDY = Arguments("run", {"": "study"})


def load(path: str | Path, changes: Changes = ()) -> Study:
    """Read a study file.

    Parameters
    ----------
    path : str or Path
        A YAML file.
    changes : mapping or sequence of str
        Other values of keys, as ``{"surface.m": 6}`` or ``"surface.m=6"``.

    Returns
    -------
    Study
        The frozen study.

    Raises
    ------
    StudyError
        With all problems of the file in its order, or if the file cannot be read.

    See Also
    --------
    roughvol.study.loads : Reads a study from text.
    roughvol.run : Computes a study.

    Examples
    --------
    >>> import pathlib
    >>> import roughvol
    >>> _ = pathlib.Path("tiny.yaml").write_text("surface: {D: 2.5, m: 3, seeds: 2}")
    >>> roughvol.load("tiny.yaml", {"surface.m": 4}).surface.m
    (4,)
    """
    check_type(path, (str, os.PathLike), "a study file is a path", refused)
    if "\n" in str(path):
        raise refused("a study file is a path, given the text of a study; roughvol.study.loads reads text")
    file = printable(str(path))
    try:
        text = plain_data.text_in(path, "the study")
    except UnreadableError as error:
        message, line = str(error), error.line
        of_runs = [Path(folder, path, "study.yaml") for folder in RUNS]
        of_runs += [Path(path)] if Path(path).suffix in RESULTS else []
        if any(map(plain_data.is_file, of_runs)):
            them = f"roughvol.open({str(path)!r}) returns them, roughvol show prints them"
            message, line = f"holds results and is no study file: {them}", None
        raise refused(message, line=line, file=file) from error
    return _study(text, file, Path(path), changes=changes_of(changes))


def of_data(data: Mapping[str, Any], arguments: Arguments = STUDY, changes: Sequence[str] = ()) -> Study:
    """Return the study of Python data, as a dict with the keys of a study file.

    Parameters
    ----------
    data : mapping
        Keys of a study file. Values may be objects of numpy, pint, xarray and pathlib. Files are relative to the
        current folder.
    arguments : Arguments
        Names of the keys in messages. Default: ``study["surface"]["L"]``.
    changes : sequence of str
        Keys set to other values, as ``surface.m=6``.

    Returns
    -------
    Study
        The frozen study.

    Raises
    ------
    StudyError
        With all problems of the data.
    """
    if hasattr(data, "attrs"):  # a dataset is a mapping with attributes
        check_type(data, Study, A_STUDY, refused)
    problems: dict[KeyPath, str] = {}
    try:
        text = plain_data.write(plain(data, problems))
    except RecursionError as error:
        message = "nested too deep, or a mapping that contains itself"
        raise refused(message, argument=arguments.of("")) from error
    return _study(text, "", Path("study"), changes=changes, arguments=arguments, problems=problems)


def changed(study: Study, changes: Sequence[str]) -> Study:
    """Return a study with keys set to other values.

    Parameters
    ----------
    study : Study
        The study.
    changes : sequence of str
        As ``surface.m=6``.

    Returns
    -------
    Study
        The changed study.
    """
    check_type(study, Study, A_STUDY, refused)
    values = {key_text(keys): value for keys, value in map(_key_and_value, changes)}
    return study.changed(**values) if values else study


def loads(
    text: str,
    file: str | Path = "<string>",
    *,
    stored: bool = False,
    of_run: str | Path | None = None,
    changes: Changes = (),
) -> Study:
    """Read a study from text.

    Parameters
    ----------
    text : str
        The study in YAML.
    file : str or Path
        Source of the text: its name in messages, its default name, and the folder of height files.
    stored : bool
        The text comes from a file of results, see `Study.stored`. Height files may be absent; such a study makes no
        cases.
    of_run : str or Path, optional
        The study.yaml of a run that has the text, in place of the file in messages. It has the keys of the version that
        wrote it.
    changes : mapping or sequence of str
        Other values of keys, as ``{"surface.m": 6}`` or ``"surface.m=6"``.

    Returns
    -------
    Study
        The frozen study.

    Raises
    ------
    StudyError
        With all problems of the text in its order.

    See Also
    --------
    roughvol.load : Reads a study file.

    Examples
    --------
    >>> from roughvol.study import loads
    >>> study = loads("surface: {D: [2.2, 2.5], m: 3, seeds: 2}", changes=["sweep.steps=5"])
    >>> len(study.cases()), study.sweep.steps
    (4, 5)
    """
    path = Path("study" if file in NO_FILES else file)
    shown, is_run = printable(str(of_run or file)), of_run is not None
    return _study(text, shown, path, stored=stored, of_run=is_run, changes=changes_of(changes))


def _study(
    text: str,
    file: str,
    path: Path,
    *,
    stored: bool = False,
    of_run: bool = False,
    changes: Sequence[str] = (),
    arguments: Arguments | None = None,
    problems: Mapping[KeyPath, str] | None = None,
) -> Study:
    reading = Reading()
    try:
        data = reading.read(text, plain_data.STORED_BYTES if stored or of_run else plain_data.MAX_BYTES)
    except UnreadableError as error:
        if arguments is not None:
            message = (problems or {}).get((), str(error))  # the data are no mapping
            raise refused(message, argument=arguments.of("")) from error
        raise refused(str(error), line=error.line, file=file) from error
    if of_run and changes:  # the study of a run names keys without a value, which exclude others
        data = plain_data.given(data)
    changed = [set_key(data, change) for change in changes]
    made = {path[:depth] for path in changed for depth in range(1, len(path))} - reading.marks.keys()
    places = Places(file, reading.marks, arguments, tuple(map(key_text, (*changed, *made))))
    problems = {**reading.problems, **(problems or {})}
    former = renamed(data, problems, changed, written=stored or of_run)
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", path.stem)[:100].lstrip("-") or "study"
    context = {"folder": path.parent, "stored": stored}
    context |= {UNSAID: {"sides": "free"}} if stored or of_run else {}  # versions without the key had free patches
    study = read_as(Study, {"name": name, **data}, problems, places, context)
    study._places = places
    warn((str(places.of(problem)) for problem in former), RoughvolDeprecation)
    return study


def set_key(data: dict[str, Any], change: str) -> KeyPath:
    """Set a key of plain data, as ``surface.m=6``, and return its path.

    ``null`` takes the key out: it has its default. An empty text stays a value, which may be an oversight.
    """
    keys, value = _key_and_value(change)
    try:
        held = plain_data.put(data, keys, value)
        section = tuple(key for key in keys[:-1] if isinstance(key, str))
        known = names(*models_of(Study).get(section, ()))
        if value is None and keys[-1] in known and not change.rstrip().endswith("="):
            del held[keys[-1]]
    except ValueError as error:
        raise refused(str(error), key_text(keys), file=CHANGES) from error
    return keys


def _key_and_value(change: str) -> tuple[KeyPath, Any]:
    """Return the key and the value of a text as ``surface.m=6``."""
    name, equals, text = change.partition("=")
    keys = plain_data.key_path(name)
    if not equals or not keys:
        raise refused(f"must be KEY=VALUE, as surface.m=6, given {show(change)}", file=CHANGES)
    reading = Reading()
    try:
        value = reading.read(f"value: {text.strip()}")["value"]
    except UnreadableError as error:
        raise refused(f"{text.strip()!r}: {error}", name.strip(), file=CHANGES) from error
    if wrong := reading.problems:
        raise StudyError([Problem(wrong[path], key_text((*keys, *path[1:])), file=CHANGES) for path in wrong])
    return keys, value
