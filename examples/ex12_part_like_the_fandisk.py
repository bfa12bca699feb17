"""A machined part with straight and curved edges loses some of them, and has them again (Fig. 10 of the paper).

One sees a fan with a hole across a curved edge, one across a straight edge and one at a corner; the holes filled with
the paper's single patch each, which rounds what was sharp; and filled by default, where edges are continued through
the holes and each side gets a surface of its own. New faces are orange.
"""

from pathlib import Path
from typing import Any

import numpy as np

import bezier_filters as bf
from common import flat_panel, run
from ex04_filling_holes import shaded

INNER, OUTER, ANGLE, HEIGHT = 0.4, 1.0, 2.0, 0.4
"""Radii, opening angle and height of the fan."""
BITES = (((OUTER, 0.7, HEIGHT), 0.13), ((0.7, 0.0, HEIGHT), 0.13), ((OUTER, ANGLE, HEIGHT), 0.13))
"""Holes: radius, angle and height of their centre, and their radius."""


def fan(cells: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """Surface of the body INNER <= r <= OUTER, 0 <= angle <= ANGLE, 0 <= z <= HEIGHT, in triangles."""
    counts = (cells, 3 * cells, (2 * cells) // 3)
    points, faces = [], []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for end in (0.0, 1.0):
            grids = np.meshgrid(*(np.linspace(0.0, 1.0, counts[k] + 1) for k in others), indexing="ij")
            block = np.full((grids[0].size, 3), end)
            block[:, others] = np.stack([grid.ravel() for grid in grids], axis=1)
            index = np.arange(len(block)).reshape(grids[0].shape) + sum(map(len, points))
            a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
            new = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
            outward = (end == 1.0) == (axis != 1)
            faces.append(new if outward else new[:, ::-1])
            points.append(block)
    unique, inverse = np.unique(np.round(np.concatenate(points), 12), axis=0, return_inverse=True)
    r = INNER + (OUTER - INNER) * unique[:, 0]
    angle = ANGLE * unique[:, 1]
    vertices = np.stack([r * np.cos(angle), r * np.sin(angle), HEIGHT * unique[:, 2]], axis=1)
    return vertices, inverse.ravel()[np.concatenate(faces)].astype(np.int32)


def distance_to_fan(points: np.ndarray) -> np.ndarray:
    """Distance to the nearest of the six surfaces of the fan, which is that to the fan near its holes."""
    r, angle = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
    sides = [r - INNER, r - OUTER, points[:, 2], points[:, 2] - HEIGHT, r * np.sin(angle), r * np.sin(angle - ANGLE)]
    return np.abs(sides).min(axis=0)


def main(out: Path) -> dict[str, Any]:
    """Write part.png; RMS distances of the new vertices to the part that was there, in mean edges."""
    vertices, whole = fan()
    gone = np.zeros(len(whole), dtype=bool)
    for (r, angle, z), radius in BITES:
        center = (r * np.cos(angle), r * np.sin(angle), z)
        gone |= (np.linalg.norm(vertices - center, axis=1) < radius)[whole].any(axis=1)
    faces = whole[~gone]
    edge = np.linalg.norm(vertices[whole[:, 0]] - vertices[whole[:, 1]], axis=1).mean()
    panels, report = (
        [flat_panel(vertices, faces, "with holes", shaded(vertices, faces, np.zeros(len(faces), bool)))],
        {},
    )
    for title, result in [
        ("paper", bf.fill_holes(vertices, faces, "paper")),
        ("automatic", bf.fill_holes(vertices, faces)),
    ]:
        new = np.arange(len(result.faces)) >= len(faces)
        panels.append(flat_panel(result.vertices, result.faces, title, shaded(result.vertices, result.faces, new)))
        off = distance_to_fan(result.vertices[len(vertices) :])
        report[f"filled, {title}"] = result.filled
        report[f"distance, {title} [mean edges]"] = float(np.sqrt(np.mean(off**2)) / edge)
    bf.render_panels(out / "part.png", panels, views=["iso"], size=(500, 500), up="z")
    return report


if __name__ == "__main__":
    run(main)
