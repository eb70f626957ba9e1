"""The key of a study that stores a variable: each is a key, and a study with it stores the variable."""

import pytest

from roughvol.observables.variables import VARIABLES
from roughvol.store.record_key import record_key
from roughvol.study.reference import keys


def test_every_key_is_one_of_a_study_file() -> None:
    known = {key.path for key in keys()}
    found = {name: record_key(name) for name in VARIABLES}
    assert {key for key in found.values() if key} <= known
    observed = [name for name, row in VARIABLES.items() if row.observable]
    assert [name for name in observed if not found[name]] == []


@pytest.mark.parametrize(
    ("variable", "key"),
    [
        ("leak_rate", "record.dimensional.leak_rate"),
        ("nominal_pressure", "record.dimensional.pressure"),
        ("transmissivity", "record.transport.transmissivity"),
        ("transmissivity_within", "record.region_widths.transmissivity"),
        ("gap", "record.fields_at"),
        ("heights", "record.heights"),
        ("rms_slope", "record.psd"),
        ("contact_conductance", "material.conductivity"),
        ("plastic_volume", "material.hardness"),
        ("load_above_hardness_fraction", "material.plastic"),
        ("seal_leak_rate", "seal"),
        ("mean_pressure", ""),
        ("separation", ""),
    ],
)
def test_a_variable_has_the_key_that_a_reader_of_the_reference_finds(variable: str, key: str) -> None:
    assert record_key(variable) == key
