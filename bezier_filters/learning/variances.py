"""What to believe of a variance whose estimate is a difference: what is there, less what noise adds to it."""

import numpy as np
from scipy.special import log_ndtr

from bezier_filters.arrays import FloatArray

PRIOR_RANGE = 8.0  # standard errors over which a variance is as likely, beforehand, as it is to be nothing at all
UPPER_PRIOR_RANGE = 4.0  # the same for standard errors, which had better be too large than too small
CORRELATED_NOISE_ERROR = 0.4  # relative standard error of what correlated noise adds to the squares of coefficients
CERTAIN_STANDARD_ERRORS = 30.0  # standard errors beyond which an estimate is taken as it is


def posterior_mean_variance(surplus: FloatArray, by_chance: FloatArray, prior_range: float = PRIOR_RANGE) -> FloatArray:
    """Mean of a variance v >= 0 whose estimate is normal about it, given the estimate.

    Beforehand v is nothing at all or anything, the range of `prior_range` standard errors being as
    likely as nothing: what rises clearly above chance is believed, and what does not, hardly. It is 0 if v cannot be
    nothing. `surplus` (k,) are the estimates of v, `by_chance` (k,) their standard errors.

    >>> posterior_mean_variance(np.array([-1.0, 0.0, 1.0, 5.0]), np.ones(4)).round(2)
    array([0.04, 0.11, 0.39, 5.  ])
    """
    certain = surplus >= CERTAIN_STANDARD_ERRORS * by_chance
    x = np.divide(surplus, by_chance, out=np.zeros_like(surplus), where=~certain & (by_chance > 0.0))
    x = np.maximum(x, -CERTAIN_STANDARD_ERRORS)
    log_density, log_share = -0.5 * x * x - 0.5 * np.log(2.0 * np.pi), log_ndtr(x)
    ratio = np.exp(log_density - log_share)
    with np.errstate(invalid="ignore"):  # unknown ones, whose standard error is infinite
        believed: FloatArray = by_chance * (x + ratio) / (1.0 + prior_range * ratio)
    return np.where(certain, np.maximum(surplus, 0.0), believed)
