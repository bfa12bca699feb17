"""Draws the figures of docs/mathematics: python docs/images/mathematics.py [NAME ...], all of them by default."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from scipy.spatial import Delaunay
from scipy.special import j0

import bezier_filters as bf
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.crease_fill import hermite_curve, project_to_intersection
from bezier_filters.holes.hole_detection import find_holes
from bezier_filters.holes.implicit_surface import INTERPOLATION_RATIO, NOISE_RATIOS, ImplicitSurface
from bezier_filters.holes.influence_region import InfluenceRegion, influence_regions, select_surface_points
from bezier_filters.holes.smooth_fill import fit_surrounding_surface, initial_fill
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.adjacency import Adjacency, mean_edge
from bezier_filters.meshes.mesh import TriangleMesh, triangle_mesh
from bezier_filters.patches.harmonics import harmonic_basis
from bezier_filters.smoothing.chebyshev import low_pass
from bezier_filters.smoothing.clusters import clusters_of
from bezier_filters.smoothing.denoise import ESTIMATE_KINDS, candidates
from bezier_filters.smoothing.laplacian import umbrella_laplacian
from bezier_filters.smoothing.low_pass import FILTER_STRENGTHS, learn_low_pass
from bezier_filters.smoothing.mesh_parts import whole_mesh
from bezier_filters.smoothing.noise import NoisyMesh
from bezier_filters.smoothing.random_noise import WHITE, Correlation
from bezier_filters.surface_model.fit_spec import FitConstraints, fit_equations, mean_squared_errors
from bezier_filters.surface_model.learn import learn_surface
from bezier_filters.surface_model.model import SIGNIFICANT_STANDARD_ERRORS
from bezier_filters.surface_model.model_tree import Leaf
from bezier_filters.surface_model.noise_model import NoiseModel, ring_noise
from bezier_filters.surface_model.ring_analysis import RingAnalysis
from bezier_filters.surface_model.variances import PRIOR_RANGE, UPPER_PRIOR_RANGE, posterior_mean_variance
from bezier_filters.surfaces import bumpy_star, ellipsoid, torus

matplotlib.use("agg")
from matplotlib import pyplot

FOLDER = Path(__file__).parent
BLUE, ORANGE, GREEN, RED, GREY = "#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "0.55"


def save(figure: Any, name: str) -> None:
    """Write a figure in this folder."""
    figure.savefig(FOLDER / f"mathematics_{name}.png", dpi=100)
    pyplot.close(figure)


def prepare(vertices: FloatArray, faces: IntArray) -> tuple[TriangleMesh, Adjacency, float]:
    """A mesh, its adjacency and its mean edge."""
    mesh = triangle_mesh(vertices, faces)
    adjacency = bf.vertex_adjacency(mesh)
    return mesh, adjacency, mean_edge(mesh, adjacency)


def white_noise(count: int, seed: int = 0) -> FloatArray:
    """Noise of variance 1 that is independent from vertex to vertex."""
    return np.random.default_rng(seed).standard_normal(count)


def correlated_noise(adjacency: Adjacency, count: int, averages: int = 2) -> FloatArray:
    """Noise of variance 1: white noise averaged with the neighbours, and a tenth of white noise."""
    rows, values = adjacency.vertices, white_noise(count)
    start = np.repeat(np.arange(count), rows.lengths)
    for _ in range(averages):
        values = (values + np.bincount(start, values[rows.indices], count)) / (1.0 + rows.lengths)
    return np.sqrt(0.9) * values / values.std() + np.sqrt(0.1) * white_noise(count, 1)


def learn(vertices: FloatArray, faces: IntArray) -> tuple[list[RingAnalysis], Leaf]:
    """The analyses of all rings, and the surface model with its fit specifications."""
    arrays, adjacency = prepare_kernel_mesh(triangle_mesh(vertices, faces), creases=True)
    analyses, leaf = learn_surface(arrays, adjacency, FitConstraints())
    if leaf is None:
        raise ValueError("the mesh determines no surface model")
    return analyses, leaf


# --- curvature ------------------------------------------------------------------------------------


def shape_operators(geometry: Any) -> FloatArray:
    """Shape operators as symmetric matrices in space, (n, 3, 3)."""
    pairs = (geometry.k_min, geometry.direction_min), (geometry.k_max, geometry.direction_max)
    return np.asarray(sum(k[:, None, None] * d[:, :, None] * d[:, None, :] for k, d in pairs))


def draw_predicted_errors() -> None:
    """Variance, bias and error of the second derivatives over the rings, predicted and measured."""
    shape = torus(major_radius=1.0, minor_radius=0.4, resolution=60, jitter=0.3)
    edge = prepare(shape.vertices, shape.faces)[2]
    figure, both = pyplot.subplots(1, 2, figsize=(10, 4.2), layout="constrained", sharey=True)
    for axes, noise in zip(both, (0.01, 0.1), strict=True):
        vertices = shape.vertices + (noise * edge * white_noise(len(shape.vertices)))[:, None] * shape.normals
        _, leaf = learn(vertices, shape.faces)
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
    edge = prepare(shape.vertices, shape.faces)[2]
    vertices = shape.vertices + (0.05 * edge * white_noise(len(shape.vertices)))[:, None] * shape.normals
    _, leaf = learn(vertices, shape.faces)
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
    _, adjacency, edge = prepare(shape.vertices, shape.faces)
    sigma = 0.1 * edge
    heights = sigma * correlated_noise(adjacency, len(shape.vertices))
    vertices = shape.vertices + heights[:, None] * shape.normals
    analyses, leaf = learn(vertices, shape.faces)
    noise, basis = leaf.surface.noise, harmonic_basis()
    figure, four = pyplot.subplots(1, 4, figsize=(11, 3.6), layout="constrained", sharey=True)
    for axes, analysis in zip(four, [one for one in analyses if 2 <= one.rings <= 5], strict=True):
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


# --- smoothing ------------------------------------------------------------------------------------


def draw_transfer_functions() -> None:
    """Filters over the eigenvalue, for three orders, and over the wavelength, for some strengths."""
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 3.9), layout="constrained", sharey=True)
    x = np.linspace(0.0, 1.5, 600)
    for order, color in ((2, GREEN), (4, BLUE), (6, ORANGE)):
        left.plot(x, 1.0 / (1.0 + (1e2 * x**4) ** (order / 4)), color=color, label=f"order {order}")
    left.axvline(1e2**-0.25, color=GREY, linewidth=0.8, linestyle="--")
    left.set(xlabel="eigenvalue L", ylabel="f", title="one strength, s = 100")
    left.legend()
    left.grid(alpha=0.25)
    lengths = np.geomspace(2.5, 200.0, 600)
    values = 1.0 - j0(2.0 * np.pi / lengths)
    colors = pyplot.get_cmap("viridis")(np.linspace(0, 0.9, 8))
    for power, color in zip(range(8), colors, strict=True):
        right.semilogx(lengths, 1.0 / (1.0 + 10.0**power * values**4), color=color, label=f"$10^{power}$")
    right.set(xlabel="wavelength [edges]", title="order 4, strength")
    right.set_xticks([3, 5, 10, 20, 50, 100, 200], ["3", "5", "10", "20", "50", "100", "200"])
    right.legend(fontsize=8)
    right.grid(alpha=0.25)
    save(figure, "transfer_functions")


def draw_risk() -> None:
    """Stein's risk of the low-pass filters, next to their true error, under white and correlated noise."""
    shape = bumpy_star(resolution=40, jitter=0.2)
    mesh, adjacency, edge = prepare(shape.vertices, shape.faces)
    count, sigma = len(shape.vertices), 0.2 * edge
    part = whole_mesh(mesh, adjacency)
    laplacian, clusters = umbrella_laplacian(part, "free"), clusters_of(part)
    figure, both = pyplot.subplots(1, 2, figsize=(10, 4.2), layout="constrained", sharey=True)
    blurred = Correlation.calibrate(NoiseModel(0.1, (0.9,), (1.2 * edge,)), edge, part.ids, laplacian, part.core)
    for axes, truth, title in zip(both, (WHITE, blurred), ("white noise", "correlated noise"), strict=True):
        noise = truth.apply(lambda k: white_noise(count, k).astype(np.float32)[:, None], laplacian)[:, 0]
        vertices = shape.vertices + (sigma * noise)[:, None] * shape.normals
        for recipe, style, label in ((truth, "-", "Stein's risk"), (WHITE, ":", "noise taken for white")):
            if style == ":" and recipe == truth:
                continue
            noisy = NoisyMesh(part, clusters, np.full(count, sigma), recipe, laplacian)
            probes, risks, errors = noisy.probes(4), [], []
            for strength in FILTER_STRENGTHS[:-4]:
                smooth, probed = (low_pass(laplacian, one, np.array([strength])) for one in (vertices, probes))
                residuals = np.einsum("ij,ij->i", vertices - smooth, shape.normals) / sigma
                leverage = float((probes * probed).sum() / np.square(probes).sum())
                risks.append(np.square(residuals).mean() + 2.0 * leverage - 1.0)
                errors.append(np.square(np.einsum("ij,ij->i", smooth - shape.vertices, shape.normals) / sigma).mean())
            places = np.log10(np.maximum(FILTER_STRENGTHS[:-4], 10.0**-1.5))
            axes.plot(places, np.sqrt(np.maximum(risks, 0.0)), style, color=BLUE, label=label)
            if style == "-":
                axes.plot(places, np.sqrt(errors), "o", color=ORANGE, label="true error")
        axes.set(title=title, xlabel="$\\log_{10}$ of the strength s")
        axes.grid(alpha=0.25)
        axes.set_ylim(0.0, 1.05)
    both[0].set_ylabel("RMS error / standard deviation of the noise")
    both[1].legend()
    save(figure, "risk")


def draw_estimates() -> None:
    """Section of a noisy lens on a plate: estimates, and where the sharp ones are used."""
    rings, crease = 40, 22
    polar = [(k, 2.0 * np.pi * i / (6 * k)) for k in range(1, rings + 1) for i in range(6 * k)]
    radius, angle = np.array([(0, 0.0), *polar]).T
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    ball = crease * np.sqrt(2.0)  # its cap meets the plate at 45 degrees
    z = np.sqrt(np.maximum(ball**2 - radius**2, crease**2)) - crease
    clean, adjacency, edge = prepare(np.column_stack([x, y, z]), Delaunay(np.column_stack([x, y])).simplices)
    faces = clean.faces
    corners = clean.vertices[faces]
    if np.cross(corners[0, 1] - corners[0, 0], corners[0, 2] - corners[0, 0])[2] < 0.0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    normals = bf.estimate_vertex_geometry(clean.vertices, faces).normals
    vertices = clean.vertices + (0.2 * edge * white_noise(len(x)))[:, None] * normals
    mesh = TriangleMesh(vertices, faces)
    part = whole_mesh(mesh, adjacency)
    laplacian = umbrella_laplacian(part, "free")
    noisy = NoisyMesh(part, clusters_of(part), np.full(len(x), 0.2 * edge), WHITE, laplacian)
    _, filters = learn_low_pass(noisy, "curve", edge)
    found = {one.kind: vertices + one.moves for one in candidates(noisy, filters, ESTIMATE_KINDS)}
    result = bf.smooth(vertices, faces)
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 3.9), layout="constrained")
    line = np.flatnonzero(angle == 0.0)
    line = line[np.abs(radius[line] - crease) <= 8]
    for points, style, color, label in (
        (vertices, "x", "0.3", "noisy"),
        (found[0], "-", GREEN, "low-pass filter"),
        (found[4], "-", BLUE, "16 rounds of the normal filter"),
        (result.vertices, "--", ORANGE, "mixture"),
    ):
        left.plot(points[line, 0], points[line, 2], style, color=color, label=label)
    left.set(xlabel="x [edges]", ylabel="z [edges]", title="section")
    left.legend(fontsize=8)
    for points, style, color in ((found[0], "-", GREEN), (found[4], "-", BLUE), (result.vertices, "--", ORANGE)):
        squares = np.square(np.einsum("ij,ij->i", points - clean.vertices, normals) / (0.2 * edge))
        means = np.bincount(radius.astype(int), squares) / np.bincount(radius.astype(int))
        right.plot(np.arange(rings) - crease, np.sqrt(means[:-1]), style, color=color)
    right.axvline(0.0, color=GREY, linewidth=0.8)
    right.set(
        xlabel="distance from the crease [edges]", ylabel="RMS error / noise", title="error by distance from the crease"
    )
    right.grid(alpha=0.25)
    save(figure, "estimates")


# --- holes ----------------------------------------------------------------------------------------


def hole_region(
    vertices: FloatArray, faces: IntArray, removed: BoolArray
) -> tuple[InfluenceRegion, FloatArray, IntArray]:
    """The region around the first hole of a mesh without some vertices, and the mesh without them."""
    kept = faces[~removed[faces].any(axis=1)]
    ids, local = np.unique(kept, return_inverse=True)
    mesh = triangle_mesh(vertices[ids], local.reshape(-1, 3).astype(np.int32))
    adjacency = bf.vertex_adjacency(mesh)
    holes = [hole for hole in find_holes(mesh, adjacency) if not hole.is_outer_rim]
    (region,) = influence_regions(mesh, adjacency, [holes[0].loops])
    return region, mesh.vertices, mesh.faces


def section(points: FloatArray, faces: IntArray, axis: int) -> FloatArray:
    """Segments (k, 2, 2) in which a mesh meets the plane where a coordinate is 0, in the two other coordinates."""
    others = [k for k in range(3) if k != axis]
    segments = []
    for corners in points[faces]:
        ends = []
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if (a[axis] > 0.0) != (b[axis] > 0.0):
                share = a[axis] / (a[axis] - b[axis])
                ends.append((a + share * (b - a))[others])
        if len(ends) == 2:
            segments.append(ends)
    return np.array(segments).reshape(-1, 2, 2)


def plot_section(axes: Any, segments: FloatArray, label: str, **style: Any) -> None:
    """Draw segments as one line of the legend."""
    pieces = np.concatenate([segments, np.full((len(segments), 1, 2), np.nan)], axis=1).reshape(-1, 2)
    axes.plot(*pieces.T, label=label, **style)


def values_on_grid(
    surface: ImplicitSurface, x: FloatArray, y: FloatArray, place: Callable[..., FloatArray]
) -> FloatArray:
    """Values of a function in a plane, on a grid (k, k) of two coordinates that `place` completes."""
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    return surface.values_and_gradients(place(*grid.reshape(-1, 2).T))[0].reshape(grid.shape[:2])


def draw_spline() -> None:
    """Section through a hole in a torus: the spline, its constraints and its zeros, and simpler fills."""
    shape = torus(major_radius=1.0, minor_radius=0.4, resolution=40, jitter=0.2)
    vertices, faces = shape.vertices, shape.faces
    removed = np.linalg.norm(vertices - [1.0, 0.0, 0.4], axis=1) < 0.42
    region, open_vertices, open_faces = hole_region(vertices, faces, removed)
    normals = bf.estimate_vertex_geometry(open_vertices, open_faces).normals[region.ids]
    surface = fit_surrounding_surface(region, normals, noisy=False)
    fills = {order: initial_fill(region, order) for order in (1, 2)}
    if isinstance(surface, str) or None in fills.values():
        raise ValueError("the hole has no fill")
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 3.9), layout="constrained")
    x, z = np.linspace(0.4, 1.6, 200), np.linspace(-0.3, 0.55, 150)
    values = values_on_grid(surface, x, z, lambda a, b: np.column_stack([a, 0.0 * a, b]))
    levels = np.linspace(-0.3, 0.3, 25)
    left.contour(x, z, values, levels=levels[levels != 0.0], cmap="coolwarm", linewidths=0.7)
    left.contour(x, z, values, levels=[0.0], colors=[BLUE], linewidths=2.0)
    ids = select_surface_points(region, noisy=False)
    near = np.abs(region.vertices[ids, 1]) < 0.05
    step = float(region.sizes.mean())
    for side, marker in ((0.0, "o"), (1.0, "+"), (-1.0, "_")):
        moved = region.vertices[ids][near] + side * step * normals[ids][near]
        left.plot(moved[:, 0], moved[:, 2], marker, color="black", markersize=4 if side == 0.0 else 7)
    starts = fills[1].points[fills[1].rim_count :]
    starts = starts[np.abs(starts[:, 1]) < 0.03][::2]
    feet, _ = surface.project(starts)
    for start, foot in zip(starts, feet, strict=True):
        left.annotate("", foot[[0, 2]], start[[0, 2]], arrowprops={"arrowstyle": "->", "color": ORANGE})
    left.set(aspect="equal", xlabel="x", ylabel="z", title="f, its constraints, and Newton projections")
    plot_section(right, section(vertices, faces, 1), "surface before", color="0.8", linewidth=6)
    right.contour(x, z, values, levels=[0.0], colors=[BLUE], linewidths=1.5)
    right.plot([], [], color=BLUE, label="zeros of the spline")
    for order, style, label in ((2, "--", "bi-Laplacian"), (1, ":", "membrane")):
        plot_section(right, section(fills[order].points, fills[order].faces, 1), label, color=ORANGE, linestyle=style)
    right.set(aspect="equal", xlabel="x", xlim=(0.4, 1.6), ylim=(-0.3, 0.55), title="fills")
    right.legend(loc="lower center", fontsize=8)
    save(figure, "spline")


def draw_likelihood() -> None:
    """The restricted likelihood over the noise ratio, and the error of the zeros, for both powers."""
    shape = ellipsoid(semi_axes=(1.0, 0.8, 0.6), resolution=24, jitter=0.2)
    edge = prepare(shape.vertices, shape.faces)[2]
    vertices = shape.vertices + (0.1 * edge * white_noise(len(shape.vertices)))[:, None] * shape.normals
    removed = (shape.vertices[:, 2] > 0.0) & (np.hypot(shape.vertices[:, 0], shape.vertices[:, 1] / 0.8) < 0.4)
    region, open_vertices, open_faces = hole_region(vertices, shape.faces, removed)
    normals = bf.estimate_vertex_geometry(open_vertices, open_faces).normals[region.ids]
    surface = fit_surrounding_surface(region, normals, noisy=True)
    if isinstance(surface, str):
        raise ValueError(surface)
    ids = select_surface_points(region, np.linalg.norm(normals, axis=1) > 0.5, noisy=True)
    step = float(region.sizes.mean())
    points = np.concatenate([region.vertices[ids] + side * step * normals[ids] for side in (0.0, 1.0, -1.0)])
    centers = (points - surface.origin) / surface.scale
    values = np.repeat([0.0, step, -step], len(ids)) / surface.scale
    x, y, z = centers.T
    quadratics = np.column_stack([np.ones_like(x), x, y, z, x * x, x * y, x * z, y * y, y * z, z * z])
    q, triangle = np.linalg.qr(quadratics, mode="complete")
    contrasts, trend = q[:, 10:], q[:, :10]
    distances = np.linalg.norm(centers[:, None] - centers, axis=2)
    errors = np.kron(np.ones((3, 3)), np.eye(len(ids))) + np.eye(3 * len(ids))
    truth = shape.vertices[removed]
    ratios = np.array([INTERPOLATION_RATIO * 1e3, *NOISE_RATIOS])
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 4.0), layout="constrained")
    above: dict[int, FloatArray] = {}
    for power, color in ((3, ORANGE), (5, BLUE)):
        kernel = (-1.0 if power == 5 else 1.0) * distances**power
        inner = contrasts.T @ kernel @ contrasts
        criteria, misses = [], []
        for ratio in ratios:
            covariance = inner + ratio * np.linalg.norm(inner) * contrasts.T @ errors @ contrasts
            weights = np.linalg.solve(covariance, contrasts.T @ values)
            energy = float((contrasts.T @ values) @ weights)
            criteria.append(np.linalg.slogdet(covariance)[1] + len(weights) * np.log(energy))
            c = contrasts @ weights
            whole = kernel + ratio * np.linalg.norm(inner) * errors
            quadratic = np.linalg.solve(triangle[:10], trend.T @ (values - whole @ c))
            signed = (-1.0 if power == 5 else 1.0) * c
            fitted = surface._replace(weights=signed * (-1.0 if power == 5 else 1.0), quadratic=quadratic, power=power)
            feet, found = fitted.project(truth)
            misses.append(np.sqrt(np.square(np.linalg.norm(feet - truth, axis=1)[found]).mean()) / edge)
        above[power] = np.array(criteria)
        right.loglog(ratios, misses, "o-", color=color, label=f"p = {power}")
        print(f"p = {power}: least criterion {min(criteria):.1f} at {ratios[int(np.argmin(criteria))]:g}")
    print(f"chosen: p = {surface.power}, ratio {surface.noise_ratio:g}")
    least = min(criteria.min() for criteria in above.values())
    for power, color in ((3, ORANGE), (5, BLUE)):
        left.loglog(ratios, above[power] - least + 1.0, "o-", color=color, label=f"p = {power}")
    for axes in (left, right):
        axes.axvline(surface.noise_ratio, color=GREY, linewidth=0.8, linestyle="--")
        axes.set_xlabel("noise ratio")
        axes.grid(alpha=0.25)
        axes.legend()
    left.set(title="-2 log of the restricted likelihood", ylabel="above its minimum, + 1")
    right.set(title="distance from the removed surface", ylabel="RMS [edges]")
    save(figure, "likelihood")


def draw_crease() -> None:
    """Section across a hole in a ridge: surfaces of both sides, and a point of the crease on its way to both."""
    axis = np.linspace(-1.0, 1.0, 41)
    x, y = (values.ravel() for values in np.meshgrid(axis, axis, indexing="ij"))

    def height(x: FloatArray, y: FloatArray) -> FloatArray:
        return -0.5 * np.abs(x) - 0.35 * x**2 - 0.25 * y**2 + 0.3 * np.maximum(x, 0.0) * y

    corner = (41 * np.arange(40)[:, None] + np.arange(40)).ravel()
    faces = np.vstack(
        [np.column_stack([corner, corner + 41, corner + 42]), np.column_stack([corner, corner + 42, corner + 1])]
    )
    vertices = np.column_stack([x, y, height(x, y)])
    removed = np.hypot(x, y) < 0.42
    region, open_vertices, open_faces = hole_region(vertices, faces.astype(np.int32), removed)
    middles = region.vertices[region.faces].mean(axis=1)[:, 0]
    surfaces = []
    for side in (-1.0, 1.0):
        ids, local = np.unique(region.faces[side * middles > 0.0], return_inverse=True)
        normals = np.zeros_like(region.vertices)
        normals[ids] = bf.estimate_vertex_geometry(region.vertices[ids], local.reshape(-1, 3)).normals
        surface = fit_surrounding_surface(region, normals, noisy=False)
        if isinstance(surface, str):
            raise ValueError(surface)
        surfaces.append(surface)
    result = bf.fill_holes(open_vertices, open_faces)
    (hole,) = [hole for hole in result.holes if hole.filled]
    rim = region.vertices[: region.rim_count]
    on_crease = rim[np.abs(rim[:, 0]) < 1e-9]
    start, stop = on_crease[on_crease[:, 1].argmin()], on_crease[on_crease[:, 1].argmax()]
    edge = float(region.sizes.mean())
    tangents = [np.array([0.0, 1.0, -0.5 * end[1]]) for end in (start, stop)]
    start_tangent, stop_tangent = (tangent / np.linalg.norm(tangent) for tangent in tangents)
    curve = hermite_curve(start, start_tangent, stop, stop_tangent, edge)
    bent = curve + np.array([0.06, 0.0, 0.08]) * (1.0 - (curve[:, 1:2] / stop[1]) ** 2)
    moved = project_to_intersection(bent, surfaces, 1.0)
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    u, w = np.linspace(-0.6, 0.6, 160), np.linspace(-0.55, 0.25, 120)
    for surface, color, label in zip(surfaces, (BLUE, GREEN), ("left side", "right side"), strict=True):
        values = values_on_grid(surface, u, w, lambda a, b: np.column_stack([a, 0.0 * a, b]))
        left.contour(u, w, values, levels=[0.0], colors=[color], linewidths=1.5)
        left.plot([], [], color=color, label=f"zeros of the {label}")
    beside = np.array([0.0, 1e-9, 0.0])  # no vertex lies in the plane of the section
    for points, some, style in (
        (open_vertices, open_faces, {"label": "mesh", "color": "black", "linewidth": 3}),
        (result.vertices, result.faces[list(hole.new_faces)], {"label": "fill", "color": ORANGE, "linestyle": "--"}),
    ):
        plot_section(left, section(points + beside, some, 1), **style)
    nearest = int(np.abs(curve[:, 1]).argmin())
    left.annotate("", moved[nearest][[0, 2]], bent[nearest][[0, 2]], arrowprops={"arrowstyle": "->", "color": RED})
    left.plot(*bent[nearest][[0, 2]], "o", color=RED, label="a point beside the crease, projected")
    left.set(aspect="equal", xlabel="x", ylabel="z", xlim=(-0.8, 0.8), title="section across the crease")
    left.legend(fontsize=8, loc="lower center")
    for points, style, color, label in (
        (bent, "o", RED, "points beside the crease"),
        (moved, ".-", BLUE, "projected to both surfaces"),
    ):
        right.plot(points[:, 1], points[:, 2], style, color=color, label=label)
    t = np.linspace(start[1], stop[1], 100)
    right.plot(t, height(0.0 * t, t), color=GREY, linewidth=4, alpha=0.5, label="removed crease", zorder=0)
    right.set(xlabel="y", ylabel="z", title="along the crease")
    right.legend(fontsize=8)
    right.grid(alpha=0.25)
    save(figure, "crease")


FIGURES: tuple[Callable[[], None], ...] = (
    draw_predicted_errors,
    draw_variance_components,
    draw_noise_spectrum,
    draw_transfer_functions,
    draw_risk,
    draw_estimates,
    draw_spline,
    draw_likelihood,
    draw_crease,
)

if __name__ == "__main__":
    for draw in FIGURES:
        if len(sys.argv) == 1 or draw.__name__.removeprefix("draw_") in sys.argv[1:]:
            draw()
