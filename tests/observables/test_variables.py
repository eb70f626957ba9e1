"""The table of variables names the function of every row; where one call gives the value, that value is stored."""

from __future__ import annotations

import dataclasses
import pkgutil
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from roughvol.campaign.case_surface import surface_of
from roughvol.campaign.one_case import run_case
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import Contact, sweep
from roughvol.observables import reduction, variables
from roughvol.observables.variables import OBSERVABLES, VARIABLES, function
from roughvol.store.dataset import Dataset
from roughvol.study import loads
from roughvol.study.reference import keys
from roughvol.surfaces.surface import Surface

TEXT = """
surface: {D: 2.3, m: 5, seeds: [1], L: 3.0}
material: {hardness: 5}
sweep: {steps: 4, to: {indentation: 3}}
record:
  texture: {at: last}
  transport: {estimates: every-step, transmissivity: every-step, diffusivity: last}
"""
SPACING = 3.0 / 32


def _resolved(source: str) -> Any:
    """Return what a dotted name of the package names: a module, an attribute, or a field of a record."""
    owner, _, name = f"roughvol.{source}".rpartition(".")
    record = pkgutil.resolve_name(owner)
    if dataclasses.is_dataclass(record) and name in {field.name for field in dataclasses.fields(record)}:
        return name
    return pkgutil.resolve_name(f"roughvol.{source}")


@pytest.fixture(scope="module")
def stored() -> Dataset:
    return run_case(loads(TEXT).cases()[0]).squeeze(("D", "m", "seed"))


@pytest.fixture(scope="module")
def surface() -> Surface:
    return surface_of(loads(TEXT).cases()[0])


@pytest.fixture(scope="module")
def contacts(surface: Surface, stored: Dataset) -> list[Contact]:
    hardness = 5 * surface.side / surface.Sq
    return list(sweep(surface, HalfSpace(surface.shape), stored.indentation.values, hardness=hardness))


def test_every_row_names_what_exists() -> None:
    assert [name for name, row in VARIABLES.items() if not row.source] == []
    for source in {row.source for row in VARIABLES.values()}:
        assert _resolved(source) is not None


def test_a_name_that_does_not_exist_is_found() -> None:
    for source in ("surfaces.texture.Sxx", "surfaces.nothing.Sq", "nothing", "surfaces.surface.Surface.nothing"):
        with pytest.raises((AttributeError, ImportError)):
            _resolved(source)


def _called(source: str, heights: np.ndarray[Any, Any]) -> float:
    function = _resolved(source)
    takes_spacing = "spacing" in function.__code__.co_varnames[: function.__code__.co_argcount]
    return float(function(heights, SPACING) if takes_spacing else function(heights))


OF_HEIGHTS = [name for name, row in VARIABLES.items() if row.source.startswith("surfaces.texture.")]
CURVES = ("material_ratio", "structure_function")


@pytest.mark.parametrize("name", [name for name in OF_HEIGHTS if not name.startswith(CURVES) and "_region" not in name])
def test_texture_is_that_of_its_function(name: str, stored: Dataset, surface: Surface, contacts: list[Contact]) -> None:
    heights = surface.heights
    if name.endswith("_loaded"):
        heights = -contacts[-1].gap() * surface.Sq
    elif name.endswith("_residual"):
        heights = surface.heights - contacts[-1].plastic_displacement() * surface.Sq
        assert not np.array_equal(heights, surface.heights)
    assert stored[name].item() == _called(VARIABLES[name].source, heights)


@pytest.mark.parametrize(
    "name", [name for name, row in VARIABLES.items() if row.source.startswith("surfaces.surface.Surface.")]
)
def test_numbers_of_the_surface_are_its_attributes(name: str, stored: Dataset, surface: Surface) -> None:
    if name in stored:
        assert_array_equal(stored[name], getattr(surface, VARIABLES[name].source.rpartition(".")[2]))


@pytest.mark.parametrize("name", [*reduction.PER_STEP, "plastic_volume", "plastic_area_fraction"])
def test_numbers_of_a_step_are_attributes_of_its_contact(name: str, stored: Dataset, contacts: list[Contact]) -> None:
    assert VARIABLES[name].source == f"contact.state.Contact.{name}"
    assert_array_equal(stored[name], [getattr(contact, name) for contact in contacts])


ARGUMENTS = {  # after the gap, and the axis where the number has one
    "transmissivity": (3.0,),
    "diffusivity": (1.0,),
    "estimate_medium_transmissivity": (3.0,),
    "estimate_medium_diffusivity": (1.0,),
    "estimate_junction_transmissivity": (3.0,),
    "estimate_junction_diffusivity": (1.0,),
}


@pytest.mark.parametrize("name", ARGUMENTS)
def test_transport_is_that_of_its_function(name: str, stored: Dataset, contacts: list[Contact]) -> None:
    function, last = _resolved(VARIABLES[name].source), stored[name][-1]
    for axis, number in enumerate(last.values) if last.dims else [((), last.item())]:
        value = function(contacts[-1].gap(), *np.atleast_1d(axis).astype(int).tolist(), *ARGUMENTS[name])
        assert number == pytest.approx(getattr(value, "coefficient", value), rel=1e-12)


def test_every_observable_names_what_exists() -> None:
    for row in OBSERVABLES.values():
        for name in filter(None, (row.of_state, row.labels, row.before)):
            assert callable(function(name))
        for key in filter(None, (row.key, row.passes, row.fields_if)):
            assert f"record.{key}" in {known.path for known in keys()}


def test_variables_and_observables_agree() -> None:
    asked = {name: row for name, row in OBSERVABLES.items() if row.seconds and name != "own"}  # its rows are a user's
    assert {row.observable for row in VARIABLES.values()} - {""} == set(asked)
    assert set(variables.STATES) == {row.dim for row in asked.values()} - {""}
    assert set(variables.ALONG) == {name for name, row in asked.items() if not row.dim}
