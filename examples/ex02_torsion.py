"""Principal geodesic torsion in the colours of the paper: red is high, blue medium, green low.

One sees how much geodesics twist at most: 0 (green) where both principal curvatures are equal, much (red) where the
surface bends in one direction only, or to both sides. ``torsion.ply`` opens in MeshLab with these colours.
"""

from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.colors import LinearSegmentedColormap

import bezier_filters as bf
from bezier_filters.mesh_files import save_mesh
from common import arrays, load, run

PALETTE = LinearSegmentedColormap.from_list("green_blue_red", ["lime", "blue", "red"])


def main(out: Path) -> dict[str, Any]:
    """Write torsion.ply and torsion.png; the filter's report."""
    ms = load("ellipsoid.ply")
    report = bf.compute_torsion_by_bezier_patch_per_vertex(ms)

    # The same palette as functions of the quality q for MeshLab's filter, which calls red, green and blue x, y and z.
    high = report["statistics"]["max"]
    share = f"(q / {high})"
    ms.compute_color_by_function_per_vertex(
        x=f"255 * max(0, 2 * {share} - 1)",
        y=f"255 * max(0, 1 - 2 * {share})",
        z=f"255 * (1 - abs(2 * {share} - 1))",
    )
    save_mesh(ms, out / "torsion.ply")

    if PALETTE.name not in matplotlib.colormaps:
        matplotlib.colormaps.register(PALETTE)
    look: dict[str, Any] = {"label": "geodesic torsion", "unit": "1/length", "colormap": PALETTE.name}
    panel = bf.Panel(
        *arrays(ms), ms.current_mesh().vertex_scalar_array(), limits=(0.0, high), title="ellipsoid", **look
    )
    bf.render_panels(out / "torsion.png", [panel], views=["front", "top", "iso"], size=(400, 400))
    return report


if __name__ == "__main__":
    run(main)
