"""Triangulations of the surfaces of unseen.py: all vertices lie on the surface."""

import contextlib
import os
from collections.abc import Callable, Iterator

import numpy as np
import pymeshlab
from scipy.spatial import cKDTree

from bezier_filters.surfaces import sampling
from stairs import mask_boundary
from unseen_surfaces import Chart, LevelSet, Sample

GRADING = 8.0
"""Largest distance of neighbours over the smallest one, of a mesh of uneven density."""
CANDIDATES = 25
"""Random points for each vertex of such a mesh."""
STRETCH = 3.0
Triangles = tuple[np.ndarray, np.ndarray]
"""Points (n, 3) of a level set or parameters (n, 2) of a chart, and faces."""


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Suppress what libraries print."""
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def face_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    corners = vertices[faces]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(0.5 * np.linalg.norm(sides, axis=1))


def cells(chart: Chart, count: int, stretch: float = 1.0) -> tuple[int, int]:
    """Numbers of cells along u and v, whose sides are as `stretch` to 1 on average; even ones."""
    middle = (np.indices((40, 40)).reshape(2, -1).T + 0.5) / 40.0 * chart.size
    _, tangents = chart.tangents(middle)
    lengths = np.linalg.norm(tangents, axis=1).mean(axis=0) * chart.size
    along = np.sqrt(count * lengths[0] / lengths[1] / stretch)
    return tuple(max(6, 2 * round(0.5 * n)) for n in (along, count / along))


def grid(chart: Chart, random: np.random.Generator, jitter: float = 0.0) -> Triangles:
    """A grid with parallel diagonals, or jittered points and their Delaunay triangulation."""
    shape = cells(chart, chart.count)
    points, faces = sampling.rectangle(shape, wrapped=chart.wrapped, jitter=jitter, seed=int(random.integers(1 << 31)))
    return points * chart.size / shape, faces


def stretched(chart: Chart, random: np.random.Generator) -> Triangles:
    """A grid of long cells whose diagonals alternate."""
    shape = cells(chart, chart.count, STRETCH if random.random() < 0.5 else 1.0 / STRETCH)
    points, faces = sampling.rectangle(shape, wrapped=chart.wrapped)
    corners = faces.reshape(-1, 6)[:, [0, 1, 2, 5]]
    odd = np.indices(shape).sum(axis=0).ravel() % 2 == 1
    corners[odd] = np.roll(corners[odd], 1, axis=1)
    return points * chart.size / shape, np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])


def scattered_on_star(surface: LevelSet, random: np.random.Generator, graded: bool = False) -> Triangles:
    """Random directions and their Delaunay triangulation on the sphere."""
    directions = random.standard_normal((surface.count * (CANDIDATES if graded else 1), 3))
    directions /= np.linalg.norm(directions, axis=1)[:, np.newaxis]
    points = on_rays(surface, directions)
    if graded:
        normals = surface.sample(points, np.empty((0, 3), dtype=np.int32)).normals
        areas = np.square(points).sum(axis=1) / np.einsum("ij,ij->i", normals, directions)
        chosen = thinned(points, areas * 4.0 * np.pi / len(points), surface.count, random.permutation(len(points)))
        points, directions = points[chosen], directions[chosen]
    return points, sampling._convex_hull(directions)


def scattered(chart: Chart, random: np.random.Generator, graded: bool = False) -> Triangles:
    """Random parameters and their Delaunay triangulation."""
    count = chart.count * (CANDIDATES if graded else 1)
    shape, coarse = np.array(cells(chart, count)), np.array(cells(chart, chart.count // CANDIDATES))
    lattice, _ = sampling.rectangle(tuple(shape), wrapped=chart.wrapped)
    border = lattice[(((lattice == 0.0) | (lattice == shape)) & ~np.array(chart.wrapped)).any(axis=1)]
    points = np.concatenate([border, random.random((count - len(border), 2)) * shape])
    if graded:
        at, tangents = chart.tangents(points * chart.size / shape)
        areas = np.linalg.norm(np.cross(tangents[:, :, 0], tangents[:, :, 1]), axis=1)
        order = np.append(random.permutation(len(border)), random.permutation(np.arange(len(border), count)))
        points = points[thinned(at, areas * np.prod(chart.size) / count, chart.count, order)]
    # in units of which no triangle has many
    periods = tuple(int(n) if is_wrapped else 0 for n, is_wrapped in zip(coarse, chart.wrapped, strict=True))
    return points * chart.size / shape, sampling._delaunay(points * coarse / shape, periods)


def thinned(points: np.ndarray, areas: np.ndarray, count: int, order: np.ndarray) -> np.ndarray:
    """Rows of about `count` points at distances that grow along an axis; each stands for an area, first come first."""
    axis = int(np.argmax(np.ptp(points, axis=0)))
    growth = GRADING ** ((points[:, axis] - points[:, axis].min()) / np.ptp(points[:, axis]))
    # in a set that no further point fits in, each has 0.6 squares of the distance
    distances = growth * np.sqrt(0.6 * (areas / growth**2).sum() / count)
    tree, is_free, chosen = cKDTree(points), np.ones(len(points), dtype=bool), []
    for row in order:
        if is_free[row]:
            chosen.append(row)
            is_free[tree.query_ball_point(points[row], distances[row])] = False
    return np.array(chosen)


def on_rays(surface: LevelSet, directions: np.ndarray) -> np.ndarray:
    """Points of a star in some directions, by bisection and Newton's method."""
    low, high = np.zeros(len(directions)), np.full(len(directions), 2.0 * max(surface.reach))
    for _ in range(50):
        middle = 0.5 * (low + high)
        is_inside = surface.value(middle[:, np.newaxis] * directions) < 0.0
        low, high = np.where(is_inside, middle, low), np.where(is_inside, high, middle)
    return middle[:, np.newaxis] * directions


def star(surface: LevelSet, random: np.random.Generator, jitter: float = 0.0) -> Triangles:
    """A divided icosahedron, regular or jittered, seen from the origin."""
    resolution = round(np.sqrt(0.1 * surface.count))
    directions, faces = sampling.sphere_directions(resolution, jitter=jitter, seed=int(random.integers(1 << 31)))
    return on_rays(surface, directions), faces


def contour(surface: LevelSet, count: int) -> Triangles:
    """Marching cubes of the exact field, moved onto the surface."""
    import pyvista

    spacing = 2.0 * max(surface.reach) / 40.0
    for _ in range(2):
        half = [int(np.ceil(r / spacing)) + 2 for r in surface.reach]
        axes = [spacing * (np.arange(-k, k + 1) + shift) for k, shift in zip(half, (0.13, 0.27, 0.41), strict=True)]
        values = surface.value(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
        image = pyvista.ImageData(dimensions=values.shape, spacing=(spacing,) * 3, origin=[axis[0] for axis in axes])
        found = image.contour([0.0], values.ravel(order="F"), method="flying_edges")
        spacing *= np.sqrt(found.n_points / count)
    points = np.asarray(found.points, dtype=np.float64)
    return surface.on_surface(points), found.faces.reshape(-1, 4)[:, 1:].astype(np.int32)


def voxels(surface: LevelSet, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, off the surface, and faces of the boundary of its voxels, and the rotation from them to the surface."""
    points, faces = contour(surface, 2000)
    spacing = np.sqrt(face_areas(points, faces).sum() * 1.5 / surface.count)
    rotation = np.linalg.qr(random.standard_normal((3, 3)))[0]
    rotation[0] *= np.linalg.det(rotation)
    half = [int(np.ceil(np.linalg.norm(surface.reach) / spacing)) + 2] * 3
    vertices, faces = mask_boundary(lambda x: surface.value(x * spacing @ rotation) <= 0.0, half)
    return vertices * spacing, faces, rotation


def dense(surface: Chart | LevelSet, factor: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a fine mesh that others are made from."""
    if isinstance(surface, LevelSet):
        return contour(surface, int(factor * surface.count))
    shape = cells(surface, int(factor * surface.count))
    points, faces = sampling.rectangle(shape, wrapped=surface.wrapped)
    return surface.points(points * surface.size / shape), faces


def remeshed(surface: Chart | LevelSet, random: np.random.Generator, method: str) -> Triangles:
    """By MeshLab's isotropic remeshing or edge collapses of a fine mesh, and with jitter."""
    meshset = pymeshlab.MeshSet()
    vertices, faces = dense(surface)
    meshset.add_mesh(pymeshlab.Mesh(vertices, faces))
    with quiet():
        if method == "collapsed":
            meshset.meshing_decimation_quadric_edge_collapse(targetfacenum=2 * surface.count)
        else:
            edge = np.sqrt(face_areas(vertices, faces).sum() / surface.count * 2.0 / np.sqrt(3.0))
            meshset.meshing_isotropic_explicit_remeshing(iterations=6, targetlen=pymeshlab.PureValue(edge))
        meshset.meshing_remove_unreferenced_vertices()
    mesh = meshset.current_mesh()
    points, faces = mesh.vertex_matrix(), mesh.face_matrix().astype(np.int32)
    if method == "jittered":
        points = points + 0.25 * edge * random.uniform(-1.0, 1.0, points.shape)
    return surface.on_surface(points) if isinstance(surface, LevelSet) else surface.nearest(points), faces


OF_LEVEL_SETS: dict[str, Callable[[LevelSet, np.random.Generator], Triangles]] = {
    "contour": lambda surface, random: contour(surface, surface.count),
    "isotropic": lambda surface, random: remeshed(surface, random, "isotropic"),
    "collapsed": lambda surface, random: remeshed(surface, random, "collapsed"),
}
OF_STARS: dict[str, Callable[[LevelSet, np.random.Generator], Triangles]] = {
    "jittered": lambda surface, random: star(surface, random, 0.3),
    "grid": star,
    "random": scattered_on_star,
    "graded": lambda surface, random: scattered_on_star(surface, random, graded=True),
}
OF_CHARTS: dict[str, Callable[[Chart, np.random.Generator], Triangles]] = {
    "jittered": lambda chart, random: grid(chart, random, 0.3),
    "grid": grid,
    "random": scattered,
    "graded": lambda chart, random: scattered(chart, random, graded=True),
    "stretched": stretched,
    "isotropic": OF_LEVEL_SETS["isotropic"],
    "collapsed": OF_LEVEL_SETS["collapsed"],
}
JITTERED = {"jittered": lambda surface, random: remeshed(surface, random, "jittered")}


def triangulations(surface: Chart | LevelSet) -> dict[str, Callable[..., Triangles]]:
    """Triangulations of a kind of surface, by name."""
    if isinstance(surface, Chart):
        return OF_CHARTS
    return OF_LEVEL_SETS | (OF_STARS if surface.is_star else JITTERED)


def sample(surface: Chart | LevelSet, triangulation: str, random: np.random.Generator) -> Sample:
    """A mesh of the surface whose faces are turned like the normals."""
    points, faces = triangulations(surface)[triangulation](surface, random)
    used, place = np.unique(faces, return_inverse=True)
    found = surface.sample(points[used], place.reshape(-1, 3).astype(np.int32))
    corners = found.vertices[found.faces]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    agrees = np.einsum("ij,ij->", sides, found.normals[found.faces].mean(axis=1)) > 0.0
    return found if agrees else found._replace(faces=found.faces[:, ::-1].copy())
