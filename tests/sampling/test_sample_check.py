"""Why the noise of a mesh is unknown, in words."""

import numpy as np
import pytest
from scarce_meshes import soup, tube

from bezier_filters import estimate_vertex_geometry, smooth
from bezier_filters.surfaces import sphere, waves


def crumpled():
    sheet = waves(resolution=60)
    noise = np.random.default_rng(0).normal(scale=0.1, size=sheet.vertices.shape)
    return sheet.vertices + noise, sheet.faces


REASONS = {
    "soup": (soup, "neighbourhoods reach a border or a sharp edge"),
    "two rows": (lambda: tube(400, 1.0), "neighbourhoods reach a border or a sharp edge"),
    "crumpled": (crumpled, "neighbourhoods fold: noise is as large as the edges, or faces are flipped"),
    "few": (lambda: (np.eye(4, 3), [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]), "4 vertices are too few"),
    "cancelled": (lambda: (np.eye(3), [[0, 1, 2], [0, 2, 1]]), "no vertex has a normal"),
}


@pytest.mark.parametrize("name", REASONS)
def test_the_reason_why_the_noise_is_unknown(name):
    make, reason = REASONS[name]
    vertices, faces = make()
    geometry, smoothed = estimate_vertex_geometry(vertices, faces), smooth(vertices, faces)
    assert geometry.noise_sigma is smoothed.noise_before is None
    assert reason in geometry.fit.noise
    assert reason in smoothed.noise
    assert reason in repr(smoothed)


def test_there_is_no_reason_where_the_noise_is_known_or_nothing_was_to_be_learned():
    ball = sphere()
    assert not estimate_vertex_geometry(ball.vertices, ball.faces).fit.noise_reason
    assert not smooth(ball.vertices, ball.faces).noise_reason
    assert not estimate_vertex_geometry(*soup(), rings=2, alpha=0.8).fit.noise
