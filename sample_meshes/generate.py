"""Write the sample meshes beside this file, or check that they are up to date.

Run ``python sample_meshes/generate.py`` after changing a surface; ``--check`` writes nothing and
exits with status 1 if a file is missing or differs.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from plyfile import PlyData, PlyElement, PlyParseError

from bezier_filters import surfaces
from bezier_filters.arrays import FloatArray, IntArray

INNER, OUTER, ANGLE, HEIGHT = 0.4, 1.0, 2.0, 0.4
"""Radii, opening angle and height of the fan,"""
HOLE_ANGLE, HOLE_RADIUS = 1.35, 0.27
"""and where its hole is, and how large."""
FOLDER = Path(__file__).parent
TOLERANCE = 1e-12
"""Sines differ in the last digit from processor to processor; so may the files, and no more."""


def sample_meshes() -> dict[str, PlyData]:
    """All meshes by file name."""
    sampled = {
        "sphere.ply": surfaces.sphere(),
        "ellipsoid.ply": surfaces.ellipsoid(jitter=0.3),
        "bumpy_star.ply": surfaces.bumpy_star(jitter=0.3),
        "torus.ply": surfaces.torus(jitter=0.3),
        "monkey_saddle.ply": surfaces.monkey_saddle(jitter=0.3),
        "waves.ply": surfaces.waves(),
        "punched_patch.ply": surfaces.punched_patch(jitter=0.2),
    }
    meshes = {name: _ply_of_surface(surface) for name, surface in sampled.items()}
    vertices, faces = surfaces.block_with_sharp_edges()
    meshes["block.ply"] = _ply(vertices, faces, _mean_face_normals(vertices, faces), {})
    vertices, faces = fan_with_hole()
    meshes["fan.ply"] = _ply(vertices, faces, _mean_face_normals(vertices, faces), {})
    return meshes


def fan_with_hole(cells: int = 16) -> tuple[FloatArray, IntArray]:
    """Surface of the body INNER <= r <= OUTER, 0 <= angle <= ANGLE, 0 <= z <= HEIGHT, without some of its outer wall.

    The hole reaches across both edges of the wall, as that of Figure 10 of the paper does in the fandisk.
    """
    counts = (cells, 3 * cells, (2 * cells) // 3)
    points: list[FloatArray] = []
    faces: list[IntArray] = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for end in (0.0, 1.0):
            grids = np.meshgrid(*(np.linspace(0.0, 1.0, counts[k] + 1) for k in others), indexing="ij")
            side = np.full((grids[0].size, 3), end)
            side[:, others] = np.stack([grid.ravel() for grid in grids], axis=1)
            index = np.arange(len(side)).reshape(grids[0].shape) + sum(map(len, points))
            a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
            new = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
            faces.append(new if (end == 1.0) == (axis != 1) else new[:, ::-1])
            points.append(side)
    unique, inverse = np.unique(np.round(np.concatenate(points), 12), axis=0, return_inverse=True)
    r, angle, z = (unique * [OUTER - INNER, ANGLE, HEIGHT] + [INNER, 0.0, 0.0]).T
    vertices = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    whole = inverse.ravel()[np.concatenate(faces)].astype(np.int32)
    place = np.array([OUTER * np.cos(HOLE_ANGLE), OUTER * np.sin(HOLE_ANGLE), 0.5 * HEIGHT])
    rest = whole[(np.linalg.norm(vertices - place, axis=1) > HOLE_RADIUS)[whole].all(axis=1)]
    used, local = np.unique(rest, return_inverse=True)
    return vertices[used], local.reshape(-1, 3).astype(np.int32)


def main(arguments: list[str] | None = None) -> int:
    """Write or check the files; return the exit status."""
    parser = argparse.ArgumentParser(description="Write the sample meshes beside this script.")
    parser.add_argument("--check", action="store_true", help="write nothing; exit status 1 if a file differs")
    check = parser.parse_args(arguments).check
    outdated = []
    for name, mesh in sample_meshes().items():
        if not check:
            mesh.write(FOLDER / name)
        elif not _is_up_to_date(FOLDER / name, mesh):
            outdated.append(name)
    if outdated:
        print(f"out of date: {', '.join(outdated)}; run {Path(__file__).name}", file=sys.stderr)
    return 1 if outdated else 0


def _ply_of_surface(surface: surfaces.SampledSurface) -> PlyData:
    truth = {
        "true_mean_curvature": surface.mean_curvature,
        "true_gaussian_curvature": surface.gaussian_curvature,
    }
    return _ply(surface.vertices, surface.faces, surface.normals, truth)


def _ply(vertices: FloatArray, faces: IntArray, normals: FloatArray, columns: dict[str, FloatArray]) -> PlyData:
    """Little-endian binary PLY with double coordinates."""
    values = dict(zip("xyz", vertices.T, strict=True))
    values |= dict(zip(("nx", "ny", "nz"), normals.T, strict=True))
    values |= columns
    vertex_rows = np.empty(len(vertices), dtype=[(name, "f8") for name in values])
    for name, column in values.items():
        vertex_rows[name] = column
    face_rows = np.empty(len(faces), dtype=[("vertex_indices", "i4", (3,))])
    face_rows["vertex_indices"] = faces
    elements = [
        PlyElement.describe(vertex_rows, "vertex"),
        PlyElement.describe(face_rows, "face", len_types={"vertex_indices": "u1"}),
    ]
    return PlyData(elements, byte_order="<")


def _mean_face_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Unit sums of the area vectors around each vertex: the block has no true normals on its edges."""
    corners = vertices[faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(vertices)
    np.add.at(normals, faces, areas[:, None, :])
    unit: FloatArray = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return unit


def _is_up_to_date(path: Path, mesh: PlyData) -> bool:
    """Whether a file holds the mesh, up to rounding."""
    try:
        stored = PlyData.read(path)
    except (FileNotFoundError, PlyParseError):
        return False
    if stored.header != mesh.header:
        return False
    same_faces = np.array_equal(np.stack(stored["face"]["vertex_indices"]), np.stack(mesh["face"]["vertex_indices"]))
    return same_faces and all(
        np.allclose(stored["vertex"][p.name], mesh["vertex"][p.name], rtol=TOLERANCE, atol=TOLERANCE)
        for p in mesh["vertex"].properties
    )


if __name__ == "__main__":
    sys.exit(main())
