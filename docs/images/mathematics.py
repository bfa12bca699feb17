"""Draws the figures of docs/mathematics: python docs/images/mathematics.py."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

import bezier_filters as bf
from bezier_filters.holes import implicit_surface as spline
from bezier_filters.holes.influence_region import MAX_SURFACE_POINTS, NOISY_SURFACE_POINTS, farthest_point_sample
from bezier_filters.holes.restricted_likelihood import (
    QUADRATIC_TERMS,
    apply_on_both_sides,
    householder_reflectors,
    reml_criterion,
)
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.adjacency import mean_edge
from bezier_filters.smoothing.chebyshev import low_pass, low_pass_series
from bezier_filters.smoothing.clusters import clusters_of
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.low_pass import FILTER_ORDERS, FILTER_STRENGTHS, _estimates
from bezier_filters.smoothing.mesh_parts import whole_mesh
from bezier_filters.smoothing.noise import NoisyMesh
from bezier_filters.surface_model.fit_spec import FitConstraints, best_specs, fit_equations, mean_squared_errors
from bezier_filters.surface_model.learn import learn_surface
from bezier_filters.surfaces import bumpy_star, torus

matplotlib.use("agg")
from matplotlib import pyplot

FOLDER = Path(__file__).parent
VARIANCE_COLOR, BIAS_COLOR, TOTAL_COLOR, TRUTH_COLOR = "#1f77b4", "#ff7f0e", "black", "#d62728"


def noisy_copy(shape: Any, noise: float, seed: int = 0) -> tuple[np.ndarray, float]:
    """The vertices with white noise along the normals, as a fraction of the mean edge, and its standard deviation."""
    mesh = bf.triangle_mesh(shape.vertices, shape.faces)
    sigma = noise * mean_edge(mesh, bf.vertex_adjacency(mesh))
    heights = sigma * np.random.default_rng(seed).standard_normal(len(shape.vertices))
    return shape.vertices + heights[:, np.newaxis] * shape.normals, sigma


def shape_operators(geometry: Any) -> np.ndarray:
    """Shape operators in space, (n, 3, 3)."""
    low, high = geometry.direction_min, geometry.direction_max
    outer = np.einsum("n,ni,nj->nij", geometry.k_min, low, low) + np.einsum("n,ni,nj->nij", geometry.k_max, high, high)
    return np.asarray(outer)


def draw_rings() -> None:
    """Predicted variance and bias of the second derivatives over the rings, and the true errors."""
    shape = torus(resolution=48, jitter=0.3)
    figure, both = pyplot.subplots(1, 2, figsize=(11, 4.2), layout="constrained", sharey=True)
    for axes, noise in zip(both, (0.01, 0.1), strict=True):
        vertices, _ = noisy_copy(shape, noise)
        mesh, adjacency = prepare_kernel_mesh(bf.triangle_mesh(vertices, shape.faces), creases=True)
        _, leaf = learn_surface(mesh, adjacency, FitConstraints())
        specs = {spec.rings: spec for spec in best_specs(leaf.surface)}
        rings = np.array(sorted(specs))
        parts = []
        for model in leaf.surface.by_rings:
            spec = specs[model.analysis.rings]
            variances = model.quartic.variances(model.variances, spec.quartic)
            equations = fit_equations(model, spec)
            without_noise = replace(equations, noise=np.zeros_like(equations.noise))
            each = [
                mean_squared_errors(*pair)[1] for pair in ((equations, 0.0 * variances), (without_noise, variances))
            ]
            parts.append(np.sqrt(8.0 * np.array(each)) / model.analysis.radius**2)
        variance, bias = np.array(parts).T
        true = shape_operators(shape)
        errors = []
        for k in rings.tolist():
            found = shape_operators(bf.estimate_vertex_geometry(vertices, shape.faces, rings=k))
            errors.append(np.sqrt(np.square(found - true).sum(axis=(1, 2)).mean()))
        axes.semilogy(rings, variance, "o--", color=VARIANCE_COLOR, label="noise: root of the variance")
        axes.semilogy(rings, bias, "s--", color=BIAS_COLOR, label="bias by the terms beyond the fit")
        axes.semilogy(rings, np.hypot(variance, bias), "o-", color=TOTAL_COLOR, label="both: predicted error")
        axes.semilogy(rings, errors, "x:", color=TRUTH_COLOR, markersize=8, label="true error")
        for k, total in zip(rings.tolist(), np.hypot(variance, bias).tolist(), strict=True):
            axes.annotate(f"{specs[k].degree}", (k, total), (0, 7), textcoords="offset points", ha="center", fontsize=8)
        axes.axvline(leaf.chosen.rings, color="0.5", linewidth=1, label=f"chosen: ring {leaf.chosen.rings}")
        axes.set(title=f"noise of {100 * noise:g} % of the mean edge", xlabel="rings k", xticks=rings)
        axes.set_ylim(top=100.0)
        axes.grid(which="both", alpha=0.25)
        axes.legend(fontsize=8, loc="upper right")
    both[0].set_ylabel("RMS error of the second derivatives [1/length]")
    figure.savefig(FOLDER / "rings_variance_bias.png", dpi=100)
    pyplot.close(figure)


def draw_filters() -> None:
    """Responses of the low-pass filters; risk estimate and true error over their strengths."""
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    values = np.geomspace(1e-3, 2.0, 400)
    colors = pyplot.get_cmap("viridis")(np.linspace(0, 0.85, 4))
    for strength, color in zip((1.0, 100.0, 1e4, 1e6), colors, strict=True):
        for order, style in zip(sorted(FILTER_ORDERS), (":", "-", "--"), strict=True):
            response = 1.0 / (1.0 + (strength * values**4) ** (order / 4))
            label = f"s = 10^{np.log10(strength):g}" if order == 4 else None
            left.semilogx(values, response, style, color=color, linewidth=1.3, label=label)
        series = low_pass_series(np.array([strength]), 2.0)
        few = np.geomspace(1e-3, 2.0, 25)
        applied = 1.0 - few * np.polynomial.chebyshev.chebval(few - 1.0, series[:, 0])
        left.plot(few, applied, ".", color=color, markersize=5)
    for order, style in zip(sorted(FILTER_ORDERS), (":", "-", "--"), strict=True):
        left.plot([], [], style, color="0.4", label=f"order r = {order}")
    left.plot([], [], ".", color="0.4", label="Chebyshev series, r = 4")
    left.set(title="response f", xlabel="eigenvalue of the Laplacian L", ylabel="f")
    left.legend(fontsize=8)
    left.grid(alpha=0.25)

    shape = bumpy_star(resolution=30, jitter=0.3)
    strengths = FILTER_STRENGTHS[(FILTER_STRENGTHS > 0.0) & (FILTER_STRENGTHS <= 1e7)]
    for noise, color in zip((0.05, 0.2), (colors[0], colors[2]), strict=True):
        vertices, sigma = noisy_copy(shape, noise)
        mesh = bf.triangle_mesh(vertices, shape.faces)
        part = whole_mesh(mesh, bf.vertex_adjacency(mesh))
        laplacian = umbrella_laplacian(part, "curve")
        noisy = NoisyMesh(part, clusters_of(part), np.full(len(vertices), sigma))
        risks = _estimates(noisy, laplacian, 4, strengths, shape.normals).mean_risks()
        errors = []
        for strength in strengths:
            away = low_pass(laplacian, vertices, np.array([strength])) - shape.vertices
            errors.append(np.square((away * shape.normals).sum(axis=1) / sigma).mean())
        label = f"noise of {100 * noise:g} % of the mean edge"
        right.loglog(strengths, np.maximum(risks, 1e-3), "-", color=color, label=f"risk estimate, {label}")
        right.loglog(strengths, errors, "x", color=color, label="true mean squared error")
        right.plot(strengths[risks.argmin()], risks.min(), "o", color=color, markersize=9, fillstyle="none")
    right.set(title="Stein's estimate and the truth", xlabel="strength s", ylabel="mean squared error / sigma^2")
    right.legend(fontsize=8)
    right.grid(which="both", alpha=0.25)
    figure.savefig(FOLDER / "filter_bank.png", dpi=100)
    pyplot.close(figure)


def restricted_likelihoods(points: np.ndarray, normals: np.ndarray, offset: float, power: int) -> np.ndarray:
    """-2 log of the restricted likelihood of noisy points at each of the candidate noise ratios."""
    count = 3 * len(points)
    origin, centers, values = np.empty(3), np.empty((3, count)), np.empty(count)
    quadratics = np.empty((QUADRATIC_TERMS, count))
    spline._write_constraints(points, normals, np.empty((0, 3)), offset, origin, centers, values, quadratics)
    reflectors = householder_reflectors(quadratics)
    kernel, errors = np.empty((count, count)), spline._error_covariance(len(points), 0)
    factor = np.empty((count - QUADRATIC_TERMS, count - QUADRATIC_TERMS))
    apply_on_both_sides(errors, reflectors)
    target = reflectors.apply(values)[QUADRATIC_TERMS:]
    spline._write_kernel(centers, power, kernel)
    size = apply_on_both_sides(kernel, reflectors)
    ratios = spline.NOISE_RATIOS
    return np.array([reml_criterion(kernel, target, errors, ratio * size, factor)[0] for ratio in ratios])


def draw_spline(resolution: int = 24, hole: float = 0.4, reach: float = 0.9) -> None:
    """Values of the spline in a section through a hole, and the choice of power and noise ratio.

    The hole is around the z axis; it and the points around it reach to these angles, in radians.
    """
    shape, offset = bumpy_star(resolution=resolution, jitter=0.3), 1.1 / resolution
    polar = np.arctan2(np.hypot(*shape.vertices[:, :2].T), shape.vertices[:, 2])
    near = np.flatnonzero((polar > hole) & (polar < reach))
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(11, 4.4), layout="constrained", width_ratios=(1.3, 1.0))

    def sample(noise: float, most: int) -> tuple[np.ndarray, np.ndarray]:
        points = noisy_copy(shape, noise)[0][near]
        rows = farthest_point_sample(points, np.zeros(len(points), dtype=np.bool_), most)
        return points[rows], shape.normals[near][rows]

    points, normals = sample(0.0, MAX_SURFACE_POINTS)
    surface = spline.fit_implicit_surface(points, normals, offset, noisy=False)
    x, z = np.meshgrid(np.linspace(-0.95, 0.95, 190), np.linspace(0.45, 1.35, 90))
    values = surface.values_and_gradients(np.column_stack([x.ravel(), 0.0 * x.ravel(), z.ravel()]))[0].reshape(x.shape)
    filled = left.contourf(x, z, values, levels=np.linspace(-0.36, 0.36, 13), cmap="RdBu_r", extend="both")
    left.contour(x, z, values, levels=[0.0], colors="black", linewidths=2)
    angles = np.linspace(-reach, reach, 200)
    directions = np.column_stack([np.sin(angles), 0.0 * angles, np.cos(angles)])
    true = directions * (1.0 + 0.08 * np.sin(directions * [4.0, 5.0, 6.0]).sum(axis=1))[:, np.newaxis]
    left.plot(true[:, 0], true[:, 2], "--", color="#ffdd33", linewidth=1.2, label="true surface")
    section = np.abs(points[:, 1]) < 0.07
    left.plot(points[section, 0], points[section, 2], "o", color="black", markersize=4, label="points, f = 0")
    for side, marker in ((1.0, "^"), (-1.0, "v")):
        moved = points[section] + side * offset * normals[section]
        label = f"f = {'+' if side > 0 else '-'}e"
        left.plot(moved[:, 0], moved[:, 2], marker, color="0.35", markersize=4, label=label)
    start = np.column_stack([np.linspace(-0.3, 0.3, 7), np.zeros(7), np.full(7, 0.85)])
    for first, last in zip(start, surface.project(start)[0], strict=True):
        left.annotate("", last[[0, 2]], first[[0, 2]], arrowprops={"arrowstyle": "->", "color": "#2ca02c"})
    left.plot([], [], color="#2ca02c", label="Newton projection")
    left.set(title=f"section through a hole, p = {surface.power}", xlabel="x [length]", ylabel="z [length]")
    left.set_aspect("equal")
    left.legend(fontsize=8, loc="lower center", ncols=2)
    figure.colorbar(filled, ax=left, shrink=0.7, label="f [length]")

    noise = 0.15
    points, normals = sample(noise, NOISY_SURFACE_POINTS)
    surface = spline.fit_implicit_surface(points, normals, offset, noisy=True)
    likelihoods = {power: restricted_likelihoods(points, normals, offset, power) for power in spline.KERNEL_POWERS}
    least = min(values.min() for values in likelihoods.values())
    for (power, values), color in zip(likelihoods.items(), (VARIANCE_COLOR, BIAS_COLOR), strict=True):
        right.semilogx(spline.NOISE_RATIOS, values - least, "o-", color=color, label=f"p = {power}")
    chosen = f"chosen: p = {surface.power}, ratio {surface.noise_ratio:g}"
    right.axvline(surface.noise_ratio, color="0.5", linewidth=1, label=chosen)
    right.set_yscale("symlog", linthresh=10.0)
    right.set_ylim(bottom=-2.0)
    right.set(
        title=f"the same hole with noise of {100 * noise:g} % of an edge",
        xlabel="noise ratio",
        ylabel="-2 log restricted likelihood, less the minimum",
    )
    right.grid(alpha=0.25)
    right.legend(fontsize=8, loc="lower right")
    figure.savefig(FOLDER / "spline_in_hole.png", dpi=100)
    pyplot.close(figure)


if __name__ == "__main__":
    draw_rings()
    draw_filters()
    draw_spline()
