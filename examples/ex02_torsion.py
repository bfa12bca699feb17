"""Principal geodesic torsion in the colours of the paper: red is high, blue medium, green low.

One sees how much geodesics twist at most: 0 (green) where both principal curvatures are equal, much (red) where the
surface bends in one direction only, or to both sides. ``torsion.ply`` opens in MeshLab with these colours, and
``torsion.qmap`` in its Quality Mapper, where they can be changed.
"""

from pathlib import Path
from typing import Any

import bezier_filters as bf
from common import arrays, load, run


def main(out: Path) -> dict[str, Any]:
    """Write torsion.ply, torsion.qmap and torsion.png; the filter's report."""
    ms = load("ellipsoid.ply")
    report = bf.compute_torsion_by_bezier_patch_per_vertex(ms, color=True, colormap="Paper", colorrange=(0.0, 1.0))
    bf.save_mesh(ms, out / "torsion.ply")
    limits = tuple(report["color_range"])
    bf.save_quality_map(out / "torsion.qmap", *limits, "Paper")

    look: dict[str, Any] = {"label": "geodesic torsion", "unit": "1/length", "colormap": "Paper"}
    panel = bf.Panel(
        *arrays(ms), ms.current_mesh().vertex_scalar_array(), limits=limits, title="ellipsoid", histogram=True, **look
    )
    bf.render_panels(out / "torsion.png", [panel], views=["front", "top", "iso"], size=(400, 400))
    return report


if __name__ == "__main__":
    run(main)
