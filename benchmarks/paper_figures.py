"""The paper's figures and tables, each from one command, and a page with all of them.

    python benchmarks/paper_figures.py              # all of them and paper.html, into build/paper
    python benchmarks/paper_figures.py figure_7     # one of them
    python benchmarks/paper_figures.py --out FOLDER

Figure 3: fields of a model; 7: smoothing, with the volume ratio; 8: smoothing next to Ohtake, Belyaev and Seidel (2002)
and to Desbrun et al. (1999); 9: smooth holes; 10: holes across sharp edges. Tables 1 and 2: how far estimates move when
vertices are deleted, without and with noise. The paper's models but the bunny are not public: the bunny and the cow of
the pymeshlab wheel and the sample meshes stand for them. `deviations` measures where ours departs from the paper: see
docs/deviations.md.
"""

import argparse
import base64
import html
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pymeshlab

import bezier_filters as bf
import reduction
from baselines import adaptive_gaussian_smoothing
from bezier_filters import surfaces
from bezier_filters.display import color_range, round_limits
from cut_holes import cut
from peers import ours, ouyang_feng, razdan_bae
from smoothing import Case, scores, with_noise
from smoothing_peers import implicit_fairing, volume

ROOT = Path(__file__).parents[1]
WHEEL = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes"
PAPER = {"rings": 2, "alpha": 0.8, "smoothness": "paper"}
PAPERS_VOLUME = 0.9936
"""Volume ratio that the paper gives for its cat."""
OLD, NEW = (0.75, 0.75, 0.75), (1.0, 0.6, 0.2)


class Found(NamedTuple):
    """What is shown of a figure or table."""

    title: str
    picture: Path | None
    rows: list[dict[str, object]]


def load(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a mesh."""
    meshset = pymeshlab.MeshSet()
    meshset.load_new_mesh(str(path))
    mesh = meshset.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int32)


def flat(vertices: np.ndarray, faces: np.ndarray, title: str, new: np.ndarray | None = None) -> bf.Panel:
    """A mesh drawn face by face, new faces in orange."""
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    level = normals @ [0.3, 0.5, 0.8] / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    is_new = np.zeros(len(faces), dtype=bool) if new is None else new
    colors = np.where(is_new[:, None], NEW, OLD) * (0.65 + 0.35 * np.abs(level)[:, None])
    corners = np.ascontiguousarray(vertices[faces].reshape(-1, 3))
    separate = np.arange(faces.size, dtype=np.int32).reshape(-1, 3)
    return bf.Panel(corners, separate, colors=np.repeat(np.minimum(colors, 1.0), 3, axis=0), title=title)


def figure_3(out: Path) -> Found:
    """Mean and Gaussian curvature and geodesic torsion by the paper's method, and the vertex normals as colours."""
    vertices, faces = load(WHEEL / "bunny.obj")
    g = bf.estimate_vertex_geometry(vertices, faces, **PAPER)
    panels, rows = [bf.Panel(vertices, faces, colors=0.5 + 0.5 * g.normals, title="normals")], []
    for name, unit in (
        ("mean_curvature", "1/length"),
        ("gaussian_curvature", "1/length²"),
        ("geodesic_torsion", "1/length"),
    ):
        values = getattr(g, name)
        limits = round_limits(*color_range(values, signed=False, percentile=4.0))
        label = name.replace("_", " ")
        panels.append(bf.Panel(vertices, faces, values, label, unit, limits=limits, colormap="Paper", title=label))
        low, middle, high = np.percentile(values, [4, 50, 96])
        rows.append({"field": label, "4 %": low, "median": middle, "96 %": high})
    bf.render_panels(out / "figure_3.png", panels, views=["front"], size=(400, 400))
    return Found("Figure 3: fields of the bunny, red where high", out / "figure_3.png", rows)


def figure_7(out: Path) -> Found:
    """Every vertex is replaced by its place on its patch; volume ratios of closed animals."""
    rows, panels = [], []
    for name in ("bunny", "cow"):
        vertices, faces = load(WHEEL / f"{name}.obj")
        noisy = with_noise(Case(vertices, faces, 0.2), 1)
        for title, points in ((name, vertices), (f"{name} with noise of 0.2 edges", noisy)):
            result = bf.smooth(points, faces, "paper")
            panels += [flat(points, faces, title), flat(result.vertices, faces, "smoothed")]
            ratios = [volume(bf.smooth(points, faces, "paper", iterations=k).vertices, faces) for k in (1, 3)]
            before = volume(points, faces)
            rows.append(
                {
                    "model": title,
                    "volume ratio": ratios[0] / before,
                    "of the clean model": ratios[0] / volume(vertices, faces),
                    "after three passes": ratios[1] / before,
                    "the paper's cat": PAPERS_VOLUME,
                }
            )
    bf.render_panels(out / "figure_7.png", panels, columns=4, views=["front"], size=(400, 330))
    return Found("Figure 7: smoothing, and what becomes of the volume", out / "figure_7.png", rows)


def figure_8(out: Path) -> Found:
    """Smoothing next to other methods, on a model and a part with noise of 0.2 mean edges."""
    fan = bf.fill_holes(*load(ROOT / "sample_meshes" / "fan.ply"))
    models = {"cow": load(WHEEL / "cow.obj"), "fan": (fan.vertices, fan.faces)}
    ways: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
        "noisy": lambda vertices, _: vertices,
        "paper": lambda vertices, faces: bf.smooth(vertices, faces, "paper").vertices,
        "paper, three passes": lambda vertices, faces: bf.smooth(vertices, faces, "paper", iterations=3).vertices,
        "Ohtake, Belyaev, Seidel": adaptive_gaussian_smoothing,
        "Desbrun": implicit_fairing,
        "automatic": lambda vertices, faces: bf.smooth(vertices, faces).vertices,
    }
    rows, panels = [], []
    for name, (vertices, faces) in models.items():
        case = Case(vertices, faces, 0.2)
        noisy = with_noise(case, 1)
        for way, smooth in ways.items():
            points = smooth(noisy, faces)
            found = scores(points, case)
            rows.append(
                {
                    "model": name,
                    "method": way,
                    "normals off [degrees]": found["angle"],
                    "volume of the clean model [%]": found["volume"],
                    "turned faces": int(found["flipped"]),
                }
            )
            panels.append(flat(points, faces, f"{way}: {found['angle']:.1f} degrees"))
    bf.render_panels(out / "figure_8.png", panels, columns=len(ways), views=["front"], size=(330, 330))
    return Found("Figure 8: smoothing next to other methods, noise of 0.2 edges", out / "figure_8.png", rows)


def filled(title: str, vertices: np.ndarray, faces: np.ndarray, ways: dict[str, dict]) -> tuple[list, list]:
    """Panels and rows of a mesh with holes and of its fills."""
    panels, rows = [flat(vertices, faces, title)], []
    for way, options in ways.items():
        result = bf.fill_holes(vertices, faces, **options)
        new = np.arange(len(result.faces)) >= len(faces)
        panels.append(flat(result.vertices, result.faces, way, new))
        rows += [
            {
                "mesh": title,
                "way": way,
                "edges of the rim": hole.edge_count,
                "fill": hole.method or "left open",
                "parts": hole.parts,
                "rim angle [degrees]": hole.rim_dihedral,
                "faces that cut others": hole.self_intersections,
            }
            for hole in result.holes
            if not hole.is_outer_rim
        ]
    return panels, rows


def figure_9(out: Path) -> Found:
    """Holes in smooth models, filled by one patch each."""
    vertices, faces = load(WHEEL / "bunny.obj")
    size = np.linalg.norm(np.ptp(vertices, axis=0))
    for place in (9000, 15000, 21000):
        faces = cut("", vertices, faces, vertices[place], 0.05 * size).faces
    ways: dict[str, dict] = {"paper": {"method": "paper"}, "automatic": {}}
    panels, rows = filled("bunny", vertices, faces, ways)
    more, others = filled("egg carton", *load(ROOT / "sample_meshes" / "punched_patch.ply"), ways)
    bf.render_panels(out / "figure_9_bunny.png", panels, views=["front", "back"], size=(420, 420))
    bf.render_panels(out / "figure_9.png", more, views=["iso"], size=(420, 420), up="z")
    joined(out / "figure_9.png", [out / "figure_9_bunny.png", out / "figure_9.png"])
    return Found("Figure 9: smooth holes", out / "figure_9.png", rows + others)


def figure_10(out: Path) -> Found:
    """A hole across two curved edges: one patch, and a patch for each part that curves cut it into."""
    ways: dict[str, dict] = {
        "one patch": {"method": "paper", "creases": False},
        "a patch for each part": {"method": "paper"},
        "automatic": {},
    }
    panels, rows = filled("fan", *load(ROOT / "sample_meshes" / "fan.ply"), ways)
    bf.render_panels(out / "figure_10.png", panels, views=["iso", "back"], size=(420, 380), up="z")
    return Found("Figure 10: a hole across sharp edges", out / "figure_10.png", rows)


def joined(path: Path, pictures: list[Path]) -> None:
    """Pictures below one another, on white."""
    from matplotlib.image import imread, imsave

    images = [imread(picture)[..., :3] for picture in pictures]
    width = max(image.shape[1] for image in images)
    padded = [np.pad(i, ((0, 0), (0, width - i.shape[1]), (0, 0)), constant_values=1.0) for i in images]
    imsave(path, np.vstack(padded))


def tables(noise: float, number: int, out: Path) -> Found:
    """Deviations from the full model at the vertices that are left."""
    vertices, faces = load(WHEEL / "bunny.obj")
    methods = {
        "paper": ours(smoothness="paper"),
        "OuYang, Feng": ouyang_feng,
        "Razdan, Bae": razdan_bae("edges"),
        "automatic": ours(),
    }
    found = reduction.measured(vertices, faces, methods, reduction.DELETED, (noise,), seed=0)
    rows = []
    for k, measure in enumerate(reduction.MEASURES):
        for method in methods:
            cells = {row[1]: row[3 + k] for row in found if row[2] == method}
            if not np.isnan(list(cells.values())).any():
                rows.append(
                    {"quantity": reduction.TITLES[measure], "method": method} | {f"{d} %": v for d, v in cells.items()}
                )
    model = f"with noise of {noise:g} edges" if noise else "without noise"
    return Found(f"Table {number}: deviation when vertices are deleted, {model}", None, rows)


def table_1(out: Path) -> Found:
    """Deviations on the clean model."""
    return tables(0.0, 1, out)


def table_2(out: Path) -> Found:
    """Deviations on the model with noise."""
    return tables(0.05, 2, out)


def relative(a: np.ndarray, b: np.ndarray) -> float:
    """Median of the differences over the median size, in percent."""
    return float(100 * np.median(np.abs(a - b)) / np.median(np.abs(b)))


def deviations(out: Path) -> Found:
    """What each departure from the paper changes."""
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
    return Found("Deviations from the paper (medians)", None, rows)


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


PARTS: dict[str, Callable[[Path], Found]] = {
    f.__name__: f for f in (figure_3, table_1, table_2, figure_7, figure_8, figure_9, figure_10, deviations)
}


def cell(value: object) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def text_table(rows: list[dict[str, object]]) -> str:
    """Rows as a table of Markdown."""
    lines = ["| " + " | ".join(rows[0]) + " |", "|" + "---|" * len(rows[0])]
    return "\n".join([*lines, *("| " + " | ".join(cell(v) for v in row.values()) + " |" for row in rows)])


def page(found: list[Found], path: Path) -> None:
    """One page with everything in it."""
    parts = ["<!doctype html><meta charset=utf-8><title>The paper's figures</title>",
             "<style>body{font:15px sans-serif;margin:2em;max-width:1500px}img{max-width:100%}"
             "td,th{padding:2px 12px 2px 0;text-align:left;border-bottom:1px solid #ddd}</style>",
             "<h1>The paper's figures and tables</h1><p>Li, Barsky, Jin, An effective third-order local fitting patch "
             "and its application, IEEE SMI 2009; other models stand for the paper's.</p>"]  # fmt: skip
    for item in found:
        parts.append(f"<h2>{html.escape(item.title)}</h2>")
        if item.picture:
            data = base64.b64encode(item.picture.read_bytes()).decode()
            parts.append(f'<img src="data:image/png;base64,{data}">')
        head = "".join(f"<th>{html.escape(name)}" for name in item.rows[0])
        body = "".join("<tr>" + "".join(f"<td>{html.escape(cell(v))}" for v in row.values()) for row in item.rows)
        parts.append(f"<table><tr>{head}{body}</table>")
    path.write_text("\n".join(parts), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[[], *PARTS], help="by default all, and the page")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "paper", help="folder for pictures and page")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    found = []
    for name in options.parts or PARTS:
        start = time.perf_counter()
        found.append(PARTS[name](options.out))
        print(f"\n{found[-1].title}\n\n{text_table(found[-1].rows)}", flush=True)
        print(f"{name}: {time.perf_counter() - start:.0f} s", file=sys.stderr)
    if not options.parts:
        page(found, options.out / "paper.html")
        print(f"\nwrote {options.out / 'paper.html'}")


if __name__ == "__main__":
    main()
