"""Maps of curvature, cavity, convexity and normals, baked into an image over the texture coordinates of a mesh."""

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from bezier_filters.arguments import brief_repr, real_array
from bezier_filters.arrays import BoolArray, FloatArray, SingleArray
from bezier_filters.errors import InvalidMeshError, InvalidParameterError, is_integer, is_real
from bezier_filters.estimation.estimate import estimate_vertex_geometry
from bezier_filters.fitting.vertex_geometry import VertexGeometry
from bezier_filters.meshes.mesh import takes_meshes, triangle_mesh
from bezier_filters.meshes.mesh_objects import MeshLike
from bezier_filters.meshes.prepared_mesh import PreparedMesh, prepare_mesh
from bezier_filters.meshes.unit_size import LENGTH, normalizes_size
from bezier_filters.runtime.parallel import Progress, runs_on_threads
from bezier_filters.status import FitStatus
from bezier_filters.textures.patch_normals import (
    are_on_sharp_edges,
    find_patch_normals,
    mean_face_normals,
    tangent_spaces,
    unit_vectors,
)
from bezier_filters.textures.texels import CHUNK_TEXELS, Texels, area_determinants, cover_texels, dilate

TextureMap = Literal["curvature", "cavity", "convexity", "normal"]
# values of flat parts, which the background has, too: mip-maps and filters mix it in beyond the padding
FLAT: dict[TextureMap, tuple[float, ...]] = {
    "curvature": (0.5,),
    "cavity": (1.0,),
    "convexity": (0.0,),
    "normal": (0.5, 0.5, 1.0),
}
MAX_TEXTURE_SIZE = 8192  # texels: memory grows with the area, and is 1.4 GB for 4,096
MAX_PADDING = 256  # texels: more than eight mip-map levels need
# Percentage of the vertices with the strongest curvatures that may saturate with the default scale: as with the
# colours of a quality, `percentile`.
SATURATED_PERCENTAGE = 2.0


@dataclass(frozen=True, repr=False)
class BakedTexture:
    """An image over the texture coordinates of a mesh, the result of `bake_texture`.

    Attributes
    ----------
    image : (size, size) or (size, size, 3) float32
        Values from 0 to 1, linear (no colour space); the first row is the top of the texture, v = 1. Normal maps have
        three channels, red, green and blue.
    covered : (size, size) bool
        Whether the centre of the texel is in a face; the others are padding or background.
    map : {"curvature", "cavity", "convexity", "normal"}
        What the image shows.
    scale : float or None
        Radius of curvature at which the image saturates, a length; None for a normal map.
    overlapping_texels : int
        Number of texels that several faces cover, as where charts are mirrored or stacked: they show the first face.
    mirrored_faces : int
        Number of faces that are clockwise in the texture.
    outside_faces : int
        Number of faces with texture coordinates beyond 0 to 1, where the texture repeats.
    faces_without_area : int
        Number of faces that have no area in the texture.
    faces_without_texels : int
        Number of other faces that contain no centre of a texel.
    faces_without_patch : int
        Number of faces whose corners are all on sharp edges or have no patch: a normal map has their own normals.
    geometry : VertexGeometry
        Normals and curvatures that the image is made from.
    """

    image: SingleArray
    covered: BoolArray
    map: TextureMap
    scale: float | None = field(metadata=LENGTH)
    overlapping_texels: int
    mirrored_faces: int
    outside_faces: int
    faces_without_area: int
    faces_without_texels: int
    faces_without_patch: int
    geometry: VertexGeometry

    def __repr__(self) -> str:
        """Map, size and coverage, on one line."""
        scale = "" if self.scale is None else f", scale {self.scale:.4g}"
        rows, columns = self.covered.shape
        return f"BakedTexture({self.map}, {columns} x {rows} texels, {self.covered.mean():.0%} covered{scale})"


@takes_meshes
@normalizes_size("scale")
@runs_on_threads
def bake_texture(
    vertices: ArrayLike | MeshLike,
    faces: ArrayLike | None = None,
    texture_coordinates: ArrayLike | None = None,
    map: TextureMap = "curvature",
    *,
    size: int = 1024,
    scale: float | None = None,
    padding: int = 8,
    directx: bool = False,
    normals: ArrayLike | None = None,
    geometry: VertexGeometry | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> BakedTexture:
    """Bake a curvature, cavity, convexity or normal map into an image over the texture coordinates of a mesh.

    The maps follow the conventions of texturing programs. With the scale R, a length, and the principal curvatures,

    - ``"convexity"`` is black where nothing is convex, and white from k_max = 1/R on: min(max(k_max R, 0), 1);
    - ``"cavity"`` is white where nothing is concave, and black from k_min = -1/R on: 1 - min(max(-k_min R, 0), 1);
    - ``"curvature"`` is mid grey where flat, and white or black where the others are: with the sum
      s = max(k_max, 0) + min(k_min, 0) it is 1/2 + min(max(s R, -1), 1) / 2. A symmetric saddle is mid grey;
    - ``"normal"`` is a tangent-space normal map: with it a coarse mesh is shaded like the surface that is fitted to it.

    Grey maps are computed at the vertices and interpolated linearly. Sharp edges have curvatures beyond any scale, and
    appear as lines that fade out within the faces next to them; there the larger curvature counts alone. The normal map
    holds the normals of the patches, blended over each face with an error of third order in its size, relative to the
    interpolated `normals`.

    Parameters
    ----------
    vertices : (n, 3) array_like of float, or mesh object
        Coordinates; or a mesh of another library, see `mesh_arrays`, and no faces.
    faces : (m, 3) array_like of int
        Triangles, counter-clockwise seen from outside.
    texture_coordinates : (m, 3, 2) or (n, 2) array_like of float
        u and v at the corners of the faces, or at the vertices where there are no seams; v points up. The texture
        repeats beyond 0 to 1.
    map : {"curvature", "cavity", "convexity", "normal"}
        What the image shows.
    size : int
        Rows, and columns, of the image.
    scale : float, optional
        Radius of curvature R at which the image saturates, a length. By default 2 % of the vertices saturate, sharp
        edges aside (curvature radii below the mean edge), between the mean edge and the diagonal of the bounding box.
        Maps of several meshes are comparable only if it is given.
    padding : int
        Texels around charts that repeat the nearest value inside, so that filters and mip-maps show no seams. What is
        farther away has the value of flat parts.
    directx : bool
        Whether green is down, -Y, as in DirectX; otherwise it is up, +Y, as in OpenGL. For normal maps.
    normals : (n, 3) array_like of float, optional
        Vertex normals, of any length, with which the mesh is shaded, for normal maps. By default means of the face
        normals, weighted by angle, as in MeshLab and Blender.
    geometry : VertexGeometry, optional
        Result of `estimate_vertex_geometry` for this mesh; by default it is computed.
    threads : int, optional
        Number of threads; by default BEZIER_FILTERS_THREADS or all usable cores. The result does not depend on it.
    progress : callable, optional
        ``progress(done, total)`` is called from this thread at intervals; if it returns False the call is
        cancelled.

    Returns
    -------
    BakedTexture

    Raises
    ------
    InvalidMeshError
        If the arrays are not a mesh with finite coordinates.
    InvalidParameterError
        If there are no texture coordinates, or they or another parameter are out of range.
    CancelledError
        If `progress` returned False.

    Notes
    -----
    Tangents are those of MikkTSpace, but for vertices at which faces with the same texture coordinates have no edge in
    common. A normal map is right only for the normals that it was baked with: export these with the mesh.

    Examples
    --------
    A hill, seen from above, whose top, in the middle, has the curvature 1:

    >>> from bezier_filters.surfaces import height_field
    >>> hill = height_field(lambda x, y: (1 - (x**2 + y**2) / 2, -x, -y, -1, 0, -1))
    >>> baked = bake_texture(hill.vertices, hill.faces, (hill.vertices[:, :2] + 1) / 2, size=64, scale=0.5)
    >>> baked.image.shape, round(float(baked.image[32, 32]), 2), round(float(baked.image[32, 0]), 2)
    ((64, 64), 0.75, 0.68)
    """
    mesh = prepare_mesh(triangle_mesh(vertices, faces))
    _check_parameters(mesh, map, size, scale, padding)
    coordinates = _corner_coordinates(texture_coordinates, mesh)
    shading = None if normals is None else _shading_normals(normals, mesh)
    if geometry is None:
        geometry = estimate_vertex_geometry(mesh.vertices, mesh.faces, threads=threads, progress=progress)
    elif len(geometry.status) != mesh.vertex_count:
        raise InvalidParameterError(
            f"geometry: got {len(geometry.status)} vertices, expected the {mesh.vertex_count} of the mesh"
        )
    texels = cover_texels(coordinates, size)
    flat = np.array(FLAT[map], dtype=np.float32)
    image = np.broadcast_to(flat, (size * size, len(flat))).copy()
    without_patch = 0
    if map == "normal":
        scale = None
        shading = mean_face_normals(mesh.vertices, mesh.faces) if shading is None else shading
        without_patch = _shade_normals(image, texels, mesh, geometry, coordinates, shading, directx=directx)
    else:
        scale = _default_scale(mesh, geometry) if scale is None else scale
        _shade_values(image, texels, _vertex_values(mesh, geometry, map, scale)[mesh.faces])
    covered = texels.mask()
    image = image.reshape(size, size, -1) if len(flat) > 1 else image.reshape(size, size)
    dilate(image, covered, padding)
    areas = area_determinants(coordinates)
    shown = np.unique(texels.faces)
    return BakedTexture(
        image=image,
        covered=covered,
        map=map,
        scale=scale,
        overlapping_texels=texels.overlapping,
        mirrored_faces=int((areas < 0.0).sum()),
        outside_faces=int(((coordinates < 0.0) | (coordinates > 1.0)).any(axis=(1, 2)).sum()),
        faces_without_area=int((areas == 0.0).sum()),
        faces_without_texels=int((areas != 0.0).sum()) - len(shown),
        faces_without_patch=without_patch,
        geometry=geometry,
    )


def _check_parameters(mesh: PreparedMesh, map: object, size: object, scale: object, padding: object) -> None:
    if not mesh.face_count:
        raise InvalidMeshError("faces: got none, expected triangles with texture coordinates")
    if map not in get_args(TextureMap):
        raise InvalidParameterError(f"map: got {brief_repr(map)}, expected one of {', '.join(get_args(TextureMap))}")
    if not (is_integer(size) and 1 <= size <= MAX_TEXTURE_SIZE):
        raise InvalidParameterError(f"size: got {brief_repr(size)}, expected an integer from 1 to {MAX_TEXTURE_SIZE}")
    if scale is not None and not (is_real(scale) and 0.0 < scale < np.inf):
        raise InvalidParameterError(f"scale: got {brief_repr(scale)}, expected a positive length, or None")
    if not (is_integer(padding) and 0 <= padding <= MAX_PADDING):
        raise InvalidParameterError(f"padding: got {brief_repr(padding)}, expected an integer from 0 to {MAX_PADDING}")


def _corner_coordinates(given: ArrayLike | None, mesh: PreparedMesh) -> FloatArray:
    """Texture coordinates of the corners of the faces, (m, 3, 2)."""
    n, m = mesh.vertex_count, mesh.face_count
    expected = f"expected finite numbers of shape ({m}, 3, 2), for corners, or ({n}, 2), for vertices"
    if given is None:
        raise InvalidParameterError(f"texture_coordinates: got None, {expected}")
    try:
        found = real_array(given)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError(f"texture_coordinates: {expected}; {error}") from None
    if found.shape not in ((m, 3, 2), (n, 2)):
        raise InvalidParameterError(f"texture_coordinates: got shape {found.shape}, {expected}")
    if not np.isfinite(found).all():
        raise InvalidParameterError(f"texture_coordinates: some are NaN or infinite, {expected}")
    corners: FloatArray = found if found.ndim == 3 else found[mesh.faces]
    if not area_determinants(corners).any():
        raise InvalidParameterError("texture_coordinates: no face has an area in the texture; unwrap the mesh first")
    return corners


def _shading_normals(given: ArrayLike, mesh: PreparedMesh) -> FloatArray:
    """Vertex normals at unit length, (n, 3)."""
    expected = f"expected finite numbers of shape {mesh.vertices.shape}"
    try:
        found = real_array(given)
    except (TypeError, ValueError) as error:
        raise InvalidParameterError(f"normals: {expected}; {error}") from None
    if found.shape != mesh.vertices.shape or not np.isfinite(found).all():
        raise InvalidParameterError(f"normals: got shape {found.shape}, {expected}")
    return unit_vectors(found)


def _default_scale(mesh: PreparedMesh, geometry: VertexGeometry) -> float:
    """Radius beyond which the strongest `SATURATED_PERCENTAGE` of the curvatures saturate, sharp edges aside."""
    edge, diagonal = mesh.mean_edge, float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    curvatures = np.maximum(np.abs(geometry.k_min), np.abs(geometry.k_max))
    known = curvatures[(geometry.status <= FitStatus.FOLDED) & (curvatures * edge <= 1.0)]
    strongest = float(np.percentile(known, 100.0 - SATURATED_PERCENTAGE)) if len(known) else 0.0
    return diagonal if strongest * diagonal <= 1.0 else max(1.0 / strongest, edge)


def _vertex_values(mesh: PreparedMesh, geometry: VertexGeometry, map: TextureMap, scale: float) -> FloatArray:
    """Values of a map at the vertices, (n,); those of flat parts where no curvature is known.

    On sharp edges the larger curvature counts alone: the fit to both sides waves along the edge, and would make dark
    spots on convex edges of cavity maps.
    """
    convex, concave = np.maximum(geometry.k_max, 0.0) * scale, np.maximum(-geometry.k_min, 0.0) * scale
    sharp = are_on_sharp_edges(mesh, geometry)
    convex, concave = (
        np.where(sharp & (other > own), 0.0, own) for own, other in ((convex, concave), (concave, convex))
    )
    if map == "curvature":
        return 0.5 + 0.5 * np.clip(convex - concave, -1.0, 1.0)
    return np.minimum(convex, 1.0) if map == "convexity" else 1.0 - np.minimum(concave, 1.0)


def _shade_values(image: SingleArray, texels: Texels, values: FloatArray) -> None:
    """Write a linear interpolation of values at the corners of faces, (m, 3), to an image (size^2, 1)."""
    for part in _parts(texels):
        found = np.einsum("kc,kc->k", texels.weights[part], values[texels.faces[part]])
        image[texels.places[part], 0] = found


def _shade_normals(
    image: SingleArray,
    texels: Texels,
    mesh: PreparedMesh,
    geometry: VertexGeometry,
    coordinates: FloatArray,
    normals: FloatArray,
    *,
    directx: bool,
) -> int:
    """Write a normal map to an image (size^2, 3); returns the number of faces without a patch."""
    surface = find_patch_normals(mesh, geometry)
    spaces = tangent_spaces(mesh.vertices, mesh.faces, coordinates, normals)
    axes = (0.5, -0.5 if directx else 0.5, 0.5)
    for part in _parts(texels):
        faces, weights = texels.faces[part], texels.weights[part]
        components = spaces.encode(faces, weights, surface.evaluate(faces, weights))
        image[texels.places[part]] = 0.5 + components * axes
    return int((~surface.has_patch).sum())


def _parts(texels: Texels) -> list[slice]:
    """Slices of the texels, to limit the memory of what is computed with each."""
    return [slice(first, first + CHUNK_TEXELS) for first in range(0, len(texels.places), CHUNK_TEXELS)]
