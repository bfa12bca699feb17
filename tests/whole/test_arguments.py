"""Arguments of the wrong kind, at every parameter of every public function: the package's own error, or sense."""

import inspect

import numpy as np
import pymeshlab
import pytest
from command_line import run

import bezier_filters as bf
from bezier_filters.surfaces import torus

SHAPE = torus(resolution=8)
VERTICES, FACES = SHAPE.vertices, SHAPE.faces
OWN = (bf.InvalidMeshError, bf.InvalidParameterError, bf.InvalidScriptError, bf.FieldFileError, bf.BezierFilterError)
# none of these is right for any parameter, but for texts, which are paths
WRONG = {
    "complex": 1 + 2j,
    "dict of texts": {"a": "b"},
    "lists of unequal length": [[1, 2], [3]],
    "complex numbers": np.ones((len(VERTICES), 3)) * 1j,
    "texts": VERTICES.astype(str),
    "dates": FACES.astype("datetime64[s]"),
    "numbers beyond floats": [[0, 1, 10**400]],
    "object": object(),
    "function": lambda: None,
    "bytes": b"ab",
    "set": {1, 2},
}


def meshset():
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(VERTICES, FACES))
    return ms


def right(name, folder):
    """Arguments that a function takes."""
    mesh = bf.triangle_mesh(VERTICES, FACES)
    if "ms" in (known := inspect.signature(getattr(bf, name)).parameters):
        return {"ms": meshset()} | ({"path": folder / "a.ply"} if name == "save_mesh" else {})
    found = {
        "boundary_loops": {"mesh": mesh},
        "vertex_adjacency": {"mesh": mesh},
        "inspect_mesh": {"mesh": mesh},
        "diagnose": {"mesh": mesh},
        "k_rings": {"adjacency": bf.vertex_adjacency(mesh), "rings": 2},
        "mesh_arrays": {"mesh": (VERTICES, FACES)},
        "replace_selection": {"vertices": VERTICES, "faces": FACES, "selected": np.arange(len(FACES)) == 3},
        "bake_texture": {"vertices": VERTICES, "faces": FACES, "texture_coordinates": VERTICES[:, :2]},
        "save_texture": {"path": folder / "a.png", "texture": None},
        "vertex_patch": {"vertices": VERTICES, "faces": FACES, "vertex": 3},
        "fit_patch": {"points": VERTICES[:40], "origin": VERTICES[0], "axes": np.eye(3)},
        "save_fields": {"path": folder / "a.npz", "geometry": None},
        "read_fields": {"path": folder / "a.npz"},
        "load_mesh": {"path": folder / "a.ply"},
        "read_filter_script": {"path": folder / "a.mlx"},
        "save_filter_script": {"path": folder / "a.mlx", "steps": []},
    }
    return found.get(name) or {key: value for key, value in (("vertices", VERTICES), ("faces", FACES)) if key in known}


FUNCTIONS = [
    "estimate_vertex_geometry",
    "smooth",
    "fill_holes",
    "replace_selection",
    "bridge_holes",
    "bake_texture",
    "subdivide",
    "remesh",
    "find_creases",
    "triangle_mesh",
    "boundary_loops",
    "vertex_adjacency",
    "inspect_mesh",
    "diagnose",
    "k_rings",
    "mesh_arrays",
    "vertex_patch",
    "fit_patch",
    "to_pyvista",
    "to_trimesh",
    "save_fields",
    "save_texture",
    "read_fields",
    "load_mesh",
    "save_mesh",
    "read_filter_script",
    "save_filter_script",
    "compute_curvature_by_bezier_patch_per_vertex",
    "compute_normal_by_bezier_patch_per_vertex",
    "compute_torsion_by_bezier_patch_per_vertex",
    "compute_selection_by_bezier_crease_per_edge",
    "generate_polyline_by_bezier_patch_direction",
    "apply_coord_bezier_patch_smoothing",
    "meshing_close_holes_by_bezier_patch",
    "meshing_replace_selection_by_bezier_patch",
    "meshing_bridge_holes_by_bezier_patch",
    "compute_texmap_by_bezier_patch",
    "meshing_surface_subdivision_by_bezier_patch",
    "meshing_remeshing_by_bezier_patch",
    "get_surface_measures_by_bezier_patch",
]
UNCHECKED = {"progress", "colorrange", "percentile"}  # what is called; what counts only where there are colours


@pytest.mark.parametrize("name", FUNCTIONS)
def test_arguments_of_the_wrong_kind_are_refused(name, tmp_path):
    function = getattr(bf, name)
    arguments = right(name, tmp_path)
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name in UNCHECKED or parameter.kind is parameter.VAR_KEYWORD:
            continue
        for kind, value in WRONG.items():
            text = refusal(lambda value=value, key=parameter.name: function(**arguments | {key: value}))
            assert len(text) > 20, f"{parameter.name}, {kind}: {text or 'was taken'}"


def refusal(call):
    """The message with which a call is refused, empty if it is not."""
    try:
        call()
    except OWN as error:
        return str(error)
    return ""


def test_the_examples_of_the_report(tmp_path):
    with pytest.raises(bf.InvalidMeshError, match=r"got ndarray, expected a TriangleMesh.*vertices and faces"):
        bf.boundary_loops(FACES)
    assert len(bf.boundary_loops(VERTICES, FACES[1:])) == 1
    with pytest.raises(bf.InvalidParameterError, match=r"geometry: got dict, expected a VertexGeometry"):
        bf.save_fields(tmp_path / "a.npz", {"k_min": VERTICES[:, 0]})
    assert not (tmp_path / "a.npz").exists()
    with pytest.raises(bf.InvalidMeshError, match=r"faces: got None.*needs a surface") as caught:
        bf.fill_holes(VERTICES, None)
    assert "polygons" not in str(caught.value)
    for vertices in (VERTICES.astype(str), VERTICES * 1j, VERTICES > 0.0, VERTICES.astype(str).tolist()):
        with pytest.raises(bf.InvalidMeshError, match=r"vertices: expected real numbers .*dtype"):
            bf.estimate_vertex_geometry(vertices, FACES)
    hidden = np.ma.masked_array(VERTICES, mask=np.zeros_like(VERTICES, dtype=bool))
    assert bf.triangle_mesh(hidden, FACES).vertex_count == len(VERTICES)
    hidden[3, 0] = np.ma.masked
    with pytest.raises(bf.InvalidMeshError, match="masked"):
        bf.triangle_mesh(hidden, FACES)


@pytest.mark.parametrize("value", [10**6, 10**30, True, 2.5, "many", [2]])
@pytest.mark.parametrize("name", ["estimate_vertex_geometry", "vertex_patch", "find_creases", "k_rings"])
def test_numbers_of_rings_are_refused_by_their_limit(name, value, tmp_path):
    function = getattr(bf, name)
    if "rings" in inspect.signature(function).parameters:
        with pytest.raises(bf.InvalidParameterError, match=r"rings: got .*, expected an integer"):
            function(**right(name, tmp_path) | {"rings": value})


def test_the_command_line_names_the_limit_of_rings(tmp_path):
    ms = meshset()
    bf.save_mesh(ms, tmp_path / "a.ply")
    result = run("curvature", tmp_path / "a.ply", tmp_path / "b.ply", "--rings", "1000000")
    assert result.returncode == 2
    assert "rings: got 1000000, expected an integer from 1 to 1000" in result.stderr
    assert "memory" not in result.stderr


@pytest.mark.parametrize("number", [np.float32(0.01), np.int64(1), 10**30, True])
def test_numbers_of_every_kind(number):
    """Integers of any size and NumPy's numbers are numbers; truth values are none."""
    if number is True:
        with pytest.raises(bf.InvalidParameterError, match="noise: got True, expected a length"):
            bf.estimate_vertex_geometry(VERTICES, FACES, noise=number)
    else:
        assert np.isfinite(bf.estimate_vertex_geometry(VERTICES, FACES, noise=number).mean_curvature).all()
    with pytest.raises(bf.InvalidParameterError, match=r"noise: got .*, expected a length"):
        bf.estimate_vertex_geometry(VERTICES, FACES, noise=10**400)
