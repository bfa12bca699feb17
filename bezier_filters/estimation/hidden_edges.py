"""Sharp edges that noise hides: they are found on the denoised mesh, and neighbourhoods end there."""

import numpy as np

from bezier_filters.arrays import BoolArray
from bezier_filters.fitting.noise_level import is_noisy
from bezier_filters.meshes.half_edges import mesh_edges
from bezier_filters.meshes.prepared_mesh import PreparedMesh
from bezier_filters.meshes.sharp_edges import may_have_sharp_edges, sharp_edges
from bezier_filters.noise.noise_model import NoiseModel
from bezier_filters.smoothing.denoise import SmoothingOptions
from bezier_filters.smoothing.flipped_faces import repair_flipped_faces
from bezier_filters.smoothing.rounds import denoise_mesh

# fraction of the noise that remains in the angles at sharp edges of the denoised surface: 0.06 to 0.3 on wedges, prisms
# and a fandisk with white noise of 0.1 to 0.5 edges
RESIDUAL_NOISE_FRACTION = 0.2
MIN_EDGE_SHARPNESS = 0.1  # smallest `DenoisedMesh.sharpness` at a sharp edge; round shapes have hardly any


def hides_sharp_edges(mesh: PreparedMesh, noise: NoiseModel) -> bool:
    """Whether the mesh may have sharp edges that its noise hides."""
    return is_noisy(mesh, noise.sigma) and may_have_sharp_edges(mesh.adjacency, mesh.planes.normals)


def noise_free_surface(mesh: PreparedMesh, noise: NoiseModel) -> tuple[PreparedMesh, BoolArray]:
    """The denoised mesh without flipped faces, and the mask (n,) of its barriers, at which neighbourhoods end.

    Barriers are vertices with two sharp edges or more where smoothing chose sharp estimates (see `smooth`). Coarse
    round shapes have edges with large angles, too, but no lines that fits should not cross.
    """
    found = denoise_mesh(mesh, noise, SmoothingOptions(repeats=False))
    surface = mesh.move(repair_flipped_faces(mesh, found.points))
    edges = mesh_edges(surface)
    sharp = sharp_edges(surface, edges, surface.adjacency)
    is_inside = np.bincount(edges.vertices[sharp].ravel(), minlength=mesh.vertex_count) >= 2
    hidden_barriers = is_inside & (found.sharpness >= MIN_EDGE_SHARPNESS)
    return surface, hidden_barriers
