"""`surface_at_file` in tiles next to `surface_at` in memory."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import bezier_filters as bf
from bezier_filters.arrays import FloatArray
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.scale import surface_at_file
from bezier_filters.surfaces import SampledSurface, bumpy_star, torus

Files = tuple[Path, Path]
STAR = bumpy_star(resolution=12, jitter=0.3, seed=4)
ACCURACY = 1e-8  # of places, in edges: that of the projection


def save(folder: Path, vertices: FloatArray, faces: object) -> Files:
    """Files of a mesh."""
    files = folder / "v.npy", folder / "f.npy"
    np.save(files[0], np.ascontiguousarray(vertices))
    np.save(files[1], np.asarray(faces, dtype=np.int32))
    return files


def with_noise(body: SampledSurface, level: float) -> tuple[FloatArray, float]:
    """Vertices with noise along the normals, and the mean edge."""
    sides = np.diff(body.vertices[body.faces[:, :2]], axis=1)
    edge = float(np.linalg.norm(sides, axis=2).mean())
    heights = np.random.default_rng(5).standard_normal((len(body.vertices), 1))
    return body.vertices + level * edge * heights * body.normals, edge


def queries_near(vertices: FloatArray, edge: float) -> FloatArray:
    """Points near the vertices of a mesh, and some far outside."""
    rng = np.random.default_rng(6)
    near = vertices[rng.integers(0, len(vertices), 600)] + 0.5 * edge * rng.standard_normal((600, 3))
    return np.vstack([near, 5.0 * rng.standard_normal((40, 3))])


@pytest.mark.parametrize("level", [0.0, 0.1])
@pytest.mark.parametrize("make", [lambda: STAR, lambda: torus(resolution=20, jitter=0.3, seed=2)])
def test_places_are_those_in_memory(tmp_path: Path, make: Callable[[], SampledSurface], level: float) -> None:
    body = make()
    vertices, edge = with_noise(body, level)
    points = queries_near(vertices, edge)
    wanted = bf.fit_surface(vertices, body.faces).query(points)
    found = surface_at_file(save(tmp_path, vertices, body.faces), points, tile_vertices=256, scheduler="synchronous")
    # noise turns faces over at a few points, where paths depend on the order of the faces
    converged = (wanted.outcome == 0) & (found.outcome == 0)
    assert converged.mean() > 0.995
    for name in ("points", "distances"):
        assert np.abs(getattr(found, name) - getattr(wanted, name))[converged].max() < ACCURACY * edge
    assert np.abs(found.normals - wanted.normals)[converged].max() < 1e-7
    np.testing.assert_allclose(found.mean_curvature[converged], wanted.mean_curvature[converged], atol=1e-6)
    np.testing.assert_allclose(found.position_std[converged], wanted.position_std[converged], rtol=1e-6, atol=1e-15)
    assert np.array_equal(found.faces[converged], wanted.faces[converged])
    assert len(list(tmp_path.iterdir())) == 2  # the temporary store is elsewhere, and removed


def test_given_noise_is_used(tmp_path: Path) -> None:
    vertices, edge = with_noise(STAR, 0.1)
    points = queries_near(vertices, edge)
    files = save(tmp_path, vertices, STAR.faces)
    found = surface_at_file(files, points, noise=0.2 * edge, tile_vertices=512, scheduler="synchronous")
    wanted = bf.fit_surface(vertices, STAR.faces, noise=0.2 * edge).query(points)
    converged = (wanted.outcome == 0) & (found.outcome == 0)
    assert np.abs(found.points - wanted.points)[converged].max() < ACCURACY * edge


def test_a_kept_store_is_resumed(tmp_path: Path) -> None:
    files, store = save(tmp_path, STAR.vertices, STAR.faces), tmp_path / "store"
    options = {"tile_vertices": 512, "scheduler": "synchronous", "store": store}
    first = surface_at_file(files, [[2.0, 0.0, 0.0]], keep_store=True, **options)
    written = {path: path.stat().st_mtime_ns for path in store.rglob("tile-*.npy")}
    again = surface_at_file(files, [[2.0, 0.0, 0.0]], resume=True, keep_store=True, **options)
    assert np.array_equal(first.points, again.points)
    assert written == {path: path.stat().st_mtime_ns for path in store.rglob("tile-*.npy")}
    surface_at_file(files, [[2.0, 0.0, 0.0]], resume=True, **options)
    assert not store.exists()


def test_points_without_a_face_with_area_have_no_place(tmp_path: Path) -> None:
    files = save(tmp_path, np.zeros((300, 3)), np.arange(300).reshape(-1, 3))
    found = surface_at_file(files, [[1.0, 0.0, 0.0]], tile_vertices=256, scheduler="synchronous")
    wanted = bf.fit_surface(np.zeros((300, 3)), np.arange(300).reshape(-1, 3)).query([[1.0, 0.0, 0.0]])
    assert found.outcome.tolist() == wanted.outcome.tolist()


def test_tiles_without_faces_are_passed_over(tmp_path: Path) -> None:
    alone = np.random.default_rng(9).uniform(5.0, 6.0, (700, 3))
    points = queries_near(STAR.vertices, 0.1)
    files = save(tmp_path, np.vstack([STAR.vertices, alone]), STAR.faces)
    found = surface_at_file(files, points, tile_vertices=256, scheduler="synchronous")
    wanted = bf.fit_surface(STAR.vertices, STAR.faces).query(points)
    assert np.abs(found.points - wanted.points).max() < 1e-6


def test_no_points_give_no_places(tmp_path: Path) -> None:
    found = surface_at_file(save(tmp_path, STAR.vertices, STAR.faces), [], tile_vertices=512, scheduler="synchronous")
    assert found.points.shape == (0, 3)


def test_bad_input_is_refused(tmp_path: Path) -> None:
    files = save(tmp_path, STAR.vertices, STAR.faces)
    with pytest.raises(InvalidParameterError, match="store: None, expected a folder"):
        surface_at_file(files, [[0.0, 0.0, 0.0]], resume=True)
    with pytest.raises(InvalidParameterError, match="points: 1 of 1"):
        surface_at_file(files, [[0.0, 0.0, np.nan]])
    with pytest.raises(InvalidParameterError, match="noise"):
        surface_at_file(files, [[0.0, 0.0, 0.0]], noise=-1.0)
    doubled = save(tmp_path, STAR.vertices, np.vstack([STAR.faces, STAR.faces[:2]]))
    with pytest.raises(InvalidMeshError, match="lie on others"):
        surface_at_file(doubled, [[0.0, 0.0, 0.0]], tile_vertices=512, scheduler="synchronous")
