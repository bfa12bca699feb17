"""Meshes of the analytic surfaces: topology, shape of the triangles, jitter and seed."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from surface_cases import (
    CASES,
    IRREGULAR,
    area_vectors,
    assert_valid_mesh,
    border_edges,
    corner_angles,
    directed_edges,
    each_jitter,
    each_surface,
    make,
)

from bezier_filters import surfaces
from bezier_filters.surfaces import SampledSurface
from bezier_filters.surfaces.sampling import MAX_JITTER


@each_surface
@each_jitter
def test_mesh_is_manifold_with_the_right_topology(name: str, jitter: float) -> None:
    surface = make(name, jitter)
    assert_valid_mesh(surface.vertices, surface.faces, CASES[name].euler_characteristic, CASES[name].rims)


@each_surface
@each_jitter
def test_no_triangle_is_thin_or_folded(name: str, jitter: float) -> None:
    surface = make(name, jitter)
    assert corner_angles(surface.vertices, surface.faces).min() > (8.0 if jitter else 20.0)
    face_normals = area_vectors(surface.vertices, surface.faces)
    face_normals /= np.linalg.norm(face_normals, axis=1, keepdims=True)
    assert np.einsum("mi,mki->mk", face_normals, surface.normals[surface.faces]).min() > 0.85


@each_surface
def test_jitter_makes_the_mesh_irregular(name: str) -> None:
    surface = make(name, IRREGULAR)
    valences = np.bincount(surface.faces.ravel())
    inner = np.setdiff1d(np.arange(len(valences)), border_edges(surface.faces))
    assert np.mean(valences[inner] != 6) > 0.25
    lengths = np.linalg.norm(np.diff(surface.vertices[directed_edges(surface.faces)], axis=1), axis=2)
    assert lengths.max() / lengths.min() > 3.5


@pytest.mark.usefixtures("spheres_afresh")
@each_surface
def test_seed_decides_the_samples(name: str) -> None:
    first, again, other = (CASES[name].make(jitter=IRREGULAR, seed=seed) for seed in (1, 1, 2))
    for field in fields(SampledSurface):
        np.testing.assert_array_equal(getattr(first, field.name), getattr(again, field.name))
    assert first.vertices.shape != other.vertices.shape or not np.allclose(first.vertices, other.vertices)


@pytest.mark.parametrize("resolution", [1, 2, 7])
def test_icosphere_counts(resolution: int) -> None:
    ball = surfaces.sphere(resolution=resolution)
    assert len(ball.vertices) == 10 * resolution**2 + 2
    assert len(ball.faces) == 20 * resolution**2
    np.testing.assert_array_equal(np.unique(np.bincount(ball.faces.ravel())), [5] if resolution == 1 else [5, 6])


def test_regular_sphere_has_nearly_equal_edges() -> None:
    ball = surfaces.sphere(resolution=16)
    lengths = np.linalg.norm(np.diff(ball.vertices[directed_edges(ball.faces)], axis=1), axis=2)
    assert lengths.max() / lengths.min() < 1.2


@given(
    name=st.sampled_from(["sphere", "torus", "cylinder", "waves"]),
    resolution=st.integers(6, 14),
    jitter=st.floats(0.0, MAX_JITTER, exclude_max=True),
    seed=st.integers(0, 2**32),
)
@example(name="torus", resolution=6, jitter=1e-20, seed=0)
@example(name="torus", resolution=6, jitter=2e-6, seed=0)
@settings(max_examples=40, deadline=None)
def test_every_size_and_jitter_gives_a_valid_mesh(name: str, resolution: int, jitter: float, seed: int) -> None:
    surface = CASES[name].make(resolution=resolution, jitter=jitter, seed=seed)
    assert_valid_mesh(surface.vertices, surface.faces, CASES[name].euler_characteristic, CASES[name].rims)
