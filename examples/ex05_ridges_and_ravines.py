"""Ridges and ravines of a surface, drawn as lines.

A ridge runs where the largest curvature has a maximum along its own direction: where the extremality, its derivative
along that direction, changes from positive to negative. A ravine is a ridge of the surface seen from inside. One sees
a blob with red ridges along its bumps and blue ravines along its dents, and a notched block with its sharp edges.
"""

from pathlib import Path
from typing import Any

import bezier_filters as bf
from bezier_filters.pictures.field_panels import crease_panel
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star
from common import run


def main(out: Path) -> dict[str, Any]:
    """Write crests.png; the lengths of all ridges and ravines of both shapes."""
    star = bumpy_star(resolution=60)
    shapes = {"blob": (star.vertices, star.faces), "block": block_with_sharp_edges(resolution=16)}
    lengths, panels = {}, []
    for name, (vertices, faces) in shapes.items():
        creases = bf.find_creases(vertices, faces)
        for kind in ("ridge", "ravine"):
            lengths[f"length of {kind}s, {name}"] = sum(line.length for line in creases.of_kind(kind))
        panels.append(crease_panel(vertices, faces, creases, title=f"{name}: ridges (red), ravines (blue)"))
    bf.render_panels(out / "crests.png", panels, views=["front", "iso"], size=(500, 500))
    return lengths


if __name__ == "__main__":
    run(main)
