"""Periodic surfaces with every other feature: equal bits in processes and on a cluster, or one clear refusal."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from roughvol.campaign import cost, running, tradeoff
from roughvol.errors import RoughvolError
from roughvol.store import dataset
from roughvol.study import loads

pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
]

MIDPOINT = "surface: {D: 2.4, m: 4, seeds: 2, periodic: true}\n"
SMALL = MIDPOINT.replace(", seeds: 2", "")
SPECTRUM = "surface: {H: 0.7, n: 16, rolloff: 2, seeds: 2, periodic: true}\n"
MEASURED = "surface: {file: z.npy, L: 1, periodic: true, outliers: {}, missing: interpolate}\n"
SWEEP = "sweep: {steps: 4, to: {contact_area: 0.5}}\n"
PATH = "sweep: [{steps: 3, to: {separation: 0.6}}, {steps: 2, to: {separation: 1.0}}]\n"
TRANSPORT = "transport: {percolation: every-step, transmissivity: last, cell_transmissivity: last, constriction: last}"
TEXTURE = "texture: true, psd: {at: last}, box_counting: {}, volume_density: {bins: 5}"
ENSEMBLE = "ensemble: {accuracy: {free_volume: 20 %}, at: {pressure: [0.2]}}"

WORKS = {
    "love": MIDPOINT + SWEEP,
    "punch": MIDPOINT + SWEEP + "solver: {kernel: punch}",
    "fourier": SPECTRUM + SWEEP + "solver: {kernel: fourier, accuracy: reference}",
    "the paper's algorithm": MIDPOINT + SWEEP + "solver: {method: paper}",
    "measured": MEASURED + SWEEP + "record: {texture: true}",
    "two bodies": MEASURED.replace("L: 1", "L: 1, against: {file: z.npy, mirror: x}") + SWEEP,
    "plastic": MIDPOINT
    + PATH
    + "material: {E_star: 1, hardness: 0.3}\nrecord: {residual_heights: true, texture: true}",
    "plastic, fourier": SPECTRUM + SWEEP + "material: {E_star: 1, hardness: 0.3}\nsolver: {kernel: fourier}",
    "hardness that only reports": MIDPOINT + SWEEP + "material: {E_star: 1, hardness: 0.3, plastic: false}",
    "void": MIDPOINT + SWEEP + f"record: {{{TRANSPORT}}}",
    "texture": SPECTRUM + SWEEP + f"record: {{{TEXTURE}}}",
    "region": MIDPOINT + SWEEP + f"record: {{region: interior, region_widths: {{}}, {TEXTURE}}}",
    "plastic region": MIDPOINT + PATH + "material: {E_star: 1, hardness: 0.3}\nrecord: {region: interior, psd: true}",
    "ensemble": SMALL.replace("m: 4", "m: 5") + "sweep: {steps: 5, to: {pressure: 0.4}}\n" + ENSEMBLE,
    "ensemble, spectrum": SPECTRUM.replace(", seeds: 2", "").replace("n: 16", "n: 32")
    + "solver: {kernel: fourier}\nsweep: {steps: 5, to: {pressure: 0.4}}\n"
    + ENSEMBLE,
}

REFUSED = {
    "fourier on a patch": (MIDPOINT.replace(", periodic: true", "") + "solver: {kernel: fourier}", "solver.kernel"),
    "cell of a region": (
        MIDPOINT + "record: {region: interior, transport: {cell_transmissivity: last}}",
        "record.transport.cell_transmissivity",
    ),
    "ensemble of files": (MEASURED + SWEEP + ENSEMBLE, "ensemble"),
    "low pass": (MEASURED.replace("L: 1", "L: 1, low_pass: 0.3"), "surface.low_pass"),
    "ensemble of too few levels": (SMALL + ENSEMBLE, "surface.m: must be at least 5"),
    "ensemble of too few waves": (SPECTRUM.replace(", seeds: 2", "") + ENSEMBLE, "surface.n: must be at least 32"),
    "beyond full contact": (
        MIDPOINT.replace("seeds: 2", "seeds: 1") + "sweep: {steps: 2, to: {separation: -0.5}}",
        "sweep.to.separation: must be >= 0, given -0.5",
    ),
    "listed beyond full contact": (
        MIDPOINT.replace("D: 2.4", "D: 2.4, L: 1 um") + "sweep: {separations: [0.2 um, -1 nm]}",
        "sweep.separations[1]: must be >= 0, given -1 nm",
    ),
    "indented beyond full contact": (
        MIDPOINT.replace("seeds: 2", "seeds: 1") + "sweep: {steps: 2, to: {indentation: 50}}",
        "up to",
    ),
    "too few elements": (
        "surface: {file: few.npy, L: 1, periodic: true}",
        "surface.periodic: few.npy has 4 x 9 heights",
    ),
}


@pytest.fixture(autouse=True)
def _map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    z = np.random.default_rng(0).normal(size=(18, 16))
    z[0, 3:6] = np.nan
    np.save("z.npy", z)
    np.save("few.npy", z[4:8, :9])


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    distributed = pytest.importorskip("distributed", reason="needs dask.distributed: pip install 'roughvol[cluster]'")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0", protocol="tcp"
    ) as local:
        yield local.scheduler_address


@pytest.mark.parametrize("text", WORKS.values(), ids=WORKS.keys())
def test_a_cluster_gives_the_bits_of_processes_and_the_cost_is_known(text: str, scheduler: str, tmp_path: Path) -> None:
    study = loads(text, tmp_path / "study.yaml")
    there = running.run(study, out=tmp_path / "there", scheduler=scheduler)
    here = running.run(study, out=tmp_path / "here", jobs=1)
    xr.testing.assert_identical(dataset.answers(there), dataset.answers(here))
    assert (here["converged"].astype(float).fillna(1.0) == 1.0).all()
    assert cost.estimate(study, 1).seconds > 0.0


@pytest.mark.parametrize(("text", "place"), REFUSED.values(), ids=REFUSED.keys())
def test_what_does_not_work_is_refused_with_one_reason(text: str, place: str, tmp_path: Path) -> None:
    with pytest.raises(RoughvolError) as refused:
        running.run(loads(text, tmp_path / "study.yaml"), out=tmp_path / "run", jobs=1)
    assert place in str(refused.value)
    assert len(str(refused.value).splitlines()) <= 2


def test_the_algorithm_of_the_paper_finds_the_same_states(tmp_path: Path) -> None:
    fast, paper = (
        running.run(loads(MIDPOINT + "sweep: {steps: 4}\n" + more), out=tmp_path / place, jobs=1)
        for place, more in (("fast", ""), ("paper", "solver: {method: paper}"))
    )
    for name in ("mean_pressure", "contact_area_fraction", "free_volume"):
        np.testing.assert_allclose(paper[name], fast[name], rtol=1e-4, atol=1e-5)


def test_tradeoff_is_refused() -> None:
    with pytest.raises(RoughvolError, match="the surface is periodic"):
        tradeoff.surfaces_of(loads(MIDPOINT + SWEEP))
