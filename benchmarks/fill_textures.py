"""Errors of texture coordinates in fills, where the surface was cut from one with a known parametrisation.

    python benchmarks/fill_textures.py

The height field has the horizontal coordinates as texture coordinates, sphere and ellipsoid longitude and latitude as
shares of their ranges, and pymeshlab's textured bunny its own atlas, of which the holes avoid the seams. Errors are
lengths in the atlas, whose side is 1, at the corners of new faces that are new vertices.
"""

from pathlib import Path

import numpy as np
import pymeshlab
from scipy.spatial import cKDTree

import bezier_filters as bf
from bezier_filters import surfaces
from bezier_filters.holes.adjacent_rows import adjacent_faces
from bezier_filters.holes.texture_continuation import Texture, continue_texture, wedge_coordinates
from bezier_filters.surfaces.sampling import rectangle

BUNNY = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes" / "bunny10k_textured.obj"


def longitude_and_latitude(points: np.ndarray) -> np.ndarray:
    x, y, z = points.T / np.linalg.norm(points, axis=1)
    return np.column_stack([0.5 + np.arctan2(y, x) / (2.0 * np.pi), np.arccos(np.clip(z, -1.0, 1.0)) / np.pi])


def fill(vertices: np.ndarray, faces: np.ndarray, coordinates: np.ndarray, **options: object) -> tuple[np.ndarray, ...]:
    """Points at new corners, and their coordinates as those of adjacent old faces and as they are continued."""
    result = bf.fill_holes(vertices, faces, **options)
    new = result.faces[len(faces) :]
    like = adjacent_faces(result.vertices, faces, new)
    adjacent = wedge_coordinates(result.vertices[new], vertices[faces[like]], coordinates[like])
    texture = Texture(coordinates, np.zeros(len(faces), np.int32))
    continued = continue_texture(result.vertices, faces, new, like, texture).coordinates
    inner = new >= len(vertices)
    return result.vertices[new[inner]], adjacent[inner], continued[inner]


def show(name: str, truth: np.ndarray, adjacent: np.ndarray, continued: np.ndarray) -> None:
    numbers = []
    for found in (adjacent, continued):
        errors = np.linalg.norm(found - truth, axis=1)
        numbers += [np.median(errors), np.sqrt((errors**2).mean()), errors.max()]
    print(f"{name:18} {np.ptp(truth, axis=0).max():7.3f} " + " ".join(f"{number:9.5f}" for number in numbers))


def height_field_cases() -> None:
    lattice, faces = rectangle((60, 60), jitter=0.3)
    x, y = (lattice / 60.0).T
    vertices = np.column_stack([x, y, 0.15 * np.sin(4.0 * x) * np.cos(3.0 * y + 0.5)])
    for radius in (0.1, 0.2, 0.3):
        kept = faces[np.hypot(*(vertices[faces].mean(axis=1)[:, :2] - 0.5).T) > radius]
        points, *found = fill(vertices, kept, vertices[kept][..., :2])
        show(f"height field {radius}", points[:, :2], *found)


def ellipsoid_cases(name: str, axes: np.ndarray) -> None:
    ball = surfaces.sphere(resolution=30)
    vertices, centers = axes * ball.vertices, ball.vertices[ball.faces].mean(axis=1)
    for radius in (0.2, 0.4, 0.6):
        kept = ball.faces[np.linalg.norm(centers - [0.8, 0.2, 0.5], axis=1) > radius]
        points, *found = fill(vertices, kept, longitude_and_latitude(ball.vertices)[kept])
        show(f"{name} {radius}", longitude_and_latitude(points / axes), *found)


def bunny_case() -> None:
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(BUNNY))
    mesh = ms.current_mesh()
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix().astype(np.int32)
    coordinates = mesh.wedge_tex_coord_matrix().reshape(-1, 3, 2)
    low, high = np.full((len(vertices), 2), np.inf), np.full((len(vertices), 2), -np.inf)
    np.minimum.at(low, faces.ravel(), coordinates.reshape(-1, 2))
    np.maximum.at(high, faces.ravel(), coordinates.reshape(-1, 2))
    at_seam = (high > low).any(axis=1)
    centers = vertices[faces].mean(axis=1)
    radius = 0.04 * np.linalg.norm(np.ptp(vertices, axis=0))
    weights = np.array([(x, y, 20 - x - y) for x in range(21) for y in range(21 - x)]) / 20.0
    collected = []
    for place in np.random.default_rng(0).choice(len(vertices), 60, replace=False):
        cut = np.linalg.norm(centers - vertices[place], axis=1) < radius
        if at_seam[faces[cut]].any():
            continue
        selected = np.zeros(len(vertices), dtype=bool)
        selected[faces[cut]] = True
        points, *found = fill(vertices, faces[~cut], coordinates[~cut], selected=selected)
        surface = np.einsum("bk,fkj->fbj", weights, vertices[faces[cut]]).reshape(-1, 3)
        known = np.einsum("bk,fkj->fbj", weights, coordinates[cut]).reshape(-1, 2)
        if len(points):
            collected.append((known[cKDTree(surface).query(points)[1]], *found))
    show(f"bunny, {len(collected)} holes", *map(np.concatenate, zip(*collected, strict=True)))


def main() -> None:
    print("errors like adjacent old faces, then continued; the width is that of the fill in the atlas")
    print(f"{'':18} {'width':>7} " + " ".join(f"{name:>9}" for name in 2 * ["median", "RMS", "largest"]))
    height_field_cases()
    ellipsoid_cases("sphere", np.ones(3))
    ellipsoid_cases("ellipsoid", np.array([1.0, 0.8, 0.6]))
    bunny_case()


if __name__ == "__main__":
    main()
