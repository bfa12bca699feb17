"""Kernels say the same without the compiler; and so a debugger, and the measurement of coverage, can look into them."""

import os
import pickle
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from full_meshset import punched_torus
from numba import config
from scale_cases import save_arrays

from baselines import ouyang_feng_normals, razdan_bae
from bezier_filters import (
    boundary_loops,
    bridge_holes,
    estimate_vertex_geometry,
    fill_holes,
    replace_selection,
    smooth,
    triangle_mesh,
)
from bezier_filters.files.field_files import read_fields
from bezier_filters.meshes.self_intersections import cut_faces
from bezier_filters.scale import estimate_file, smooth_file
from bezier_filters.scale.source import open_source
from bezier_filters.surfaces import block_with_sharp_edges, sphere, waves
from open_ends import revolved, weld

pytestmark = [] if config.DISABLE_JIT else [pytest.mark.slow]


def mesh(name):
    if name == "ring":
        return punched_torus(9)
    if name == "block":
        vertices, faces = block_with_sharp_edges(resolution=4, jitter=0.2)
        return vertices, faces[4:]
    if name == "bowl":
        surface = sphere(resolution=7, jitter=0.2)
        return surface.vertices, surface.faces[(surface.vertices[surface.faces, 2] < 0.5).any(axis=1)]
    surface = {"ball": sphere, "sheet": waves}[name](resolution=4, jitter=0.2)
    return surface.vertices, surface.faces


def halves():
    """A ball with a gap around it."""
    vertices, faces = mesh("ball")
    return vertices, faces[(np.abs(vertices[faces, 2]) > 0.2).all(axis=1)]


def rings():
    """Two flat rings above each other."""
    low, high = (revolved(radii, np.full(2, z), 12) for radii, z in (([3.0, 2.0], 0.0), ([2.0, 3.0], 2.0)))
    return weld(low, high)


def inner_holes(vertices, faces):
    """Numbers of the holes inside the rings."""
    return [k for k, hole in enumerate(fill_holes(vertices, faces, holes=[]).holes) if hole.diameter < 5.0]


def noisy(name):
    vertices, faces = mesh(name)
    return vertices + 0.02 * np.random.default_rng(0).standard_normal(vertices.shape), faces


def folded(name):
    """Some vertices far off, faces turned, vertices and faces alone."""
    vertices, faces = noisy(name)
    vertices[::7] *= 1.8
    faces = np.vstack([faces, faces[:2, ::-1], [[0, 1, len(vertices)], [0, 0, 1]]])
    faces[::9] = faces[::9, ::-1]
    return np.vstack([vertices, [[3.0, 3.0, 3.0], [4.0, 4.0, 4.0]]]), faces


def in_tiles(work):
    """Columns and coordinates that a job on files writes."""
    with TemporaryDirectory() as folder:
        files = save_arrays(Path(folder), *punched_torus(13))
        work(files, Path(folder) / "out.ply", tile_vertices=256, scheduler="synchronous", workers=1)
        result = open_source(Path(folder) / "out.ply")
        return read_fields(Path(folder) / "out.ply") | {"vertices": result.vertices(0, result.vertex_count)}


CASES = {
    "automatic": lambda: estimate_vertex_geometry(*noisy("ring"), conditions=True),
    "fixed": lambda: estimate_vertex_geometry(*mesh("sheet"), rings=2, alpha=0.8, conditions=True),
    "wide": lambda: estimate_vertex_geometry(*mesh("ball"), rings=3, alpha="auto", degree=4),
    "paper": lambda: estimate_vertex_geometry(*mesh("ball"), smoothness="paper"),
    "radius": lambda: estimate_vertex_geometry(*mesh("sheet"), radius=0.6),
    "robust": lambda: estimate_vertex_geometry(*noisy("ball"), robust=True),
    "creases": lambda: estimate_vertex_geometry(*mesh("block")),
    "folded": lambda: estimate_vertex_geometry(*folded("ball"), rings=2, alpha=0.8),
    "folded automatic": lambda: estimate_vertex_geometry(*folded("ring")),
    "points": lambda: estimate_vertex_geometry(mesh("ball")[0], None, rings=2, alpha=0.8),
    "smooth": lambda: smooth(*noisy("ball")),
    "smooth a block": lambda: smooth(*noisy("block")),
    "smooth a border": lambda: smooth(*noisy("sheet")),
    "smooth, paper": lambda: smooth(*noisy("ring"), "paper", keep_volume=True),
    "fill": lambda: fill_holes(*mesh("ring"), outer_rims=True),
    "fill a bowl": lambda: fill_holes(*mesh("bowl"), outer_rims=True),
    "fill creases": lambda: fill_holes(*mesh("block"), outer_rims=True),
    "fill, paper": lambda: fill_holes(*mesh("ring"), "paper", outer_rims=True),
    "replace": lambda: replace_selection(*mesh("ball"), np.arange(len(mesh("ball")[1])) == 0, rings=1),
    "bridge": lambda: bridge_holes(*halves(), [(0, 1)]),
    "bridge, straight": lambda: bridge_holes(*rings(), [inner_holes(*rings())]),
    "razdan_bae": lambda: razdan_bae(*mesh("ball")),
    "ouyang_feng": lambda: ouyang_feng_normals(*mesh("ball")),
    "loops": lambda: boundary_loops(triangle_mesh(*mesh("sheet"))),
    "tiles": lambda: in_tiles(estimate_file),
    "smooth tiles": lambda: in_tiles(smooth_file),
    "crossings": lambda: cut_faces(*folded("ball"), 40),
}


def arrays(result):
    """The arrays of a result by name."""
    if isinstance(result, dict):
        return result
    if isinstance(result, np.ndarray):
        return {"": result}
    if isinstance(result, list | tuple):
        return {str(k): np.asarray(part) for k, part in enumerate(result)}
    found = {field.name: getattr(result, field.name) for field in fields(result)}
    return {name: values for name, values in found.items() if isinstance(values, np.ndarray)}


def everything():
    return {name: arrays(case()) for name, case in CASES.items()}


@pytest.fixture(scope="module")
def others(tmp_path_factory):
    """The arrays of all cases from another process, with the compiler if this one has none, and without if it has."""
    target = tmp_path_factory.mktemp("others") / "arrays"
    code = f"import pickle, test_plain_python as t; pickle.dump(t.everything(), open({str(target)!r}, 'wb'))"
    tests, root = Path(__file__).parents[1:3]
    folders = os.pathsep.join(
        str(folder) for folder in (tests / "whole", tests, tests / "helpers", root / "benchmarks")
    )
    without = "0" if config.DISABLE_JIT else "1"
    environment = os.environ | {"NUMBA_DISABLE_JIT": without, "PYTHONWARNINGS": "ignore", "PYTHONPATH": folders}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
    return pickle.loads(target.read_bytes())


@pytest.mark.parametrize("name", CASES)
def test_kernels_say_the_same_without_the_compiler(name, others):
    for part, values in arrays(CASES[name]()).items():
        lines = part.startswith("direction") or part.startswith("extremality")  # of either sign
        found, values = (np.abs(a) if lines else a for a in (others[name][part], values))
        if values.dtype.kind in "iub":
            np.testing.assert_array_equal(found, values, err_msg=part)
        elif not lines:  # at umbilics they are arbitrary
            scale = np.abs(values).max(initial=1e-300)
            np.testing.assert_allclose(found, values, rtol=0, atol=1e-6 * scale, err_msg=part)
