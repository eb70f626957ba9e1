"""Units that messages name are accepted without pint; pint agrees with them."""

import pint
import pytest

from roughvol.study import loads, read
from roughvol.study.values.units import FACTORS, KINDS, convert, unit_of

REGISTRY = pint.get_application_registry()
NAMED = [(kind, unit) for kind, row in KINDS.items() for unit in row.units.removesuffix(" and the like").split(", ")]


@pytest.mark.parametrize(("kind", "unit"), NAMED)
def test_a_named_unit_is_of_its_kind(kind: str, unit: str) -> None:
    assert unit_of(read(f"2 {unit}", kind)) == unit
    if unit != "sccm":  # defined by this package
        assert REGISTRY.parse_units(unit).dimensionality == REGISTRY.get_dimensionality(KINDS[kind].dimension)


@pytest.mark.parametrize("wanted", FACTORS)
def test_factors_without_pint_have_the_bits_of_pint_0_25_and_agree_with_older_ones(wanted: str) -> None:
    older = tuple(map(int, pint.__version__.split(".")[:2])) < (0, 25)
    for given in FACTORS[wanted]:
        for value in (1.0, 0.1, 5.0, 293.15, 1e-7 / 3.0):
            expected = REGISTRY.Quantity(value, given).to(wanted).magnitude
            assert convert(value, given, wanted) == pytest.approx(expected, rel=1e-15 if older else 0.0, abs=0.0)


@pytest.mark.parametrize(("dotted", "same"), [("mPa.s", "mPa*s"), ("mbar.l/s", "mbar*l/s"), ("kg.m^-1.s^-1", "Pa*s")])
def test_a_dot_between_units_is_a_product(dotted: str, same: str) -> None:
    kind = next(kind for kind, row in KINDS.items() if same in row.units)
    assert convert(read(f"2.5 {dotted}", kind), dotted, same) == pytest.approx(2.5)
    assert unit_of(read(f"2.5 {dotted}", kind)) == dotted.replace(".", "*")


def test_torr_has_its_symbol_of_vacuum_technology_too() -> None:
    assert convert(read("760 Torr", "pressure"), "Torr", "Pa") == pytest.approx(101325.0, rel=1e-12)
    assert convert(1.0, "Torr*l/s", "mbar*l/s") == pytest.approx(1013.25 / 760, rel=1e-12)


def test_a_state_that_a_list_gives_twice_is_one_state() -> None:
    text = "surface: {D: 2.3, m: 4, L: 100 um}\nmaterial: {E: 1 GPa, nu: 0.5}\nsweep: {to: {pressure: 0.7 MPa}}\n"
    text += "ensemble: {accuracy: {free_volume: 1 %}, at: {pressure: [700 kPa, 0.7 MPa]}}\n"
    study = loads(f"{text}record: {{fields_at: {{pressure: [0.5 MPa, 1 MPa, 500 kPa], step: [1, 2, 1]}}}}")
    states = ["step=1", "step=2", "pressure=0.5 MPa", "pressure=1 MPa", "pressure=700 kPa"]
    assert [level.label for _, level in (*study.record.levels(), *study.ensemble.states())] == states
