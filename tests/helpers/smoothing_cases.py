"""Noisy meshes with a known surface, and how far a result is from it."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from bezier_filters.arrays import BoolArray, FloatArray, IntArray
from bezier_filters.meshes.mesh import TriangleMesh, triangle_mesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.runtime.parallel import MIN_CHUNK
from bezier_filters.sampling import mesh_parts
from bezier_filters.sampling.mesh_parts import MAX_WHOLE_VERTICES, PART_CORE_VERTICES, PART_VERTICES, MeshPart
from bezier_filters.smoothing import denoise
from bezier_filters.surfaces import SampledSurface, block_with_sharp_edges, bumpy_star


def edge_of(vertices: FloatArray, faces: IntArray) -> float:
    """The mean edge length."""
    return prepare_mesh(triangle_mesh(vertices, faces)).mean_edge


def face_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Unit normals of the faces, (m, 3)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals: FloatArray = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def normals_of_faces(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Unit normals of the vertices, (n, 3): means of those of their faces."""
    directions, normals = face_normals(vertices, faces), np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], directions)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def mean_angle(vertices: FloatArray, truth: FloatArray, faces: IntArray) -> float:
    """Between the normals of the faces, degrees."""
    cosine = np.einsum("ij,ij->i", face_normals(vertices, faces), face_normals(truth, faces))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).mean())


def height_error(surface: SampledSurface, vertices: FloatArray) -> float:
    """Root mean square of the distance along the normals."""
    heights = np.einsum("ij,ij->i", vertices - surface.vertices, surface.normals)
    return float(np.sqrt(np.square(heights).mean()))


def with_noise(vertices: FloatArray, faces: IntArray, normals: FloatArray, level: float, seed: int = 0) -> FloatArray:
    """The vertices with white noise of `level` mean edges along the normals."""
    heights = np.random.default_rng(seed).standard_normal(len(vertices)) * level * edge_of(vertices, faces)
    return vertices + normals * heights[:, np.newaxis]


def noisy_block(resolution: int) -> tuple[FloatArray, FloatArray, IntArray]:
    """Clean and noisy vertices and faces of a block with sharp edges."""
    vertices, faces = block_with_sharp_edges(resolution=resolution, jitter=0.2)
    return vertices, with_noise(vertices, faces, normals_of_faces(vertices, faces), 0.2), faces


def part_around(mesh: PreparedMesh, inner: BoolArray, rings: int) -> MeshPart:
    """The part of a mesh with some vertices and rings around them, in another order."""
    rows, taken = mesh.adjacency.vertices, inner.copy()
    for _ in range(rings):
        taken[rows.indices[np.repeat(taken, rows.lengths)]] = True
    ids = np.random.default_rng(0).permutation(np.flatnonzero(taken)).astype(np.int32)
    number = np.full(len(taken), -1, dtype=np.int32)
    number[ids] = np.arange(len(ids), dtype=np.int32)
    part = prepare_mesh(TriangleMesh(mesh.vertices[ids], number[mesh.faces[taken[mesh.faces].all(axis=1)]]))
    cut = part.adjacency.faces.lengths != mesh.adjacency.faces.lengths_of(ids)
    return MeshPart(part, ids, cut, inner[ids], mesh.vertex_count)


@contextmanager
def large_star(share: int) -> Iterator[SampledSurface]:
    """A surface with more vertices than are looked at as a whole, or a share of that, and parts as much smaller."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mesh_parts, "PART_VERTICES", PART_VERTICES // share)
        patch.setattr(mesh_parts, "PART_CORE_VERTICES", PART_CORE_VERTICES // share)
        for module in (mesh_parts, denoise):
            patch.setattr(module, "MAX_WHOLE_VERTICES", MAX_WHOLE_VERTICES // share)
        surface = bumpy_star(resolution=80 if share == 1 else 42, jitter=0.2)
        assert len(surface.vertices) > max(MAX_WHOLE_VERTICES // share, 2 * MIN_CHUNK)
        yield surface
