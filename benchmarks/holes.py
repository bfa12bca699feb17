"""Hole filling next to other libraries: how far fills are from the surface that was cut out.

Holes are cut from shapes whose surface is then known: analytic ones, the bunny that pymeshlab ships, and, where a
folder of cases is given (npz files with vertices, faces and removed_faces), those. The score is the RMS distance
between fill and removed surface, the larger of both ways, in percent of the hole's diameter. Beside it: the mean
angle between faces along the rim, and that of the removed surface, whether the result is closed, manifold and
oriented, new faces that cut others, mean of the smallest angles of the new triangles, and seconds.
"""

import argparse
import csv
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import igl
import numpy as np
import pymeshlab
from scipy.spatial import cKDTree

import bezier_filters as bf
from bezier_filters import surfaces
from bezier_filters.holes.loops import diameter
from bezier_filters.meshes.self_intersections import cut_faces
from bezier_filters.meshlab.meshset import bunny_path
from cut_holes import Case, compact, cut, normals, surface_points
from hole_peers import Filler, fillers

RESULTS = Path(__file__).parent / "results"
SMALLEST = 0.01
"""RMS, in percent, that counts as no error in ratios: blocks are continued exactly."""


class Score(NamedTuple):
    """What a fill is worth; see the module."""

    rms: float
    rim_angle: float
    true_rim_angle: float
    valid: bool
    cuts: int
    angle: float
    seconds: float


def own_cases() -> Iterator[Case]:
    ball, star = surfaces.sphere(resolution=28), surfaces.bumpy_star(resolution=28)
    ring, waves = surfaces.torus(resolution=32), surfaces.ellipsoid(resolution=28)
    for share in (0.1, 0.3, 0.6):
        yield cut(f"sphere {share}", ball.vertices, ball.faces, np.array([0.3, 0.4, 0.87]), 2 * share)
        yield cut(f"bumpy star {share}", star.vertices, star.faces, star.vertices[100], 1.5 * share)
        yield cut(f"ellipsoid {share}", waves.vertices, waves.faces, waves.vertices[50], 1.5 * share)
    for place in ((1.4, 0.0, 0.0), (0.6, 0.0, 0.0), (1.0, 0.0, 0.4)):
        yield cut(f"torus at {place[0]}", ring.vertices, ring.faces, np.array(place), 0.3)
    vertices, faces = surfaces.block_with_sharp_edges(resolution=32)
    for name, place in (("edge", (-0.5, -0.5, 0.0)), ("corner", (-0.5, -0.5, -0.5)), ("valley", (0.0, 0.0, 0.3))):
        yield cut(f"block, {name}", vertices, faces, np.array(place), 0.15)
    meshset = pymeshlab.MeshSet()
    meshset.load_new_mesh(str(bunny_path()))
    mesh = meshset.current_mesh()
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix().astype(np.int32)
    size = np.linalg.norm(np.ptp(vertices, axis=0))
    for number in (3000, 9000, 15000, 21000):
        yield cut(f"bunny {number}", vertices, faces, vertices[number], 0.04 * size)


def cases_of(folder: Path) -> Iterator[Case]:
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as data:
            yield Case(path.stem, data["vertices"], data["faces"], data["removed_faces"])


def distances(vertices: np.ndarray, faces: np.ndarray, other: np.ndarray, other_faces: np.ndarray) -> float:
    """RMS distance from points spread over some faces to another surface."""
    points = surface_points(vertices, faces)
    squares = igl.point_mesh_squared_distance(points, other, other_faces.astype(np.int64))[0]
    return float(np.sqrt(squares.mean()))


def rim_angle(vertices: np.ndarray, inside: np.ndarray, outside: np.ndarray) -> float:
    """Mean angle between faces on both sides of the rim, in degrees."""

    def by_edge(faces: np.ndarray) -> dict[tuple[int, int], np.ndarray]:
        unit = normals(vertices, faces)
        unit /= np.maximum(np.linalg.norm(unit, axis=1, keepdims=True), 1e-300)
        return {(f[k], f[(k + 1) % 3]): n for f, n in zip(faces.tolist(), unit, strict=True) for k in range(3)}

    own, other = by_edge(inside), by_edge(outside)
    chords = [np.linalg.norm(own[a, b] - other[b, a]) for a, b in own if (b, a) in other]
    return float(np.degrees(2 * np.arcsin(np.minimum(0.5 * np.array(chords), 1))).mean()) if chords else float("nan")


def smallest_angles(vertices: np.ndarray, faces: np.ndarray) -> float:
    corners = vertices[faces]
    u, v = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    angles = np.degrees(np.arctan2(np.linalg.norm(np.cross(u, v), axis=2), (u * v).sum(axis=2)))
    return float(angles.min(axis=1).mean())


def matched(vertices: np.ndarray, mesh: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """A filled mesh with the old vertices first, as they were, wherever the filler put them."""
    new_vertices, new_faces = mesh
    tolerance = 1e-5 * np.linalg.norm(np.ptp(vertices, axis=0))  # some libraries compute in single precision
    distance, nearest = cKDTree(vertices).query(new_vertices)
    added = np.flatnonzero(distance > tolerance)
    names = nearest.copy()
    names[added] = len(vertices) + np.arange(len(added))
    return np.vstack([vertices, new_vertices[added]]), names[new_faces].astype(np.int32)


def is_closed_manifold(faces: np.ndarray) -> bool:
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    there, back = (set(map(tuple, part.tolist())) for part in (edges, edges[:, ::-1]))
    return len(there) == len(edges) and there == back


def judge(case: Case, filler: Filler) -> Score:
    vertices, faces = compact(case.vertices, case.faces)
    start = time.perf_counter()
    try:
        mesh = filler(vertices, faces)
    except RuntimeError:  # how libraries say that they cannot
        mesh = vertices, faces
    seconds = time.perf_counter() - start
    result, result_faces = matched(vertices, mesh)
    old = {tuple(sorted(face)) for face in faces.tolist()}
    is_new = np.array([tuple(sorted(face)) not in old for face in result_faces.tolist()])
    fill = result_faces[is_new]
    if len(fill) == 0:
        return Score(*3 * [float("nan")], False, 0, float("nan"), seconds)
    rim = np.intersect1d(case.faces, case.removed)
    size = diameter(case.vertices[rim])
    rms = max(
        distances(result, fill, case.vertices, case.removed), distances(case.vertices, case.removed, result, fill)
    )
    truth = rim_angle(case.vertices, case.removed, case.faces)
    valid = is_closed_manifold(result_faces)
    cuts = int(cut_faces(result, np.vstack([result_faces[~is_new], fill]), len(fill)).sum())
    own = rim_angle(result, fill, result_faces[~is_new])
    return Score(100 * rms / size, own, truth, valid, cuts, smallest_angles(result, fill), seconds)


def draw(case: Case, filler: Filler, path: Path) -> None:
    """The fill, in colour, from in front of it, next to the removed surface."""
    import pyvista

    vertices, faces = compact(case.vertices, case.faces)
    result, result_faces = filler(vertices, faces)
    rim = case.vertices[np.intersect1d(case.faces, case.removed)]
    towards = normals(case.vertices, case.removed).sum(axis=0)
    towards /= np.linalg.norm(towards)
    with pyvista.vtk_verbosity("error"):
        plotter = pyvista.Plotter(off_screen=True, window_size=(1200, 600), shape=(1, 2), border=False)
        panels = (
            ("removed", case.vertices, case.faces, case.removed),
            ("filled", result, result_faces[: len(faces)], result_faces[len(faces) :]),
        )
        for column, (title, points, old, new) in enumerate(panels):
            plotter.subplot(0, column)
            text = plotter.add_text(title, font_size=12)
            text.prop.background_color, text.prop.background_opacity = "white", 1.0
            for part, color in ((old, "lightgray"), (new, "orange")):
                plotter.add_mesh(pyvista.PolyData.from_regular_faces(points, part), color=color, show_edges=True)
            plotter.camera.focal_point = rim.mean(axis=0)
            plotter.camera.position = rim.mean(axis=0) + 3 * diameter(rim) * towards
            plotter.camera.parallel_projection = True
            plotter.camera.parallel_scale = 0.7 * diameter(rim)
        plotter.screenshot(path)
        plotter.close()


def summary(rows: list[dict[str, object]], names: list[str]) -> None:
    """Geometric mean of RMS relative to ours, where both are valid, and how many are."""
    by_key = {(row["case"], row["filler"]): row for row in rows}
    heading = "valid  without cuts  RMS / ours  rim angle (truth)  smallest angle  seconds"
    print(f"\n{'':22}{heading}")
    for name in names:
        own = [by_key[case, name] for case, filler in by_key if filler == name]
        good = [row for row in own if row["valid"] and by_key[row["case"], "ours"]["valid"]]
        pairs = np.array([(row["rms"], by_key[row["case"], "ours"]["rms"]) for row in good]).reshape(-1, 2)
        theirs, own_rms = np.log(np.maximum(pairs, SMALLEST)).T
        ratio = np.exp((theirs - own_rms).mean()) if len(good) else float("nan")
        mean = {key: np.mean([row[key] for row in good]) for key in ("rim_angle", "true_rim_angle", "angle", "seconds")}
        valid, clean = sum(bool(r["valid"]) for r in own), sum(bool(r["valid"]) and r["cuts"] == 0 for r in own)
        counts = f"{valid:5}/{len(own)}{clean:11}/{len(own)}"
        angles = f"{mean['rim_angle']:12.1f} ({mean['true_rim_angle']:4.1f}){mean['angle']:16.1f}"
        print(f"{name:20}{counts}{ratio:12.2f}{angles}{mean['seconds']:9.2f}")


def kept_rows(run: list[dict[str, object]]) -> list[dict[str, object]]:
    """Rows that are stored of fillers and cases which have not been run."""
    new = {(row["case"], row["filler"]) for row in run}
    with (RESULTS / "holes.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if (row["case"], row["filler"]) not in new]
    words = {"case": str, "filler": str, "valid": lambda text: text == "True", "cuts": int}
    return [{key: words.get(key, float)(value) for key, value in row.items()} for row in rows]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, help="folder of further cases")
    parser.add_argument("--only", default="", help="cases whose name begins like this")
    parser.add_argument("--no-peers", action="store_true", help="our fills alone")
    parser.add_argument("--save", action="store_true", help="write benchmarks/results/holes.csv and pictures of fills")
    options = parser.parse_args()
    contenders = fillers(peers=not options.no_peers)
    cases = [*own_cases(), *(cases_of(options.cases) if options.cases else ())]
    cases = [case for case in cases if case.name.startswith(options.only)]
    bf.fill_holes(*compact(cases[0].vertices, cases[0].faces))  # compile
    rows: list[dict[str, object]] = []
    print(f"RMS in % of the hole's diameter; ! not valid, x cuts\n{'':20}" + "".join(f"{n:>20}" for n in contenders))
    for case in cases:
        print(f"{case.name:20}", end="", flush=True)
        for name, filler in contenders.items():
            score = judge(case, filler)
            rows.append({"case": case.name, "filler": name, **score._asdict()})
            mark = ("" if score.valid else "!") + ("x" if score.cuts else "")
            print(f"{score.rms:>18.3f}{mark:2}", end="", flush=True)
        print()
    if options.save:
        rows += kept_rows(rows)
    summary(rows, list(dict.fromkeys(row["filler"] for row in rows)))
    if options.save:
        with (RESULTS / "holes.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)
        for case in cases:
            if case.name.startswith(("block, corner", "block, edge", "bunny 9000", "torus at 1.4", "fandisk")):
                draw(case, contenders["ours"], RESULTS / f"holes_{case.name.replace(', ', '_').replace(' ', '_')}.png")


if __name__ == "__main__":
    main()
