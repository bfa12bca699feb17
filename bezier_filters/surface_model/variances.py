"""Shrinkage of variance components: the posterior mean of a variance whose moment estimate may be negative.

The estimate is a difference, the observed mean square less the expected contribution of the noise.
"""

import numpy as np
from scipy.special import log_ndtr

from bezier_filters.arrays import FloatArray

PRIOR_RANGE = 8.0  # standard errors over which the flat prior has the same mass as the point mass at 0
UPPER_PRIOR_RANGE = 4.0  # the same for upper variances: standard errors should rather be too large than too small
# relative standard error of the contribution of correlated noise to the squares of coefficients
CORRELATED_NOISE_ERROR = 0.4
CERTAIN_STANDARD_ERRORS = 30.0  # standard errors beyond which an estimate is not shrunk


def posterior_mean_variance(
    surplus: FloatArray, standard_errors: FloatArray, prior_range: float = PRIOR_RANGE
) -> FloatArray:
    """Posterior mean of a variance v >= 0 given a normally distributed estimate of it.

    The prior is a spike and slab: a point mass at 0 and a flat density that has the same mass over `prior_range`
    standard errors. With x = estimate / standard error, density phi and distribution Phi of the normal distribution,
    the mean is standard error * (x + phi / Phi) / (1 + prior_range * phi / Phi). Without the point mass, `prior_range`
    is 0. `surplus` (k,) are the estimates of v, `standard_errors` (k,) their standard errors.

    >>> posterior_mean_variance(np.array([-1.0, 0.0, 1.0, 5.0]), np.ones(4)).round(2)
    array([0.04, 0.11, 0.39, 5.  ])
    """
    certain = surplus >= CERTAIN_STANDARD_ERRORS * standard_errors
    x = np.divide(surplus, standard_errors, out=np.zeros_like(surplus), where=~certain & (standard_errors > 0.0))
    x = np.maximum(x, -CERTAIN_STANDARD_ERRORS)
    log_density, log_share = -0.5 * x * x - 0.5 * np.log(2.0 * np.pi), log_ndtr(x)
    ratio = np.exp(log_density - log_share)
    with np.errstate(invalid="ignore"):  # infinite standard errors: the variance is unknown
        posterior: FloatArray = standard_errors * (x + ratio) / (1.0 + prior_range * ratio)
    return np.where(certain, np.maximum(surplus, 0.0), posterior)
