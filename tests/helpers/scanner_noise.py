"""Noise as scanners make it, made without the package: white noise that was averaged over rings of neighbours.

And what the package learns of it.
"""

import numpy as np
from scipy.sparse import coo_matrix

from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.noise.noise_evidence import learn_noise_covariance
from bezier_filters.sampling.neighbourhood_samples import draw_from_mesh, sample_by_mode
from bezier_filters.sampling.ring_analysis import analyse_rings
from bezier_filters.surface_model.learn import FIRST_STAGE_MAX_RINGS, SAMPLES_PER_RING
from bezier_filters.surfaces import sphere, torus


def ring_means(faces, count):
    """The half-lazy mean: every vertex keeps one half and takes the other from its neighbours, (n, n) sparse."""
    start, end = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    both = coo_matrix((np.ones(2 * len(start)), (np.append(start, end), np.append(end, start))), (count, count)).tocsr()
    both.data[:] = 1.0
    own = coo_matrix((np.full(count, 0.5), (np.arange(count), np.arange(count))), (count, count))
    halves = 0.5 / np.maximum(np.asarray(both.sum(axis=1)).ravel(), 1.0)
    return (own + both.multiply(halves[:, np.newaxis])).tocsr()


def mean_edge_of(vertices, faces):
    corners = vertices[faces]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean()


def averaged_noise(faces, count, passes, seed=0, columns=1):
    """White noise after some passes of the ring means, of mean square 1, (n, columns)."""
    values, means = np.random.default_rng(seed).standard_normal((count, columns)), ring_means(faces, count)
    for _ in range(passes):
        values = means @ values
    return values / np.sqrt(np.square(values).mean(axis=0))


def length_of(passes):
    """Over how many edges the correlation of such noise falls to exp(-1/2).

    A pass moves one half by an edge: it adds a quarter of a squared edge to the squared width in either coordinate.
    Values that were averaged over the same width are alike over sqrt(2) times that.
    """
    return np.sqrt(0.5 * passes)


def along_normals(surface, level, passes, seed=0):
    """The vertices of a surface with noise of `level` mean edges along the normal."""
    heights = averaged_noise(surface.faces, len(surface.vertices), passes, seed)
    return surface.vertices + level * mean_edge_of(surface.vertices, surface.faces) * heights * surface.normals


def in_all_directions(vertices, faces, level, seed=0):
    """The vertices with white noise of `level` mean edges in every coordinate."""
    return vertices + level * mean_edge_of(vertices, faces) * np.random.default_rng(seed).standard_normal(
        vertices.shape
    )


def learned(vertices, faces):
    """The correlated noise that narrow rings tell of, as in the package; None if it is white."""
    mesh = prepare_kernel_mesh(triangle_mesh(vertices, faces), with_barriers=True)
    sample = sample_by_mode(mesh, draw_from_mesh(mesh, SAMPLES_PER_RING[2]), FIRST_STAGE_MAX_RINGS, "plain")
    rings = {k: SAMPLES_PER_RING[k] for k in range(1, FIRST_STAGE_MAX_RINGS + 1)}
    return learn_noise_covariance(analyse_rings(sample, rings, vertex_count=len(vertices)))


def ball_with_a_narrow_ring(level):
    """A ball, and beside it a ring whose tube is 3 edges of the ball thick, with noise of `level` such edges.

    Returns vertices, faces, exact normals and which vertices are those of the ring, one in fourteen.
    """
    ball = sphere(radius=20.0, resolution=20, jitter=0.2)
    edge = mean_edge_of(ball.vertices, ball.faces)
    ring = torus(major_radius=5.0 * edge, minor_radius=3.0 * edge, resolution=14, jitter=0.2)
    parts = [along_normals(part, level * edge / mean_edge_of(part.vertices, part.faces), 0) for part in (ball, ring)]
    vertices = np.concatenate([parts[0], parts[1] + 100.0])
    faces = np.concatenate([ball.faces, ring.faces + len(ball.vertices)]).astype(np.int32)
    is_narrow = np.arange(len(vertices)) >= len(ball.vertices)
    return vertices, faces, np.concatenate([ball.normals, ring.normals]), is_narrow
