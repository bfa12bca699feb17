"""Draws the picture of bridged holes in docs/holes.md: python docs/images/bridging.py.

A bent surface with a gap, and a block with a bolt hole that has no wall, each before and after; new faces are orange.
"""

from pathlib import Path

import numpy as np

import bezier_filters as bf
from bezier_filters.pictures.render import render_panels
from bezier_filters.pictures.scene import Panel
from bezier_filters.surfaces import bumpy_star, torus

FOLDER = Path(__file__).parent
OLD, INSIDE, NEW = (0.75, 0.75, 0.75), (0.45, 0.45, 0.5), (0.95, 0.6, 0.1)


def panel(vertices: np.ndarray, faces: np.ndarray, old: int, title: str) -> Panel:
    """A mesh whose faces share no vertices, in the colour of new ones from number `old` on."""
    corners = np.ascontiguousarray(vertices[faces].reshape(-1, 3))
    colors = np.repeat([OLD, NEW], [3 * old, 3 * (len(faces) - old)], axis=0)
    rows = np.arange(faces.size, dtype=np.int32).reshape(-1, 3)
    return Panel(corners, rows, colors=colors, back=INSIDE, title=title)


def panels(vertices: np.ndarray, faces: np.ndarray, pairs: list[tuple[int, int]], title: str) -> list[Panel]:
    """A mesh before and after."""
    result = bf.bridge_holes(vertices, faces, pairs)
    print(title, [hole.method for hole in result.holes])
    return [
        panel(vertices, faces, len(faces), title),
        panel(result.vertices, result.faces, len(faces), "bridged"),
    ]


def open_ring() -> tuple[np.ndarray, np.ndarray]:
    """A torus without a piece."""
    ring = torus(resolution=72, jitter=0.2)
    around = np.arctan2(ring.vertices[:, 0], -ring.vertices[:, 1])
    return ring.vertices, ring.faces[~(np.abs(around) < 0.3)[ring.faces].any(axis=1)]


def halves() -> tuple[np.ndarray, np.ndarray]:
    """A blob with a gap all around."""
    blob = bumpy_star(resolution=32, jitter=0.2)
    return blob.vertices, blob.faces[~(np.abs(blob.vertices[:, 2] - 0.1) < 0.12)[blob.faces].any(axis=1)]


def washer() -> tuple[np.ndarray, np.ndarray]:
    """A disk with a hole, without the wall of the hole."""
    count, radii = 48, 0.6 * np.concatenate([np.linspace(1.0, 2.2, 9), np.full(5, 2.2), np.linspace(2.2, 1.0, 9)])
    heights = 0.6 * np.concatenate([np.full(9, -0.4), np.linspace(-0.4, 0.4, 7)[1:-1], np.full(9, 0.4)])
    angles = 2.0 * np.pi * np.arange(count) / count
    vertices = np.stack(
        [
            radii[:, np.newaxis] * np.cos(angles),
            radii[:, np.newaxis] * np.sin(angles),
            np.broadcast_to(heights[:, np.newaxis], (len(radii), count)),
        ],
        axis=2,
    ).reshape(-1, 3)
    i = np.arange((len(radii) - 1) * count)
    after = i - i % count + (i + 1) % count
    return vertices, np.vstack(
        [np.column_stack([i, after, i + count]), np.column_stack([after, after + count, i + count])]
    ).astype(np.int32)


def main() -> None:
    """Write the picture."""
    shown = [
        *panels(*open_ring(), [(0, 1)], "a gap"),
        *panels(*halves(), [(0, 1)], "two halves"),
        *panels(*washer(), [(0, 1)], "no wall"),
    ]
    render_panels(FOLDER / "bridging.png", shown, views=("iso",), up="z", size=(300, 300))


if __name__ == "__main__":
    main()
