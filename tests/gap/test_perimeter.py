"""The perimeter of contact against a count by hand, and the area it corrects against circles of known area."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from roughvol.campaign import one_case
from roughvol.contact.halfspace import HalfSpace
from roughvol.contact.loading import solve
from roughvol.gap.perimeter import contact_perimeter, corrected_area
from roughvol.study import loads
from roughvol.surfaces.surface import Surface

STUDY = """
surface: {H: 0.8, n: 32, rolloff: 2, cut: 8, sides: free, seeds: 1}
sweep: {contact_areas: [0.1, 0.4]}
record: {contact_perimeter: true, fields_at: {contact_area: 0.4}REGION}
"""


def _counted(contact, periodic):
    """Count the pairs one by one."""
    rows, columns = contact.shape
    pairs = 0
    for i in range(rows):
        for j in range(columns):
            for k, m in ((i + 1, j), (i, j + 1)):
                if periodic or (k < rows and m < columns):
                    pairs += contact[i, j] != contact[k % rows, m % columns]
    return pairs


@pytest.mark.parametrize("periodic", [False, True])
def test_edges_are_those_counted_by_hand(periodic):
    contact = np.random.default_rng(1).random((9, 6)) > 0.6
    # S_d = pairs δ, L = 9 δ, A_n = 54 δ²
    assert contact_perimeter(contact, periodic) == pytest.approx(_counted(contact, periodic) * 9 / 54)
    assert contact_perimeter(contact | True, periodic) == contact_perimeter(contact & False, periodic) == 0.0


def test_the_corrected_area_of_a_sphere_is_nearer_to_hertz():
    """Mean over contact radii of 8 to 15 elements, with the tip of the sphere anywhere in an element."""
    n, random = 49, np.random.default_rng(5)
    space, errors = HalfSpace((n, n)), []
    for radius in np.linspace(8.0, 15.0, 9) / n:
        x, y = ((np.arange(n) - n // 2 - shift) / n for shift in random.random(2) - 0.5)
        sphere = Surface(-(x[:, None] ** 2 + y**2) / 2.0, 1.0 / n)  # R = 1
        indentation = radius**2 + sphere.z_max  # from the highest node and not from the tip
        contact = solve(sphere, space, indentation / sphere.Sq, rtol=1e-8).contact()
        corrected = corrected_area(contact.mean(), contact_perimeter(contact), n)
        errors.append([contact.mean() / (np.pi * radius**2) - 1.0, corrected / (np.pi * radius**2) - 1.0])
    raw, corrected = np.mean(errors, axis=0)
    assert raw > 0.01
    assert abs(corrected) < 0.5 * raw
    assert_allclose(
        corrected_area([0.0, 0.1], [10.0, 1.0], 10), [0.0, 0.1 - (np.pi - 1 + np.log(2)) / 240]
    )  # never < 0


@pytest.mark.parametrize("region", ["", ", region: {x: [0, 0.5], y: [0.25, 1]}"])
def test_the_length_of_a_stored_perimeter_is_that_of_the_elements_along_x(region):
    values = one_case.run_case(loads(STUDY.replace("REGION", region)).cases()[0])
    assert values["contact_perimeter"].shape[-1] == 2
    contact = values["pressure"].values[0, 0, 0, 0] > 0.0
    inside = contact[:17, 8:] if region else contact
    found = float(values["contact_perimeter"].isel(step=-1).item())
    assert found == _counted(inside, False) * inside.shape[0] / inside.size
    assert "n δ of the elements along x" in values["contact_perimeter"].attrs["long_name"]
