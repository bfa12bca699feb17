"""How far vertices slide along the surface while noise is taken off it.

What filters take off along the surface moves textures, colours and marks with the vertices, and is mostly the
unevenness of the triangles, not noise. So vertices move along the normals of the result; at its edges and corners,
along those of all faces there. Noise in all directions makes triangles so narrow that normals suffer, or turns them
over: where there may be such noise, the vertices of narrow faces slide, too, and all of them if such faces are many.
Faces that would turn over otherwise let their vertices slide in any case.
"""

from enum import IntEnum

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray, IntArray, SingleArray
from bezier_filters.meshes.adjacency import Adjacency, from_middles, longest_edges
from bezier_filters.meshes.frames import face_normal, tangent_planes
from bezier_filters.meshes.mesh import TriangleMesh
from bezier_filters.meshes.triangles import longest_squared
from bezier_filters.runtime.jit import jit
from bezier_filters.runtime.parallel import run_kernel
from bezier_filters.smoothing.laplacian import MeshStars, mesh_stars
from bezier_filters.smoothing.mesh_parts import MeshPart

STEPS = 8  # each leaves of a move what is not along a normal: an edge at a right angle takes a half off in each
# times the noise along the normal: unevenness of the triangles below which that is not in all directions
UNEVEN = 0.8
# height of a face over its longest edge from which down it is narrow, if filters would make it wider by a factor
NARROW, WIDER = 0.05, 2.0
SLIDING_STEPS = 4  # in which the vertices of narrow faces slide ever farther, up to where filters take them
REACH = SLIDING_STEPS + 2  # rings around a vertex that decide how far it slides
FARTHEST = 2.0  # times the longest edge at a vertex: what would go farther has not been estimated but flung
MANY = 0.05  # share of the vertices at narrow faces beyond which there is noise in all directions everywhere


class Sliding(IntEnum):
    """Which vertices slide."""

    TURNED = 0  # those of faces that would turn over otherwise
    NARROW = 1  # those of faces that would be narrow otherwise
    ALL = 2


def sliding_of(part: MeshPart, points: FloatArray, sigma: FloatArray) -> Sliding:
    """Which vertices of a mesh have to slide on their way to points, as the core of a part tells.

    `sigma` (n,) is the standard deviation of the noise along the normal, lengths.
    """
    mesh, adjacency, core = part.mesh, part.adjacency, part.core
    held = _along_normals(mesh, adjacency, points)
    uneven = _unevenness(TriangleMesh(points, mesh.faces), adjacency, held)[core]
    if not np.square(uneven).mean() > np.square(UNEVEN * sigma[core]).mean():
        return Sliding.TURNED
    slides = _slides(mesh, points, held, NARROW)[core] > 0.0
    return Sliding.ALL if slides.mean() > MANY else Sliding.NARROW


def held_back(mesh: TriangleMesh, adjacency: Adjacency, points: FloatArray, sliding: Sliding) -> FloatArray:
    """Where vertices that would move to points (n, 3) end if not all of them slide. Those at borders do.

    None goes farther than a multiple of its longest edge.
    """
    if sliding == Sliding.ALL:
        result = points.copy()
    else:
        held = _along_normals(mesh, adjacency, points)
        slides = _slides(mesh, points, held, NARROW if sliding == Sliding.NARROW else 0.0)
        result = _slid(held, points, slides)
    moves, most = result - mesh.vertices, FARTHEST * longest_edges(mesh, adjacency)
    lengths = np.linalg.norm(moves, axis=1)
    too_far = lengths > most
    shortened = (most[too_far] / lengths[too_far])[:, np.newaxis] * moves[too_far]
    result[too_far] = mesh.vertices[too_far] + shortened
    return result


def _along_normals(mesh: TriangleMesh, adjacency: Adjacency, points: FloatArray) -> FloatArray:
    held, stars = points.copy(), mesh_stars(mesh, adjacency)
    run_kernel(_hold_back, len(points), stars, adjacency.on_boundary, points, held)
    return held


def _unevenness(smooth: TriangleMesh, adjacency: Adjacency, points: FloatArray) -> FloatArray:
    """How far points are from the middle of their neighbours along a surface, per direction, lengths (n,)."""
    away, normals = from_middles(adjacency.vertices, points), tangent_planes(smooth, adjacency).normals
    away -= np.einsum("ij,ij->i", away, normals)[:, np.newaxis] * normals
    away[adjacency.on_boundary] = 0.0
    result: FloatArray = np.linalg.norm(away, axis=1) / np.sqrt(2.0)
    return result


def _slides(mesh: TriangleMesh, points: FloatArray, held: FloatArray, least: float) -> SingleArray:
    """How far vertices slide, (n,), from where they are held, 0, to the points, 1, lest faces be narrower than that."""
    slides = np.zeros(len(points), dtype=np.float32)
    for _ in range(SLIDING_STEPS):
        more, current = slides.copy(), _slid(held, points, slides)
        farther = slides + np.float32(1.0 / SLIDING_STEPS)
        run_kernel(_mark_narrow, mesh.face_count, mesh.faces, points, current, least, farther, more)
        if (more == slides).all():
            break
        slides = more
    return slides


def _slid(held: FloatArray, points: FloatArray, slides: SingleArray) -> FloatArray:
    return held + slides[:, np.newaxis] * (points - held)


@jit()
def _hold_back(
    mesh: MeshStars, on_boundary: BoolArray, points: FloatArray, held: FloatArray, start: int, stop: int
) -> None:
    """Take off the moves of vertices start .. stop-1 what is along the surface: normals span what stays."""
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
        for _ in range(STEPS):
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
    """Let the vertices of those of the faces start .. stop-1 slide farther that are narrow, and less so at points."""
    for f in range(start, stop):
        x, y, z = face_normal(points, faces, f)
        length = np.sqrt(x * x + y * y + z * z)
        u, v, w = face_normal(held, faces, f)
        there, here = longest_squared(points, faces, f), longest_squared(held, faces, f)
        wide = length / there if there > 0.0 else 0.0
        height = (u * x + v * y + w * z) / (length * here) if length * here > 0.0 else 0.0
        if height < least and WIDER * height < wide:
            for corner in range(3):
                slides[faces[f, corner]] = farther[faces[f, corner]]
