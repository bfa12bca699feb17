"""Time for many small holes: some 290 holes of 40 edges in a sphere of a million vertices, next to CGAL's filler.

CGAL is given the mesh as a file, the only way into its Python bindings; reading and filling are timed apart.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import bezier_filters as bf
from bezier_filters import surfaces
from hole_peers import write_off
from holes import compact


def perforated(resolution: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """A sphere with round holes, five edges in radius, some of which run into each other."""
    ball = surfaces.sphere(resolution=resolution)
    edge = np.linalg.norm(ball.vertices[ball.faces[0, 0]] - ball.vertices[ball.faces[0, 1]])
    centers = ball.vertices[np.random.default_rng(0).choice(len(ball.vertices), count)]
    tree = cKDTree(ball.vertices[ball.faces].mean(axis=1))
    keep = np.ones(len(ball.faces), dtype=bool)
    keep[np.concatenate(tree.query_ball_point(centers, 5.0 * edge)).astype(int)] = False
    return compact(ball.vertices, ball.faces[keep])


def time_cgal(vertices: np.ndarray, faces: np.ndarray) -> tuple[float, float, int]:
    """Seconds to read and to fill with curvatures continued, and the number of holes."""
    from CGAL import CGAL_Polygon_mesh_processing as processing
    from CGAL.CGAL_Polyhedron_3 import Polyhedron_3

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh.off"
        write_off(path, vertices, faces)
        start = time.perf_counter()
        mesh = Polyhedron_3(str(path))
        read = time.perf_counter()
    mesh.normalize_border()
    filled = 0
    for edge in list(mesh.border_halfedges()):
        border = next((side for side in (edge, edge.opposite()) if side.is_border()), None)
        if border is not None:
            processing.triangulate_refine_and_fair_hole(mesh, border, [], [], np.sqrt(2.0), 2)
            filled += 1
    return read - start, time.perf_counter() - read, filled


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--resolution", type=int, default=316, help="of the sphere; 316 gives a million vertices")
    parser.add_argument("--holes", type=int, default=300)
    options = parser.parse_args()
    vertices, faces = perforated(options.resolution, options.holes)
    bf.fill_holes(*perforated(30, 2))  # compile
    print(f"{len(vertices)} vertices, {len(faces)} faces")
    for _ in range(3):
        start = time.perf_counter()
        result = bf.fill_holes(vertices, faces)
        print(f"ours: {time.perf_counter() - start:.2f} s, {result.filled} holes")
        try:
            read, fill, count = time_cgal(vertices, faces)
        except ImportError as error:
            print(f"CGAL: left out ({error})")
            continue
        print(f"CGAL, continuity 2: {read:.2f} s reading + {fill:.2f} s, {count} holes")


if __name__ == "__main__":
    main()
