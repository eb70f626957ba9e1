"""What a package holds, and what PyPI shows of it."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest

import roughvol

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    backend = pytest.importorskip("hatchling.build", reason="needs roughvol[dev]")
    pytest.importorskip("hatch_fancy_pypi_readme", reason="needs roughvol[dev]")
    place = tmp_path_factory.mktemp("dist")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        return place / backend.build_wheel(str(place))


def test_the_wheel_holds_the_package_its_types_and_its_command(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as held:
        names = set(held.namelist())
    modules = {path.relative_to(ROOT).as_posix() for path in (ROOT / "roughvol").rglob("*.py")}
    examples = {path.relative_to(ROOT).as_posix() for path in (ROOT / "roughvol" / "examples").iterdir()}
    assert examples
    assert modules | examples | {"roughvol/py.typed", "roughvol/report/report.css"} <= names
    assert not [name for name in names if not name.startswith(("roughvol/", "roughvol-"))]


def test_the_description_on_pypi_renders_and_refers_to_nothing_that_is_not_there(wheel: Path) -> None:
    markdown = pytest.importorskip("readme_renderer.markdown", reason="needs roughvol[dev]")
    with zipfile.ZipFile(wheel) as held:
        (name,) = [name for name in held.namelist() if name.endswith(".dist-info/METADATA")]
        metadata = message_from_bytes(held.read(name))
    assert metadata["Version"] == roughvol.__version__
    assert metadata["Description-Content-Type"] == "text/markdown"
    shown = markdown.render(metadata.get_payload())
    assert shown is not None
    targets = re.findall(r'(?:href|src)="([^"]*)"', shown)
    assert [target for target in targets if not target.startswith(("https://", "mailto:", "#"))] == []
    assert "docs/how-to/sealing.md" in shown  # a page is still named where its link cannot work
    assert "docs/pictures/fig05.png" in shown


def test_every_picture_and_page_that_the_readme_refers_to_is_in_the_repository() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    targets = [target for target in re.findall(r"\]\(([^)\s]+)\)", text) if not target.startswith(("https:", "#"))]
    assert targets
    assert [target for target in targets if not (ROOT / target).exists()] == []


def test_python_m_roughvol_is_the_command() -> None:
    done = subprocess.run([sys.executable, "-m", "roughvol", "--version"], capture_output=True, text=True, timeout=100)
    assert done.stdout.strip() == f"roughvol, version {roughvol.__version__}"
