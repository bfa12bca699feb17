"""Fit the surface of the patches of a mesh."""

from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arguments import real_array
from bezier_filters.arrays import FloatArray, IntArray, unique_rows
from bezier_filters.errors import InvalidMeshError
from bezier_filters.estimation.estimate import estimate_patches, estimate_vertex_geometry
from bezier_filters.feature_lines.crease_lines import find_sharp_edges
from bezier_filters.fitting.cloud_triangulation import cloud_surface
from bezier_filters.fitting.noise_level import is_noisy
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.meshes.half_edges import distinct_edges
from bezier_filters.meshes.mesh import TriangleMesh, surface_or_points, takes_meshes, triangle_mesh
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.unit_size import size_exponent
from bezier_filters.patch_surface.cut_mesh import cut_mesh
from bezier_filters.patch_surface.surface import Surface, SurfacePoints
from bezier_filters.runtime.parallel import Progress, runs_on_threads
from bezier_filters.surface_model.fit_options import FitOptions, check_noise

# Correlation of residuals at neighbours above which they are no noise. White noise leaves -0.3 to 0; without noise,
# tori, ellipsoids and stars of 500 to 20,000 vertices have 0.13 to 0.91.
MIN_SHARED_RESIDUAL = 0.1


@takes_meshes
@runs_on_threads
def fit_surface(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    *,
    noise: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Surface:
    """Fit patches to all vertices of a mesh and join them to a surface that can be asked anywhere.

    The patches are those of `estimate_vertex_geometry` with automatic choices. Over each face those of its corners are
    blended so that the surface is tangent-continuous, touches the patch of every vertex there and has its curvature;
    see `bezier_filters.patch_surface.blending`. Sharp edges stay sharp: the mesh is cut along them, and each side has
    patches of its own, which meet to within their errors. The surface ends over the border of the mesh.

    Without noise the surface passes through the vertices. Coarse meshes without noise leave residuals that look like a
    little of it, but neighbours share them; where no edge is sharp, the patches are then fitted without noise.

    A point cloud gets triangles between its points, see `bezier_filters.fitting.cloud_triangulation`: they are the
    faces of the result.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int, optional
        Triangles, counter-clockwise seen from outside; None or empty for a point cloud.
    noise : float, optional
        Standard deviation of the noise along the normal, a length, if it is known; 0 for none. By default it is
        estimated.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` as in `estimate_vertex_geometry`.

    Returns
    -------
    Surface

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh, or no cloud of a surface, with finite coordinates, or faces are doubled.
    InvalidParameterError
        If a parameter is out of range.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(radius=2.0)
    >>> surface = fit_surface(ball.vertices, ball.faces)
    >>> found = surface.query([[3.0, 1.0, 0.0], [0.0, 0.0, 1.5]])
    >>> found.distances.round(3), found.mean_curvature.round(3)
    (array([ 1.162, -0.5  ]), array([0.5, 0.5]))
    """
    exponent = size_exponent(cast("ArrayLike", vertices))  # arrays, see `takes_meshes`
    shape = surface_or_points(np.ldexp(real_array(vertices), -exponent) if exponent else vertices, faces)
    check_noise(noise)
    mesh = prepare_mesh(shape) if shape.face_count else cloud_surface(shape)
    if not mesh.face_count:
        raise InvalidMeshError("vertices: the points of the cloud are too few, or on a line, for a surface")
    refuse_duplicates(mesh)
    options = FitOptions(noise=None if noise is None else float(np.ldexp(noise, -exponent)))
    geometry = estimate_vertex_geometry(mesh.vertices, mesh.faces, noise=options.noise, progress=progress)
    edges, is_sharp, _ = find_sharp_edges(mesh, geometry)
    if noise is None and not is_sharp.any() and _has_shared_residuals(mesh, geometry):
        options = FitOptions(noise=0.0)  # at sharp edges, points on one side alone would be interpolated wildly
    is_cut = is_sharp | (np.bincount(edges.of_faces[edges.of_faces >= 0], minlength=len(is_sharp)) > 2)
    cut = cut_mesh(mesh.vertices, mesh.faces, edges.vertices[is_cut])
    patches = estimate_patches(triangle_mesh(cut.vertices, cut.faces), options, progress)
    if not shape.face_count:  # noise folds the triangles of a cloud; those on the patches lie along the surface
        cut = replace(cut, vertices=cut.vertices + patches.displacements)
    return Surface(TriangleMesh(mesh.vertices, mesh.faces), cut, patches, exponent)


def refit_surface(
    surface: Surface, vertices: FloatArray, *, noise: float | None = None, progress: Progress | None = None
) -> Surface:
    """Fit patches to moved vertices (n, 3) of the mesh of a surface, cut along the sharp edges already found."""
    moved = np.ldexp(vertices, -surface.exponent)
    cut = replace(surface.cut, vertices=moved[surface.cut.origin])
    options = FitOptions(noise=None if noise is None else float(np.ldexp(noise, -surface.exponent)))
    patches = estimate_patches(triangle_mesh(cut.vertices, cut.faces), options, progress)
    return Surface(TriangleMesh(moved, surface.mesh.faces), cut, patches, surface.exponent)


@takes_meshes
def surface_at(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None,
    points: ArrayLike,
    *,
    noise: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SurfacePoints:
    """Find the places of the fitted surface of a mesh nearest to points, with its differential geometry there.

    For several calls on one mesh, make the surface once with `fit_surface`.

    Parameters
    ----------
    vertices, faces, noise, threads, progress
        As in `fit_surface`.
    points : (q, 3) array_like of float
        Points anywhere. The nearest place is found from the nearest place on the faces, so that far from the surface,
        beyond its centres of curvature, it may be a local one.

    Returns
    -------
    SurfacePoints

    Raises
    ------
    InvalidMeshError, InvalidParameterError, CancelledError
        As `fit_surface`; also if the points are not finite numbers of shape (q, 3).

    Examples
    --------
    >>> from bezier_filters.surfaces import cylinder
    >>> tube = cylinder(radius=2.0)
    >>> found = surface_at(tube.vertices, tube.faces, [[2.5, 0.5, 0.0]])
    >>> bool(abs(found.distances[0] - (np.hypot(2.5, 0.5) - 2.0)) < 1e-3), bool(abs(found.k_max[0] - 0.5) < 0.01)
    (True, True)
    """
    return fit_surface(vertices, faces, noise=noise, threads=threads, progress=progress).query(points, threads=threads)


def refuse_duplicates(mesh: PreparedMesh) -> None:
    """Refuse faces on the same vertices: their edges have three faces, which would cut the surface all around them."""
    count = mesh.face_count - len(unique_rows(np.sort(mesh.faces, axis=1))[0])
    if count:
        raise InvalidMeshError(
            f"faces: {count:,} lie on others with the same three vertices, in either orientation; remove them, as "
            "meshing_remove_duplicate_faces of pymeshlab does"
        )


@takes_meshes
def project(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    points: ArrayLike | None = None,
    *,
    noise: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SurfacePoints:
    """Project the points of a cloud or the vertices of a mesh, or other points, onto the surface of its patches.

    It is `surface_at` with the vertices as points by default.

    Parameters
    ----------
    vertices, faces, noise, threads, progress
        As in `fit_surface`.
    points : (q, 3) array_like of float, optional
        Points to project; the vertices by default.

    Returns
    -------
    SurfacePoints
        Its `points` are the projections, `distances` how far the points were from them, a length with a sign.

    Raises
    ------
    InvalidMeshError, InvalidParameterError, CancelledError
        As `surface_at`.

    Examples
    --------
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(radius=2.0)
    >>> found = project(ball.vertices, None, [[3.0, 1.0, 0.0]])
    >>> found.distances.round(3), np.linalg.norm(found.points, axis=1).round(3)
    (array([1.162]), array([2.]))
    """
    surface = fit_surface(vertices, faces, noise=noise, threads=threads, progress=progress)
    return surface.query(cast("ArrayLike", vertices) if points is None else points, threads=threads)


def _has_shared_residuals(mesh: PreparedMesh, geometry: VertexGeometry) -> bool:
    """Whether the little noise that was found is the error of the patches: their residuals at neighbours agree."""
    sigma = geometry.noise_sigma
    if not sigma or geometry.fit.noise_length or is_noisy(mesh, sigma):
        return False
    products, squares = residual_products(geometry, distinct_edges(mesh.faces, mesh.vertex_count)[0])
    return products > MIN_SHARED_RESIDUAL * squares


def residual_products(geometry: VertexGeometry, edges: IntArray) -> tuple[float, float]:
    """Sums over edges (e, 2) of the product of the residuals at their ends, and of the mean of their squares."""
    residuals = np.einsum("ij,ij->i", geometry.displacements, geometry.normals)
    ends = residuals[edges]
    return float((ends[:, 0] * ends[:, 1]).sum()), 0.5 * float(np.square(ends).sum())
