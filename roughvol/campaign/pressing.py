"""Heights in memory, pressed in one call."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from roughvol.campaign.running import run
from roughvol.errors import SurfaceError
from roughvol.store.dataset import Dataset


def press(
    heights: ArrayLike,
    *,
    L: float | str,
    E: float | str | None = None,
    nu: float = 0.3,
    E_star: float | str | None = None,
    hardness: float | str | None = None,
    to: str | Mapping[str, Any] = "mean-plane",
    steps: int = 20,
    sweep: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    record: Mapping[str, Any] | None = None,
    solver: Mapping[str, Any] | str | None = None,
    surface: Mapping[str, Any] | None = None,
    jobs: int | None = None,
) -> Dataset:
    """Return the contact of a height map with an elastic half space; nothing is kept on disk.

    Parameters
    ----------
    heights : array (nx, ny)
        Heights, positive out of the body, in the unit of L unless ``surface`` gives ``heights_unit``.
    L : float or str
        Length of the first axis, as 500 or ``"500 um"``.
    E : float or str, optional
        Young's modulus, as ``"10 MPa"``.
    nu : float
        Poisson's ratio, with E.
    E_star : float or str, optional
        Contact modulus instead of E and nu. Default: 1.
    hardness : float or str, optional
        Largest contact pressure. Default: elastic contact.
    to : str or mapping
        Last state, as ``{"pressure": "0.5 MPa"}``.
    steps : int
        Number of equal steps of indentation.
    sweep : mapping or list of mappings, optional
        Section ``sweep`` of a study instead of ``to`` and ``steps``.
    record, solver : mapping, optional
        Sections of a study.
    surface : mapping, optional
        Further keys of the section ``surface``, as ``{"level": "tilt"}``.
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
    """
    array = np.asarray(heights, dtype=np.float64)
    if array.ndim != 2:
        message = f"heights have shape {array.shape}; allowed: two axes"
        raise SurfaceError(message)
    material: dict[str, Any] = {"E": E, "nu": nu} if E is not None else {"E_star": 1.0 if E_star is None else E_star}
    if E is not None and E_star is not None:
        material["E_star"] = E_star  # the study refuses both
    if hardness is not None:
        material["hardness"] = hardness
    recorded = dict(record or {})
    units = {"pressure": _unit(E if E is not None else E_star), "mean_gap": _unit(L)}
    if "dimensional" not in recorded and (known := {name: unit for name, unit in units.items() if unit}):
        recorded["dimensional"] = known
    study: dict[str, Any] = {"name": "press", "material": material, "record": recorded}
    study["sweep"] = _plain(sweep) if sweep is not None else {"steps": steps, "to": _plain(to)}
    if solver is not None:
        study["solver"] = _plain(solver)
    with tempfile.TemporaryDirectory(prefix="roughvol-") as folder:
        file = Path(folder) / "heights.npy"
        np.save(file, array)
        study["surface"] = {"file": str(file), "L": L, **(surface or {})}
        return run(study, out=Path(folder) / "run", jobs=jobs).isel(case=0)


def _unit(value: Any) -> str:
    """Return the unit of a number given as text, empty without one."""
    return value.strip().lstrip("+-0123456789.eE").strip() if isinstance(value, str) else ""


def _plain(value: Any) -> Any:
    """Return mappings and sequences as dicts and lists."""
    if isinstance(value, Mapping):
        return {str(name): _plain(inner) for name, inner in value.items()}
    return [_plain(inner) for inner in value] if isinstance(value, Sequence) and not isinstance(value, str) else value
