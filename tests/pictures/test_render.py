import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pymeshlab
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.image import imread

from bezier_filters.display import PALETTES, color_range, round_limits
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.pictures import scene
from bezier_filters.pictures.render import find_clipping, render_panels, symlog_ticks, ticks
from bezier_filters.pictures.scene import Panel
from bezier_filters.pictures.views import AXES, VIEW_NAMES, choose_orientation, view_axes

NO_FACES = np.zeros((0, 3), np.int32)
finite = st.floats(-1e100, 1e100)
fields = st.lists(finite, min_size=1, max_size=30).map(np.array)


def plane(n: int = 21, size: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Square in the plane z = 0 about the origin."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, n) * size, np.linspace(-0.5, 0.5, n) * size)
    k = np.arange(n * n).reshape(n, n)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], axis=1), faces.astype(np.int32)


def colored_box() -> Panel:
    """Box of 2 x 3 x 2.5 whose six sides have colours of their own: r, g, b for +x, +y, +z, dark for -x, -y, -z."""
    corners = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], dtype=np.float64)
    vertices, colors = [], []
    for axis in range(3):
        for sign, bright in ((1, 1.0), (-1, 0.5)):
            vertices.append(np.roll(corners * (1, 1, sign), axis + 1, axis=1) * (1.0, 1.5, 1.25))
            colors.append(np.tile(np.eye(3)[axis] * bright, (4, 1)))
    first = 4 * np.arange(6)[:, None]
    faces = np.concatenate([first + np.arange(3), first + np.array([0, 2, 3])]).astype(np.int32)
    return Panel(np.concatenate(vertices), faces, colors=np.concatenate(colors))


def read(path: Path) -> np.ndarray:
    pixels: np.ndarray = imread(path)[..., :3]
    return pixels


def draw(panel: Panel, view: str = "front", up: str = "y", scale: float = 50.0) -> np.ndarray:
    seen = scene.view_of(panel, view_axes(view, up))
    return scene.draw(panel, [seen], scale=scale, background="#ffffff")[0] / 255.0


def test_views_have_room_for_lines_that_stick_out():
    line = np.array([[0.0, 0.0, 0.0], [3.0, -2.0, 5.0]])
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    panel = Panel(vertices, np.array([[0, 1, 2]], np.int32), vertices[:, 0], lines=[(line, (0.0, 0.0, 0.0))])
    seen = scene.view_of(replace(panel, line_radius=0.5), view_axes("front", "y"))
    assert (seen.low.tolist(), seen.high.tolist()) == ([-0.5, -2.5, -0.5], [3.5, 1.0, 5.5])


# colour ranges


@given(fields, st.booleans(), st.floats(0, 49))
def test_limits_are_never_empty_and_within_the_values(values: np.ndarray, signed: bool, percentile: float) -> None:
    low, high = color_range(values, signed=signed, percentile=percentile)
    assert np.isfinite([low, high]).all()
    assert low < high
    if signed:
        assert low == -high
        assert high <= max(np.abs(values).max(), 1.0)
    elif np.ptp(values) > 1e-8 * np.abs(values).max() and np.ptp(values) > 1e-200:
        assert values.min() <= low
        assert high <= values.max()


@given(fields, st.booleans())
def test_all_values_are_within_the_full_limits(values: np.ndarray, signed: bool) -> None:
    low, high = color_range(values, signed=signed, percentile=0)
    assert low <= values.min()
    assert values.max() <= high


@given(st.floats(0.01, 100), st.integers(0, 2**32 - 1), st.booleans())
def test_limits_scale_with_the_field(factor: float, seed: int, signed: bool) -> None:
    values = np.random.default_rng(seed).normal(size=200)
    limits = color_range(values, signed=signed)
    np.testing.assert_allclose(color_range(factor * values, signed=signed), np.multiply(factor, limits))


def test_outliers_masked_values_and_infinities_do_not_count() -> None:
    values = np.concatenate([np.linspace(1, 2, 100), [1e9, np.nan, np.inf, -50.0]])
    low, high = color_range(values, signed=False, mask=values != -50)
    assert 1.0 <= low < 1.1
    assert 1.9 < high <= 2.0


@pytest.mark.parametrize(("constant", "expected"), [(2.0, (1.9, 2.1)), (-4.0, (-4.2, -3.8)), (0.0, (-1.0, 1.0))])
def test_a_constant_field_gets_a_small_range_around_it(constant: float, expected: tuple[float, float]) -> None:
    noise = 1.0 + 1e-12 * np.arange(5)
    assert color_range(constant * noise, signed=False) == pytest.approx(expected)


def test_few_different_values_are_not_hidden() -> None:
    assert color_range(np.array([0.0] * 999 + [7.0]), signed=False) == (0.0, 7.0)


@pytest.mark.parametrize("value", [5e-324, 1e-310])
def test_values_that_are_all_but_zero_count_as_zero(value: float) -> None:
    assert color_range(np.array([0.0, value]), signed=False) == (-1.0, 1.0)


def test_no_usable_value() -> None:
    assert color_range(np.array([np.nan]), signed=True) == (-1.0, 1.0)
    assert color_range(np.ones(3), signed=False, mask=np.zeros(3, bool)) == (-1.0, 1.0)
    with pytest.raises(InvalidParameterError, match="percentile: got 50"):
        color_range(np.ones(3), signed=False, percentile=50)


@given(finite, st.floats(1e-6, 1e6))
def test_round_limits_enclose_the_range_and_do_not_waste_it(low: float, width: float) -> None:
    low = low % 1e5
    start, end = round_limits(low, low + width)
    assert start <= low
    assert low + width <= end
    assert end - start <= 3 * width


@given(st.floats(1e-250, 1e250))
def test_round_limits_keep_zero_in_the_middle(high: float) -> None:
    start, end = round_limits(-high, high)
    assert start == -end
    assert high <= end <= 1.5 * high


@given(st.floats(1e-250, 1e250), st.booleans())
def test_tick_texts_tell_their_values(high: float, signed: bool) -> None:
    low = -high if signed else 0.0
    places, texts, exponent = ticks(low, high)
    assert (places[0], places[-1]) == (low, high)
    told = [float(text.replace("\N{MINUS SIGN}", "-")) * 10.0**exponent for text in texts]
    np.testing.assert_allclose(told, places, rtol=0, atol=0.005 * high)
    assert max(map(len, texts)) <= 7


# single images


def test_red_is_high_and_colours_facing_the_viewer_are_those_of_the_bar() -> None:
    vertices, faces = plane()
    values = np.where(vertices[:, 0] < 0, -1.0, 1.0)
    image = draw(Panel(vertices, faces, values, signed=True))
    height, width, _ = image.shape
    np.testing.assert_allclose(image[height // 2, width // 4], PALETTES["Cool Warm"][0], atol=0.02)
    np.testing.assert_allclose(image[height // 2, 3 * width // 4], PALETTES["Cool Warm"][-1], atol=0.02)
    assert image[height // 2, 3 * width // 4, 0] > 3 * image[height // 2, 3 * width // 4, 2]


@pytest.mark.parametrize("flip", [False, True])
def test_backs_of_faces_have_a_colour_of_their_own(flip: bool) -> None:
    vertices, faces = plane()
    front, back = (0.2, 0.7, 0.4), (0.69, 0.54, 0.42)
    colors = np.tile(front, (len(vertices), 1))
    image = draw(Panel(vertices, faces[:, ::-1] if flip else faces, colors=colors, back=back))
    height, width, _ = image.shape
    np.testing.assert_allclose(image[height // 2, width // 2], back if flip else front, atol=0.02)


@pytest.mark.parametrize("colormap", ["turbo", "coolwarm"])
@pytest.mark.parametrize("flip", [False, True])
def test_every_colour_is_faithful_whichever_way_the_faces_turn(colormap: str, flip: bool) -> None:
    vertices, faces = plane()
    image = draw(Panel(vertices, faces[:, ::-1] if flip else faces, vertices[:, 0], colormap=colormap, limits=(-1, 1)))
    row = image[len(image) // 2, scene.MARGIN_PIXELS : -scene.MARGIN_PIXELS]
    places = (np.arange(len(row)) + 0.5) / len(row)
    np.testing.assert_allclose(row, matplotlib.colormaps[colormap](places)[:, :3], rtol=0, atol=0.02)


@pytest.mark.parametrize("up", AXES)
@pytest.mark.parametrize("view", VIEW_NAMES)
def test_view_axes_are_rotations(view: str, up: str) -> None:
    axes = view_axes(view, up)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    upwards = {"x": 0, "y": 1, "z": 2}[up[-1]]
    if view not in ("top", "bottom"):
        assert axes[1, upwards] * (-1 if up[0] == "-" else 1) > 0.8


@pytest.mark.parametrize(
    ("up", "view", "side"),
    [
        *[("y", view, side) for view, side in zip(VIEW_NAMES, ["+z", "-z", "-x", "+x", "+y", "-y"], strict=False)],
        *[("z", view, side) for view, side in zip(VIEW_NAMES, ["-y", "+y", "-x", "+x", "+z", "-z"], strict=False)],
    ],
)
def test_a_view_shows_its_side_of_the_mesh(up: str, view: str, side: str) -> None:
    box = colored_box()
    image = draw(box, view, up)
    expected = np.eye(3)["xyz".index(side[1])] * (1.0 if side[0] == "+" else 0.5)
    np.testing.assert_allclose(image[len(image) // 2, image.shape[1] // 2], expected, atol=0.02)
    extent = 50 * np.abs(view_axes(view, up) @ np.array([2.0, 3.0, 2.5]))
    assert image.shape[:2] == (round(extent[1]) + 2 * scene.MARGIN_PIXELS, round(extent[0]) + 2 * scene.MARGIN_PIXELS)


@pytest.mark.parametrize(
    ("size", "convention", "expected"),
    [
        ((1.5, 1.5, 1.2), "auto", ("y", "z")),  # a bunny
        ((0.5, 0.3, 1.8), "auto", ("z", "-y")),  # a standing figure
        ((2.0, 0.3, 1.1), "auto", ("-z", "y")),  # an aeroplane with y up, seen from above
        ((1.0, 1.0, 1.2), "z", ("z", "-y")),  # a part from CAD
        ((0.5, 1.0, 1.8), "y", ("y", "x")),  # a cow, from its side
        ((2.0, 2.0, 0.1), "z", ("y", "z")),  # a plate of a part from CAD
    ],
)
def test_bodies_stand_upright(size: tuple[float, ...], convention: str, expected: tuple[str, str]) -> None:
    assert choose_orientation(np.array([[0, 0, 0], size]), NO_FACES, convention=convention) == expected


@pytest.mark.parametrize("front", AXES)
def test_sheets_are_seen_from_the_side_that_their_normals_face(front: str) -> None:
    vertices, faces = plane()
    tilted = np.stack([vertices[:, 0], vertices[:, 1], 0.3 * vertices[:, 0] + 0.2 * vertices[:, 1]], axis=1)
    right, above, towards = view_axes("front", *choose_orientation(NO_FACES.astype(float), NO_FACES, front=front))
    turned = tilted @ np.array([right, above, towards])
    assert choose_orientation(turned, faces)[1] == front
    panel = Panel(turned, faces, colors=np.full((len(vertices), 3), 0.8), back=(1.0, 0.0, 0.0))
    image = scene.draw(
        panel, [scene.view_of(panel, view_axes("front", *scene.orientation(panel)))], scale=50.0, background="#ffffff"
    )[0]
    assert np.ptp(image, axis=2).max() < 10  # no red back
    if front[-1] != "x":
        assert right.tolist() == [1.0, 0.0, 0.0]


def test_up_and_front_are_perpendicular() -> None:
    with pytest.raises(InvalidParameterError, match="expected an axis perpendicular to up"):
        choose_orientation(*plane(), "y", "-y")
    assert choose_orientation(*plane(), "z", "x") == ("z", "x")
    np.testing.assert_array_equal(view_axes("front", "z", "x"), [[0, 1, 0], [0, 0, 1], [1, 0, 0]])


def test_lines_are_not_cut_at_the_edge_of_the_picture() -> None:
    vertices, faces = plane()
    line = np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    look = {"colors": np.ones((len(vertices), 3)), "lines": [(line, (0.0, 0.0, 1.0))], "line_radius": 0.1}
    image = draw(Panel(vertices, faces, **look))
    assert (np.ptp(image[: scene.MARGIN_PIXELS - 1], axis=2) < 0.02).all()
    assert np.ptp(image[scene.MARGIN_PIXELS + 5], axis=1).max() > 0.5


@settings(max_examples=25)
@given(st.floats(1e-6, 1e6), st.floats(0.001, 0.9), st.booleans())
def test_ticks_of_symmetric_logarithms_are_round(high: float, linear: float, signed: bool) -> None:
    panel = Panel(np.eye(3), NO_FACES, np.ones(3), limits=(-high if signed else 0.0, high), linear_below=linear * high)
    found = symlog_ticks(lambda value: float(panel.norm()(value)), *panel.color_limits())
    assert 0.0 in found
    assert 2 <= len(found) <= 10
    assert all(f"{abs(value):.0e}"[0] in "0125" and float(f"{value:.0e}") == pytest.approx(value) for value in found)


def test_a_mesh_is_seen_from_the_same_side_whatever_stands_beside_it(tmp_path: Path) -> None:
    def panel(*size: float) -> Panel:
        vertices, faces = plane()
        heights = np.linspace(0, 1, len(vertices))[:, None] * np.array([0.0, 0.0, 1.0])
        return Panel((vertices + heights) * size, faces, colors=np.full((len(vertices), 3), 0.5))

    upright, sizes = panel(0.4, 0.4, 2.0), []
    for others in ([], [panel(2.0, 0.4, 1.5)]):
        render_panels(tmp_path / "a.png", [upright, *others], columns=1, size=(200, 200))
        mesh = read(tmp_path / "a.png")[..., 0] < 0.9
        rows = np.flatnonzero(mesh.any(axis=1))
        mesh = mesh[rows[0] : rows[0] + int(np.argmax(np.append(np.diff(rows), 9) > 1)) + 1]  # the upper one
        sizes.append([int(mesh.any(axis=axis).sum()) for axis in (0, 1)])
    (width, height), (beside_width, beside_height) = sizes
    assert height > 2 * width
    assert height / width == pytest.approx(beside_height / beside_width, rel=0.1)


def test_a_key_says_what_colours_stand_for(tmp_path: Path) -> None:
    vertices, faces = plane()
    look = {"colors": np.full((len(vertices), 3), 0.75)}
    sizes = []
    for names in ((), (("red", (1.0, 0.0, 0.0)), ("blue", (0.0, 0.0, 1.0)))):
        render_panels(tmp_path / "a.png", [Panel(vertices, faces, names=names, **look)], size=(200, 200))
        image = read(tmp_path / "a.png")
        sizes.append(len(image))
        for channel in (0, 2):
            patches = (image[..., channel] > 0.9) & (np.delete(image, channel, axis=2).max(axis=2) < 0.1)
            assert patches.any() == bool(names)
    assert sizes[1] > sizes[0] + 20


@pytest.mark.parametrize(("scale", "shift"), [(1e-9, 0.0), (1.0, 1e6), (1e9, 0.0)])
def test_size_and_place_of_the_mesh_do_not_matter(scale: float, shift: float) -> None:
    vertices, faces = plane()
    values = vertices[:, 0] ** 2
    reference = draw(Panel(vertices, faces, values))
    moved = draw(Panel(vertices * scale + shift, faces, values), scale=50.0 / scale)
    difference = np.abs(moved[: len(reference), : reference.shape[1]] - reference[: len(moved), : moved.shape[1]])
    assert difference.mean() < 0.005


def test_stray_vertices_are_not_seen_and_do_not_shrink_the_mesh() -> None:
    vertices, faces = plane()
    stray = Panel(np.vstack([vertices, [[1e6, 0, 0]]]), faces, np.zeros(len(vertices) + 1))
    assert draw(stray).shape == draw(Panel(vertices, faces, np.zeros(len(vertices)))).shape


def test_values_that_are_not_finite_are_grey() -> None:
    vertices, faces = plane()
    image = draw(Panel(vertices, faces, np.full(len(vertices), np.nan)))
    np.testing.assert_allclose(image[len(image) // 2, len(image) // 2], [211 / 255] * 3, atol=0.02)


# sheets


def bunny_like(**options: Any) -> Panel:
    meshes = pymeshlab.MeshSet()
    meshes.create_torus(hradius=3, vradius=1)
    meshes.compute_scalar_by_discrete_curvature_per_vertex(curvaturetype="Mean Curvature")
    mesh = meshes.current_mesh()
    texts = {"label": "mean curvature", "unit": "1/length", "signed": True} | options
    return Panel(mesh.vertex_matrix(), mesh.face_matrix(), mesh.vertex_scalar_array(), **texts)


def test_a_sheet_of_pymeshlab_curvature(tmp_path: Path) -> None:
    path = tmp_path / "sheet.png"
    panels = [bunny_like(title="one"), bunny_like(colormap="coolwarm"), bunny_like(unit="", signed=False)]
    render_panels(path, panels, views=["front", "iso"], size=(200, 200), title="A torus of $5 and a_b")
    image = read(path)
    assert 3 * 200 < image.shape[1] < 4 * 200
    assert 2 * 200 < image.shape[0] < 3 * 200
    assert (image[0] == 1.0).all()  # nothing touches the edge
    assert (image[:, 0] == 1.0).all()
    colored = np.ptp(image, axis=2) > 0.2
    assert 0.15 < colored.mean() < 0.8
    assert [item.name for item in tmp_path.iterdir()] == ["sheet.png"]


def test_all_images_have_the_same_scale(tmp_path: Path) -> None:
    path = tmp_path / "scale.png"
    panels = [Panel(*plane(size=size), colors=np.tile([1.0, 0.0, 0.0], (441, 1))) for size in (1.0, 2.0)]
    render_panels(path, panels, size=(308, 308))
    red = (np.abs(read(path) - [1.0, 0.0, 0.0]) < 0.03).all(axis=2).any(axis=0)
    widths = np.diff(np.flatnonzero(np.diff(red.astype(int))))[::2]
    np.testing.assert_allclose(widths, [150, 300], atol=2)


def test_a_single_panel_has_its_views_side_by_side(tmp_path: Path) -> None:
    sizes = []
    for columns in (None, 2):
        render_panels(
            tmp_path / "views.png", [bunny_like()], views=["front", "left", "iso"], columns=columns, size=(150, 150)
        )
        sizes.append(read(tmp_path / "views.png").shape)
    assert sizes[0][1] > sizes[1][1]
    assert sizes[0][0] < sizes[1][0]


def test_arrows_show_that_values_are_clipped() -> None:
    vertices, faces = plane()
    for limits, expected in (((-1, 1), (False, False)), ((-0.5, 2), (True, False)), ((-0.5, 0.5), (True, True))):
        assert find_clipping(Panel(vertices, faces, vertices[:, 0], limits=limits)) == expected


@pytest.mark.parametrize("background", ["white", "#202020"])
def test_points_and_constants_on_any_background(tmp_path: Path, background: str) -> None:
    path = tmp_path / "points.png"
    points = np.random.default_rng(0).normal(size=(500, 3))
    panels = [Panel(points, NO_FACES, np.full(500, 3.0), "constant"), Panel(points[:1], NO_FACES, np.zeros(1))]
    render_panels(path, panels, size=(150, 150), background=background)
    image = read(path)
    np.testing.assert_allclose(image[0, 0], matplotlib.colors.to_rgb(background), atol=0.01)
    assert (np.ptp(image, axis=2) > 0.2).mean() > 0.01


def test_long_texts_make_room_for_themselves(tmp_path: Path) -> None:
    path = tmp_path / "long.png"
    panel = bunny_like(title="a title that is much longer than the image below it is wide " * 2)
    render_panels(path, [panel], size=(100, 100))
    image = read(path)
    assert (image[:, 0] == 1.0).all()
    assert (image[:, -1] == 1.0).all()
    assert (image[:30] < 0.5).any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"views": ["frnt"]}, "view: got 'frnt', expected one of front, back"),
        ({"views": []}, "no panels or no views"),
        ({"up": "w"}, "up: got 'w', expected one of auto, x, y"),
        ({"columns": 0}, "columns: got 0"),
        ({"size": (10, 10)}, "size: got .10, 10., expected"),
        ({"size": 600}, "size: got 600, expected a width and a height"),
        ({"columns": 1.5}, "columns: got 1.5"),
        ({"views": "front"}, "views: got 'front', expected a list of names"),
        ({"views": None}, "views: got None"),
        ({"title": 5}, "title: got 5, expected a text"),
        ({"background": "no colour"}, "background: got 'no colour', expected a colour"),
    ],
)
def test_wrong_options_are_named_and_leave_the_old_picture(tmp_path: Path, options: Any, message: str) -> None:
    path = tmp_path / "old.png"
    path.write_text("old")
    with pytest.raises(InvalidParameterError, match=message):
        render_panels(path, [bunny_like()], **options)
    assert path.read_text() == "old"


def test_arrays_for_a_path_or_panels_are_refused(tmp_path: Path) -> None:
    vertices, faces = plane(3)
    with pytest.raises(InvalidParameterError, match="path: got ndarray, expected a text or a path"):
        render_panels(vertices, None)  # type: ignore[arg-type]
    wrong: list[Any] = [None, bunny_like(), faces, [vertices, faces], "ab"]
    for panels in wrong:
        with pytest.raises(InvalidParameterError, match=r"panels: got .*, expected a list of Panel"):
            render_panels(tmp_path / "a.png", panels)


def test_an_unknown_colour_map_gets_suggestions(tmp_path: Path) -> None:
    with pytest.raises(InvalidParameterError, match=r"colormap: got 'turbos', expected one of turbo, .*Cool Warm"):
        render_panels(tmp_path / "a.png", [bunny_like(colormap="turbos")])


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"values": None}, InvalidParameterError, "either values or colors"),
        ({"values": np.zeros(3)}, InvalidParameterError, r"values have the shape \(3,\), expected \(441,\)"),
        ({"values": None, "colors": np.zeros(441)}, InvalidParameterError, "colors have the shape"),
        ({"limits": (1.0, 1.0)}, InvalidParameterError, "limits .* lower one first"),
        ({"vertices": np.zeros((0, 3))}, InvalidMeshError, "vertices: got none"),
        ({"vertices": np.full((441, 3), np.nan)}, InvalidMeshError, "NaN or infinite"),
        ({"faces": np.array([[0, 1, 441]])}, InvalidMeshError, "indices run from 0 to 441, expected 0 to 440"),
        ({"faces": np.array([[0, 1, 2, 3]])}, InvalidMeshError, r"expected \(m, 3\)"),
    ],
)
def test_panels_are_checked(change: dict[str, Any], error: type[Exception], message: str) -> None:
    vertices, faces = plane()
    with pytest.raises(error, match=message):
        Panel(**{"vertices": vertices, "faces": faces, "values": np.zeros(441)} | change)


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    start = "import sys, numpy as np\nfrom bezier_filters import Panel, render_panels\n"
    start += "panel = Panel(np.eye(3), np.array([[0, 1, 2]]), np.zeros(3))\n"
    variables = {name: value for name, value in os.environ.items() if name != "DISPLAY"} | environment
    return subprocess.run([sys.executable, "-c", start + code], capture_output=True, text=True, env=variables)


def test_pictures_without_a_display_print_nothing(tmp_path: Path) -> None:
    done = run(f"render_panels({str(tmp_path / 'quiet.png')!r}, [panel], size=(99, 99))")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_missing_library_is_named_with_the_remedy(tmp_path: Path) -> None:
    done = run(f"sys.modules['pyvista'] = None\nrender_panels({str(tmp_path / 'a.png')!r}, [panel])")
    assert done.stderr.splitlines()[-1].startswith(
        "bezier_filters.pictures.scene.RenderingUnavailableError: pictures need pyvista and matplotlib: "
        'pip install "bezier-filters[viz]"'
    )
