"""What a figure needs is what it draws: from those cases alone it is the same figure as from all."""

from pathlib import Path

import numpy as np
import pytest

from roughvol.campaign import one_case
from roughvol.plotting import needed
from roughvol.reproduction.figures.registry import FIGURES
from roughvol.store import dataset
from roughvol.study import load, loads
from tests.kit import said

TEXT = """
name: some
surface: {D: [2.1, 2.3, 2.7], m: [2, 3, 4], seeds: 2}
sweep: {steps: 3}
record:
  heights: true
  fields_at: last
  box_counting: {at: last}
  volume_density: {bins: 9, at: last}
"""


@pytest.fixture(scope="module")
def parts() -> dict[str, dataset.Dataset]:
    return {case.id: one_case.run_case(case) for case in loads(TEXT).cases()}


@pytest.fixture(scope="module")
def whole(parts: dict[str, dataset.Dataset]) -> dataset.Dataset:
    return dataset.combine(list(parts.values()), {})


def drawn(figure: object) -> list[object]:
    """Everything in a figure that comes from data."""
    content: list[object] = []
    for ax in figure.axes:  # type: ignore[attr-defined]
        content += [line.get_xydata() for line in ax.lines]
        content += [image.get_array().filled(-1.0) for image in ax.images]
        content += [collection.get_offsets() for collection in ax.collections]
        content += [text.get_text() for text in ax.texts] + [ax.get_title(), ax.get_xlabel()]
    return content


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_of_the_cases_needed_is_the_figure(
    name: str, parts: dict[str, dataset.Dataset], whole: dataset.Dataset
) -> None:
    ids = needed([name], loads(TEXT).cases())
    assert 0 < len(ids) < len(parts)
    few = dataset.combine([parts[id] for id in ids], {})
    one, other = drawn(FIGURES[name](whole)), drawn(FIGURES[name](few))
    assert len(one) == len(other) > 0
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


def test_figures_together_need_the_cases_of_each() -> None:
    cases = loads(TEXT).cases()
    together = needed(["fig04a", "fig04b"], cases)
    assert set(together) == {*needed(["fig04a"], cases), *needed(["fig04b"], cases)}
    assert list(together) == [case.id for case in cases if case.id in together]


def test_run_computes_what_the_figures_need_and_then_the_rest(tmp_path: Path) -> None:
    (tmp_path / "some.yaml").write_text(TEXT)
    out = tmp_path / "run"
    run = ("run", tmp_path / "some.yaml", "--out", out, "--jobs", "1")
    said(*run, "--figures", "fig05, fig08")
    cases = load(tmp_path / "some.yaml").cases()
    assert {path.stem for path in (out / "cases").glob("*.nc")} == set(needed(["fig05", "fig08"], cases))
    said(*run)
    assert len(list((out / "cases").glob("*.nc"))) == len(cases)
    # asked for less again, it keeps what is there
    said(*run, "--figures", "fig08")
    assert dataset.read(out / "study.nc").sizes["m"] == 3
