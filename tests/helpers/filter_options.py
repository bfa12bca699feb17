"""Options with which each filter learns nothing and repeats little, for tests of what does not depend on them."""

import pymeshlab

GIVEN_FIT = {"rings": 2, "alpha": 0.8}
WITHOUT_NOISE = {"noise": 0.0}

QUICK_OPTIONS = {
    "apply_coord_bezier_patch_smoothing": {"noise": 0.01},  # without noise vertices stay where they are
    "meshing_close_holes_by_bezier_patch": WITHOUT_NOISE,
    "compute_normal_by_bezier_patch_per_vertex": GIVEN_FIT,
    "compute_curvature_by_bezier_patch_per_vertex": GIVEN_FIT,
    "compute_torsion_by_bezier_patch_per_vertex": GIVEN_FIT,
    "compute_selection_by_bezier_crease_per_edge": WITHOUT_NOISE,
    "generate_polyline_by_bezier_patch_direction": WITHOUT_NOISE | {"spacing": pymeshlab.PercentageValue(10.0)},
    "meshing_replace_selection_by_bezier_patch": WITHOUT_NOISE,
    "meshing_bridge_holes_by_bezier_patch": WITHOUT_NOISE,
    "compute_texmap_by_bezier_patch": GIVEN_FIT | {"size": 64},
    "meshing_surface_subdivision_by_bezier_patch": WITHOUT_NOISE,
    "meshing_remeshing_by_bezier_patch": WITHOUT_NOISE | {"iterations": 1},
    "compute_deviation_by_bezier_patch_per_vertex": WITHOUT_NOISE | {"refnoise": 0.0},
    "get_surface_measures_by_bezier_patch": WITHOUT_NOISE | {"repeats": 2},
}


def quick_options(function):
    """The quick options of a filter."""
    return QUICK_OPTIONS[function.__name__]
