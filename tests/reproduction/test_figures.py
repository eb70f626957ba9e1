"""Every figure draws what the dataset holds: curves, bands, fields and images are compared with the stored numbers."""

import json
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from drawn import shown
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.interpolate import PchipInterpolator

import roughvol
from roughvol.campaign import one_case
from roughvol.errors import DatasetError
from roughvol.gap.free_volume import volume_density
from roughvol.observables.variables import VARIABLES
from roughvol.report.figures import curves
from roughvol.report.figures.families import Family, mean_and_band
from roughvol.report.figures.families import curves as curves_of
from roughvol.reproduction.figures.element_volumes import ENOUGH, merged
from roughvol.reproduction.figures.registry import FIGURES
from roughvol.store.dataset import combine
from roughvol.store.record_key import record_key
from roughvol.study import Study, loads
from roughvol.surfaces.midpoint import random_midpoint_displacement

pytestmark = pytest.mark.layout  # every figure is saved once with its layout

NAMES = list(FIGURES)
CURVES = {
    "fig04a": ("D", "mean_pressure", "contact_area_fraction"),
    "fig05": ("D", "separation", "free_volume"),
    "fig06a": ("D", "mean_pressure", "free_volume"),
    "fig06b": ("D", "contact_area_fraction", "free_volume"),
    "fig04b": ("m", "mean_pressure", "contact_area_fraction"),
    "fig07a": ("m", "mean_pressure", "free_volume"),
    "fig07b": ("m", "contact_area_fraction", "free_volume"),
}
THRESHOLDS = (0.0, 0.2, 1.0)
SIDE = 10.0
RECORD = """
sweep: {steps: 4, to: mean-plane}
record:
  heights: true
  fields_at: last
  box_counting: {at: last, thresholds: [0, 0.2, 1]}
  volume_density: {bins: 12, at: last}
"""


def _made(D: Sequence[float], m: Sequence[int], seeds: int = 1) -> xr.Dataset:
    """Return a run with everything recorded."""
    return _run(f"{{D: {list(D)}, m: {list(m)}, L: {SIDE}, seeds: {seeds}}}")


def _run(surface: str) -> xr.Dataset:
    study: Study = loads(f"name: run\nsurface: {surface}\n{RECORD}")
    return combine([one_case.run_case(case) for case in study.cases()], {})


def _with_exponent(ds: xr.Dataset) -> xr.Dataset:
    """Return a run whose A*/p* is δ^0.37, but for a factor by D and seed."""
    slope = 0.2 * 2.0 ** (-0.37 * ds["m"]) / (ds["D"] - 1.0) * (1.0 + 0.1 * ds["seed"])
    area = (slope * ds["mean_pressure"]).transpose(*ds["mean_pressure"].dims)
    return ds.assign(contact_area_fraction=area)


@pytest.fixture(scope="module")
def study() -> xr.Dataset:
    return _made(D=(2.1, 2.3, 2.9), m=(3, 4, 5), seeds=2)


@pytest.fixture(scope="module")
def single(study: xr.Dataset) -> xr.Dataset:
    return study.isel(seed=[0])


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Return a run of two height files, of 17 x 11 nodes."""
    folder = tmp_path_factory.mktemp("files")
    paths = [folder / name for name in ("_turned $1.npy", "ground.npy")]
    for seed, path in enumerate(paths):
        np.save(path, random_midpoint_displacement(2.4, 4, seed=seed).heights[:, :11])
    return _run(f"{{files: {json.dumps(list(map(str, paths)))}, L: {SIDE}, sides: free}}")


def _line(fig: Figure, label: str, axes: int = 0) -> np.ndarray:
    (line,) = [line for line in fig.axes[axes].lines if line.get_label() == label]
    return np.array(line.get_data(), dtype=float)


def _title(fig: Figure, axes: int = 0) -> str:
    return fig.axes[axes].get_legend().get_title().get_text()


def test_the_figures_are_those_of_the_paper() -> None:
    assert len(NAMES) == 17
    for name in NAMES:
        assert FIGURES[name].name == name
        assert f"Fig. {name[3:].lstrip('0')}" in str(FIGURES[name].draw.__doc__)


def test_what_figures_need_is_what_datasets_store(study: xr.Dataset) -> None:
    assert {variable for figure in FIGURES.values() for variable in figure.needs} <= set(VARIABLES)
    for name, variable in study.data_vars.items():  # and the datasets of these tests are built like the stored ones
        assert list(variable.dims) == VARIABLES[str(name)].dims.replace("...", "D m seed").split()


@pytest.mark.parametrize("name", NAMES)
def test_every_figure_draws_with_labelled_axes(study: xr.Dataset, name: str) -> None:
    before = study.copy(deep=True)
    fig = FIGURES[name](study)
    assert shown(fig) > 1
    assert fig.axes[0].get_ylabel()
    assert all(axes.get_xlabel() and axes.get_ylabel() for axes in fig.axes if len(fig.axes) == 1)
    assert any(axes.get_xlabel() for axes in fig.axes)
    assert study.identical(before)


@pytest.mark.parametrize(("name", "by", "x", "y"), [(name, *what) for name, what in CURVES.items()])
def test_a_single_seed_is_drawn_as_stored(single: xr.Dataset, name: str, by: str, x: str, y: str) -> None:
    fig = FIGURES[name](single)
    values = [2.1, 2.9] if name == "fig05" else single[by].values
    for value in values:
        case = single.isel(seed=0).sel({by: value} | ({"m": 5} if by == "D" else {"D": 2.3}))
        drawn = _line(fig, f"${by} = {value:g}$")
        np.testing.assert_array_equal(drawn, case[[x, y]].to_array().values)
    assert len(fig.axes[0].lines) == len(values) + (name == "fig05")
    assert sum(line.get_marker() != "None" for line in fig.axes[0].lines) == len(values)
    assert _title(fig) == ("$m = 5$" if by == "D" else "$D = 2.3$")


def test_a_mean_over_curves_with_steps_of_one_abscissa_goes_on_from_the_last_of_them() -> None:
    """A* stays 0 near first touch, and p* where a region is unloaded."""
    x, y = np.array([0.0, 0.0, 1.0, 2.0]), np.array([3.0, 2.0, 1.0, 0.5])
    at, mean, _ = mean_and_band([(x, y), (x, y)], 5)
    np.testing.assert_allclose(mean, [3.0, *PchipInterpolator(x[1:], y[1:])(at[1:])])


def test_a_mean_over_free_volume_ends_at_the_first_state_of_full_contact() -> None:
    load, volume = np.array([1.0, 2.0, 3.0, 9.0]), np.array([2.0, 1.0, 0.0, 0.0])
    data = xr.Dataset({"load": (("seed", "step"), [load, load]), "volume": (("seed", "step"), [volume, volume])})
    at, mean, _ = mean_and_band(curves_of(Family("", 0.0, {}, data), "volume", "load"), 5)
    np.testing.assert_allclose(mean, PchipInterpolator(volume[2::-1], load[2::-1])(at))


@pytest.mark.parametrize(("name", "by", "x", "y"), [(name, *CURVES[name]) for name in ("fig05", "fig07b")])
def test_seeds_are_averaged_over_the_range_they_share(study: xr.Dataset, name: str, by: str, x: str, y: str) -> None:
    fig = FIGURES[name](study)
    value = study[by].values[-1]
    cases = study.sel({by: value} | ({"m": 5} if by == "D" else {"D": 2.3}))
    pairs = [case[[x, y]].sortby(case[x]).to_array().values for case in (cases.isel(seed=0), cases.isel(seed=1))]
    abscissa, mean = _line(fig, f"${by} = {value:g}$")
    assert abscissa[0] == max(pair[0][0] for pair in pairs)
    assert abscissa[-1] == min(pair[0][-1] for pair in pairs)
    rows = np.array([PchipInterpolator(*pair)(abscissa) for pair in pairs])
    np.testing.assert_allclose(mean, rows.mean(axis=0), rtol=1e-12)
    band = fig.axes[0].collections[-1].get_paths()[0].vertices
    spread = np.abs(rows[0] - rows[1]) / np.sqrt(2.0)  # standard deviation of two
    for at in (0, 77, 199):
        ends = band[band[:, 0] == abscissa[at], 1]
        np.testing.assert_allclose([ends.min(), ends.max()], [mean[at] - spread[at], mean[at] + spread[at]], rtol=1e-12)
    faint = [np.array(line.get_data()) for line in fig.axes[0].lines if line.get_linewidth() < 0.5]
    assert all(any(np.array_equal(pair, line[:, line[0].argsort()]) for line in faint) for pair in pairs)
    marked = [line for line in fig.axes[0].lines if line.get_marker() != "None"]
    assert not marked  # a marker is a computed state
    assert "mean of 2 surfaces, band ± 1 std. dev." in _title(fig)


def test_a_mean_is_seen_among_the_lines_of_hundreds_of_surfaces(study: xr.Dataset) -> None:
    seeds = np.arange(400)
    one = study.sel(D=[2.3], m=[5]).isel(seed=0, drop=True)
    many = one.expand_dims(seed=seeds).transpose("D", "m", "seed", ...).copy()
    many["free_volume"] = many["free_volume"] * xr.DataArray(1.0 + 0.5 * np.linspace(-1.0, 1.0, 400), dims="seed")
    fig = FIGURES["fig06a"](many)
    (ax,) = fig.axes
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    grey = np.asarray(canvas.buffer_rgba())[::-1, :, :3].mean(axis=2)
    x, y = _line(fig, "$D = 2.3$")

    def tone(share: float) -> float:
        rows = ax.transData.transform(np.transpose([x, share * y]))[20:-20].astype(int)
        return float(np.mean([grey[row, column] for column, row in rows]))

    assert tone(1.0) < tone(1.1) - 100.0


def test_seeds_without_a_common_range_have_no_mean(study: xr.Dataset) -> None:
    apart = study.copy()
    apart["mean_pressure"] = study["mean_pressure"] + 1e3 * study["seed"]
    fig = FIGURES["fig06a"](apart)
    assert _line(fig, "$D = 2.1$").size == 0
    assert shown(fig, layout=False) > 1


def test_fig04b_finds_the_exponent(study: xr.Dataset) -> None:
    study = _with_exponent(study)
    fig = FIGURES["fig04b"](study)
    labels = [str(line.get_label()) for line in fig.axes[1].lines[-3:]]
    assert labels == ["fit $0.37$", "paper $0.37$", "Persson $0.30$"]
    points = {float(line.get_xdata()[0]): line.get_ydata() for line in fig.axes[1].lines[:-3]}
    assert sorted(points) == [2.0**-5, 2.0**-4, 2.0**-3]
    stored = (study["contact_area_fraction"] / study["mean_pressure"]).sel(D=2.3).isel(step=0)
    for m in (3, 4, 5):
        np.testing.assert_allclose(points[2.0**-m], stored.sel(m=m), rtol=1e-12)
    shared = study["mean_pressure"].sel(D=2.3).max("step").min()
    assert f"{float(shared):.2f}" in fig.axes[1].get_ylabel()
    assert "$m = 3$ to $5$" in _title(fig, 1)


def test_fig04b_fits_the_four_finest_and_the_paper_only_at_its_D() -> None:
    ds = _with_exponent(_made(D=[2.5], m=[1, 2, 3, 4, 5]))
    coarse = ds["contact_area_fraction"].where(ds["m"] > 1, 7.0 * ds["contact_area_fraction"])
    fig = FIGURES["fig04b"](ds.assign(contact_area_fraction=coarse))
    assert [str(line.get_label()) for line in fig.axes[1].lines[-2:]] == ["fit $0.37$", "Persson $0.50$"]
    assert "$m = 2$ to $5$" in _title(fig, 1)


def test_fig04b_draws_sweeps_of_one_step(study: xr.Dataset) -> None:
    assert shown(FIGURES["fig04b"](study.isel(step=[-1])), layout=False) > 1


def test_fig05_has_the_rigid_line(study: xr.Dataset) -> None:
    x, y = _line(FIGURES["fig05"](study), r"$V^{\ast} = d/\sigma$")
    np.testing.assert_array_equal(x, y)
    assert x[-1] == study["separation"].sel(m=5, D=[2.1, 2.9]).max()


def test_fig01_colours_the_nodes_in_the_order_of_the_recursion(study: xr.Dataset) -> None:
    fig = FIGURES["fig01"](study)
    heights = study["heights"].sel(D=2.3, m=5, seed=0).values[::8, ::8]
    for axes, nodes in zip(fig.axes[:4], (5, 9, 13, 25), strict=True):
        offsets = np.concatenate([layer.get_offsets() for layer in axes.collections]).astype(int)
        assert len({tuple(offset) for offset in offsets.tolist()}) == len(offsets) == nodes
        colours = np.concatenate([np.asarray(layer.get_array()) for layer in axes.collections])
        np.testing.assert_array_equal(colours, heights[offsets[:, 0], offsets[:, 1]])
    assert [len(axes.texts) for axes in fig.axes[:4]] == [4 + 5, 12 + 9, 16, 4 * 4 + 8 * 3]  # arrows, and letters


def test_reliefs_show_every_node_on_one_vertical_scale(single: xr.Dataset) -> None:
    fig = FIGURES["fig03"](single)
    assert len({axes.get_zlim() for axes in fig.axes}) == 1
    facets = [len(axes.collections[0].get_facecolor()) for axes in fig.axes]
    assert facets == [4**3, 4**4, 4**5]
    low, high = fig.axes[0].get_zlim()
    heights = single["heights"].sel(D=2.3) / SIDE
    np.testing.assert_allclose([low, high], [heights.min(), heights.max()], rtol=1e-12)


def test_a_flat_surface_has_a_relief(single: xr.Dataset) -> None:
    assert shown(FIGURES["fig02"](single.assign(heights=0.0 * single.heights)), layout=False) > 1


def test_fig02_takes_low_middle_and_high_D_with_their_slopes() -> None:
    ds = _made(D=[2.1, 2.2, 2.5, 2.8, 2.9], m=[3])
    titles = [axes.get_title() for axes in FIGURES["fig02"](ds).axes]
    slopes = ds["Sdq"].sel(D=[2.1, 2.5, 2.9], m=3).isel(seed=0).values
    ends = [f"$D = {D:g}$, $m = 3$, $S_{{dq}} = {slope:.3g}$" for D, slope in zip((2.1, 2.5, 2.9), slopes, strict=True)]
    assert titles == ends
    assert "dq" not in FIGURES["fig02"](ds.drop_vars("Sdq")).axes[0].get_title()


def test_fig08_deforms_the_surface_by_the_gap(study: xr.Dataset) -> None:
    case = study.sel(D=2.3, m=5, seed=0)
    fig = FIGURES["fig08"](study)
    before = (case["heights"] - case["heights"].mean()) / case["Sq"]
    after = before.max() - case["indentation"].isel(step=-1) - case["gap"].isel(field_at=0)
    low, high = fig.axes[1].get_zlim()
    np.testing.assert_allclose([low, high], [min(before.min(), after.min()), before.max()], rtol=1e-12)
    vertices = fig.axes[1].collections[0]
    blue = mpl.colors.to_rgba("#08306b")
    contact = (case["gap"].isel(field_at=0).values == 0.0)[:-1, :-1]
    colours = np.asarray(vertices.get_facecolor())
    assert np.isclose(colours, blue).all(axis=1).sum() == contact.sum() > 0


def test_fig09_maps_the_element_volumes(study: xr.Dataset) -> None:
    image = FIGURES["fig09"](study).axes[0].images[0]
    case = study.sel(D=2.3, m=5, seed=0)
    gap = case["gap"].isel(field_at=0).values
    volumes = gap * float(case["Sq"]) * (SIDE / 32) ** 2
    np.testing.assert_allclose(image.get_array(), np.where(gap == 0.0, -1.0, volumes).T, rtol=1e-12)
    under = image.cmap(image.norm(-1.0))
    assert under == mpl.colors.to_rgba("#08306b")
    assert tuple(image.get_extent()) == (-1 / 64, 65 / 64, -1 / 64, 65 / 64)


def test_fig09_and_fig10_of_full_contact(study: xr.Dataset) -> None:
    full = study.assign(gap=0.0 * study["gap"])
    assert shown(FIGURES["fig09"](full), layout=False) > 1
    assert all(np.all(axes.images[0].get_array() == 1) for axes in FIGURES["fig10"](full).axes)


@pytest.mark.parametrize("name", ["fig09", "fig10"])
@pytest.mark.parametrize("rows", [{"x": slice(2)}, {"y": slice(2)}])
def test_maps_of_few_rows_fit_a_page(study: xr.Dataset, name: str, rows: dict[str, slice]) -> None:
    """The map of 3 × 60 nodes was a figure 45 inches tall."""
    fig = FIGURES[name](study.isel(rows))
    assert 1.5 < fig.get_figheight() < 11.0
    assert shown(fig, layout=False) > 1


@pytest.mark.parametrize("thresholds", [THRESHOLDS, None])
def test_fig10_blackens_from_contact_to_everything(study: xr.Dataset, thresholds: tuple[float, ...] | None) -> None:
    ds = study if thresholds else study.drop_dims("threshold")
    shares = thresholds or (0.0, 0.1, 0.25, 0.5, 1.0)
    gap = study["gap"].sel(D=2.3, m=5, seed=0).isel(field_at=0).values
    fig = FIGURES["fig10"](ds)
    of_region = FIGURES["fig10"](ds.assign_attrs(region="y/L_y 0 to 0.5"))  # the panels show the whole map
    assert ["in the region" in one.get_suptitle() for one in (fig, of_region)] == [False, True]
    panels = [np.asarray(axes.images[0].get_array()).T for axes in fig.axes]
    assert len(panels) == len(shares)
    for black, share in zip(panels, shares, strict=True):
        np.testing.assert_array_equal(black == 1, gap <= share * gap.max() * (1 + 1e-12))
    fig.set_layout_engine(None)
    fig.draw_without_rendering()
    labelled = [bool(ax.get_xlabel()) and ax.get_xticklabels()[0].get_visible() for ax in fig.axes]
    assert labelled == [False] * (len(shares) - 3) + [True] * 3  # two rows of three: at the end of the column


@pytest.mark.parametrize(
    ("name", "variable", "r"), [("fig11a", "box_count", "r"), ("fig11b", "local_dimension", "r_mid")]
)
def test_fig11_draws_the_box_counting(study: xr.Dataset, name: str, variable: str, r: str) -> None:
    fig = FIGURES[name](study)
    case = study[variable].sel(D=2.3, m=5, seed=0).isel(box_at=0)
    for share in THRESHOLDS:
        sides, values = _line(fig, f"${share:g}$")
        np.testing.assert_array_equal(values, case.sel(threshold=share).dropna(r))
        np.testing.assert_array_equal(sides, case.sel(threshold=share).dropna(r)[r])
    everything = _line(fig, "$1$")[1]
    np.testing.assert_allclose(everything, 2.0 if name == "fig11b" else 4.0 ** np.arange(5, -1, -1), rtol=1e-12)


def _bins(middles: Sequence[float]) -> list[float]:
    """Return the ends of bins by their middles; the first begins at 0."""
    bins = [0.0]
    for middle in middles:
        bins.append(2.0 * middle - bins[-1])
    return bins


def _joined(edges: np.ndarray, density: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Return the share of the stored density between the ends of the bins that a line was drawn on."""
    below = np.append(0.0, np.cumsum(density * np.diff(edges)))
    bins = _bins(line[0])
    assert np.isclose(np.array(bins)[:, None], edges, rtol=1e-9).any(axis=1).all()  # ends of stored bins
    shares: np.ndarray = np.diff(np.interp(bins, edges, below))
    np.testing.assert_allclose(line[1] * np.diff(bins), shares, rtol=1e-9)
    return shares


def test_fig12a_keeps_the_share_of_the_stored_bins_at_m_7() -> None:
    ds = _made(D=[2.2, 2.8], m=[3, 5, 6]).assign_coords(m=[3, 7, 8])
    fig = FIGURES["fig12a"](ds)
    assert _title(fig) == "last step\n$m = 7$"
    case = ds.sel(D=2.8, m=7).isel(seed=0, density_at=0)
    drawn = _line(fig, "$D = 2.8$")
    shares = _joined(case["volume_density_edges"].values, case["volume_density"].values, drawn)
    assert shares.sum() == pytest.approx(1.0, rel=1e-12)
    elements = int((case["gap"].sel(x=slice(None), y=slice(None)) > 0.0).sum())
    assert shares.min() * elements >= ENOUGH - 1e-9


@pytest.mark.parametrize("elements", [40, 300, 5000])
@pytest.mark.parametrize("log", [True, False])
def test_densities_neither_comb_nor_block(elements: int, log: bool) -> None:
    volumes = np.random.default_rng(elements).gamma(2.0, 1.0, elements)
    counted = volume_density(volumes[None], np.zeros((1, elements), bool), bins=50)
    ((v, f),) = merged(counted.edges, counted.density[None], float(elements), log=log)
    assert (f > 0.0).all()
    truth = v * np.exp(-v)
    assert np.abs(np.log(f / truth))[1:-1].max() < 3.0 / np.sqrt(min(ENOUGH, 0.5 * elements ** (2 / 3)))  # 3 deviations
    if log and len(v) > 3:
        assert np.diff(np.log10(v)).min() > 0.5 / 12
    if elements == 40:  # the stored bins are a comb
        assert (counted.density == 0.0).sum() > 10


def test_fig12b_line_of_means_has_slope_minus_one_for_similar_densities(single: xr.Dataset) -> None:
    shape, edges = np.linspace(2.0, 0.0, 12), np.linspace(0.0, 1.0, 13)
    shape /= np.sum(shape) / 12
    scale = 4.0 ** -single["m"]
    similar = single.assign(
        volume_density=xr.DataArray(shape, dims="bin") / scale + 0.0 * single["volume_density"],
        volume_density_edges=xr.DataArray(edges, dims="edge") * scale + 0.0 * single["volume_density_edges"],
    )
    fig = FIGURES["fig12b"](similar)
    assert r"stars: $(\overline{v}, \overline{f})$, slope $-1.00$" in _title(fig)
    (stars,) = [line for line in fig.axes[0].lines if line.get_marker() == "*"]
    np.testing.assert_allclose(stars.get_xdata() * stars.get_ydata(), stars.get_xdata()[0] * stars.get_ydata()[0])
    np.testing.assert_allclose(stars.get_xdata(), np.sum(shape * (edges[1:] + edges[:-1])) / 24 * scale, rtol=1e-12)
    assert np.all(_line(fig, "$m = 4$")[1] > 0.0)


def test_fig12_takes_the_last_state_that_was_reached(study: xr.Dataset) -> None:
    later = study.copy()
    for name in ("volume_density", "volume_density_edges"):
        later[name] = study[name] * np.nan
    unreached = 0 * study["density_at_step"] - 1
    later = later.assign_coords(density_at=["contact_area=0.9"]).assign(density_at_step=unreached)
    joined = {"data_vars": "minimal", "coords": "minimal", "compat": "override", "join": "outer"}
    both = xr.concat([study, later], "density_at", **joined)
    figures = [FIGURES["fig12a"](ds) for ds in (both, study)]
    np.testing.assert_array_equal(*[_line(fig, "$D = 2.1$") for fig in figures])
    assert {_title(fig).split("\n")[0] for fig in figures} == {"last step"}
    named = study.assign_coords(density_at=["pressure=0.5 MPa"])
    assert _title(FIGURES["fig12b"](named)).startswith("pressure=0.5 MPa\n")


def test_fields_are_those_of_the_state_nearest_the_contact_area_of_the_paper(study: xr.Dataset) -> None:
    area = study["contact_area_fraction"] * 0.0 + 0.05 * study["step"]  # A* = 0.1 at step 2
    parts = []
    for step, label in ((4, "last"), (-1, "contact_area=0.5"), (3, "step=3")):
        gap = study["gap"] * (np.nan if step < 0 else step)
        parts.append(study[["field_at_step"]].assign(gap=gap, field_at_step=0 * study["field_at_step"] + step))
        parts[-1] = parts[-1].assign_coords(field_at=[label])
    states = study.drop_dims("field_at").assign(xr.concat(parts, "field_at")).assign(contact_area_fraction=area)
    fig = FIGURES["fig09"](states)
    assert r"$A^{\ast} = 0.150$" in fig.axes[0].get_title()
    scale = float((study["gap"] * study["Sq"]).sel(D=2.3, m=5, seed=0).max()) * (SIDE / 32) ** 2
    assert fig.axes[0].images[0].get_array().max() == pytest.approx(3 * scale, rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_a_study_of_files_draws_by_case_or_says_why_not(files: xr.Dataset, name: str) -> None:
    ds = files
    if name in ("fig01", "fig03", "fig04b", "fig07a", "fig07b", "fig12b"):
        words = "needs surfaces made from D and m, and those of the dataset were read from files"
        assert FIGURES[name].missing(ds) == f"{name} {words}"
        return
    fig = FIGURES[name](ds)
    assert shown(fig, layout=False) > 1
    if name in (*CURVES, "fig12a"):
        assert {r"turned \$1.npy", "ground.npy"} <= {str(line.get_label()) for line in fig.axes[0].lines}


@pytest.mark.parametrize("name", NAMES)
def test_what_is_missing_is_named(study: xr.Dataset, name: str) -> None:
    assert FIGURES[name].missing(study) is None
    variable = FIGURES[name].needs[0]
    absent = study.drop_vars(variable)
    key = record_key(variable)
    lacks = f"{name} needs {variable}, which the run does not have"
    assert FIGURES[name].missing(absent) == lacks + (key and f" ({key})")
    with pytest.raises(DatasetError, match=f"{name} needs {variable}, which"):
        FIGURES[name](absent)
    unknown = study.assign({variable: study[variable] * np.nan})
    assert str(FIGURES[name].missing(unknown)).endswith("and no case of the dataset has a value of each")


def test_comparisons_need_something_to_compare(single: xr.Dataset) -> None:
    one_m, one_D = single.sel(m=[4]), single.sel(D=[2.3])
    for name, figure in FIGURES.items():
        by = figure.by
        assert figure.missing(one_m) == (f"{name} compares values of m, and the dataset has one" if by == "m" else None)
        assert figure.missing(one_D) == (f"{name} compares values of D, and the dataset has one" if by == "D" else None)
        lone = figure.missing(single.sel(D=[2.3], m=[4]))  # nothing is compared: the curve alone is worth drawing
        assert lone == (f"{name} compares values of m, and the dataset has one" if by == "m" else None)


def test_surfaces_without_contact_feed_the_first_three_figures(study: xr.Dataset) -> None:
    gallery = study[["heights", "Sdq"]]
    assert [name for name in NAMES if FIGURES[name].missing(gallery) is None] == ["fig01", "fig02", "fig03"]


def test_cases_that_are_not_there_yet_are_left_out(study: xr.Dataset) -> None:
    there = (study["D"] != 2.1) & ((study["D"] != 2.9) | (study["seed"] == 0))
    partial = study.assign({name: study[name].where(there) for name in ("mean_pressure", "free_volume")})
    fig = FIGURES["fig06a"](partial)
    assert [text.get_text() for text in fig.axes[0].get_legend().get_texts()] == ["$D = 2.3$", "$D = 2.9$"]
    assert "mean of 2 surfaces" in _title(fig)
    single = fig.axes[0].lines[-1]
    assert single.get_marker() != "None"
    stored = partial.sel(D=2.9, m=5, seed=0)
    np.testing.assert_array_equal(single.get_xydata(), stored[["mean_pressure", "free_volume"]].to_array().values.T)
    one = partial.where(partial["m"] == 4)
    assert FIGURES["fig07a"].missing(one) == "fig07a compares values of m, and the dataset has one"


def test_nothing_draws_with_pyplot() -> None:
    assert not [path for path in Path(roughvol.__path__[0]).rglob("*.py") if "pyplot" in path.read_text("utf-8")]


@pytest.mark.parametrize("log", [True, False])
def test_no_single_surface_falls_to_zero_on_a_logarithmic_axis(log: bool) -> None:
    ax = Figure().subplots()
    x = np.array([1.0, 2.0, 3.0])
    family: Any = SimpleNamespace(label="", look={"color": "k"})
    two = [(x, np.array([3.0, 2.0, 1.0])), (x, np.array([3.0, 1.0, 0.0]))]
    curves.plot(ax, [family], [two], ("", ""), "", common=True, log=log)
    single = [line.get_ydata() for line in ax.lines if line.get_linewidth() < 0.5]
    assert len(single) == 2
    assert bool(np.isnan(single[1][-1])) is log


def test_labels_carry_the_units_of_the_dataset(study: xr.Dataset) -> None:
    micro = study.assign_coords(L=study["L"].assign_attrs(units="um"))
    micro["Sq"].attrs["units"] = "um"
    micro["heights"].attrs["units"] = "um"
    fig09 = FIGURES["fig09"](micro)
    assert fig09.axes[1].get_ylabel() == "element volume $v$ [µm³]"
    assert "length" not in "".join(text.get_text() for text in fig09.findobj(mpl.text.Text))
    assert FIGURES["fig12a"](micro).axes[0].get_xlabel() == "element volume $v$ [µm³]"
    assert FIGURES["fig12b"](micro).axes[0].get_ylabel() == "probability density $f(v)$ [µm$^{-3}$]"
    milli = micro.assign(heights=(1e-3 * micro["heights"]).assign_attrs(units="mm"))
    relief, same = (FIGURES["fig02"](ds).axes[0] for ds in (micro, milli))
    assert relief.get_zlabel() == same.get_zlabel() == "$z$ [µm]"
    assert same.get_zlim() == pytest.approx(relief.get_zlim())
    assert "[µm]" in FIGURES["fig01"](micro).axes[-1].get_ylabel()
    nano = micro.copy()
    nano["Sq"] = micro["Sq"].assign_attrs(units="nm")
    assert FIGURES["fig09"](nano).axes[1].get_ylabel() == "element volume $v$ [nm µm²]"
    assert FIGURES["fig09"](study.copy(deep=True)).axes[1].get_ylabel() == "element volume $v$ [length³]"


@pytest.mark.parametrize("name", ["fig03", "fig09"])
def test_nothing_is_cut_off(single: xr.Dataset, name: str) -> None:
    fig = FIGURES[name](single)
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())[..., :3]
    edge = [image[:2], image[-2:], image[:, :2], image[:, -2:]]
    assert all((part == 255).all() for part in edge)


def test_the_line_of_the_paper_is_drawn_for_its_surfaces_alone(single: xr.Dataset, files: xr.Dataset) -> None:
    ds = single.sel(D=[2.1, 2.9], m=[4, 5]).assign_coords(m=[5, 7], L=100.0)
    ds["volume_density_edges"] = ds["volume_density_edges"] * 1e3

    def fulcrum(some: xr.Dataset) -> bool:
        return any(np.allclose(line.get_xdata(), 1.0) for line in FIGURES["fig12a"](some).axes[0].lines)

    assert fulcrum(ds)
    scaled = "name: other\nsurface: {D: [2.1, 2.9], m: [5, 7], L: 100.0, Sq: 0.5}\n"
    of_files = files.assign_coords(L=100.0).assign(volume_density_edges=1e3 * files["volume_density_edges"])
    in_um = ds.assign_coords(L=ds["L"].assign_attrs(units="um"))
    others = ds.assign_coords(L=500.0), in_um, ds.assign_coords(m=[5, 8]), ds.assign_attrs(study=scaled), of_files
    assert not any(map(fulcrum, others))


def _note(fig: Figure) -> str:
    return " ".join(fig.get_supxlabel().split())


def test_a_figure_says_whether_it_is_the_papers_or_whose_run_it_is(single: xr.Dataset, files: xr.Dataset) -> None:
    ds = single.sel(m=[4, 5]).assign_coords(m=[7, 8], L=100.0)
    run = "name: mine\nsurface: {D: [2.1, 2.3, 2.9], m: [7, 8], L: 100.0}\nsweep: {steps: 8}\n"
    ds = ds.assign_attrs(study=run)
    assert _note(FIGURES["fig05"](ds)) == "Fig. 5 of Paggi and He (2015), computed by the run mine."
    lone = _note(FIGURES["fig05"](ds.sel(D=[2.3], m=[8])))
    assert "Run mine: D = 2.3, m = 8, L = 100, one surface." in lone
    assert "D = 2.3, not 2.1, 2.9" in lone
    assert "1 of each, not 10" in _note(FIGURES["fig04a"](ds))
    more = ds.assign_attrs(study=run).isel(seed=[0] * 3).assign_coords(seed=[0, 1, 2])
    uneven = more.where((more["m"] == 7) | (more["seed"] == 0)).assign_attrs(more.attrs)
    assert "1 to 3 surfaces of each" in _note(FIGURES["fig04b"](uneven))
    other = ds.assign_attrs(study=run.replace("{steps: 8}", "{steps: 8, to: {pressure: 2}}"))
    assert "a sweep to pressure=2" in _note(FIGURES["fig05"](other))
    scan = files.assign_attrs(study="name: 'leak'\nsurface: {file: gone.npy, L: 500 um}\n")
    scan = scan.assign_coords(L=scan["L"].assign_attrs(units="um"))
    words = _note(FIGURES["fig05"](scan))
    assert r"Run leak: height files turned \$1.npy, ground.npy, L = 10 µm." in words
    assert "Drawn as Fig. 5 of Paggi and He (2015), whose surfaces are others." in words
