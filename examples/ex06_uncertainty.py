"""How far the curvature can be trusted, where noise differs from place to place.

The right half of a torus was scanned with ten times the noise of the left half. One sees the mean curvature, the
standard error that comes with it (`mean_curvature_std`), and the error that was really made: both are larger on the
right half, and largest where the halves meet.
"""

from pathlib import Path
from typing import Any

import numpy as np

import bezier_filters as bf
from bezier_filters.display import round_limits
from bezier_filters.surfaces import torus
from common import run


def main(out: Path) -> dict[str, Any]:
    """Write uncertainty.png; standard errors and errors of both halves, and how often 95 % intervals hold the truth."""
    shape = torus(resolution=120, jitter=0.3)
    right = shape.vertices[:, 0] > 0
    sigma = np.where(right, 0.01, 0.001)
    height = sigma * np.random.default_rng(0).standard_normal(len(sigma))
    vertices = shape.vertices + height[:, None] * shape.normals

    g = bf.estimate_vertex_geometry(vertices, shape.faces)
    error = np.abs(g.mean_curvature - shape.mean_curvature)
    limits = round_limits(0.0, float(np.percentile(g.mean_curvature_std, 99)))
    panels = [
        bf.Panel(vertices, shape.faces, g.mean_curvature, "mean curvature", "1/length", signed=True),
        bf.Panel(vertices, shape.faces, g.mean_curvature_std, "standard error", "1/length", limits=limits),
        bf.Panel(vertices, shape.faces, error, "error", "1/length", limits=limits),
    ]
    bf.render_panels(out / "uncertainty.png", panels, views=["front"], size=(400, 400))
    rms = {
        f"{what}, {side}": float(np.sqrt(np.mean(values[half] ** 2)))
        for side, half in (("left", ~right), ("right", right))
        for what, values in (("standard error", g.mean_curvature_std), ("error", error))
    }
    return rms | {"truth within 95 % intervals": float(np.mean(error < 1.96 * g.mean_curvature_std))}


if __name__ == "__main__":
    run(main)
