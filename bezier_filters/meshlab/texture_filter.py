"""The filter that bakes maps of the current mesh into an image over its texture coordinates.

Written like the filters of fields of vertices: see `vertex_filters`.
"""

from dataclasses import asdict

import numpy as np

from bezier_filters.arrays import FloatArray, Report
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.fields import BAKE
from bezier_filters.files.texture_files import check_texture_file, save_texture
from bezier_filters.meshlab.mesh_growth import textures_of
from bezier_filters.meshlab.meshset import (
    BezierFilterError,
    Length,
    MeshSet,
    absolute_length,
    check_unchanged,
    checks_filter_arguments,
    current_mesh,
    preserve_filter_script,
    read_current_mesh,
)
from bezier_filters.meshlab.verdicts import fit_verdict
from bezier_filters.meshlab.vertex_filters import FitArguments, fit_mesh
from bezier_filters.parameters import complete_docstring
from bezier_filters.patches.smoothness import Smoothness
from bezier_filters.runtime.compile_time import clock_without_compilation
from bezier_filters.runtime.parallel import Progress
from bezier_filters.status import FitStatus
from bezier_filters.surface_model.fit_options import Automatic
from bezier_filters.textures.bake import BakedTexture, TextureMap, bake_texture

NO_COORDINATES = (
    "the current mesh has no texture coordinates; unwrap it first: in Blender, or with pymeshlab's "
    "generate_voronoi_atlas_parametrization (a new layer, with large charts) or "
    "compute_texcoord_parametrization_triangle_trivial_per_wedge (a chart for each face)"
)


@checks_filter_arguments
@complete_docstring(BAKE)
def compute_texmap_by_bezier_patch(
    ms: MeshSet,
    *,
    textname: str | None = None,
    texmap: TextureMap = "curvature",
    size: int = 1024,
    scale: Length | None = None,
    padding: int = 8,
    bits: int = 16,
    directx: bool = False,
    rings: int | Automatic = "auto",
    radius: Length | None = None,
    alpha: float | Automatic = "auto",
    degree: int | Automatic = "auto",
    smoothness: Smoothness = "third_order",
    robust: bool | None = None,
    noise: Length | None = None,
    detail: Length | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Bake a curvature, cavity, convexity or normal map of the current mesh into an image over its texture coordinates.

    See `bezier_filters.bake_texture` for the maps. Normal maps are relative to the vertex normals of the current mesh,
    those of its file if that has some.

    Nothing in the MeshSet changes. To see the map on the mesh, make it its texture with pymeshlab's
    ``set_texture_per_mesh(textname=...)``.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        Its current mesh must have faces with texture coordinates, of wedges or of vertices, in one image.
    textname : str, optional
        PNG file to write or replace. If left out, none is written, and the report says what would be in it.

    Returns
    -------
    dict
        ``texture`` (the file, or None), ``texmap``, ``size``, ``bits``, ``scale`` (a length; None for a normal map),
        ``covered`` (share of the texels), ``overlapping_texels``, ``mirrored_faces``, ``outside_faces``,
        ``faces_without_area``, ``faces_without_texels`` and ``faces_without_patch`` (numbers, see `BakedTexture`),
        ``status`` (vertices per status name), ``fit`` (as of `compute_curvature_by_bezier_patch_per_vertex`),
        ``mean_edge`` (a length), ``warnings`` (texts: why no vertex has an estimate), ``remarks`` (texts: what the
        image cannot show) and ``seconds`` (read, fit, bake, write). It can be written as JSON.

    Examples
    --------
    >>> from pymeshlab import MeshSet
    >>> ms = MeshSet()
    >>> ms.create_sphere(radius=2.0, subdiv=3)
    >>> ms.compute_texcoord_parametrization_triangle_trivial_per_wedge(textdim=256)
    >>> report = compute_texmap_by_bezier_patch(ms, size=256, scale=4.0)
    >>> report["overlapping_texels"], report["faces_without_texels"], report["scale"]
    (0, 0, 4.0)
    """
    if textname is not None:
        check_texture_file(textname, bits)
    clock = [clock_without_compilation()]
    mesh = read_current_mesh(ms)
    if not len(mesh.faces):
        raise BezierFilterError("the current mesh has no faces, and textures are on faces; it is a point cloud")
    coordinates = _texture_coordinates(ms)
    length = absolute_length(scale, mesh.vertices, "scale")
    clock.append(clock_without_compilation())
    everywhere = np.ones(len(mesh.vertices), dtype=np.bool_)
    fit = FitArguments(rings, radius, alpha, degree, smoothness, robust, noise, detail, threads, progress)
    try:
        geometry = fit_mesh(mesh, everywhere, fit)
        clock.append(clock_without_compilation())
        baked = bake_texture(
            mesh.vertices,
            mesh.faces,
            coordinates,
            texmap,
            size=size,
            scale=length,
            padding=padding,
            directx=directx,
            normals=_finite_normals(mesh.vertex_normals),
            geometry=geometry,
            threads=threads,
        )
        clock.append(clock_without_compilation())
        check_unchanged(ms, mesh)
        if textname is not None:
            save_texture(textname, baked, bits=bits)
    except (InvalidMeshError, InvalidParameterError) as error:
        raise BezierFilterError(str(error).replace("map: got", "texmap: got", 1)) from error
    clock.append(clock_without_compilation())
    verdict = fit_verdict("curvature", geometry, mesh, everywhere, FitStatus.FOLDED)
    return {
        "texture": textname,
        "texmap": texmap,
        "size": size,
        "bits": bits,
        "scale": baked.scale,
        "covered": float(baked.covered.mean()),
        "overlapping_texels": baked.overlapping_texels,
        "mirrored_faces": baked.mirrored_faces,
        "outside_faces": baked.outside_faces,
        "faces_without_area": baked.faces_without_area,
        "faces_without_texels": baked.faces_without_texels,
        "faces_without_patch": baked.faces_without_patch,
        "status": geometry.status_counts(),
        "fit": asdict(geometry.fit) | {"parts": [asdict(part) for part in geometry.fit.parts]},
        "mean_edge": mesh.mean_edge(),
        "warnings": verdict["warnings"],
        "remarks": verdict["remarks"] + _remarks(baked, len(mesh.faces)),
        "seconds": dict(zip(("read", "fit", "bake", "write"), map(float, np.diff(clock)), strict=True)),
    }


def _texture_coordinates(ms: MeshSet) -> FloatArray:
    """Texture coordinates of the current mesh: (m, 3, 2) of wedges, else (n, 2) of vertices."""
    mesh = current_mesh(ms)
    if mesh.has_wedge_tex_coord():
        with preserve_filter_script(ms):
            names, numbers = textures_of(ms)
        if len(np.unique(numbers)) > 1:
            raise BezierFilterError(
                f"the faces of the current mesh are on {len(names)} images, expected one; unwrap the mesh into one "
                "atlas first"
            )
        return np.array(mesh.wedge_tex_coord_matrix(), dtype=np.float64).reshape(-1, 3, 2)
    if mesh.has_vertex_tex_coord():
        return np.array(mesh.vertex_tex_coord_matrix(), dtype=np.float64)
    raise BezierFilterError(NO_COORDINATES)


def _finite_normals(normals: FloatArray) -> FloatArray | None:
    """Vertex normals (n, 3) of a mesh; None where they are not finite, or all of them are missing."""
    return normals if np.isfinite(normals).all() and normals.any() else None


def _remarks(baked: BakedTexture, face_count: int) -> list[str]:
    """What the image cannot show, in words."""
    found = []
    if baked.overlapping_texels:
        found.append(
            f"{baked.overlapping_texels:,} texels are covered by several faces, as where charts are mirrored or "
            "stacked; they show the first face"
        )
    if baked.outside_faces:
        found.append(
            f"{baked.outside_faces:,} of {face_count:,} faces have texture coordinates beyond 0 to 1; the texture "
            "repeats there"
        )
    if baked.faces_without_area:
        found.append(f"{baked.faces_without_area:,} of {face_count:,} faces have no area in the texture")
    if baked.faces_without_texels:
        found.append(
            f"{baked.faces_without_texels:,} of {face_count:,} faces are smaller than a texel and show those next to "
            "them; a larger size has room for more"
        )
    return found
