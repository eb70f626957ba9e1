"""Periodic surfaces in a study: keys, ids, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from roughvol.contact.kernels import KERNELS
from roughvol.errors import StudyError
from roughvol.study import loads
from roughvol.study.sections.solver import FreeKernel, PeriodicKernel
from tests.study.kit import refused

GENERATED = "surface: {D: 2.3, m: 4, seeds: 1, periodic: true}\n"


def case(text: str):
    return loads(text).cases()[0]


def test_ids_change_where_a_surface_is_periodic_and_nowhere_else() -> None:
    free, periodic = case("surface: {D: 2.3, m: 4, seeds: 1}"), case(GENERATED)
    assert free.id == case("surface: {D: 2.3, m: 4, seeds: 1, periodic: false}").id
    assert periodic.id != free.id
    assert periodic.periodic
    assert periodic.id != case(GENERATED + "solver: {kernel: fourier}").id


def test_the_resolved_study_reads_back_equal() -> None:
    study = loads(GENERATED + "solver: {kernel: fourier}\nsweep: {to: {free_volume: 0.5}}")
    assert loads(study.to_yaml()) == study


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("surface: {D: 2.3, m: 4}\nsolver: {kernel: fourier}", "'fourier' needs surface.periodic: true"),
        ("surface: {D: 2.3, m: 2, periodic: true}", "takes m >= 3"),
        ("surface: {file: z.npy, L: 1, periodic: true, level: tilt}", "allowed with periodic: none, mean"),
        ("surface: {file: z.npy, L: 1, periodic: true, downsample: 2}", "surface.downsample: changes or cuts"),
        ("surface: {file: z.npy, L: 1, periodic: true, low_pass: 0.5}", "surface.low_pass: changes or cuts"),
        ("surface: {file: z.npy, L: 1, periodic: true, crop: {x: [0, 0.5]}}", "surface.crop: changes or cuts"),
        ("surface: {D: 2.3, m: 4}\nrecord: {transport: {cell_transmissivity: last}}", "needs surface.periodic: true"),
        (GENERATED + "record: {region: {x: [0, 0.5]}, transport: {cell_transmissivity: last}}", "no record.region"),
        (GENERATED + "sweep: {to: {free_volume: 0}}", "must be > 0"),
        (GENERATED + "sweep: {to: {free_volume: 0.5}}\nrecord: {fields_at: {free_volume: 0.4}}", "is not reached"),
    ],
)
def test_what_cannot_be_is_refused_with_its_key(
    text: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("z.npy", np.random.default_rng(0).random((12, 12)))
    assert words in refused(text, tmp_path / "study.yaml")


def test_a_period_is_one_pixel_longer_than_its_nodes(tmp_path: Path) -> None:
    """A text with coordinates gives the length between the outer nodes."""
    z = np.random.default_rng(0).random((6, 6))
    rows = [f"{0.5 * i} {0.5 * j} {z[i, j]}" for i in range(6) for j in range(6)]
    (tmp_path / "z.xyz").write_text("\n".join(rows))
    text = "surface: {{file: z.xyz, periodic: {}}}"
    assert pytest.approx(2.5) == loads(text.format("false"), tmp_path / "s.yaml").cases()[0].L
    assert pytest.approx(3.0) == loads(text.format("true"), tmp_path / "s.yaml").cases()[0].L
    with pytest.raises(StudyError, match="a period of 3"):
        loads("surface: {file: z.xyz, L: 2.5, periodic: true}", tmp_path / "s.yaml").cases()


def test_the_kernels_of_a_study_are_those_of_the_half_spaces():
    assert set(get_args(FreeKernel) + get_args(PeriodicKernel)) == set(KERNELS)
    assert set(get_args(FreeKernel)) == {name for name, kernel in KERNELS.items() if kernel.coefficients}
