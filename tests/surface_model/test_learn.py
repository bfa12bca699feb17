"""Noise that turns single normals is told from thin parts and sharp edges, whose normals turn away, too."""

import numpy as np
import pytest
from numba import config
from scanner_noise import in_all_directions

from bezier_filters import estimate_vertex_geometry
from bezier_filters.fitting.mesh_neighbourhoods import MeshNeighbourhoods
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.surface_model.fit_options import FitOptions
from bezier_filters.surface_model.learn import CANDIDATE_RINGS, learn_surface
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, ellipsoid, sphere, torus

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="takes too long without the compiler")


def noise_of(vertices, faces):
    arrays = prepare_kernel_mesh(triangle_mesh(vertices, faces), with_barriers=True)
    return learn_surface(MeshNeighbourhoods(arrays), FitOptions()).surface.noise


def flattened(surface, factor):
    return surface.vertices * np.array([1.0, 1.0, factor]), surface.faces


CLEAN = {
    "lens": flattened(sphere(resolution=12, jitter=0.2), 0.03),
    "finer lens": flattened(sphere(resolution=24, jitter=0.2), 0.03),
    "disc": flattened(sphere(resolution=12, jitter=0.2), 0.1),
    "flat ring": flattened(torus(resolution=24, jitter=0.2), 0.1),
    "flatter ring": flattened(torus(resolution=24, jitter=0.2), 0.03),
    "block": block_with_sharp_edges(resolution=12, jitter=0.2),
    "star": flattened(bumpy_star(resolution=12, jitter=0.2), 1.0),
}
SURFACES = {
    "torus": torus(resolution=24, jitter=0.3),
    "star": bumpy_star(resolution=16, jitter=0.2),
    "ellipsoid": ellipsoid(resolution=12, jitter=0.2),
}
each_surface = pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES)


@pytest.mark.parametrize("name", CLEAN)
def test_knife_edges_and_sharp_edges_are_not_heavy_noise(name):
    assert not noise_of(*CLEAN[name]).heavy


@each_surface
@pytest.mark.parametrize(("level", "heavy"), [(0.1, False), (0.2, False), (0.5, True), (0.6, True)])
def test_noise_of_half_an_edge_in_every_coordinate_is_heavy(surface, level, heavy):
    noise = noise_of(in_all_directions(surface.vertices, surface.faces, level), surface.faces)
    assert noise.heavy == heavy


def curvature_error(surface, geometry):
    return np.sqrt(np.square(geometry.mean_curvature - surface.mean_curvature).mean())


@pytest.mark.parametrize("rings", ["auto", 3, 7])
def test_every_ring_is_analysed_once_and_the_wanted_one_in_any_case(rings):
    surface = SURFACES["ellipsoid"]
    noisy = in_all_directions(surface.vertices, surface.faces, 0.1)
    arrays = prepare_kernel_mesh(triangle_mesh(noisy, surface.faces), with_barriers=True)
    found = [analysis.rings for analysis in learn_surface(MeshNeighbourhoods(arrays), FitOptions(rings=rings)).analyses]
    assert found == sorted(set(found))
    assert set(range(1, 6)) < set(found) <= {*CANDIDATE_RINGS, rings}
    assert rings == "auto" or rings in found


@each_surface
@pytest.mark.parametrize("options", [{}, {"radius": 0.4}], ids=["rings", "balls"])
def test_curvature_survives_heavy_noise(surface, options):
    """Single normals tell nothing then: a wide quadric over planes from these is no use."""
    vertices = in_all_directions(surface.vertices, surface.faces, 0.5)
    geometry = estimate_vertex_geometry(vertices, surface.faces, **options)
    counts = geometry.status_counts()
    assert counts["OK"] > 0.97 * len(vertices)
    plain = estimate_vertex_geometry(vertices, surface.faces, rings=5, degree=2, alpha=1.0)
    assert curvature_error(surface, geometry) < 0.5 * curvature_error(surface, plain)
    assert np.einsum("ij,ij->i", geometry.normals, surface.normals).min() > 0.0
