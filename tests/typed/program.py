"""A program of a user with all public functions; mypy checks it against the installed package, and nothing runs it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pint
import xarray as xr

import roughvol
import roughvol.errors
from roughvol.analysis.accessor import Accessor
from roughvol.campaign import Context, Progress, collect, estimate, run_case
from roughvol.contact import Contact, HalfSpace, first_indentation, indentation_for, solve, sweep
from roughvol.store import dataset
from roughvol.store.licences import Licence
from roughvol.surfaces import Spectrum, Surface, power_law_surface, random_midpoint_displacement

units: pint.UnitRegistry[float] = pint.UnitRegistry()
heights = np.random.default_rng(0).normal(size=(33, 33))


def pressed() -> xr.Dataset:
    """Press a map in three forms of its numbers."""
    roughvol.press(heights, L=100, E_star=1.0, steps=np.int64(5))
    roughvol.press(Path("scan.npy"), L="100 um", E="10 MPa", nu=0.5, to="summit-plane", jobs=1)
    end = {"pressure": 0.1 * units.bar}
    roughvol.press(heights, L="100 um", E="10 MPa", nu=0.5, thickness=50 * units.um, to=end)
    return roughvol.press(heights, L=0.1 * units.mm, E=10 * units.MPa, nu=np.float32(0.5), to=end, record={})


def followed(now: Progress) -> None:
    """Print the progress of a run."""
    print(now.done, now.cases, now.left)


def ran() -> xr.Dataset:
    """Run a study in each form."""
    data = {"name": "rubber", "surface": {"D": 2.3, "m": 5, "seeds": 2}, "material": {"E_star": 1 * units.MPa}}
    roughvol.run(data, jobs=1, on_event=followed, changes={"surface.m": 6})
    roughvol.run("study.yaml", out="runs/other", fresh=True, only=["case"], changes=["surface.m=6"])
    study = roughvol.load("study.yaml", ["surface.m=6"]).changed(**{"surface.m": 7})
    ds: xr.Dataset = roughvol.run(study, scheduler="tcp://localhost:8786")
    return ds if ds.attrs["warnings"] else roughvol.open("rubber", changes={"material.E_star": 2.0})


def read(ds: xr.Dataset) -> float:
    """Read numbers at loads."""
    at: xr.Dataset = Accessor(ds).at(pressure="0.02 MPa", leg=1)
    at = Accessor(at).at({"pressure": 20 * units.kPa})
    at = Accessor(at).at(contact_area=np.float64(0.1))
    every: xr.Dataset = Accessor(Accessor(at).derived()).mean("seed")
    every = Accessor(every).in_units(mean_gap="nm", leak_rate=units.ml / units.min)
    frame = roughvol.show(ds, ["last", {"pressure": "0.02 MPa"}]).frame()
    names, rows, unit = roughvol.compare([ds, "rubber"], "last").records()
    frame.to_csv(f"{names[0]}, {rows[0]}, {unit[names[0]]}")
    quantity: pint.Quantity[float] = Accessor(ds).quantity("leak_rate", "ml/min", units)
    return float(quantity.magnitude)


def sealed(ds: xr.Dataset) -> tuple[float, float]:
    """Card, read-offs and creep of a seal."""
    cards = roughvol.card("gasket.yaml", [{"pressure": 50 * units.kPa}, "last"], jobs=2, changes={"seal.width": "4 mm"})
    paths: list[Path] = cards.write()
    print(paths, cards.plain())
    seal = cards.cards["pressure=50 kPa"].seal
    leak = seal.leak if seal is not None else 0.0
    most = 1e-6 * units.mm**3 / units.s
    answer = roughvol.ask(ds, leak_rate=most, unknown="modulus", at="pressure=0.05 MPa").answers[0]
    closed = roughvol.ask("gasket", budget=True)
    law = {"power": {"exponent": 0.1, "time": 1 * units.s}}
    history = roughvol.creep(ds, law, at={"pressure": "0.05 MPa"}, times=["1 s", 1 * units.hour])
    print(history.leak["x"].value, history.plain(), closed.plain(), closed.command())
    return leak, answer.value


def asked() -> list[str]:
    """Ask about runs, studies and keys."""
    found = roughvol.check({"surface": {"D": 2.5, "m": 4, "seeds": 3}}, jobs=1)
    print(found.estimate.seconds, found.warnings, found.plain())
    print(roughvol.status("rubber").done, roughvol.tradeoff("study.yaml").sizes)
    roughvol.report_on(["rubber"]).write("report")
    roughvol.plot({"dry": "dry", "wet": roughvol.open("wet")}, "v_of_p").savefig("both.png")
    gas = roughvol.explain("helium").gas
    print(gas.viscosity if gas is not None else roughvol.study.json_schema())
    held: list[Licence] = [*roughvol.licences()]
    print(len(held))
    return [run.name for run in roughvol.runs()] + [key.path for key in roughvol.explain().keys]


def solved() -> Contact:
    """Solve states of one surface."""
    surface: Surface = random_midpoint_displacement(2.3, 5, seed=1).scaled(0.5)
    waves = power_law_surface(Spectrum(rolloff=2.0, cut=8.0), hurst=0.8, n=32)
    half_space = HalfSpace(surface.shape)
    first = first_indentation(surface, half_space, lambda contact: contact.contact_area_fraction > 0.1)
    for state in sweep(surface, half_space, [first, 2.0 * first]):
        print(state.residual, state.gap().shape, waves.Sq)
    print(indentation_for(surface, half_space, "pressure", 0.1, rtol=1e-6))
    return solve(surface, half_space, first)


def computed() -> xr.Dataset:
    """Compute a case, and collect a run."""
    study = roughvol.load("study.yaml")
    case = study.cases()[0]
    print(estimate(study, jobs=2).memory)
    dataset.write(run_case(case, Context(threads=2)), Path("case.nc"))
    collect(study, Path("runs/study"))
    return dataset.read(Path("runs/study/study.nc"))


def main() -> None:
    """Name errors and doubts."""
    try:
        print(read(pressed()), sealed(ran()), asked(), solved(), computed(), roughvol.__version__)
    except roughvol.errors.StudyError as error:
        print([problem.key for problem in error.problems])
    except (roughvol.errors.RoughvolError, roughvol.RoughvolWarning) as error:
        print(error)
