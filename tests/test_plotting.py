"""Figures from Python: by name, of one run or several, shown by a notebook."""

from pathlib import Path

import numpy as np
import pytest

import roughvol
from roughvol.store import dataset
from roughvol.store.dataset import Dataset


@pytest.fixture(scope="module")
def pressed() -> Dataset:
    heights = np.random.default_rng(0).normal(size=(17, 17))
    return roughvol.press(heights, L="500 um", E="10 MPa", to={"pressure": "0.5 MPa"}, steps=4)


def test_a_figure_is_drawn_from_a_dataset_a_file_a_folder_and_what_press_returns(
    small_study: Path, pressed: Dataset
) -> None:
    for results in (dataset.read(small_study), small_study, str(small_study.parent), pressed):
        assert roughvol.plot(results, "v_of_p").axes[0].lines


def test_runs_are_overlaid_and_named(pressed: Dataset) -> None:
    figure = roughvol.plot({"dry": pressed, "wet": pressed}, "gap_of_p")
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["dry", "wet"]


def test_runs_whose_names_have_commas_are_told_apart_below_the_figure(pressed: Dataset) -> None:
    figure = roughvol.plot({"dry, E = 5 MPa": pressed, "dry, E = 10 MPa": pressed}, "v_of_p")
    notes = [text.get_text().replace("\n", " ") for text in figure.figure.texts]
    assert any(note.startswith("Runs dry, E = 5 MPa; dry, E = 10 MPa. ") for note in notes), notes


@pytest.mark.parametrize("length", [45, 51])
def test_long_names_do_not_cut_a_formula(small_study: Path, length: int) -> None:
    figure = roughvol.plot({"a " * (length // 2): small_study, "b " * (length // 2): small_study}, "v_of_p")
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert any("\n" in label for label in labels)
    assert all(line.count("$") % 2 == 0 for label in labels for line in label.splitlines())


@pytest.mark.filterwarnings("ignore:Glyph")
@pytest.mark.parametrize("letter", ["W", "a", "接"])
def test_a_long_name_stays_within_the_figure(small_study: Path, letter: str) -> None:
    figure = roughvol.plot({letter * 100: small_study, letter * 99: small_study}, "v_of_p")
    (note,) = (text for text in figure.texts if text.get_text().startswith("Runs"))
    assert note.get_window_extent().x1 < figure.bbox.x1


def test_a_notebook_shows_the_figure(pressed: Dataset) -> None:
    assert roughvol.plot(pressed)._repr_png_().startswith(b"\x89PNG")
