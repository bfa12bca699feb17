"""One pipeline of MeshLab's filters and ours, as methods of the same MeshSet.

A scan with double vertices, crumbs, holes and noise is repaired by MeshLab's filters, filled and smoothed by ours,
and remeshed by MeshLab's; then the curvature is computed, and what is strongly curved is selected by an expression
that names one of our columns. One sees the scan, and the result with its mean curvature.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab

import bezier_filters as bf
from common import arrays, load, run


def scan() -> pymeshlab.MeshSet:
    """A blob with noise, a hole, a crumb beside it and vertices that are stored once for every face."""
    vertices, faces = arrays(load("bumpy_star.ply"))
    vertices = vertices + 0.008 * np.random.default_rng(0).standard_normal(vertices.shape)
    holed = faces[~(vertices[faces][..., 2] > 0.8).all(axis=1)]
    crumb = np.array([[1.3, 1.3, 0.0], [1.35, 1.3, 0.0], [1.3, 1.35, 0.0]])
    corners = np.concatenate([vertices[holed].reshape(-1, 3), crumb])
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3)))
    return ms


def main(out: Path) -> dict[str, Any]:
    """Write pipeline.ply and pipeline.png; what the steps did."""
    bf.register()
    ms = scan()
    before = arrays(ms)
    ms.meshing_remove_duplicate_vertices()
    ms.meshing_remove_connected_component_by_face_number(mincomponentsize=10)
    filled = ms.meshing_close_holes_by_bezier_patch()
    smoothed = ms.apply_coord_bezier_patch_smoothing()
    ms.meshing_isotropic_explicit_remeshing(targetlen=pymeshlab.PercentageValue(2.5), iterations=5)
    ms.compute_curvature_by_bezier_patch_per_vertex(quality="mean", color=True)
    ms.compute_selection_by_condition_per_vertex(condselect="bz_k_max > 3")
    selected = ms.current_mesh().selected_vertex_number()
    bf.save_mesh(ms, out / "pipeline.ply")

    quality = ms.current_mesh().vertex_scalar_array()
    panels = [
        bf.Panel(*before, colors=np.full((len(before[0]), 3), 0.75), title="scan"),
        bf.Panel(*arrays(ms), quality, label="mean curvature", unit="1/length", signed=True, title="result"),
    ]
    bf.render_panels(out / "pipeline.png", panels, views=["iso"], size=(450, 450))
    return {
        "holes filled": filled["closed_holes"],
        "noise before": smoothed["noise_before"],
        "noise after": smoothed["noise_after"],
        "closed": ms.get_topological_measures()["boundary_edges"] == 0,
        "selected vertices": selected,
    }


if __name__ == "__main__":
    run(main)
