"""Draws the picture of docs/trust.md: python docs/images/trust.py.

The same regions of two surfaces, cut out of the noisy mesh, of that smoothed by MeshLab's Taubin filter and by this
package, and of the truth. Above each stands its error in the region: the root mean square distance of its vertices from
the true faces in mean edges, and the mean angle between its face normals and the true ones. Taubin's filter has the
setting with the smallest angle among those of `readme.py`, which only the truth tells; this package has its defaults.
Faces are drawn flat, one by one, so that nothing hides the noise that remains.
"""

from pathlib import Path

import numpy as np
import pyvista
from readme import angles, noisy, taubin

import bezier_filters as bf
from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.pictures.render import render_panels
from bezier_filters.pictures.scene import Panel
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star

FOLDER = Path(__file__).parent
NOISE = 0.2  # standard deviation along the normals, in mean edges
GREY = 0.78
"""Of the faces, from 0 to 1."""
SIGHTS = {"block": (1.0, 0.75, 0.9), "bumpy star": (0.9, -0.5, 0.7)}
"""Directions towards the viewer; the region is around the vertex farthest this way, or around the inner corner."""
RADII = {"block": 0.42, "bumpy star": 0.62}
"""Of the regions, in units of the coordinates."""
PIXELS = (420, 420)  # of each region, at most


def surfaces() -> dict[str, tuple[FloatArray, IntArray]]:
    """Vertices and faces of the true surfaces."""
    star = bumpy_star(resolution=29, jitter=0.25)
    return {"block": block_with_sharp_edges(resolution=30, jitter=0.25), "bumpy star": (star.vertices, star.faces)}


def towards(direction: tuple[float, float, float]) -> FloatArray:
    """Rotation (3, 3) whose rows point right, up and towards the viewer."""
    back = np.array(direction) / np.linalg.norm(direction)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(back, right), back])


def distances(points: FloatArray, truth: FloatArray, faces: IntArray) -> FloatArray:
    """Distances (n,) of points from the true faces."""
    found = pyvista.PolyData(points).compute_implicit_distance(pyvista.PolyData.from_regular_faces(truth, faces))
    return np.abs(np.asarray(found["implicit_distance"]))


def panels(name: str, truth: FloatArray, faces: IntArray) -> list[Panel]:
    """The region of each mesh with its errors, which are printed, too."""
    measured = noisy(truth, faces, NOISE)
    peer, setting = taubin(measured, truth, faces)
    smoothed = bf.smooth(measured, faces).vertices
    axes, edge = towards(SIGHTS[name]), bf.inspect_mesh(truth, faces).mean_edge_length
    middle = np.zeros(3) if name == "block" else truth[np.argmax(truth @ axes[2])]
    region = faces[(np.linalg.norm(truth - middle, axis=1) < RADII[name])[faces].all(axis=1)]
    print(f"{name}: {len(np.unique(region))} vertices; Taubin {setting}")
    drawn = []
    for title, vertices in {"noisy": measured, "Taubin": peer, "bezier_filters": smoothed, "truth": truth}.items():
        if vertices is not truth:
            off = distances(vertices[np.unique(region)], truth, faces)
            angle = angles(vertices, truth, region).mean()
            title += f"\n{np.sqrt(np.mean(off**2)) / edge:.3f} edges, {angle:.1f}°"
            print(title.replace("\n", ": "))
        corners = np.ascontiguousarray((vertices[region] @ axes.T).reshape(-1, 3))
        separate = np.arange(region.size, dtype=np.int32).reshape(-1, 3)
        drawn.append(Panel(corners, separate, colors=np.full((region.size, 3), GREY), title=title))
    return drawn


def main() -> None:
    """Write trust_block.png and trust_star.png."""
    for name, (truth, faces) in surfaces().items():
        path = FOLDER / f"trust_{name.split()[-1]}.png"
        render_panels(path, panels(name, truth, faces), views=["front"], size=PIXELS, up="y", front="z")


if __name__ == "__main__":
    main()
