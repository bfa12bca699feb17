"""Draws the picture of replaced selections in docs/holes.md: python docs/images/replacement.py.

A stamp on a bent surface and a bump across the edge of a block, selected (blue) and replaced (orange).
"""

from pathlib import Path

import numpy as np

import bezier_filters as bf
from bezier_filters.pictures.render import render_panels
from bezier_filters.pictures.scene import Panel
from bezier_filters.surfaces import block_with_sharp_edges, torus

FOLDER = Path(__file__).parent
OLD, SELECTED, NEW = (0.75, 0.75, 0.75), (0.35, 0.55, 0.85), (0.95, 0.6, 0.1)
RADIUS, WIDTH = 0.22, 0.07  # of the ring of the stamp


def colored_panel(vertices: np.ndarray, faces: np.ndarray, colors: np.ndarray, title: str) -> Panel:
    """A mesh whose faces share no vertices, so that each has its colour."""
    corners = np.ascontiguousarray(vertices[faces].reshape(-1, 3))
    return Panel(
        corners, np.arange(faces.size, dtype=np.int32).reshape(-1, 3), colors=np.repeat(colors, 3, axis=0), title=title
    )


def panels(vertices: np.ndarray, faces: np.ndarray, moved: np.ndarray, noise: float, name: str) -> list[Panel]:
    """A mesh with some vertices moved, and replaced."""
    selected = (moved != 0.0).any(axis=1)[faces].any(axis=1)
    vertices = vertices + moved + noise * np.random.default_rng(0).standard_normal(moved.shape)
    result = bf.replace_selection(vertices, faces, selected)
    for patch in result.patches:
        print(f"{name}: {patch.hole.method}, volume {patch.removed_volume:.4g}, height {patch.removed_height:.3g}")
    is_new = np.arange(len(result.faces)) >= len(result.old_faces)
    return [
        colored_panel(vertices, faces, np.where(selected[:, np.newaxis], SELECTED, OLD), name),
        colored_panel(result.vertices, result.faces, np.where(is_new[:, np.newaxis], NEW, OLD), "replaced"),
    ]


def main() -> None:
    """Write the picture."""
    ring, (corners, sides) = torus(resolution=120, jitter=0.2), block_with_sharp_edges(resolution=48, jitter=0.2)
    stamp = np.linalg.norm(ring.vertices - [0.0, -1.28, 0.28], axis=1)
    raised = 0.05 * np.square(np.maximum(1.0 - np.square((stamp - RADIUS) / WIDTH), 0.0))
    raised[stamp < RADIUS] = np.maximum(raised[stamp < RADIUS], 1e-9)  # what the ring surrounds is selected, too
    bump = np.linalg.norm(corners - [0.5, -0.5, 0.0], axis=1) / 0.25
    swollen = 0.12 * np.square(np.maximum(1.0 - np.square(bump), 0.0))
    shown = [
        *panels(ring.vertices, ring.faces, ring.normals * raised[:, np.newaxis], 0.002, "a stamp on a noisy torus"),
        *panels(corners, sides, swollen[:, np.newaxis] * [0.7, -0.7, 0.0], 0.0, "a bump across an edge"),
    ]
    render_panels(FOLDER / "replacement.png", shown, views=("iso",), up="z", size=(420, 420))


if __name__ == "__main__":
    main()
