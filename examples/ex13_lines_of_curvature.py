"""Lines of curvature of an ellipsoid and of the bunny.

Lines of curvature run along the principal directions and cross at right angles. On an ellipsoid they are its
intersections with confocal quadrics, and go around four umbilics. On the bunny one sees them follow the ears, the neck
and the legs; they end where the surface bends alike in all directions, so that noise makes its directions. Its fur was
smoothed first, as it has lines of its own.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab

import bezier_filters as bf
from bezier_filters.meshlab.meshset import bunny_path
from bezier_filters.pictures.line_panels import line_panel
from bezier_filters.surfaces import ellipsoid
from common import arrays, run

STEPS = 30  # of Laplacian smoothing: they remove fur and keep ears
SPACING = 0.06  # of the lines; both shapes have a length of about 2


def main(out: Path) -> dict[str, Any]:
    """Write lines.png; numbers of lines and umbilics."""
    shape = ellipsoid(semi_axes=(1.0, 0.8, 0.5), resolution=24, jitter=0.2)
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(bunny_path()))
    ms.apply_coord_laplacian_smoothing(stepsmoothnum=STEPS, cotangentweight=False)
    bunny, bunny_faces = arrays(ms)
    bunny *= np.ptp(shape.vertices, axis=0).max() / np.ptp(bunny, axis=0).max()  # as large in the picture
    found, panels = {}, []
    for name, vertices, faces in (("ellipsoid", shape.vertices, shape.faces), ("bunny", bunny, bunny_faces)):
        lines = bf.trace_lines(bf.fit_surface(vertices, faces), spacing=SPACING)
        found |= {f"lines, {name}": len(lines.lines), f"umbilics, {name}": [each.index for each in lines.umbilics]}
        panels.append(line_panel(vertices, faces, lines, title=name))
    bf.render_panels(out / "lines.png", panels, views=["iso"], size=(700, 700))
    return found


if __name__ == "__main__":
    run(main)
