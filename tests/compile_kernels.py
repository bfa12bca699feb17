"""Compile what most tests call, in one process: two that start at the same time would both compile all of it."""

import tempfile
from pathlib import Path

import numpy as np
from full_meshset import punched_torus
from hole_cases import without_faces_near

import bezier_filters as bf
from baselines import ouyang_feng_normals, razdan_bae
from bezier_filters.scale import estimate_file, smooth_file
from bezier_filters.surfaces import block_with_sharp_edges, torus
from survivors import keep_survivors


def compile_kernels() -> None:
    """Call every function on meshes as small as they can be."""
    vertices, faces = punched_torus()
    for robust in (False, True):
        for conditions in (False, True):
            bf.estimate_vertex_geometry(vertices, faces, robust=robust, conditions=conditions)
    for options in ({"radius": 0.5}, {"rings": 2, "alpha": 0.8, "robust": True}):
        bf.estimate_vertex_geometry(vertices, faces, **options)
    bf.estimate_vertex_geometry(vertices, None)
    for method in ("auto", "paper"):
        bf.smooth(vertices, faces, method)
        bf.fill_holes(vertices, faces, method)
    block, sides = block_with_sharp_edges(resolution=8)
    bf.fill_holes(block, without_faces_near(block, sides, np.array([-0.5, -0.5, 0.0]), 0.2))
    bf.bridge_holes(vertices, faces, [(0, 1)])
    bf.find_creases(block, sides)
    razdan_bae(vertices, faces)
    ouyang_feng_normals(vertices, faces)
    ring = torus(resolution=12, jitter=0.3)
    keep_survivors(ring.vertices, ring.faces, np.arange(len(ring.vertices)) % 2 == 0)
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder, "vertices.npy"), Path(folder, "faces.npy")
        np.save(files[0], vertices)
        np.save(files[1], faces)
        for function in (estimate_file, smooth_file):
            function(files, Path(folder, "out.ply"), tile_vertices=256, scheduler="synchronous")


if __name__ == "__main__":
    compile_kernels()
