"""The bunny's bottom: holes that a real scan left.

One sees the bunny of pymeshlab from below, with the holes that the scanner could not reach; filled with the paper's
single patch for each; and filled by default, where the fill continues the surface around it. New faces are orange.
"""

from pathlib import Path
from typing import Any

import numpy as np

import bezier_filters as bf
from bezier_filters.meshlab.meshset import bunny_path
from common import flat_panel, run

OLD, NEW = (0.75, 0.75, 0.75), (1.0, 0.6, 0.2)


def main(out: Path) -> dict[str, Any]:
    """Write bottom.png; how many holes there are, how many were filled, and the angles along their rims."""
    vertices, faces = bf.mesh_arrays(bunny_path().with_name("bunny10k_textured.obj"))
    paper, automatic = bf.fill_holes(vertices, faces, "paper"), bf.fill_holes(vertices, faces)
    panels = [flat_panel(vertices, faces, "the scan")]
    for title, result in [("the paper's patches", paper), ("automatic", automatic)]:
        new = np.arange(len(result.faces)) >= len(faces)  # old faces stay the first
        panels.append(flat_panel(result.vertices, result.faces, title, np.where(new[:, None], NEW, OLD)))
    bf.render_panels(out / "bottom.png", panels, views=["bottom"], size=(500, 500), up="y")
    angles = {
        f"mean angle along the rims, {title} [degrees]": float(
            np.mean([hole.rim_dihedral for hole in result.holes if hole.filled])
        )
        for title, result in [("paper", paper), ("automatic", automatic)]
    }
    return {"holes": len(automatic.holes), "filled": automatic.filled, "filled by the paper": paper.filled} | angles


if __name__ == "__main__":
    run(main)
