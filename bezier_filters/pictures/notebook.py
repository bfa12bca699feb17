"""Meshes in notebooks: the page of a report, with the results that are at hand."""

from typing import TypeAlias

from numpy.typing import ArrayLike

from bezier_filters.errors import InvalidParameterError
from bezier_filters.estimation.vertex_geometry import VertexGeometry
from bezier_filters.feature_lines.crease_lines import Creases
from bezier_filters.holes.hole_filling import HoleFillingResult
from bezier_filters.meshes.mesh import takes_arrays, triangle_mesh
from bezier_filters.pictures.page import MOST_FACES, Page, Results, page_of
from bezier_filters.smoothing.smooth import SmoothingResult

Shown: TypeAlias = VertexGeometry | Creases | SmoothingResult | HoleFillingResult


@takes_arrays
def show(
    vertices: ArrayLike,
    faces: ArrayLike | None = None,
    *results: Shown,
    title: str = "",
    most_faces: int = MOST_FACES,
) -> Page:
    """Show a mesh in a notebook, to be turned with the mouse, with results for it: the page of a report.

    Fields are colours with legends and histograms, creases are lines, and what was smoothed or filled is after a slider
    whose other side is before. A line drawn on the mesh has a profile.

    Parameters
    ----------
    vertices : (n, 3) array_like
        The mesh that the results belong to: for smoothing and hole filling, that before.
    faces : (m, 3) array_like, optional
        Its triangles; None for a point cloud.
    *results : VertexGeometry, Creases, SmoothingResult or HoleFillingResult
        What was computed from it, at most one of each.
    title : str
        Heading of the page.
    most_faces : int
        A mesh with more faces is drawn with so many, and the page says so.

    Returns
    -------
    Page
        The last line of a cell shows it; ``save`` writes it as a file for a browser.

    Raises
    ------
    InvalidMeshError
        No vertices, or faces that are not triangles of them.
    InvalidParameterError
        A result that is none of these, or belongs to another mesh.

    Examples
    --------
    >>> import bezier_filters as bf
    >>> from bezier_filters.surfaces import torus
    >>> shape = torus(resolution=12)
    >>> result = bf.smooth(shape.vertices, shape.faces, "paper")
    >>> bf.show(shape.vertices, shape.faces, result)  # in a notebook, the torus
    Page(scan, smoothed; displacement)
    """
    mesh = triangle_mesh(vertices, [] if faces is None else faces)
    if not mesh.vertex_count:
        raise InvalidParameterError("vertices: got none, expected one or more")
    names = {VertexGeometry: "geometry", Creases: "creases", SmoothingResult: "smoothed", HoleFillingResult: "filled"}
    found: dict[str, Shown] = {}
    for result in results:
        got, name = type(result).__name__, names.get(type(result), "")
        if not name or name in found:
            expected = ", ".join(kind.__name__ for kind in names)
            raise InvalidParameterError(f"results: got {got}, expected at most one each of {expected}")
        if not _fits(result, mesh.vertex_count):
            count = mesh.vertex_count
            raise InvalidParameterError(f"results: a {got} belongs to another mesh than these {count} vertices")
        found[name] = result
    return page_of(title, mesh.vertices, mesh.faces, Results(**found), most_faces=most_faces)  # type: ignore[arg-type]


def _fits(result: Shown, vertex_count: int) -> bool:
    """Whether a result is of a mesh with so many vertices."""
    if isinstance(result, HoleFillingResult):
        return len(result.vertices) - sum(len(hole.new_vertices) for hole in result.holes) == vertex_count
    if isinstance(result, SmoothingResult):
        return len(result.vertices) == vertex_count
    return len((result.geometry if isinstance(result, Creases) else result).status) == vertex_count
