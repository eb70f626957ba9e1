"""The figure of the power spectral density: lines of the dataset, and the law of the study."""

from pathlib import Path

import numpy as np
import pytest

from roughvol.campaign.execution import run
from roughvol.campaign.one_case import Context, run_case
from roughvol.errors import DatasetError
from roughvol.plotting import needed
from roughvol.report.figures import content
from roughvol.report.figures.registry import FIGURES
from roughvol.store import dataset
from roughvol.study import loads
from roughvol.surfaces.waves import density

TEXT = """
name: waves
surface: {H: [0.3, 0.8], rolloff: 4, cut: 12, n: [16, 32], L: 100 um, seeds: 3, sides: periodic, phases: random}
sweep: {steps: 0}
"""


def results(text: str) -> dataset.Dataset:
    study = loads(text)
    parts = [run_case(case, Context(study=study.stored())) for case in study.cases()]
    return dataset.combine(parts, parts[0].attrs)


def test_the_whole_surface_of_a_list_of_regions_has_its_waves(tmp_path: Path) -> None:
    study = loads(TEXT.replace("[0.3, 0.8]", "0.8") + "record: {psd: true, region: [none, interior]}")
    run(study, out=tmp_path, jobs=1)
    stored = dataset.read(tmp_path / "study.nc")
    whole, interior = (part.dataset for part in content.parts([("waves", stored)]))
    for part, first in ((whole, 1.0), (interior, 2.0)):
        line = FIGURES["psd"](part).axes[0].lines[0]
        np.testing.assert_allclose(line.get_xdata()[:4], first * np.arange(1, 5), rtol=1e-12)


def test_lines_are_the_means_of_the_finest_grid_and_the_law() -> None:
    ds = results(TEXT + "record: {psd: true}")
    figure = FIGURES["psd"](ds)
    left, right = figure.axes
    assert len(left.lines) == 4
    assert len(right.lines) == 2
    for line, law, D in zip(left.lines[::2], left.lines[1::2], (2.2, 2.7), strict=True):
        wanted = ds["psd"].sel(D=D, m=5).mean("seed").values
        np.testing.assert_allclose(line.get_ydata()[:11], wanted[:11])
        assert np.isnan(line.get_ydata()[-1])  # nothing but rounding beyond the cut
        spectrum = loads(TEXT).cases()[0].spectrum
        np.testing.assert_allclose(law.get_ydata()[:11], density(spectrum, 3 - D, 100.0, np.arange(1, 12)))
        np.testing.assert_allclose(law.get_ydata()[:10], wanted[:10], rtol=0.2)
    titles = [axes.get_legend().get_title().get_text() for axes in (left, right)]
    assert titles == ["$m = 5$; mean of 3 surfaces\ndashed: the law of the study", "$m = 5$; mean of 3 surfaces"]
    assert "um" not in left.get_ylabel()
    assert "µm" in left.get_ylabel()


def test_it_needs_the_record_and_is_found_by_name() -> None:
    ds = results(TEXT)
    with pytest.raises(DatasetError, match=r"add record: \{psd: true\}"):
        FIGURES["psd"](ds)
    cases = loads(TEXT).cases()
    assert set(needed(["psd"], cases)) == {case.id for case in cases if case.m == 5}


def test_midpoint_surfaces_have_no_law() -> None:
    ds = results("surface: {D: 2.3, m: 4, seeds: 2}\nsweep: {steps: 0}\nrecord: {psd: true}")
    assert len(FIGURES["psd"](ds).axes[0].lines) == 1


@pytest.mark.parametrize("region", ["", ", region: interior"])
def test_the_deformed_surface_is_drawn_beside_the_undeformed_one(region: str) -> None:
    text = "surface: {D: [2.3, 2.6], m: 4, seeds: 2, sides: periodic}\nsweep: {steps: 2, to: {pressure: 1}}\n"
    ds = results(f"{text}record: {{psd: {{at: {{pressure: [0.5, 1]}}}}{region}}}")
    figure = FIGURES["psd"](ds)
    left, right = figure.axes
    assert (len(left.lines), len(right.lines)) == (4, 4)
    of_curves = {(point["panel"], point["D"], str(point["curve"]).partition(", ")[2]) for point in content.data(figure)}
    assert of_curves == {(panel, D, words) for panel in (1, 2) for D in (2.3, 2.6) for words in ("", "pressure 1")}
    wanted = ds["psd_loaded"].sel(D=2.6, m=4).isel(psd_at=1).mean("seed").values
    np.testing.assert_allclose(left.lines[3].get_ydata(), wanted)
    assert left.lines[3].get_color() == left.lines[2].get_color()
    assert left.lines[3].get_xdata()[0] == pytest.approx(2.0 if region else 1.0)
    assert "dotted: pressure 1" in left.get_legend().get_title().get_text()


@pytest.mark.parametrize(
    ("sweep", "at", "words", "lines"),
    [
        ("[{steps: 1, to: {pressure: 1}}, {steps: 1, to: {pressure: 0.5}}]", "last", "end of the sweep", 2),
        ("{steps: 2, to: {percolation: x}}", "{contact_area: 0.4}", "contact area 0.4, where all surfaces reach it", 1),
    ],
)
def test_a_state_of_a_later_leg_is_drawn_and_one_that_is_not_reached_is_named(
    sweep: str, at: str, words: str, lines: int
) -> None:
    ds = results(f"surface: {{D: 2.2, m: 4, seeds: 2}}\nsweep: {sweep}\nrecord: {{psd: {{at: {at}}}}}")
    left, _ = FIGURES["psd"](ds).axes
    assert sum(bool(np.isfinite(line.get_ydata()).any()) for line in left.lines) == lines
    assert left.get_legend().get_title().get_text().endswith(f"dotted: {words}")


def test_the_title_of_one_surface_is_that_of_the_load_alone(here: Path) -> None:
    np.save("z.npy", np.random.default_rng(0).normal(size=(16, 16)))
    ds = results("surface: {file: z.npy, L: 1, sides: periodic}\nsweep: {steps: 2}\nrecord: {psd: {at: last}}")
    left, _ = FIGURES["psd"](ds).axes
    assert left.get_legend().get_title().get_text() == "dotted: end of the sweep"
