"""Baked maps of surfaces with known curvature and normals."""

import numpy as np
import pytest
from texture_charts import decode, points_of, separate_charts

from bezier_filters import InvalidMeshError, InvalidParameterError, bake_texture, estimate_vertex_geometry
from bezier_filters.surfaces import block_with_sharp_edges, cylinder, height_field, sphere, torus, waves
from bezier_filters.textures.bake import FLAT
from bezier_filters.textures.texels import cover_texels

BALL = sphere(radius=2.0, resolution=12)
BALL_GEOMETRY = estimate_vertex_geometry(BALL.vertices, BALL.faces)
BALL_CHARTS = separate_charts(BALL.faces)
FLAT_SHEET = height_field(lambda x, y: (0.25 * x, 0.25, 0, 0, 0, 0), resolution=8, jitter=0.2)
SHEET_COORDINATES = 0.1 + 0.4 * (FLAT_SHEET.vertices[:, :2] + 1.0)


def bake_ball(map="curvature", **options):
    return bake_texture(BALL.vertices, BALL.faces, BALL_CHARTS, map, geometry=BALL_GEOMETRY, **{"size": 256} | options)


@pytest.mark.parametrize(
    ("map", "value"), [("curvature", 0.5 + 0.5 * 0.8), ("convexity", 0.8), ("cavity", 1.0)], ids=str
)
def test_a_ball_has_one_grey(map, value):
    """Its curvature is 1/2, so with a scale of 1.6 it is at four fifths of saturation."""
    baked = bake_ball(map, scale=1.6)
    np.testing.assert_allclose(baked.image[baked.covered], value, atol=2e-3)
    assert baked.scale == 1.6


@pytest.mark.parametrize(
    ("map", "value"), [("curvature", 0.5 - 0.5 * 0.8), ("convexity", 0.0), ("cavity", 0.2)], ids=str
)
def test_the_inside_of_a_ball_is_concave(map, value):
    baked = bake_texture(BALL.vertices, BALL.faces[:, ::-1], BALL_CHARTS[:, ::-1], map, size=256, scale=1.6)
    np.testing.assert_allclose(baked.image[baked.covered], value, atol=2e-3)


@pytest.mark.parametrize("map", FLAT)
def test_a_plane_is_flat(map):
    baked = bake_texture(FLAT_SHEET.vertices, FLAT_SHEET.faces, SHEET_COORDINATES, map, size=128)
    np.testing.assert_allclose(baked.image, np.broadcast_to(np.squeeze(FLAT[map]), baked.image.shape), atol=1e-6)
    assert 0.5 < baked.covered.mean() < 0.8


def test_a_cylinder_saturates_at_its_radius():
    tube = cylinder(radius=0.5)
    charts = separate_charts(tube.faces)
    geometry = estimate_vertex_geometry(tube.vertices, tube.faces)
    for scale, value in ((0.25, 0.75), (0.5, 1.0), (2.0, 1.0)):
        baked = bake_texture(tube.vertices, tube.faces, charts, size=256, scale=scale, geometry=geometry)
        np.testing.assert_allclose(baked.image[baked.covered], value, atol=5e-3)


def test_a_torus_has_its_curvature_at_every_texel():
    """Its k_max is 1/r, and its other curvature is cos(b) / (R + r cos(b)); the faces span 10 degrees."""
    ring = torus(major_radius=1.0, minor_radius=0.4, resolution=36)
    charts = separate_charts(ring.faces)
    baked = bake_texture(ring.vertices, ring.faces, charts, size=1024, scale=0.3)
    x, y, z = points_of(texels := cover_texels(charts, 1024), ring.vertices, ring.faces).T
    cosine = np.cos(np.arctan2(z, np.hypot(x, y) - 1.0))
    other = cosine / (1.0 + 0.4 * cosine)
    expected = 0.5 + 0.15 * (2.5 + np.minimum(other, 0.0))
    np.testing.assert_allclose(baked.image.ravel()[texels.places], expected, atol=2e-3)
    assert expected.min() < 0.65 < 0.87 < expected.max()


def test_sharp_edges_are_lines():
    """White along convex edges and black along concave ones, flat at the vertices next to them."""
    vertices, faces = block_with_sharp_edges(resolution=8)
    charts = separate_charts(faces)
    baked = bake_texture(vertices, faces, charts, size=1024)
    points = points_of(texels := cover_texels(charts, 1024), vertices, faces)
    found = baked.image.ravel()[texels.places]
    middle = np.abs(points[:, 2]) < 0.2
    outer = (np.abs(points[:, :2] - [-0.5, 0.5]).max(axis=1) < 0.01) & middle
    inner = (np.abs(points[:, :2]).max(axis=1) < 0.01) & (points[:, 2] > 0.2)
    flat = (np.abs(points - [-0.5, -0.25, -0.25]).max(axis=1)) < 0.05
    assert min(outer.sum(), inner.sum(), flat.sum()) > 20
    assert found[outer].min() > 0.9
    assert found[inner].max() < 0.1
    np.testing.assert_allclose(found[flat], 0.5, atol=1e-6)


def test_convex_edges_and_corners_make_no_dark_spots():
    vertices, faces = block_with_sharp_edges(resolution=8, jitter=0.2)
    charts = separate_charts(faces)
    baked = bake_texture(vertices, faces, charts, "cavity", size=1024)
    points = points_of(texels := cover_texels(charts, 1024), vertices, faces)
    found = baked.image.ravel()[texels.places]
    is_far = np.abs(points).min(axis=1) + (points < -0.2).any(axis=1) > 0.2  # from the notch
    assert is_far.sum() > 0.3 * len(points)
    np.testing.assert_allclose(found[is_far], 1.0, atol=1e-6)
    assert found.min() == 0.0


def test_rims_do_not_bleed():
    """Each chart has a value of its own, which all texels within the padding of it have, and none of the others."""
    values = np.repeat(np.linspace(0.1, 0.9, 4), 2)  # curvatures of four triangles, at the scale 1
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    vertices = np.vstack([corners + np.array([2.0 * k, 0, 0]) for k in range(8)])
    faces = np.arange(24).reshape(-1, 3)
    known = estimate_vertex_geometry(vertices, faces)
    curvature = np.repeat(values, 3)
    geometry = type(known)(
        **{
            **{
                name: getattr(known, name)
                for name in known.__dataclass_fields__
                if known.__dataclass_fields__[name].init
            },
            "k_max": curvature,
            "k_min": curvature,
            "status": np.zeros(24, dtype=np.int32),
        }
    )
    charts = separate_charts(faces, margin=0.2)
    baked = bake_texture(vertices, faces, charts, "convexity", size=240, scale=1.0, padding=8, geometry=geometry)
    cell = 80
    for k, value in enumerate(values):
        column, row = np.divmod(k, 3)
        part = baked.image[240 - (row + 1) * cell : 240 - row * cell, column * cell : (column + 1) * cell]
        inside = baked.covered[240 - (row + 1) * cell : 240 - row * cell, column * cell : (column + 1) * cell]
        assert inside.sum() > 500
        assert set(np.unique(part)) == {np.float32(0.0), np.float32(value)}
        assert (part > 0).sum() > inside.sum() + 8 * 100


def coarse_normal_map(**options):
    ring = torus(major_radius=1.0, minor_radius=0.4, resolution=24)
    charts = separate_charts(ring.faces)
    baked = bake_texture(ring.vertices, ring.faces, charts, "normal", size=512, padding=0, **options)
    return ring, charts, baked


def test_a_normal_map_makes_a_coarse_mesh_look_like_its_surface():
    """Decoded with axes from first principles: each chart is one face, with a tangent along its first edge."""
    ring, charts, baked = coarse_normal_map(normals=None)
    texels = cover_texels(charts, 512)
    points = points_of(texels, ring.vertices, ring.faces)
    circle = points * [1.0, 1.0, 0.0]
    expected = points - circle / np.linalg.norm(circle, axis=1, keepdims=True)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)

    corner_normals = np.zeros_like(ring.vertices)  # as programs shade: by angle
    a, b, c = (ring.vertices[ring.faces[:, k]] for k in range(3))
    own = np.cross(b - a, c - a)
    own /= np.linalg.norm(own, axis=1, keepdims=True)
    for k, (p, q, r) in enumerate(((a, b, c), (b, c, a), (c, a, b))):
        cosine = np.einsum("fj,fj->f", q - p, r - p) / np.linalg.norm(q - p, axis=1) / np.linalg.norm(r - p, axis=1)
        np.add.at(corner_normals, ring.faces[:, k], np.arccos(cosine)[:, np.newaxis] * own)
    corner_normals /= np.linalg.norm(corner_normals, axis=1, keepdims=True)
    corner_normals = corner_normals[ring.faces]
    along = (b - a)[:, np.newaxis] - np.einsum("fj,fcj->fc", b - a, corner_normals)[..., np.newaxis] * corner_normals
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    normal, tangent = (np.einsum("kc,kcj->kj", texels.weights, each[texels.faces]) for each in (corner_normals, along))
    x, y, z = decode(baked.image.reshape(-1, 3)[texels.places]).T[..., np.newaxis]
    decoded = x * tangent + y * np.cross(normal, tangent) + z * normal
    decoded /= np.linalg.norm(decoded, axis=1, keepdims=True)
    smooth = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    error, before = (np.linalg.norm(each - expected, axis=1) for each in (decoded, smooth))
    assert np.sqrt(np.square(error).mean()) < 0.25 * np.sqrt(np.square(before).mean())
    assert np.quantile(error, 0.99) < 0.5 * np.quantile(before, 0.99)


def test_directx_flips_green():
    _, _, opengl = coarse_normal_map()
    _, _, directx = coarse_normal_map(directx=True)
    np.testing.assert_allclose(directx.image[..., 1], 1.0 - opengl.image[..., 1], atol=1e-7)
    np.testing.assert_array_equal(directx.image[..., ::2], opengl.image[..., ::2])


def test_green_is_up_where_the_surface_leans_to_the_top_of_the_image():
    """A ridge along u: the shading normals of a plane, and normals that lean to +v on the far side of it."""
    ridge = height_field(lambda x, y: (-0.3 * y**2, 0, -0.6 * y, 0, 0, -0.6), resolution=12)
    up = np.broadcast_to([0.0, 0.0, 1.0], ridge.vertices.shape)
    coordinates = 0.5 * (ridge.vertices[:, :2] + 1.0)
    baked = bake_texture(ridge.vertices, ridge.faces, coordinates, "normal", size=64, normals=up)
    slope = 0.6 * (1.0 - 2.0 * (np.arange(64) + 0.5) / 64)  # -dz/dy of the rows
    expected = 0.5 + 0.5 * slope / np.hypot(1.0, slope)
    np.testing.assert_allclose(baked.image[..., 1].mean(axis=1), expected, atol=3e-3)
    np.testing.assert_allclose(baked.image[..., 0], 0.5, atol=3e-3)


def test_counts_say_what_an_image_cannot_show():
    charts = BALL_CHARTS.copy()
    charts[3] = charts[2]  # stacked
    charts[5] = charts[5, ::-1]  # mirrored
    charts[7] += [2.0, 0.0]  # beyond the image, where it repeats
    charts[9] = charts[9, :1]  # a point
    charts[11] = 0.5 + 1e-7 * (charts[11] - charts[11, 0])  # smaller than a texel
    baked = bake_texture(BALL.vertices, BALL.faces, charts, size=256, geometry=BALL_GEOMETRY)
    assert baked.mirrored_faces == baked.outside_faces == baked.faces_without_area == 1
    assert baked.faces_without_texels == 2  # the stacked and the small one
    assert baked.overlapping_texels == (cover_texels(charts[2:3], 256).places.size)
    assert repr(baked).startswith("BakedTexture(curvature, 256 x 256 texels, ")


def test_the_default_scale_saturates_few_vertices():
    shape = waves()
    baked = bake_texture(shape.vertices, shape.faces, shape.vertices[:, :2] / 4 + 0.5, size=64)
    strongest = np.maximum(np.abs(baked.geometry.k_min), np.abs(baked.geometry.k_max))
    assert (strongest * baked.scale > 1.0).mean() == pytest.approx(0.02, abs=0.005)


@pytest.mark.parametrize("factor", [1e-3, 1e30])
def test_maps_do_not_depend_on_the_size_of_the_mesh(factor):
    scaled = bake_texture(BALL.vertices * factor, BALL.faces, BALL_CHARTS, size=64, scale=1.6 * factor)
    np.testing.assert_allclose(scaled.image, bake_ball(size=64, scale=1.6).image, atol=1e-5)
    assert scaled.scale == 1.6 * factor


def test_runs_repeat_to_the_bit():
    first, second = (bake_ball("normal", threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(first.image, second.image)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"map": "bump"}, r"map: got 'bump', expected one of curvature, cavity, convexity"),
        ({"size": 0}, r"size: got 0, expected an integer from 1 to 8192"),
        ({"scale": 0.0}, r"scale: got 0\.0, expected a positive length"),
        ({"padding": -1}, r"padding: got -1, expected an integer from 0"),
        ({"texture_coordinates": None}, r"texture_coordinates: got None, expected finite numbers of shape"),
        ({"texture_coordinates": np.zeros((4, 2))}, r"texture_coordinates: got shape \(4, 2\)"),
        ({"texture_coordinates": np.full((len(BALL.vertices), 2), np.nan)}, r"texture_coordinates: some are NaN"),
        ({"texture_coordinates": np.zeros((len(BALL.vertices), 2))}, r"no face has an area in the texture; unwrap"),
        ({"normals": np.zeros((2, 3))}, r"normals: got shape \(2, 3\)"),
    ],
)
def test_bad_parameters_are_refused(options, message):
    given = {"texture_coordinates": BALL_CHARTS, "map": "normal"} | options
    with pytest.raises(InvalidParameterError, match=message):
        bake_texture(BALL.vertices, BALL.faces, **given)


def test_a_mesh_of_another_geometry_or_without_faces_is_refused():
    with pytest.raises(InvalidParameterError, match=r"geometry: got .* vertices, expected the 3 of the mesh"):
        bake_texture([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], np.eye(3)[:, :2], geometry=BALL_GEOMETRY)
    with pytest.raises(InvalidMeshError, match=r"faces: got none"):
        bake_texture(BALL.vertices, np.zeros((0, 3), dtype=int), np.zeros((0, 3, 2)))
