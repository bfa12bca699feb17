"""Sharp edges that noise hides: patches end there."""

import numpy as np
from outlier_cases import spikes, with_heights

from bezier_filters import estimate_vertex_geometry
from bezier_filters.meshes.triangles import area_vectors
from bezier_filters.surfaces import block_with_sharp_edges


def test_patches_end_at_sharp_edges_that_noise_and_outliers_hide():
    """They reached across, and normals of flat faces were 10 degrees off."""
    vertices, faces = block_with_sharp_edges(resolution=20, jitter=0.25)
    of_faces = area_vectors(vertices, faces)
    of_faces /= np.linalg.norm(of_faces, axis=1, keepdims=True)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], of_faces)
    lengths = np.linalg.norm(normals, axis=1)
    is_flat = lengths > 0.999 * np.bincount(faces.ravel())
    normals /= lengths[:, np.newaxis]
    heights = spikes(len(vertices), 0.03, 1.0)[0] + spikes(len(vertices), 1.0, 0.1, 1)[0]
    found = estimate_vertex_geometry(*with_heights((vertices, faces, normals), heights))
    cosines = np.einsum("ij,ij->i", found.normals, normals)[is_flat]
    angles = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
    assert np.sqrt(np.square(angles).mean()) < 2.0
