"""The fields that the paper's figures show, by its method to the letter and by ours.

One sees the bunny of pymeshlab twice, above by the paper's method (2 rings, alpha = 0.8, its smoothness), below by
default: vertex normals as colours, mean curvature, Gaussian curvature, and principal geodesic torsion in the paper's
palette, red where high, blue where medium, green where low. Above and below the colours have the same ranges. The
paper's smoothness takes away what is as small as the mesh; by default little noise is found in it, so detail stays.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import bezier_filters as bf
from bezier_filters.display import color_range, round_limits
from bezier_filters.meshlab.meshset import bunny_path
from common import run

SETTINGS: dict[str, dict[str, Any]] = {
    "paper": {"rings": 2, "alpha": 0.8, "smoothness": "paper"},
    "default": {},
}
FIELDS = (
    ("mean_curvature", "mean curvature", "1/length", "auto"),
    ("gaussian_curvature", "Gaussian curvature", "1/length²", "auto"),
    ("geodesic_torsion", "geodesic torsion", "1/length", "Paper"),
)


def main(out: Path) -> dict[str, Any]:
    """Write fields.png; how far the two agree."""
    vertices, faces = bf.mesh_arrays(bunny_path())
    found = {name: bf.estimate_vertex_geometry(vertices, faces, **options) for name, options in SETTINGS.items()}
    panels = []
    for name, g in found.items():
        panels.append(bf.Panel(vertices, faces, colors=0.5 + 0.5 * g.normals, title=f"{name}: normals"))
        for attribute, label, unit, colormap in FIELDS:
            signed = attribute != "geodesic_torsion"
            limits = round_limits(*color_range(getattr(found["default"], attribute), signed=signed, percentile=4.0))
            values = getattr(g, attribute)
            panel = bf.Panel(vertices, faces, values, label, unit, signed=signed, limits=limits, colormap=colormap)
            panels.append(replace(panel, title=f"{name}: {label}"))
    bf.render_panels(out / "fields.png", panels, columns=4, views=["front"], size=(400, 400))
    paper, default = found.values()
    cosine = np.einsum("ij,ij->i", paper.normals, default.normals).clip(-1.0, 1.0)
    return {
        "median angle between the normals [degrees]": float(np.degrees(np.median(np.arccos(cosine)))),
        "correlation of the mean curvatures": float(np.corrcoef(paper.mean_curvature, default.mean_curvature)[0, 1]),
    }


if __name__ == "__main__":
    run(main)
