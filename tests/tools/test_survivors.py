"""The remeshing that the benchmark on deleted vertices rests on."""

import numpy as np
import pytest
from surface_cases import area_vectors, assert_valid_mesh, border_edges, directed_edges, volume

from bezier_filters.surfaces import bumpy_star, height_field, punched_patch, sphere, torus
from survivors import keep_survivors

CASES = {
    "sphere": (sphere, 20, 2, 0),
    "bumpy_star": (bumpy_star, 20, 2, 0),
    "torus": (torus, 40, 0, 0),
    "punched_patch": (punched_patch, 60, -2, 4),
}


def surviving(size, share, seed=0):
    survivors = np.zeros(size, dtype=bool)
    survivors[np.random.default_rng(seed).permutation(size)[: round(share * size)]] = True
    return survivors


@pytest.mark.parametrize("share", [0.9, 0.5, 0.1])
@pytest.mark.parametrize("name", CASES)
def test_survivors_stay_and_the_others_go(name, share):
    make, resolution, euler_characteristic, rims = CASES[name]
    surface = make(resolution=resolution, jitter=0.3)
    survivors = surviving(len(surface.vertices), share)
    kept, faces = keep_survivors(surface.vertices, surface.faces, survivors)
    assert np.isin(np.flatnonzero(survivors), kept).all()
    # A border vertex may only go along the border, which its survivors must outline well enough.
    assert np.isin(kept[~survivors[kept]], border_edges(surface.faces)).all()
    assert_valid_mesh(surface.vertices[kept], faces, euler_characteristic, rims)
    normals = area_vectors(surface.vertices[kept], faces)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.einsum("mi,mki->mk", normals, surface.normals[kept][faces]).min() > 0


def test_volume_of_a_sphere_shrinks_as_that_of_an_inscribed_polyhedron():
    ball = sphere(resolution=30)
    kept, faces = keep_survivors(ball.vertices, ball.faces, surviving(len(ball.vertices), 0.1))
    assert 0.97 < volume(ball.vertices[kept], faces) / volume(ball.vertices, ball.faces) < 1


def test_flat_sheet_becomes_a_delaunay_triangulation():
    """No edge has opposite angles of more than 180 degrees: in the plane, nothing keeps it from being flipped."""
    sheet = height_field(lambda x, y: (0 * x, 0, 0, 0, 0, 0), resolution=40, jitter=0.3)
    survivors = surviving(len(sheet.vertices), 0.3)
    survivors[np.unique(border_edges(sheet.faces))] = True
    kept, faces = keep_survivors(sheet.vertices, sheet.faces, survivors)
    assert len(kept) == survivors.sum()
    vertices = sheet.vertices[kept]
    areas = area_vectors(vertices, faces)[:, 2]
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(area_vectors(sheet.vertices, sheet.faces)[:, 2].sum(), rel=1e-12)
    corners = vertices[faces]
    towards, away = np.roll(corners, -1, axis=1) - corners, np.roll(corners, -2, axis=1) - corners
    cosine = np.einsum("mki,mki->mk", towards, away)
    cotangent = cosine / np.linalg.norm(np.cross(towards, away), axis=2)
    sums = {}
    for edge, opposite in zip(np.sort(directed_edges(faces), axis=1), cotangent[:, [2, 0, 1]].T.ravel(), strict=True):
        sums.setdefault(tuple(edge), []).append(opposite)
    assert min(sum(pair) for pair in sums.values() if len(pair) == 2) > -1e-5


def test_all_survivors_leave_the_mesh_of_a_sphere_as_it_is():
    ball = sphere(resolution=10)
    kept, faces = keep_survivors(ball.vertices, ball.faces, np.ones(len(ball.vertices), dtype=bool))
    np.testing.assert_array_equal(kept, np.arange(len(ball.vertices)))
    np.testing.assert_array_equal(faces, ball.faces)


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        ([[0, 1, 2], [0, 1, 3]], "oriented differently"),
        ([[0, 1, 2], [0, 3, 4]], "not one fan"),
    ],
)
def test_meshes_that_are_no_manifolds_are_refused(faces, message):
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=np.float64)
    with pytest.raises(ValueError, match=message):
        keep_survivors(vertices, np.array(faces), np.ones(5, dtype=bool))
