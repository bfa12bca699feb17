"""A machined part loses parts of straight and curved edges to holes; filling restores them (Fig. 10 of the paper).

One sees a fan with a hole across both curved edges of its wall, one across a curved edge, one across a straight edge
and one at a corner; the holes filled with a single patch each, which rounds what was sharp; filled in the paper's way,
where curves continue the edges and every part between them has a patch; and filled by default, where each side gets a
surface that continues the one around it. New faces are orange.
"""

from pathlib import Path
from typing import Any

import numpy as np

import bezier_filters as bf
from common import arrays, flat_panel, load, run
from ex04_filling_holes import shaded

INNER, OUTER, ANGLE, HEIGHT = 0.4, 1.0, 2.0, 0.4
"""Radii, opening angle and height of the fan."""
BITES = (((OUTER, 0.6, HEIGHT), 0.16), ((0.7, 0.0, HEIGHT), 0.13), ((OUTER, ANGLE, HEIGHT), 0.13))
"""Further holes: radius, angle and height of their centre, and their radius."""


def distance_to_fan(points: np.ndarray) -> np.ndarray:
    """Distance to the nearest of the six surfaces of the fan, which is that to the fan near its holes."""
    r, angle = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
    sides = [r - INNER, r - OUTER, points[:, 2], points[:, 2] - HEIGHT, r * np.sin(angle), r * np.sin(angle - ANGLE)]
    return np.abs(sides).min(axis=0)


def main(out: Path) -> dict[str, Any]:
    """Write part.png; RMS distances of the new vertices to the part that was there, in mean edges."""
    vertices, whole = arrays(load("fan.ply"))
    gone = np.zeros(len(whole), dtype=bool)
    for (r, angle, z), radius in BITES:
        center = (r * np.cos(angle), r * np.sin(angle), z)
        gone |= (np.linalg.norm(vertices - center, axis=1) < radius)[whole].any(axis=1)
    faces = whole[~gone]
    edge = np.linalg.norm(vertices[whole[:, 0]] - vertices[whole[:, 1]], axis=1).mean()
    panels = [flat_panel(vertices, faces, "with holes", shaded(vertices, faces, np.zeros(len(faces), bool)))]
    report: dict[str, Any] = {}
    for title, options in [
        ("paper, one patch", {"method": "paper", "creases": False}),
        ("paper", {"method": "paper"}),
        ("automatic", {}),
    ]:
        result = bf.fill_holes(vertices, faces, **options)
        new = np.arange(len(result.faces)) >= len(faces)
        panels.append(flat_panel(result.vertices, result.faces, title, shaded(result.vertices, result.faces, new)))
        off = distance_to_fan(result.vertices[len(vertices) :])
        report[f"filled, {title}"] = result.filled
        report[f"parts, {title}"] = sorted(hole.parts for hole in result.holes)
        report[f"distance, {title} [mean edges]"] = float(np.sqrt(np.mean(off**2)) / edge)
    bf.render_panels(out / "part.png", panels, views=["iso", "back"], size=(500, 400), up="z")
    return report


if __name__ == "__main__":
    run(main)
