"""Some of the vertices far off an otherwise clean mesh: what smoothing leaves of it, and normals of estimates.

Shares of 1 to 40 % of the vertices are off by a normal distribution of .3 to 2 mean edges, along the normal or in all
directions, some with white noise of .05 or .1 besides. Printed are, as geometric means over the surfaces, the root
mean square height over the truth in mean edges before and after smoothing, the mean angle between face normals and
true ones in degrees, and the root mean square angle of the normals of estimates, at edges left out.
"""

from collections.abc import Callable

import numpy as np

import bezier_filters as bf
from bezier_filters import surfaces
from peers import angles

CASES = (
    (0.01, 0.5, 0.0),
    (0.015, 1.0, 0.05),
    (0.03, 0.1, 0.0),
    (0.03, 1.0, 0.0),
    (0.05, 2.0, 0.1),
    (0.1, 0.5, 0.05),
    (0.15, 0.3, 0.0),
    (0.25, 0.7, 0.05),
    (0.4, 0.5, 0.0),
)  # share, size, noise
AT_EDGES = 0.8  # cosine of the angle between a face and a normal, below which that is at an edge
Shape = tuple[np.ndarray, np.ndarray, np.ndarray]  # vertices, faces, true normals of the vertices


def sampled(shape: surfaces.SampledSurface) -> Shape:
    return shape.vertices, shape.faces, shape.normals


def block() -> Shape:
    vertices, faces = surfaces.block_with_sharp_edges(resolution=30, jitter=0.25)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], face_normals(vertices, faces))
    return vertices, faces, normals / np.linalg.norm(normals, axis=1, keepdims=True)


SHAPES: dict[str, Callable[[], Shape]] = {
    "torus": lambda: sampled(surfaces.torus(resolution=36, jitter=0.2)),
    "ellipsoid": lambda: sampled(surfaces.ellipsoid(resolution=24, jitter=0.2)),
    "star": lambda: sampled(surfaces.bumpy_star(resolution=24, jitter=0.2)),
    "coarse star": lambda: sampled(surfaces.bumpy_star(resolution=16)),
    "block": block,
}


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    corners = vertices[faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)


def errors(shape: Shape, share: float, size: float, noise: float, along: bool, seed: int = 77) -> list[float]:
    """Heights before and after, angles before and after, and angles of estimated normals."""
    vertices, faces, normals = shape
    random = np.random.default_rng(seed)
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()

    def drawn() -> np.ndarray:
        return normals * random.normal(size=(len(vertices), 1)) if along else random.normal(size=vertices.shape)

    hit = random.random((len(vertices), 1)) < share
    moved = vertices + edge * (size * hit * drawn() + noise * drawn())
    smoothed, truth = bf.smooth(moved, faces).vertices, face_normals(vertices, faces)
    estimate = bf.estimate_vertex_geometry(moved, faces).normals
    heights = [np.einsum("ij,ij->i", points - vertices, normals) / edge for points in (moved, smoothed)]
    turned = [angles(face_normals(points, faces), truth).mean() for points in (moved, smoothed)]
    roots = [np.sqrt(np.square(values).mean()) for values in heights]
    is_inside = np.ones(len(vertices), dtype=bool)
    for k in range(3):
        is_inside[faces[np.einsum("ij,ij->i", normals[faces[:, k]], truth) < AT_EDGES, k]] = False
    return [*roots, *turned, np.sqrt(np.square(angles(estimate, normals)[is_inside]).mean())]


def main() -> None:
    shapes, of_all = {name: make() for name, make in SHAPES.items()}, []
    print("| share | size | noise | directions | height, before | after | angle, before | after | normals |")
    print("|---|---|---|---|---|---|---|---|---|")
    for share, size, noise in CASES:
        for along in (True, False):
            found = [errors(shape, share, size, noise, along) for shape in shapes.values()]
            of_all += found
            means = " | ".join(f"{value:.3g}" for value in np.exp(np.log(found).mean(axis=0)))
            print(f"| {share} | {size} | {noise} | {'normal' if along else 'all'} | {means} |", flush=True)
    print("| all | | | | " + " | ".join(f"{value:.3g}" for value in np.exp(np.log(of_all).mean(axis=0))) + " |")


if __name__ == "__main__":
    main()
