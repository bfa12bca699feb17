"""Subdivision and remeshing against known surfaces: distances from the truth, angles and valences.

Bodies of other sizes and seeds than those of the tests, regular and irregular, without noise and with some. The peers
are pymeshlab's subdivision schemes and its isotropic remeshing (its isotropic loop is that of PMP, too) and, where it
is installed, MeshLib's remeshing. Distances are root mean squares in mean edges of the given mesh.

    python benchmarks/remeshing.py
"""

from collections.abc import Callable, Iterator

import numpy as np
import pymeshlab

import bezier_filters as bf
from bezier_filters.surfaces import SampledSurface, bumpy_star, ellipsoid, torus
from peers import loaded

AXES, AMPLITUDE, FREQUENCIES, MINOR = np.array([1.0, 0.8, 0.6]), 0.1, np.array([3.0, 5.0, 4.0]), 0.35
LEVELS, JITTERS, SEED = (0.0, 0.1), (0.0, 0.3), 7
Pair = tuple[np.ndarray, np.ndarray]


def torus_heights(points: np.ndarray) -> np.ndarray:
    """Distances from the torus."""
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - MINOR


def ellipsoid_heights(points: np.ndarray) -> np.ndarray:
    """Distances from the ellipsoid, to first order."""
    value = np.square(points / AXES).sum(axis=1) - 1.0
    return value / (2.0 * np.linalg.norm(points / AXES**2, axis=1))


def star_heights(points: np.ndarray) -> np.ndarray:
    """Distances from the star, to first order."""
    radius = np.linalg.norm(points, axis=1)
    directions = points / radius[:, np.newaxis]
    rise = radius - 1.0 - AMPLITUDE * np.sin(directions * FREQUENCIES).sum(axis=1)
    slopes = -AMPLITUDE * np.cos(directions * FREQUENCIES) * FREQUENCIES
    slopes -= np.einsum("nd,nd->n", slopes, directions)[:, np.newaxis] * directions
    return rise / np.sqrt(1.0 + np.square(slopes / radius[:, np.newaxis]).sum(axis=1))


def bodies(jitter: float) -> dict[str, tuple[SampledSurface, Callable[[np.ndarray], np.ndarray]]]:
    """Meshes with the functions that measure distances from their surfaces."""
    return {
        "torus": (torus(minor_radius=MINOR, resolution=26, jitter=jitter, seed=SEED), torus_heights),
        "ellipsoid": (ellipsoid(semi_axes=(1.0, 0.8, 0.6), resolution=14, jitter=jitter, seed=SEED), ellipsoid_heights),
        "star": (
            bumpy_star(amplitude=AMPLITUDE, frequencies=(3.0, 5.0, 4.0), resolution=18, jitter=jitter, seed=SEED),
            star_heights,
        ),
    }


def by_pymeshlab(name: str, vertices: np.ndarray, faces: np.ndarray, **options: object) -> Pair:
    """Result of a filter of pymeshlab."""
    ms = loaded(vertices, faces)
    getattr(ms, name)(**options)
    return ms.current_mesh().vertex_matrix(), ms.current_mesh().face_matrix()


def by_meshlib(vertices: np.ndarray, faces: np.ndarray, edge: float) -> Pair | None:
    """Result of MeshLib's remeshing, if it is there."""
    try:
        from meshlib import mrmeshnumpy, mrmeshpy
    except ImportError:
        return None
    mesh = mrmeshnumpy.meshFromFacesVerts(faces.astype(np.int32), vertices)
    settings = mrmeshpy.RemeshSettings()
    settings.targetEdgeLen, settings.finalRelaxIters = edge, 3
    settings.projectOnOriginalMesh = True
    mrmeshpy.remesh(mesh, settings)
    mesh.pack()
    return mrmeshnumpy.getNumpyVerts(mesh), mrmeshnumpy.getNumpyFaces(mesh.topology)


def quality(vertices: np.ndarray, faces: np.ndarray) -> tuple[float, float, float]:
    """Smallest angle, mean of the smallest angles of faces, and part of the vertices with 6 neighbours."""
    sides = np.roll(vertices[faces], -1, axis=1) - vertices[faces]
    sides /= np.linalg.norm(sides, axis=2, keepdims=True)
    cosines = -np.einsum("fkd,fkd->fk", sides, np.roll(sides, 1, axis=1))
    angles = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))).min(axis=1)
    return float(angles.min()), float(angles.mean()), float((np.bincount(faces.ravel()) == 6).mean())


def subdivided(vertices: np.ndarray, faces: np.ndarray) -> Iterator[tuple[str, Pair]]:
    """Every face into four, by ours and by the schemes of pymeshlab."""
    result = bf.subdivide(vertices, faces)
    yield "ours", (result.vertices, result.faces)
    for name in ("loop", "butterfly", "ls3_loop"):
        yield (
            name,
            by_pymeshlab(
                f"meshing_surface_subdivision_{name}",
                vertices,
                faces,
                iterations=1,
                threshold=pymeshlab.PercentageValue(0),
            ),
        )


def remeshed(vertices: np.ndarray, faces: np.ndarray, edge: float) -> Iterator[tuple[str, Pair]]:
    """As many regular triangles as pymeshlab makes, by ours and by the peers."""
    peer = by_pymeshlab(
        "meshing_isotropic_explicit_remeshing",
        vertices,
        faces,
        iterations=10,
        targetlen=pymeshlab.PureValue(edge),
    )
    result = bf.remesh(vertices, faces, vertex_count=len(peer[0]))
    yield "ours", (result.vertices, result.faces)
    yield "pymeshlab", peer
    other = by_meshlib(vertices, faces, edge)
    if other is not None:
        yield "MeshLib", other


def main() -> None:
    """Print a row for each body, mesh and noise."""
    for jitter in JITTERS:
        for name, (body, heights) in bodies(jitter).items():
            edge = float(np.linalg.norm(np.diff(body.vertices[body.faces[:, :2]], axis=1), axis=2).mean())
            for level in LEVELS:
                noise = np.random.default_rng(SEED).standard_normal((len(body.vertices), 1))
                vertices = body.vertices + level * edge * noise * body.normals
                title = f"{name}, {'irregular' if jitter else 'regular'}, {len(vertices):,} vertices, noise {level}"
                for kind, results in (
                    ("subdivide", subdivided(vertices, body.faces)),
                    ("remesh", remeshed(vertices, body.faces, edge)),
                ):
                    for method, (points, faces) in results:
                        error = float(np.sqrt(np.mean(np.square(heights(points))))) / edge
                        least, mean, six = quality(points, faces)
                        shape = f"{len(points):6,} vertices  angles {least:4.1f} {mean:4.1f}  six {six:.2f}"
                        print(f"{title:50}  {kind:9}  {method:9}  {error:.2e}  {shape}", flush=True)


if __name__ == "__main__":
    main()
