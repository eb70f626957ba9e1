"""The picture of a surface shows its heights, in a unit that can be read, with its highest point marked."""

import numpy as np
import pytest
from matplotlib.axes import Axes

from roughvol.report.figures import surface_picture
from roughvol.surfaces.surface import Surface

HEIGHTS = np.random.default_rng(0).normal(size=(20, 30))
HEIGHTS[3, 25] = 30.0


def _drawn(surface: Surface, title: str = "a map") -> list[Axes]:
    """Return the axes of a picture that is drawn without its layout, which takes most of the time."""
    figure = surface_picture.look(surface, "um", title)
    figure.set_layout_engine(None)
    figure.draw_without_rendering()
    return figure.axes


@pytest.fixture(scope="module")
def axes() -> list[Axes]:
    figure = surface_picture.look(Surface(HEIGHTS, 2.0), "um", "a map")
    figure.draw_without_rendering()
    return figure.axes


def test_the_profiles_run_through_the_highest_point(axes: list[Axes]) -> None:
    *_, along_x, along_y = axes
    z = HEIGHTS - HEIGHTS.mean()
    x, profile = along_x.lines[1].get_data()
    assert np.allclose(x, 2.0 * np.arange(20))
    assert np.allclose(profile, z[:, 25])
    assert np.allclose(along_y.lines[1].get_data(), (2.0 * np.arange(30), z[3]))
    assert (along_x.get_xlabel(), along_y.get_xlabel()) == ("$x$ [µm]", "$y$ [µm]")
    assert "50$ µm" in along_x.get_title()


def test_the_map_has_x_across_and_its_colours_ignore_one_spike(axes: list[Axes]) -> None:
    plan, *_ = axes
    (image,) = plan.images
    assert np.allclose(image.get_array(), (HEIGHTS - HEIGHTS.mean()).T)
    assert image.get_extent() == [-1.0, 39.0, -1.0, 59.0]
    assert image.get_clim()[1] < 15.0


def test_the_histogram_counts_every_node(axes: list[Axes]) -> None:
    _, _, histogram, *_ = axes
    assert sum(bar.get_height() for bar in histogram.patches) == HEIGHTS.size


@pytest.mark.parametrize(
    ("unit", "size", "labels"),
    [
        ("m", 1e-6, ("$x$ [µm]", "$z$ [µm]")),
        ("mm", 1.0, ("$x$ [mm]", "$z$ [mm]")),
        ("m", 1e-9, ("$x$ [nm]", "$z$ [nm]")),
        (None, 1e-9, ("$x$ [length]", "$z$ [length]")),
    ],
)
def test_lengths_are_drawn_in_a_unit_that_can_be_read(unit: str | None, size: float, labels: tuple[str, str]) -> None:
    *_, along_x, _ = surface_picture.look(Surface(HEIGHTS * size, 2.0 * size), unit, "a map").axes
    assert (along_x.get_xlabel(), along_x.get_ylabel()) == labels


@pytest.mark.parametrize("shape", [(60, 8), (8, 60)])
def test_long_maps_and_names_that_look_like_mathematics_are_drawn(shape: tuple[int, int]) -> None:
    assert _drawn(Surface(np.random.default_rng(0).normal(size=shape), 1.0), "a $b_$ scan_$2.npy")


def test_a_flat_surface_can_be_looked_at() -> None:
    assert len(_drawn(Surface(np.zeros((4, 5)), 1.0))) == 5
