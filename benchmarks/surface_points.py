"""The fitted surface between the vertices, next to the estimates at them, on surfaces that are known.

    python benchmarks/surface_points.py

Errors are root mean squares: of the mean curvature relative to the root mean square of the true one, of normals in
degrees, of positions in mean edges. A level set of each body gives the truth, with derivatives by central differences.
"""

from collections.abc import Callable

import numpy as np

import bezier_filters as bf
from bezier_filters.arrays import FloatArray
from bezier_filters.surfaces import SampledSurface, bumpy_star, ellipsoid, torus

LevelSet = Callable[[FloatArray], FloatArray]
STEP = 1e-4  # of the central differences, a length; errors of second derivatives are near 1e-7
PLACES = 20_000
AXES = (1.0, 0.7, 0.5)
FREQUENCIES = (3.0, 4.0, 5.0)


def torus_level(points: FloatArray) -> FloatArray:
    """Distance from a torus with radii 1 and 0.35."""
    return np.asarray(np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - 0.35)


def ellipsoid_level(points: FloatArray) -> FloatArray:
    """Level set of an ellipsoid."""
    return np.asarray(np.linalg.norm(points / AXES, axis=1) - 1.0)


def star_level(points: FloatArray) -> FloatArray:
    """Level set of `bumpy_star`."""
    radius = np.linalg.norm(points, axis=1)
    return np.asarray(radius - 1.0 - 0.08 * np.sin(points / radius[:, np.newaxis] * FREQUENCIES).sum(axis=1))


def truth(level: LevelSet, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance to first order, normal and mean curvature of the level through each point."""
    shifts = STEP * np.eye(3)
    gradient = np.column_stack([level(points + e) - level(points - e) for e in shifts]) / (2.0 * STEP)
    hessian = np.empty((len(points), 3, 3))
    for i, e in enumerate(shifts):
        for j, f in enumerate(shifts):
            corners = level(points + e + f) - level(points + e - f) - level(points - e + f) + level(points - e - f)
            hessian[:, i, j] = corners / (4.0 * STEP**2)
    slope = np.linalg.norm(gradient, axis=1)
    normals = gradient / slope[:, np.newaxis]
    along = np.einsum("ni,nij,nj->n", normals, hessian, normals)
    return level(points) / slope, normals, 0.5 * (np.trace(hessian, axis1=1, axis2=2) - along) / slope


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def measure(name: str, body: SampledSurface, level: LevelSet, noise: float) -> None:
    """Print a row of the table."""
    rng = np.random.default_rng(7)
    ends = body.vertices[body.faces]
    edge = float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean())
    vertices = body.vertices + noise * edge * rng.standard_normal((len(body.vertices), 1)) * body.normals
    surface = bf.fit_surface(vertices, body.faces)
    rows, weights = rng.integers(0, len(body.faces), PLACES), rng.dirichlet([1.0, 1.0, 1.0], PLACES)
    there = surface.evaluate(rows, weights[:, 1:])
    distance, normals, mean = truth(level, there.points)
    at = surface.geometry
    own = truth(level, at.displacements + vertices)
    scale = rms(mean)
    interpolated = np.einsum("qk,qk->q", weights, at.mean_curvature[body.faces[rows]])
    facets = truth(level, np.einsum("qk,qkd->qd", weights, vertices[body.faces[rows]]))[0]
    cells = [
        rms(at.mean_curvature - own[2]) / scale,
        rms(there.mean_curvature - mean) / scale,
        rms(interpolated - mean) / scale,
        np.degrees(rms(np.linalg.norm(at.normals - own[1], axis=1))),
        np.degrees(rms(np.linalg.norm(there.normals - normals, axis=1))),
        rms(own[0]) / edge,
        rms(distance) / edge,
        rms(facets) / edge,
    ]
    print(f"| {name} | {noise:g} | " + " | ".join(f"{cell:.2g}" for cell in cells) + " |")


def main() -> None:
    """Print the table."""
    measured = ("H at vertices", "between", "interpolated", "normals", "between", "positions", "between", "facets")
    columns = ("body", "noise", *measured)
    print("| " + " | ".join(columns) + " |")
    print("|---" * len(columns) + "|")
    bodies = (
        ("torus", torus(minor_radius=0.35, resolution=28, jitter=0.3, seed=5), torus_level),
        ("ellipsoid", ellipsoid(semi_axes=AXES, resolution=22, jitter=0.3, seed=6), ellipsoid_level),
        ("star", bumpy_star(frequencies=FREQUENCIES, resolution=26, jitter=0.3, seed=7), star_level),
    )
    for name, body, level in bodies:
        for noise in (0.0, 0.05, 0.1, 0.2):
            measure(f"{name}, {len(body.vertices):,}", body, level, noise)


if __name__ == "__main__":
    main()
