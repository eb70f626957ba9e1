"""What a package holds, and what PyPI shows of it."""

import itertools
import json
import re
import subprocess
import sys
import tomllib
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest
import yaml

import roughvol
from tests import publish
from tests.kit import python
from tests.publish import LIBRARIES, PAGE, extract

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CHANGES = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel that is built from the sdist."""
    backend = pytest.importorskip("hatchling.build", reason="needs roughvol[dev]")
    pytest.importorskip("hatch_fancy_pypi_readme", reason="needs roughvol[dev]")
    place = tmp_path_factory.mktemp("dist")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        sdist = place / backend.build_sdist(str(place))
        extract(sdist, place)
        patch.chdir(place / sdist.name.removesuffix(".tar.gz"))
        return place / backend.build_wheel(str(place))


def test_the_wheel_holds_the_package_its_types_and_its_command(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as held:
        names = set(held.namelist())
    stored = {path.relative_to(ROOT).as_posix() for path in (ROOT / "roughvol").rglob("*.*") if path.is_file()}
    stored = {name for name in stored if "__pycache__" not in name}
    assert {Path(name).suffix for name in stored} == {
        ".py",
        ".pyi",
        ".typed",
        ".toml",
        ".css",
        ".html",
        ".yaml",
        ".mplstyle",
    }
    assert stored <= names
    assert not [name for name in names if not name.startswith(("roughvol/", "roughvol-"))]


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="these sources are no clone")
def test_the_sdist_holds_every_file_of_the_repository(wheel: Path) -> None:
    listed = subprocess.run(("git", "ls-files", "-z"), cwd=ROOT, capture_output=True, text=True, check=True).stdout
    sdist = wheel.parent / f"roughvol-{roughvol.__version__}"
    assert [name for name in listed.split("\0") if not (sdist / name).exists()] == []


def test_the_description_on_pypi_renders_and_refers_to_nothing_that_is_not_there(wheel: Path) -> None:
    markdown = pytest.importorskip("readme_renderer.markdown", reason="needs roughvol[dev]")
    with zipfile.ZipFile(wheel) as held:
        (name,) = [name for name in held.namelist() if name.endswith(".dist-info/METADATA")]
        metadata = message_from_bytes(held.read(name))
    assert metadata["Version"] == roughvol.__version__
    assert metadata["Description-Content-Type"] == "text/markdown"
    shown = markdown.render(metadata.get_payload())
    targets = re.findall(r'(?:href|src)="([^"]*)"', shown)
    assert [target for target in targets if not target.startswith(("https://", "mailto:", "#"))] == []
    assert "docs/how-to/sealing.md" in shown  # a page is still named where its link cannot work
    assert "docs/pictures/fig05.png" in shown


def test_the_citation_agrees_with_the_package() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == roughvol.__version__
    assert (citation["license"], citation["keywords"]) == (PROJECT["license"], PROJECT["keywords"])
    assert f"\n## {citation['version']} ({citation['date-released']})\n" in CHANGES


def test_the_python_versions_that_are_named_were_tried_with_the_lowest_and_the_newest_libraries() -> None:
    named = publish.pythons()
    row = re.compile(r"^\| (3\.\d+)\.\d+ \| (lowest|newest) \|.* (\d+) passed", re.MULTILINE)
    rows = row.findall(PAGE.read_text(encoding="utf-8"))
    assert {(version, libraries) for version, libraries, _ in rows} == set(itertools.product(named, LIBRARIES))
    assert all(int(passed) > 200 for *_, passed in rows)
    assert PROJECT["requires-python"] == f">={named[0]}"


def test_the_page_of_installed_libraries_is_not_written_without_a_row_of_every_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before, kept = PAGE.read_text(encoding="utf-8"), tmp_path / "rows.json"
    kept.write_text(json.dumps([{"python": "3.11.7", "libraries": "newest"}]))
    monkeypatch.setattr(sys, "argv", ["publish", "--page", "--python", "--rows", str(kept)])
    publish.main()
    assert "stays as it is: no row of 3.11 lowest, 3.12 lowest, 3.12 newest" in capsys.readouterr().out
    assert PAGE.read_text(encoding="utf-8") == before


def test_the_page_of_installed_libraries_has_the_bounds_of_the_project() -> None:
    lines = (line.partition(",")[0] for line in PROJECT["dependencies"])
    bounds = {name: bound for name, _, bound in (line.partition(">=") for line in lines)}
    text = PAGE.read_text(encoding="utf-8").partition("## Versions")[2]
    assert dict(re.findall(r"^\| ([\w-]+) \| ([\d.]+) \|", text, re.MULTILINE)) == bounds


def test_the_build_of_the_site_elsewhere_is_that_of_make_docs() -> None:
    steps = yaml.safe_load((ROOT / ".readthedocs.yaml").read_text(encoding="utf-8"))
    assert steps["sphinx"] == {"configuration": "docs/conf.py", "builder": "html", "fail_on_warning": True}
    assert steps["python"]["install"] == [{"method": "pip", "path": ".", "extra_requirements": ["docs"]}]
    assert f"Programming Language :: Python :: {steps['build']['tools']['python']}" in PROJECT["classifiers"]
    assert "sphinx --quiet -b html -W" in (ROOT / "Makefile").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("libraries", LIBRARIES)
def test_the_sdist_and_its_wheel_install_and_run(libraries: str, tmp_path: Path) -> None:
    kept = tmp_path / "rows.json"
    words = (sys.executable, "-m", "tests.publish", "--libraries", libraries, "--json", str(kept))
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(kept.read_text(encoding="utf-8"))
    assert row["versions"]["roughvol"] == roughvol.__version__
    assert re.match(r"\d+ passed", row["tests"])


def test_python_m_roughvol_is_the_command() -> None:
    assert python("-m", "roughvol", "--version").stdout.strip() == f"roughvol, version {roughvol.__version__}"
