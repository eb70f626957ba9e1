"""The run of a name, a folder, a study.nc or a study file, checked to hold the results of its study.

Every command that reads results opens them here. Two rules hold:

- The study of ``study.nc`` is that of ``study.yaml`` beside it. They differ after an interrupted extension, or where a
  ``study.nc`` of another run was copied into the folder.
- A study file opens the run of its name only if the run holds its results: equal keys (``name`` and ``comment`` may
  differ) and equal height files.
"""

from __future__ import annotations

import contextlib
import functools
import json
import shlex
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from roughvol import errors
from roughvol.errors import DatasetError, FolderError, Problem, StudyError, SurfaceError
from roughvol.store import run_folder, same_study, sample_plan
from roughvol.study import HeightFile, Study, changes_of, check_type, load, loads
from roughvol.study.plain_data import is_file

if TYPE_CHECKING:
    from xarray import Dataset

    from roughvol.study import Case
    from roughvol.study.axes import Label
    from roughvol.study.values.own import OwnQuantity
    from roughvol.typing import Changes

RUNS = Path("runs")
RESULTS = "study.nc"
STUDY_SUFFIXES = (".yaml", ".yml")
HEIGHTS = ("surface", "surface.file", "surface.files", "surface.against")  # keys of height files
DATASETS = (".nc", ".nc4", ".cdf", ".h5")


@dataclass(frozen=True, eq=False)
class StoredRun:
    """A run with results: its ``study.nc``, the loaded dataset, and what opened the run.

    ``given`` is the study of a study file. ``asked`` is the run as the user named it, with ``changes`` of its study.
    """

    file: Path
    dataset: Dataset = field(repr=False)
    given: Study | None = None
    asked: str = ""
    changes: tuple[str, ...] = ()

    @classmethod
    def open(cls, run: str | Path | None = None, changes: Sequence[str] = ()) -> StoredRun:
        """Open a run as `open` does, with the same errors; None is the latest run with results."""
        from roughvol.store.variants import whole

        file, results, given = _opened(run, changes)
        return cls(file, whole(results), given, "" if run is None else str(run), tuple(changes))

    @property
    def folder(self) -> Path:
        """Its folder."""
        return self.file.parent

    @property
    def pages(self) -> Path:
        """The folder of its figures and pages: its folder, for a part of its lists one inside with their values."""
        from roughvol.store.variants import part_words

        return self.folder / run_folder.slug(part_words(self.dataset) if self.has_study else "")

    @property
    def has_study(self) -> bool:
        """Whether its study can be run again; not that of a dataset saved with ``to_netcdf``, or in memory."""
        return self.file.name == RESULTS and self.file.exists()

    @property
    def study(self) -> Study:
        """Its study with the height files, which must be those of the results."""
        if self.given is not None:
            return self.given
        study, is_part = _of_results(self.dataset, study_of(self.folder, self.changes)[0])
        _check(self.file, self.dataset, study, str(self.folder), self.call, is_part=bool(is_part))
        return study

    @property
    def name(self) -> str:
        """Name of its folder; of a dataset not named ``study.nc``, that of the file without its suffix."""
        return _whole(self.file).name

    @property
    def call(self) -> str:
        """The words of a command that opens it: the run as the user named it, and the changes of its study."""
        return _call(self.asked or self.name, self.changes)


def open(run: str | Path | None = None, *, changes: Changes = ()) -> Dataset:
    """Return the results of a run, or a dataset that was saved with ``to_netcdf``.

    Parameters
    ----------
    run : path, optional
        The folder of a run, its ``study.nc``, a name under ``runs``, or a study file, whose results the run must hold.
        Default: the latest run with results.
    changes : mapping or sequence of str
        Other values of keys of the study, as ``{"surface.m": 6}``: the run holds their results.

    Returns
    -------
    Dataset
        The results, in memory.

    Raises
    ------
    DatasetError
        If there are no results, or they are damaged.
    FolderError
        If the results are of another study. The message has the keys that differ.
    StudyError
        If the study file has problems.

    See Also
    --------
    roughvol.run : Computes a study.

    Examples
    --------
    >>> import roughvol
    >>> study = {"name": "tiny", "surface": {"D": 2.5, "m": 3, "seeds": 2}, "sweep": {"steps": 2}}
    >>> ds = roughvol.run(study, jobs=1)
    >>> bool((roughvol.open("tiny")["free_volume"] == ds["free_volume"]).all())
    True
    """
    return _opened(run, changes_of(changes))[1]


def _opened(run: str | Path | None, changes: Sequence[str] = ()) -> tuple[Path, Dataset, Study | None]:
    """Return the file of the results of a run, the results, and the study that the run was opened by."""
    from roughvol.store import dataset  # xarray: a second
    from roughvol.store.variants import part_with

    check_type(run, (str, Path, type(None)), "a run is a name or a path")
    given: Study | None = None
    run = _latest() if run is None else run
    by_name = folder_of_run(run) is not None
    if is_study_file(run) or (changes and is_run(run)):
        given, folder = study_of(run, changes, stored=not gives_heights(changes))
        files = [folder / RESULTS]  # of another name, where it is changed
    else:
        files = [Path(run), *(folder / RESULTS for folder in _folders(run))]
    call = _call(str(run), changes)
    file = next((file for file in files if is_file(file)), None)
    if file is None:
        raise _no_results(str(run), files, "" if given is None else call)
    try:
        results = dataset.read(file, saved=file.name != RESULTS)
    except DatasetError as error:
        if file.name == RESULTS and is_file(file.with_name("study.yaml")):
            raise DatasetError(f"{error}; to make it anew: roughvol run {_word(file.parent)}") from error
        if file.suffix in DATASETS or not _is_map(file):
            raise
        words = f"{file}: a height map, no run: roughvol init {_word(file)} writes a study for it"
        raise DatasetError(words) from error
    if "case_id" in results.attrs:  # its Sq is that of the surface as generated, and its modulus that of another run
        words = "the file of one case, without the scale and the units of its study"
        raise DatasetError(f"{file}: {words}; allowed: its run, by folder, study.nc or name")
    labels: dict[str, list[Label]] = {}
    if given is not None:
        given, labels = _of_results(results, given)
    _check(file, results, given, str(run), call, is_part=bool(labels))
    if given is not None:
        _set_seal(results, given)
    return file, part_with(results, labels) if labels else results, None if by_name else given


def _of_results(results: Dataset, given: Study) -> tuple[Study, dict[str, list[Label]]]:
    """Return a study with the values of its lists as results spell them, and the labels of the part that it has."""
    from roughvol.store.variants import study_in

    stored = study_in(results)
    if stored is None or given.stored() == results.attrs["study"]:
        return given, {}
    given = same_study.spelled_as(given, stored)
    return given, same_study.part(given, stored)


def _call(run: str, changes: Sequence[str]) -> str:
    """Return a run and the changes of its study as words of a shell."""
    return shlex.join([run, *(word for change in changes for word in ("--set", change))])


def gives_heights(changes: Iterable[str]) -> bool:
    """Return whether changes of a study give other height files."""
    keys = (change.partition("=")[0].strip() for change in changes)
    return any(key in HEIGHTS or key.startswith("surface.against.") for key in keys)


def _set_seal(results: Dataset, given: Study) -> None:
    """Give results the seal of the study that they were opened by: no stored number depends on it."""
    stored = loads(str(results.attrs["study"]), stored=True)  # `_check` has compared it
    if stored.seal != given.seal:
        seal = None if given.seal is None else given.seal.model_dump(mode="json")
        results.attrs["study"] = stored.changed(seal=seal).stored()


def with_results() -> list[Path]:
    """Return the folders of runs that have results, by name."""
    return [file.parent for file in sorted(RUNS.glob(f"*/{RESULTS}"))]


def own_quantities() -> dict[str, OwnQuantity]:
    """Return the quantities of users in the studies of all runs; of equal names that of the latest run."""
    found: dict[str, OwnQuantity] = {}
    for file in _studies():
        text = run_folder.stored_study(file.parent) or ""
        if "own:" in text:  # not every study is read
            with contextlib.suppress(StudyError):
                found |= loads(text, stored=True).record.own or {}
    return found


def study_of(run: str | Path, changes: Sequence[str] = (), *, stored: bool = False) -> tuple[Study, Path]:
    """Return the study of a study file, or of a run by folder, ``study.nc`` or name, and the folder of its results.

    A run stores the names of height files alone: they lie in its folder, as heights that were in memory, or in the
    current folder. With ``stored`` they may be absent, and the study of the run makes no cases of them.
    """
    path = Path(run)
    if folder := folder_of_run(run):
        text = run_folder.stored_study(folder) or ""
        source, file = _beside_heights(text, folder), folder / "study.yaml"
        with errors.each_problem(functools.partial(_with_advice, file)):
            study = loads(text, source, stored=stored, of_run=file, changes=changes)
        renamed = any(change.partition("=")[0].strip() == "name" for change in changes)
        return study, run_folder.folder_of(study) if renamed else folder
    try:
        study = load(path, changes)
    except StudyError as error:
        if "\n" in str(path):  # a text
            raise
        whole = all(not problem.key for problem in error.problems)  # the file is no mapping
        if whole and path.suffix not in STUDY_SUFFIXES and is_file(path):
            reason = "; ".join(problem.message for problem in error.problems)
            words = "a height map, no study" if _is_map(path) else f"{reason}. If it is a height map"
            problem = Problem(f"{words}: roughvol init {_word(path)} writes a study for it", file=str(path))
            raise StudyError([problem]) from error
        if path.suffix not in STUDY_SUFFIXES and not is_file(path):
            looked_for = dict.fromkeys(map(str, (path, *(folder / "study.yaml" for folder in _folders(run)))))
            message = f"no study file and no run: looked for {', '.join(looked_for)}{_meant(run)}"
            raise StudyError([Problem(message)]) from error
        if not is_file(path):
            raise StudyError([replace(one, message=one.message + _meant(run)) for one in error.problems]) from error
        raise
    return study, run_folder.folder_of(study)


def _is_map(path: Path) -> bool:
    """Return whether a file is a height map."""
    from roughvol.surfaces.files import reading  # numpy: for a message alone

    try:
        reading.describe(path)
    except (DatasetError, SurfaceError):
        return False
    return True


def _with_advice(file: Path, problem: Problem) -> Problem:
    """Return a problem of the study.yaml of a run with what to do if a height file is absent."""
    absent = problem.key.startswith("surface.") and problem.message.startswith("no such file")
    if problem.file != str(file) or not absent:
        return problem
    where = "a run has the names of its height files alone: call in the folder they begin in, or give the study file"
    return replace(problem, message=f"{problem.message}; {where}")


def _beside_heights(text: str, folder: Path) -> Path:
    """Return the path that a stored study is read from: in the folder of its run if its height files are there."""
    name = f"{folder.name}.yaml"
    if "file" not in text:  # the key of heights: a study of ten thousand seeds is not read twice
        return Path(name)
    try:
        surface = loads(text, name, stored=True).surface
    except StudyError:
        return Path(name)
    files = [body.file for body in surface.bodies] if isinstance(surface, HeightFile) else []
    return folder / name if files and all(is_file(folder / file) for file in files) else Path(name)


def folder_of_run(run: str | Path) -> Path | None:
    """Return the folder of a run by folder, ``study.nc`` or name; None for the path of another file."""
    if is_file(Path(run)) and Path(run).name != RESULTS:
        return None
    return next((folder for folder in _folders(run) if is_file(folder / "study.yaml")), None)


def is_study_file(run: str | Path) -> bool:
    """Return whether a path is a study file, by its suffix."""
    return Path(run).suffix in STUDY_SUFFIXES and is_file(Path(run))


def is_run(run: str | Path) -> bool:
    """Return whether a text leads to a study file, to results, or to the folder of a run."""
    files = (folder / name for folder in _folders(run) for name in (RESULTS, "study.yaml"))
    return any(map(is_file, (Path(run), *files)))


def names_of(files: Sequence[Path]) -> list[str]:
    """Return the names of runs by their ``study.nc``; where two are equal, with the folders by which they differ."""
    paths = [_whole(file) for file in files]
    names = []
    for path in paths:
        parts = 1
        while sum(other.parts[-parts:] == path.parts[-parts:] for other in {*paths}) > 1 and parts < len(path.parts):
            parts += 1
        names.append("/".join(path.parts[-parts:]))
    return names


def check_once(command: str, parts: Sequence[tuple[Path, str]]) -> None:
    """Refuse a part of a run, by its file and its name, that a command takes twice."""
    if twice := next((name for file, name in parts if file.exists() and parts.count((file, name)) > 1), ""):
        raise DatasetError(f"{command} takes each run once, given {twice} twice")


def _whole(file: Path) -> Path:
    """Return the path of a run: the folder of a ``study.nc``, another dataset without its suffix."""
    return file.resolve().parent if file.name == RESULTS else file.resolve().with_suffix("")


def _folders(run: str | Path) -> Iterator[Path]:
    """Yield the folders that may be meant by a path or a name."""
    yield Path(run).parent if Path(run).name == RESULTS else Path(run)
    yield RUNS / run


def _studies() -> list[Path]:
    """Return the ``study.yaml`` of the runs with results, that of the latest run last."""
    # every run writes study.yaml, also without a case to compute
    studies = [folder / "study.yaml" for folder in with_results() if is_file(folder / "study.yaml")]
    return sorted(studies, key=lambda path: path.stat().st_mtime)


def _latest() -> Path:
    if not (studies := _studies()):
        message = "no finished run under runs/; start one with: roughvol run STUDY (roughvol init writes a study)"
        raise DatasetError(message)
    return studies[-1].with_name(RESULTS)


def _no_results(run: str, files: Sequence[Path], call: str) -> DatasetError:
    """Return the error for a run without results; ``call`` computes those of a study."""
    for folder in (file.parent for file in files if file.name == RESULTS):
        if is_file(folder / "study.yaml"):
            see = f"roughvol status {_word(folder)}"
            return DatasetError(f"{folder} has no {RESULTS}: its run has not ended; see: {see}")
    hint = f"; to compute them: roughvol run {call}" if call else _meant(run)
    return DatasetError(f"no results of {run!r}: looked for {', '.join(map(str, files))}{hint}")


def _meant(run: str | Path) -> str:
    """Return the question for the run under runs/, or the study file beside it, with the most similar name."""
    files = [path for suffix in STUDY_SUFFIXES for path in Path().glob(f"*{suffix}")]
    known = {name: path.name for path in files for name in (path.name, path.stem)}
    known |= {folder.name: folder.name for folder in with_results()}
    near = str(run) if str(run) in known else errors.nearest_word(str(run), known)
    return errors.question([known[near]] if near else [])


def _check(file: Path, results: Dataset, given: Study | None, run: str, call: str, *, is_part: bool = False) -> None:
    """Refuse results that are not those of the study file, or not those of their folder; ``call`` computes them.

    ``is_part``: the study file has some of the combinations of the results.
    """
    stored = str(results.attrs.get("study", ""))
    within = _of_another_folder(file, results, stored)
    if given is not None and (lines := _of_another_study(file, results, stored, given, is_part=is_part)):
        show = "" if within else f"; to see what the folder holds: roughvol show {_word(file.parent)}"
        cases = _cases(given, file.parent)
        another = same_study.another_study(file.parent, given, cases)
        beside = " --set name=OTHER, or --fresh, which replaces these results" if another else ""
        raise FolderError(
            f"{file} does not hold the results of {run} (stored → {run}):\n{_indented(lines)}\n"
            f"to compute them: roughvol run {call}{beside}{show}"
        )
    if within:
        raise FolderError(
            f"{file} does not hold the results of the study.yaml beside it (stored → study.yaml):\n"
            f"{_indented(within)}\n"
            f"an interrupted run goes on with: roughvol run STUDY; a {RESULTS} of another run opens in its own folder"
        )


def _of_another_study(file: Path, results: Dataset, stored: str, given: Study, *, is_part: bool) -> list[str]:
    """Return how the study and the height files of results differ from those of a study; a line each."""
    if not is_part and (lines := _changes(file, stored, given.stored())):
        return lines
    if not (cases := _cases(given, file.parent)):
        return []
    return _changed_heights(results, cases.values()) or _of_other_cases(results, cases)


def _cases(study: Study, folder: Path) -> dict[str, Case]:
    """Return the cases of a study; none of height files by name, whose heights are those of the results."""
    named = isinstance(study.surface, HeightFile) and not Path(study.surface.file).is_absolute()
    return {} if named else sample_plan.cases_of(study, folder)


def _changed_heights(results: Dataset, cases: Iterable[Case], absent: Sequence[str] = ("absent",)) -> list[str]:
    """Return the height files whose content is not that of results; a line each."""
    then = {(body["file"], body["sha256"]) for body in json.loads(results.attrs.get("height_files", "[]"))}
    now = {(body.file.name, body.sha256) for case in cases for body in case.bodies}
    return [
        f"surface.file: the content of {name} has changed (sha256 {old[:8]} → {new[:8]})"
        for name, old in sorted(then - now)
        for new in sorted(digest for other, digest in now if other == name)[:1] or absent
    ]


def check_heights(study: Study, run: str | Path) -> None:
    """Refuse the study of a run if the content of its height files has changed; a study file may have any heights."""
    folder = next((folder for folder in _folders(run) if is_file(folder / RESULTS)), None)
    if folder is None or is_study_file(run) or not isinstance(study.surface, HeightFile):
        return
    from roughvol.store import dataset

    try:
        results = dataset.read(folder / RESULTS)
    except DatasetError:  # damaged results are made again
        return
    if lines := _changed_heights(results, study.cases(), absent=()):
        message = f"{folder} is a run of other heights:\n{_indented(lines)}\ngo to the folder of its heights"
        raise FolderError(f"{message}, or give a study file of these")


def _of_another_folder(file: Path, results: Dataset, stored: str) -> list[str]:
    """Return how results differ from the study.yaml and the cases beside them; a line each."""
    text = run_folder.stored_study(file.parent) if file.name == RESULTS else None
    if text is None:
        return []
    return _changes(file, stored, text) or _of_other_cases(results, run_folder.stored_ids(file.parent))


def _changes(file: Path, stored: str, text: str) -> list[str]:
    """Return the keys that differ between the study of results and another study, both as stored; a line each."""
    if text == stored:
        return []
    try:
        old, new = (loads(one, file.with_name("study.yaml"), stored=True) for one in (stored, text))
    except StudyError as error:
        return [f"one of both studies cannot be read by this version: {error}"]
    return same_study.changed_keys(old, new)


def _of_other_cases(results: Dataset, ids: Collection[str]) -> list[str]:
    """Return a line if results and a study or folder of equal keys share no case."""
    held = json.loads(results.attrs.get("case_ids", "[]"))
    if not held or not ids or not set(held).isdisjoint(ids):
        return []
    return [f"cases: {held[0]} → {min(ids)}, of other heights or of a version with other answers"]


def _word(path: Path) -> str:
    """Return a path as a word of a shell."""
    return shlex.quote(str(path))


def _indented(lines: Sequence[str]) -> str:
    return "\n".join(f"  {line}" for line in lines)
