"""Ridges and ravines of a surface, drawn as lines.

A ridge runs where the largest curvature has a maximum along its own direction: where the extremality, its derivative
along that direction, changes from positive to negative. A ravine is a ridge of the surface seen from inside. One sees
a blob with red ridges along its bumps and blue ravines along its dents.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pyvista

import bezier_filters as bf
from bezier_filters.surfaces import bumpy_star
from common import run

FAINTEST = 0.3
"""Curvature of the weakest line that is drawn, as a share of the strongest."""


def crest_segments(
    vertices: np.ndarray, faces: np.ndarray, curvature: np.ndarray, directions: np.ndarray, extremality: np.ndarray
) -> np.ndarray:
    """Segments (s, 2, 3) across triangles along which `curvature` has a maximum in its `directions`.

    The directions have no sign, so those at the ends of an edge are made to agree first; after that the
    extremality has a zero on the edge where its signs differ, and the curvature a maximum where it grows from both
    ends towards the zero.
    """
    tail, head = faces[:, [0, 1, 2]], faces[:, [1, 2, 0]]  # edges (m, 3) of the triangles
    agree = np.sign(np.einsum("fek,fek->fe", directions[tail], directions[head]))
    at_tail, at_head = extremality[tail], agree * extremality[head]
    along = np.einsum("fek,fek->fe", vertices[head] - vertices[tail], directions[tail])
    crossed = (at_tail * at_head < 0) & (at_tail * along > 0)
    share = np.divide(at_tail, at_tail - at_head, out=np.zeros_like(at_tail), where=crossed)[..., None]
    points = (1 - share) * vertices[tail] + share * vertices[head]
    strong = curvature[faces].min(axis=1) > FAINTEST * curvature.max()
    through = (crossed.sum(axis=1) == 2) & strong
    return points[through][crossed[through]].reshape(-1, 2, 3)


def tubes(segments: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of thin tubes around segments."""
    lines = pyvista.line_segments_from_points(segments.reshape(-1, 3)).tube(radius=radius, n_sides=6)
    mesh = lines.triangulate()
    return np.array(mesh.points, dtype=float), mesh.faces.reshape(-1, 4)[:, 1:].astype(np.int32)


def main(out: Path) -> dict[str, Any]:
    """Write crests.png; the lengths of all ridges and ravines."""
    shape = bumpy_star(resolution=60)
    g = bf.estimate_vertex_geometry(shape.vertices, shape.faces)
    ridges = crest_segments(shape.vertices, shape.faces, g.k_max, g.direction_max, g.extremality_max)
    # From inside, the smallest curvature is the largest, with the other sign.
    ravines = crest_segments(shape.vertices, shape.faces, -g.k_min, g.direction_min, -g.extremality_min)

    vertices, faces = [shape.vertices], [shape.faces]
    colors = [np.full((len(shape.vertices), 3), 0.85)]
    for segments, color in ((ridges, (0.85, 0.1, 0.1)), (ravines, (0.1, 0.2, 0.85))):
        points, triangles = tubes(segments, radius=0.008)
        faces.append(triangles + sum(map(len, vertices)))
        vertices.append(points)
        colors.append(np.tile(color, (len(points), 1)))
    panel = bf.Panel(
        np.concatenate(vertices),
        np.concatenate(faces).astype(np.int32),
        colors=np.concatenate(colors),
        title="ridges (red) and ravines (blue)",
    )
    bf.render_panels(out / "crests.png", [panel], views=["front", "iso"], size=(500, 500))
    lengths = [float(np.linalg.norm(s[:, 1] - s[:, 0], axis=1).sum()) for s in (ridges, ravines)]
    return dict(zip(("length of ridges", "length of ravines"), lengths, strict=True))


if __name__ == "__main__":
    run(main)
