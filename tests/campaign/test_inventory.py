"""Cases that other runs under one root have finished."""

from pathlib import Path

import pytest
import xarray as xr

import roughvol
from roughvol.campaign import batch, inventory
from roughvol.store import dataset, run_status, stamped_file
from roughvol.store.same_study import differences
from roughvol.study import loads
from tests.campaign.kit import Events, values_of

pytestmark = pytest.mark.usefixtures("here")

HEAD = "surface: {D: 2.4, m: 3, seeds: 2}\nsweep: {steps: 4, to: {pressure: 1}}\n"
TEXT = f"{HEAD}record: {{fields_at: {{pressure: 0.5}}, transport: {{transmissivity: every-step}}}}\n"
OTHER = f"{HEAD}record: {{transport: {{percolation: every-step}}}}\n"


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Ids of the cases that are computed; a study named "idle" computes none and is interrupted."""
    ids: list[str] = []
    compute = batch.Batch.compute

    def follow(self: batch.Batch) -> None:
        if "name: idle" in self._study:
            raise KeyboardInterrupt
        ids.extend(case.id for case in self._cases)
        compute(self)

    monkeypatch.setattr(batch.Batch, "compute", follow)
    return ids


def test_another_record_is_computed_and_keeps_the_old_cases_until_then(computed: list[str]) -> None:
    before = roughvol.run(loads(TEXT, "x.yaml"), jobs=1)
    new = loads(f"name: idle\n{OTHER}", "x.yaml")
    files = {path: path.read_bytes() for path in Path("runs/x/cases").glob("*.nc")}
    with pytest.raises(KeyboardInterrupt):
        roughvol.run(new, out="runs/x", jobs=1)
    assert {path: path.read_bytes() for path in files} == files  # a kill loses nothing
    xr.testing.assert_identical(values_of(Path("runs/x")), values_of(before))
    assert not run_status.status(new, Path("runs/x")).collected
    after = roughvol.run(loads(OTHER, "x.yaml"), jobs=1)  # no --fresh
    assert "percolates" in after
    xr.testing.assert_identical(after.free_volume, before.free_volume)
    assert files.items() <= {path: path.read_bytes() for path in Path("runs/x/cases").glob("*.nc")}.items()
    assert run_status.status(loads(OTHER, "x.yaml")).collected
    assert len(computed) == 4
    assert "gap" in roughvol.run(loads(TEXT, "x.yaml"), jobs=1)  # going back computes nothing
    assert len(computed) == 4


def test_a_renamed_or_commented_study_and_one_with_shared_cases_compute_nothing(computed: list[str]) -> None:
    first, events = roughvol.run(loads(TEXT, "x.yaml"), jobs=1), Events()
    del computed[:]
    shared = loads(f"comment: the same\n{TEXT.replace('seeds: 2', 'seeds: [1]')}", "y.yaml")
    again = roughvol.run(shared, jobs=1, on_event=events)
    assert (computed, "1 finished in other runs" in "".join(events.notices)) == ([], True)
    assert (again.free_volume.sel(seed=1) == first.free_volume.sel(seed=1)).all()
    name = next(Path("runs/y/cases").glob("*.nc"))
    assert name.read_bytes() == (Path("runs/x/cases") / name.name).read_bytes()


def test_damaged_files_and_other_formats_of_a_sibling_are_not_used(computed: list[str]) -> None:
    roughvol.run(loads(TEXT, "x.yaml"), jobs=1)
    del computed[:]
    one, other = sorted(Path("runs/x/cases").glob("*.nc"))
    content = bytearray(one.read_bytes())
    content[len(content) // 2] ^= 1
    one.write_bytes(content)
    sound, labels = stamped_file.verified(other)
    stamped_file.store(other, stamped_file.stamped(sound, labels | {"format_of_answers": "2"}))
    roughvol.run(loads(TEXT, "y.yaml"), jobs=1)
    assert sorted(computed) == [one.stem, other.stem]


def test_runs_outside_a_root_share_nothing_and_a_region_has_its_own_cases(tmp_path: Path, computed: list[str]) -> None:
    study = loads(HEAD, "x.yaml")
    roughvol.run(study, out=tmp_path / "a", jobs=1)
    assert inventory.taken(tmp_path / "b", study.cases()) == []
    first = roughvol.run(study, jobs=1)
    inner = roughvol.run(loads(f"{HEAD}record: {{region: interior}}", "x.yaml"), jobs=1)
    assert len(computed) == 6
    assert not bool((first.contact_area_fraction == inner.contact_area_fraction).all())
    assert dataset.read(Path("runs/x/study.nc")).attrs["region"] != ""


def test_a_changed_record_is_no_reason_to_refuse_a_folder() -> None:
    text = "surface: {D: 2.3, m: 3, seeds: 1}\n"
    old = loads(text + "sweep: {steps: 4}\nrecord: {volume_density: {}}\ncomment: four", "x.yaml")
    assert differences(old, loads(text + "sweep: {steps: 3}", "x.yaml")) == ["sweep.steps: 4 → 3"]


def test_a_recorded_state_with_a_unit_is_no_reason_to_refuse_a_folder() -> None:
    """The key of a case has the modulus and Sq with such a state, and else without."""
    text = "surface: {D: 2.3, m: 3, L: 1 mm, Sq: 1 um, seeds: 1}\nmaterial: {E_star: 9 MPa}\nsweep: {steps: 4}\n"
    old, new = loads(text), loads(f"{text}record: {{fields_at: {{pressure: [0.1 MPa]}}}}")
    assert differences(old, new) == differences(new, old) == []
    harder = loads(f"{text}record: {{fields_at: {{pressure: [0.1 MPa]}}}}".replace("9 MPa", "8 MPa"))
    assert differences(new, harder) == ['material.E_star: "9 MPa" → "8 MPa"']
    assert differences(new, loads(text.replace("steps: 4", "steps: 3"))) == ["sweep.steps: 4 → 3"]
