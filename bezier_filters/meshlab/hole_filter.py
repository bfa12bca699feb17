"""The filter on a pymeshlab MeshSet that fills holes."""

import re
from dataclasses import asdict

import numpy as np

from bezier_filters.arrays import Report
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.holes.adjacent_rows import adjacent_faces, nearest_rim_vertices
from bezier_filters.holes.fill_methods import FillingMethod
from bezier_filters.holes.hole_filling import HoleFillingResult, fill_holes
from bezier_filters.holes.hole_report import HoleReport
from bezier_filters.holes.planar_fill import Correction
from bezier_filters.holes.selection_replacement import ReplacementResult
from bezier_filters.meshlab.mesh_growth import MeshGrowth, StayingRows, grow_mesh
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    CurrentMesh,
    Length,
    MeshSet,
    absolute_length,
    check_unchanged,
    checks_filter_arguments,
    preserve_filter_script,
    read_current_mesh,
)
from bezier_filters.meshlab.topology import repair as repair_mesh
from bezier_filters.meshlab.topology import repair_copy, topology_of
from bezier_filters.parameters import complete_docstring
from bezier_filters.runtime.compile_time import clock_without_compilation
from bezier_filters.runtime.parallel import Progress

WIDE_HOLE_RATIO = 0.5  # diameter over the diagonal of the bounding box above which a hole may be an open end


@checks_filter_arguments
@complete_docstring("fill-holes")
def meshing_close_holes_by_bezier_patch(
    ms: MeshSet,
    *,
    method: FillingMethod = "auto",
    maxholesize: int | None = None,
    maxperimeter: Length | None = None,
    maxdiameter: Length | None = None,
    outerrims: bool = False,
    boltholes: bool = False,
    trim: bool = False,
    intersecting: bool = False,
    creases: bool = True,
    repair: bool = False,
    noise: Length | None = None,
    alpha: float | None = None,
    correction: Correction = "harmonic",
    refine: bool = True,
    onselected: bool = False,
    newfaceselected: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Fill the holes of the current mesh, which becomes a new layer with the id ``result["id"]``.

    Fills are smooth where the surface is smooth, and sharp where it is sharp. The new triangles are about as large as
    the triangles around a hole, and continue the surface around it; sharp edges that end at a hole are continued
    through it. See `bezier_filters.fill_holes`. A hole is filled completely or left open.

    pymeshlab can add faces only by merging layers: the new layer is the last and the current one, and the old one, with
    its id, is gone. Old vertices and faces, but for what `trim` removes, stay the first, bit for bit and in their
    order, with their textures, colours, quality, selection and custom attributes; label, transform and visibility stay,
    too. Colours and quality of vertices go on smoothly into the fills; those of faces, and attributes, are of the
    nearest old ones, and ``bz_*`` columns are 0, as nothing has been estimated there. Texture coordinates go on
    smoothly, too; where a seam meets the rim, or other faces show the texture inside the hole, new faces continue the
    texture of adjacent old faces from the common edge on. They have no texture if one has a name with spaces, or two
    have the same name. Vertex and face normals are those of the faces. If no hole is filled, nothing changes except by
    `repair`: pymeshlab's filters weld coincident borders, split edges of more than two faces, which loses selections
    and sets custom attributes to 0, split vertices at which surfaces only touch, and reorient flipped faces.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have faces.
    onselected : bool
        Fill only holes with a selected vertex on their rim or, if no vertex is selected, with a vertex of a
        selected face.
    newfaceselected : bool
        Whether the new faces, and nothing else, are selected afterwards. MeshLab's filters act on selected faces
        alone if there are any.

    Returns
    -------
    dict
        ``closed_holes``, ``open_holes``, ``new_vertices``, ``new_faces`` and ``trimmed_faces`` (numbers), ``id`` (of
        the layer that is the mesh now), ``noise`` (standard deviation, a length, or None), ``lost_attributes`` (custom
        attributes that pymeshlab does not let us copy: those with capital letters or signs in their names),
        ``textured`` (whether the new faces show a texture), ``repaired`` (numbers of ``welded_vertices``,
        ``split_vertices``, ``removed_faces`` without area or there twice, and ``turned_faces``, or None), ``topology``
        (after that, as ``topology_before``) and ``topology_after`` (what pymeshlab counts: ``components``, ``genus``,
        ``boundary_loops`` with those of outer rims and islands, ``boundary_edges``, ``non_manifold_faces`` at such
        edges, ``non_manifold_vertices`` and ``two_manifold``; where the mesh is not a manifold the genus is None, and
        ``boundary_loops_by`` says that we have counted the loops), ``warnings`` (texts: fills that need a look, because
        they intersect faces, or are as wide as half of the mesh, and holes that were left open because every fill would
        intersect faces), ``remarks`` (texts: limits that limit nothing), ``seconds`` (read, fit, write) and ``holes``,
        a dict for each with ``filled``, ``method``, ``reason``, ``edge_count``, ``perimeter``, ``diameter``,
        ``islands``, ``is_outer_rim``, ``parts``, ``crease_edges``, ``new_vertices`` and ``new_faces`` (numbers),
        ``rim_error`` (0), ``rim_dihedral`` (mean angle along the rim, degrees) and ``self_intersections``; see
        `bezier_filters.HoleReport`. It can be written as JSON.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_sphere(radius=1.0, subdiv=4)
    >>> ms.compute_selection_by_condition_per_face(condselect="z0 > 0.9 && z1 > 0.9 && z2 > 0.9")
    >>> ms.meshing_remove_selected_faces()
    >>> result = meshing_close_holes_by_bezier_patch(ms)
    >>> result["closed_holes"], result["holes"][0]["method"]
    (1, 'surface')
    """
    begin = clock_without_compilation()
    given = mesh = read_current_mesh(ms)
    repaired: Report | None = None
    if not len(mesh.faces):
        raise BezierFilterError("the current mesh has no faces, so it has no holes")
    if repair:
        mesh, repaired = repair_copy(ms)
    start = clock_without_compilation()
    topology = topology_of(mesh.vertices, mesh.faces)
    diameter = absolute_length(maxdiameter, mesh.vertices, "maxdiameter")
    try:
        result = fill_holes(
            mesh.vertices,
            mesh.faces,
            method,
            max_edges=maxholesize,
            max_perimeter=absolute_length(maxperimeter, mesh.vertices, "maxperimeter"),
            max_diameter=diameter,
            selected=mesh.selection_mask() if onselected else None,
            outer_rims=outerrims,
            bolt_holes=boltholes,
            trim=trim,
            intersecting=intersecting,
            creases=creases,
            noise=absolute_length(noise, mesh.vertices, "noise"),
            alpha=alpha,
            correction=correction,
            refine=refine,
            on_border=topology.on_border,
            threads=threads,
            progress=progress,
        )
    except (InvalidMeshError, InvalidParameterError) as error:
        raise BezierFilterError(re.sub("^max_edges", "maxholesize", str(error))) from error
    fitted = clock_without_compilation()
    diagonal = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    check_unchanged(ms, given)
    if repair:
        with preserve_filter_script(ms):
            repair_mesh(ms)
    lost_attributes, textured = list[str](), False
    if result.filled:
        with preserve_filter_script(ms):
            lost_attributes, textured = grow_mesh(ms, growth_of(mesh, result), select=newfaceselected)
    written = clock_without_compilation()
    remarks = topology.remarks
    if diameter is not None and diameter > diagonal:  # a length in other units than those of the mesh, perhaps
        where = f"where all of the mesh is {diagonal:.3g} across"
        remarks.append(f"maxdiameter: no hole can have a diameter of {diameter:g} {where}")
    after = topology_of(result.vertices, result.faces) if result.filled else topology
    return {
        "closed_holes": result.filled,
        "open_holes": len(result.holes) - result.filled,
        "new_vertices": len(result.vertices) - len(result.old_vertices),
        "new_faces": len(result.faces) - len(result.old_faces),
        "trimmed_faces": len(mesh.faces) - len(result.old_faces),
        "id": ms.current_mesh_id(),
        "noise": result.noise,
        "lost_attributes": lost_attributes,
        "textured": textured,
        "repaired": repaired,
        "topology": dict(topology.counts),
        "topology_before": dict(topology.counts),
        "topology_after": dict(after.counts),
        "warnings": fill_warnings(result, diagonal),
        "remarks": remarks,
        "holes": [describe_report(hole) for hole in result.holes],
        "seconds": {"read": start - begin, "fit": fitted - start, "write": written - fitted},
    }


def fill_warnings(result: HoleFillingResult, diagonal: float) -> list[str]:
    """Warnings about fills to check, given the diagonal of the bounding box."""
    filled = [hole for hole in result.holes if hole.filled]
    wide = [hole for hole in filled if hole.diameter > WIDE_HOLE_RATIO * diagonal]
    cutting = [hole.self_intersections for hole in filled if hole.self_intersections]
    open_ = [hole for hole in result.holes if hole.self_intersections and not hole.filled]
    texts = [
        f"{len(wide):,} of the filled holes as wide as half of the mesh or wider, perhaps the end of a part and not a "
        f"hole: a largest diameter of {100 * WIDE_HOLE_RATIO:g}% leaves such open",
        f"{len(cutting):,} of the fills with faces that intersect others, {sum(cutting):,} in all",
        f"{len(open_):,} of the holes, left open because every fill would intersect others; intersecting=True fills "
        "them",
    ]
    return [text for text, holes in zip(texts, (wide, cutting, open_), strict=True) if holes]


def growth_of(mesh: CurrentMesh, result: HoleFillingResult | ReplacementResult) -> MeshGrowth:
    """New vertices and faces, the nearest old ones on the rims, whose attributes they get, and the rows that stay."""
    n, m = len(result.old_vertices), len(result.old_faces)
    old, new = result.faces[:m], result.faces[m:]
    like_vertex, like_face = nearest_rim_vertices(result.vertices, new, n), adjacent_faces(result.vertices, old, new)
    staying = StayingRows(result.old_vertices, result.old_faces) if m < len(mesh.faces) else None
    return MeshGrowth(result.vertices[n:], new, like_vertex, like_face, staying)


def describe_report(hole: HoleReport) -> Report:
    """A report as a dict of plain values, with counts instead of lists."""
    description = asdict(hole)
    del description["rim"]
    description["crease_edges"] = len(description.pop("creases"))
    return description | {"new_vertices": len(hole.new_vertices), "new_faces": len(hole.new_faces)}
