"""Draws the picture of docs/holes.md: python docs/images/holes.py MESH, with the Stanford bunny, whose bottom is open.

Faces are drawn flat, one by one; the new ones are orange.
"""

import sys
from pathlib import Path

import numpy as np
import pymeshlab

import bezier_filters as bf
from bezier_filters.pictures.render import render_panels
from bezier_filters.pictures.scene import Panel

FOLDER = Path(__file__).parent
OLD, NEW = (0.75, 0.75, 0.75), (0.95, 0.6, 0.1)


def flat_panel(vertices: np.ndarray, faces: np.ndarray, old: int, title: str) -> Panel:
    """A mesh whose faces share no vertices, in the colour of new ones from number `old` on."""
    corners = np.ascontiguousarray(vertices[faces].reshape(-1, 3))
    colors = np.repeat([OLD, NEW], [3 * old, 3 * (len(faces) - old)], axis=0)
    return Panel(corners, np.arange(faces.size, dtype=np.int32).reshape(-1, 3), colors=colors, title=title)


def draw(path: Path) -> None:
    """Write the picture of one mesh, seen from below."""
    meshset = pymeshlab.MeshSet()
    meshset.load_new_mesh(str(path))
    mesh = meshset.current_mesh()
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix().astype(np.int32)
    result = bf.fill_holes(vertices, faces)
    for hole in result.holes:
        print(
            f"{hole.edge_count} edges: {hole.method}, {len(hole.new_faces)} faces, rim {hole.rim_dihedral:.1f} degrees"
        )
    meshset.meshing_close_holes(maxholesize=len(faces))
    theirs = meshset.current_mesh()
    panels = [
        flat_panel(vertices, faces, len(faces), "open"),
        flat_panel(theirs.vertex_matrix(), theirs.face_matrix().astype(np.int32), len(faces), "MeshLab's close holes"),
        flat_panel(result.vertices, result.faces, len(faces), "filled"),
    ]
    render_panels(FOLDER / f"holes_{path.stem}.png", panels, views=("bottom",), size=(450, 450))


if __name__ == "__main__":
    for name in sys.argv[1:]:
        draw(Path(name))
