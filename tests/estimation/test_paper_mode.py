"""The paper's mode, with its own fallbacks, next to dense least squares that share no code with it."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from paper_fits import PaperFits
from reference import paper_rows

from bezier_filters import FitStatus, PatchFit, estimate_vertex_geometry
from bezier_filters.errors import InvalidParameterError
from bezier_filters.fitting.fallbacks import fallback_chain, fit_with_fallbacks
from bezier_filters.fitting.vertex_geometry import empty_geometry
from bezier_filters.kernels.kernel_input import prepare_kernel_mesh
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, torus

SOME = 12  # vertices that are compared in each example
TOLERANCE = 1e-9


def shaken(vertices, faces, share, seed):
    """Noise in all directions, in mean edges."""
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    return vertices + share * edge * np.random.default_rng(seed).standard_normal(vertices.shape)


def rough_torus():
    surface = torus(resolution=9, jitter=0.3)
    return surface.vertices, surface.faces


def noisy_star():
    surface = bumpy_star(resolution=5, jitter=0.2)
    return shaken(surface.vertices, surface.faces, 0.25, 0), surface.faces


def sharp_block():
    vertices, faces = block_with_sharp_edges(resolution=6, jitter=0.3)
    return shaken(vertices, faces, 0.05, 1), faces


MESHES = [rough_torus(), noisy_star(), sharp_block()]


@dataclass(frozen=True)
class GivenRows(PatchFit):
    """A bicubic patch, over the bounding rectangle as in the paper, with rows S of one's own."""

    rows: tuple = ()
    smoothness: str = "paper"

    @property
    def smoothness_rows(self):
        return np.array(self.rows)


def assert_equal(geometry, dense, chosen, size):
    """Statuses are equal, normals and curvatures to the tolerance; the number of those that were compared."""
    compared = 0
    for vertex in chosen.tolist():
        expected = dense.fit(vertex)
        if expected is None:
            continue
        compared += 1
        assert FitStatus(geometry.status[vertex]).name == expected.status
        bound = TOLERANCE * max(1.0, abs(expected.mean) * size, abs(expected.gaussian) * size**2)
        assert np.abs(geometry.normals[vertex] - expected.normal).max() < TOLERANCE
        assert abs(geometry.mean_curvature[vertex] - expected.mean) * size < bound
        assert abs(geometry.gaussian_curvature[vertex] - expected.gaussian) * size**2 < bound
    return compared


def some_of(vertices, seed):
    chosen = np.zeros(len(vertices), dtype=bool)
    chosen[np.random.default_rng(seed).choice(len(vertices), SOME, replace=False)] = True
    return chosen


@settings(max_examples=30)
@given(
    mesh=st.sampled_from(MESHES),
    alpha=st.floats(0.1, 1.0),
    rings=st.integers(1, 3),
    seed=st.integers(0, 10**6),
    fold_test=st.sampled_from(["angle", "crossings"]),
)
def test_the_papers_mode_is_dense_least_squares(mesh, alpha, rings, seed, fold_test):
    vertices, faces = mesh
    rng = np.random.default_rng(seed)
    x_axis = rng.standard_normal(3) if seed % 2 else None
    chosen = some_of(vertices, seed)
    options = {"rings": rings, "alpha": alpha, "smoothness": "paper", "fallbacks": "paper", "x_axis": x_axis}
    geometry = estimate_vertex_geometry(vertices, faces, selected=chosen, threads=1, fold_test=fold_test, **options)
    dense = PaperFits(vertices, faces, paper_rows(), alpha, rings, x_axis, fold_test)
    assume(assert_equal(geometry, dense, np.flatnonzero(chosen), 0.1))


@settings(max_examples=30)
@given(
    mesh=st.sampled_from(MESHES),
    count=st.integers(1, 10),
    alpha=st.floats(0.1, 1.0),
    rings=st.integers(1, 3),
    seed=st.integers(0, 10**6),
)
def test_with_any_small_s_it_is_so_too(mesh, count, alpha, rings, seed):
    vertices, faces = mesh
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((count, 16))
    i, j = np.divmod(np.arange(16), 4)
    affine = np.linalg.qr(np.stack([np.ones(16), i, j], axis=1))[0]
    rows -= rows @ affine @ affine.T  # as the paper's S does: else the patch is no height field
    fit = GivenRows(3, alpha, rows=tuple(map(tuple, rows.tolist())))
    arrays = prepare_kernel_mesh(triangle_mesh(vertices, faces), with_barriers=False)
    geometry = empty_geometry(len(vertices))
    chosen = np.flatnonzero(some_of(vertices, seed)).astype(np.int32)
    fit_with_fallbacks(arrays, chosen, list(fallback_chain(rings, fit, fallbacks="paper")), geometry)
    assume(assert_equal(geometry, PaperFits(vertices, faces, rows, alpha, rings), chosen, 0.1))


@pytest.mark.parametrize("fold_test", ["angle", pytest.param("crossings", marks=pytest.mark.slow)])
def test_every_fallback_of_the_paper_is_compared(fold_test):
    statuses = set()
    for vertices, faces in MESHES:
        for rings, alpha in ((1, 0.8), (2, 0.8), (3, 0.4), (2, 1.0)):
            options = {"rings": rings, "alpha": alpha, "smoothness": "paper", "fallbacks": "paper"}
            geometry = estimate_vertex_geometry(vertices, faces, fold_test=fold_test, **options)
            chosen = np.concatenate([np.flatnonzero(geometry.status == code)[:6] for code in FitStatus])
            dense = PaperFits(vertices, faces, paper_rows(), alpha, rings, fold_test=fold_test)
            fits = [dense.fit(vertex) for vertex in chosen.tolist()]
            statuses |= {fit.status for fit in fits if fit is not None}
            assert_equal(geometry, dense, chosen, 0.1)
    assert statuses >= {"OK", "WIDER_RING", "OTHER_PLANE", "ONE_RING", "LOWER_DEGREE"}


@pytest.mark.parametrize(
    "options",
    [
        {"fallbacks": "soap"},
        {"fallbacks": "paper"},
        {"fallbacks": "paper", "alpha": 0.8, "radius": 0.1},
        {"fold_test": "soap"},
        {"fold_test": "crossings"},
        {"fold_test": "crossings", "alpha": 0.8, "radius": 0.1},
        {"x_axis": [1.0, 0.0, 0.0]},
        {"x_axis": [1.0, 0.0], "alpha": 0.8},
        {"x_axis": [1.0, np.nan, 0.0], "alpha": 0.8},
    ],
)
def test_what_does_not_fit_together_is_refused(options):
    with pytest.raises(InvalidParameterError, match=r"fallbacks|fold_test|x_axis"):
        estimate_vertex_geometry(*MESHES[0], **options)


def test_points_without_faces_have_no_edges_that_cross():
    with pytest.raises(InvalidParameterError, match="fold_test"):
        estimate_vertex_geometry(MESHES[0][0], None, alpha=0.8, fold_test="crossings")


def test_a_sheet_that_comes_to_lie_above_itself_crosses_though_no_face_leans():
    """A flat spiral stair: its faces lean a few degrees, and its second turn is above its first."""
    n = 40
    angles = np.linspace(0.0, 3.2 * np.pi, n)
    rings = [np.column_stack([r * np.cos(angles), r * np.sin(angles), 0.02 * angles]) for r in (0.6, 1.0)]
    vertices = np.vstack(rings)
    i = np.arange(n - 1)
    faces = np.vstack([np.column_stack([i, i + n, i + 1]), np.column_stack([i + 1, i + n, i + n + 1])])
    middle = np.arange(2 * n) == n // 2
    options = {"alpha": 0.8, "rings": 20, "selected": middle}
    by_angle = estimate_vertex_geometry(vertices, faces, **options)
    by_crossings = estimate_vertex_geometry(vertices, faces, fold_test="crossings", **options)
    assert by_angle.status[middle] == [FitStatus.OK]
    assert by_crossings.status[middle] != [FitStatus.OK]


def test_more_points_than_pairs_can_be_tested_are_judged_by_angles():
    """The tip of a cone of 1,200 faces, which is no fold, and that of a star, which is one."""
    n = 1200
    angles = 2.0 * np.pi * np.arange(n) / n
    for heights in (np.full(n, -0.3), np.where(np.arange(n) % 2, -40.0, 40.0)):
        vertices = np.vstack([[0.0, 0.0, 0.0], np.column_stack([np.cos(angles), np.sin(angles), heights])])
        faces = np.column_stack([np.zeros(n, int), np.arange(n) + 1, (np.arange(n) + 1) % n + 1])
        results = [
            estimate_vertex_geometry(
                vertices, faces, rings=1, alpha=0.8, fold_test=test, selected=np.arange(n + 1) == 0
            )
            for test in ("angle", "crossings")
        ]
        assert results[0].status[0] == results[1].status[0]
        assert np.array_equal(results[0].normals[0], results[1].normals[0])
