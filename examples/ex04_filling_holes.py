"""Holes are filled with the surface that is missing: smooth, or with the edge or corner that was there.

One sees an egg carton with three holes and a block that lost an edge and a corner, and below them the same meshes
filled; new faces are orange. The outer rim of the egg carton is no hole and stays open.
"""

from pathlib import Path
from typing import Any

import numpy as np

import bezier_filters as bf
from common import arrays, flat_panel, load, run

BITES = (((-0.15, -0.5, 0.5), 0.17), ((0.5, -0.5, 0.5), 0.17))
"""Centres and radii of the holes in the block: the middle of an edge, and a corner."""
OLD, NEW = (0.75, 0.75, 0.75), (1.0, 0.6, 0.2)


def bitten_block() -> tuple[np.ndarray, np.ndarray]:
    """The block without the faces that touch one of the balls."""
    vertices, faces = arrays(load("block.ply"))
    gone = np.zeros(len(faces), dtype=bool)
    for center, radius in BITES:
        gone |= (np.linalg.norm(vertices - center, axis=1) < radius)[faces].any(axis=1)
    return vertices, faces[~gone]


def shaded(vertices: np.ndarray, faces: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Colours of faces: orange where they are new, darker the steeper they are, so that every edge shows."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    level = np.abs(normals[:, 2]) / np.linalg.norm(normals, axis=1)
    return np.where(new[:, None], NEW, OLD) * (0.7 + 0.3 * level[:, None])


def main(out: Path) -> dict[str, Any]:
    """Write holes.png; how many holes were filled, and the volume of the block, which should be 0.875."""
    patch, block = arrays(load("punched_patch.ply")), bitten_block()
    filled_patch, filled_block = bf.fill_holes(*patch), bf.fill_holes(*block)
    panels = []
    for title, vertices, faces, old in [
        ("egg carton", *patch, patch),
        ("block with sharp edges", *block, block),
        ("filled", filled_patch.vertices, filled_patch.faces, patch),
        ("filled", filled_block.vertices, filled_block.faces, block),
    ]:
        new = np.arange(len(faces)) >= len(old[1])  # old faces stay the first
        panels.append(flat_panel(vertices, faces, title, shaded(vertices, faces, new)))
    bf.render_panels(out / "holes.png", panels, columns=2, views=["iso"], size=(450, 450), up="z")
    a, b, c = filled_block.vertices[filled_block.faces].transpose(1, 0, 2)
    return {
        "holes filled in the egg carton": filled_patch.filled,
        "holes filled in the block": filled_block.filled,
        "volume of the block": float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0),
    }


if __name__ == "__main__":
    run(main)
