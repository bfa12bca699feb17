"""Draws the pictures of docs/smoothing.md: python docs/images/smoothing.py [MESH ...].

Every mesh, and the bunny of pymeshlab, gets noise of a fifth of its mean edge, and is shown before and after.
Faces are drawn with flat shading, which shows the remaining noise.
"""

import sys
from pathlib import Path

import numpy as np
import pymeshlab

import bezier_filters as bf
from bezier_filters.pictures.render import render_panels
from bezier_filters.pictures.scene import Panel

FOLDER = Path(__file__).parent
BUNNY = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes" / "bunny.obj"
NOISE = 0.2


def flat_panel(vertices: np.ndarray, faces: np.ndarray, title: str) -> Panel:
    """A mesh whose faces share no vertices."""
    corners = np.ascontiguousarray(vertices[faces].reshape(-1, 3))
    colors = np.full((len(corners), 3), 0.75)
    return Panel(corners, np.arange(faces.size, dtype=np.int32).reshape(-1, 3), colors=colors, title=title)


def draw(path: Path) -> None:
    """Write the picture of one mesh."""
    meshset = pymeshlab.MeshSet()
    meshset.load_new_mesh(str(path))
    mesh = meshset.current_mesh()
    clean, faces = mesh.vertex_matrix(), mesh.face_matrix().astype(np.int32)
    edge = np.linalg.norm(clean[faces[:, 0]] - clean[faces[:, 1]], axis=1).mean()
    normals = bf.estimate_vertex_geometry(clean, faces, rings=1, alpha=1.0, degree=2).normals
    heights = np.random.default_rng(0).standard_normal(len(clean)) * NOISE * edge
    noisy = clean + heights[:, None] * normals
    meshset.add_mesh(pymeshlab.Mesh(noisy, faces))
    meshset.apply_coord_taubin_smoothing(stepsmoothnum=20)
    panels = [
        flat_panel(clean, faces, "clean"),
        flat_panel(noisy, faces, "with noise"),
        flat_panel(meshset.current_mesh().vertex_matrix(), faces, "MeshLab Taubin, 20 steps"),
        flat_panel(bf.smooth(noisy, faces, "paper").vertices, faces, "paper"),
        flat_panel(bf.smooth(noisy, faces).vertices, faces, "automatic"),
    ]
    render_panels(FOLDER / f"smoothing_{path.stem}.png", panels, size=(330, 330))


def main() -> None:
    """Draw the bunny and the meshes that are named."""
    for path in (BUNNY, *map(Path, sys.argv[1:])):
        draw(path)


if __name__ == "__main__":
    main()
