"""Draws the picture in docs/filters/deviation.md: python docs/images/deviation.py.

A torus with noise and a defect of half the noise in height, against another noisy mesh of the torus with a hole: the
deviations, and their means over regions.
"""

from pathlib import Path

import numpy as np
import pymeshlab

import bezier_filters as bf
from bezier_filters.pictures.deviation_picture import deviation_panel
from bezier_filters.pictures.render import render_panels
from bezier_filters.surfaces import SampledSurface, torus

FOLDER = Path(__file__).parent
NOISE, DEFECT = 0.007, 0.0035
"""Standard deviation of the noise, a tenth of an edge, and height of the defect, lengths."""


def noisy(body: SampledSurface, seed: int) -> np.ndarray:
    """Vertices with noise along the normals."""
    return body.vertices + NOISE * np.random.default_rng(seed).standard_normal((len(body.vertices), 1)) * body.normals


def main() -> None:
    """Write the picture."""
    scan, model = torus(resolution=40, jitter=0.3), torus(resolution=48, jitter=0.2, seed=3)
    vertices = noisy(scan, 0)
    place = np.array([-0.8, 0.6, 0.4])
    near = np.argsort(np.linalg.norm(scan.vertices - place, axis=1))[:200]
    vertices[near] += DEFECT * scan.normals[near]
    hole = np.linalg.norm(model.vertices[model.faces].mean(axis=1) - [1.0, 0.0, 0.4], axis=1) < 0.3
    panels = []
    for quality in ("deviation", "regional"):
        ms = pymeshlab.MeshSet()
        ms.add_mesh(pymeshlab.Mesh(noisy(model, 1), model.faces[~hole]))
        ms.add_mesh(pymeshlab.Mesh(vertices, scan.faces))
        report = bf.compute_deviation_by_bezier_patch_per_vertex(ms, quality=quality, tolerance=0.002)
        print(report["status"], report["regions"])
        panels.append(deviation_panel(ms, report))
    render_panels(FOLDER / "deviation.png", panels, views=("front",), size=(450, 450))


if __name__ == "__main__":
    main()
