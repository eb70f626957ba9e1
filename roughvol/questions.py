"""The questions of the command line, as functions that return their answers as data.

A question opens a run and joins rooms that do not know each other: a card computes with `campaign`, and its error is
that of `analysis`. So this module is above the rooms, beside `plotting`, and below `cli`, which prints the answers.
The rooms that compute, analyse and draw have dotted names here, as `analysis.read_off`. A module of theirs is imported
on its first use: `roughvol ask` needs no solver.

==========  ============================================================================
`run`       a run by name or path, a `StoredRun`, or a dataset; None is the latest run
`study`     a study file, a run by name or path, a mapping with the keys of a file, or a `Study`
`at`        a load as ``"pressure=0.5 MPa, leg 2"`` or ``{"pressure": "0.5 MPa", "leg": 2}``
`changes`   other values of keys of the study file, as ``{"surface.m": 6}`` or ``"surface.m=6"``
`jobs`      number of processes; None for all cores
`plain()`   the content of ``--json``
==========  ============================================================================

A number with a unit is text or a quantity of pint. A name without a run is a `DatasetError`, a folder of another study
is a `FolderError`, and a study that cannot be used is a `StudyError`. Functions name further errors alone.
"""

from __future__ import annotations

import difflib
import itertools
import json
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from roughvol import analysis, campaign, report, store
from roughvol.errors import DatasetError, FolderError, Problem, StudyError, question
from roughvol.observables.variables import MEAN_ENDS, QUANTITIES, Variable, columns_of, named_by, with_means
from roughvol.store import Status, StoredRun, folder_of, run_status
from roughvol.store import run as stored_run
from roughvol.store.record_key import record_key
from roughvol.store.run_folder import slug, slugs
from roughvol.study import Fluid, Study, changes_of, check_type, level, levels, refused
from roughvol.study.reference import Key, keys
from roughvol.study.sections.fluid import SUBSTANCES
from roughvol.study.values.own import OwnQuantity, offered

if TYPE_CHECKING:
    from roughvol.analysis.creep import History
    from roughvol.analysis.leak_card import Card
    from roughvol.analysis.read_off import Answer, Errors
    from roughvol.campaign.cost import Estimate
    from roughvol.ensemble.prediction import Expected
    from roughvol.report.card_page import Page
    from roughvol.report.page import Report
    from roughvol.report.screen import Compared, Records
    from roughvol.reproduction.judgement import Judgement
    from roughvol.store.card_runs import CardRuns
    from roughvol.store.dataset import Dataset
    from roughvol.store.run_status import Listed
    from roughvol.surfaces.surface import Surface
    from roughvol.typing import Changes, Load, Loads, Number


def opened(run: Dataset | StoredRun | str | Path | None, changes: Changes = ()) -> StoredRun:
    """Return the run of a name, a path or a dataset in memory; None is the latest run."""
    if run is None or isinstance(run, str | Path):
        return StoredRun.open(run, changes_of(changes))
    check_type(run, (store.dataset.Dataset, StoredRun), "a run is a name, a path or a dataset")
    if changes_of(changes):
        raise DatasetError("changes are of a run by name or path; allowed for a dataset: labels, as ds.sel(E=5.0)")
    if isinstance(run, StoredRun):
        return run
    from roughvol.report.figures import origin

    name = origin.run_name(run) or "dataset"
    return StoredRun(Path(f"{name}.nc"), analysis.Run.of(name, store.variants.whole(run)).dataset)


def _each_opened(runs: Iterable[Dataset | StoredRun | str | Path], changes: Changes) -> list[StoredRun]:
    """Return several runs."""
    check_type(runs, Iterable, "runs are a list of names, paths and datasets", but=(str, bytes, Mapping))
    return [opened(run, changes) for run in runs]


def study_of(
    study: Study | Mapping[str, Any] | str | Path, changes: Changes = (), *, of_run: bool = False
) -> tuple[Study, Path]:
    """Return a study, of a mapping, a study file or a run, and the folder of its results.

    ``of_run``: the height files of a run must be those of its results.
    """
    from roughvol.study import Arguments, changed, of_data

    texts = changes_of(changes)
    if isinstance(study, str | Path):
        found, folder = stored_run.study_of(study, texts)
        if of_run and not stored_run.gives_heights(texts):
            stored_run.check_heights(found, study)
        return found, folder
    if isinstance(study, Mapping):
        _refuse_heights(study)
        whole = of_data(study, Arguments("", {"": "study"}), texts)
    else:
        whole = changed(study, texts)
    return whole, folder_of(whole)


def _refuse_heights(study: Mapping[str, Any]) -> None:
    """Refuse heights in memory, which the folder of a run keeps."""
    surface = study.get("surface")
    if isinstance(surface, Mapping) and "heights" in surface:
        name = study.get("name", "NAME")
        message = f"heights in memory are taken by roughvol.run, which keeps them; then give the run, as {name!r}"
        raise StudyError([Problem(message, argument='study["surface"]["heights"]')])


@dataclass(frozen=True, eq=False)
class ReadOff:
    """Read-offs of a stored sweep."""

    run: StoredRun
    leak_rate: str  # largest leak with its unit; empty for a closed joint
    unknown: str  # quantity found: pressure, modulus or Sq
    pressure: float | None  # nominal pressure of a modulus or an Sq, in the unit of the study
    answers: tuple[Answer, ...]  # along x and y
    narrower: tuple[str, ...]  # changes of the study that solve states around the answers

    def command(self) -> str:
        """Return the command that narrows the interval, empty without one, and of a dataset that no stored run has."""
        stored = self.run.has_study or (not self.run.file.exists() and stored_run.is_run(self.run.name))
        if not self.narrower or not stored:
            return ""
        changes = shlex.join(word for change in self.narrower for word in ("--set", change))
        return f"roughvol run {self.run.call} {changes}"

    def plain(self) -> dict[str, Any]:
        """Return the read-offs as ``ask --json`` prints them."""
        return {
            "run": self.run.name,
            "leak_rate": self.leak_rate or None,
            "at": None if self.pressure is None else f"pressure={self.pressure:.9g} {self.answers[0].load_unit}",
            "leg": 1,
            "answers": [analysis.read_off.record(answer, self.unknown) for answer in self.answers],
            "narrower": self.command() or None,
        }


def ask(
    run: Dataset | str | Path | None = None,
    *,
    leak_rate: Number | None = None,
    unknown: Literal["pressure", "modulus", "Sq"] = "pressure",
    at: Load | None = None,
    budget: bool = False,
    jobs: int | None = None,
    changes: Changes = (),
) -> ReadOff:
    """Return where the leak of a run falls to a value, or where its last way closes: `roughvol ask`.

    The answer is read off the stored sweep: numbers depend on E* and Sq through p* alone. Of several surfaces the
    leakiest decides. Nothing is solved, but for the budget of the error.

    Parameters
    ----------
    run : Dataset, StoredRun, path or name
        A run.
    leak_rate : str or Quantity, optional
        Largest leak with its unit, as ``"1e-6 mm^3/s"``. Default: no open way.
    unknown : {"pressure", "modulus", "Sq"}
        Quantity to find.
    at : str or mapping, optional
        Load of a modulus or an Sq, as ``"pressure=0.05 MPa"``.
    budget : bool
        Whether the runs of a leak card at the answers are computed. The interval has their errors.
    jobs, changes : int, mapping or sequence of str
        Processes, and changes of the study of the run.

    Returns
    -------
    ReadOff
        ``answers`` along x and y, with ``value``, ``low``, ``high`` and ``unit``.

    Raises
    ------
    StudyError
        If the run has no leak rates, or several D, m or values of a list. If it yields, for a modulus or an Sq.

    See Also
    --------
    roughvol.card : Returns the leak at one load with its error.
    roughvol.creep : Returns the leak over time.

    Examples
    --------
    >>> import roughvol
    >>> study = {"name": "patch", "surface": {"D": 2.3, "m": 4, "seeds": 1}, "sweep": {"steps": 8}}
    >>> ds = roughvol.run(study | {"record": {"transport": {"percolation": "every-step"}}}, jobs=1)
    >>> along_x, along_y = roughvol.ask(ds).answers
    >>> along_x.low < along_x.value == along_x.high
    True
    """
    from roughvol.study import text_of_value

    found = opened(run, changes)
    wanted = "" if leak_rate is None else str(text_of_value(leak_rate, "leak_rate")).lstrip("<= ")
    results, kelvin = store.variants.of_one_combination(found.dataset), None
    if leak_rate is not None:
        results, kelvin = analysis.read_off.leaking(results, unknown, wanted)
    results = analysis.read_off.checked(results, leaks=leak_rate is not None)
    load = None if at is None else analysis.read_off.nominal_of(results, level(at))
    if at is not None and unknown == "pressure":
        raise refused(f"the pressure is asked for; the load {level(at).label} belongs to: for modulus or Sq")
    largest = None
    if leak_rate is not None:
        of_gas = str(results["gas_leak_rate"].attrs["units"]) if "gas_leak_rate" in results else ""
        largest, wanted = _leak(wanted, str(results["leak_rate"].attrs["units"]), kelvin, of_gas)
    answered = partial(analysis.read_off.ask, results, largest, unknown, pressure=load)
    answers = answered()
    whole, parts = store.variants.study_in(found.dataset), store.variants.parts_of(found.dataset)
    # a study of several combinations would not answer for one, which the changes of a run may choose
    single = whole is None or len(whole.variants) == 1 or (found.has_study and len(parts) == 1)
    narrower = analysis.read_off.narrower(results, answers, closed=leak_rate is None) if single else []
    if budget:
        answers = answered(errors=_errors(found, answers, jobs, closed=leak_rate is None))
    return ReadOff(found, wanted, unknown, load, tuple(answers), tuple(narrower))


def _errors(run: StoredRun, answers: Sequence[Answer], jobs: int | None, *, closed: bool) -> dict[str, Errors]:
    """Return the errors of leak cards at the loads of answers, by axis."""
    loads = {
        answer.axis: "last"
        if closed or answer.nominal.closing
        else f"pressure={answer.nominal.value:.4g} {answer.load_unit}"
        for answer in answers
        if closed or answer.found
    }
    return {axis: analysis.read_off.errors_of(_card_at(run, load, jobs), axis) for axis, load in loads.items()}


def _card_at(run: StoredRun, load: str, jobs: int | None) -> Card:
    """Return the leak card of a run at a load of leg 1."""
    if not run.has_study:
        raise refused("the budget of the error takes runs of the study; allowed: a study file, or the name of a run")
    leg = ", leg 1" if analysis.read_off.path_words(run.dataset) else ""
    folder = run.folder.with_name(f"{run.name}_card") / run.pages.relative_to(run.folder)
    try:
        return card(run.study, f"{load}{leg}", out=folder, jobs=jobs).cards[""]
    except FolderError as error:
        differences = str(error).rpartition("\n")[0]  # without the options of a card
        if not differences:  # in use
            raise
        raise FolderError(f"{differences}\nto compute the budget anew, move {folder} away") from error


def _leak(text: str, unit: str, kelvin: float | None, of_gas: str) -> tuple[float, str]:
    """Return a leak in the unit of a run, and its text with a unit.

    ``kelvin`` is the temperature of a gas whose leak it is, ``of_gas`` the unit of the leak of the gas of the run.
    """
    from roughvol.study import convert, read, throughput
    from roughvol.study.values.units import unit_of

    try:
        value = read(text, "flow" if kelvin is None else "throughput")
        number, own = float(value), unit_of(value)
        largest = (
            convert(number, own or unit, unit) if kelvin is None else throughput(number, own or unit, unit, kelvin)
        )
        return float(largest), text if own else f"{text} {unit}"
    except (ValueError, StudyError) as error:
        either = f", or of the gas as in {of_gas}" if of_gas and kelvin is None else ""
        message = f"the leak rate is {text!r}; allowed: a number with its unit, as in {unit}{either} ({error})"
        raise refused(message) from error


def creep(
    run: Dataset | StoredRun | str | Path | None,
    law: str | Path | Mapping[str, Any],
    *,
    at: Load,
    times: str | Sequence[Number],
    budget: bool = False,
    jobs: int | None = None,
    changes: Changes = (),
) -> History:
    """Return the leak of a run over time, for a material that creeps under constant load: `roughvol creep`.

    The modulus of the study is that at once. States at later times are read off the stored sweep (Lee and Radok 1960).

    Parameters
    ----------
    run : Dataset, StoredRun, path or name
        A run.
    law : mapping or path
        The creep law J(t)/J(0), as ``{"power": {"exponent": 0.1, "time": "1 s"}}``, or a YAML file of it.
    at : str or mapping
        The constant load, as ``"pressure=0.1 MPa"``.
    times : str, sequence or Quantity
        Times under load with units, as ``"1 s..30 day"`` or ``["1 min", "1 h"]``; without a unit seconds.
    budget : bool
        Whether the runs of leak cards at up to four of the states are computed. The intervals have their errors.
    jobs, changes : int, mapping or sequence of str
        Processes, and changes of the study of the run.

    Returns
    -------
    History
        Arrays over the times: ``seconds``, ``area``, and ``leak["x"].value`` with its intervals.

    Raises
    ------
    StudyError
        If the run has no leak rates or yields, or if a time needs states beyond the sweep.

    See Also
    --------
    roughvol.ask : Returns the pressure of a leak.

    Examples
    --------
    >>> import roughvol
    >>> leak = {"pressure_drop": "5 mbar", "viscosity": "1 mPa*s"}
    >>> study = {
    ...     "name": "seal",
    ...     "surface": {"D": 2.3, "m": 4, "seeds": 1, "L": "100 um", "Sq": "1 um"},
    ...     "material": {"E_star": "10 MPa"},
    ...     "sweep": {"steps": 8, "to": {"pressure": "0.5 MPa"}},
    ...     "record": {
    ...         "transport": {"transmissivity": "every-step"},
    ...         "dimensional": {"pressure": "MPa", "leak_rate": leak},
    ...     },
    ... }
    >>> ds = roughvol.run(study, jobs=1)
    >>> law = {"power": {"exponent": 0.1, "time": "1 s"}}
    >>> history = roughvol.creep(ds, law, at="pressure=0.2 MPa", times=["1 s", "1 min"])
    >>> history.ratio.round(2).tolist()  # J(t)/J(0)
    [2.0, 2.51]
    """
    from roughvol.study import load_creep, read_times

    found = opened(run, changes)
    results, _ = analysis.read_off.leaking(store.variants.of_one_combination(found.dataset), "modulus")
    results = analysis.read_off.checked(results)
    load = analysis.read_off.nominal_of(results, level(at))
    history = analysis.creep.history(results, load_creep(law), load, read_times(times))
    if not budget:
        return history
    loads = analysis.creep.loads_of_cards(history)
    cards = {load: _card_at(found, f"pressure={load:.5g} {history.pressure_unit}", jobs) for load in loads}
    return analysis.creep.with_errors(history, cards)


@dataclass(frozen=True, eq=False)
class Cards:
    """The leak cards of a study.

    The runs behind the cards are named by load and by combination of the lists of the study, then by height file. A
    study without lists has the combination ``""``, generated surfaces have the file ``""``.
    """

    study: Study
    asked: str  # name or path of the study
    changes: tuple[str, ...]
    folder: Path  # of the runs, and of the pages
    runs: Mapping[tuple[str, str], Mapping[str, CardRuns]] = field(repr=False)
    notice: str = ""  # a default that changed since an older version, where a run was computed with it

    @property
    def varied(self) -> tuple[str, ...]:
        """Changes of the study, but for its name."""
        return tuple(change for change in self.changes if not change.startswith("name="))

    @cached_property
    def loads(self) -> tuple[str, ...]:
        """The loads in words."""
        return tuple(dict.fromkeys(load for load, _ in self.runs))

    @cached_property
    def cards(self) -> dict[str, Card]:
        """The card of each combination; of several loads, the load is behind the combination."""
        found = {}
        for (load, words), runs in self.runs.items():
            key = ", ".join(filter(None, (words, load if len(self.loads) > 1 else "")))
            found[key] = analysis.card_of(list(runs.values()), self.study.name, load)
        return found

    def plain(self) -> dict[str, Any]:
        """Return the cards as ``card --json`` prints them."""
        data = {words: card.plain() for words, card in self.cards.items()}
        return data if self.study.axes or len(self.loads) > 1 else data[""]

    @cached_property
    def pages(self) -> list[Page]:
        """A page of each load and combination; of several height files, one together, and one of each at the load."""
        pages, changed = [], [word for change in self.changes for word in ("--set", change)]
        for ((load, words), runs), whole in zip(self.runs.items(), self.cards.values(), strict=True):
            command = shlex.join(["roughvol", "card", self.asked, "--at", load, *changed])
            several, names = len(runs) > 1, slugs(runs)
            reached = {name: one for name, one in runs.items() if several and analysis.leak_budget.is_reached(one.fine)}
            single = {name: analysis.card_of([one], "", load) for name, one in reached.items()}
            for name, shown in ({"": whole} | single).items():
                title = ", ".join(filter(None, (self.study.name, *self.varied, words, name)))
                before = map(slug, ("card", load, *self.varied, words))
                stem = "_".join(filter(None, (*before, names.get(name, ""))))
                fields = tuple(one.fine.dataset for key, one in runs.items() if name in ("", key))
                pages.append(report.card_page.Page(replace(shown, title=title), fields, self.study, command, stem))
        return pages

    def write(self) -> list[Path]:
        """Write the pages as HTML and PDF beside the runs, several with a table; return the paths of the HTML."""
        paths = [report.card_page.write(page, self.folder) for page in self.pages]
        if len(paths) > 1:
            stem = "_".join(map(slug, ("cards", *self.loads, *self.varied)))
            paths.append(report.card_page.write_table(self.pages, stem, self.study.name, self.folder))
        return paths


def card(
    study: Study | Mapping[str, Any] | str | Path,
    at: Loads = "last",
    *,
    out: str | Path | None = None,
    jobs: int | None = None,
    fresh: bool = False,
    changes: Changes = (),
) -> Cards:
    """Return the leak along x and y at a load with its error, and where the ways close: `roughvol card`.

    Coarser grids and another levelling are computed for the error; finished runs are read.

    Parameters
    ----------
    study : Study, mapping, path or name
        A study.
    at : str or mapping, or sequence of them
        The load, as ``"pressure=0.5 MPa, leg 2"`` or ``{"pressure": "0.5 MPa"}``, or several. Default: the end of the
        sweep.
    out : path, optional
        Folder of the runs. Default: ``runs/<name of the study>_card``.
    jobs : int, optional
        Processes.
    fresh : bool
        Compute the runs anew, also in folders of another study or version.
    changes : mapping or sequence of str
        Changes of the study, which run in a folder of their own.

    Returns
    -------
    Cards
        ``cards[""]`` of a study without lists at one load. ``write()`` writes the pages.

    Raises
    ------
    StudyError
        If the study has several D or m, an ensemble, or no sweep.
    DatasetError
        If no surface is pressed to the load.

    See Also
    --------
    roughvol.ask : Returns the pressure of a leak.

    Examples
    --------
    >>> import roughvol
    >>> study = {"name": "pressed", "surface": {"D": 2.3, "m": 4, "seeds": 1}, "sweep": {"steps": 4}}
    >>> found = roughvol.card(study, at="pressure=0.2", jobs=1).plain()
    >>> round(found["load"]["mean_pressure"], 3), [way["axis"] for way in found["ways"]]
    (0.2, ['x', 'y'])
    """
    done: list[int] = []  # numbers of cases computed now
    (asked, _), texts = study_of(study, changes, of_run=not fresh), changes_of(changes)
    campaign.checks.check_surfaces(asked)  # of all files together
    folder = folder_of(asked, Path("runs") / f"{asked.name}_card" if out is None else out)
    found: dict[tuple[str, str], dict[str, CardRuns]] = {}
    cards = Cards(asked, str(study) if isinstance(study, str | Path) else asked.name, texts, folder, found)
    loads = levels(at)
    for load, variant in itertools.product(loads, asked.variants):
        surfaces = campaign.card.surfaces_of(variant.study)
        names = slugs(surfaces)
        accept = analysis.leak_budget.check_reached if len(surfaces) == 1 else lambda fine: None
        inside = folder.joinpath("runs", *map(slug, (*cards.varied, variant.words)))
        together = campaign.card.loads_together(load, loads)
        options: dict[str, Any] = {"jobs": jobs, "accept": accept, "together": together}
        options["fresh"] = fresh and load == together[0]  # the runs of the others are the same
        options["on_event"] = lambda now: done.append(now.done)
        found[load.label, variant.words] = {
            name: campaign.card.compute(one, load, inside / names[name], **options) for name, one in surfaces.items()
        }
    return replace(cards, notice=campaign.interpretation.default_sides(asked) if any(done) else "")


def show(run: Dataset | StoredRun | str | Path | None = None, at: Loads = (), *, changes: Changes = ()) -> Records:
    """Return the numbers of every surface of a run as rows, at all steps or at loads: `roughvol show`.

    Parameters
    ----------
    run : Dataset, StoredRun, path or name
        A run.
    at : str or mapping, or sequence of them
        Loads, as ``"pressure=0.5 MPa"`` or ``{"pressure": "0.5 MPa"}``. Default: all steps.
    changes : mapping or sequence of str
        Changes of the study of the run.

    Returns
    -------
    Records
        ``names``, ``rows`` and ``units``; ``frame()`` is a DataFrame of pandas. Combinations of lists and surfaces
        that do not reach a load have no row there; a `RoughvolWarning` has their names or their number.

    Raises
    ------
    DatasetError
        If nothing was pressed, or no surface reaches a load.

    See Also
    --------
    roughvol.compare : Returns the numbers of several runs at equal loads.
    roughvol.analysis.accessor.Accessor.at : Returns the numbers at a load as a dataset.

    Examples
    --------
    >>> import roughvol
    >>> study = {"name": "shown", "surface": {"D": 2.5, "m": 3, "seeds": 2}, "sweep": {"steps": 4}}
    >>> _ = roughvol.run(study, jobs=1)
    >>> frame = roughvol.show("shown", {"contact_area": [0.1, 0.15]}).frame()
    >>> frame[["seed", "state", "contact_area_fraction"]].round(6).values.tolist()
    [[0, 'contact_area=0.1', 0.1], [1, 'contact_area=0.1', 0.1], [0, 'contact_area=0.15', 0.15],
     [1, 'contact_area=0.15', 0.15]]
    """
    found = opened(run, changes)
    return report.screen.records(analysis.Run.of(found.name, found.dataset), levels(at))


def compare(
    runs: Sequence[Dataset | StoredRun | str | Path] | Mapping[str, Dataset | StoredRun | str | Path],
    at: Loads = (),
    *,
    changes: Changes = (),
) -> Compared:
    """Return the numbers of several runs at equal loads: `roughvol compare`.

    Parameters
    ----------
    runs : sequence of Dataset, StoredRun, path or name, or mapping of labels to them
        Two runs or more; a run with lists counts as its combinations. Labels name the rows, in place of names.
    at : str or mapping, or sequence of them
        Loads, as ``"pressure=0.5 MPa"`` or ``{"pressure": "0.5 MPa"}``. Default: pressures that all runs reach.
    changes : mapping or sequence of str
        Changes of the studies of the runs.

    Returns
    -------
    Compared
        ``records()`` are names, rows and units of the numbers, ``records().frame()`` is a DataFrame of pandas, and
        ``table()`` is their text.

    Raises
    ------
    DatasetError
        If there are fewer than two runs, or no load is common to all.

    See Also
    --------
    roughvol.show : Returns the numbers of one run.

    Examples
    --------
    >>> import roughvol
    >>> study = {"name": "D", "surface": {"D": 2.2, "m": 3, "seeds": 2}, "sweep": {"steps": 4}}
    >>> runs = [roughvol.run(study, jobs=1, out=f"runs/{k}") for k in range(2)]
    >>> names, rows, units = roughvol.compare(runs, ["contact_area=0.1"]).records()
    >>> rows[0][names.index("free_volume")] == rows[1][names.index("free_volume")]
    True
    """
    labels = list[str]()
    if isinstance(runs, Mapping) and not hasattr(runs, "attrs"):  # a dataset is a mapping with attributes
        labels, runs = list(map(str, runs)), list(runs.values())
    each = _each_opened(runs, changes)
    files = [run.file for run in each]
    names = labels or stored_run.names_of(files)
    stored = [analysis.Run.of(name, run.dataset) for name, run in zip(names, each, strict=True)]
    parts = [(file, part.name) for file, run in zip(files, stored, strict=True) for part in run.parts]
    if len(parts) < 2:
        raise DatasetError("compare takes two runs or more; one is shown by: roughvol show RUN")
    stored_run.check_once("compare", parts)
    return report.screen.compared(stored, levels(at))


@dataclass(frozen=True, eq=False)
class Reported:
    """A report on runs."""

    judgement: Judgement = field(repr=False)  # claims of the paper and the literature, answered from the runs
    report: Report = field(repr=False)  # the page: a section for each run, claims, figures
    runs: tuple[StoredRun, ...]
    refused: tuple[str, ...] = ()  # why other runs are left out

    def plain(self) -> dict[str, Any]:
        """Return numbers and provenance, the content of claims.json."""
        data: dict[str, Any] = json.loads(report.page.to_json(self.report))
        return data

    def write(self, folder: str | Path | None = None) -> Path:
        """Write report.html, report.md and claims.json into a folder; default: that of one run, or runs/report."""
        own = self.runs[0].pages if len(self.runs) == 1 else Path("runs/report")
        return report.page.write(self.report, Path(folder or own))


def report_on(runs: Sequence[str | Path] = (), *, changes: Changes = ()) -> Reported:
    """Return the facts of runs and the claims of the paper that they answer: `roughvol report`.

    The name `roughvol.report` is that of a package.

    Parameters
    ----------
    runs, changes : sequence of path or name, mapping or sequence of str
        Runs, and changes of their studies. Default: all under ``runs`` that hold the results of their study.

    Returns
    -------
    Reported
        ``judgement`` of the claims, and the ``report``; ``write()`` writes the page.

    Raises
    ------
    DatasetError
        If there is no run.

    See Also
    --------
    roughvol.compare : Returns the numbers of runs at equal loads.

    Examples
    --------
    >>> import roughvol
    >>> study = {"name": "tiny", "surface": {"D": 2.5, "m": 3, "seeds": 2}, "sweep": {"steps": 2}}
    >>> _ = roughvol.run(study, jobs=1)
    >>> [(run["name"], run["states"]) for run in roughvol.report_on(["tiny"]).plain()["runs"]]
    [('tiny', 4)]
    """
    from roughvol.reproduction.judgement import judge
    from roughvol.reproduction.sections import report_of

    found, refused, texts = _each_opened(runs, changes), [], changes_of(changes)
    for folder in () if found else stored_run.with_results():
        try:
            found.append(StoredRun.open(folder, texts))
        except (DatasetError, StudyError) as error:
            refused.append(f"{folder}: {error}" if isinstance(error, StudyError) else str(error))
    judgement = judge(found or [StoredRun.open(None, texts)])
    return Reported(judgement, report_of(judgement), tuple(found), tuple(refused))


@dataclass(frozen=True, eq=False)
class Checked:
    """A study with its first surface and its cost."""

    study: Study
    folder: Path  # of the results
    surface: Surface | None  # of the first case; None for a generated surface of more than 2^20 nodes
    estimate: Estimate  # cases, memory, disk and time
    expected: tuple[Expected, ...]  # samples and time of an ensemble by D; empty without an ensemble
    warnings: tuple[str, ...]  # limits of the model that the study will exceed, and doubtful input

    def plain(self) -> dict[str, Any]:
        """Return the study and its cost as ``check --json`` prints them."""
        surface = None
        if (made := self.surface) is not None:
            surface = {"nodes": list(made.shape), "side": made.side, "spacing": made.spacing, "Sq": made.Sq}
            surface["unit"] = self.study.cases()[0].length_unit
        return {
            "study": self.study.model_dump(mode="json"),
            "surface": surface,
            "cost": asdict(self.estimate) | {"expected": [asdict(row) for row in self.expected]},
            "units": {"memory": "byte", "disk": "byte", "seconds": "s"},
            "warnings": list(self.warnings),
        }


def check(study: Study | Mapping[str, Any] | str | Path, *, jobs: int | None = None, changes: Changes = ()) -> Checked:
    """Return the first surface of a study, its cost, and doubts; nothing is stored: `roughvol check`.

    Of an ensemble, small surfaces are solved for the cost.

    Parameters
    ----------
    study, jobs, changes : Study, mapping, path or name; int; mapping or sequence of str
        A study, processes, and changes of the study.

    Returns
    -------
    Checked
        ``surface``, ``estimate`` and ``warnings``.

    Raises
    ------
    SurfaceError
        If the heights cannot be used.

    See Also
    --------
    roughvol.run : Computes the study.

    Examples
    --------
    >>> import roughvol
    >>> found = roughvol.check({"name": "three", "surface": {"D": 2.5, "m": 4, "seeds": 3}}, jobs=1)
    >>> found.estimate.cases, found.surface.shape
    (3, (17, 17))
    """
    loaded, folder = study_of(study, changes, of_run=True)
    surface = campaign.interpretation.shown(loaded, campaign.checks.check_surfaces(loaded))
    estimate, cases, rows = campaign.cost.estimate(loaded, jobs), loaded.cases(), []
    if loaded.ensemble is not None:
        rows = campaign.rounds.expected(loaded)
    is_read = cases[0].file is not None and not rows
    notes = campaign.interpretation.notes(cases, surface) if surface is not None and is_read else ()
    doubts = (*notes, *campaign.interpretation.doubts(loaded, surface))
    warnings = list(campaign.validity.sentences(campaign.validity.foreseen(loaded, surface), doubts))
    if not rows and estimate.warning:
        warnings.append(estimate.warning)
    return Checked(loaded, folder, surface, estimate, tuple(rows), tuple(warnings))


def status(study: Study | Mapping[str, Any] | str | Path, *, changes: Changes = ()) -> Status:
    """Return the finished, running, failed and missing cases of a study, also during a run: `roughvol status`.

    Parameters
    ----------
    study, changes : Study, mapping, path or name, and mapping or sequence of str
        A study, and changes of it.

    Returns
    -------
    Status
        Ids of the cases by their state.

    See Also
    --------
    roughvol.runs : Returns the state of all runs.

    Examples
    --------
    >>> import roughvol
    >>> study = {"name": "tiny", "surface": {"D": 2.5, "m": 3, "seeds": 2}, "sweep": {"steps": 2}}
    >>> _ = roughvol.run(study, jobs=1)
    >>> len(roughvol.status("tiny").done)
    2
    """
    try:
        whole, folder = study_of(study, changes)
    except StudyError:  # its height files may be gone: a finished run does not need them
        kept = stored_run.folder_of_run(study) if isinstance(study, str | Path) and not changes else None
        if kept is None or (found := run_status.of_results(kept)) is None:
            raise
        return found
    return run_status.status(whole, folder)


def runs(folder: str | Path = "runs") -> list[Listed]:
    """Return all runs in a folder, the latest first: `roughvol ls`.

    Parameters
    ----------
    folder : path
        Folder that holds the folders of runs.

    Returns
    -------
    list of Listed
        ``name``, ``state``, ``size`` in bytes and ``age`` in seconds.

    Raises
    ------
    DatasetError
        If there is no such folder.

    See Also
    --------
    roughvol.open : Opens the results of a run.

    Examples
    --------
    >>> import roughvol
    >>> study = {"name": "tiny", "surface": {"D": 2.5, "m": 3, "seeds": 2}, "sweep": {"steps": 2}}
    >>> _ = roughvol.run(study, jobs=1)
    >>> [(run.name, run.state) for run in roughvol.runs() if run.name == "tiny"]
    [('tiny', 'finished')]
    """
    return run_status.listed(folder)


def tradeoff(
    study: Study | Mapping[str, Any] | str | Path,
    *,
    changes: Changes = (),
    on_sweep: Callable[[int, int], None] = lambda done, all: None,
) -> Dataset:
    """Return speed and accuracy of the solver on the surfaces of a study: `roughvol tradeoff`.

    Parameters
    ----------
    study, changes : Study, mapping, path or name, and mapping or sequence of str
        A study, and changes of it.
    on_sweep : callable, optional
        Called with the number of finished sweeps, and of all.

    Returns
    -------
    Dataset
        Time, convolutions and errors along the rungs of five ladders.

    Raises
    ------
    StudyError
        If the study has no elastic sweep of a free surface, or several by its lists.

    See Also
    --------
    roughvol.check : Returns the expected time of a study.

    Examples
    --------
    >>> import roughvol
    >>> study = {"name": "speed", "surface": {"D": 2.5, "m": 3, "seeds": 1}, "sweep": {"steps": 2}}
    >>> ds = roughvol.tradeoff(study)
    >>> sorted(set(ds["ladder"].values.tolist()))
    ['kernel', 'method', 'resolution', 'steps', 'tolerance']
    """
    return campaign.tradeoff.measure(study_of(study, changes, of_run=True)[0], on_sweep)


@dataclass(frozen=True)
class Explained:
    """A name in words; what the name does not have is empty or None."""

    name: str
    keys: tuple[Key, ...] = ()  # the key of the name in each of its forms; without a name, the sections
    others: tuple[Key, ...] = ()  # keys inside the section; without a key of the name, keys elsewhere that end so
    variable: Variable | None = None  # the variable, stored or derived
    stored_by: str = ""  # the key of a study that stores the variable
    gas: Fluid | None = None  # the gas, into vacuum


def explain(name: str | None = None) -> Explained:
    """Return the meaning of a key, a section, a variable, a gas or a quantity of your own: `roughvol explain`.

    Parameters
    ----------
    name : str, optional
        As ``"surface.file"``, ``"free_volume"`` or its symbol ``"V*"``, ``"helium"``. A quantity of your own is
        ``"my_module:my_function"``, an entry point of ``roughvol.observables``, or its name in a run under ``runs``;
        its mean is ``"my_number_mean"``. Default: the sections of a study.

    Returns
    -------
    Explained
        Keys with values, default and description; unit and symbol of a variable; viscosity of a gas.

    Raises
    ------
    DatasetError
        If there is no such name; the message has the nearest names.

    See Also
    --------
    roughvol.study.json_schema : Returns the JSON schema of study files.

    Examples
    --------
    >>> import roughvol
    >>> (key,) = roughvol.explain("surface.missing").keys
    >>> key.values, key.default
    ("'refuse' or 'nearest' or 'interpolate'", 'refuse')
    >>> roughvol.explain("leak_rate").variable.symbol
    'Q_i'
    """
    check_type(name, (str, type(None)), "a name is text")
    word = (name or "").strip().strip(".")
    if not word:
        return Explained("", tuple(key for key in keys() if "." not in key.path))
    if word in SUBSTANCES:
        return Explained(word, gas=Fluid.model_validate({"gas": word, "inlet": "1 bar", "outlet": "0 bar"}))
    exact = tuple(key for key in keys() if key.path == word)
    inside = tuple(key for key in keys() if key.path.rpartition(".")[0] == word)
    other = tuple(key for key in keys() if not exact and key.path.rpartition(".")[2] == word)
    variable = next((name for name in QUANTITIES if word in (name, *columns_of(name))), "")
    variable = variable or ("" if exact or other else named_by(word))
    of_user = None if exact or variable else _own_explained(word)
    if of_user is not None:
        return replace(of_user, others=other)
    if not exact and not other and not variable:
        from roughvol.reproduction.figures.registry import NAMES  # matplotlib: for a message alone

        if word in NAMES:
            raise DatasetError(f"{word} is a figure; roughvol plot RUN {word} draws it")
        names = [*explained_names(), *NAMES]
        near = [name for name in names if name.lower() == word.lower()]
        near = near or difflib.get_close_matches(word, names, n=3, cutoff=0.5)
        raise DatasetError(f"no key and no variable {word!r}{question(near)}; roughvol explain lists the sections")
    stored_by = record_key(variable) if variable else ""
    return Explained(variable or word, exact, inside or other, QUANTITIES.get(variable), stored_by)


def _own_explained(word: str) -> Explained | None:
    """Return the meaning of a quantity of a user, or of a number of its mean; None for another word."""
    last = word.rpartition(":")[2]
    if ":" in word:
        known = {last: OwnQuantity(word)}
    else:
        known = {name: OwnQuantity(name) for name in offered()} | stored_run.own_quantities()
    end = next((end for end in ("", *MEAN_ENDS) if last.endswith(end) and last.removesuffix(end) in known), None)
    if end is None:
        return None
    from roughvol.observables.own import row_of  # the solver: not for another word

    name = last.removesuffix(end)
    target = known[name].target
    try:
        row = row_of(name, known[name])
    except Exception as error:  # whatever the module of a user raises
        raise DatasetError(f"cannot import {target!r} ({type(error).__name__}: {error})") from error
    if end and row.dims != "... step":  # an array has no mean
        return None
    stored_by = f"record.own: {{{name}: {target}}}" + (f", ensemble.accuracy: {{{name}: 5 %}}" if end else "")
    return Explained(last, variable=with_means(name, row)[last], stored_by=stored_by)


def explained_names() -> list[str]:
    """Return all names that `explain` describes."""
    return list(dict.fromkeys([*(key.path for key in keys()), *QUANTITIES, *SUBSTANCES]))
