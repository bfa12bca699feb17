"""Draws the picture of the README: python docs/images/readme.py.

A sample mesh with noise, smoothed by MeshLab's Taubin filter and by this package, and its truth. Faces are drawn flat,
one by one, so that nothing hides the noise that remains; below each, the angle by which the normals of the faces are
wrong. Taubin's filter has the setting with the smallest mean angle among `STEPS` and `FACTORS`, which only the truth
tells; this package has its defaults. Errors are those of all faces.
"""

import argparse
from itertools import product
from pathlib import Path

import matplotlib
import numpy as np
import pymeshlab
import pyvista

import bezier_filters as bf
from bezier_filters.arrays import FloatArray, IntArray

matplotlib.use("agg")
from matplotlib import pyplot
from matplotlib.colors import Normalize

FOLDER = Path(__file__).parent
MESH = FOLDER.parents[1] / "sample_meshes" / "fan.ply"
NOISE = 0.2  # standard deviation along the normals, in mean edges
STEPS = (5, 10, 20, 40, 80, 160)
FACTORS = ((0.3, -0.31), (0.3, -0.34), (0.5, -0.51), (0.5, -0.53), (0.5, -0.56), (0.7, -0.73), (0.7, -0.77))
"""Numbers of steps, and lambda and mu of Taubin's filter; 10 steps of 0.5 and -0.53 are MeshLab's default."""
TOWARDS, HALF_HEIGHT, FOCUS = (1.0, -0.75, 0.85), 0.42, (0.66, 0.26, 0.15)
"""Direction towards the viewer; half the height, and centre, of the part that is drawn."""
LIGHTS = (((-1.0, 0.9, 0.8), 0.7), ((1.0, 0.1, 0.6), 0.5))
"""Positions relative to the camera, and intensities: low on both sides, so that small slopes show."""
PIXELS = (396, 330)  # of each view
WORST = 20.0  # degrees at the end of the colour bar


def face_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Unit normals of the faces (m, 3)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def angles(vertices: FloatArray, truth: FloatArray, faces: IntArray) -> FloatArray:
    """Angles between the normals of the faces and the true ones, in degrees."""
    cosines = (face_normals(vertices, faces) * face_normals(truth, faces)).sum(axis=1)
    return np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))


def noisy(truth: FloatArray, faces: IntArray, noise: float) -> FloatArray:
    """The vertices with Gaussian noise along their normals."""
    normals = np.zeros_like(truth)
    for k in range(3):
        np.add.at(normals, faces[:, k], face_normals(truth, faces))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edges = [np.linalg.norm(truth[faces[:, k - 1]] - truth[faces[:, k]], axis=1) for k in range(3)]
    heights = np.random.default_rng(1).standard_normal(len(truth)) * noise * np.mean(edges)
    return truth + heights[:, None] * normals


def taubin(vertices: FloatArray, truth: FloatArray, faces: IntArray) -> tuple[FloatArray, str]:
    """The result of MeshLab's Taubin filter that is nearest to the truth, and its setting."""
    best, least, setting = vertices, np.inf, ""
    for steps, (forth, back) in product(STEPS, FACTORS):
        meshset = pymeshlab.MeshSet()
        meshset.add_mesh(pymeshlab.Mesh(vertices, faces))
        meshset.apply_coord_taubin_smoothing(lambda_=forth, mu=back, stepsmoothnum=steps)
        found = meshset.current_mesh().vertex_matrix()
        if (error := angles(found, truth, faces).mean()) < least:
            best, least, setting = found, error, f"{steps} steps, lambda {forth}, mu {back}"
    return best, setting


def view(vertices: FloatArray, faces: IntArray, colors: FloatArray | None) -> FloatArray:
    """A picture of the part: shaded, or in the colours of the faces."""
    corners = vertices[faces].reshape(-1, 3)
    mesh = pyvista.PolyData.from_regular_faces(corners, np.arange(faces.size).reshape(-1, 3))
    plotter = pyvista.Plotter(off_screen=True, window_size=[2 * k for k in PIXELS], lighting="none")
    plotter.set_background("white")
    if colors is None:
        for position, intensity in LIGHTS:
            plotter.add_light(pyvista.Light(position=position, light_type="camera light", intensity=intensity))
        plotter.add_mesh(mesh, color=(0.80, 0.82, 0.85), ambient=0.15)
    else:
        mesh.cell_data["colors"] = colors
        plotter.add_mesh(mesh, scalars="colors", rgb=True, lighting=False)
    plotter.camera.focal_point = FOCUS
    plotter.camera.position = np.array(FOCUS) + np.array(TOWARDS)
    plotter.camera.up = (0.0, 0.0, 1.0)
    plotter.camera.parallel_projection = True
    plotter.camera.parallel_scale = HALF_HEIGHT
    plotter.reset_camera_clipping_range()
    image = np.asarray(plotter.screenshot(return_img=True))
    plotter.close()
    return image[..., :3]


def draw(path: Path, noise: float) -> None:
    """Smooth the mesh, print the errors and write the picture."""
    meshset = pymeshlab.MeshSet()
    meshset.load_new_mesh(str(path))
    truth = meshset.current_mesh().vertex_matrix()
    faces = meshset.current_mesh().face_matrix().astype(np.int32)
    measured = noisy(truth, faces, noise)
    peer, setting = taubin(measured, truth, faces)
    ours = bf.smooth(measured, faces).vertices
    columns = {
        "noisy\n": measured,
        f"MeshLab, Taubin\nbest of {len(STEPS) * len(FACTORS)} settings": peer,
        "bezier_filters\nno settings": ours,
        "truth\n": truth,
    }
    norm, palette = Normalize(0.0, WORST), pyplot.get_cmap("YlOrRd")
    figure, axes = pyplot.subplots(2, 4, figsize=(16.0, 7.9))
    figure.subplots_adjust(left=0.005, right=0.995, top=0.90, bottom=0.09, wspace=0.02, hspace=0.02)
    for column, (title, vertices) in enumerate(columns.items()):
        errors = angles(vertices, truth, faces)
        print(f"{' '.join(title.split())}: mean angle {errors.mean():.2f} degrees")
        axes[0, column].imshow(view(vertices, faces, None))
        axes[0, column].set_title(title, fontsize=21)
        axes[0, column].axis("off")
        axes[1, column].axis("off")
        if vertices is truth:
            continue
        axes[1, column].imshow(view(vertices, faces, palette(norm(errors))[:, :3]))
        axes[1, column].text(
            0.5, -0.02, f"mean error {errors.mean():.1f}°", fontsize=23, weight="bold",
            ha="center", va="top", transform=axes[1, column].transAxes,
        )  # fmt: skip
    place = axes[1, 3].get_position()
    bar = figure.add_axes((place.x0 + 0.2 * place.width, place.y0 + 0.48 * place.height, 0.6 * place.width, 0.03))
    figure.colorbar(pyplot.cm.ScalarMappable(norm, palette), cax=bar, orientation="horizontal", extend="max")
    bar.set_title("error of the\nface normals [degrees]", fontsize=19, pad=12)
    bar.tick_params(labelsize=17)
    print(f"Taubin: {setting}")
    figure.savefig(FOLDER / "readme.png", dpi=100)


def main() -> None:
    """Draw the sample mesh, or another one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", nargs="?", type=Path, default=MESH)
    parser.add_argument("--noise", type=float, default=NOISE, help="standard deviation in mean edges")
    options = parser.parse_args()
    draw(options.mesh, options.noise)


if __name__ == "__main__":
    main()
