"""Studies: what is read, what is refused and how it is said, which cases come out and what names them."""

import contextlib
import itertools
import json
import pickle
import re
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from roughvol.errors import Problem, StudyError
from roughvol.study import (
    ACCURACY,
    HEIGHT_FORMATS,
    GeneratedSurface,
    Level,
    SpectralSurface,
    Study,
    json_schema,
    load,
    loads,
)
from roughvol.study.reference import keys
from roughvol.study.values.state_kinds import LISTS
from roughvol.surfaces.body import UNTREATED
from tests.study.kit import in_full, problems_of, table

CONFIGS = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))
SURFACE = "surface: {D: 2.3, m: 4}\n"
FULL = """\
name: full
surface:
  D: [2.1, 2.125, 2.9]
  m: [3, 4]
  L: 50
  seeds: [7, 1]
  midpoint_law: variance
material: {E: 210.0e+9, nu: 0.3, hardness: 2e9, plastic: false}
sweep: {steps: 40, to: {separation: -1}}
solver: {accuracy: draft, rtol: 1e-8, kernel: punch, method: paper}
record:
  heights: true
  fields_at: {step: [1, 40], contact_area: 0.05}
  box_counting: {at: {separation: [2, 0.5]}, thresholds: [0, 1]}
  volume_density: {bins: 20, at: last, include_contact: true}
"""


# What is read


def test_the_shortest_study_has_the_documented_defaults() -> None:
    study = loads(SURFACE)
    surface = study.surface
    assert (surface.D, surface.m, surface.L, surface.midpoint_law) == ((2.3,), (4,), 100.0, "std")
    assert surface.seeds == tuple(range(10))
    assert study.material.contact_modulus == 1.0
    assert (study.sweep.steps, study.sweep.target) == (60, Level("mean-plane"))
    assert (study.solver.kernel, study.solver.method, study.solver.tolerance) == ("love", "fast", ACCURACY["standard"])
    assert not any(study.record.model_dump().values())


def test_every_key_is_read() -> None:
    study = loads(FULL)
    surface, record = study.surface, study.record
    assert (surface.seeds, surface.L, surface.midpoint_law) == ((7, 1), 50.0, "variance")
    assert study.material.contact_modulus == pytest.approx(210e9 / 0.91, rel=1e-15)
    assert study.material.hardness == 2e9
    assert study.sweep.target == Level("separation", -1.0)
    assert (study.solver.tolerance, study.solver.kernel, study.solver.method) == (1e-8, "punch", "paper")
    assert [level.label for level in record.fields_at.levels] == ["step=1", "step=40", "contact_area=0.05"]
    assert [level.label for level in record.box_counting.at.levels] == ["separation=2", "separation=0.5"]
    assert record.box_counting.thresholds == (0.0, 1.0)
    assert record.volume_density.at.levels == (Level("last"),)
    assert (record.volume_density.bins, record.volume_density.include_contact) == (20, True)


def test_empty_mappings_record_with_defaults() -> None:
    record = loads(SURFACE + "record: {box_counting: {}, volume_density: {}}").record
    assert record.box_counting.thresholds == (0.0, 0.1, 0.25, 0.5, 1.0)
    assert record.volume_density.bins == 50
    assert record.box_counting.at.levels == record.volume_density.at.levels == (Level("last"),)
    assert record.fields_at is None


@pytest.mark.parametrize("text", ["1e-8", "1.0e-8", "1E-8", "+.1e-7", "0.00000001", "10e-9"])
def test_a_number_is_a_number_however_it_is_written(text: str) -> None:
    assert loads(SURFACE + f"solver: {{rtol: {text}}}").solver.tolerance == 1e-8


@pytest.mark.parametrize("accuracy", list(ACCURACY))
def test_accuracy_stands_for_a_tolerance_unless_one_is_given(accuracy: str) -> None:
    assert loads(SURFACE + f"solver: {{accuracy: {accuracy}}}").solver.tolerance == ACCURACY[accuracy]
    assert loads(SURFACE + f"solver: {{accuracy: {accuracy}, rtol: 0.01}}").solver.tolerance == 0.01


def test_level_labels_differ_where_values_differ() -> None:
    values = [0.1, 0.1 + 1e-15, 1e-9, 60, 2.0, 1234567.5]
    labels = [Level("pressure", value).label for value in values]
    assert labels[:1] + labels[2:5] == ["pressure=0.1", "pressure=1e-09", "pressure=60", "pressure=2"]
    assert [float(label.partition("=")[2]) for label in labels] == values


def test_the_name_is_that_of_the_file_unless_given(tmp_path: Path) -> None:
    for stem, name in {"seal": "seal", "a b.c": "a_b_c", "--": "study", "ü": "_"}.items():
        path = tmp_path / f"{stem}.yaml"
        path.write_text(SURFACE, encoding="utf-8")
        assert load(path).name == name
    for name in ("given-1_a", "v1.2_run", "1.0", "_a.b-c", "a."):
        assert loads(f'{SURFACE}name: "{name}"\n', path).name == name


def test_a_byte_order_mark_is_no_part_of_the_study(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + SURFACE.encode())
    assert load(path) == loads(SURFACE)


def test_the_smoke_study_is_small_and_records_everything() -> None:
    study = load(next(path for path in CONFIGS if path.stem == "smoke"))
    assert len(study.cases()) * study.sweep.steps * max(4 ** (case.m or 0) for case in study.cases()) < 200_000
    left_out = {name for name, value in study.record.model_dump().items() if not value}
    others = {"region", "region_widths", "dimensional", "residual_heights", "all_legs", "fluid_pressure", "own"}
    assert left_out <= others


def test_a_number_may_have_a_unit() -> None:
    study = loads(
        "surface: {D: 2.3, m: 4, L: 0.1mm, Sq: 500 nm}\nmaterial: {E: 210 GPa, nu: 0.3, hardness: 2000 MPa}\n"
        "record:\n  transport: {transmissivity: last}\n"
        "  dimensional: {pressure: psi, leak_rate: {pressure_drop: 1 bar, viscosity: 1 mPa*s}}"
    )
    surface, material = study.surface, study.material
    assert (float(surface.L), surface.length_unit) == (0.1, "mm")
    assert surface.height == pytest.approx(5e-4, rel=1e-14)
    assert (material.unit, material.contact_modulus) == ("GPa", pytest.approx(210 / 0.91, rel=1e-14))
    assert material.indentation_hardness == pytest.approx(2.0, rel=1e-14)
    assert study.record.dimensional.leak_rate.drive == pytest.approx(1e5 / 1e-3 * 1e9, rel=1e-12)
    assert {case.length_unit for case in study.cases()} == {"mm"}
    assert "L: 0.1 mm" in study.to_yaml()


@pytest.mark.parametrize(("text", "unit"), [("2 um", "um"), ("2µm", "um"), ("2.0e0  micron", "um"), ("2.5e-1 m", "m")])
def test_a_length_has_one_name_for_its_unit(text: str, unit: str) -> None:
    study = loads(f"surface: {{D: 2.3, m: 4, L: {text}}}")
    assert study.surface.length_unit == unit
    assert loads(study.to_yaml()).surface.length_unit == unit


@settings(max_examples=50)
@given(
    st.text(alphabet="aAbcdegGhkKlmMnNPsuµ*/^ ·²³0123456789.-{}%", max_size=12),
    st.sampled_from(["surface: {D: 2.3, m: 4, L: '1 @'}", SURFACE + "material: {E_star: '1 @'}"]),
)
def test_whatever_stands_for_a_unit_is_read_or_refused(unit: str, where: str) -> None:
    text, study = where.replace("@", unit), None
    with contextlib.suppress(StudyError):
        study = loads(text)
    if study is None:
        assert len(problems_of(text)) == 1
    else:
        assert loads(study.to_yaml()) == study
        assert (study.surface.length_unit is None) != (study.material.unit is None)


# Writing it out again


UNITS = """\
surface: {D: 2.3, m: 4, L: 100 um, Sq: 0.5 um}
material: {E_star: 10 MPa, hardness: 1 bar}
record:
  transport: {transmissivity: last, constriction: last}
  region_widths: {shares: [1, 0.5], at: last, transmissivity: {step: 4}}
  dimensional: {pressure: MPa, critical_gap: nm, leak_rate: {pressure_drop: 1 bar, viscosity: 1 mPa*s, unit: ml/min}}
"""


@pytest.mark.parametrize("text", [SURFACE, FULL, UNITS, SURFACE + "name: '1e5'\nsweep: {to: {contact_area: 0.1}}"])
def test_the_resolved_study_reads_back_equal(text: str) -> None:
    study = loads(text)
    written = study.to_yaml()
    assert loads(written) == study
    assert loads(written).to_yaml() == written
    assert loads(written).cases() == study.cases()


def test_the_resolved_study_names_every_key() -> None:
    study = loads(SURFACE)
    written = yaml.safe_load(study.to_yaml())
    assert "fluid" not in written.keys() | yaml.safe_load(study.stored()).keys()
    for section in ("surface", "sweep", "solver", "record"):
        assert written[section].keys() == type(getattr(study, section)).model_fields.keys() - {*LISTS, "periodic"}


def test_a_height_file_is_found_beside_its_study(here: Path) -> None:
    folder = here / "deep"
    folder.mkdir()
    np.save(folder / "z.npy", np.zeros((3, 3)))
    (folder / "study.yaml").write_text("surface: {file: z.npy, L: 2}", encoding="utf-8")
    study = load("deep/study.yaml")
    assert loads(study.to_yaml()) == study
    assert yaml.safe_load(study.to_yaml())["surface"]["file"] == str(folder / "z.npy")
    (case,) = study.cases()
    assert (case.file, case.L, case.D, case.seed) == (folder / "z.npy", 2.0, None, None)


# Cases


def test_cases_run_over_seeds_then_m_then_D() -> None:
    cases = loads(FULL).cases()
    product = itertools.product((2.1, 2.125, 2.9), (3, 4), (7, 1))
    assert [(case.D, case.m, case.seed) for case in cases] == list(product)
    assert cases[0].label == "D = 2.10, m = 3, seed 7"


def test_ids_are_readable_and_never_shared() -> None:
    text = "surface: {D: [2.1, 2.10, 2.125, 2.1000000000000005], m: [3, 12], seeds: [0, 3, 12345]}"
    cases = loads(text.replace("2.10,", "2.15,")).cases()
    ids = [case.id for case in cases]
    prefixes = [case_id.rpartition("-")[0] for case_id in ids]
    assert prefixes[:4] == ["D2.10_m3_s000", "D2.10_m3_s003", "D2.10_m3_s12345", "D2.10_m12_s000"]
    assert "D2.125_m3_s000" in prefixes
    assert "D2.1000000000000005_m3_s000" in prefixes
    assert len(set(prefixes)) == len(cases) == 24
    assert all(len(case_id.rpartition("-")[2]) == 8 for case_id in ids)


def test_one_id_is_pinned() -> None:
    # A change here makes every stored case of every user look like another one.
    assert loads("surface: {D: 2.3, m: 8, seeds: [3]}").cases()[0].id == "D2.30_m8_s003-577831fe"


IDENTITY = table("identity.toml")


@pytest.mark.parametrize("family", IDENTITY)
def test_what_changes_the_answer_changes_the_id_and_nothing_else(family: str, tmp_path: Path) -> None:
    for seed, name in enumerate(("z.npy", "b.npy")):
        np.save(tmp_path / name, np.random.default_rng(seed).normal(size=(12, 12)))
    seen: set[str] = set()
    for group in IDENTITY[family]:
        studies = [loads(in_full(text), tmp_path / "study.yaml") for text in group]
        assert [loads(study.to_yaml()) for study in studies] == studies
        for study in studies:  # the key of a case is read with the states that are stored
            key = study.cases()[0].key["record"]
            assert type(study.record).model_validate(key) == study.record.model_copy(update={"dimensional": None})
        first, *others = ({case.id for case in study.cases()} for study in studies)
        assert others == [first] * len(others), group
        assert not first & seen, group
        seen |= first


def test_cases_travel_between_processes() -> None:
    case = loads(FULL).cases()[3]
    copy = pickle.loads(pickle.dumps(case))
    assert copy == case
    assert (copy.id, copy.sweep.target, hash(copy)) == (case.id, case.sweep.target, hash(case))
    assert json.loads(json.dumps(case.key, allow_nan=False)) == case.key


def test_defaults_are_part_of_the_key_written_out_or_not(tmp_path: Path) -> None:
    np.save(tmp_path / "z.npy", np.arange(12.0).reshape(3, 4))
    one = "surface: {file: z.npy, L: 2, sides: free}"
    defaults = "level: none, missing: refuse, low_pass: null, against: null}"
    texts = one, f"surface: {{file: z.npy, L: 2, sides: free, unit: um, {defaults}"
    cases = [loads(text, tmp_path / "study.yaml").cases()[0] for text in texts]
    assert [case.id for case in cases] == ["z-c0baff5c"] * 2  # pinned: a change outdates every stored case
    assert cases[0].key["surface"]["treatment"].keys() == {field.name for field in fields(UNTREATED)}
    generated = loads("surface: {D: 2.3, m: 4}").cases()[0].key
    assert generated["record"].keys() == loads(SURFACE).record.model_dump().keys() - {"dimensional", "own"}
    assert generated["pressed"]["solver"].keys() == {"rtol", "pressure_error", "method"}


def test_the_id_of_height_files_follows_the_content_of_both(tmp_path: Path) -> None:
    for name in ("my a", "b"):
        np.save(tmp_path / f"{name}.npy", np.zeros((3, 3)))
    study = loads("surface: {file: my a.npy, L: 2, against: {file: b.npy}}", tmp_path / "study.yaml")
    assert loads(study.to_yaml()) == study
    (before,), (again,) = study.cases(), study.cases()
    assert before.id == again.id
    assert before.id.rpartition("-")[0] == "my_a"
    assert (before.label, before.surface_text) == ("my a.npy against b.npy", "heights of b.npy added")
    for name, key in (("b", "surface.against.file"), ("my a", "surface.file")):
        np.save(tmp_path / f"{name}.npy", np.ones((3, 3)))
        (after,) = study.cases()
        assert before.id != after.id
        assert replace(after, bodies=before.bodies).id == before.id
        assert pickle.loads(pickle.dumps(after)) == after
        (tmp_path / f"{name}.npy").rename(tmp_path / "moved")
        with pytest.raises(StudyError, match=rf"{re.escape(key)}: cannot read"):
            study.cases()
        (tmp_path / "moved").rename(tmp_path / f"{name}.npy")
        before = after


def test_lengths_of_a_measured_surface_come_in_one_unit(tmp_path: Path) -> None:
    np.save(tmp_path / "z.npy", np.zeros((3, 3)))
    text = "surface: {file: z.npy, L: 100 um, low_pass: 0.06 mm}"
    (case,) = loads(text, tmp_path / "study.yaml").cases()
    assert (case.L, case.length_unit) == (100.0, "um")
    assert case.treatment.low_pass == pytest.approx(60.0, rel=1e-15)
    (named,) = loads("surface: {file: z.npy, L: 100, unit: µm}", tmp_path / "study.yaml").cases()
    (plain,) = loads("surface: {file: z.npy, L: 100 um}", tmp_path / "s.yaml").cases()
    assert (named.length_unit, named.id) == ("um", plain.id)


def test_files_of_instruments_need_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    (tmp_path / "scan.al3d").touch()
    (problem,) = problems_of("surface: {file: scan.al3d}", tmp_path / "study.yaml")
    assert (problem.key, problem.line) == ("surface.file", 1)
    assert "must end in one of .npy .npz .nc .txt .csv .xyz .dat .asc .grd .gsf .tif .tiff" in problem.message
    assert "pip install 'roughvol[measured]'" in problem.message


def test_two_elastic_bodies_are_as_soft_as_both_together() -> None:
    alone, other = loads(SURFACE + "material: {E: 2, nu: 0.3}"), loads(SURFACE + "material: {E: 3, nu: 0.4}")
    both = loads(SURFACE + "material: {E: 2, nu: 0.3, against: {E: 3, nu: 0.4}}")
    compliances = [1 / study.material.contact_modulus for study in (alone, other, both)]
    assert compliances[2] == pytest.approx(compliances[0] + compliances[1], rel=1e-15)
    assert loads(both.to_yaml()) == both
    assert "against: null" in alone.to_yaml()
    equal = loads(SURFACE + "material: {E: 210 GPa, nu: 0.3, against: {E: 210000 MPa, nu: 0.3}}").material
    assert equal.contact_modulus == pytest.approx(210 / 0.91 / 2, rel=1e-14)
    assert equal.unit == "GPa"


def test_all_problems_come_together_in_the_order_of_the_file() -> None:
    text = """\
name: a b
surface:
  m: [7, 8.5, 20]
  D: [2.3, 3.2, 2.3, .nan]
  seed: 3
solver: {rtol: 1, method: paper, kernel: lov}
sweep:
  steps: 10
  steps: 11
  to: {contact_area: 0.1}
record:
  fields_at: {step: [10, 12, 0], contact_area: [0.5]}
  heights: 1
"""
    assert ", ".join(f"{problem.line} {problem.key}" for problem in problems_of(text)) == (
        "1 name, 3 surface.m[0], 3 surface.m[1], 3 surface.m[2], 4 surface.D[1], 4 surface.D[2], 4 surface.D[3], "
        "5 surface.seed, 6 solver.rtol, 6 solver.kernel, 9 sweep.steps, 12 record.fields_at.step[1], "
        "12 record.fields_at.step[2], 12 record.fields_at.contact_area[0], 13 record.heights"
    )


def test_messages_print_whatever_the_file_holds() -> None:
    for problem in problems_of('"\\e[31m": 1\nsurface: {D: "\\e[31m\\ud800", m: 4}'):
        assert str(problem).isprintable()


def test_files_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "latin.yaml").write_bytes(b"# one\nname: m\xfcller\n")
    (tmp_path / "huge.yaml").write_bytes("é".encode() * (1 << 20))
    (tmp_path / "huge.nc").write_bytes(b"CDF" * (1 << 20))
    (tmp_path / "null.yaml").write_bytes(bytes(10))
    said = {
        "latin.yaml": (2, "not text in UTF-8"),
        "huge.yaml": (None, "larger than 1024 KiB"),
        "huge.nc": (None, "holds results and is no study file"),
        "null.yaml": (1, "not YAML"),
        "absent.yaml": (None, "cannot read the study: No such file"),
        "absent/study.yaml": (None, "cannot read the study: No such file"),
        ".": (None, "cannot read the study: Is a directory"),
        "a\0b.yaml": (None, "cannot read the study: embedded null"),
        "a" * 300: (None, "cannot read the study: File name too long"),
    }
    for name, (line, words) in said.items():
        with pytest.raises(StudyError) as caught:
            load(f"{tmp_path}/{name}")
        (problem,) = caught.value.problems
        assert problem.line == line, name
        assert words in problem.message
        assert problem.file.startswith(str(tmp_path))
        assert str(problem).isprintable()


# Nothing but a study or a StudyError


def _study_or_error(text: str) -> None:
    problems: tuple[Problem, ...] = ()
    try:
        study = loads(text, "a.yaml")
    except StudyError as error:
        problems = error.problems
    if not problems:
        assert loads(study.to_yaml()) == study
    assert all(problem.message and str(problem).isprintable() for problem in problems)
    lines = [problem.line or 0 for problem in problems]
    assert lines == sorted(lines)


@settings(max_examples=40, derandomize=True)
@given(st.text(st.characters() | st.sampled_from(list(":{}[]-#&*!|>'\"%@`,?\n ")), max_size=60))
def test_any_text_is_a_study_or_a_study_error(text: str) -> None:
    _study_or_error(text)


@settings(max_examples=50, derandomize=True)
@given(st.data())
def test_a_damaged_study_is_a_study_or_a_study_error(data: st.DataObject) -> None:
    text = FULL
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(text)))
        stop = data.draw(st.integers(start, min(start + 12, len(text))))
        text = text[:start] + data.draw(st.text(max_size=4) | st.sampled_from(FULL.split())) + text[stop:]
    _study_or_error(text)


VALUES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.just("1e-320 pm")
TREES = st.recursive(
    VALUES,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)
PLACES = st.sampled_from(
    [
        *[(section,) for section in ("name", "surface", "material", "sweep", "solver", "record")],
        *[("surface", key) for key in (*SpectralSurface.model_fields, "m", "midpoint_law", "file", "variable")],
        *[("sweep", "steps"), ("sweep", "to"), ("sweep", "to", "separation"), ("solver", "rtol"), ("material", "E")],
        *[("record", "fields_at"), ("record", "fields_at", "step"), ("record", "box_counting", "at")],
    ]
)


@pytest.mark.parametrize("text", [FULL, "surface: {H: 0.8, n: 32}\nsweep: {steps: 0}"])
@settings(max_examples=30, derandomize=True)
@given(changes=st.lists(st.tuples(PLACES, TREES), min_size=1, max_size=3))
def test_any_value_anywhere_is_a_study_or_a_study_error(text: str, changes: list[tuple[tuple[str, ...], Any]]) -> None:
    study = yaml.safe_load(text)
    for place, value in changes:
        here = study
        for part in place[:-1]:
            here = here[part] if isinstance(here.get(part), dict) else here.setdefault(f"{part}_", {})
        here[place[-1]] = value
    _study_or_error(yaml.safe_dump(study))


# The schema for editors


def _objects(schema: Any) -> list[dict[str, Any]]:
    if isinstance(schema, list):
        return [found for item in schema for found in _objects(item)]
    if not isinstance(schema, dict):
        return []
    inside = [found for value in schema.values() for found in _objects(value)]
    return [schema, *inside] if "properties" in schema and "type" in schema else inside


def test_the_schema_is_strict_and_explains_every_key() -> None:
    objects = _objects(json_schema())
    assert len(objects) >= 10
    open_ = [found["title"] for found in objects if found["additionalProperties"] is not False]
    assert open_ == ["Accuracies"]  # takes names of record.own
    for found in objects:
        assert all("description" in value for value in found["properties"].values())


def test_the_schema_holds_ranges_choices_and_defaults() -> None:
    schema = json_schema()
    surface = schema["$defs"]["GeneratedSurface"]
    dimension = surface["properties"]["D"]["anyOf"]
    assert {"type": "number", "exclusiveMinimum": 2, "exclusiveMaximum": 3} in dimension
    assert [one["type"] for one in dimension] == ["number", "array"]
    assert {"type": "integer", "minimum": 1, "maximum": 13} in surface["properties"]["m"]["anyOf"][1]["anyOf"]
    assert not any(f'"{bound}":' in json.dumps(schema) for bound in ("ge", "gt", "le", "lt"))
    assert surface["required"] == ["D", "m"]
    assert surface["properties"]["seeds"]["default"] == 10
    assert surface["properties"]["midpoint_law"]["enum"] == ["std", "variance"]
    assert schema["required"] == ["surface"]
    assert schema["properties"]["solver"]["anyOf"][0] == {"const": "paper"}


def test_the_schema_takes_the_forms_that_a_study_takes() -> None:
    file = json_schema()["$defs"]["HeightFile"]
    assert all(f"*{ending}" in file["properties"]["file"]["description"] for ending in HEIGHT_FORMATS)
    assert "file" not in file["required"]
    assert file["anyOf"] == [{"required": ["file"]}, {"required": ["files"]}]
    values = {key.path: key.values for key in reversed(keys())}
    assert values["surface.files"] == "text; or a list of these"
    assert values["surface.variable"] == "text or a whole number >= 0"
    assert values["sweep.to.contact_area"] == "a number > 0 and <= 1; or a list of these"


def test_a_study_made_in_python_obeys_the_same_rules() -> None:
    surface = GeneratedSurface(D=(2.3,), m=(7,))
    assert Study(surface=surface).surface == surface
    with pytest.raises(ValueError, match="takes m <= 6"):
        Study(surface=surface, solver={"method": "paper"})  # type: ignore[arg-type]


def test_the_first_leg_may_unload_behind_its_first_state() -> None:
    (leg,) = loads("surface: {D: 2.3, m: 4}\nsweep: [{pressures: [1, 0.5, 0]}]").sweep.legs
    assert [level.value for level in leg.listed] == [1.0, 0.5, 0.0]


def test_whole_numbers_may_be_written_with_a_point(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((9, 9)))
    for text in (
        "surface: {D: 2.3, m: [8.0, 7], seeds: 3.0}\nsweep: {steps: 60.0}\nrecord: {volume_density: {bins: 9.0}}\n",
        "surface: {D: 2.3, m: 3, seeds: [1.0, 4]}",
        "surface: {file: a.npy, L: 1, downsample: 2.0, outliers: {window: 7.0}}",
    ):
        study, same = (loads(one, tmp_path / "a.yaml") for one in (text, text.replace(".0", "")))
        assert study == same
        assert [case.id for case in study.cases()] == [case.id for case in same.cases()]
        assert study.to_yaml() == same.to_yaml()
        assert type(study.sweep.steps) is int


def test_a_stored_study_goes_without_its_files_and_names_no_folder(tmp_path: Path) -> None:
    for name in ("a.npy", "b.npy"):
        np.save(tmp_path / name, np.zeros((3, 3)))
    text = f"surface: {{file: ./a.npy, L: 2, against: {{file: {tmp_path / 'b.npy'}}}}}"
    study = loads(text, tmp_path / "study.yaml")
    assert pickle.loads(pickle.dumps(study)).stored() == study.stored()
    assert "name: other" in study.model_copy(update={"name": "other"}).stored()
    assert str(tmp_path) not in study.stored()
    again = loads(study.stored(), stored=True)
    assert (again.surface.file, again.surface.against.file) == ("./a.npy", "b.npy")
    assert again.stored() == study.stored()


@pytest.mark.parametrize(
    ("seeds", "material"),
    [("3", "{E_star: 1}"), ("[2, 1]", "{E_star: 1}"), ("[0]", "[{E_star: 1}, {E_star: 2}]"), ("2500", "{E_star: 1}")],
)
def test_the_text_in_the_files_of_cases_is_the_study_and_short(seeds: str, material: str) -> None:
    study = loads(f"name: s\nsurface: {{D: [2.2, 2.5], m: 3, seeds: {seeds}}}\nmaterial: {material}")
    text = study.of_each_case()
    assert loads(text, stored=True).stored() == study.stored()
    assert len(text) < 2000


# Studies that are shipped


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_shipped_study_loads_and_is_the_same_when_resolved(path: Path) -> None:
    study = load(path)
    assert study.name == path.stem
    assert len({case.id for case in study.cases()}) == len(study.cases()) > 0
    assert path.read_text(encoding="utf-8").startswith("# ")  # a line on what it feeds
    assert loads(study.to_yaml()) == study
