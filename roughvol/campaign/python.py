"""`roughvol.run` and `roughvol.press`: campaigns called from Python.

Errors name arguments, as ``press: argument E`` or ``run: study["surface"]["L"]``. Doubts are warnings of the class
`RoughvolWarning` and lines of the attribute ``warnings`` of the dataset. Heights in memory become a file: a temporary
one for `press`, one beside the results for `run`.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, SupportsFloat, SupportsIndex

from roughvol.campaign import execution, machine, notebook
from roughvol.campaign.batch import OnEvent, Progress
from roughvol.errors import CampaignError, Problem, RoughvolError, StudyError, SurfaceError, warn
from roughvol.store import run as stored_run
from roughvol.store.dataset import Dataset
from roughvol.study import Arguments, Study, changed, changes_of, of_data
from roughvol.surfaces.files import memory
from roughvol.typing import Changes, Number

NU = 0.3  # taken by `press` for E without nu
STEPS = 20  # of `press`
PERIODIC = "surface.sides is periodic for a period; mirrored or free for a part of a joint"
OF_PRESS = {
    "": "arguments",
    "surface": "argument surface",
    **dict.fromkeys(("surface.file", "surface.heights"), "argument heights"),
    "surface.L": "argument L",
    "material": "arguments E, nu and E_star",
    **{f"material.{name}": f"argument {name}" for name in ("E", "nu", "E_star", "thickness", "hardness")},
    **{name: f"argument {name}" for name in ("sweep", "record", "solver", "fluid")},
    **{f"sweep.{name}": f"argument {name}" for name in ("to", "steps")},
}
BODIES = {"surface": "heights", "surface.against": "against"}  # names of the files of heights in memory


def run(
    study: Study | str | Path | Mapping[str, Any],
    *,
    out: str | Path | None = None,
    jobs: int | None = None,
    fresh: bool = False,
    on_event: OnEvent | None = None,
    scheduler: str | None = None,
    stopping: Callable[[], bool] = lambda: False,
    only: Collection[str] | None = None,
    changes: Changes = (),
) -> Dataset:
    """Compute the missing cases of a study, store each when it is finished, and return all of them.

    Parameters
    ----------
    study : Study, path of a study file, run by folder or name, or mapping
        The study. A mapping has the keys of a study file; its values may be objects of numpy, pint and pathlib.
        ``study["surface"]["heights"]`` takes heights in memory, as `press` does, in place of ``file``.
    out : path, optional
        Folder of the results. Default: ``runs/<name of the study>``.
    jobs : int, optional
        Number of processes, ≥ 1; 1 is this process. Default: all cores, fewer if memory is short or the run is. It
        changes no value.
    fresh : bool
        Compute every case anew, also in the folder of another study.
    on_event : callable, optional
        Called with a `Progress` at every change. Default: in a notebook, a bar; else nothing.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers compute instead of processes here.
    stopping : callable, optional
        Polled during the run. Once it is true, cases begun are finished, and the run ends with KeyboardInterrupt.
    only : collection of str, optional
        Ids of the cases to compute. Default: all.
    changes : mapping or sequence of str
        Other values of keys of the study, as ``{"surface.m": 6, "name": "finer"}`` or ``["surface.m=6"]``.

    Returns
    -------
    Dataset
        The finished cases, as stored in ``study.nc``.

    Raises
    ------
    StudyError, SurfaceError
        If the study or its heights cannot be used. Nothing has been computed.
    FolderError
        If the folder is in use, holds another study, or cannot be written. Finished cases stay.
    ResourceError
        If a case needs more memory, or the files more disk, than there is. Nothing has been computed.
    CampaignError
        If cases failed (the others are stored), or ``only`` names no case of the study.

    Warns
    -----
    RoughvolWarning
        For each line of the attribute ``warnings``: limits of the model that the study exceeds, doubtful input.

    See Also
    --------
    roughvol.press : Presses a height map in memory.
    roughvol.open : Opens the results again.

    Examples
    --------
    >>> import roughvol
    >>> study = {"name": "seeds", "surface": {"D": [2.2, 2.5], "m": 3, "seeds": 2}, "sweep": {"steps": 2}}
    >>> ds = roughvol.run(study, jobs=1)
    >>> ds["free_volume"].dims
    ('D', 'm', 'seed', 'step')
    """
    options: dict[str, Any] = {"out": out, "jobs": jobs, "fresh": fresh, "scheduler": scheduler}
    options |= {"on_event": _heard(on_event), "stopping": stopping, "only": only}
    texts = changes_of(changes)
    if isinstance(study, str | os.PathLike):
        whole, folder = stored_run.study_of(Path(study), texts)
        return _warned(execution.run(whole, **options | {"out": folder if out is None else out}))
    if not isinstance(study, Mapping):
        return _warned(execution.run(changed(study, texts), **options))
    with _written(study, Arguments("run", {"": "study"})) as (data, names, files):
        if files and scheduler is not None:
            message = "run: argument scheduler: its workers do not have the heights in memory; store them in a file"
            raise CampaignError(message)
        return _warned(execution.run(of_data(data, names, texts), **options, made=files))


def press(
    heights: Any,
    *,
    L: Number | None = None,
    E: Number | None = None,
    nu: SupportsFloat | None = None,
    E_star: Number | None = None,
    thickness: Number | None = None,
    hardness: Number | None = None,
    to: str | Mapping[str, Any] | None = None,
    steps: SupportsIndex | None = None,
    sweep: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    record: Mapping[str, Any] | None = None,
    solver: Mapping[str, Any] | str | None = None,
    fluid: Mapping[str, Any] | None = None,
    surface: Mapping[str, Any] | None = None,
    jobs: int | None = None,
) -> Dataset:
    """Return the contact of a height map with an elastic half space or layer; nothing is kept on disk.

    Numbers may be of Python or numpy, text with a unit as ``"10 MPa"``, or quantities of pint. A pressure without a
    unit is p* = p L/(E* Sq), also beside a modulus with a unit.

    Parameters
    ----------
    heights : array (nx, ny), masked array, Quantity, DataArray, Topography, or path
        Heights, positive out of the body, or a file of them. The first axis is x, unless labels name the axes, as the
        dimensions ``("y", "x")``. Masked and NaN heights are missing. Heights without a unit are in that of L, or in
        ``surface["heights_unit"]``.
    L : float, str or Quantity, optional
        Length of the first axis between its outer nodes, as 500 or ``"500 um"``. Default: size of the heights, with
        which L must agree.
    E : float, str or Quantity, optional
        Young's modulus, as ``"10 MPa"``.
    nu : float, optional
        Poisson's ratio, with E. Default: 0.3, with a warning.
    E_star : float, str or Quantity, optional
        Contact modulus instead of E and nu. Default: 1.
    thickness : float, str or Quantity, optional
        Thickness of an elastic layer of E and nu, bonded to a rigid base, as ``"50 um"``. A number is in the unit of L.
        The sides are mirrored or periodic. Default: a half space.
    hardness : float, str or Quantity, optional
        Largest contact pressure. Default: elastic contact.
    to : str or mapping, optional
        Last state, as ``{"pressure": "0.5 MPa"}``. Default: ``"mean-plane"``, full contact unless the sides are free.
    steps : int, optional
        Number of equal steps of indentation. Default: 20.
    sweep : mapping or list of mappings, optional
        Section ``sweep`` of a study instead of ``to`` and ``steps``.
    record, solver : mapping, optional
        Sections of a study. ``record["dimensional"]`` adds to ``nominal_pressure`` and ``mean_gap``.
    fluid : mapping, optional
        Section ``fluid`` of a study: a gas, as ``{"gas": "helium", "inlet": "1 bar", "outlet": "0 bar"}``.
    surface : mapping, optional
        Further keys of the section ``surface``, as ``{"level": "tilt", "missing": "interpolate"}``. The default of
        ``sides`` is "mirrored": the heights are a piece of a larger joint. "free" is a block of their size.
    jobs : int, optional
        Number of threads. Default: all cores.

    Returns
    -------
    Dataset
        The states along ``step``; with units also ``nominal_pressure`` and ``mean_gap``.

    Raises
    ------
    SurfaceError
        If the heights are no map.
    StudyError
        If another argument is out of range.

    Warns
    -----
    RoughvolWarning
        For each line of the attribute ``warnings``: limits of the model that are exceeded, doubtful input.

    See Also
    --------
    roughvol.run : Computes a study, on all cores, and stores the results.

    Examples
    --------
    >>> import numpy as np
    >>> import roughvol
    >>> x = np.linspace(0.0, 4.0 * np.pi, 33)
    >>> heights = 1e-3 * np.cos(x)[:, None] * np.cos(x)  # in the unit of L
    >>> ds = roughvol.press(heights, L="1 mm", E="10 MPa", nu=0.5, to={"pressure": "5 kPa"})
    >>> round(1e3 * float(ds["nominal_pressure"][-1]), 3)  # MPa to kPa
    5.0
    """
    _refuse_twice(surface, sweep, to, steps)
    notes = []
    if E is not None and nu is None and E_star is None:
        nu = NU
        notes.append(f"press: argument nu is not given: {NU} is taken, as for many metals; rubber has 0.5")
    material = {"E": E, "nu": nu, "E_star": E_star, "thickness": thickness, "hardness": hardness}
    source = {"file": heights} if isinstance(heights, str | os.PathLike) else {"heights": heights}
    study: dict[str, Any] = {
        "name": "press",
        "surface": source | ({} if L is None else {"L": L}) | dict(surface or {}),
        "material": {name: value for name, value in material.items() if value is not None},
        "sweep": {"to": "mean-plane" if to is None else to, "steps": STEPS if steps is None else steps},
        "record": {} if record is None else record,
    }
    names = OF_PRESS
    if sweep is not None:
        study["sweep"], names = sweep, {key: name for key, name in OF_PRESS.items() if not key.startswith("sweep.")}
    study |= {name: section for name, section in (("solver", solver), ("fluid", fluid)) if section is not None}
    with (
        tempfile.TemporaryDirectory(prefix="roughvol-") as folder,
        _written(study, Arguments("press", names)) as (data, arguments, files),
    ):
        asked = _with_units(data, arguments)
        results = execution.run(asked, out=Path(folder) / "run", jobs=jobs, on_event=_heard(None), made=files)
    notes += results.attrs["warnings"].splitlines()
    return _warned(results.isel(case=0).assign_attrs(warnings="\n".join(notes)))


def _refuse_twice(surface: Any, sweep: Any, to: Any, steps: Any) -> None:
    """Refuse arguments of `press` that are given in two places."""
    if surface is not None and not isinstance(surface, Mapping):
        raise StudyError([Problem("must be a mapping", "surface", argument="press: argument surface")])
    homes = {"L": "L", "file": "heights", "files": "heights", "heights": "heights"}
    found = [(f'surface["{name}"]', f"give it as argument {homes[name]}") for name in homes if name in (surface or {})]
    if sweep is not None:
        given = {"to": to, "steps": steps}
        found += [(name, "excluded by argument sweep") for name in given if given[name] is not None]
    if found:
        raise StudyError([Problem(text, argument=f"press: argument {name}") for name, text in found])


def _with_units(data: Mapping[str, Any], names: Arguments) -> Study:
    """Return the study of `press`, which stores the nominal pressure and the mean gap where it has their units."""
    study = of_data(data, names)
    units = {"pressure": study.material.unit, "mean_gap": study.cases()[0].length_unit}
    known = {name: unit for name, unit in units.items() if unit and study.sweep.steps}  # else there is no state
    asked = {name: value for name, value in (data["record"].get("dimensional") or {}).items() if value is not None}
    return of_data({**data, "record": {**data["record"], "dimensional": known | asked}}, names) if known else study


@contextlib.contextmanager
def _written(study: Mapping[str, Any], names: Arguments) -> Iterator[tuple[Mapping[str, Any], Arguments, list[Path]]]:
    """Yield a study with files in place of heights in memory, the names of its keys, and these files.

    Errors inside name the argument in place of its file.
    """
    surface = study.get("surface")
    if not isinstance(surface, Mapping):
        yield study, names, []
        return
    bodies: dict[str, Any] = {"surface": surface, "surface.against": surface.get("against")}
    with tempfile.TemporaryDirectory(prefix="roughvol-") as folder:
        said: dict[Path, str] = {}
        for key, body in bodies.items():
            if not isinstance(body, Mapping) or "heights" not in body:
                continue
            argument = names.of(f"{key}.heights")
            if {"file", "files"} & body.keys():
                raise StudyError([Problem("excluded by 'file'", f"{key}.heights", argument=argument)])
            try:
                path = memory.write(body["heights"], Path(folder), BODIES[key])
            except SurfaceError as error:
                raise SurfaceError(f"{argument}: {error}") from error
            said[path] = argument
            bodies[key] = {**{name: value for name, value in body.items() if name != "heights"}, "file": str(path)}
            names = Arguments(names.call, {**names.names, f"{key}.file": argument.partition(": ")[2]})
            if getattr(body["heights"], "is_periodic", False) is True and not {"periodic", "sides"} & surface.keys():
                warn([f"{argument} is a periodic Topography, pressed mirrored at its sides: {PERIODIC}"])
        files = {**bodies["surface"]}
        if "against" in files:
            files["against"] = bodies["surface.against"]
        with _named(said):
            yield {**study, "surface": files}, names, list(said)


@contextlib.contextmanager
def _named(files: Mapping[Path, str]) -> Iterator[None]:
    """Name arguments in place of their files in the errors raised inside."""
    try:
        yield
    except RoughvolError as raised:
        for error in machine.with_causes(raised):
            error.args = tuple(_text(part, files) if isinstance(part, str) else part for part in error.args)
            if isinstance(error, StudyError):
                error.problems = tuple(_named_problem(one, files) for one in error.problems)
                error.args = ("\n".join(map(str, error.problems)),)
        raise


def _named_problem(problem: Problem, files: Mapping[Path, str]) -> Problem:
    """Return a problem with arguments in place of their files, named once."""
    message = _text(problem.message, files)
    return replace(problem, message=message.removeprefix(f"{problem.argument}: "))


def _text(text: str, files: Mapping[Path, str]) -> str:
    """Return a text with arguments in place of their files."""
    for path, argument in files.items():
        if text.startswith(str(path)):
            text = argument + text.removeprefix(str(path))
        for name in (str(path), path.name):
            text = text.replace(name, argument.partition(": ")[2])
    return text


def _heard(on_event: OnEvent | None) -> OnEvent:
    """Return a function that draws the progress of a run in a notebook, and warns of doubts and unusable files.

    A function of the user is returned unchanged.
    """
    if on_event is not None:
        return on_event
    draw = notebook.progress()

    def follow(now: Progress) -> None:
        if now.notice.startswith(("warning: ", "set aside: ")):
            warn([now.notice.removeprefix("warning: ")])
        if draw is not None:
            draw(now)

    return follow


def _warned(results: Dataset) -> Dataset:
    """Return a dataset, with a warning for each line of its attribute ``warnings``."""
    warn(results.attrs["warnings"].splitlines())
    return results
