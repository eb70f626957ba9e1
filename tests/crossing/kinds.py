"""Kinds of run: small studies, each of which shows one feature in its numbers.

Surfaces have 17 nodes a side (m = 4), those with coarser grids 32 or 33, and few steps.
A kind is made once in a session, by ``roughvol run``.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Kind:
    """A kind of run.

    Attributes
    ----------
    name : str
        Row of the table, and name of the study.
    title : str
        The kind in words.
    study : str
        Its study file.
    at : tuple of str
        Loads that the questions ask for.
    modulus : float or mapping
        E* in MPa, or E* of each label of a list; NaN without a unit.
    lists : tuple of str
        Keys with a list, which are dimensions of study.nc.
    changes : tuple of str
        The part of the run that the questions are put to, as for ``--set``. `modulus` has its labels.
    ends : str
        The load at which the sweep ends by definition, where no number of the last step has exactly this value.
    axes : str
        Axes of read-offs: of a seal that of its flow.
    squares : float
        Length over width of a seal; 1 without a seal.
    beside : (str, str)
        The kind to compare with, and the load of the comparison.
    files : mapping
        Names of height files: seed, Sq in um, and nodes a side.
    afterwards : mapping
        The same for files that change after the run; of a study, the words before and after. Questions are then put
        with the study file.
    """

    name: str
    title: str
    study: str
    at: tuple[str, ...] = ("pressure=0.05 MPa",)
    modulus: float | Mapping[object, float] = 10.0
    lists: tuple[str, ...] = ()
    changes: tuple[str, ...] = ()
    ends: str = ""
    axes: str = "xy"
    squares: float = 1.0
    beside: tuple[str, str] = ("one", "pressure=0.05 MPa")
    files: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    afterwards: Mapping[str, Sequence[Any]] = field(default_factory=dict)

    @property
    def file(self) -> str:
        """Name of the study file."""
        return f"{self.name}.yaml"

    @property
    def card(self) -> str:
        """The load of a leak card: a solved step, so that study.nc has its numbers."""
        return "pressure=0.06 MPa" if "0.06 MPa, 0.09 MPa]" in self.study else "last"

    @property
    def asked(self) -> str:
        """What the questions take as the run: its name, or its study file where this was changed."""
        return self.file if self.afterwards else self.name


def _heights(seed: int, sq: float, nodes: int) -> np.ndarray:
    """Return a rough map with a given Sq in um: random waves with amplitudes that fall with the wave number."""
    random = np.random.default_rng(seed)
    waves = np.fft.rfft2(random.standard_normal((nodes, nodes)))
    q = np.hypot(np.fft.fftfreq(nodes)[:, None], np.fft.rfftfreq(nodes)[None, :])
    q[0, 0] = np.inf
    z = np.fft.irfft2(waves * q**-1.8, s=(nodes, nodes))
    return sq * (z - z.mean()) / z.std()


def write(folder: Path, files: Mapping[str, Sequence[Any]]) -> None:
    """Write height maps into a folder, and replace words of the study files there."""
    for name, given in files.items():
        if name.endswith(".npy"):
            np.save(folder / name, _heights(*given))
        else:
            text = (folder / name).read_text(encoding="utf-8")
            (folder / name).write_text(text.replace(*given), encoding="utf-8")


def _kind(name: str, row: dict[str, Any]) -> Kind:
    """Return the kind of a table of kinds.toml."""
    modulus = row.pop("modulus", 10.0)
    if not isinstance(modulus, float):
        modulus = {float(label): value for label, value in modulus.items()}
    own = {key: row.pop(key) for key in _MOST if key in row}
    fields = {key: tuple(value) if isinstance(value, list) else value for key, value in row.items()}
    return Kind(name, modulus=modulus, **{"study": _study(_MOST | own)} | fields)


def _study(keys: dict[str, Any]) -> str:
    """Return a study file of sections, and of keys and lines of its record."""
    sections = [f"{name}: {keys[name]}" for name in ("surface", "material", "sweep")]
    record = [f"{name}: {keys[name]}" for name in ("heights", "transport", "dimensional")]
    lines = [f"  {line}" for line in (*record, *keys["records"])]
    return "\n".join([*sections, "record:", *lines, keys["further"]])


_TABLE = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
_MOST = _TABLE.pop("most")
KINDS = tuple(_kind(name, row) for name, row in _TABLE.items())
BY_NAME = {kind.name: kind for kind in KINDS}
