"""The recipes of CONTRIBUTING.md, carried out on a copy of the package: their text cannot go stale."""

import ast
import json
import re
import shutil
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.kit import ROOT, python

BLOCK = re.compile(r"^( *)```\w+\n\1# ([\w/.]+), ([^\n]+)\n(.*?)^\1```", re.MULTILINE | re.DOTALL)
FILES = {"An observable": 3, "A section of the study file": 4, "A figure": 2, "A claim": 2, "A kernel": 4}
STUDY = """
name: recipe
surface: {D: 2.3, m: 3, L: 100 um, Sq: 1 um, seeds: 2}
material: {E_star: 10 MPa}
sweep: {steps: 3, to: {pressure: 0.1 MPa}}
"""
BED = """
surface: {D: 2.3, m: 3, seeds: 1, sides: periodic}
sweep: {steps: 2, to: {contact_area: 0.5}}
solver: {kernel: springs}
record: {heights: true, fields_at: last}
"""
USE = """
import json
import numpy as np
from click.testing import CliRunner
import roughvol, roughvol.errors, roughvol.study
from roughvol.campaign import workers
from roughvol.cli import main
from roughvol.reproduction.claim_run import ClaimRun
from roughvol.reproduction.claims.evidence import CLAIMS, Evidence

def call(*words):
    done = CliRunner().invoke(main, list(words), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout

with workers.in_this_process():
    call("run", "recipe.yaml", "--jobs", "1")
    call("run", "bed.yaml", "--jobs", "1")
ds, bed = roughvol.open("recipe"), roughvol.open("bed").squeeze()
touching = bed.pressure.values > 0.0
claim = CLAIMS[25](Evidence((ClaimRun.of("recipe", ds),), any_size=True))
drawn = {name: roughvol.plot("recipe", name).axes[0] for name in ("depth_of_p", "seal_depth")}

np.save("worn.npy", np.eye(5))

def answer(surface, specimen):
    try:
        return roughvol.study.loads(f"{{surface: {surface}, specimen: {specimen}}}").specimen.cycles
    except roughvol.errors.RoughvolError as error:
        return str(error)

print(json.dumps({
    "schema": call("schema"),
    "sections": [
        answer("{file: worn.npy, L: 1}", "{label: seat, cycles: 3}"),
        answer("{file: worn.npy, L: 1}", "{label: seat, cycles: -1}"),
        answer("{D: 2.3, m: 3}", "{label: seat}"),
    ],
    "unit": ds.largest_gap.attrs["units"],
    "stored": ds.largest_gap.values.ravel().tolist(),
    "gap": (ds.free_volume * ds.Sq).values.ravel().tolist(),
    "mean": ds.roughvol.mean("seed").largest_gap.values.ravel().tolist(),
    "show": call("show", "recipe"),
    "pressure": bed.pressure.values[touching].tolist(),
    "height": bed.heights.values[touching].tolist(),
    "lines": {name: [line.get_ydata().tolist() for line in ax.lines] for name, ax in drawn.items()},
    "labels": {name: ax.get_ylabel() for name, ax in drawn.items()},
    "claim": [claim.title, claim.verdict, claim.all_numbers["smallest"].value],
}))
"""


def blocks(recipe: str) -> list[tuple[str, str, str]]:
    """Return file, place and text of the examples of a recipe."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    part = text.split(f"**{recipe}.**")[1].split("\n**")[0]
    return [(file, place, textwrap.dedent(body)) for _, file, place, body in BLOCK.findall(part)]


def written(text: str, place: str, block: str) -> str:
    """Return the text of a file with a block at its place."""
    if place == "new":
        return block
    if place == "at the end":
        return f"{text}\n\n{block}"
    lines, tree = text.splitlines(keepends=True), ast.parse(text)
    if place == "after the imports":
        last = max(node.end_lineno or 0 for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom))
        return "".join([*lines[:last], block, *lines[last:]])
    name = place.removeprefix("in ")
    (node,) = (node for node in tree.body if name in _names(node))
    end = node.end_lineno or 0
    if isinstance(node, ast.ClassDef):
        fields = [part for part in node.body if isinstance(part, ast.AnnAssign)]
        end = fields[-1].end_lineno or 0
        return "".join([*lines[:end], textwrap.indent(block, "    "), *lines[end:]])
    inside, bracket = "".join(lines[:end]).rstrip(), lines[end:]
    comma = "" if inside[:-1].rstrip().endswith((",", "(", "[", "{")) else ", "
    return "".join([inside[:-1], comma, block.strip(), "\n", inside[-1], "\n", *bracket])


def _names(node: ast.stmt) -> list[str]:
    """Return the names that a statement at the top of a module defines."""
    if isinstance(node, ast.ClassDef):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return [target.id for target in targets if isinstance(target, ast.Name)]


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a copy of the package in which the recipes were carried out."""
    folder = tmp_path_factory.mktemp("recipes")
    shutil.copytree(ROOT / "roughvol", folder / "roughvol")  # with its compiled files, which save seconds
    for recipe in FILES:
        for name, place, block in blocks(recipe):
            file = folder / "roughvol" / name
            assert file.exists() != (place == "new"), name
            text = file.read_text(encoding="utf-8") if file.exists() else ""
            file.write_text(written(text, place, block), encoding="utf-8")
    for name, text in (("recipe", STUDY), ("bed", BED)):
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def found(package: Path) -> Any:
    """Return what the copy answers about a small study."""
    return json.loads(python("-c", USE, cwd=package, first=package).stdout)


@pytest.mark.parametrize(("recipe", "files"), FILES.items())
def test_a_recipe_touches_few_files(recipe: str, files: int) -> None:
    assert 0 < len({file for file, _, _ in blocks(recipe)}) <= files


def test_an_observable_is_stored_with_its_unit_and_has_column_mean_and_figure(found: Any) -> None:
    assert found["unit"] == "um"
    assert all(largest > mean > 0.0 for largest, mean in zip(found["stored"], found["gap"], strict=True))
    assert "g_max [um]" in found["show"]
    first, second = found["stored"][:3], found["stored"][3:]
    assert found["mean"][:3] == pytest.approx([(a + b) / 2.0 for a, b in zip(first, second, strict=True)])
    assert found["lines"]["depth_of_p"]
    assert "largest gap" in found["labels"]["depth_of_p"]


def test_a_section_is_in_the_schema_and_obeys_its_rule(found: Any) -> None:
    assert "loadings before the measurement, >= 0" in found["schema"]
    cycles, negative, generated = found["sections"]
    assert cycles == 3
    assert "specimen.cycles" in negative
    assert ">= 0" in negative
    assert "needs surface.file" in generated


def test_a_figure_is_drawn_by_its_name(found: Any) -> None:
    assert found["lines"]["seal_depth"] == [pytest.approx(found["stored"][:3])]
    assert found["labels"]["seal_depth"] == "largest gap [µm]"


def test_a_claim_has_a_verdict(found: Any) -> None:
    title, verdict, smallest = found["claim"]
    assert (title, verdict) == ("Some void is left", "holds")
    assert smallest > 0.0


def test_a_kernel_is_offered_and_solved(found: Any) -> None:
    """Independent springs yield in proportion: the pressure is linear in the height."""
    pressure, height = np.array(found["pressure"]), np.array(found["height"])
    assert pressure.size > 10
    assert np.corrcoef(pressure, height)[0, 1] == pytest.approx(1.0, abs=1e-6)
