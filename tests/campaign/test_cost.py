"""Cost of a study: counts, bounds and laws of growth; and too little memory, told in one line."""

import errno
import math
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import roughvol
from roughvol.campaign import batch, cost, execution, machine
from roughvol.campaign.batch import Forecast
from roughvol.campaign.cost import START, choices, estimate
from roughvol.contact.halfspace import HalfSpace
from roughvol.ensemble.cost import CALL, CASE, FLOW, NODE, STEP, convolutions_per_step, expected_area, expected_seconds
from roughvol.errors import CampaignError, ResourceError
from roughvol.observables import requests
from roughvol.study import ACCURACY, loads
from tests.campaign.kit import case_of, noise
from tests.kit import call, refused

PLAIN = "surface: {D: 2.2, m: 6, seeds: 4}\nsweep: {steps: 50}"
TEXT = "name: s\nsurface: {D: 2.4, m: 3, seeds: 1}\nsweep: {steps: 2}\n"


def test_counts_are_those_of_the_study() -> None:
    found = estimate(loads("surface: {D: [2.2, 2.8], m: [3, 4], seeds: 3}\nsweep: {steps: 7}"), jobs=100)
    assert (found.cases, found.steps, found.jobs) == (12, 84, 12)


@pytest.mark.parametrize(
    ("old", "new", "names"),
    [
        ("steps: 50", "steps: 5000", ["seconds"]),
        ("m: 6", "m: 8", ["seconds", "memory"]),
        ("50}", "50}\nrecord: {fields_at: last}", ["disk"]),
    ],
)
def test_cost_grows_with_what_is_asked(old: str, new: str, names: list[str]) -> None:
    plain, more = (estimate(loads(text), jobs=1) for text in (PLAIN, PLAIN.replace(old, new)))
    assert all(getattr(more, name) > getattr(plain, name) for name in names)


def test_processes_share_the_time_but_not_that_of_one_case() -> None:
    study = loads("surface: {D: 2.2, m: 6, seeds: 8}\nsweep: {steps: 10000}")
    times = [estimate(study, jobs=jobs).seconds for jobs in (1, 2, 8, 100)]
    assert times[0] > times[1] > times[2] == times[3]


def test_cases_of_one_cost_are_estimated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thousands of D with a long record of levels made `roughvol check` wait for minutes."""
    text = "surface: {D: [2.2, 2.5, 2.8], m: [3, 4], seeds: SEEDS}\nsweep: {steps: 7}\nrecord: {fields_at: last}"
    asked: list[object] = []
    find = requests.asked
    monkeypatch.setattr(requests, "asked", lambda record: asked.append(record) or find(record))
    one, many = (estimate(loads(text.replace("SEEDS", seeds)), jobs=2) for seeds in ("1", "100"))
    assert len(asked) < 50
    assert (many.cases, many.steps) == (100 * one.cases, 100 * one.steps)
    assert many.disk == pytest.approx(100 * one.disk, rel=1e-12)
    assert many.observables == {name: pytest.approx(100 * taken, rel=1e-12) for name, taken in one.observables.items()}
    assert many.seconds - START == pytest.approx(100 * (one.seconds - START), rel=1e-9)


def test_everything_that_is_recorded_has_its_cost() -> None:
    text = (
        "surface: {D: 2.2, m: 6, seeds: 4}\nsweep: {steps: 10}\n"
        "record: {fields_at: last, box_counting: {}, volume_density: {}, texture: true, "
        "transport: {transmissivity: STATES, flux_at: last}, region_widths: {shares: [1, 0.5], transmissivity: last}}"
    )
    few, many = (
        estimate(loads(text.replace("STATES", states)), jobs=1).observables for states in ("last", "every-step")
    )
    names = {"fields_at", "box_counting", "volume_density", "texture", "transmissivity", "flux_at", "region_widths"}
    assert set(few) == names | {"region_transmissivity"}
    assert many["transmissivity"] == pytest.approx(10 * few["transmissivity"], rel=1e-12)
    assert 1.0 < few["region_transmissivity"] / few["transmissivity"] < 2.0  # two flows, of which the second is smaller
    assert estimate(loads(text[: text.index("record")]), jobs=1).observables == {}


@pytest.mark.parametrize("nodes", [9, 33, 129, 1025])
def test_a_step_takes_at_least_its_verification(nodes: int) -> None:
    needed = [convolutions_per_step((nodes, nodes), rtol, 0.1, 60) for rtol in (1e-1, 1e-3, 1e-6, 1e-9)]
    assert needed == sorted(needed)
    assert needed[0] >= 1.0


MEASURED = [  # m, sweep, convolutions of the grid that take the time of a step beside STEP (tests.bench.cost_rule)
    (4, "{steps: 60}", 1),
    (5, "{steps: 100, to: {separation: -200}}", 33),
    (5, "{steps: 10, to: {contact_area: 0.4}}", 31),
    (6, "{steps: 30, to: percolation}", 25),
    (7, "{steps: 10, to: {pressure: 2}}", 14),
    (7, "{steps: 30, to: {pressure: 0.1}}", 1.2),
    (7, "{steps: 10, to: percolation}", 33),
    (8, "{steps: 10, to: mean-plane}", 13),
    (8, "{steps: 30, to: percolation}", 17),
]


@pytest.mark.parametrize(("m", "sweep", "measured"), MEASURED)
def test_steps_cost_as_measured(m: int, sweep: str, measured: float) -> None:
    """Steps far beyond the mean plane were stated at a tenth of their seconds."""
    case, shape = case_of(f"surface: {{D: 2.3, m: {m}}}\nsweep: {sweep}"), (2**m + 1, 2**m + 1)
    area = expected_area(case.sweep.target, case)
    assert measured / 2 <= convolutions_per_step(shape, 1e-6, area, case.sweep.steps) <= 2 * measured


@pytest.mark.parametrize("sides", ["free", "mirrored", "periodic"])
def test_a_load_in_mpa_on_heights_of_unknown_scale_is_no_full_contact(sides: str) -> None:
    """Scans under a light load were stated at three times their seconds."""
    spectral = f"surface: {{H: 0.8, n: 256, L: 100 um, Sq: 1 um, sides: {sides}}}\nmaterial: {{E_star: 1 GPa}}\n"
    case = case_of(spectral + "sweep: {steps: 9, to: {pressure: 2 MPa}}")
    assert 0.01 < expected_area(case.sweep.target, case) < 0.2


@pytest.mark.parametrize("target", ["{contact_area: 0.06}", "{pressure: 1}"])
def test_a_search_costs_less_than_a_sweep_of_sixty_steps(target: str) -> None:
    text = "surface: {{D: 2.4, m: 7, seeds: 1}}\nsweep: {{steps: {}, to: {}}}"
    plain, searched, twice = (
        estimate(loads(text.format(*how)), jobs=1).seconds - START - CASE
        for how in ((60, "mean-plane"), (60, target), (120, "mean-plane"))
    )
    assert plain < searched < twice


def test_work_grows_with_grid_searches_and_observables() -> None:
    def total(text: str, m: int = 7) -> float:
        return expected_seconds(case_of(f"surface: {{D: 2.3, m: {m}}}\n{text}"))

    plain = total("sweep: {steps: 20}")
    assert total("sweep: {steps: 40}") > plain
    assert total("sweep: {steps: 20}", m=8) > 3.0 * plain
    assert total("sweep: {steps: 20, to: percolation}") > 1.5 * plain
    assert total("sweep: {steps: 20}\nrecord: {transport: {transmissivity: every-step}}") > 2.0 * plain
    with_ways = "sweep: {{steps: 20, to: {{contact_area: {}}}}}\nrecord: {{transport: {{percolation: every-step{}}}}}"
    for area, most in ((0.2, 18.0), (0.5, 8.0)):  # beyond the last step, and among the steps
        searched = total(with_ways.format(area, ", closing: true")) - total(with_ways.format(area, ""))
        step = convolutions_per_step((129, 129), 1e-6, 0.42, 60) * (CALL + NODE * 129**2 * math.log(129)) + STEP
        assert searched == pytest.approx(2 * most * step, rel=1e-9)
    flows = "sweep: {{steps: 20}}\nrecord: {{transport: {{transmissivity: every-step{}}}}}"
    assert total(flows.format(", quadrants: every-step")) > total(flows.format("")) + 20 * 4 * FLOW
    assert total("sweep: {pressures: [0.1, 0.2, 0.3]}") > total("sweep: {steps: 3, to: {pressure: 0.3}}")
    assert total("sweep: {steps: 0}") < 0.3 * plain


@pytest.mark.parametrize(
    ("sides", "pressure", "closing", "without"),
    [("free", 0.05, 1.51, 0.30), ("mirrored", 0.05, 2.46, 0.53), ("periodic", 0.05, 1.61, 0.24)],
)
def test_closing_loads_cost_as_measured(sides: str, pressure: float, closing: float, without: float) -> None:
    """Over the seconds without closing loads, m = 8: a closing beyond the last step was stated down to a fifth."""
    text = f"surface: {{D: 2.2, m: 8, L: 100 um, Sq: 0.5 um, seeds: 1, sides: {sides}}}\nmaterial: {{E_star: 10 MPa}}\n"
    text += f"sweep: {{steps: 10, to: {{pressure: {pressure} MPa}}}}\n"
    text += "record: {transport: {percolation: every-step, closing: CLOSING}}"
    convolution = {"free": 1.19e-3, "mirrored": 2.22e-3, "periodic": 0.62e-3}[sides]
    found = [expected_seconds(case_of(text.replace("CLOSING", given)), convolution) for given in ("true", "false")]
    assert closing / 1.5 <= found[0] <= 1.5 * closing
    assert without / 1.5 <= found[1] <= 1.5 * without


@pytest.mark.parametrize(
    ("m", "steps", "record"),
    [
        (5, 6, "{heights: true, fields_at: {step: [3, 6]}, box_counting: {}, volume_density: {}}"),
        (3, 150, "{transport: {percolation: every-step}}"),
    ],
)
def test_disk_is_an_upper_bound(tmp_path: Path, m: int, steps: int, record: str) -> None:
    study = loads(f"surface: {{D: 2.5, m: {m}, seeds: 2}}\nsweep: {{steps: {steps}}}\nrecord: {record}")
    roughvol.run(study, out=tmp_path)
    assert sum(path.stat().st_size for path in tmp_path.rglob("*.nc")) <= estimate(study).disk


def test_the_memory_of_a_gas_is_little_beside_that_of_its_flow() -> None:
    """Measured at m = 9 and 10: 209 to 266 bytes a node beside the 250 of a sweep."""
    flow = "surface: {D: 2.2, m: 9, L: 1 mm, Sq: 1 um, seeds: [1]}\nmaterial: {E_star: 10 MPa}\nsweep: {steps: 2}\n"
    gas = "fluid: {gas: helium, inlet: 1 bar, outlet: 0 bar}\nrecord: {transport: {gas_flow: last}}\n"
    plain, more = (cost.memory_of(loads(text).cases()[0]) for text in (flow, flow + gas))
    assert 266 < (more - plain - cost.COMPILED_BYTES) / 513**2 < 1.2 * 266


def test_time_that_others_take_is_no_cost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(HalfSpace, "displacement", lambda *_: time.sleep(0.05))
    cost.seconds_per_convolution.cache_clear()
    assert cost.seconds_per_convolution((9, 9)) < 0.01
    cost.seconds_per_convolution.cache_clear()


def test_the_time_of_a_large_grid_is_that_of_strips_along_both_axes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A node of a line of n has n units of time here."""
    monkeypatch.setattr(cost, "_timed", lambda shape, sides: sum(shape) * math.prod(shape) * 1e-9)
    for shape in ((1025, 3), (2053, 1801), (3000, 40)):
        cost.seconds_per_convolution.cache_clear()
        assert cost.seconds_per_convolution(shape) == pytest.approx(sum(shape) * math.prod(shape) * 1e-9)
    cost.seconds_per_convolution.cache_clear()


def test_check_has_the_cost_of_each_accuracy() -> None:
    found = choices(loads("surface: {D: 2.6, m: 8, seeds: 4}"), jobs=1)
    assert [one.name for one in found] == list(ACCURACY)
    assert [one.seconds for one in found] == sorted(one.seconds for one in found)
    assert choices(loads("surface: {D: 2.6, m: 8}\nsweep: {steps: 0}")) == []


# The time left, with a clock that the test moves


class _Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize("processes", [1, 7])
@pytest.mark.parametrize("slower", [150.0, 400.0])
def test_the_time_left_is_that_of_the_work_left_at_the_mean_rate(processes: int, slower: float) -> None:
    works = {f"fine{k}": 2.0 for k in range(21)} | {f"coarse{k}": 0.1 for k in range(210)}
    clock = _Clock()
    forecast = Forecast(clock)
    forecast.expect(works, dict.fromkeys(works, 60))
    assert forecast.left() is None
    whole = slower * sum(works.values()) / processes
    for id, seconds in works.items():
        clock.now += slower * seconds / processes
        forecast.ended(id)
        assert forecast.left() == pytest.approx(whole - clock.now, abs=1e-9)
    assert forecast.share == pytest.approx(1.0)


def test_steps_of_a_case_at_work_and_later_batches_count_as_their_share() -> None:
    clock = _Clock()
    forecast = Forecast(clock)
    forecast.expect({"long": 30.0, "none": 0.0}, {"long": 10, "none": 0}, later=30.0)
    clock.now = 60.0
    forecast.reached("long", 2)
    assert (forecast.share, forecast.left()) == (pytest.approx(0.1), pytest.approx(540.0))
    forecast.ended("long")
    assert (forecast.share, forecast.left()) == (pytest.approx(0.5), pytest.approx(60.0))
    forecast.ended("none")
    forecast.expect({"short": 10.0}, {"short": 10}, later=20.0)  # the clock goes on
    forecast.reached("short", 0)
    assert (forecast.share, forecast.left()) == (pytest.approx(0.5), pytest.approx(60.0))


def test_the_time_left_is_not_known_while_the_rate_is_that_of_the_start() -> None:
    clock = _Clock()
    forecast = Forecast(clock)
    forecast.expect({"case": 60.0}, {"case": 480})
    clock.now = 10.0
    forecast.reached("case", 1)
    assert forecast.left() is None
    clock.now = 30.0
    forecast.reached("case", 160)
    assert forecast.left() == pytest.approx(60.0)


# Too little memory


def _as_scipy_words_it() -> ImportError:
    error = ImportError("the install seems to be broken, try reinstalling")
    error.__cause__ = ImportError("_cyutility.so: failed to map segment from shared object")
    return error


LACKING = [MemoryError(), OSError(errno.ENOMEM, "Cannot allocate memory"), _as_scipy_words_it()]
LACKING += [RuntimeError("can't start new thread")]
OTHERS = [ImportError("no module named x"), OSError(errno.EIO, "x"), RuntimeError("x")]


@pytest.fixture
def study(tmp_path: Path) -> str:
    (tmp_path / "s.yaml").write_text(TEXT)
    return str(tmp_path / "s.yaml")


def test_a_narrow_limit_is_told_in_one_line_before_any_library_is_loaded(study: str) -> None:
    code = (
        "import resource, sys\nresource.setrlimit(resource.RLIMIT_AS, (100_000 * 1024,) * 2)\n"
        "from roughvol.cli import main\nmain(prog_name='roughvol')"
    )
    done = subprocess.run([sys.executable, "-c", code, "run", study], capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: not enough memory: the limit of address space is ")


def test_a_limit_too_narrow_for_a_case_is_told(study: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "address_space", lambda: machine.needed_space() + 1e6)
    for command in (["check", study], ["run", study, "--out", tmp_path / "out"]):
        done = call(*command)
        (line,) = done.stderr.splitlines()
        assert done.exit_code == 1
        assert line.startswith("error: not enough memory: D = 2.40, m = 3, seed 0 needs about ")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("error", [*LACKING, *OTHERS], ids=lambda error: type(error).__name__)
def test_memory_that_runs_out_is_one_line_and_no_other_error_is(
    study: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(execution, "run", fail)
    done = call("run", study)
    if error in OTHERS:
        assert done.exception is error
        return
    (line,) = done.stderr.splitlines()
    assert (done.exit_code, line.startswith("error: not enough memory (")) == (1, True)
    monkeypatch.undo()
    monkeypatch.setattr(batch, "file_of_case", fail)
    with pytest.raises(CampaignError, match=r"1 of 1 cases failed\n.*: not enough memory$"):
        execution.run(loads(TEXT), out=tmp_path / "out")


def test_each_height_file_costs_its_own_nodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, nodes in (("a.npy", 9), ("b.npy", 1301)):
        np.save(tmp_path / name, noise(1, nodes, nodes))
    study = loads(
        "surface: {files: '*.npy', L: 1.0}\nsweep: {steps: 1}\nrecord: {transport: {transmissivity: last}}",
        tmp_path / "study.yaml",
    )
    assert [case.shape for case in study.cases()] == [(9, 9), (1301, 1301)]
    monkeypatch.setattr(machine, "available_memory", lambda: 1.1e9)
    monkeypatch.setattr(batch.Batch, "compute", lambda batch: pytest.fail("it was begun"))
    with pytest.raises(ResourceError, match=r"b\.npy needs about 1\.\d+ GB of memory, 1\.1 GB are available"):
        execution.run(study, out=tmp_path / "out")


def test_without_a_limit_nothing_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "address_space", lambda: None)
    assert machine.too_narrow() == ""
    cost.check_fits(loads(TEXT).cases(), [], tmp_path / "nowhere" / "yet")


def test_a_name_too_long_is_refused_in_one_line(study: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / ("a" * 300)
    sizes = {tmp_path.stat().st_ino: 5e9}  # of the folder alone: other processes write to the disk
    monkeypatch.setattr("shutil.disk_usage", lambda place: SimpleNamespace(free=sizes[Path(place).stat().st_ino]))
    assert machine.free_disk(folder / "b") == machine.free_disk(tmp_path) == 5e9
    assert (
        refused("run", study, "--out", folder).splitlines()[-1] == f"error: cannot write {folder}: File name too long"
    )
    for command in ("run", "init"):
        refused(command, f"{folder}.yaml")


def test_a_study_in_a_folder_that_has_vanished_is_refused_in_one_line(
    study: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert call("check", study).exit_code == 0
    assert refused("run", study).splitlines()[-1] == "error: cannot write runs/s: the folder has vanished"


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (0, "0 B"),
        (999, "999 B"),
        (999_600, "1 MB"),
        (4.5e8, "450 MB"),
        (1.28e11, "128 GB"),
        (999.6e9, "1 TB"),
        (12345e12, "12345 TB"),
    ],
)
def test_bytes_have_three_digits_and_no_power_of_ten(number: float, text: str) -> None:
    assert machine.size(number) == text
