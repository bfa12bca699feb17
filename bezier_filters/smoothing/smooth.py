"""Smoothing of meshes: the public function `smooth` and its result."""

from dataclasses import dataclass, field
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.display import noise_in_words, noise_level
from bezier_filters.errors import InvalidParameterError, is_integer
from bezier_filters.field_arrays import result_arrays, split_vectors
from bezier_filters.fields import AXES, SMOOTH
from bezier_filters.fitting.cloud_triangulation import cloud_surface
from bezier_filters.fitting.fallbacks import fit_patches
from bezier_filters.fitting.first_call import first_call
from bezier_filters.fitting.noise_level import explain_unknown_noise, learn_mesh_noise
from bezier_filters.meshes.half_edges import non_manifold_edge_vertices
from bezier_filters.meshes.mesh import check_normals, check_selection, surface_or_points, takes_meshes
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.prepared_mesh import PreparedMesh, longest_edges, prepare_mesh
from bezier_filters.meshes.spatial_order import ensure_locality
from bezier_filters.meshes.unit_size import LENGTH, VOLUME, normalizes_size
from bezier_filters.patches.patch_fit import PatchFit
from bezier_filters.result_tables import Table, TabularResult
from bezier_filters.runtime.parallel import Progress, runs_on_threads
from bezier_filters.smoothing.denoise import SmoothingOptions
from bezier_filters.smoothing.flipped_faces import bad_faces, repair_flipped_faces
from bezier_filters.smoothing.intersections import reduce_intersections
from bezier_filters.smoothing.move_limits import MAX_MOVE_SIGMAS
from bezier_filters.smoothing.rounds import denoise_mesh, join_errors
from bezier_filters.smoothing.volume import (
    ClosedComponents,
    component_volumes,
    local_movement,
    omit_outliers,
    restore_volumes,
    volume_not_restored,
)
from bezier_filters.surface_model.fit_options import FitOptions, check_detail, check_noise

SmoothingMethod = Literal["auto", "paper"]
SmoothedBorders = Literal["curve", "fixed"]
ROUNDING = 1e-9  # relative rounding of a move


class _ChangeMeasures:
    """What follows from displacements and volumes; fields of a `SmoothingResult` of these names."""

    displacement: FloatArray
    volume_before: float | None
    volume_after: float | None

    @property
    def volume_ratio(self) -> float | None:
        """Volume after over volume before; None if there is none to compare with."""
        if not self.volume_before or self.volume_after is None:
            return None
        return self.volume_after / self.volume_before

    @property
    def mean_displacement(self) -> float:
        """Mean distance that a vertex moved, a length."""
        return float(self.displacement.mean()) if len(self.displacement) else 0.0

    @property
    def rms_displacement(self) -> float:
        """Root mean square of the same."""
        return float(np.sqrt(np.square(self.displacement).mean())) if len(self.displacement) else 0.0

    @property
    def max_displacement(self) -> float:
        """Largest distance that a vertex moved, a length."""
        return float(self.displacement.max(initial=0.0))


@dataclass(frozen=True, repr=False)
class SmoothingResult(_ChangeMeasures, TabularResult):
    """A smoothed mesh, with measures of the change.

    Attributes
    ----------
    vertices : (n, 3) float64
        The new coordinates; the faces are the same.
    displacement : (n,) float64
        Distance that each vertex moved, a length.
    vertex_noise : (n,) float64
        Standard deviation of the noise at each vertex, a length: noise removal moves none farther than five times
        this, except `outliers`; volumes are restored after that. 0 where noise cannot be distinguished from shape, and
        with ``method="paper"``.
    outliers : (n,) bool
        Single vertices far from the surface around them, which moved onto it.
    sharpness : (n,) float64
        From 0, where a smooth estimate of the surface was used, to 1, where the sharpest one was used; 0 with
        ``method="paper"``.
    noise_before, noise_after : float or None
        Standard deviation of the noise along the normal, a length; None if it could not be learned. After, it is the
        root mean square of the error that the smoothed vertices have left along the normal, as expected by Stein's
        risk estimate: the noise that is averaged less than fully, and the shape that is lost. With ``method="paper"``
        it is that of the noise in the result, of ranges up to those before: smoother noise is like detail.
    noise_length : float or None
        Distance over which the noise before is correlated; 0 if it is independent from vertex to vertex.
    noise_heavy : bool
        Whether the noise before is so strong, as noise in all directions is, that single normals are useless.
    noise_reason : str
        Why the noise before could not be learned; empty if it was.
    iterations : int
        Number of iterations: as requested, or until nothing changed.
    mean_edge : float
        Mean length of the edges before.
    volume_before, volume_after : float or None
        Total volume of the closed components, length^3, before without outliers; None if there are none.
    flipped_before, flipped_after : int
        Faces more than 90 degrees away from the mean normal around them.
    degenerate_before, degenerate_after : int
        Faces without area.
    new_bad_faces : int
        Faces that are flipped or degenerate, and were not before; 0 unless four times as many were repaired.
    new_intersecting_faces : int
        Faces that intersect others, where no face at their corners did before; 0 unless smaller moves, which are tried,
        do not help. Not counted with ``method="paper"``.
    volume_ratio : float or None
        Derived: volume after over volume before.
    mean_displacement, rms_displacement, max_displacement : float
        Derived from `displacement`, lengths.
    """

    vertices: FloatArray = field(metadata=LENGTH)
    displacement: FloatArray = field(metadata=LENGTH)
    vertex_noise: FloatArray = field(metadata=LENGTH)
    outliers: BoolArray
    sharpness: FloatArray
    noise_before: float | None = field(metadata=LENGTH)
    noise_after: float | None = field(metadata=LENGTH)
    noise_length: float | None = field(metadata=LENGTH)
    noise_heavy: bool
    noise_reason: str
    iterations: int
    mean_edge: float = field(metadata=LENGTH)
    volume_before: float | None = field(metadata=VOLUME)
    volume_after: float | None = field(metadata=VOLUME)
    flipped_before: int
    flipped_after: int
    degenerate_before: int
    degenerate_after: int
    new_bad_faces: int
    new_intersecting_faces: int
    volume_ratio: float | None = field(init=False)
    mean_displacement: float = field(init=False, metadata=LENGTH)
    rms_displacement: float = field(init=False, metadata=LENGTH)
    max_displacement: float = field(init=False, metadata=LENGTH)

    @property
    def noise(self) -> str:
        """The noise before, in words."""
        return noise_in_words(
            self.noise_before, self.noise_length, self.noise_heavy, self.mean_edge, reason=self.noise_reason
        )

    def __repr__(self) -> str:
        """One line with the noise and the volume, without the arrays."""
        return (
            f"SmoothingResult({len(self.vertices)} vertices: {self.noise}; "
            f"{noise_level(self.noise_after, self.mean_edge)} after; volume ratio {self.volume_ratio}, "
            f"{self.new_bad_faces} new bad faces)"
        )

    def _tables(self) -> list[Table]:
        rows: list[list[object]] = [
            ["noise", "length", self.noise_before, self.noise_after],
            ["volume", "length³", self.volume_before, self.volume_after],
            ["flipped faces", "", self.flipped_before, self.flipped_after],
            ["degenerate faces", "", self.degenerate_before, self.degenerate_after],
        ]
        moved = [["displacement", "length", self.mean_displacement, self.rms_displacement, self.max_displacement]]
        title = f"Smoothing of {len(self.vertices):,} vertices: {self.noise}"
        return [
            Table(title, ["", "unit", "before", "after"], rows),
            Table("Vertices moved by", ["", "unit", "mean", "rms", "max"], moved),
        ]

    def _columns(self) -> dict[str, NDArray[Any]]:
        positions = dict(zip(AXES, self.vertices.T, strict=True))
        more = {"vertex_noise": self.vertex_noise, "outliers": self.outliers}
        return positions | split_vectors(result_arrays(self, SMOOTH)) | more


@takes_meshes
@normalizes_size("noise", "detail")
@runs_on_threads
def smooth(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    method: SmoothingMethod = "auto",
    *,
    normals: ArrayLike | None = None,
    iterations: int = 1,
    noise: float | None = None,
    borders: SmoothedBorders = "curve",
    keep_volume: bool | None = None,
    detail: float | None = None,
    relax: bool = False,
    rings: int | None = None,
    alpha: float | None = None,
    selected: BoolArray | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SmoothingResult:
    """Remove the noise of a mesh and keep its shape, its volume and its edges.

    By default all parameters are automatic. The noise is estimated from the mesh, as by `estimate_vertex_geometry`,
    and without noise nothing moves. The kind and the strength of the filter minimise the expected distance from the
    true surface, which follows from the noise and the result (Stein's unbiased risk estimate), for the mesh and around
    every vertex. Smooth surfaces get a low-pass filter, sharp edges a bilateral filter of the face normals, which does
    not average over differences that noise cannot explain.

    ``method="paper"`` is the paper's: every vertex p_i moves to the point B(u_i, v_i) of its patch, all from the
    old mesh (Li, Barsky, Jin, "An effective third-order local fitting patch and its application", IEEE SMI 2009).
    Where an edge has more than two faces, or two that disagree, there is no such patch, and its ends stay; so does a
    vertex whose patch is farther away than its neighbours.

    Without faces the vertices are a point cloud, which is smoothed as a mesh of triangles between its points (see
    `bezier_filters.fitting.cloud_triangulation`), and the patches are one of the estimates of its surface. Points move
    along the normals, so that the density stays; nothing is said of volumes and faces.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int, optional
        Triangles, counter-clockwise seen from outside; None or empty for a point cloud.
    method : {"auto", "paper"}
        How to smooth.
    normals : (n, 3) array_like of float, optional
        For point clouds only: outward vectors of any length, zero where the outside is unknown. As in
        `estimate_vertex_geometry`, points with opposite ones are no neighbours, so that two sides of a thin wall are
        smoothed apart.
    iterations : int
        How many times, at least 1; once is enough for ``"auto"``.
    noise : float, optional
        Standard deviation of the noise along the normal, a length, if it is known better than it can
        be estimated; 0 does not change the mesh. If it is much more than the estimated correlated noise, the difference
        gets a longer range, as the waves of depth cameras have, which would count as shape otherwise. For ``"auto"``
        only.
    borders : {"curve", "fixed"}
        Whether border vertices move along the normal, and across the border by its own noise, or stay; with ``"paper"``
        they move to their patches unless they are fixed.
    keep_volume : bool, optional
        Whether each closed component keeps its volume: the change by smoothing is compensated by moves along
        the normals, in proportion to the local movement. By default with ``"auto"`` only.
    detail : float, optional
        Size of the smallest detail to keep, a length: filters that more than halve waves of this length are
        excluded, and where a stronger one would be best, filters of the normals, too, which keep edges. For ``"auto"``
        only.
    relax : bool
        Whether all vertices slide along the surface, which makes the triangles, or the gaps of a cloud, more regular.
        By default they move along the normals, and slide only where noise in all directions has made triangles narrow.
        For ``"auto"`` only.
    rings, alpha : int, float, optional
        Neighbourhood, 2 by default, and weight of the points, in (0, 1], by default 0.8, for ``"paper"`` only.
    selected : (n,) bool, optional
        Vertices that may move; all by default.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result
        does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` is called from this thread now and then; if it returns False
        the smoothing is cancelled.

    Returns
    -------
    SmoothingResult

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with finite coordinates.
    InvalidParameterError
        If a parameter is out of range.
    CancelledError
        If `progress` returned False.

    Examples
    --------
    >>> import numpy as np
    >>> from bezier_filters.surfaces import sphere
    >>> ball = sphere(resolution=20)
    >>> noise = np.random.default_rng(0).normal(scale=0.01, size=len(ball.vertices))
    >>> result = smooth(ball.vertices * (1.0 + noise[:, np.newaxis]), ball.faces)
    >>> error = np.linalg.norm(result.vertices, axis=1) - 1.0
    >>> bool(error.std() < 0.2 * noise.std()), round(result.volume_ratio, 6)
    (True, 1.0)
    """
    shape = surface_or_points(vertices, faces)
    is_cloud = not shape.face_count
    if is_cloud and keep_volume:
        raise InvalidParameterError("keep_volume: got True, but a point cloud, without faces, has no volume")
    outward = check_normals(normals, shape)
    check_smoothing(method, iterations, noise, borders, detail, relax, rings, alpha)
    paper = FitOptions("auto" if rings is None else rings, "auto" if alpha is None else alpha, smoothness="paper")
    paper.check()
    ring_count, fit = cast("int", paper.ring_count), cast("PatchFit", paper.patch)
    with first_call():
        ordered = ensure_locality(cloud_surface(shape, outward) if is_cloud else prepare_mesh(shape))
    mesh = prepare_mesh(ordered.mesh)
    n = mesh.vertex_count
    check_noise_fits(noise, mesh.vertices)
    movable = np.ones(n, dtype=np.bool_) if selected is None else check_selection(selected, n)[ordered.order]
    if borders == "fixed":
        movable = movable & ~mesh.adjacency.on_boundary
    points, sharpness, sigma, error = mesh.vertices, *np.zeros((3, n))
    with first_call():
        known, done = learn_mesh_noise(mesh, noise), 0
        for k in range(iterations):
            current = mesh.move(points) if k else mesh
            part = iteration_progress(progress, k, iterations)
            if method == "auto":
                here = known if k == 0 else learn_mesh_noise(current)
                options = SmoothingOptions(borders, detail, relax, noise if k == 0 else None, is_cloud=is_cloud)
                found = denoise_mesh(current, here, options, progress=part)
                points, sharpness = found.points, np.maximum(sharpness, found.sharpness)
                sigma, error = np.hypot(sigma, found.noise), join_errors(error, found.noise, found.error)
            else:
                moves = fit_patches(current, ring_count, fit, progress=part).displacements
                points = points + admissible_displacements(current, moves)
            points = np.where(movable[:, np.newaxis], points, mesh.vertices)
            if np.array_equal(points, current.vertices) and (k or noise is None):
                break  # further iterations would not change it
            done += 1
        is_outlier = (method == "auto") & (
            np.linalg.norm(points - mesh.vertices, axis=1) > (1.0 + ROUNDING) * MAX_MOVE_SIGMAS * sigma
        )
        components, without = ClosedComponents.locate(mesh), omit_outliers(mesh, points)
        volumes_before = component_volumes(components, without)
        keeps_volume = components.count and not is_cloud and (keep_volume or (keep_volume is None and method == "auto"))
        if keeps_volume:
            amounts = local_movement(without, points) * movable
            points = restore_volumes(components, mesh.move(points), volumes_before, amounts)
        new_intersecting = 0
        if method == "auto" and not is_cloud:
            points, new_intersecting = reduce_intersections(mesh, repair_flipped_faces(mesh, points))
        if keeps_volume:
            unlike = volume_not_restored(components, without, mesh.move(points), known.sigma if known else 0.0)
            points = np.where(unlike[:, np.newaxis], mesh.vertices, points)
        smoothed = mesh.move(points)
        volumes_after = component_volumes(components, smoothed)
        noise_after = None
        if known is not None and method == "auto":
            noise_after = float(np.sqrt(np.square(np.where(movable, error, sigma)).mean())) if n else 0.0
        elif method == "paper" and (left := learn_mesh_noise(smoothed)) is not None:
            noise_after = left.sigma_in_ranges_of(known or left)
        bad_before, bad_after = (bad_faces(prepare_mesh(shape) if is_cloud else one) for one in (mesh, smoothed))
        has_volume = components.count and not is_cloud
        return SmoothingResult(
            vertices=ordered.restore_order(points),
            displacement=ordered.restore_order(np.linalg.norm(points - mesh.vertices, axis=1)),
            vertex_noise=ordered.restore_order(sigma),
            outliers=ordered.restore_order(is_outlier),
            sharpness=ordered.restore_order(sharpness),
            noise_before=None if known is None else known.sigma,
            noise_after=noise_after,
            noise_length=None if known is None else known.length,
            noise_heavy=known is not None and known.heavy,
            noise_reason="" if known is not None else explain_unknown_noise(mesh),
            iterations=done,
            mean_edge=mesh.mean_edge,
            volume_before=float(volumes_before.sum()) if has_volume else None,
            volume_after=float(volumes_after.sum()) if has_volume else None,
            flipped_before=int(bad_before.flipped.sum()),
            flipped_after=int(bad_after.flipped.sum()),
            degenerate_before=int(bad_before.degenerate.sum()),
            degenerate_after=int(bad_after.degenerate.sum()),
            new_bad_faces=int(bad_after.new_since(bad_before).sum()),
            new_intersecting_faces=new_intersecting,
        )


def unknown_noise(reason: str) -> str:
    """Warning that nothing was smoothed, as the noise could not be learned for a reason."""
    return f"nothing was smoothed, as the noise is not known ({reason})"


def check_noise_fits(noise: float | None, vertices: FloatArray) -> None:
    """Refuse noise (a length, or None) that is larger than a mesh with vertices (n, 3): it has another unit."""
    size = float(np.linalg.norm(np.ptp(vertices, axis=0))) if len(vertices) else 0.0
    if noise is not None and noise > size > 0.0:
        raise InvalidParameterError(
            f"noise: got {noise:g}, where all of the mesh is {size:.3g} across; give it in the unit of the coordinates"
        )


def admissible_displacements(mesh: PreparedMesh, displacements: FloatArray) -> FloatArray:
    """Displacements onto patches, (n, 3), set to zero if longer than the edges, and at edges that are not manifold."""
    admissible = (np.linalg.norm(displacements, axis=1) <= longest_edges(mesh)) & ~non_manifold_edge_vertices(mesh)
    return np.where(admissible[:, np.newaxis], displacements, 0.0)


def iteration_progress(progress: Progress | None, k: int, total: int) -> Progress | None:
    """Progress of the k-th of several iterations as progress of all of them."""
    if progress is None:
        return None
    return lambda done, of: progress(k * of + done, total * of)


def check_smoothing(
    method: object,
    iterations: object,
    noise: object,
    borders: object,
    detail: object = None,
    relax: object = False,
    rings: object = None,
    alpha: object = None,
) -> None:
    """Refuse options that are out of range.

    Raises
    ------
    InvalidParameterError
        It names the parameter.
    """
    if method not in ("auto", "paper"):
        raise InvalidParameterError(f"method: got {method!r}, expected 'auto' or 'paper'")
    if not is_integer(iterations) or iterations < 1:
        raise InvalidParameterError(f"iterations: got {iterations!r}, expected an integer of 1 or more")
    check_noise(noise)
    check_detail(detail)
    others = {"noise": noise, "detail": detail, "relax": relax or None}
    if method == "auto":
        others = {"rings": rings, "alpha": alpha}
    for name, value in others.items():
        if value is not None:
            raise InvalidParameterError(f"{name}: method={method!r} does not use it; leave it out")
    if borders not in ("curve", "fixed"):
        raise InvalidParameterError(f"borders: got {borders!r}, expected 'curve' or 'fixed'")
