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
    return meshes


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
