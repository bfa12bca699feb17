"""The paper's figures and tables, each from one command, and a page with all of them.

    python benchmarks/paper_figures.py              # all of them and paper.html, into build/paper
    python benchmarks/paper_figures.py figure_7     # one of them
    python benchmarks/paper_figures.py --out FOLDER
    python benchmarks/paper_figures.py --models FOLDER

Figure 3: the patch through eight points, by a random S and by the paper's; 4: a model and its normals; 5: its mean and
Gaussian curvature; 6: its principal geodesic torsion; 7: smoothing, with the volume ratio; 8: smoothing next to Ohtake,
Belyaev and Seidel (2002) and to Desbrun et al. (1999); 9: holes of the bunny; 10: a hole across sharp edges. Table 1:
how far normals move when vertices are deleted, next to OuYang and Feng (2005); Table 2: H and K, next to Razdan and Bae
(2005); both without and with noise. Figures 8 to 10 take fandisk, a dragon and the Stanford bunny from a folder of
common test models, where file names have these words; meshes of the pymeshlab wheel and of this project stand in for
those that are not there. `deviations` measures where ours departs from the paper: see docs/deviations.md.
"""

import argparse
import base64
import html
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

import bezier_filters as bf
import reduction
from baselines import adaptive_gaussian_smoothing
from bezier_filters import surfaces
from bezier_filters.display import color_range, round_limits
from bezier_filters.holes.influence_region import farthest_point_sample
from bezier_filters.patches.bernstein import design_matrix
from bezier_filters.patches.smoothness import smoothness_matrix
from paper_deviations import PAPER, WHEEL, deviations
from paper_hole_figures import figure_9, figure_10
from paper_models import FAN, OLD, Found, Where, flat, joined
from peers import ours, ouyang_feng, razdan_bae
from smoothing import Case, scores, with_noise
from smoothing_peers import implicit_fairing, volume
from sub_holes import load

ROOT = Path(__file__).parents[1]
TABLE_NOISE = 0.05
"""Of the tables, standard deviation in mean edges."""
PAPERS_VOLUME = 0.9936
"""Volume ratio that the paper gives for its cat."""
RED, BLUE = (0.85, 0.1, 0.1), (0.1, 0.25, 0.8)
NO_MODELS = "Other models stand in for its fandisk, dragon and Stanford bunny; make paper MODELS=folder takes these."


def eight_points() -> np.ndarray:
    """A vertex at the top of a sphere of radius 2 around (0, 0, -2), and seven neighbours, uneven, about one away."""
    rng = np.random.default_rng(0)
    angles = 2.0 * np.pi * (np.arange(7) + 0.25 * rng.uniform(-1.0, 1.0, 7)) / 7.0
    radii = 1.0 + 0.2 * rng.uniform(-1.0, 1.0, 7)
    x, y = np.r_[0.0, radii * np.cos(angles)], np.r_[0.0, radii * np.sin(angles)]
    return np.column_stack([x, y, np.sqrt(4.0 - x * x - y * y) - 2.0])


def off_sphere(points: np.ndarray) -> float:
    """RMS distance of points to that sphere, in percent of its radius."""
    distances = np.linalg.norm(points - np.array([0.0, 0.0, -2.0]), axis=1) - 2.0
    return float(100.0 * np.sqrt(np.square(distances).mean()) / 2.0)


def control_points(points: np.ndarray, s: np.ndarray, alpha: float = 0.8) -> np.ndarray:
    """Those of the patch that solves [alpha A; (1 - alpha) S] b = [alpha P; 0], (16, 3)."""
    low, sides = points[:, :2].min(axis=0), np.ptp(points[:, :2], axis=0)
    system = np.vstack([alpha * design_matrix(*((points[:, :2] - low) / sides).T, 3), (1.0 - alpha) * s])
    return np.linalg.lstsq(system, np.vstack([alpha * points, np.zeros((len(s), 3))]), rcond=None)[0]


def figure_3(where: Where) -> Found:
    """The bicubic patch of eight points, which leave half of its control points to the rows of S."""
    points = eight_points()
    grid = np.linspace(0.0, 1.0, 41)
    basis = design_matrix(*(k.ravel() for k in np.meshgrid(grid, grid, indexing="ij")), 3)
    random = [control_points(points, np.random.default_rng(seed).standard_normal((8, 16))) for seed in range(99)]
    random.sort(key=lambda net: off_sphere(basis @ net))
    nets = {"random S": random} | {
        title: [control_points(points, smoothness_matrix(kind, 3))]
        for title, kind in (("the paper's S", "paper"), ("third derivatives", "third_order"))
    }
    rows = []
    for k, (title, several) in enumerate(nets.items()):
        net = several[len(several) // 2]
        off = [off_sphere(basis @ one) for one in several]
        rows.append(
            {
                "S": title,
                "number of them": len(several),
                "patch off the sphere, RMS [% of the radius]": float(np.median(off)),
                "least": min(off),
                "most": max(off),
            }
        )
        panel = patch_panel((basis @ net).reshape(41, 41, 3), points, title)
        bf.render_panels(where.out / f"figure_3_{k}.png", [panel], views=["iso"], size=(420, 420), up="z")
    joined(where.out / "figure_3.png", [where.out / f"figure_3_{k}.png" for k in range(len(nets))], axis=1)
    note = (
        "The points (red) lie on a sphere. Each patch has a scale of its own; of the random ones the middle is shown."
    )
    return Found("Figure 3: the patch of eight points by different S", where.out / "figure_3.png", rows, note)


def patch_panel(surface: np.ndarray, points: np.ndarray, title: str) -> bf.Panel:
    """A patch (k, k, 3) with lines of equal parameters and the points that it is fitted to."""
    side = len(surface)
    place = np.arange(side * side).reshape(side, side)
    a, b, c, d = (k.ravel() for k in (place[:-1, :-1], place[1:, :-1], place[1:, 1:], place[:-1, 1:]))
    size = np.linalg.norm(np.ptp(surface, axis=(0, 1)))
    ball = surfaces.sphere(radius=0.015 * size, resolution=6)
    balls = (points[:, np.newaxis] + ball.vertices).reshape(-1, 3)
    of_balls = (ball.faces + len(ball.vertices) * np.arange(len(points))[:, np.newaxis, np.newaxis]).reshape(-1, 3)
    faces = np.vstack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1), of_balls + side * side])
    step = (side - 1) // 8
    return bf.Panel(
        np.vstack([surface.reshape(-1, 3), balls]),
        faces.astype(np.int32),
        colors=np.vstack([np.tile(OLD, (side * side, 1)), np.tile(RED, (len(balls), 1))]),
        title=title,
        lines=[(line, BLUE) for line in (*surface[::step], *surface.transpose(1, 0, 2)[::step])],
        line_radius=0.002 * size,
    )


@cache
def paper_geometry() -> tuple[np.ndarray, np.ndarray, bf.VertexGeometry]:
    """The closed bunny of the wheel, and what the paper's method says of it."""
    vertices, faces = load(WHEEL / "bunny.obj")
    return vertices, faces, bf.estimate_vertex_geometry(vertices, faces, **PAPER)


def figure_4(where: Where) -> Found:
    """A model and its normals, as lines and as colours."""
    vertices, faces, g = paper_geometry()
    size = np.linalg.norm(np.ptp(vertices, axis=0))
    spread = farthest_point_sample(vertices, np.zeros(len(vertices), dtype=bool), 900)
    lines = [(np.stack([vertices[k], vertices[k] + 0.03 * size * g.normals[k]]), BLUE) for k in spread]
    grey = np.tile(OLD, (len(vertices), 1))
    panels = [
        bf.Panel(vertices, faces, colors=grey, title="model"),
        bf.Panel(vertices, faces, colors=grey, title="normals", lines=lines, line_radius=size / 900.0),
        bf.Panel(vertices, faces, colors=0.5 + 0.5 * g.normals, title="(1 + normal) / 2 as red, green, blue"),
    ]
    bf.render_panels(where.out / "figure_4.png", panels, views=["front"], size=(400, 400))
    rows = [{"vertices": len(vertices), "normals drawn": len(lines)} | g.status_counts()]
    return Found("Figure 4: the bunny and its normals", where.out / "figure_4.png", rows)


def of_fields(where: Where, number: int, fields: dict[str, str], colormap: str, title: str) -> Found:
    """Fields, with their units, of the bunny in colours; four percent of the values lie beyond each end."""
    vertices, faces, g = paper_geometry()
    panels, rows = [], []
    for name, unit in fields.items():
        values = getattr(g, name)
        limits = round_limits(*color_range(values, signed=False, percentile=4.0))
        label = name.replace("_", " ").replace("gaussian", "Gaussian")
        panels.append(bf.Panel(vertices, faces, values, label, unit, limits=limits, colormap=colormap, title=label))
        low, middle, high = np.percentile(values, [4, 50, 96])
        rows.append({"field": f"{label} [{unit}]", "4 %": low, "median": middle, "96 %": high})
    path = where.out / f"figure_{number}.png"
    bf.render_panels(path, panels, views=["front", "back"], size=(400, 400))
    return Found(f"Figure {number}: {title}", path, rows)


def figure_5(where: Where) -> Found:
    """Mean and Gaussian curvature by the paper's method."""
    fields = {"mean_curvature": "1/length", "gaussian_curvature": "1/length²"}
    title = "mean and Gaussian curvature of the bunny, red high, green medium, blue low"
    return of_fields(where, 5, fields, "Paper Curvature", title)


def figure_6(where: Where) -> Found:
    """Principal geodesic torsion by the paper's method."""
    title = "principal geodesic torsion of the bunny, red high, blue medium, green low"
    return of_fields(where, 6, {"geodesic_torsion": "1/length"}, "Paper", title)


def figure_7(where: Where) -> Found:
    """Every vertex is replaced by its place on its patch; volume ratios of closed animals."""
    rows, pictures = [], []
    for name in ("bunny", "cow"):
        panels = []
        vertices, faces = load(WHEEL / f"{name}.obj")
        noisy = with_noise(Case(vertices, faces, 0.2), 1)
        for title, points in ((name, vertices), (f"{name}, noise of 0.2 edges", noisy)):
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
        pictures.append(where.out / f"figure_7_{name}.png")
        bf.render_panels(pictures[-1], panels, views=["iso"], size=(400, 330), up="y")
    joined(where.out / "figure_7.png", pictures)
    return Found("Figure 7: smoothing, and what becomes of the volume", where.out / "figure_7.png", rows)


def figure_8(where: Where) -> Found:
    """Smoothing next to other methods, on a dragon and a part with noise of 0.2 mean edges."""
    dragon = where.model("dragon", ("dragon",), WHEEL / "cow.obj")
    part = where.model("fandisk", ("fandisk",), FAN)
    if not part.is_found:
        fan = bf.fill_holes(part.vertices, part.faces)
        part = part._replace(vertices=fan.vertices, faces=fan.faces)
    ways: dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
        "noisy": lambda vertices, _: vertices,
        "paper": lambda vertices, faces: bf.smooth(vertices, faces, "paper").vertices,
        "paper, three passes": lambda vertices, faces: bf.smooth(vertices, faces, "paper", iterations=3).vertices,
        "Ohtake, Belyaev, Seidel": adaptive_gaussian_smoothing,
        "Desbrun et al.": implicit_fairing,
        "automatic": lambda vertices, faces: bf.smooth(vertices, faces).vertices,
    }
    rows, pictures = [], []
    for number, (name, vertices, faces, is_found) in enumerate((dragon, part)):
        case = Case(vertices, faces, 0.2)
        noisy = with_noise(case, 1)
        panels = [flat(vertices, faces, "clean")]
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
            panels.append(flat(points, faces, f"{way}: {found['angle']:.1f}°"))
        pictures.append(where.out / f"figure_8_{number}.png")
        up = "y" if is_found or number == 0 else "z"
        bf.render_panels(pictures[-1], panels, columns=4, views=["iso"], size=(400, 330), title=name, up=up)
    joined(where.out / "figure_8.png", pictures)
    title = "Figure 8: smoothing next to other methods, noise of 0.2 edges, mean angle between normals and clean ones"
    return Found(title, where.out / "figure_8.png", rows)


@cache
def measured() -> list[tuple]:
    """How far estimates move when vertices are deleted, without and with noise; see `reduction`."""
    methods = {"paper": ours(smoothness="paper"), "OuYang, Feng": ouyang_feng, "Razdan, Bae": razdan_bae("edges")}
    vertices, faces = load(WHEEL / "bunny.obj")
    levels = 0.0, TABLE_NOISE
    return reduction.measured(vertices, faces, {**methods, "automatic": ours()}, reduction.DELETED, levels, seed=0)


def table(number: int, measures: tuple[str, ...], methods: tuple[str, ...], title: str) -> Found:
    """Deviations from the full model at the vertices that are left."""
    rows = []
    for measure in measures:
        column = 3 + reduction.MEASURES.index(measure)
        for noise in (0.0, TABLE_NOISE):
            for method in methods:
                cells = {f"{row[1]} %": row[column] for row in measured() if row[0] == noise and row[2] == method}
                model = f"noise of {noise:g} edges" if noise else "without noise"
                rows.append({"quantity": reduction.TITLES[measure], "model": model, "method": method} | cells)
    note = "Columns: share of the vertices deleted. Deviation of each method from its own estimate on the full model."
    return Found(f"Table {number}: {title}", None, rows, note)


def table_1(_: Where) -> Found:
    """Normals, next to OuYang and Feng."""
    return table(1, ("normal",), ("paper", "OuYang, Feng", "automatic"), "how far normals move, in the mean")


def table_2(_: Where) -> Found:
    """Mean and Gaussian curvature, next to Razdan and Bae."""
    title = "how far H and K move, sum of the differences over sum of the references"
    return table(2, ("H", "K"), ("paper", "Razdan, Bae", "automatic"), title)


PARTS: dict[str, Callable[[Where], Found]] = {
    f.__name__: f
    for f in (figure_3, figure_4, figure_5, figure_6, table_1, table_2, figure_7, figure_8, figure_9, figure_10)
} | {"deviations": lambda _: Found("Deviations from the paper (medians)", None, deviations())}


def cell(value: object) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def text_table(rows: list[dict[str, object]]) -> str:
    """Rows as a table of Markdown."""
    lines = ["| " + " | ".join(rows[0]) + " |", "|" + "---|" * len(rows[0])]
    return "\n".join([*lines, *("| " + " | ".join(cell(v) for v in row.values()) + " |" for row in rows)])


def page(found: list[Found], path: Path, models: str) -> None:
    """One page with everything in it."""
    parts = ["<!doctype html><meta charset=utf-8><title>The paper's figures</title>",
             "<style>body{font:15px sans-serif;margin:2em;max-width:1500px}img{max-width:100%}"
             "td,th{padding:2px 12px 2px 0;text-align:left;border-bottom:1px solid #ddd}</style>",
             "<h1>The paper's figures and tables</h1><p>Li, Barsky, Jin, An effective third-order local fitting patch "
             "and its application, IEEE SMI 2009. " + html.escape(models) + "</p>"]  # fmt: skip
    for item in found:
        parts.append(f"<h2>{html.escape(item.title)}</h2>")
        if item.picture:
            data = base64.b64encode(item.picture.read_bytes()).decode()
            parts.append(f'<img src="data:image/png;base64,{data}">')
        parts.append(f"<p>{html.escape(item.note)}</p>" * bool(item.note))
        head = "".join(f"<th>{html.escape(name)}" for name in item.rows[0])
        body = "".join("<tr>" + "".join(f"<td>{html.escape(cell(v))}" for v in row.values()) for row in item.rows)
        parts.append(f"<table><tr>{head}{body}</table>")
    path.write_text("\n".join(parts), encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[[], *PARTS], help="by default all, and the page")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "paper", help="folder for pictures and page")
    parser.add_argument("--models", type=Path, help="folder with fandisk, a dragon and the Stanford bunny")
    options = parser.parse_args()
    if options.models is not None and not options.models.is_dir():
        parser.error(f"--models: got {str(options.models)!r}, expected a folder")
    options.out.mkdir(parents=True, exist_ok=True)
    where, found = Where(options.out, options.models), []
    begin = time.perf_counter()
    for name in options.parts or PARTS:
        start = time.perf_counter()
        found.append(PARTS[name](where))
        print(f"\n{found[-1].title}\n\n{text_table(found[-1].rows)}", flush=True)
        if found[-1].note:
            print(f"\n{found[-1].note}", flush=True)
        print(f"{name}: {time.perf_counter() - start:.0f} s", file=sys.stderr)
    if not options.parts:
        page(found, options.out / "paper.html", NO_MODELS if options.models is None else "")
        print(f"\nwrote {options.out / 'paper.html'}", f"in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
