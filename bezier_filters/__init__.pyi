from . import differential_geometry as differential_geometry
from . import surfaces as surfaces
from ._version import __version__ as __version__
from .errors import CancelledError as CancelledError
from .errors import FieldFileError as FieldFileError
from .errors import InvalidMeshError as InvalidMeshError
from .errors import InvalidParameterError as InvalidParameterError
from .errors import InvalidScriptError as InvalidScriptError
from .estimation.estimate import estimate_vertex_geometry as estimate_vertex_geometry
from .feature_lines.crease_lines import CreaseLine as CreaseLine
from .feature_lines.crease_lines import Creases as Creases
from .feature_lines.crease_lines import find_creases as find_creases
from .files.field_files import read_fields as read_fields
from .files.field_files import save_fields as save_fields
from .files.filter_scripts import ScriptStep as ScriptStep
from .files.filter_scripts import read_filter_script as read_filter_script
from .files.filter_scripts import save_filter_script as save_filter_script
from .files.texture_files import save_texture as save_texture
from .fitting.vertex_geometry import VertexGeometry as VertexGeometry
from .fitting.vertex_patch import vertex_patch as vertex_patch
from .holes.bridging import BridgingResult as BridgingResult
from .holes.bridging import bridge_holes as bridge_holes
from .holes.hole_filling import HoleFillingResult as HoleFillingResult
from .holes.hole_filling import fill_holes as fill_holes
from .holes.hole_report import HoleReport as HoleReport
from .holes.selection_replacement import ReplacedPatch as ReplacedPatch
from .holes.selection_replacement import ReplacementResult as ReplacementResult
from .holes.selection_replacement import replace_selection as replace_selection
from .inspection.deviating_regions import DeviatingRegion as DeviatingRegion
from .inspection.deviation import Deviation as Deviation
from .inspection.deviation import compare as compare
from .inspection.deviation_status import DeviationStatus as DeviationStatus
from .inspection.measures import Integrals as Integrals
from .inspection.measures import PartMeasures as PartMeasures
from .inspection.measures import SurfaceMeasures as SurfaceMeasures
from .inspection.measures import measure as measure
from .meshes.adjacency import Adjacency as Adjacency
from .meshes.adjacency import Rows as Rows
from .meshes.adjacency import vertex_adjacency as vertex_adjacency
from .meshes.diagnosis import MeshReport as MeshReport
from .meshes.diagnosis import diagnose as diagnose
from .meshes.diagnosis import inspect_mesh as inspect_mesh
from .meshes.half_edges import boundary_loops as boundary_loops
from .meshes.mesh import TriangleMesh as TriangleMesh
from .meshes.mesh import triangle_mesh as triangle_mesh
from .meshes.neighbourhoods import k_rings as k_rings
from .meshlab.bridge_filter import meshing_bridge_holes_by_bezier_patch as meshing_bridge_holes_by_bezier_patch
from .meshlab.converters import mesh_arrays as mesh_arrays
from .meshlab.converters import to_open3d as to_open3d
from .meshlab.converters import to_pyvista as to_pyvista
from .meshlab.converters import to_trimesh as to_trimesh
from .meshlab.crease_filter import (
    compute_selection_by_bezier_crease_per_edge as compute_selection_by_bezier_crease_per_edge,
)
from .meshlab.deviation_filter import (
    compute_deviation_by_bezier_patch_per_vertex as compute_deviation_by_bezier_patch_per_vertex,
)
from .meshlab.hole_filter import meshing_close_holes_by_bezier_patch as meshing_close_holes_by_bezier_patch
from .meshlab.line_filter import (
    generate_polyline_by_bezier_patch_direction as generate_polyline_by_bezier_patch_direction,
)
from .meshlab.measure_filter import get_surface_measures_by_bezier_patch as get_surface_measures_by_bezier_patch
from .meshlab.mesh_colors import color_by_quality as color_by_quality
from .meshlab.mesh_colors import save_quality_map as save_quality_map
from .meshlab.mesh_files import load_mesh as load_mesh
from .meshlab.mesh_files import save_mesh as save_mesh
from .meshlab.meshset import BezierFilterError as BezierFilterError
from .meshlab.registration import register as register
from .meshlab.registration import unregister as unregister
from .meshlab.remeshing_filter import meshing_remeshing_by_bezier_patch as meshing_remeshing_by_bezier_patch
from .meshlab.replacement_filter import (
    meshing_replace_selection_by_bezier_patch as meshing_replace_selection_by_bezier_patch,
)
from .meshlab.scripts import StepReport as StepReport
from .meshlab.scripts import run_filter_script as run_filter_script
from .meshlab.scripts import script_step as script_step
from .meshlab.subdivision_filter import (
    meshing_surface_subdivision_by_bezier_patch as meshing_surface_subdivision_by_bezier_patch,
)
from .meshlab.texture_filter import compute_texmap_by_bezier_patch as compute_texmap_by_bezier_patch
from .meshlab.vertex_filters import apply_coord_bezier_patch_smoothing as apply_coord_bezier_patch_smoothing
from .meshlab.vertex_filters import (
    compute_curvature_by_bezier_patch_per_vertex as compute_curvature_by_bezier_patch_per_vertex,
)
from .meshlab.vertex_filters import (
    compute_normal_by_bezier_patch_per_vertex as compute_normal_by_bezier_patch_per_vertex,
)
from .meshlab.vertex_filters import (
    compute_torsion_by_bezier_patch_per_vertex as compute_torsion_by_bezier_patch_per_vertex,
)
from .patch_surface.surface import Surface as Surface
from .patch_surface.surface import SurfacePoints as SurfacePoints
from .patch_surface.surface_fit import fit_surface as fit_surface
from .patch_surface.surface_fit import project as project
from .patch_surface.surface_fit import surface_at as surface_at
from .patches.patch import BezierPatch as BezierPatch
from .patches.patch import ParameterRectangle as ParameterRectangle
from .patches.patch_fit import PatchFit as PatchFit
from .patches.patch_fit import fit_patch as fit_patch
from .pictures.page import Page as Page
from .pictures.page import show as show
from .pictures.render import render_panels as render_panels
from .pictures.scene import Panel as Panel
from .remeshing.remeshing import RemeshingResult as RemeshingResult
from .remeshing.remeshing import remesh as remesh
from .remeshing.subdivision import SubdivisionResult as SubdivisionResult
from .remeshing.subdivision import subdivide as subdivide
from .smoothing.smooth import SmoothingResult as SmoothingResult
from .smoothing.smooth import smooth as smooth
from .status import FitStatus as FitStatus
from .surface_lines.curve_geometry import CurveGeometry as CurveGeometry
from .surface_lines.curve_geometry import curve_geometry as curve_geometry
from .surface_lines.lines import LineEnd as LineEnd
from .surface_lines.lines import SurfaceLine as SurfaceLine
from .surface_lines.lines import SurfaceLines as SurfaceLines
from .surface_lines.lines import trace_lines as trace_lines
from .surface_lines.umbilics import Umbilic as Umbilic
from .surface_lines.umbilics import find_umbilics as find_umbilics
from .textures.bake import BakedTexture as BakedTexture
from .textures.bake import bake_texture as bake_texture
