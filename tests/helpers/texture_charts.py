"""Texture coordinates for tests: a chart for every face, and the sheet of a height field."""

import numpy as np


def separate_charts(faces, margin=0.1, mirrored=False):
    """Coordinates (m, 3, 2): every face is half of a cell of a lattice, with a margin around it.

    Faces keep their orientation, or are mirrored.
    """
    count = int(np.ceil(np.sqrt(len(faces))))
    cell = np.stack(np.divmod(np.arange(len(faces)), count), axis=1)[:, np.newaxis]
    triangle = np.array([[margin, margin], [1 - margin, margin], [margin, 1 - margin]])
    corners = (cell + triangle) / count
    return 1.0 - corners[..., ::-1] if mirrored else corners


def points_of(texels, vertices, faces):
    """Points (k, 3) of the mesh at the covered texels."""
    return np.einsum("kc,kcj->kj", texels.weights, vertices[faces[texels.faces]])


def decode(image):
    """Unit vectors of a normal map."""
    vectors = 2.0 * image.astype(np.float64) - 1.0
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
