"""The table of variables names the function of every row; where one call gives the value, that value is stored."""

import dataclasses
import pkgutil

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from roughvol.campaign.case_surface import surface_of
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import sweep
from roughvol.observables import reduction, variables
from roughvol.observables.variables import OBSERVABLES, VARIABLES, function
from roughvol.study import loads
from roughvol.study.reference import keys
from tests.observables.kit import answer

TEXT = """
surface: {D: 2.3, m: 5, seeds: [1], L: 3.0}
material: {hardness: 5}
sweep: {steps: 4, to: {indentation: 3}}
record:
  texture: {at: last}
  transport: {estimates: every-step, transmissivity: every-step, diffusivity: last}
"""
SPACING = 3.0 / 32


def _resolved(source):
    """Return what a dotted name of the package names: a module, an attribute, or a field of a record."""
    owner, _, name = f"roughvol.{source}".rpartition(".")
    record = pkgutil.resolve_name(owner)
    if dataclasses.is_dataclass(record) and name in {field.name for field in dataclasses.fields(record)}:
        return name
    return pkgutil.resolve_name(f"roughvol.{source}")


@pytest.fixture(scope="module")
def stored():
    return answer(TEXT)


@pytest.fixture(scope="module")
def surface():
    return surface_of(loads(TEXT).cases()[0])


@pytest.fixture(scope="module")
def contacts(surface, stored):
    hardness = 5 * surface.side / surface.Sq
    return list(sweep(surface, HalfSpace(surface.shape), stored.indentation.values, hardness=hardness))


def test_every_row_names_what_exists():
    assert [name for name, row in VARIABLES.items() if not row.source] == []
    for source in {row.source for row in VARIABLES.values()}:
        assert _resolved(source) is not None


def test_a_name_that_does_not_exist_is_found():
    for source in ("surfaces.texture.Sxx", "surfaces.nothing.Sq", "nothing", "surfaces.surface.Surface.nothing"):
        with pytest.raises((AttributeError, ImportError)):
            _resolved(source)


def _called(source, heights):
    function = _resolved(source)
    takes_spacing = "spacing" in function.__code__.co_varnames[: function.__code__.co_argcount]
    return float(function(heights, SPACING) if takes_spacing else function(heights))


OF_HEIGHTS = [name for name, row in VARIABLES.items() if row.source.startswith("surfaces.texture.")]
CURVES = ("material_ratio", "structure_function")


def test_texture_is_that_of_its_function(stored, surface, contacts):
    under = {
        "loaded": -contacts[-1].gap() * surface.Sq,
        "residual": surface.heights - contacts[-1].plastic_displacement() * surface.Sq,
    }
    assert not np.array_equal(under["residual"], surface.heights)
    for name in (name for name in OF_HEIGHTS if not name.startswith(CURVES) and "_region" not in name):
        heights = under.get(name.rpartition("_")[2], surface.heights)
        assert stored[name].item() == _called(VARIABLES[name].source, heights), name


def test_numbers_of_surface_and_steps_are_their_attributes(stored, surface, contacts):
    for name, row in VARIABLES.items():
        if row.source.startswith("surfaces.surface.Surface.") and name in stored:
            assert_array_equal(stored[name], getattr(surface, row.source.rpartition(".")[2]), name)
    for name in (*reduction.OF_STATE, *reduction.OF_YIELD, *reduction.OF_SOLVER):
        assert VARIABLES[name].source == f"contact.state.Contact.{name}"
        assert_array_equal(stored[name], [getattr(contact, name) for contact in contacts], name)


POWERS = {"transmissivity": 3.0, "diffusivity": 1.0}  # of the gap, the last argument


@pytest.mark.parametrize("of", ["", "estimate_medium_", "estimate_junction_"])
def test_transport_is_that_of_its_function(stored, contacts, of):
    for kind, power in POWERS.items():
        function, last = _resolved(VARIABLES[of + kind].source), stored[of + kind][-1]
        for axis, number in enumerate(last.values) if last.dims else [((), last.item())]:
            value = function(contacts[-1].gap(), *np.atleast_1d(axis).astype(int).tolist(), power)
            assert number == pytest.approx(getattr(value, "coefficient", value), rel=1e-12), kind


def test_every_observable_names_what_exists():
    for row in OBSERVABLES.values():
        for name in filter(None, (row.of_state, row.labels, row.before)):
            assert callable(function(name))
        for key in filter(None, (row.key, row.passes, row.fields_if)):
            assert f"record.{key}" in {known.path for known in keys()}


def test_variables_and_observables_agree():
    asked = {name: row for name, row in OBSERVABLES.items() if row.seconds and name != "own"}  # its rows are a user's
    assert {row.observable for row in VARIABLES.values()} - {""} == set(asked)
    assert set(variables.STATES) == {row.dim for row in asked.values()} - {""}
    assert set(variables.ALONG) == {name for name, row in asked.items() if not row.dim}
