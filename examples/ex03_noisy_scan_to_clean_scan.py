"""A noisy scan becomes a clean one, without a parameter.

One sees the noisy mesh, the paper's smoothing, and the automatic one, each with its faces drawn flat, so that what is
left of the noise shows: a round blob that should be smooth, and a block whose edges should be sharp.
"""

from pathlib import Path
from typing import Any

import numpy as np

import bezier_filters as bf
from common import arrays, flat_panel, load, run

NOISE = 0.2
"""Standard deviation in mean edges."""


def main(out: Path) -> dict[str, Any]:
    """Write scan.png; RMS distances to the true vertices, along the normal, in mean edges."""
    panels, distances = [], {}
    for name in ("bumpy_star", "block"):
        ms = load(f"{name}.ply")
        (clean, faces), normals = arrays(ms), ms.current_mesh().vertex_normal_matrix()
        edge = np.linalg.norm(clean[faces[:, 0]] - clean[faces[:, 1]], axis=1).mean()
        height = NOISE * edge * np.random.default_rng(0).standard_normal((len(clean), 1))
        noisy = clean + height * normals
        for title, vertices in [
            ("with noise", noisy),
            ("the paper's smoothing", bf.smooth(noisy, faces, "paper").vertices),
            ("automatic smoothing", bf.smooth(noisy, faces).vertices),
        ]:
            panels.append(flat_panel(vertices, faces, title))
            off = np.einsum("ij,ij->i", vertices - clean, normals)
            distances[f"{name}, {title}"] = float(np.sqrt(np.mean(off**2)) / edge)
    bf.render_panels(out / "scan.png", panels, columns=3, views=["iso"], size=(400, 400))
    return distances


if __name__ == "__main__":
    run(main)
