"""Times of the stages of an estimate, to see a regression: `make bench-kernels`.

With pytest-benchmark: `--benchmark-autosave` keeps a run, `--benchmark-compare` sets the next one against it.
"""

import numpy as np
import pytest

import bezier_filters as bf
from bezier_filters.meshes.adjacency import vertex_adjacency
from bezier_filters.meshes.frames import tangent_planes
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.sharp_edges import sharp_edge_vertices
from bezier_filters.meshes.spatial_order import sort_spatially
from speed import noisy, subdivided_bunny

VERTICES, FACES = subdivided_bunny(1)
MESH = sort_spatially(triangle_mesh(VERTICES, FACES)).mesh
ADJACENCY = vertex_adjacency(MESH)
PLANES = tangent_planes(MESH, ADJACENCY)
SHUFFLED = np.random.default_rng(0).permutation(len(VERTICES))
STAGES = {
    "spatial order": lambda: sort_spatially(triangle_mesh(VERTICES, FACES)),
    "spatial order, shuffled": lambda: sort_spatially(
        triangle_mesh(VERTICES[SHUFFLED], np.argsort(SHUFFLED)[FACES].astype(np.int32))
    ),
    "adjacency": lambda: vertex_adjacency(MESH),
    "tangent planes": lambda: tangent_planes(MESH, ADJACENCY),
    "creases": lambda: sharp_edge_vertices(MESH, ADJACENCY, PLANES),
    "2 rings, degree 3": lambda: bf.estimate_vertex_geometry(VERTICES, FACES, rings=2, alpha=0.8, threads=1),
    "5 rings, degree 4": lambda: bf.estimate_vertex_geometry(VERTICES, FACES, rings=5, degree=4, alpha=0.8, threads=1),
    "paper": lambda: bf.estimate_vertex_geometry(VERTICES, FACES, smoothness="paper", threads=1),
    "automatic": lambda: bf.estimate_vertex_geometry(VERTICES, FACES, threads=1),
    "automatic, noise": lambda: bf.estimate_vertex_geometry(noisy(VERTICES, FACES), FACES, threads=1),
}


@pytest.mark.parametrize("stage", STAGES)
def test_stage(benchmark, stage):
    benchmark.extra_info["vertices"] = len(VERTICES)
    benchmark(STAGES[stage])
