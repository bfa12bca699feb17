"""Figures of docs/mathematics/holes.md."""

from collections.abc import Callable
from typing import Any

import numpy as np
from mathematics_common import BLUE, GREEN, GREY, ORANGE, RED, prepare, save, white_noise
from matplotlib import pyplot

import bezier_filters as bf
from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.holes.crease_fill import hermite_curve, project_to_intersection
from bezier_filters.holes.hole_detection import find_holes
from bezier_filters.holes.implicit_surface import INTERPOLATION_RATIO, NOISE_RATIOS, ImplicitSurface
from bezier_filters.holes.influence_region import InfluenceRegion, influence_regions, select_surface_points
from bezier_filters.holes.smooth_fill import fit_surrounding_surface, initial_fill
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from bezier_filters.surfaces import ellipsoid, torus


def hole_region(
    vertices: FloatArray, faces: IntArray, removed: BoolArray
) -> tuple[InfluenceRegion, FloatArray, IntArray]:
    """The region around the first hole of a mesh without some vertices, and the mesh without them."""
    kept = faces[~removed[faces].any(axis=1)]
    ids, local = np.unique(kept, return_inverse=True)
    mesh = prepare_mesh(triangle_mesh(vertices[ids], local.reshape(-1, 3).astype(np.int32)))
    holes = [hole for hole in find_holes(mesh) if not hole.is_outer_rim]
    (region,) = influence_regions(mesh, [holes[0].loops])
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
    edge = prepare(shape.vertices, shape.faces).mean_edge
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
