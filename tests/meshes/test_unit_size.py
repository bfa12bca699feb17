"""A power of two changes no digit of a mesh, so none of what is found may change, at any size."""

import dataclasses
import re
from functools import cache

import numpy as np
import pymeshlab
import pytest

import bezier_filters as bf
from bezier_filters.errors import InvalidMeshError, InvalidParameterError
from bezier_filters.scale.source import open_source
from bezier_filters.scale.store import build_store
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, torus

MIDDLE = [pytest.param(exponent, marks=pytest.mark.slow) for exponent in (-90, -49, 49, 90)]
EXPONENTS = [-131, 132, *MIDDLE]  # nearly 1e-40 .. 1e40
POWERS = {"noise": 1, "radius": 1, "detail": 1, "max_perimeter": 1, "max_diameter": 1}


@cache
def shape(name):
    if name == "noisy":
        star = bumpy_star(resolution=12, jitter=0.2)
        noise = np.random.default_rng(0).normal(scale=0.02, size=star.vertices.shape)
        return star.vertices + noise, star.faces
    if name == "holes":
        star = bumpy_star(resolution=12, jitter=0.2)
        middle = star.vertices[star.faces].mean(axis=1)
        return star.vertices, star.faces[(np.abs(middle[:, 2]) < 0.8) & (middle[:, 0] < 0.9)]
    if name == "block":
        return block_with_sharp_edges(resolution=8)
    ring = torus()
    return ring.vertices, ring.faces


CALLS = {
    "estimate": (bf.estimate_vertex_geometry, "torus", {}),
    "estimate of noise": (bf.estimate_vertex_geometry, "noisy", {"conditions": True}),
    "estimate in balls": (bf.estimate_vertex_geometry, "noisy", {"radius": 0.4}),
    "estimate with details": (bf.estimate_vertex_geometry, "noisy", {"noise": 0.02, "detail": 0.5}),
    "paper": (bf.estimate_vertex_geometry, "torus", {"smoothness": "paper"}),
    "smooth": (bf.smooth, "noisy", {}),
    "smooth known noise": (bf.smooth, "noisy", {"noise": 0.03}),
    "smooth edges": (bf.smooth, "block", {"noise": 0.001}),
    "fill": (bf.fill_holes, "holes", {"max_perimeter": 10.0, "max_diameter": 3.0, "noise": 0.01}),
    "fill as the paper": (bf.fill_holes, "holes", {"method": "paper"}),
    "creases": (bf.find_creases, "block", {}),
    "crest lines": (bf.find_creases, "torus", {"min_strength": 0.0}),
}


def quantities(result, exponent):
    """All numbers of a result, in the units of the mesh without the scale, by their place."""
    if isinstance(result, tuple):
        for k, item in enumerate(result):
            yield from ((f"{k}.{name}", value) for name, value in quantities(item, exponent))
        return
    for field in dataclasses.fields(result):
        value = getattr(result, field.name)
        if dataclasses.is_dataclass(value) or isinstance(value, tuple):
            yield from ((f"{field.name}.{name}", v) for name, v in quantities(value, exponent))
        elif isinstance(value, float | np.ndarray):
            yield field.name, value * 2.0 ** (-exponent * field.metadata.get("power of length", 0))
        else:
            yield field.name, value


@cache
def at_unit_size(call):
    """The numbers of a result, which are compared with those at every size."""
    function, name, options = CALLS[call]
    return dict(quantities(function(*shape(name), **options), 0))


@pytest.mark.parametrize("exponent", EXPONENTS)
@pytest.mark.parametrize("call", CALLS)
def test_a_power_of_two_changes_no_digit(call, exponent):
    function, name, options = CALLS[call]
    vertices, faces = shape(name)
    at_one = at_unit_size(call)
    lengths = {key: value * 2.0**exponent if key in POWERS else value for key, value in options.items()}
    scaled = dict(quantities(function(vertices * 2.0**exponent, faces, **lengths), exponent))
    assert at_one.keys() == scaled.keys()
    for key, value in at_one.items():
        np.testing.assert_array_equal(scaled[key], value, err_msg=key)


@pytest.mark.parametrize("exponent", [-100, 0, 100])
@pytest.mark.parametrize("value", [True, "2%", [0.2], -0.25, np.nan])
@pytest.mark.parametrize(
    ("function", "name"),
    [
        *((bf.estimate_vertex_geometry, name) for name in ("radius", "noise", "detail")),
        *((bf.smooth, name) for name in ("noise", "detail")),
        *((bf.fill_holes, name) for name in ("max_perimeter", "max_diameter", "noise")),
    ],
)
def test_what_is_no_length_is_refused_at_every_size(function, name, value, exponent):
    """By name, and with the value that was given."""
    vertices, faces = shape("torus")
    with pytest.raises(InvalidParameterError, match=f"^{name}: got {re.escape(repr(value))}"):
        function(vertices * 2.0**exponent, faces, **{name: value})


def test_units_of_results_are_those_of_their_lengths():
    """Against a second way: twice the size, where the functions compute as ever."""
    vertices, faces = shape("noisy")
    for call in ("estimate of noise", "smooth"):
        function, _, options = CALLS[call]
        single, double = (
            dict(quantities(function(s * vertices, faces, **options), k)) for k, s in enumerate((1.0, 2.0))
        )
        for key, value in single.items():
            np.testing.assert_array_equal(double[key], value, err_msg=key)


def test_lines_of_a_given_geometry():
    vertices, faces = shape("torus")
    lines = []
    for scale in (1.0, 2.0**80):
        geometry = bf.estimate_vertex_geometry(scale * vertices, faces, rings=2)
        lines.append(bf.find_creases(scale * vertices, faces, geometry, min_strength=0.0))
    assert len(lines[0].lines) == len(lines[1].lines)
    for one, other in zip(*(found.lines for found in lines), strict=True):
        np.testing.assert_array_equal(2.0**80 * one.points, other.points)


@pytest.mark.parametrize("exponent", [-90, 90])
def test_filters_of_any_size(exponent):
    vertices, faces = shape("noisy")
    results = []
    for scale in (1.0, 2.0**exponent):
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(vertices * scale, faces))
        bf.compute_curvature_by_bezier_patch_per_vertex(meshes)
        bf.apply_coord_bezier_patch_smoothing(meshes)
        mesh = meshes.current_mesh()
        results.append(
            (mesh.vertex_matrix() / scale, mesh.vertex_custom_scalar_attribute_array("bz_mean_curvature") * scale)
        )
    for one, other in zip(*results, strict=True):
        np.testing.assert_array_equal(one, other)


def test_tiles_refuse_sizes_that_they_cannot_compute(tmp_path):
    vertices, faces = shape("torus")
    np.save(tmp_path / "v.npy", vertices * 2.0**60)
    np.save(tmp_path / "f.npy", faces)
    with pytest.raises(InvalidMeshError, match="in tiles it must be between"):
        build_store(open_source((tmp_path / "v.npy", tmp_path / "f.npy")), tmp_path, 1 << 16)
