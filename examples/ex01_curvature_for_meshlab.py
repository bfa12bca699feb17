"""Curvature as colours that open in MeshLab.

One sees a blob with bumps and dents: red where it is convex (positive mean curvature), blue where it is dented,
light grey where it is flat or a saddle. ``curvature.ply`` holds the colours, the mean curvature as vertex quality and
all other curvatures as ``bz_*`` columns; ``curvature.png`` is the picture of it, with a colour bar in 1/length.
"""

from pathlib import Path
from typing import Any

import bezier_filters as bf
from common import arrays, load, run


def main(out: Path) -> dict[str, Any]:
    """Write curvature.ply and curvature.png; the filter's report."""
    ms = load("bumpy_star.ply")
    report = bf.compute_curvature_by_bezier_patch_per_vertex(ms, quality="mean", color=True)
    bf.save_mesh(ms, out / "curvature.ply")

    fields = bf.read_fields(out / "curvature.ply")  # the bz_* columns, too, which pymeshlab does not read
    vertices, faces = arrays(ms)
    panels = [
        bf.Panel(vertices, faces, fields[column], label=label, unit=unit, signed=True, title=label)
        for column, label, unit in [
            ("quality", "mean curvature", "1/length"),
            ("bz_gaussian_curvature", "Gaussian curvature", "1/length²"),
            ("bz_shape_index", "shape index", "no unit"),
        ]
    ]
    bf.render_panels(out / "curvature.png", panels, views=["iso"], size=(400, 400))
    return report


if __name__ == "__main__":
    run(main)
