"""Element volumes, the density and its integral, the domains and their order."""

import itertools

import numpy as np
import pytest

from roughvol.gap.free_volume import domain, element_volumes, free_volume, volume_density

RANDOM = np.random.Generator(np.random.PCG64(3))
CONTACT = RANDOM.random((17, 12)) < 0.2
GAP = np.where(CONTACT, 0.0, RANDOM.random(CONTACT.shape) ** 2)
VOLUMES = element_volumes(GAP, 0.5, CONTACT)


def test_volumes_are_gap_times_element_and_exactly_zero_on_contact():
    rounded = np.where(CONTACT, -1e-17, GAP)  # what a solver leaves on the contact does not matter
    volumes = element_volumes(rounded, 0.5, CONTACT)
    np.testing.assert_array_equal(volumes[CONTACT], 0.0)
    np.testing.assert_array_equal(volumes[~CONTACT], GAP[~CONTACT] * 0.25)
    assert volumes.sum() == pytest.approx(free_volume(GAP, 2.0) * 2.0 * GAP.size * 0.25, rel=1e-14)


def test_free_volume_scales():
    number = free_volume(GAP, 0.3)
    assert free_volume(1e-250 * GAP, 0.3e-250) == pytest.approx(number, rel=1e-14)
    assert free_volume(1e250 * GAP, 0.3e250) == pytest.approx(number, rel=1e-14)
    assert free_volume(np.zeros((3, 3)), 1.0) == 0.0


@pytest.mark.parametrize(
    ("bins", "include_contact", "upper"), [(1, True, None), (7, False, 0.8), (50, True, 0.8), (50, False, None)]
)
def test_density_integrates_to_one_and_counts(bins, include_contact, upper):
    density = volume_density(VOLUMES, CONTACT, bins, include_contact, upper)
    assert density.density @ np.diff(density.edges) == pytest.approx(1.0, rel=1e-13)
    assert (density.edges[0], density.edges[-1]) == (0.0, upper or VOLUMES.max())
    v = VOLUMES.ravel() if include_contact else VOLUMES[~CONTACT]
    for (lower, higher), value in zip(itertools.pairwise(density.edges), density.density, strict=True):
        last_is_closed = higher == density.edges[-1]
        number = np.count_nonzero((v >= lower) & ((v < higher) | last_is_closed))
        assert value * (higher - lower) * v.size == pytest.approx(number, abs=1e-9)


def test_density_at_full_contact_is_undefined():
    for include_contact in (False, True):
        density = volume_density(np.zeros((3, 3)), np.ones((3, 3), dtype=bool), 5, include_contact)
        assert (density.edges.shape, density.density.shape) == ((6,), (5,))
        assert np.isnan(density.density).all()


def test_domain_of_zero_is_the_contact_even_where_an_open_gap_is_zero():
    volumes = VOLUMES.copy()
    first_open = tuple(np.argwhere(~CONTACT)[0])
    volumes[first_open] = 0.0
    np.testing.assert_array_equal(domain(volumes, 0.0, CONTACT), CONTACT)
    assert domain(volumes, 1e-300, CONTACT)[first_open]


def test_domains_grow_from_the_contact_to_everything():
    thresholds = np.linspace(0.0, 1.0, 9) * VOLUMES.max()
    domains = [domain(VOLUMES, threshold, CONTACT) for threshold in thresholds]
    for small, large in itertools.pairwise(domains):
        assert not np.any(small & ~large)
    assert np.count_nonzero(domains[4]) == sum(v <= thresholds[4] for v in VOLUMES.flat)
    assert domains[-1].all()
