"""What each departure from the paper changes: the figures of docs/deviations.md, printed by paper_figures.py."""

from pathlib import Path

import numpy as np
import pymeshlab

import bezier_filters as bf
from bezier_filters import surfaces
from cut_holes import cut
from sub_holes import load

WHEEL = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes"
PAPER = {"rings": 2, "alpha": 0.8, "smoothness": "paper"}


def relative(a: np.ndarray, b: np.ndarray) -> float:
    """Median of the differences over the median size, in percent."""
    return float(100 * np.median(np.abs(a - b)) / np.median(np.abs(b)))


def deviations() -> list[dict[str, object]]:
    """Rows that say what each departure from the paper changes."""
    bunny = load(WHEEL / "bunny.obj")
    cow = load(WHEEL / "cow.obj")
    block = surfaces.block_with_sharp_edges(resolution=16, jitter=0.2)
    ball = surfaces.sphere(resolution=20)
    rng = np.random.default_rng(0)

    def estimate(mesh: tuple[np.ndarray, np.ndarray], **options: object) -> bf.VertexGeometry:
        return bf.estimate_vertex_geometry(*mesh, **{**PAPER, **options})  # type: ignore[arg-type]

    rows: list[dict[str, object]] = []

    def note(what: str, figure: str) -> None:
        rows.append({"deviation": what, "figure": figure})

    sphere = ball.vertices, ball.faces
    biased, exact = (estimate(sphere, smoothness=s).mean_curvature.mean() for s in ("paper", "third_order"))
    note("smoothness", f"H of a unit sphere with alpha 0.8: paper {biased:.3f}, third_order {exact:.3f}")
    g = estimate(bunny)
    moved = estimate(bunny, x_axis=rng.standard_normal(bunny[0].shape))
    note("x axis", f"H of the bunny with random x axes: {relative(moved.mean_curvature, g.mean_curvature):.1f} % off")
    moved, far = estimate(cow, x_axis=[1.0, 0.0, 0.0]), estimate(cow)
    note(
        "x axis",
        f"H of the cow with one x axis for all: {relative(moved.mean_curvature, far.mean_curvature):.1f} % off",
    )
    sound, paper = estimate(block), estimate(block, fallbacks="paper")
    for name, fit in (("sound", sound), ("paper", paper)):
        counts = ", ".join(f"{status} {count}" for status, count in fit.status_counts().items())
        note("other plane", f"vertices of a block, {name}: {counts}")
    both = (sound.status == bf.FitStatus.OTHER_PLANE) & (paper.status == bf.FitStatus.OTHER_PLANE)
    cosines = np.einsum("ij,ij->i", sound.normals[both], paper.normals[both]).clip(-1.0, 1.0)
    note("other plane", f"normals over both planes: {np.degrees(np.median(np.arccos(cosines))):.1f} degrees apart")
    single = estimate(bunny, rings=1, fallbacks="paper")
    solved = single.status == bf.FitStatus.OK
    note("1-ring", f"the paper's system is singular on {100 * (~solved).mean():.1f} % of the 1-rings of the bunny")
    default = bf.estimate_vertex_geometry(*bunny).mean_curvature[solved]
    quadratic = bf.estimate_vertex_geometry(*bunny, rings=1, degree=2, alpha=0.1).mean_curvature[solved]
    off = relative(single.mean_curvature[solved], default), relative(quadratic, default)
    note("1-ring", f"H on the others, from the default: patch {off[0]:.0f} % off, quadratic {off[1]:.0f} %")
    root = np.sqrt(np.maximum(g.mean_curvature**2 - g.gaussian_curvature, 0.0))
    largest = np.abs(root - g.geodesic_torsion).max() / g.geodesic_torsion.max()
    note("torsion", f"sqrt(H^2 - K) and (k_max - k_min) / 2 on the bunny: {largest:.0e} of the largest apart")
    note("border correction", lagrange_holes(bunny))
    return rows


def lagrange_holes(mesh: tuple[np.ndarray, np.ndarray]) -> str:
    """How many of some holes each correction fills."""
    vertices, faces = mesh
    size = np.linalg.norm(np.ptp(vertices, axis=0))
    counts = dict.fromkeys(("harmonic", "lagrange", "lagrange_pieces"), 0)
    holes = [cut("", vertices, faces, vertices[k], r * size) for k in range(2000, 26000, 4000) for r in (0.01, 0.02)]
    for hole in holes:
        for correction in counts:
            result = bf.fill_holes(vertices, hole.faces, "paper", correction=correction)
            counts[correction] += result.holes[0].method == "paper"
    words = ", ".join(f"{name} {count}" for name, count in counts.items())
    return f"of {len(holes)} small holes of the bunny the patch is taken with the correction {words}"
