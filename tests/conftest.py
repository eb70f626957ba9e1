"""What several test modules share: where tests compute, what they read and draw once, and one stored run."""

import functools
import gc
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("busy machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy machine")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give a slow test two hours: 600 random cases take 6 minutes, and have taken 34 on a busy machine."""
    for item in items:
        if item.get_closest_marker("slow") is not None:
            item.add_marker(pytest.mark.timeout(7200))


def pytest_configure() -> None:
    """Collect garbage seldom: during imports and the collection of tests there is hardly any."""
    gc.set_threshold(200_000, 20, 100)


def pytest_collection_finish() -> None:
    """Leave out of later collections of garbage what lives to the end: a tenth of the processor time."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> Iterator[None]:
    """Take one thread for linear algebra: with small matrices, several threads mostly wait for each other."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        yield


@pytest.fixture(scope="session", autouse=True)
def _in_this_process() -> Iterator[None]:
    """Compute in this process, also in fixtures: starting a worker takes longer than most cases here."""
    from roughvol.campaign import workers

    with workers.in_this_process():
        yield


@pytest.fixture(autouse=True)
def _in_processes_where_marked(request: pytest.FixtureRequest) -> Iterator[None]:
    from roughvol.campaign import workers

    with workers.in_this_process(request.node.get_closest_marker("processes") is None):
        yield


@pytest.fixture(scope="module", autouse=True)
def _rows_of_the_package() -> Iterator[None]:
    """Take the rows of a user's functions out of the tables of quantities again: in another process are none."""
    from roughvol.observables.variables import QUANTITIES, VARIABLES

    before = [(table, table.copy()) for table in (QUANTITIES, VARIABLES)]
    yield
    for table, rows in before:
        table.clear()
        table.update(rows)


@pytest.fixture(scope="session", autouse=True)
def _read_once() -> Iterator[None]:
    """Read each text and each content of a file once in a session: commands read the same files over and over.

    The arrays of a file are not writeable, so that no test changes them for another.
    """
    from roughvol.store import dataset
    from roughvol.study import plain_data

    loader, opened = plain_data._Loader, dataset._opened
    nodes = functools.lru_cache(maxsize=512)(lambda text: loader(text).get_single_node())

    @functools.lru_cache(maxsize=256)
    def held(content: bytes) -> Any:
        found = opened(content)
        for name in found.data_vars:
            found.variables[name].values.flags.writeable = False
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plain_data, "_Loader", lambda text: SimpleNamespace(get_single_node=lambda: nodes(text)))
        patch.setattr(dataset, "_opened", lambda content: held(content).copy())
        yield


@pytest.fixture(scope="session", autouse=True)
def _press_trials_once() -> Iterator[None]:
    """Press the trial surfaces of an ensemble once in a session: every run that goes on presses them again."""
    from roughvol.campaign import rounds

    press = rounds.in_memory
    known: dict[str, Any] = {}

    def remembered(cases: Any, *others: Any) -> dict[str, Any]:
        known.update(press([case for case in cases if case.id not in known], *others))
        return {case.id: known[case.id] for case in cases}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rounds, "in_memory", remembered)
        yield


@pytest.fixture(scope="module")
def few_samples() -> Iterator[None]:
    """Ensembles of few samples, few trials and few surfaces without a solve, for all tests of a module."""
    from roughvol.ensemble import design, prediction, step_error

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(design, "PILOT", 8)
        patch.setattr(design, "FEW_SURFACES", 100)
        patch.setattr(prediction, "SEEDS", 8)
        patch.setattr(step_error, "SURFACES", 8)
        yield


@pytest.fixture(scope="module")
def small_grids() -> Iterator[None]:
    """Cards with coarser grids of 16 nodes a side, for all tests of a module."""
    from roughvol.campaign import card

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(card, "FEWEST_NODES", 16)
        yield


@pytest.fixture(scope="session", autouse=True)
def _blank_figures() -> Iterator[None]:
    """Save blank figures of the same size: layout, text and fonts take most of the time of a figure."""
    from roughvol.report.figures.style import Drawing

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Drawing, "savefig", functools.partialmethod(_saved_blank, Drawing.savefig))
        yield


@pytest.fixture(scope="session", autouse=True)
def _formulas_once() -> Iterator[None]:
    """Set each formula once in a session: matplotlib remembers those of one figure, and many axes have the same."""
    import matplotlib as mpl
    from matplotlib.mathtext import MathTextParser

    if not mpl.__version__.startswith(("3.10.", "3.11.")):  # whose method has no public name
        yield
        return
    setting, parsers = MathTextParser._parse_cached.__wrapped__, {"vector": "path", "raster": "agg"}
    known = functools.cache(lambda output, *words: setting(MathTextParser(parsers[output]), *words))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MathTextParser, "_parse_cached", lambda self, *words: known(self._output_type, *words))
        yield


@pytest.fixture(autouse=True)
def _figures_where_marked(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.node.get_closest_marker("layout") is not None:
        from roughvol.report.figures.style import Drawing

        monkeypatch.setattr(Drawing, "savefig", Drawing.__dict__["savefig"].args[0])


def _saved_blank(figure: Any, saved: Any, file: Any, **options: Any) -> None:
    saved(type(figure)(figsize=figure.get_size_inches()), file, **options | {"dpi": 40})


@pytest.fixture
def no_figures() -> Iterator[None]:
    """Reports without figures."""
    from tests.kit import without_figures

    with without_figures():
        yield


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, which is the current folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def there(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """An empty folder, which is the current folder in all tests of a module."""
    folder = tmp_path_factory.mktemp("there")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder


@pytest.fixture(scope="session")
def small_study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stored answer (study.nc) of tests/regression/small.yaml."""
    from roughvol.campaign import execution

    folder = tmp_path_factory.mktemp("runs") / "small"
    execution.run(Path(__file__).parent / "regression" / "small.yaml", out=folder, jobs=2)
    return folder / "study.nc"
