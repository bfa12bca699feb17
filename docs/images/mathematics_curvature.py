"""Figures of docs/mathematics/curvature.md."""

from dataclasses import replace
from typing import Any

import numpy as np
from mathematics_common import BLUE, GREY, ORANGE, correlated_noise, learn, prepare, save, white_noise
from matplotlib import pyplot

import bezier_filters as bf
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.noise.noise_model import ring_noise
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.surface_model.fit_spec import fit_equations, mean_squared_errors
from bezier_filters.surface_model.model import SIGNIFICANT_STANDARD_ERRORS
from bezier_filters.surface_model.variances import PRIOR_RANGE, UPPER_PRIOR_RANGE, posterior_mean_variance
from bezier_filters.surfaces import bumpy_star, torus


def shape_operators(geometry: Any) -> FloatArray:
    """Shape operators as symmetric matrices in space, (n, 3, 3)."""
    pairs = (geometry.k_min, geometry.direction_min), (geometry.k_max, geometry.direction_max)
    return np.asarray(sum(k[:, None, None] * d[:, :, None] * d[:, None, :] for k, d in pairs))


def draw_predicted_errors() -> None:
    """Variance, bias and error of the second derivatives over the rings, predicted and measured."""
    shape = torus(major_radius=1.0, minor_radius=0.4, resolution=60, jitter=0.3)
    edge = prepare(shape.vertices, shape.faces).mean_edge
    figure, both = pyplot.subplots(1, 2, figsize=(10, 4.2), layout="constrained", sharey=True)
    for axes, noise in zip(both, (0.01, 0.1), strict=True):
        vertices = shape.vertices + (noise * edge * white_noise(len(shape.vertices)))[:, None] * shape.normals
        leaf = learn(vertices, shape.faces)
        specs = {spec.rings: spec for spec in leaf.specs}
        rows, measured = [], []
        for ring in leaf.surface.by_rings:
            spec = specs[ring.analysis.rings]
            equations = fit_equations(ring, spec)
            variances = ring.quartic.variances(ring.variances, spec.quartic)
            without_noise = replace(equations, noise=0.0 * equations.noise)
            pairs = (equations, 0.0 * variances), (without_noise, variances), (equations, variances)
            squares = [mean_squared_errors(*pair)[1] for pair in pairs]
            rows.append(np.sqrt(8.0 * np.array(squares)) / ring.analysis.radius**2)
            found = bf.estimate_vertex_geometry(vertices, shape.faces, rings=spec.rings)
            errors = shape_operators(found) - shape_operators(shape)
            measured.append(np.sqrt(np.square(errors).sum(axis=(1, 2)).mean()))
        rings = [ring.analysis.rings for ring in leaf.surface.by_rings]
        for curve, style, label in zip(
            np.array(rows).T,
            ("--", ":", "-"),
            ("noise (variance)", "terms that vary (bias)", "predicted error"),
            strict=True,
        ):
            axes.semilogy(rings, curve, style, color=BLUE, label=label)
        axes.semilogy(rings, measured, "o", color=ORANGE, label="measured error")
        chosen = leaf.chosen.rings
        axes.axvline(chosen, color=GREY, linewidth=0.8, label="chosen ring")
        for spec in leaf.specs:
            axes.annotate(str(spec.degree), (spec.rings, 0.02), xycoords=("data", "axes fraction"), ha="center")
        axes.set(title=f"noise of {100 * noise:g} % of the mean edge", xlabel="rings (degree of the fit below)")
        axes.set_xticks(rings)
        axes.grid(alpha=0.25)
    both[0].set_ylabel("RMS error of second derivatives [1/length]")
    both[1].legend()
    save(figure, "predicted_errors")


def draw_variance_components() -> None:
    """Shrinkage, and the variance components of one ring of a noisy star, before and after it."""
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 4.2), layout="constrained", width_ratios=(2, 3))
    x = np.linspace(-3.0, 7.0, 201)
    left.plot(x, np.maximum(x, 0.0), "--", color=GREY, label="estimate, at least 0")
    for range_, color, label in ((PRIOR_RANGE, BLUE, "for fits"), (UPPER_PRIOR_RANGE, ORANGE, "for standard errors")):
        left.plot(x, posterior_mean_variance(x, np.ones_like(x), range_), color=color, label=f"posterior mean, {label}")
    left.set(xlabel="moment estimate / standard error", ylabel="variance / standard error", title="shrinkage")
    left.legend()
    left.grid(alpha=0.25)

    shape = bumpy_star(resolution=30, jitter=0.3)
    edge = prepare(shape.vertices, shape.faces).mean_edge
    vertices = shape.vertices + (0.05 * edge * white_noise(len(shape.vertices)))[:, None] * shape.normals
    leaf = learn(vertices, shape.faces)
    ring = next(ring for ring in leaf.surface.by_rings if ring.analysis.rings == leaf.chosen.rings)
    sums, basis = ring.analysis.sums, harmonic_basis()
    squares, weights, counts = (part.sum(axis=0) for part in (sums.term_squares, sums.term_weights, sums.term_counts))
    noise = ring.noise.coefficients
    with np.errstate(invalid="ignore", divide="ignore"):
        estimates = (squares - noise * counts) / weights
        errors = noise * np.sqrt(2.0 * counts / ring.analysis.independent_fraction) / weights
        lower = np.where(counts > 0.0, estimates - SIGNIFICANT_STANDARD_ERRORS * errors, -np.inf)
    best = lower.argmax(axis=0)
    groups = np.arange(basis.groups[basis.degrees == 3].min(), counts.shape[1])
    estimates, errors = estimates[best[groups], groups], errors[best[groups], groups]
    first = [int(np.flatnonzero(basis.groups == group)[0]) for group in groups]
    unit, places = leaf.surface.sigma**2, np.arange(len(groups))
    tops = np.maximum(estimates + errors, 0.0) / unit
    right.vlines(places, np.maximum(estimates - errors, 1e-9) / unit, tops, color=GREY)
    right.plot(
        places, np.where(estimates > 0.0, estimates / unit, np.nan), "o", color=GREY, label="estimate by moments"
    )
    right.plot(places, ring.variances[first] / unit, "s", color=BLUE, label="variance of the model")
    right.set(yscale="log", ylim=(1e-4, None))
    labels = [f"{basis.degrees[k]},{_frequency(k)}" for k in first]
    right.set_xticks(places, labels, rotation=60)
    right.set(
        xlabel="degree j, frequency l of the terms",
        ylabel="variance at the radius / noise variance",
        title=f"{ring.analysis.rings} rings of a star, noise of 5 % of the mean edge",
    )
    right.legend()
    right.grid(alpha=0.25)
    save(figure, "variance_components")


def _frequency(term: int) -> int:
    """Angular frequency of a term: groups of one degree j have the frequencies j, j - 2, ..."""
    basis = harmonic_basis()
    degree = basis.degrees[term]
    first = basis.groups[basis.degrees == degree].min()
    return int(degree - 2 * (basis.groups[term] - first))


def draw_noise_spectrum() -> None:
    """Mean squares of the scores by ring and degree, and the share of white and of correlated noise in them."""
    shape = torus(major_radius=1.0, minor_radius=0.4, resolution=80, jitter=0.2)
    mesh = prepare(shape.vertices, shape.faces)
    adjacency, edge = mesh.adjacency, mesh.mean_edge
    sigma = 0.1 * edge
    heights = sigma * correlated_noise(adjacency, len(shape.vertices))
    vertices = shape.vertices + heights[:, None] * shape.normals
    leaf = learn(vertices, shape.faces)
    noise, basis = leaf.surface.noise, harmonic_basis()
    figure, four = pyplot.subplots(1, 4, figsize=(11, 3.6), layout="constrained", sharey=True)
    for axes, analysis in zip(four, [one for one in leaf.analyses if 2 <= one.rings <= 5], strict=True):
        degrees = np.arange(3, analysis.degree + 1)
        m = analysis.sums.scores.shape[1]
        observed = np.square(analysis.sums.scores).mean(axis=0)
        expected = ring_noise(noise, analysis).score_variances

        def by_degree(values: FloatArray, m: int = m, degrees: IntArray = degrees) -> FloatArray:
            return np.array([values[basis.degrees[:m] == degree].mean() for degree in degrees]) / sigma**2

        white = np.full(len(degrees), noise.white / sigma**2)
        axes.bar(degrees, white, color="#c6dbef", label="white noise")
        axes.bar(degrees, by_degree(expected) - white, bottom=white, color=BLUE, label="correlated noise")
        axes.plot(degrees, by_degree(observed), "o", color=ORANGE, label="observed")
        axes.set(title=f"{analysis.rings} rings", xlabel="degree", yscale="log", ylim=(0.03, 8.0))
        axes.set_xticks(degrees)
        axes.grid(axis="y", alpha=0.25)
    four[0].set_ylabel("mean square of scores / noise variance")
    four[0].legend(loc="upper right", fontsize=8)
    save(figure, "noise_spectrum")
