"""Kinds of run: small studies, each of which shows one feature in its numbers.

Surfaces have 17 nodes a side (m = 4) and few steps. A kind is made once in a session, by ``roughvol run``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

LEAK = "leak_rate: {pressure_drop: 5 mbar, viscosity: 1 mPa*s}"
FLOWS = "transport: {percolation: every-step, constriction: every-step, transmissivity: every-step}"
UNITS = f"dimensional: {{pressure: MPa, mean_gap: um, critical_gap: um, {LEAK}}}"
RECORD = f"record:\n  heights: true\n  {FLOWS}\n  {UNITS}\n"
RUBBER = "material: {E_star: 10 MPa}\n"
LISTED = "sweep: {pressures: [0.01 MPa, 0.03 MPa, 0.06 MPa, 0.09 MPa]}\n"


def _patch(seeds: str, m: str = "4", D: str = "2.2", more: str = "") -> str:
    return f"surface: {{D: {D}, m: {m}, L: 100 um, Sq: 0.5 um, seeds: {seeds}{more}}}\n"


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
    ends : str
        The load at which the sweep ends by definition, where no number of the last step has exactly this value.
    beside : (str, str)
        The kind to compare with, and the load of the comparison.
    files : callable, optional
        Writes the height files into a folder.
    afterwards : callable, optional
        Changes the study or a file after the run. Questions are then put with the study file.
    """

    name: str
    title: str
    study: str
    at: tuple[str, ...]
    modulus: float | Mapping[object, float] = 10.0
    lists: tuple[str, ...] = ()
    ends: str = ""
    beside: tuple[str, str] = ("one", "pressure=0.05 MPa")
    files: Callable[[Path], None] | None = field(default=None)
    afterwards: Callable[[Path], None] | None = field(default=None)

    @property
    def file(self) -> str:
        """Name of the study file."""
        return f"{self.name}.yaml"

    @property
    def card(self) -> str:
        """The load of a leak card: a solved step, so that study.nc has its numbers."""
        return "pressure=0.06 MPa" if LISTED in self.study else "last"

    @property
    def asked(self) -> str:
        """What the questions take as the run: its name, or its study file where this was changed."""
        return self.file if self.afterwards else self.name


def _heights(seed: int, sq: float, nodes: int = 17) -> np.ndarray:
    """Return a rough map with a given Sq in um: random waves with amplitudes that fall with the wave number."""
    random = np.random.default_rng(seed)
    waves = np.fft.rfft2(random.standard_normal((nodes, nodes)))
    q = np.hypot(np.fft.fftfreq(nodes)[:, None], np.fft.rfftfreq(nodes)[None, :])
    q[0, 0] = np.inf
    z = np.fft.irfft2(waves * q**-1.8, s=(nodes, nodes))
    return sq * (z - z.mean()) / z.std()


def _two_files(folder: Path) -> None:
    np.save(folder / "flat.npy", _heights(3, 0.4))
    np.save(folder / "rough.npy", _heights(4, 0.9))


def _one_file(folder: Path) -> None:
    np.save(folder / "worn.npy", _heights(5, 0.5))


def _two_bodies(folder: Path) -> None:
    np.save(folder / "lower.npy", _heights(6, 0.3))
    np.save(folder / "upper.npy", _heights(7, 0.4))


def _softer(folder: Path) -> None:
    file = folder / "study-changed.yaml"
    file.write_text(file.read_text(encoding="utf-8").replace("10 MPa", "20 MPa"), encoding="utf-8")


def _other_heights(folder: Path) -> None:
    np.save(folder / "worn.npy", _heights(8, 0.7))


KINDS = (
    Kind(
        "one",
        "one surface",
        _patch("[1]") + RUBBER + "sweep: {steps: 8, to: {pressure: 0.2 MPa}}\n" + RECORD,
        ("pressure=0.05 MPa", "contact_area=0.2", "last"),
    ),
    Kind(
        "seeds",
        "several seeds",
        _patch("[1, 2, 3]") + RUBBER + "sweep: {steps: 8, to: {pressure: 0.05 MPa}}\n" + RECORD,
        ("pressure=0.02 MPa", "mean_gap=0.4 um"),
    ),
    Kind(
        "m",
        "several m",
        _patch("[1, 2]", "[3, 4]") + RUBBER + LISTED + RECORD.replace("heights: true", "heights: false"),
        ("pressure=0.05 MPa",),
    ),
    Kind(
        "D",
        "several D, no units",
        "surface: {D: [2.2, 2.6], m: 4, seeds: [1, 2]}\nsweep: {steps: 8, to: {pressure: 1.5}}\n"
        f"record: {{heights: true, {FLOWS}}}\n",
        ("pressure=0.5", "indentation=1.5"),
        modulus=float("nan"),
        beside=("mean-plane", "pressure=0.5"),
    ),
    Kind(
        "files",
        "several files of different Sq",
        "surface: {files: [flat.npy, rough.npy], L: 100 um}\n" + RUBBER + LISTED + RECORD,
        ("pressure=0.05 MPa",),
        files=_two_files,
    ),
    Kind(
        "bodies",
        "two rough bodies",
        "surface: {file: lower.npy, L: 100 um, against: {file: upper.npy}}\n" + RUBBER + LISTED + RECORD,
        ("pressure=0.05 MPa",),
        files=_two_bodies,
    ),
    Kind(
        "spectrum",
        "a spectrum with a roll-off",
        "surface: {H: 0.8, n: 16, rolloff: 3, cut: 7, L: 100 um, Sq: 0.5 um, seeds: [1, 2]}\n"
        + RUBBER
        + LISTED
        + RECORD,
        ("pressure=0.05 MPa",),
    ),
    Kind(
        "materials",
        "a list of materials",
        _patch("[1, 2]") + "material: {E: [6 MPa, 12 MPa], nu: 0.5}\n" + LISTED + RECORD,
        ("pressure=0.05 MPa",),
        modulus={6.0: 8.0, 12.0: 16.0},
        lists=("E",),
    ),
    Kind(
        "regions",
        "a list of regions",
        _patch("[1]") + RUBBER + LISTED + RECORD + "  region: [none, interior]\n",
        ("pressure=0.05 MPa",),
        lists=("region",),
    ),
    Kind(
        "legs",
        "legs with yield",
        _patch("[1, 2]")
        + "material: {E_star: 10 MPa, hardness: 0.5 MPa}\nsolver: {rtol: 1.0e-7}\n"
        + "sweep:\n  - {steps: 5, to: {pressure: 0.08 MPa}}\n  - {steps: 4, to: {pressure: 0.01 MPa}}\n"
        + RECORD
        + "  residual_heights: true\n  all_legs: true\n  fields_at: {pressure: 0.05 MPa}\n",
        ("pressure=0.03 MPa", "pressure=0.03 MPa, leg 2", "last"),
    ),
    Kind(
        "one-way",
        "fluid pressure, one-way",
        _patch("[1]")
        + RUBBER
        + LISTED
        + RECORD
        + "  fluid_pressure: {inlet: 5 mbar, coupling: one-way, at: {pressure: [0.03 MPa, 0.06 MPa]}}\n",
        ("pressure=0.03 MPa", "pressure=0.06 MPa"),
    ),
    Kind(
        "coupled",
        "fluid pressure, coupled",
        _patch("[1, 3]")
        + RUBBER
        + LISTED
        + RECORD.replace("5 mbar", "50 mbar")
        + "  fluid_pressure: {inlet: 50 mbar, at: {pressure: [0.03 MPa, 0.06 MPa]}}\n",
        ("pressure=0.03 MPa", "pressure=0.06 MPa"),
    ),
    Kind(
        "gas",
        "a gas",
        _patch("[1, 2]")
        + RUBBER
        + LISTED
        + "fluid: {gas: helium, inlet: 100 mbar, outlet: 0 mbar}\n"
        + RECORD.replace("percolation: every-step", "percolation: every-step, gas_flow: every-step").replace(
            "dimensional: {", "dimensional: {gas_leak_rate: mbar*l/s, "
        ),
        ("pressure=0.05 MPa",),
    ),
    Kind(
        "lifted-gas",
        "a gas under fluid pressure",
        _patch("[1]")
        + RUBBER
        + LISTED
        + "fluid: {gas: helium, inlet: 100 mbar, outlet: 0 mbar}\n"
        + RECORD.replace("5 mbar", "50 mbar")
        .replace("percolation: every-step", "percolation: every-step, gas_flow: every-step")
        .replace("dimensional: {", "dimensional: {gas_leak_rate: mbar*l/s, ")
        + "  fluid_pressure: {inlet: 50 mbar, at: {pressure: 0.06 MPa}}\n",
        ("pressure=0.06 MPa",),
    ),
    Kind(
        "region",
        "a region",
        _patch("[1, 2]") + RUBBER + LISTED + RECORD + "  region: interior\n",
        ("pressure=0.05 MPa",),
    ),
    Kind(
        "periodic",
        "a periodic surface",
        _patch("[1, 2]", more=", periodic: true") + RUBBER + LISTED + RECORD,
        ("pressure=0.05 MPa",),
    ),
    Kind(
        "ensemble",
        "an ensemble",
        "surface: {D: 2.3, m: 3}\nsweep: {steps: 6, to: {pressure: 0.5}}\n"
        "ensemble: {accuracy: {free_volume: 20 %}, at: {pressure: [0.1, 0.3]}}\n",
        ("pressure=0.2",),
        modulus=float("nan"),
        beside=("D", "pressure=0.2"),
    ),
    Kind(
        "closed",
        "all ways closed",
        _patch("[1, 2]") + RUBBER + "sweep: {pressures: [0.3 MPa, 0.5 MPa]}\n" + RECORD,
        ("pressure=0.4 MPa", "pressure=0.6 MPa"),
        beside=("one", "pressure=0.3 MPa"),
    ),
    Kind(
        "some-closed",
        "one of three surfaces closed at the end",
        _patch("[1, 2, 3]") + RUBBER + LISTED + RECORD,
        ("pressure=0.09 MPa", "pressure=0.08 MPa"),
    ),
    Kind(
        "percolation",
        "each surface pressed until it closes",
        _patch("[1, 2, 3]") + RUBBER + "sweep: {steps: 6, to: percolation}\n" + RECORD,
        ("pressure=0.05 MPa", "pressure=0.14 MPa"),
    ),
    Kind(
        "mean-plane",
        "end at d = 0",
        "surface: {D: 2.3, m: 4, seeds: [0, 1, 2, 3]}\nsweep: {steps: 5, to: mean-plane}\n"
        f"record: {{heights: true, {FLOWS}}}\n",
        ("separation=0",),
        modulus=float("nan"),
        beside=("D", "pressure=0.5"),
    ),
    Kind(
        "to-pressure",
        "end at a pressure",
        _patch("[1, 2, 3]") + RUBBER + "sweep: {steps: 5, to: {pressure: 0.05 MPa}}\n" + RECORD,
        ("pressure=0.05 MPa",),
    ),
    Kind(
        "to-area",
        "end at a contact area",
        _patch("[1, 2, 3]") + RUBBER + "sweep: {steps: 5, to: {contact_area: 0.2}}\n" + RECORD,
        ("contact_area=0.2",),
        ends="contact_area=0.2",
    ),
    Kind(
        "force",
        "loads as forces",
        _patch("[1, 2]") + RUBBER + "sweep: {loads: [0.1 mN, 0.3 mN, 0.9 mN]}\n" + RECORD,
        ("load=0.3 mN", "load=0.5 mN"),
    ),
    Kind(
        "nominal",
        "loads as nominal pressures in other units",
        _patch("[1, 2]") + RUBBER + "sweep: {pressures: [10 kPa, 30 kPa, 0.9 bar]}\n" + RECORD,
        ("pressure=30 kPa", "pressure=0.5 bar"),
    ),
    Kind(
        "gap",
        "loads as mean gaps",
        _patch("[1, 2]") + RUBBER + "sweep: {mean_gaps: [0.7 um, 500 nm, 0.3 um]}\n" + RECORD,
        ("mean_gap=500 nm", "mean_gap=0.4 um"),
    ),
    Kind(
        "records",
        "every other record",
        _patch("[1]")
        + RUBBER
        + LISTED
        + RECORD
        + "  fields_at: {contact_area: 0.1}\n  box_counting: {at: {contact_area: 0.1}}\n  texture: true\n  psd: true\n"
        "  volume_density: {bins: 9}\n  contact_perimeter: true\n  region_widths: {shares: [1.0, 0.5]}\n",
        ("pressure=0.05 MPa", "contact_area=0.1"),
    ),
    Kind(
        "unpressed",
        "surfaces alone, nothing pressed",
        _patch("[1, 2]") + RUBBER + "sweep: {steps: 0}\nrecord: {heights: true}\n",
        ("last",),
    ),
    Kind(
        "study-changed",
        "the study changed since the run",
        "comment: a study that changes\n" + _patch("[1]") + RUBBER + LISTED + RECORD,
        ("pressure=0.05 MPa",),
        afterwards=_softer,
    ),
    Kind(
        "file-changed",
        "the height file changed since the run",
        "surface: {file: worn.npy, L: 100 um}\n" + RUBBER + LISTED + RECORD,
        ("pressure=0.05 MPa",),
        files=_one_file,
        afterwards=_other_heights,
    ),
)
BY_NAME = {kind.name: kind for kind in KINDS}
