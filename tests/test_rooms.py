"""The rooms of the package: who may import whom, which library is used where, and what only one room may do.

Imports are read from the syntax trees: inside functions and under TYPE_CHECKING they count as well.
"""

import ast
import functools
import graphlib
import importlib
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from tests.kit import python

PACKAGE = Path(__file__).parents[1] / "roughvol"

# From the bottom up. A module imports from its own room and from lines below. Rooms on one line do not know each other.
FLOORS = (
    ("errors", "tables", "typing", "_version"),
    ("spellings",),
    ("surfaces",),
    ("gap", "contact", "study"),
    ("observables",),
    ("ensemble", "store"),
    ("campaign", "analysis"),
    ("report",),
    ("reproduction",),
    ("questions",),
    ("plotting",),
    ("cli", "__init__"),
    ("__main__",),
)
ANYWHERE = {"numpy"} | set(sys.stdlib_module_names)
LIBRARIES = {  # library -> rooms or modules that import it
    "scipy": "surfaces contact gap observables ensemble store.dataset "
    "store.small_file reproduction analysis.leak_curve analysis.leak_budget.state",
    "numba": "gap.compiled",
    "lazy_loader": "spellings",
    "pyfftw": "contact.fftw",
    "yaml": "study",
    "pydantic": "study",
    "pydantic_core": "study",
    "pint": "study",
    "xarray": "store campaign.validity analysis report reproduction",
    "netCDF4": "store surfaces",
    "pandas": "report.screen store.dataset",
    "SurfaceTopography": "surfaces",
    "h5py": "surfaces",
    "tifffile": "surfaces",
    "matplotlib": "report.figures report.document reproduction.figures",
    "mpl_toolkits": "report.figures",
    "threadpoolctl": "campaign",
    "distributed": "campaign.cluster",
    "click": "cli",
    "rich": "cli",
    "IPython": "campaign.notebook",
}
PROCESSES = (
    "multiprocessing",
    "subprocess",
    "asyncio",
    "concurrent.futures.ProcessPoolExecutor",
    "concurrent.futures.process",
)
THREADS = ("threading", "concurrent.futures")

Imports = Mapping[str, set[str]]


@functools.cache
def _source() -> dict[str, ast.Module]:
    paths = sorted(path for path in PACKAGE.rglob("*.py") if "__pycache__" not in path.parts)
    return {_name(path): ast.parse(path.read_text(encoding="utf-8")) for path in paths}


def _name(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)


def _imports(tree: ast.Module) -> set[str]:
    """Return full dotted names: ``from a import b`` is ``a.b``."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide the room"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


@functools.cache
def _all_imports() -> Imports:
    return {module: _imports(tree) for module, tree in _source().items()}


def _modules_imported(module: str, imports: Imports) -> Iterator[str]:
    """Yield the modules of the package that a module imports."""
    for name in imports[module]:
        if name.split(".")[0] != "roughvol":
            continue
        inner = name.removeprefix("roughvol").removeprefix(".")
        while inner and inner not in imports:
            inner = inner.rpartition(".")[0]
        yield inner or "__init__"


def _upward(imports: Imports) -> list[str]:
    """Return the imports that do not go down."""
    floor = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
    wrong = []
    for module in imports:
        for target in _modules_imported(module, imports):
            here, there = module.split(".")[0], target.split(".")[0]
            if there != "__init__" and here != there and floor[there] >= floor[here]:
                wrong.append(f"{module} -> {target}")
    return wrong


def _circle(imports: Imports) -> list[str]:
    """Return modules that import each other in a circle, if there is one."""
    graph = {module: set(_modules_imported(module, imports)) - {module, "__init__"} for module in imports}
    for package in graph:  # a package re-exports its modules: that is no import by them
        graph[package] = {target for target in graph[package] if not package.startswith(f"{target}.")}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


def test_imports_go_down_only() -> None:
    assert _upward(_all_imports()) == []
    assert _upward({"surfaces.x": {"roughvol.study.load"}, "study": set()}) == ["surfaces.x -> study"]
    assert _upward({"campaign.x": {"roughvol.report.y"}, "report.y": set()}) == ["campaign.x -> report.y"]


def test_no_two_modules_import_each_other() -> None:
    assert _circle(_all_imports()) == []
    assert _circle({"campaign.a": {"roughvol.campaign.b.f"}, "campaign.b": {"roughvol.campaign.a.g"}})


def test_libraries_stay_in_their_rooms() -> None:
    wrong = [
        f"{module}: {name}"
        for module, names in _all_imports().items()
        for name in sorted({name.split(".")[0] for name in names} - ANYWHERE - {"roughvol", "__future__"})
        if not any(f"{module}.".startswith(f"{room}.") for room in LIBRARIES.get(name, "").split())
    ]
    assert wrong == []


def test_processes_and_threads_start_in_one_place_each() -> None:
    allowed = {
        "campaign.workers": PROCESSES + THREADS,
        "campaign.cluster": ("threading", "concurrent.futures.Future"),
        "contact.convolution": ("concurrent.futures.ThreadPoolExecutor",),
        "surfaces.files.netcdf": ("threading.RLock",),
    }
    wrong = [
        f"{module}: {name}"
        for module, names in _all_imports().items()
        for name in names
        if any(f"{name}.".startswith(f"{door}.") for door in PROCESSES + THREADS)
        and not any(f"{name}.".startswith(f"{door}.") for door in allowed.get(module, ()))
    ]
    assert wrong == []


def test_only_the_command_line_prints_and_exits() -> None:
    forbidden = {"print", "input", "exit", "quit", "sys.exit", "SystemExit", "sys.stdout.write", "sys.stderr.write"}
    wrong = [
        f"{module}: {ast.unparse(node.func)}"
        for module, tree in _source().items()
        if module not in ("cli", "__main__")
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) in forbidden
    ]
    assert wrong == []


def test_private_names_stay_in_their_module() -> None:
    private = {
        f"{module}: {name}"
        for module, names in _all_imports().items()
        for name in names
        if name.startswith("roughvol.") and name.rpartition(".")[2].startswith("_") and not name.endswith("__version__")
    }
    assert private == set()


@pytest.mark.parametrize("room", [room for rooms in FLOORS[2:-4] for room in rooms])
def test_a_room_is_a_table_of_contents(room: str) -> None:
    package = importlib.import_module(f"roughvol.{room}")
    assert all(getattr(package, name) is not None for name in package.__all__)
    listed = set(re.findall(r"^`(\w+)`", package.__doc__ or "", re.MULTILINE))
    modules = {path.stem for path in (PACKAGE / room).iterdir() if not path.name.startswith("_")}
    assert listed == modules


def test_an_import_loads_only_what_it_needs() -> None:
    """One after the other in one process: each also without what a later one may load."""
    lacking = {"": "click yaml", ".cli": "numpy pydantic", ".study": "numpy", ".store.run_status": "xarray"}
    code = "import sys\n" + "".join(
        f"import roughvol{module}; print(*('{module}: ' + name for name in {absent.split()} if name in sys.modules))\n"
        for module, absent in lacking.items()
    )
    done = python("-c", code)
    assert done.stdout.split() == []
    assert done.stderr == ""
