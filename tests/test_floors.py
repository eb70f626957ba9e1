"""Who may import whom: the floors of the design, read off the syntax trees (imports inside functions count too)."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "roughvol"

# module or package -> (what it may import of roughvol, third parties it may import). Physics modules do not import each
# other, but what may import "physics" may import them all; a package named among its own imports is one module.
ABOVE_DATASET = {
    "dataset",
    "storage",
    "variables",
    "heightfile",
    "bodies",
    "leakage",
    "record",
    "regions",
    "study",
    "physics",
    "errors",
    "_version",
}
FIGURE_PARTS = {"figure_style", "figure_data", "figure_curves", "figure_origin", "relief"}
FLOORS: dict[str, tuple[set[str], set[str]]] = {
    "errors": (set(), set()),
    "limits": (set(), set()),
    "lengths": (set(), set()),
    "_version": (set(), set()),
    "physics": ({"errors"}, {"numpy", "scipy"}),
    "study": ({"study", "errors", "lengths", "heightfile", "_version"}, {"yaml", "pydantic", "pydantic_core", "pint"}),
    "description": ({"errors", "lengths"}, set()),
    "plaintext": ({"errors", "description"}, {"numpy"}),
    "textheader": ({"errors", "description"}, set()),
    "points": ({"errors"}, {"numpy"}),
    "textmap": ({"errors", "description", "plaintext", "textheader", "points"}, {"numpy"}),
    "netcdfmap": ({"errors", "description"}, {"numpy", "netCDF4"}),
    "tiffmap": ({"errors", "description"}, {"numpy", "tifffile"}),
    "instrument": ({"errors", "description"}, {"numpy", "SurfaceTopography"}),
    "heightfile": (
        {"errors", "description", "instrument", "netcdfmap", "tiffmap", "textmap", "plaintext"},
        {"numpy"},
    ),
    "bodies": ({"study", "heightfile", "lengths", "physics", "errors"}, {"numpy"}),
    "storage": ({"errors", "_version"}, set()),
    "columns": (set(), {"numpy"}),
    "ledger": ({"storage", "errors", "_version"}, set()),
    "variables": (set(), {"numpy"}),
    "dataset": (
        {"study", "errors", "physics", "_version", "columns", "storage", "variables"},
        {"numpy", "netCDF4", "xarray"},
    ),
    "leakage": ({"study", "physics"}, {"numpy"}),
    "regions": ({"study", "physics", "errors", "leakage"}, {"numpy"}),
    "record": ({"study", "physics", "errors", "leakage", "regions"}, {"numpy"}),
    "workers": ({"errors"}, {"distributed"}),
    "resources": ({"study", "errors", "limits"}, set()),
    "checkpoint": ({"storage", "study", "errors", "_version"}, {"numpy"}),
    "pressing": (ABOVE_DATASET | {"checkpoint"}, {"numpy", "threadpoolctl"}),
    "folder": ({"ledger", "storage", "study", "errors"}, set()),
    "same_study": ({"folder", "study", "errors"}, set()),
    "standing": ({"folder", "ledger", "same_study", "study"}, set()),
    "collecting": (ABOVE_DATASET | {"columns", "folder"}, set()),
    "batch": (ABOVE_DATASET | {"workers", "resources", "pressing", "folder", "ledger", "limits"}, set()),
    "dimensional": ({"study", "variables", "errors"}, set()),
    "validity": ({"study"}, {"numpy"}),
    "campaign": (
        ABOVE_DATASET
        | {"workers", "resources", "pressing", "folder", "ledger", "standing", "columns", "collecting", "batch"}
        | {"dimensional", "estimate", "same_study", "validity"},
        set(),
    ),
    "estimate": (ABOVE_DATASET | {"pressing", "resources"}, {"numpy"}),
    "understood": (ABOVE_DATASET | {"pressing", "description"}, set()),
    "tradeoff": (ABOVE_DATASET | {"pressing"}, {"numpy", "threadpoolctl"}),
    "convergence": (ABOVE_DATASET | {"tradeoff"}, {"numpy"}),
    "figure_style": (set(), {"numpy", "matplotlib"}),
    "figure_data": (ABOVE_DATASET | {"figure_style"}, {"numpy"}),
    "figure_curves": (ABOVE_DATASET | {"figure_style", "figure_data"}, {"numpy"}),
    "figure_origin": (ABOVE_DATASET | {"figure_style", "figure_data"}, {"matplotlib"}),
    "relief": ({"figure_style"}, {"numpy", "matplotlib"}),
    "tradeoff_figures": (ABOVE_DATASET | {"figure_style", "figure_origin", "tradeoff"}, {"numpy", "matplotlib"}),
    "claims": (ABOVE_DATASET | {"claims"}, {"numpy", "scipy"}),
    "figures": (ABOVE_DATASET | FIGURE_PARTS, {"numpy", "matplotlib"}),
    "theory_figures": (ABOVE_DATASET | {"claims", "figure_style", "figure_origin"}, {"numpy", "matplotlib"}),
    "figure_cases": (ABOVE_DATASET | {"figures", "seal_figures"}, set()),
    "look_figure": ({"figure_style", "lengths", "physics", "errors"}, {"numpy", "matplotlib"}),
    "report_style": (set(), set()),
    "seal_ways": (ABOVE_DATASET | {"figure_data"}, {"numpy"}),
    "seal_drawing": (ABOVE_DATASET | {"figure_style", "figure_data", "seal_ways"}, {"numpy", "matplotlib"}),
    "seal_figures": (ABOVE_DATASET | FIGURE_PARTS | {"seal_ways", "seal_drawing"}, {"numpy", "matplotlib"}),
    "captions": (set(), set()),
    "report_model": (ABOVE_DATASET | {"claims"}, set()),
    "report_words": ({"claims", "report_model"}, set()),
    "run_facts": (ABOVE_DATASET | {"claims"}, {"numpy", "xarray"}),
    "report_figures": (
        ABOVE_DATASET | {"captions", "claims", "figures", "figure_cases", "theory_figures", "report_model"},
        {"matplotlib"},
    ),
    "report_html": ({"report_figures"}, set()),
    "run_page": ({"report_figures", "report_html", "run_facts"}, set()),
    "report_page": (
        {"_version", "claims", "run_facts", "run_page", "report_figures", "report_html", "report_model"}
        | {"report_style", "report_words"},
        {"numpy"},
    ),
    "report_text": ({"_version", "claims", "run_facts", "report_model", "report_words"}, set()),
    "report": ({"errors", "report_model", "report_page", "report_text"}, set()),
    "cli": (
        {
            *ABOVE_DATASET,
            "limits",
            "workers",
            "folder",
            "standing",
            "campaign",
            "estimate",
            "understood",
            "look_figure",
            "tradeoff",
            "convergence",
            "tradeoff_figures",
            "claims",
            "figures",
            "figure_cases",
            "seal_figures",
            "report",
            "validity",
        },
        {"click", "rich"},
    ),
    "__main__": ({"cli"}, set()),
    "__init__": ({"_version", "campaign", "study"}, set()),  # the door: imports on first use only
}
# the contact solver, from the ground up: which of its modules imports which
SOLVER: dict[str, set[str]] = {
    "convolution": {"tuning"},
    "halfspace": {"kernels", "convolution", "tuning"},
    "blocks": {"kernels", "tuning"},
    "precondition": {"near_field", "blocks", "tuning"},
    "problem": {"state", "superposition", "surface", "tuning"},
    "active_set": {"kernels", "precondition", "problem", "state"},
    "paper_algorithm": {"kernels", "problem", "state"},
    "contact": {"active_set", "paper_algorithm", "problem", "state", "surface", "tuning"},
    "search": {"surface", "contact"},
}
PROCESSES = {
    "multiprocessing",
    "subprocess",
    "asyncio",
    "concurrent.futures.ProcessPoolExecutor",
    "concurrent.futures.process",
}
THREADS = {"threading", "concurrent.futures.ThreadPoolExecutor", "concurrent.futures.thread"}


def _modules() -> list[str]:
    return [
        ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
        for path in sorted(PACKAGE.rglob("*.py"))
        if "__pycache__" not in path.parts
    ]


def _tree(module: str) -> ast.Module:
    return ast.parse(PACKAGE.joinpath(*module.split(".")).with_suffix(".py").read_text(encoding="utf-8"))


def _is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")


def _nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Walk everything that runs: a name imported for an annotation alone is no dependency."""
    for child in ast.iter_child_nodes(node):
        if not _is_type_checking(child):
            yield child
            yield from _nodes(child)


def _imports(module: str) -> set[str]:
    """Full dotted names of what a module imports, `from a import b` as `a.b`, relative imports resolved."""
    found = set()
    package = ["roughvol", *module.split(".")[:-1]]
    for node in _nodes(_tree(module)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            origin = ".".join([*base, *([node.module] if node.module else [])])
            found |= {f"{origin}.{alias.name}" for alias in node.names}
    return found


def _floor(module: str) -> tuple[set[str], set[str]]:
    siblings, parties = FLOORS[module.split(".")[0]]
    siblings = siblings | {f"physics.{name}" for name in SOLVER.get(module.removeprefix("physics."), set())}
    if module in ("physics.outliers", "physics.lattice"):
        siblings = siblings | {"physics.levelling"}  # a plane taken off, holes filled
    if module == "physics.convolution":
        parties = parties | {"pyfftw"}
    return siblings, parties


def _internal(name: str) -> str:
    """`roughvol.physics.surface.Surface` -> `physics.surface`; `roughvol.study.load` -> `study`."""
    parts = name.split(".")[1:]
    return ".".join(parts[:2]) if parts[:1] == ["physics"] else parts[0]


def test_every_module_stands_on_a_floor() -> None:
    assert {name.split(".")[0] for name in _modules()} <= set(FLOORS)


@pytest.mark.parametrize("module", _modules())
def test_imports_go_down_only(module: str) -> None:
    siblings, _ = _floor(module)
    wrong = {
        name
        for name in _imports(module)
        if name.split(".")[0] == "roughvol"
        and _internal(name) not in siblings | {"__version__"}
        and not (_internal(name).startswith("physics") and "physics" in siblings)
    }
    assert not wrong


@pytest.mark.parametrize("module", _modules())
def test_third_parties_stay_in_their_rooms(module: str) -> None:
    _, parties = _floor(module)
    roots = {name.split(".")[0] for name in _imports(module)} - {"roughvol"}
    assert roots - set(sys.stdlib_module_names) <= parties


@pytest.mark.parametrize("module", [name for name in _modules() if name != "workers"])
def test_processes_start_in_one_place_and_threads_only_inside_a_convolution(module: str) -> None:
    forbidden = PROCESSES if module == "physics.convolution" else PROCESSES | THREADS | {"concurrent"}
    assert not [name for name in _imports(module) if any(f"{name}.".startswith(f"{door}.") for door in forbidden)]


@pytest.mark.parametrize("module", [name for name in _modules() if name != "cli"])
def test_only_the_command_line_prints_and_exits(module: str) -> None:
    called = {ast.unparse(node.func) for node in _nodes(_tree(module)) if isinstance(node, ast.Call)}
    assert not called & {"print", "input", "exit", "quit", "sys.exit", "SystemExit", "sys.stdout.write"}


@pytest.mark.parametrize("module", _modules())
def test_importing_a_module_does_nothing(module: str) -> None:
    # A bare call at module level is work done, or a setting changed, by the import.
    calls = [node for node in _tree(module).body if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)]
    assert not [ast.unparse(node) for node in calls]
