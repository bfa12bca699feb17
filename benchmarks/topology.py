"""What it costs to ask pymeshlab for the topology of a mesh, next to our own adjacency and to the filters.

Seconds, the least of some runs, on a torus with two holes. The first filter on a mesh asks; those after it know.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
import pymeshlab

import bezier_filters as bf
from bezier_filters.meshes.half_edges import border_edges
from bezier_filters.meshlab.topology import clear_topology_cache, topology_of
from bezier_filters.surfaces import torus

FILTERS = (
    bf.compute_normal_by_bezier_patch_per_vertex,
    bf.compute_curvature_by_bezier_patch_per_vertex,
    bf.compute_torsion_by_bezier_patch_per_vertex,
    bf.compute_selection_by_bezier_crease_per_edge,
    bf.apply_coord_bezier_patch_smoothing,
    bf.meshing_close_holes_by_bezier_patch,
)


def seconds(run: Callable[[], object], runs: int) -> float:
    """Least time of some runs."""
    found = []
    for _ in range(runs):
        begin = time.perf_counter()
        run()
        found.append(time.perf_counter() - begin)
    return min(found)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--resolution", type=int, default=300, help="of the torus, in faces around its tube")
    parser.add_argument("--runs", type=int, default=3)
    arguments = parser.parse_args()
    surface = torus(resolution=arguments.resolution, jitter=0.2)
    vertices = surface.vertices
    centers = vertices[surface.faces].mean(axis=1)
    faces = surface.faces[(np.abs(centers - [0.0, 1.0, 0.4]).max(axis=1) > 0.05) & (centers[:, 1] > -1.38)]
    print(f"{len(vertices):,} vertices, {len(faces):,} faces: {topology_of(vertices, faces).counts}")

    def scratch() -> pymeshlab.MeshSet:
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(vertices, faces))
        return ms

    def ours() -> None:
        mesh = bf.triangle_mesh(vertices, faces)
        border_edges(mesh, bf.vertex_adjacency(mesh).on_boundary)

    def ask() -> None:
        clear_topology_cache()
        topology_of(vertices, faces)

    asked = seconds(ask, arguments.runs)
    print(f"{'topology by pymeshlab':45} {asked:6.2f}")
    print(f"{'the same once more':45} {seconds(lambda: topology_of(vertices, faces), arguments.runs):6.2f}")
    print(f"{'of which the mesh in a MeshSet of its own':45} {seconds(scratch, arguments.runs):6.2f}")
    print(f"{'adjacency and borders by us':45} {seconds(ours, arguments.runs):6.2f}")
    for function in FILTERS:
        function(scratch())  # compiles, and learns the surface, which further filters know as well
        first, later = [scratch() for _ in range(arguments.runs)], [scratch() for _ in range(arguments.runs)]

        def asking(function: Callable[..., object] = function, first: list[pymeshlab.MeshSet] = first) -> None:
            clear_topology_cache()
            function(first.pop())

        def knowing(function: Callable[..., object] = function, later: list[pymeshlab.MeshSet] = later) -> None:
            function(later.pop())

        spent, known = seconds(asking, arguments.runs), seconds(knowing, arguments.runs)
        print(f"{function.__name__:45} {known:6.2f}, {spent:.2f} if it has to ask")


if __name__ == "__main__":
    main()
