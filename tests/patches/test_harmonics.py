"""The terms r^j cos(l phi) and r^j sin(l phi), in polar coordinates."""

import numpy as np
from random_neighbourhoods import terms_at

from bezier_filters.patches.harmonics import HIGHEST_DEGREE, harmonic_basis

BASIS = harmonic_basis()
PAIRS = [(j, frequency) for j in range(HIGHEST_DEGREE + 1) for frequency in range(j, -1, -2)]
RNG = np.random.default_rng(0)
R, PHI = RNG.uniform(0.1, 1.0, 50), RNG.uniform(-np.pi, np.pi, 50)


def test_terms_are_powers_of_the_radius_times_cosines_and_sines():
    expected = []
    for j, frequency in PAIRS:
        expected.append(R**j * np.cos(frequency * PHI))
        if frequency:
            expected.append(R**j * np.sin(frequency * PHI))
    found = terms_at(np.column_stack([R * np.cos(PHI), R * np.sin(PHI)]))
    np.testing.assert_allclose(found, np.column_stack(expected), atol=1e-12)


def test_both_terms_of_a_frequency_are_a_group():
    terms = [(j, number) for number, (j, frequency) in enumerate(PAIRS) for _ in range(2 if frequency else 1)]
    assert list(zip(BASIS.degrees.tolist(), BASIS.groups.tolist(), strict=True)) == terms
    for degree in range(HIGHEST_DEGREE + 1):
        assert BASIS.term_count(degree) == sum(j <= degree for j, _ in terms)
