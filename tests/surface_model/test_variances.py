"""What is believed of a variance, against the posterior distribution that it is the mean of."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from bezier_filters.surface_model.variances import CERTAIN_STANDARD_ERRORS, PRIOR_RANGE, posterior_mean_variance


def posterior_mean(x):
    """By integration, in standard errors: half a point mass at 0, half a density of 1 / range on v >= 0."""
    # Relative to the highest density, so that nothing underflows.
    top = max(x, 0.0)
    cut = {"points": (top, top + 1.0), "limit": 200}
    density = lambda v: np.exp(norm.logpdf(x - v) - norm.logpdf(x - top)) / PRIOR_RANGE  # noqa: E731
    upwards = quad(lambda v: v * density(v), 0.0, top + 12.0, **cut)[0]
    nothing = np.exp(norm.logpdf(x) - norm.logpdf(x - top))
    return upwards / (nothing + quad(density, 0.0, top + 12.0, **cut)[0])


@pytest.mark.parametrize("x", [-12.0, -3.0, -1.0, 0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 8.0, 20.0])
def test_the_expected_variance_is_the_mean_of_the_posterior_distribution(x):
    assert posterior_mean_variance(np.array([0.3 * x]), np.array([0.3]))[0] == pytest.approx(
        0.3 * posterior_mean(x), rel=1e-6
    )


@given(st.floats(-50, 50), st.floats(0, 50), st.floats(1e-3, 1e3))
def test_a_larger_estimate_is_believed_to_be_larger(x, more, unit):
    low, high = posterior_mean_variance(unit * np.array([x, x + more]), np.array([unit, unit]))
    assert 0.0 <= low <= high * (1.0 + 1e-9)
    assert high <= unit * max(x + more, 1.0)


def test_what_is_certain_is_believed_and_nothing_comes_of_nothing():
    values = np.array([2.0 * CERTAIN_STANDARD_ERRORS, 1e9, 5.0, 0.0, -3.0])
    np.testing.assert_array_equal(
        posterior_mean_variance(values, np.array([1.0, 1.0, 0.0, 0.0, 0.0])), [*values[:3], 0, 0]
    )
    assert posterior_mean_variance(np.array([CERTAIN_STANDARD_ERRORS - 1e-9]), np.ones(1))[0] == pytest.approx(
        CERTAIN_STANDARD_ERRORS
    )
    assert posterior_mean_variance(np.array([-1e9]), np.ones(1))[0] < 1e-3
