"""Finds the places nearest to points on the fitted surface of a mesh that does not fit into memory."""

import hashlib
import os
import tempfile
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arguments import checks_arguments
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fitting.fallbacks import fit_with_fallbacks
from bezier_filters.fitting.noise_level import is_noisy
from bezier_filters.fitting.outlier_removal import rebase_displacements
from bezier_filters.fitting.patch_geometry import PatchGeometry, empty_patch_geometry
from bezier_filters.fitting.region_fits import fit_regions
from bezier_filters.fitting.surface_fit import SurfaceFit
from bezier_filters.meshes.half_edges import MeshEdges, distinct_edges, mesh_edges
from bezier_filters.meshes.mesh import TriangleMesh, triangle_mesh
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.sharp_edges import sharp_edges
from bezier_filters.patch_surface.cut_mesh import cut_mesh
from bezier_filters.patch_surface.nearest_face import find_squared_distances
from bezier_filters.patch_surface.query_arguments import check_points
from bezier_filters.patch_surface.surface import Surface, SurfacePoints, empty_points
from bezier_filters.patch_surface.surface_fit import MIN_SHARED_RESIDUAL, refuse_duplicates, residual_products
from bezier_filters.runtime.parallel import single_threaded_blas
from bezier_filters.scale.array_file import ArrayFile, Values, save_array
from bezier_filters.scale.clients import Scheduler
from bezier_filters.scale.halo import TilePart, tile_part
from bezier_filters.scale.learn import learn_fit, mesh_to_fit, rings_needed, sample_store_parts
from bezier_filters.scale.run import Run, RunOptions, StageProgress, store_run
from bezier_filters.scale.source import SourcePath, open_source
from bezier_filters.scale.store import Store
from bezier_filters.scale.tiles import TileReport
from bezier_filters.surface_model.fit_options import FitOptions, check_noise

# Rings around a tile with patches, in which places nearest to its points mostly are; doubled where they are not.
PATCH_RINGS = 4
NEAREST = np.dtype([("point", "<i8"), ("squared", "<f8")])
PAIRS_AT_ONCE = 1 << 22  # pairs of a point and a box in memory


@dataclass(frozen=True)
class TiledFit:
    """What the tasks on all tiles share."""

    store: Store
    fit: SurfaceFit
    options: FitOptions
    is_noisy: bool  # whether noise makes angles that look like sharp edges
    points: ArrayFile  # (q, 3)


@checks_arguments
@single_threaded_blas()
def surface_at_file(
    source: SourcePath,
    points: ArrayLike,
    *,
    noise: float | None = None,
    scheduler: Scheduler = None,
    workers: int | None = None,
    tile_vertices: int | None = None,
    memory_limit: int | None = None,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
    keep_store: bool = False,
    progress: StageProgress | None = None,
) -> SurfacePoints:
    """Find the places of the fitted surface of a mesh of any size nearest to points: `surface_at`, in tiles.

    The points and results are in memory, the mesh is not: it is sorted and cut into tiles as in `estimate_file`. A
    first round of tasks measures the tiles, a second one finds the tile with the face nearest to each point, a third
    one fits the patches around the tiles that have points, and finds the places.

    The results are those in memory, to rounding errors. At sharp edges they differ a little, because the patches next
    to them have the fit of the whole mesh, and sharp edges that noise hides are not found.

    Parameters
    ----------
    source : path, or two of them
        As in `estimate_file`.
    points : (q, 3) array_like of float
        Points anywhere.
    noise : float, optional
        Standard deviation of the noise along the normal, a length, if it is known; 0 for none.
    scheduler, workers, tile_vertices, memory_limit, progress
        As in `estimate_file`.
    store : path, optional
        Folder for the store; by default a temporary one, which other machines do not see.
    resume, keep_store : bool
        As in `estimate_file`; only with `store`.

    Returns
    -------
    SurfacePoints

    Raises
    ------
    FieldFileError, InvalidMeshError, InvalidParameterError, ImportError, LostTaskError, CancelledError
        As `estimate_file`.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from bezier_filters.surfaces import sphere
    >>> folder, ball = Path(tempfile.mkdtemp()), sphere(radius=2.0, resolution=20)
    >>> np.save(folder / "v.npy", ball.vertices)
    >>> np.save(folder / "f.npy", ball.faces)
    >>> files = folder / "v.npy", folder / "f.npy"
    >>> found = surface_at_file(files, [[3.0, 1.0, 0.0]], tile_vertices=1024, scheduler="synchronous")
    >>> found.distances.round(3), found.mean_curvature.round(3)
    (array([1.162]), array([0.5]))
    """
    queries = check_points(points)
    check_noise(noise)
    if store is None and (resume or keep_store):
        raise InvalidParameterError("store: None, expected a folder to resume from or to keep")
    opened, options = open_source(source), FitOptions(noise=noise)
    if not len(queries):
        return empty_points(0)
    with tempfile.TemporaryDirectory() if store is None else nullcontext(store) as folder:
        folder = Path(folder) / "store" if store is None else store
        how = RunOptions(scheduler, workers, tile_vertices, memory_limit, folder, resume, keep_store, progress)
        with store_run(opened, folder, how) as run:
            return _find_places(run, queries, options)


def _find_places(run: Run, queries: FloatArray, options: FitOptions) -> SurfacePoints:
    """Run the three rounds of tasks."""
    digest = hashlib.sha256(queries.tobytes()).hexdigest()
    results = run.results({"quantity": "surface", "points": digest, "options": asdict(options)})
    points = save_array(results / "points.bin", queries)
    with run.stages.stage("learn"):
        fit = learn_fit(run.store, options)
        noisy = is_noisy(sample_store_parts(run.store).mesh, fit.choice.noise_sigma)
    common = TiledFit(run.store, fit, options, noisy, points)
    measured = run.tiles("measure", results / "measure", partial(measure_tile, common))
    sharp, products, squares = measured.sums("residuals")
    if not sharp and products > MIN_SHARED_RESIDUAL * squares:
        common = replace(common, options=FitOptions(noise=0.0))
        with run.stages.stage("learn"):
            common = replace(common, fit=learn_fit(run.store, common.options))
    boxes = np.array([tile.report.sums["box"] for tile in measured.tiles]).reshape(-1, 2, 3)
    bounds = save_array(results / "bounds.bin", _upper_bounds(queries, boxes))
    found = run.tiles("nearest", results / "nearest", partial(nearest_of_tile, common, bounds, boxes))
    least, owner = np.full(len(queries), np.inf), np.full(len(queries), -1, dtype=np.int32)
    for number, tile in enumerate(found.tiles):
        rows = tile.rows()
        is_nearer = rows["squared"] < least[rows["point"]]
        ids = rows["point"][is_nearer]
        least[ids], owner[ids] = rows["squared"][is_nearer], number
    owners = save_array(results / "owners.bin", owner)
    placed = run.tiles("surface", results / "surface", partial(query_tile, common, owners))
    return _join(len(queries), [tile.rows() for tile in placed.tiles])


def _upper_bounds(queries: FloatArray, boxes: FloatArray) -> FloatArray:
    """Upper bounds (q,) of the squared distances of points (q, 3) from a mesh, given the boxes (t, 2, 3) of its tiles.

    A face of a tile touches each side of its box, so that it is nearer than the farthest corner of any.
    """
    bounds, step = np.full(len(queries), np.inf), max(PAIRS_AT_ONCE // max(len(boxes), 1), 1)
    for start in range(0, len(queries), step):
        some = queries[start : start + step, np.newaxis]
        reach = np.maximum(np.abs(some - boxes[:, 0]), np.abs(some - boxes[:, 1]))
        bounds[start : start + step] = np.square(reach).sum(axis=2).min(axis=1, initial=np.inf)
    return bounds


def measure_tile(common: TiledFit, tile: int) -> tuple[Values, TileReport]:
    """The box of the faces of a tile; and of its residuals the number of sharp edges and the sums over edges."""
    store, choice = common.store, common.fit.choice
    part = tile_part(store, tile, rings_needed(common.fit))
    mesh, own = prepare_mesh(part.mesh), part.own
    refuse_duplicates(mesh)
    corners = mesh.vertices[mesh.faces[part.faces_of_tile()]].reshape(-1, 3)
    box = np.full((2, 3), np.inf) if not len(corners) else np.stack([corners.min(axis=0), corners.max(axis=0)])
    residuals = 0.0, 0.0, 0.0
    if common.options.noise is None and choice.noise_sigma and not choice.noise_length and not common.is_noisy:
        ids = np.arange(own.start, own.stop, dtype=np.int32)
        ends = distinct_edges(mesh.faces, mesh.vertex_count)[0]
        ends = ends[((ends >= own.start) & (ends < own.stop)).all(axis=1)]
        sharp = _sharp_edges(mesh, mesh_edges(mesh), common)
        is_own = ((sharp >= own.start) & (sharp < own.stop)).all(axis=1)
        residuals = float(is_own.sum()), *residual_products(_fit_patches(mesh, common, ids), ends)
    sums = {"box": box.ravel().tolist(), "residuals": list(residuals)}
    return np.empty(0, NEAREST), TileReport(tile, len(part.ids), sums)


def nearest_of_tile(common: TiledFit, bounds: ArrayFile, boxes: FloatArray, tile: int) -> tuple[Values, TileReport]:
    """Squared distances from the faces of a tile of the points that may be nearest to it."""
    points, box = common.points.read(0, common.points.rows), boxes[tile]
    gaps = np.maximum(np.maximum(box[0] - points, points - box[1]), 0.0)
    ids = np.flatnonzero(np.square(gaps).sum(axis=1) <= bounds.read(0, bounds.rows))
    part = tile_part(common.store, tile, 1)
    rows = np.empty(len(ids), NEAREST)
    rows["point"] = ids
    rows["squared"] = find_squared_distances(part.mesh.vertices, part.mesh.faces[part.faces_of_tile()], points[ids])
    return rows, TileReport(tile, len(part.ids), {})


def query_tile(common: TiledFit, owners: ArrayFile, tile: int) -> tuple[Values, TileReport]:
    """Rows of results for the points nearest to a tile, with their numbers."""
    ids = np.flatnonzero(owners.read(0, owners.rows) == tile).astype(np.int32)
    points, results, read, rings = common.points.take(ids), list[Values](), 0, PATCH_RINGS
    while len(ids):
        part = tile_part(common.store, tile, rings_needed(common.fit) + rings)
        read, mesh = len(part.ids), prepare_mesh(part.mesh)
        fitted = _rings_around(mesh, part, rings)
        found = _part_surface(mesh, common, fitted).query(points)
        has_patches = np.zeros(mesh.vertex_count, dtype=np.bool_)
        has_patches[fitted] = True
        is_inside = has_patches[mesh.faces[np.maximum(found.faces, 0)]].all(axis=1) | (len(fitted) == mesh.vertex_count)
        results.append(_rows(ids, found, part)[is_inside])
        ids, points, rings = ids[~is_inside], points[~is_inside], 2 * rings
    rows = np.concatenate(results) if results else np.empty(0, NEAREST)
    return rows, TileReport(tile, read, {})


def _rings_around(mesh: PreparedMesh, part: TilePart, rings: int) -> IntArray:
    """Vertices within so many rings of a tile, ascending."""
    inside = np.zeros(mesh.vertex_count, dtype=np.bool_)
    inside[part.own] = True
    for _ in range(rings):
        faces = mesh.faces[inside[mesh.faces].any(axis=1)]
        inside[faces] = True
    return np.flatnonzero(inside).astype(np.int32)


def _sharp_edges(mesh: PreparedMesh, edges: MeshEdges, common: TiledFit) -> IntArray:
    """Sharp edges (e, 2) of a part of a mesh, none where noise makes angles that look like them."""
    return edges.vertices[:0] if common.is_noisy else edges.vertices[sharp_edges(mesh, edges, mesh.adjacency)]


def _part_surface(mesh: PreparedMesh, common: TiledFit, fitted: IntArray) -> Surface:
    """Surface of a part of a mesh with patches at some vertices, cut as by `fit_surface`."""
    edges = mesh_edges(mesh)
    uses = np.bincount(edges.of_faces[edges.of_faces >= 0], minlength=len(edges.vertices))
    cut = cut_mesh(mesh.vertices, mesh.faces, np.vstack([_sharp_edges(mesh, edges, common), edges.vertices[uses > 2]]))
    ids = np.flatnonzero(np.isin(cut.origin, fitted)).astype(np.int32)
    geometry = _fit_patches(triangle_mesh(cut.vertices, cut.faces), common, ids)
    return Surface(TriangleMesh(mesh.vertices, mesh.faces), cut, geometry)


def _fit_patches(mesh: TriangleMesh, common: TiledFit, ids: IntArray) -> PatchGeometry:
    """Geometry of all vertices of a part of a mesh, fitted at some of them, in ascending order."""
    fit = common.fit
    arrays = mesh_to_fit(mesh, fit.with_barriers, fit.cleaned, fit.smooth_normals)
    arrays = arrays._replace(origin=np.arange(mesh.vertex_count, dtype=np.int32))
    geometry = empty_patch_geometry(mesh.vertex_count, common.options.highest_total_degree)
    fit_with_fallbacks(arrays, ids, fit.attempts, geometry, robust=fit.robust)
    choice = fit_regions(arrays, ids, fit, geometry)
    if fit.cleaned:
        rebase_displacements(mesh.vertices, arrays, ids, geometry)
    return replace(geometry, fit=choice)


def _rows(ids: IntArray, found: SurfacePoints, part: TilePart) -> Values:
    """Results as rows, with the numbers of the points, and those of the faces in the source."""
    numbers = (part.keys & 0xFFFFFFFF).astype(np.int32)
    values = {entry.name: getattr(found, entry.name) for entry in fields(found) if entry.init}
    values["faces"] = np.where(found.faces < 0, -1, numbers[np.maximum(found.faces, 0)])
    dtype = [("point", "<i8"), *((name, array.dtype.str, array.shape[1:]) for name, array in values.items())]
    rows = np.empty(len(ids), dtype=dtype)
    rows["point"] = ids
    for name, array in values.items():
        rows[name] = array
    return rows


def _join(count: int, tables: Sequence[Values]) -> SurfacePoints:
    """Results of all tiles in the order of the points; those without a place are as in memory."""
    found = empty_points(count)
    for rows in tables:
        for entry in fields(found):
            if entry.init and len(rows):
                getattr(found, entry.name)[rows["point"]] = rows[entry.name]
    return SurfacePoints(**{entry.name: getattr(found, entry.name) for entry in fields(found) if entry.init})
