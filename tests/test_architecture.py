"""The imports point one way, and importing the package is cheap."""

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import bezier_filters

PACKAGE = Path(bezier_filters.__file__).parent
LAYERS = """
_version arrays errors status bernstein dense lean parallel compilation atomic color_range palettes html_tables
supervision memory_limit interrupts ply_header
mesh polynomials smoothness patch differential_geometry jets vertex_geometry surfaces
adjacency boundary fields harmonics spatial_order mesh_edges polylines line_files
sharp_edges crest_segments
neighbourhoods frames fitting uncertainty diagnosis ply_columns orientation lanes
creases kernel_input lane_algebra condition
loop_geometry self_intersections loop_triangulation surroundings implicit_surface variational_fill
hole_detection fill_topology hole_result evening
hole_choice smooth_fill flat_fill rim_creases
paper_fill sub_holes
crease_curves
fill_placement
lane_workspace lane_errors lane_frames lane_results local_frames vertex_patch field_files point_cloud
filter_scripts
scalar_kernel lane_kernel
neighbourhood_samples
ring_lanes
ring_reference
ring_analysis
surface_model
predicted_errors
plans
model_tree
learning
fallbacks
adaptive_fit ball_fit first_call
outliers
estimation worker_processes
scale
baselines crease_lines
laplacian volume flips normal_filter mesh_parts
chebyshev
scale_space vertex_update
clusters
stein noise_levels
low_pass
surface_estimates
automatic_smoothing smoothing_result
smoothing
crease_fill
fill_methods
hole_filling
meshset
mesh_headers
mesh_attributes mesh_colors mesh_coordinates mesh_files texture_growth
mesh_growth converters
vertex_output
vertex_filter
filters smoothing_filter hole_filter crease_filter
registration
script_values
script_runner
rendering sheets
render crease_pictures
viewing
pictures demo console cli_options cli_app
cli_files
cli_filters cli_creases cli_pictures cli_scale cli_script
cli_batch
cli
__main__
"""
"""Modules, one layer a line: a module imports only from its own layer and those above it."""


def imports_of(path):
    """Modules of the package that a module imports anywhere in its code."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module == "bezier_filters":
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("bezier_filters."):
            found.add(node.module.split(".")[1])
        elif isinstance(node, ast.Import):
            found.update(a.name.split(".")[1] for a in node.names if a.name.startswith("bezier_filters."))
    return found


def package_imports():
    """Every module, or subpackage as a whole, with the modules that it imports."""
    found = {}
    for path in PACKAGE.rglob("*.py"):
        name = path.relative_to(PACKAGE).with_suffix("").parts[0]
        if name != "__init__":
            found.setdefault(name, set()).update(imports_of(path) - {name})
    return found


def test_no_import_points_upwards():
    level = {name: k for k, layer in enumerate(LAYERS.split("\n")) for name in layer.split()}
    for name, imported_names in package_imports().items():
        for imported in imported_names:
            assert level[imported] <= level[name], f"{name} must not import {imported}"


def test_there_are_no_import_cycles():
    TopologicalSorter(package_imports()).prepare()


def test_one_module_imports_pymeshlab():
    importing = [
        path.stem
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Import | ast.ImportFrom) and "pymeshlab" in ast.unparse(node)
    ]
    assert importing == ["meshset"]


def run(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def test_importing_the_package_loads_neither_pymeshlab_nor_numba():
    loaded = run("import sys, bezier_filters; print(*sys.modules)").split()
    assert "pymeshlab" not in loaded
    assert "numba" not in loaded


def test_estimating_loads_no_pymeshlab():
    code = "import sys, bezier_filters; bezier_filters.estimate_vertex_geometry; print(*sys.modules)"
    assert "pymeshlab" not in run(code).split()


def test_every_public_name_exists():
    for name in bezier_filters.__all__:
        assert getattr(bezier_filters, name) is not None
