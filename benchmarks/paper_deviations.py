"""What each departure from the paper changes: the figures of docs/deviations.md, printed by paper_figures.py."""

from collections import Counter
from pathlib import Path

import numpy as np
import pymeshlab

import baselines
import bezier_filters as bf
from bezier_filters import surfaces
from bezier_filters.holes.hole_detection import find_holes
from bezier_filters.holes.influence_region import INFLUENCE_RINGS, influence_regions
from bezier_filters.holes.planar_fill import MIN_PATCH_POINTS, PAPER_RINGS, paper_fill
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from cut_holes import Case, compact, cut
from sub_holes import load, random_cuts, rms

WHEEL = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes"
PAPER = {"rings": 2, "alpha": 0.8, "smoothness": "paper"}
RANDOM_HOLES = 40
"""Twice as many take a further half minute."""


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
    for name, mesh in (("block", block), ("cow", cow), ("bunny", bunny)):
        note("fold test", differing_folds(name, estimate(mesh), estimate(mesh, fold_test="crossings")))
    root = np.sqrt(np.maximum(g.mean_curvature**2 - g.gaussian_curvature, 0.0))
    largest = np.abs(root - g.geodesic_torsion).max() / g.geodesic_torsion.max()
    note("torsion", f"sqrt(H^2 - K) and (k_max - k_min) / 2 on the bunny: {largest:.0e} of the largest apart")
    note("border correction", lagrange_holes(bunny))
    note("new vertices", refined_holes(bunny))
    note("influence area", influence_areas(bunny))
    note("other methods", fill_methods(bunny))
    note("Razdan and Bae", shape_equations(bunny))
    return rows


def differing_folds(name: str, angle: bf.VertexGeometry, crossings: bf.VertexGeometry) -> str:
    """Vertices that only one of the tests finds unfolded, and where both do, that nothing else differs."""
    ok, other = angle.status == bf.FitStatus.OK, crossings.status == bf.FitStatus.OK
    same = np.array_equal(angle.normals[ok & other], crossings.normals[ok & other])
    only = f"only by angles {np.count_nonzero(ok & ~other)}, only by crossings {np.count_nonzero(other & ~ok)}"
    return f"{name}: of {len(ok):,} vertices {np.count_nonzero(ok):,} OK by angles; {only}; normals else equal: {same}"


def small_holes(mesh: tuple[np.ndarray, np.ndarray]) -> list[Case]:
    """Twelve holes."""
    vertices, faces = mesh
    size = np.linalg.norm(np.ptp(vertices, axis=0))
    return [cut("", vertices, faces, vertices[k], r * size) for k in range(2000, 26000, 4000) for r in (0.01, 0.02)]


def refined_holes(mesh: tuple[np.ndarray, np.ndarray]) -> str:
    """How far fills with and without new vertices are off."""
    found: dict[bool, list[float]] = {True: [], False: []}
    for hole in small_holes(mesh):
        for refine, off in found.items():
            result = bf.fill_holes(hole.vertices, hole.faces, "paper", refine=refine)
            off.append(rms(hole, result.vertices, result.faces[len(hole.faces) :]))
    with_them, without = (np.median(off) for off in found.values())
    return f"RMS of {len(found[True])} small holes: {with_them:.2f} % of the diameter with, {without:.2f} % without"


def influence_areas(mesh: tuple[np.ndarray, np.ndarray]) -> str:
    """How many of the smallest holes have too few points in two rings, and how far the fill is elsewhere with these."""
    vertices, faces = mesh
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    total, few, moves = Counter(), Counter(), []
    for k in range(0, len(vertices), 1400):
        around = (faces == k).any(axis=1)
        for kind, lost in (("a face", np.arange(len(faces)) == around.argmax()), ("a vertex", around)):
            opened = prepare_mesh(triangle_mesh(*compact(vertices, faces[~lost])))
            loops = [hole.loops for hole in find_holes(opened)]
            ((narrow,), (wide,)) = (influence_regions(opened, loops, rings) for rings in (PAPER_RINGS, INFLUENCE_RINGS))
            total[kind] += 1
            if len(narrow.ids) < MIN_PATCH_POINTS:
                few[kind] += 1
                fills = [paper_fill(region, 0.8) for region in (narrow, wide)]
                if not any(isinstance(fill, str) for fill in fills):
                    moves.append(np.linalg.norm(fills[0].points - fills[1].points, axis=1).max() / edge)
    words = ", ".join(f"{few[kind]} of {total[kind]} holes of {kind}" for kind in total)
    moved = f"these alone move fills by {max(moves):.2g} edges at most"
    return f"{words} have fewer than {MIN_PATCH_POINTS} points in two rings; {moved}"


def fill_methods(mesh: tuple[np.ndarray, np.ndarray]) -> str:
    """How random holes of one rim are filled by the paper's method."""
    found: Counter[str] = Counter()
    for case in random_cuts("", *mesh, 0):
        vertices, faces = compact(case.vertices, case.faces)
        if len(bf.boundary_loops(triangle_mesh(vertices, faces))) != 1:
            continue
        (hole,) = bf.fill_holes(vertices, faces, "paper").holes
        found[hole.method or "left open"] += 1
        if found.total() == RANDOM_HOLES:
            break
    return f"{RANDOM_HOLES} random holes of the bunny: " + ", ".join(f"{n} {name}" for name, n in found.most_common())


def shape_equations(mesh: tuple[np.ndarray, np.ndarray]) -> str:
    """How far the two readings of Razdan and Bae's shape equations are apart."""
    edges, twists = baselines.razdan_bae(*mesh, shape="edges"), baselines.razdan_bae(*mesh, shape="twists")
    mean = relative(edges.mean_curvature, twists.mean_curvature)
    gaussian = relative(edges.gaussian_curvature, twists.gaussian_curvature)
    return f"differences along the border or twists: H and K of the bunny {mean:.0f} and {gaussian:.0f} % apart"


def lagrange_holes(mesh: tuple[np.ndarray, np.ndarray]) -> str:
    """How many of some holes each correction fills."""
    counts = dict.fromkeys(("harmonic", "lagrange", "lagrange_pieces"), 0)
    holes = small_holes(mesh)
    for hole in holes:
        for correction in counts:
            result = bf.fill_holes(hole.vertices, hole.faces, "paper", correction=correction)
            counts[correction] += result.holes[0].method == "paper"
    words = ", ".join(f"{name} {count}" for name, count in counts.items())
    return f"of {len(holes)} small holes of the bunny the patch is taken with the correction {words}"
