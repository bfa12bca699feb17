"""Tangential motion: which vertices slide along the surface when noise is removed.

The tangential part of a filter's moves shifts textures, colours and marks, and is mostly due to irregular triangles,
not to noise. So vertices move along the normals of the result; at edges and corners, along the normals of all faces
there. Noise in all directions makes triangles so narrow that normals become inaccurate, or flips them. Where there may
be such noise, the vertices of narrow faces slide, too, and all vertices if there are many such faces. Vertices of faces
that would flip otherwise slide in any case.
"""

from enum import IntEnum

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.meshes.adjacency import umbrella_vectors
from bezier_filters.meshes.frames import face_normal
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.triangles import longest_squared
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import run_kernel
from bezier_filters.sampling.mesh_parts import MeshPart
from bezier_filters.smoothing.laplacian import MeshStars, mesh_stars

PROJECTION_STEPS = 8  # iterations of the projection on the normals of a vertex; at a right angle each halves the rest
# tangential unevenness of the triangles over the noise along the normal, from which on noise may be in all directions
MIN_UNEVENNESS_RATIO = 0.8
# height of a narrow face over its longest edge, and the widening by the filter that makes it worth sliding
NARROW_HEIGHT_RATIO, MIN_WIDENING = 0.05, 2.0
SLIDING_STEPS = 4  # steps in which the vertices of narrow faces slide, up to the unrestricted result
SLIDING_RINGS = SLIDING_STEPS + 2  # rings around a vertex that decide how far it slides
MAX_SLIDING_FRACTION = 0.05  # fraction of vertices at narrow faces above which all vertices slide


class TangentialMotion(IntEnum):
    """Which vertices slide."""

    NONE = -1  # of a point cloud
    FLIPPED = 0  # vertices of faces that would flip otherwise
    NARROW = 1  # vertices of faces that would be narrow otherwise, too
    ALL = 2


def choose_sliding(part: MeshPart, points: FloatArray, sigma: FloatArray) -> TangentialMotion:
    """Choose which vertices of a mesh slide on their way to points, from the core of a part.

    `sigma` (n,) is the standard deviation of the noise along the normal, lengths.
    """
    mesh, core = part.mesh, part.core
    held = _project_on_normals(mesh, points)
    uneven = _unevenness(mesh.move(points), held)[core]
    if not np.square(uneven).mean() > np.square(MIN_UNEVENNESS_RATIO * sigma[core]).mean():
        return TangentialMotion.FLIPPED
    slides = _sliding_fractions(mesh, points, held, NARROW_HEIGHT_RATIO)[core] > 0.0
    return TangentialMotion.ALL if slides.mean() > MAX_SLIDING_FRACTION else TangentialMotion.NARROW


def restrict_to_normals(mesh: PreparedMesh, points: FloatArray, sliding: TangentialMotion) -> FloatArray:
    """Restrict the moves of vertices to points (n, 3) to the normals, except for sliding vertices; return the points.

    Border vertices always slide.
    """
    if sliding == TangentialMotion.ALL:
        return points.copy()
    held = _project_on_normals(mesh, points)
    if sliding == TangentialMotion.NONE:
        return held
    slides = _sliding_fractions(mesh, points, held, NARROW_HEIGHT_RATIO if sliding == TangentialMotion.NARROW else 0.0)
    return _slide(held, points, slides)


def _project_on_normals(mesh: PreparedMesh, points: FloatArray) -> FloatArray:
    held, stars = points.copy(), mesh_stars(mesh)
    run_kernel(_project_moves, len(points), stars, mesh.adjacency.on_boundary, points, held)
    return held


def _unevenness(smooth: PreparedMesh, points: FloatArray) -> FloatArray:
    """Tangential distances of points from the mean of their neighbours, per direction, lengths (n,)."""
    away, normals = umbrella_vectors(smooth.adjacency.vertices, points), smooth.planes.normals
    away -= np.einsum("ij,ij->i", away, normals)[:, np.newaxis] * normals
    away[smooth.adjacency.on_boundary] = 0.0
    result: FloatArray = np.linalg.norm(away, axis=1) / np.sqrt(2.0)
    return result


def _sliding_fractions(mesh: TriangleMesh, points: FloatArray, held: FloatArray, least: float) -> SingleArray:
    """Fractions (n,) by which vertices slide, from the held positions, 0, to the points, 1, to avoid narrow faces."""
    slides = np.zeros(len(points), dtype=np.float32)
    for _ in range(SLIDING_STEPS):
        more, current = slides.copy(), _slide(held, points, slides)
        farther = slides + np.float32(1.0 / SLIDING_STEPS)
        run_kernel(_mark_narrow, mesh.face_count, mesh.faces, points, current, least, farther, more)
        if (more == slides).all():
            break
        slides = more
    return slides


def _slide(held: FloatArray, points: FloatArray, slides: SingleArray) -> FloatArray:
    return held + slides[:, np.newaxis] * (points - held)


@jit()
def _project_moves(
    mesh: MeshStars, on_boundary: BoolArray, points: FloatArray, held: FloatArray, start: int, stop: int
) -> None:
    """Project the moves of vertices start .. stop-1 on the span of the normals of their faces."""
    vertices = mesh.vertices
    for i in range(start, stop):
        if on_boundary[i]:
            continue
        xx = xy = xz = yy = yz = zz = 0.0
        for q in range(mesh.face_ptr[i], mesh.face_ptr[i + 1]):
            x, y, z = face_normal(points, mesh.faces, mesh.face_indices[q])
            length = np.sqrt(x * x + y * y + z * z)
            if length > 0.0:
                xx, xy, xz = xx + x * x / length, xy + x * y / length, xz + x * z / length
                yy, yz, zz = yy + y * y / length, yz + y * z / length, zz + z * z / length
        total = xx + yy + zz
        if total == 0.0:
            continue
        x, y, z = (points[i, 0] - vertices[i, 0], points[i, 1] - vertices[i, 1], points[i, 2] - vertices[i, 2])
        for _ in range(PROJECTION_STEPS):
            x, y, z = (
                x - (xx * x + xy * y + xz * z) / total,
                y - (xy * x + yy * y + yz * z) / total,
                z - (xz * x + yz * y + zz * z) / total,
            )
        held[i, 0], held[i, 1], held[i, 2] = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z


@jit()
def _mark_narrow(
    faces: IntArray,
    points: FloatArray,
    held: FloatArray,
    least: float,
    farther: SingleArray,
    slides: SingleArray,
    start: int,
    stop: int,
) -> None:
    """Let the vertices of the narrow ones among faces start .. stop-1 slide farther, if the points make them wider."""
    for f in range(start, stop):
        x, y, z = face_normal(points, faces, f)
        length = np.sqrt(x * x + y * y + z * z)
        u, v, w = face_normal(held, faces, f)
        there, here = longest_squared(points, faces, f), longest_squared(held, faces, f)
        wide = length / there if there > 0.0 else 0.0
        height = (u * x + v * y + w * z) / (length * here) if length * here > 0.0 else 0.0
        if height < least and MIN_WIDENING * height < wide:
            for corner in range(3):
                slides[faces[f, corner]] = farther[faces[f, corner]]
