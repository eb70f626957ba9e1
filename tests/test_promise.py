"""The promise of docs/reference/promise.md: no public name leaves without a row in the table of former spellings."""

from pathlib import Path

import pytest

from roughvol import spellings
from roughvol.spellings import Former
from tests import public_names

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "promise.md"


@pytest.fixture(scope="module")
def now() -> dict[str, list[str]]:
    """The public names of this version."""
    return public_names.public()


def test_no_public_name_is_gone(now: dict[str, list[str]]) -> None:
    lost = public_names.gone(public_names.stored(), now)
    assert lost == [], f"public no more, without a row in roughvol/spellings.py: {lost}"


def test_the_list_has_every_public_name(now: dict[str, list[str]]) -> None:
    listed = public_names.stored()
    new = [f"{kind}: {name}" for kind, names in now.items() for name in sorted({*names} - {*listed.get(kind, ())})]
    assert new == [], f"new public names; `make public` adds them to {public_names.FILE.name}: {new}"


def test_a_name_that_is_gone_needs_its_row(now: dict[str, list[str]], monkeypatch: pytest.MonkeyPatch) -> None:
    before = {kind: [*names, "gone"] for kind, names in now.items()}
    assert public_names.gone(before, now) == [f"{kind}: gone" for kind in now]
    rows = tuple(Former(kind, "gone", "come", "1.0.0", "2.0.0") for kind in now)
    monkeypatch.setattr(spellings, "FORMER", rows)
    assert public_names.gone(before, now) == []


def test_each_kind_of_public_name_is_on_the_page(now: dict[str, list[str]]) -> None:
    """A row of the page names an example of each kind."""
    text = PAGE.read_text(encoding="utf-8")
    for kind, names in now.items():
        assert any(f"`{name}`" in text for name in names), f"no {kind} is on the page"
