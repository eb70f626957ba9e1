"""The command card: what a designer reads, for one surface, several, closed ways, lists, and fluid pressure."""

import csv
import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

import roughvol
from roughvol.analysis import seal
from roughvol.analysis.average import average
from roughvol.analysis.closing import Closing
from roughvol.analysis.leak_card import Card, Way
from roughvol.analysis.parts import Part
from roughvol.analysis.tables import number
from roughvol.campaign import card as card_runs
from roughvol.campaign.case_surface import surface_of
from roughvol.questions import Cards
from roughvol.report import card_page, card_text, terminal
from roughvol.report.document import Document, Section
from roughvol.report.figures import card_print, leak_card
from roughvol.store import dataset
from roughvol.store.run_folder import slugs
from roughvol.study import Level, loads
from roughvol.surfaces.midpoint import random_midpoint_displacement
from tests.kit import answered, ran, refused, said

pytestmark = pytest.mark.usefixtures("here")

FLUID = "dimensional: {pressure: MPa, leak_rate: {pressure_drop: 5 mbar, viscosity: 1 mPa*s, unit: mm^3/s}}"
SEAL = f"""name: seal
surface: {{D: 2.2, m: 4, L: 100 um, Sq: 0.5 um, seeds: [1]}}
material: {{E_star: 10 MPa}}
sweep: {{steps: 4, to: percolation}}
record: {{transport: {{percolation: every-step, transmissivity: every-step}}, {FLUID}}}
"""
PRESSED = SEAL.replace("to: percolation", "to: {pressure: 0.1 MPa}")
GENERATED = "{D: 2.2, m: 4, L: 100 um, Sq: 0.5 um, seeds: [1]}"
AT = ("--at", "pressure=0.02 MPa")
TO_CLOSING = "{steps: 4, to: percolation}"
SHORT = "steps: 4, to: {pressure: 0.01 MPa}"
LEAK_ENDS = "last: the leg ends at a leak rate, 1 mm^3/s, and so on each grid; allowed: a load"
CLOSING = ("closing_pressure", "closing_pressure_interval")


def _study(text: str, name: str = "seal") -> str:
    Path(f"{name}.yaml").write_text(text, encoding="utf-8")
    return f"{name}.yaml"


def _printed(*arguments: str) -> str:
    return said("card", *arguments, "--jobs", "1")


def _card(*arguments: str) -> Any:
    return answered("card", *arguments, "--jobs", "1")


def _pairs(printed: str) -> str:
    """Return lines in columns as ``name: value``."""
    return re.sub(r"(?<=\S) {2,}", ": ", printed)


def _computed(text: str, *at: str) -> Cards:
    return roughvol.card(loads(text), at=at or "last", jobs=1)


def _brief(cards: Cards, number: int = 0) -> str:
    """Return a card as the terminal has it, with facts as ``name: value``."""
    return _pairs("\n".join(terminal.lines(card_page.brief(cards.pages[number]))))


def _maps(*heights: float, m: int = 4) -> None:
    for k, height in enumerate(heights):
        z = random_midpoint_displacement(2.2, m, seed=k).heights
        np.savetxt(f"face{k}.txt", height * z / z.std(), header="heights in um")


def test_some_closed_surfaces_are_counted_as_0_with_a_median() -> None:
    """The three sweeps end closed at 0.147, 0.189 and 0.146 MPa."""
    found = _computed(SEAL.replace("[1]", "3"), "pressure=0.165 MPa")
    printed, card = _brief(found), found.cards[""]
    line = next(line for line in printed.splitlines() if line.startswith("along x: "))
    assert re.search(r"[0-2] of 3 surfaces open", line)
    assert "its error is not known (grid)" in line  # 17 nodes have no coarser grid
    assert "together: unknown" in printed
    ax = Figure().add_subplot()
    next(panel for panel in leak_card.panels(card) if "Parts" in panel.caption).draw(ax, card)
    assert leak_card.panels(card)[0].caption.endswith("; the band is 16 to 84 % of the surfaces.")  # no error is known
    places = [text.get_position()[1] for text in ax.texts]
    assert len(places) in (2, 4)  # grid and together along the open axes
    assert all(min(ax.get_ylim()) + 0.25 <= place <= max(ax.get_ylim()) - 0.25 for place in places)
    for factor in (1.1, 3.0, 8.0, 60.0):
        ways = [replace(way, parts=[Part("grid", factor, "")]) for way in card.ways]
        ax = Figure().add_subplot()
        panel = next(panel for panel in leak_card.panels(card) if "Parts" in panel.caption)
        panel.draw(ax, replace(card, ways=ways))
        low, high = ax.get_xlim()
        labelled = [tick for tick in ax.get_xticks() if low <= tick <= high]
        assert 1.0 in labelled
        assert len(labelled) > 2


def test_a_load_that_the_sweep_misses_by_rounding_has_its_card() -> None:
    end, beyond = _computed(PRESSED, "pressure=0.1 MPa", "pressure=0.1000005 MPa").cards.values()
    for way, other in zip(end.ways, beyond.ways, strict=True):
        assert other.leak.value == pytest.approx(way.leak.value, rel=1e-4)


@pytest.fixture(scope="module")
def closed(tmp_path_factory: pytest.TempPathFactory) -> Cards:
    """Return the cards of a joint with a coarser grid: at the end of the sweep, which is its closing, and beyond."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(card_runs, "FEWEST_NODES", 16)
        study, out = loads(SEAL.replace("m: 4", "m: 5")), tmp_path_factory.mktemp("closed")
        return roughvol.card(study, at=("last", "pressure=2 MPa"), jobs=1, out=out)


def test_a_closed_joint_has_a_largest_leak(closed: Cards) -> None:
    """The unsafe side is a finer grid."""
    printed = _brief(closed)
    for axis in "xy":
        line = next(line for line in printed.splitlines() if line.startswith(f"along {axis}: "))
        assert re.search(r"closed on this grid, at most .*; tight above [\d.]+ MPa, between [\d.]+ and [\d.]+$", line)
        assert "no leak" not in line
    assert "At twice the spacing: at " in printed
    assert "on a finer grid the way may be open" in printed
    assert "factors of the closing load" in printed
    drawings = card_page.document(closed.pages[0]).sections[1].drawings
    assert len(drawings) == 3  # closing loads in the place of an empty budget
    assert "Closing loads on this grid" in drawings[2].caption
    for way in closed.plain()["last"]["ways"]:
        low, high = way["closing_pressure_interval"]
        assert low < way["closing_pressure"] < high
        assert way["leak"] == way["leak_interval"][0] == 0.0
        assert way["leak_interval"][1] > 0.0


def test_a_card_has_mean_gap_and_second_body_as_the_study_gives_them() -> None:
    text = PRESSED.replace("L: 100 um", "L: 0.1 mm").replace("dimensional: {", "dimensional: {mean_gap: nm, ")
    material = "{E: 10 MPa, nu: 0.5, against: {E: 200 GPa, nu: 0.3}}"
    found = _computed(text.replace("{E_star: 10 MPa}", material), "pressure=0.02 MPa")
    gap = re.search(r"Mean gap V\*: ([\d.]+) σ, ([\d.]+) nm", _brief(found))
    assert float(gap[2]) == pytest.approx(500.0 * float(gap[1]), rel=1e-3)
    facts = dict(card_text.rests_on(found.pages[0].fine)[0])
    assert facts["Material"] == "E 10 MPa, nu 0.5, against {E: 200 GPa, nu: 0.3}"


def test_a_load_beyond_a_sweep_that_ended_closed_is_closed(closed: Cards) -> None:
    cards = _computed(SEAL, "pressure=0.02 MPa", "pressure=2 MPa")
    beyond, note = _brief(cards, 1), "The error of a closed way is that of its closing load."
    words = r"closed on this grid; tight above [\d.]+ MPa, its error is not known \(grid"
    assert len(re.findall(words, beyond)) == 2  # 17 nodes have no coarser grid
    assert not re.search(r"Contact area|Mean gap", beyond)  # the state is not known
    assert [note in card_page.table_of(pages).note for pages in (cards.pages[:1], cards.pages)] == [False, True]
    for way in closed.plain()["pressure=2 MPa"]["ways"]:
        beyond_interval = way["closing_pressure_interval"][1] < 2.0
        assert (way["leak_interval"] == [0.0, 0.0]) == beyond_interval


@pytest.mark.parametrize(("cut_off", "on_coarser"), [("3 um", [None, None]), ("7 um", ["7 um", None])])
def test_means_over_nodes_replace_a_filter_that_a_coarser_grid_cannot_hold(cut_off: str, on_coarser: list[Any]) -> None:
    _maps(0.5, m=7)
    study = loads(SEAL.replace(GENERATED, f"{{file: face0.txt, L: 128 um, low_pass: {cut_off}}}"))
    planned = card_runs.plan(study, Level("last"))
    found = [run.study.surface.low_pass for run in (*planned.coarser, planned.levelled)]
    assert [cut and str(cut) for cut in found] == [*on_coarser, on_coarser[0]]


def test_the_window_of_a_sweep_far_beyond_closing_is_that_of_a_light_step() -> None:
    for way in _computed(SEAL.replace(TO_CLOSING, "{steps: 16, to: {pressure: 1 MPa}}")).plain()["ways"]:
        assert way["closing_pressure"] < 1.0
        assert way["parts"]["window"] > 1.0


def test_one_open_step_does_not_show_the_window() -> None:
    np.save("s.npy", scipy.ndimage.gaussian_filter(np.random.default_rng(3).standard_normal((32, 32)), 2))
    text = SEAL.replace(GENERATED, "{file: s.npy, L: 32 um, level: tilt}")
    printed = _brief(_computed(text.replace(TO_CLOSING, "{steps: 6, to: {pressure: 0.5 MPa}}")))
    assert len(re.findall(r"the map is open at one step alone, 0\.\d+ MPa", printed)) == 2


def test_a_period_has_coarser_grids_that_its_blocks_fill() -> None:
    np.save("face0.npy", np.random.default_rng(0).standard_normal((128, 126)))
    period = "{file: face0.npy, L: 128 um, heights_unit: um, sides: periodic}"
    planned = card_runs.plan(loads(SEAL.replace(GENERATED, period)), Level("last"))
    assert [run.study.surface.downsample for run in planned.coarser] == [2]  # 126 is no multiple of 4
    assert planned.levelled is None


@pytest.mark.parametrize("amplitude", ["Sq: 0.5 um", "slope: 0.1", "slope: 0.1, anisotropy: 3, shortest: 2 um"])
def test_coarser_grids_of_a_spectrum_hold_the_low_waves_of_its_surface(amplitude: str) -> None:
    spectral = f"{{H: 0.4, n: 128, rolloff: 4, L: 100 um, {amplitude}, seeds: [1], sides: periodic}}"
    planned = card_runs.plan(loads(SEAL.replace(GENERATED, spectral)), Level("pressure", 3.0))
    runs = (planned.fine, *planned.coarser)
    whole, *coarser = (surface_of(run.study.cases()[0]).heights for run in runs)
    nominal = [(run.level.value or 0.0) * surface_of(run.study.cases()[0]).Sq for run in runs]
    assert nominal == pytest.approx([nominal[0]] * 3)
    assert [len(heights) for heights in coarser] == [64, 32]
    along_x = 3 if "anisotropy" in amplitude else 1
    waves = np.hypot(*np.meshgrid(along_x * np.fft.fftfreq(128, 1 / 128), np.fft.fftfreq(128, 1 / 128), indexing="ij"))
    for heights in coarser:
        low = np.fft.ifft2(np.where(waves < len(heights) / 2, np.fft.fft2(whole), 0.0)).real
        every = 128 // len(heights)
        held = low[::every, ::every]
        assert heights == pytest.approx(held, abs=1e-9 * whole.std())


def test_a_plane_is_called_flat_and_has_no_card() -> None:
    np.save("plane.npy", np.add.outer(0.3 * np.arange(33), 0.1 * np.arange(33)))
    study = SEAL.replace(GENERATED, "{file: plane.npy, L: 1 mm, heights_unit: um, level: tilt}")
    flat = "the surface is flat once treated: Sq is 0, and numbers over Sq have no meaning"
    Path("plane.yaml").write_text(study, encoding="utf-8")
    assert flat in roughvol.check("plane.yaml").warnings
    assert flat in roughvol.run("plane.yaml", jobs=1).warnings
    told = refused("card", "plane.yaml")
    assert "plane.npy is flat once it is treated, Sq is 0; allowed: a map with roughness" in told


@pytest.mark.parametrize(("separation", "grids"), [(7.7, 0), (2.7, 2)])
def test_a_card_says_which_of_its_other_runs_failed(
    separation: float, grids: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(card_runs, "FEWEST_NODES", 15)
    z = np.random.default_rng(0).standard_normal((32, 32))
    z[20:22, 20:22] = 8.0, -1.0  # means over 2 x 2 nodes halve this peak and the others
    np.savetxt("face0.txt", z, header="heights in um")
    text = SEAL.replace(GENERATED, "{file: face0.txt, L: 100 um, level: mean}")
    cards = _computed(text.replace("to: percolation", f"to: {{separation: {separation}}}"))
    for way in cards.cards[""].ways:
        assert len(way.coarser) == grids
        parts = {part.name: part for part in way.parts}
        assert list(parts) == ["solver", "grid", "window", "levelling"]
        assert parts["grid"].known == bool(grids)
        assert parts["levelling"].known == bool(grids)
        unknown = [part.words for part in parts.values() if part.name in ("grid", "levelling") and not part.known]
        assert all("not computed at twice the spacing: face0" in words for words in unknown)
        assert all("allowed: beyond first touch" in words for words in unknown)


def test_a_card_of_a_region_of_two_rows_has_no_coarser_grid_and_no_roll_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(card_runs, "FEWEST_NODES", 15)
    study = PRESSED.replace("m: 4", "m: 5").replace("record: {", "record: {region: {x: [0.5, 0.56]}, ")
    (card,) = _computed(f"{study}seal: {{length: 1 mm, width: 10 um}}").cards.values()
    (grid,) = (part for part in card.ways[0].parts if part.name == "grid")
    assert not grid.known
    assert re.search("not computed at twice the spacing: .*record.region: .* is fewer than 2 × 2", grid.words)
    assert seal.NO_ROLL_OFF in [part.words for part in card.seal.parts]


def test_several_maps_have_a_card_each_one_together_and_a_table() -> None:
    """Their names differ in a blank: in names of files both are the same."""
    files = {"face 1.txt": 0.3, "face_1.txt": 0.6}
    _maps(*files.values())
    for k, name in enumerate(files):
        Path(f"face{k}.txt").rename(name)
    surface = f"{{files: {list(files)}, L: 100 um, sides: periodic}}"  # a period has no other levelling
    study = _study(PRESSED.replace(GENERATED, surface).replace("steps: 4", "steps: 2"))
    printed = _pairs(_printed(study, *AT))
    for name, height in files.items():
        assert f"Surface: {name}, Sq {height} um" in printed
    assert "of 2 surfaces open" in printed
    assert "Load: 0.02 MPa" in printed
    assert "card: surfaces: load: leak x" in printed  # the table
    folder = Path("runs/seal_card")
    names = {path.name for path in folder.glob("*.html")}
    single = {f"card_pressure=0.02_MPa_{name}.html" for name in slugs(files).values()}
    assert names == {"card_pressure=0.02_MPa.html", "cards_pressure=0.02_MPa.html", *single}
    page = (folder / "card_pressure=0.02_MPa.html").read_text()
    assert page.count("face_1.txt") >= 2
    table = (folder / "cards_pressure=0.02_MPa.html").read_text()
    assert table.count("<tr>") == 4


def test_a_page_in_another_encoding_is_not_overwritten() -> None:
    page = Path("runs/seal_card/card_pressure=0.02_MPa.html")
    page.parent.mkdir(parents=True)
    page.write_bytes(written := "Öl".encode("latin-1"))
    _printed(_study(PRESSED), *AT)
    assert page.read_bytes() == written
    assert len(list(page.parent.glob("card_*.html"))) == 2


def test_the_table_of_cards_of_a_gas_alone_has_the_leak_of_the_gas() -> None:
    Path("gas.yaml").write_text(
        "surface: {D: 2.2, m: 4, L: 100 um, Sq: 0.5 um, seeds: [1]}\nmaterial: {E: 6 MPa, nu: 0.5}\n"
        "sweep: {pressures: [0.01 MPa, 0.03 MPa]}\nfluid: {gas: helium, inlet: 100 mbar, outlet: 0 mbar}\n"
        "record: {transport: {gas_flow: every-step}, dimensional: {gas_leak_rate: sccm, pressure: MPa}}\n"
        "seal: {length: 3 mm, width: 0.2 mm}",
        encoding="utf-8",
    )
    found = roughvol.card("gas.yaml", {"pressure": "0.03 MPa"}, jobs=1)
    table = card_page.table_of(found.pages)
    leaks = [row[table.head.index("leak of the gas x [sccm]")] for row in table.rows]
    known = [beside.leaks[0].value for card in found.cards.values() for beside in card.beside]
    assert leaks == [card_text.short(leak) for leak in known]
    of_seal = [row[table.head.index("leak of the gas, seal [sccm]")] for row in table.rows]
    assert of_seal == [card_text.short(card.seal.gas_leak) for card in found.cards.values() if card.seal]
    assert "leak x T* V*³ of a liquid" in table.head


def test_a_variation_of_a_study_has_a_card_of_its_own() -> None:
    _printed(_study(SEAL), *AT, "--set", "material.E_star=20 MPa")
    stem = "card_pressure=0.02_MPa_material.E_star=20_MPa"
    names = {path.name for path in Path("runs/seal_card").glob("*.*")}
    assert names == {f"{stem}.html", f"{stem}.pdf"}
    assert "seal, material.E_star=20 MPa" in Path("runs/seal_card", f"{stem}.html").read_text()


@pytest.mark.parametrize(("most", "words"), [(np.nan, "leak: 0 mm³/s"), (2.0, "leak: 0 mm³/s, between 0 and 2")])
def test_a_closed_way_has_an_interval_where_its_largest_leak_is_known(most: float, words: str) -> None:
    parts = (Part("grid", 2.0, ""),)  # of its closing load
    way = Way("x", average("leak_rate", 0.0), 0, "mm^3/s", Closing((), "MPa"), (), "", parts, at_most=most)
    assert card_text.details(way) == [words]


def test_the_quadrants_of_a_closed_map_have_no_scatter() -> None:
    for way in _computed(SEAL.replace(TO_CLOSING, "{pressures: [0.4 MPa, 0.6 MPa]}")).cards[""].ways:
        (window,) = (part for part in way.parts if part.name == "window")
        assert not window.known
        assert window.words.startswith("the map is closed at ")


def test_csv_has_a_row_for_each_leak_of_each_card_with_the_numbers_of_json() -> None:
    study = _study(PRESSED + "seal: {length: 1 mm, width: 0.2 mm}\n")
    loads = (*AT, "--at", "pressure=30 kPa")
    rows = list(csv.DictReader(io.StringIO(_printed(study, *loads, "--csv"))))
    cards = _card(study, *loads)
    leaks = (("patch", "x"), ("patch", "y"), ("seal", ""))
    assert [(row["load"], row["of"], row["axis"]) for row in rows] == [
        (load, *leak) for load in cards for leak in leaks
    ]
    assert not list(Path("runs/seal_card").glob("*.html"))
    every = [leak for card in cards.values() for leak in (*card["ways"], card["seal"])]
    for row, leak in zip(rows, every, strict=True):
        lower, upper = leak["leak_interval"] or ("", "")
        assert [row[f"leak{end}"] for end in ("", "_lower", "_upper")] == [str(n) for n in (leak["leak"], lower, upper)]
        closing = "closing_pressure" if "axis" in leak else "tight_above"
        ends = leak[closing], *(leak[f"{closing}_interval"] or ("", ""))
        assert [row[f"closing_pressure{end}"] for end in ("", "_lower", "_upper")] == [*map(str, ends)]
        load = cards[row["load"]]["load"]
        assert {name: row[name] for name in load} == {name: str(value) for name, value in load.items()}
        assert row["leak_unit"] == "mm^3/s"
    assert "exclude each other" in refused("card", study, "--csv", "--json")


def test_json_of_several_loads_is_the_object_of_the_contract_for_each() -> None:
    """Pressures are in MPa, whatever the unit of the study. The numbers: crossing/test_crossing.py."""
    study = _study(PRESSED.replace("pressure: MPa", "pressure: kPa"))
    loads = (*AT, "--at", "pressure=30 kPa")
    cards = _card(study, *loads)
    assert list(cards) == ["pressure=0.02 MPa", "pressure=30 kPa"]
    for card, pressure in zip(cards.values(), (0.02, 0.03), strict=True):
        assert list(card) == ["surfaces", "load", "ways"]
        assert card["surfaces"] == ["D = 2.2, m = 4, seed 1"]
        assert list(card["load"]) == ["nominal_pressure", "mean_pressure"]
        assert card["load"]["nominal_pressure"] == pytest.approx(pressure, rel=1e-5)
        for axis, way in zip("xy", card["ways"], strict=True):
            assert list(way) == [*("axis", "leak", "unit", "leak_interval"), *CLOSING, "parts"]
            assert (way["axis"], way["unit"]) == (axis, "mm^3/s")
            assert set(way["parts"]) == {"solver", "grid", "window"}
            assert way["parts"]["grid"] is None  # 17 nodes have no coarser grid
            assert way["leak_interval"] is way["closing_pressure_interval"] is None
    light, heavy = (card["ways"][0]["leak"] for card in cards.values())
    assert heavy < light
    assert cards["pressure=0.02 MPa"] == _card(study, *AT)
    folder = Path("runs/seal_card")
    assert not list(folder.glob("*.html"))
    stored = {path: path.stat().st_mtime_ns for path in folder.rglob("cases/*.nc")}
    _printed(study, *loads)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("cases/*.nc")} == stored
    assert {path.name for path in folder.glob("*.pdf")} == {f"card_pressure={p}.pdf" for p in ("0.02_MPa", "30_kPa")}
    assert (folder / "cards_pressure=0.02_MPa_pressure=30_kPa.html").exists()
    both, alone = folder / "runs/pressure=0.02_MPa_pressure=30_kPa", folder / "runs/pressure=0.02_MPa"
    assert set((folder / "runs").iterdir()) == {both, alone}  # loads of one kind share their runs
    assert len(list(both.glob("*/cases/*.nc"))) == len(list(alone.glob("*/cases/*.nc")))


def test_a_card_of_a_changed_study_leaves_the_first_and_its_runs_until_fresh_is_given() -> None:
    at, folder = ("--at", "pressure=0.2"), Path("runs/seal_card")
    _printed(_study(SEAL), *at)
    page = folder / "card_pressure=0.2.html"
    first, stored = page.read_text(), sorted(path.name for path in folder.rglob("cases/*.nc"))
    _printed(_study(SEAL.replace("10 MPa", "20 MPa")), *at)
    assert page.read_text() == first
    assert len(list(folder.glob("card_pressure=0.2_*.html"))) == 1
    assert len(list(folder.glob("*.pdf"))) == 2
    _study(SEAL.replace("steps: 4", "steps: 3"))
    assert "another --out keeps them, --fresh computes all anew" in refused("card", "seal.yaml", *at)
    assert sorted(path.name for path in folder.rglob("cases/*.nc")) == stored
    _card("seal.yaml", *at, "--fresh")
    assert sorted(path.name for path in folder.rglob("set_aside/*.nc")) == stored


@pytest.mark.layout
def test_the_print_keeps_its_text_on_the_page() -> None:
    """Every text of the page of print lies inside the margins, measured as it is drawn."""
    found = _computed(PRESSED.replace("[1]", "3"))
    page = replace(found.pages[0], command=f"roughvol card {'long/' * 60}")
    fig = card_print.page_of(page.card, card_page.document(page))
    assert len(fig.texts) > 40
    for text, box in zip(fig.texts, _boxes(fig), strict=True):
        assert 0.0 < box.x0 <= box.x1 < 0.97, text.get_text()
        assert 0.0 < box.y0 <= box.y1 < 1.0, text.get_text()


def _boxes(fig: Figure) -> list[Bbox]:
    """The extents of the texts of a page as shares of the page."""
    renderer = FigureCanvasAgg(fig).get_renderer()
    return [text.get_window_extent(renderer).transformed(fig.transFigure.inverted()) for text in fig.texts]


@pytest.fixture(scope="module")
def pressed(tmp_path_factory: pytest.TempPathFactory) -> Card:
    return roughvol.card(loads(PRESSED), jobs=1, out=tmp_path_factory.mktemp("pressed")).cards[""]


@pytest.mark.layout
@pytest.mark.parametrize(
    ("words", "shown"), [(15, "the last fact"), (150, "3 on the page of HTML"), (300, "The rest is on")]
)
def test_the_print_ends_on_the_page_whatever_it_has(words: int, shown: str, pressed: Card) -> None:
    """Long facts take smaller type, then the place of limits; at last a sentence leads to the page of HTML."""
    limits = tuple(f"surface {k}: {'a limit that is exceeded by much; ' * 5}" for k in range(3))
    facts = (*[(f"fact {k}", "a word " * words) for k in range(10)], ("identity", "the last fact"))
    parts = Section("Limits", sections=(Section(kind="warnings", items=limits),)), Section("Facts", facts=facts)
    fig = card_print.page_of(pressed, Document("A card", sections=parts))
    assert min(box.y0 for box in _boxes(fig)) > 0.0
    assert any(shown in text.get_text() for text in fig.texts)


def test_a_card_of_several_files_names_the_files_of_what_differs() -> None:
    _maps(0.4, 0.5, 0.6)
    for name in ("face1.txt", "face2.txt"):
        z = 1e3 * np.loadtxt(name)
        z[3, 4] = np.nan if name == "face2.txt" else z[3, 4]
        np.savetxt(name, z, header="heights in nm")
    files = "{files: [face0.txt, face1.txt, face2.txt], L: 100 um, level: tilt, missing: interpolate}"
    surfaces = card_runs.surfaces_of(loads(PRESSED.replace(GENERATED, files).replace("steps: 4", "steps: 1")))
    runs = [roughvol.run(study, out=f"runs/{name}", jobs=1) for name, study in surfaces.items()]
    facts = dict(card_text.rests_on(runs)[0])
    filled = "missing heights filled with the mean of their neighbours"
    units = "face0.txt: numbers of the file are in µm; face1.txt, face2.txt: numbers of the file are in nm"
    assert facts["Treatment"] == f"least-squares tilt of the known heights subtracted; {filled}; {units}"
    assert facts["Missing heights"] == "face0.txt, face1.txt: none; face2.txt: 0.35% of the nodes, 1 node, filled"
    assert facts["Nodes"] == "17 x 17, 6.25 µm apart"
    assert facts["Sweep"] == "1 step to pressure=0.1 MPa"


def test_a_page_has_what_the_numbers_rest_on() -> None:
    _maps(0.4)
    text = SEAL.replace(GENERATED, "{file: face0.txt, L: 100 um, level: tilt, missing: interpolate}")
    study = _study(text.replace("E_star: 10 MPa", "E: 10 MPa, nu: 0.49"))
    printed = _printed(study, "--at", "pressure=0.005 MPa")
    assert "The leak is that of the patch, the surface of 100 × 100 µm, not that of a seal of many patches." in printed
    page = Path("runs/seal_card/card_pressure=0.005_MPa.html").read_text()
    for words in (
        "E 10 MPa, nu 0.49",
        "pressure drop 5 mbar, viscosity 1 mPa*s",
        "17 x 17, 6.25 µm apart",
        "100 by 100 µm",
        "tilt",
        "Missing heights",
        "File face0.txt",
        "sha256 ",
        "roughvol card seal.yaml --at &#x27;pressure=0.005 MPa&#x27;",
        f"roughvol {roughvol.__version__}",
        "rms slope at most 0.3",
        "of a seal of many patches",
    ):
        assert words in page, words
    assert "://" not in page.replace("http://www.w3.org", "")  # one file without links to others


def test_fluid_pressure_gives_the_lifted_leak_with_the_dry_leak_named() -> None:
    text = PRESSED.replace("[1]", "[1], sides: periodic").replace("name: seal", "name: lift")
    text = text.replace("5 mbar", "0.4 bar")
    ran("lift", text.replace(", dimensional", ", fluid_pressure: {inlet: 0.4 bar}, dimensional"))
    stored = dataset.read(Path("runs/lift/study.nc")).isel(D=0, m=0, seed=0, fluid_at=0)
    found = roughvol.card("lift.yaml", jobs=1)
    printed = _brief(found)
    dry = card_text.short(stored["leak_rate"].sel(axis="x").isel(step=-1).item())
    assert f"Leak of the dry gap, without fluid pressure: x {dry}" in printed
    area = number(stored["contact_area_fraction"].isel(step=-1).item())
    assert f"Contact area A*: {area}, without fluid pressure" in printed
    assert "Closes: without fluid pressure " in printed
    assert "Leak rate: pressure drop 0.4 bar, viscosity 1 mPa*s" in printed
    assert "Fluid pressure: inlet 0.4 bar" in printed
    assert "warning: the mean pressure of the fluid is " in printed
    assert "record.fluid_pressure computes it" not in found.write()[0].read_text()
    drawn, ax = found.cards[""], Figure().add_subplot()
    way = drawn.ways[0]
    small = replace(drawn, ways=(replace(way, leak=replace(way.leak, value=1e-11)), *drawn.ways[1:]))
    leak_card.panels(small)[0].draw(ax, small)
    assert ax.get_ylim()[0] < 1e-11  # of a leak far below the dry curve, too


def test_an_interval_without_bounds_leaves_the_curve_of_a_card_to_be_read() -> None:
    """Two surfaces far apart: the interval of their mean by t reaches 1e6 times farther than the loads of the sweep."""
    card = _computed(SEAL.replace("m: 4", "m: 5").replace("[1]", "2"), "pressure=0.02 MPa").cards[""]
    wide = Part("window", 1e6, "of two surfaces")
    ways = tuple(replace(way, parts=(wide,), closing=replace(way.closing, parts=(wide,))) for way in card.ways)
    wild = replace(card, ways=ways)
    panel, ax = leak_card.panels(wild)[0], Figure().add_subplot()
    assert "longer bars are cut at 10 times the largest load" in panel.caption
    assert "cut" not in leak_card.panels(replace(card, ways=tuple(replace(w, parts=()) for w in card.ways)))[0].caption
    panel.draw(ax, wild)
    largest = max(float(surface.table["nominal_pressure"].max()) for surface in card.surfaces)
    assert ax.get_xlim()[1] < 12.0 * largest < max(way.closing.interval[1] for way in wild.ways)
    stored = max(float(surface.table["leak_rate"].max()) for surface in card.surfaces)
    assert ax.get_ylim()[1] < 1e4 * stored < max(way.interval[1] for way in wild.ways)


def test_the_second_leg_of_a_path_has_a_card() -> None:
    text = SEAL.replace("{E_star: 10 MPa}", "{E: 200 GPa, nu: 0.3, hardness: 5 GPa}")
    legs = "[{steps: 3, to: {pressure: 1}}, {steps: 2, to: {pressure: 0.1}}]"
    study = _study(text.replace(TO_CLOSING, legs))
    found = roughvol.card(study, at=("pressure=0.3", "pressure=0.3, leg 2"), jobs=1)
    up, down = (card.ways[1].leak.value for card in found.cards.values())
    assert down < up
    page = found.write()[1].read_text()
    for words in ("(p* = 0.3) on leg 2", "on leg 1 "):
        assert words in _brief(found, 1)
        assert words in page
    assert "; on leg 1 open up to " in page
    assert re.search(r"against load on leg 1[;.]", page)
    assert "the sweep has no leg 3; its last is leg 2" in refused("card", study, "--at", "pressure=0.3, leg 3")


@pytest.mark.parametrize(
    ("sweep", "at", "words"),
    [
        (SHORT, "pressure=0.05 MPa", "the sweep has no state at pressure=0.05 MPa: its steps have pressure "),
        ("steps: 4, to: {pressure: 0.1}", "pressure=9", "pressure=9: "),
        (SHORT, "leak_rate=1e-3 mm^3/s", "roughvol ask"),
        (SHORT, "step=3", "allowed: last, or a load"),
        (SHORT, "pressure=1 um", "1 um"),
        (SHORT, "speed=3", "no state"),
        ("steps: 4, to: {leak_rate: 1 mm^3/s}", "last", LEAK_ENDS),
        ("leak_rates: [2 mm^3/s, 1 mm^3/s]", "last", LEAK_ENDS),
    ],
)
def test_a_load_that_is_none_is_refused_by_name(sweep: str, at: str, words: str) -> None:
    told = refused("card", _study(SEAL.replace("steps: 4, to: percolation", sweep)), "--at", at, "--jobs", "1")
    assert words in told
    assert len(told.strip().splitlines()) <= 2
    assert "<string>" not in told


@pytest.mark.parametrize(
    ("leak", "words"),
    [
        ((2.79e-4, "mm^3/s"), "0.28 mm³ in 1000 s"),
        ((2.79e-4, "mm^3/s", (1.26e-4, 6.19e-4)), "0.28 mm³ in 1000 s, between 0.12 and 0.62"),
        ((2.79e-4, "mm^3/s", (2.77e-4, 2.81e-4)), "0.279 mm³ in 1000 s, between 0.277 and 0.281"),
        ((1e-5, "mm^3/s"), "0.86 mm³ in a day"),
        ((4e-9, "mm^3/s"), "0.13 mm³ in a year"),
        ((4e-12, "mm^3/s"), "4 µm³ in 1000 s"),
        ((1.5, "um^3/s"), "1.5 µm³/s"),
        ((2e-4, "ml/min"), "0.29 ml in a day"),
        ((5e4, "mm^3/s"), "50 ml/s"),
        ((0.0, "mm^3/s"), "0 mm³/s"),
        ((0.0123, ""), "T* V*³ = 0.012"),
    ],
)
def test_a_leak_is_said_as_a_person_says_it_with_the_digits_of_its_interval(leak: Any, words: str) -> None:
    assert card_text.amount(*leak) == words


@pytest.mark.parametrize(
    ("value", "words"), [(999.0, "999"), (999.9, "1.00e3"), (3042.0, "3.04e3"), (2.79e-4, "2.79e-4"), (0.0, "0")]
)
def test_a_number_has_one_form_of_powers_of_ten(value: float, words: str) -> None:
    assert card_text.short(value) == words


LIGHT = ("pressure=0.01 MPa", "pressure=0.02 MPa")
LEGS = "[{steps: 6, to: {pressure: 0.05 MPa}}, {steps: 4, to: {pressure: 0.01 MPa}}]"
COUPLED = "{inlet: 5 mbar, outlet: 0 mbar, at: last, coupling: full}"
TOGETHER = {
    "starred": ((), ("pressure=0.2", "pressure=0.4")),
    "mixed": ((), ("pressure=0.2", "pressure=0.01 MPa", "contact_area=0.1", "last")),
    "beyond the closing": ((), ("pressure=0.02 MPa", "pressure=5 MPa")),
    "legs": ((f"sweep={LEGS}",), ("pressure=0.02 MPa", "pressure=0.03 MPa, leg 2")),
    "lists": (("material.E_star=[10 MPa, 20 MPa]",), LIGHT),
    "mirrored": (("surface.sides=mirrored",), LIGHT),
    "gas": (("fluid={gas: air, inlet: 2 bar, outlet: 1 bar}", "record.transport.gas_flow=every-step"), LIGHT),
    "coupled": ((f"record.fluid_pressure={COUPLED}",), ("pressure=0.03 MPa", "pressure=0.05 MPa")),
    "file": (("surface={file: face0.txt, L: 100 um, level: tilt}",), ("pressure=0.2", "pressure=0.4")),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", TOGETHER)
def test_a_card_beside_other_loads_is_that_of_its_load_alone(kind: str) -> None:
    _maps(0.5)
    changes, together = TOGETHER[kind]
    study = loads(SEAL, file="seal.yaml", changes=changes)
    beside = roughvol.card(study, at=together, jobs=1, out="beside").cards
    for load in together:
        alone = roughvol.card(study, at=load, jobs=1, out="alone")
        for words, card in alone.cards.items():
            assert beside[", ".join(filter(None, (words, *alone.loads)))].plain() == card.plain()


def test_a_map_that_is_not_pressed_to_the_load_is_counted_and_has_no_card() -> None:
    """Under fluid pressure a map that ends closed is not known beyond: the fluid may open it."""
    _maps(0.2, 0.6)
    lift = "fluid_pressure: {inlet: 5 mbar, coupling: one-way}, dimensional"
    surface = '{files: "face*.txt", L: 100 um, sides: periodic}'  # a period has no other levelling
    text = SEAL.replace(GENERATED, surface).replace("dimensional", lift)
    found = _computed(text, "pressure=0.11 MPa")  # the sweeps end at 0.09 and 0.48 MPa
    printed = _brief(found)
    assert printed.count("1 not pressed to this load") == 2
    assert "mm³/s" in printed
    assert "T* V*³" not in printed
    assert [page.stem for page in found.pages] == [f"card_pressure=0.11_MPa{name}" for name in ("", "_face1.txt")]
    words = "the sweep ends before pressure=9 MPa, and the fluid may open the way again: press farther"
    assert words in refused("card", _study(text), "--at", "pressure=9 MPa", "--jobs", "1")
