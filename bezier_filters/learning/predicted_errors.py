"""Errors of a fit, predicted over a few neighbourhoods from what is known of the surface.

A fit is linear in the heights. Its mean squared error is the noise that passes through plus, for each
random term of the surface, what is lost of it or mistaken for slope and curvature.
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.learning.surface_model import RingModel

WEIGHTED_RINGS = 4
"""Distance weights are looked at up to here: where narrow rings are best because the surface varies fast."""
RIDGE = 1e-14
"""Of the largest entry of the normal equations: makes singular ones solvable, whose errors are then huge."""
WANTED = np.arange(1, 6)
"""Places of the two slopes, x^2 - y^2, 2 x y and x^2 + y^2 among the terms."""


@dataclass(frozen=True)
class FitEquations:
    """Normal equations of a fit of m terms over the first neighbourhoods of a ring, T of them.

    Attributes
    ----------
    normal_matrices : (T, m, m) float64
        Design^T W design plus prior, W being the weights.
    products : (T, m, M) float64
        The same without prior and for all terms on the right.
    noise : (T, m, m) float64
        Covariance of the right-hand sides that noise and what no term follows cause, length^2.
    """

    normal_matrices: FloatArray
    products: FloatArray
    noise: FloatArray


def fit_equations(
    ring: RingModel, sigma: float, degree: int, term_prior: FloatArray, weight_radius: float
) -> FitEquations:
    """Set up the equations of a fit.

    Parameters
    ----------
    ring : RingModel
    sigma : float
        Of the noise, a length.
    degree, term_prior, weight_radius
        As in `FitPlan`; the radius in units of that of the ring.
    """
    analysis, m = ring.analysis, len(term_prior)
    if np.isinf(weight_radius) and degree <= analysis.degree:
        products = analysis.first_grams[:, :m]
        rest = analysis.rest_grams if analysis.rings <= WEIGHTED_RINGS else products
        noise = sigma**2 * products[..., :m] + ring.unmodelled * rest[:, :m, :m]
    else:
        design = analysis.first_designs
        ratio = np.square(analysis.first_points).sum(axis=2) / weight_radius**2
        weighted = design[..., :m] / (1.0 + ratio ** (degree + 1))[..., np.newaxis]
        products = weighted.transpose(0, 2, 1) @ design
        variance = sigma**2 + ring.unmodelled * analysis.rest_profile
        noise = weighted.transpose(0, 2, 1) @ (weighted * variance[..., np.newaxis])
    normal_matrices = products[..., :m].copy()
    diagonal = normal_matrices[:, np.arange(m), np.arange(m)]
    normal_matrices[:, np.arange(m), np.arange(m)] += term_prior + RIDGE * diagonal.max(axis=1, keepdims=True)
    return FitEquations(normal_matrices, products, noise)


def squared_errors(equations: FitEquations, variances: FloatArray) -> tuple[float, float]:
    """Mean squared errors of the slopes and of the second-degree coefficients, in units of the radius, length^2.

    `variances` are those of the terms, (M,), length^2.
    """
    wanted = np.eye(equations.normal_matrices.shape[1])[:, WANTED]  # the matrices are symmetric
    inverse_rows = np.linalg.solve(equations.normal_matrices, wanted).transpose(0, 2, 1)
    transfer = inverse_rows @ equations.products
    transfer[:, np.arange(len(WANTED)), WANTED] -= 1.0
    passed = ((inverse_rows @ equations.noise) * inverse_rows).sum(axis=2)
    mean = (passed + np.square(transfer) @ variances).mean(axis=0)
    return float(mean[:2].sum()), float(mean[2:].sum())


def claimed_variances(equations: FitEquations) -> tuple[float, float]:
    """What the covariance matrices say of the same errors for heights of unit noise."""
    covariance = np.linalg.inv(equations.normal_matrices)[:, WANTED, WANTED].mean(axis=0)
    return float(covariance[:2].sum()), float(covariance[2:].sum())
