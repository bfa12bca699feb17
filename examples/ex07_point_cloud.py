"""Curvature of points without faces.

One sees noisy points of a torus, coloured by their mean curvature: high on the outside, low around the hole. The points
have no normals either; the filter finds out that they lie on a closed body and which way is out.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab

import bezier_filters as bf
from bezier_filters.surfaces import torus
from common import run


def main(out: Path) -> dict[str, Any]:
    """Write points.ply and points.png; relative error of the mean curvature, and how many points look outward."""
    shape = torus(resolution=60)
    points = shape.vertices + 0.002 * np.random.default_rng(0).standard_normal(shape.vertices.shape)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(points))
    bf.compute_normal_by_bezier_patch_per_vertex(ms, quality=None)
    bf.compute_curvature_by_bezier_patch_per_vertex(ms, color=True)
    bf.save_mesh(ms, out / "points.ply")

    mesh = ms.current_mesh()
    found, truth = mesh.vertex_scalar_array(), shape.mean_curvature
    panel = bf.Panel(
        points, np.empty((0, 3), np.int32), found, label="mean curvature", unit="1/length", signed=True, title="points"
    )
    bf.render_panels(out / "points.png", [panel], views=["front", "iso"], size=(450, 450))
    outward = np.einsum("ij,ij->i", mesh.vertex_normal_matrix(), shape.normals) > 0
    return {
        "relative error": float(np.linalg.norm(found - truth) / np.linalg.norm(truth)),
        "outward": float(outward.mean()),
    }


if __name__ == "__main__":
    run(main)
