"""Holes across sharp edges filled in the paper's way (Figure 10): curves cut them, and each part has a patch.

    python benchmarks/sub_holes.py fandisk.obj  # 25 random connected holes with four crease ends

RMS distance between fill and removed surface, the larger of both ways, in percent of the hole's diameter, for the
paper's way, one patch (``creases=False``) and the default.
"""

import argparse
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pymeshlab
import pyvista

import bezier_filters as bf
from bezier_filters.holes.crease_ends import crease_ends, sharp_edge_graph
from bezier_filters.holes.hole_detection import find_holes
from bezier_filters.holes.influence_region import influence_regions
from bezier_filters.holes.loops import diameter
from bezier_filters.meshes.mesh import triangle_mesh
from bezier_filters.meshes.prepared_mesh import prepare_mesh
from cut_holes import Case, compact, cut, surface_points

SMALLEST, LARGEST = 0.03, 0.12
"""Radii of the balls in which faces are cut out, times the diagonal."""
WAYS: dict[str, dict[str, object]] = {
    "paper": {"method": "paper"},
    "one patch": {"method": "paper", "creases": False},
    "automatic": {},
}


def random_cuts(name: str, vertices: np.ndarray, faces: np.ndarray, seed: int) -> Iterator[Case]:
    """Holes of random places and sizes, without end."""
    rng = np.random.default_rng(seed)
    size = np.linalg.norm(np.ptp(vertices, axis=0))
    while True:
        place, radius = vertices[rng.integers(len(vertices))], rng.uniform(SMALLEST, LARGEST) * size
        yield cut(name, vertices, faces, place, radius)


def random_holes(vertices: np.ndarray, faces: np.ndarray, count: int, ends: int, seed: int) -> Iterator[Case]:
    """Holes of random places and sizes whose rim is one loop with so many crease ends."""
    fitting = (case for case in random_cuts("hole", vertices, faces, seed) if _ends_of(case) == ends)
    for number, case in enumerate(islice(fitting, count)):
        yield case._replace(name=f"{case.name} {number}")


def _ends_of(case: Case) -> int:
    """Number of crease ends at a hole, -1 if its rim is not one simple loop."""
    mesh = prepare_mesh(triangle_mesh(*compact(case.vertices, case.faces)))
    holes = find_holes(mesh)
    if len(holes) != 1:
        return -1
    (region,) = influence_regions(mesh, [holes[0].loops])
    return len(crease_ends(region, sharp_edge_graph(region))[0]) if region.has_simple_rim else -1


def rms(case: Case, vertices: np.ndarray, fill: np.ndarray) -> float:
    """RMS distance between a fill and what was removed, the larger of both ways, in percent of the diameter."""
    squares = []
    pair = (vertices, fill), (case.vertices, case.removed)
    for (points, own), (others, faces) in (pair, pair[::-1]):
        surface = pyvista.PolyData.from_regular_faces(np.asarray(others, dtype=np.float64), faces)
        spread = surface_points(points, own)
        nearest = surface.find_closest_cell(spread, return_closest_point=True)[1]
        squares.append(np.square(spread - nearest).sum(axis=1).mean())
    rim = case.vertices[np.intersect1d(case.faces, case.removed)]
    return float(100 * np.sqrt(max(squares)) / diameter(rim))


def judged(cases: Iterator[Case]) -> list[dict[str, object]]:
    """A row for each hole: method, parts and RMS of each way to fill it."""
    rows = []
    for case in cases:
        vertices, faces = compact(case.vertices, case.faces)
        row: dict[str, object] = {"case": case.name}
        for name, options in WAYS.items():
            result = bf.fill_holes(vertices, faces, **options)  # type: ignore[arg-type]
            (hole,) = result.holes
            row |= {f"{name}: method": hole.method, f"{name}: parts": hole.parts}
            row[f"{name}: RMS"] = rms(case, result.vertices, result.faces[len(faces) :])
        rows.append(row)
    return rows


def load(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a mesh."""
    meshset = pymeshlab.MeshSet()
    meshset.load_new_mesh(str(path))
    mesh = meshset.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int32)


def summary(rows: list[dict[str, object]]) -> str:
    """How many holes have patches, and how far fills are off in the median."""
    patches = sum(row["paper: method"] == "paper" for row in rows)
    divided = sum(row["paper: method"] == "paper" and row["paper: parts"] > 1 for row in rows)
    medians = ", ".join(f"{name} {np.median([row[f'{name}: RMS'] for row in rows]):.2f}" for name in WAYS)
    return f"{patches} of {len(rows)} holes have patches, {divided} of them several; RMS in the median: {medians}"


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path, help="a closed part with sharp edges")
    parser.add_argument("--count", type=int, default=25, help="number of holes")
    parser.add_argument("--ends", type=int, default=4, help="ends of creases at each")
    parser.add_argument("--seed", type=int, default=0, help="of the places and sizes")
    options = parser.parse_args()
    rows = judged(random_holes(*load(options.mesh), options.count, options.ends, options.seed))
    for row in rows:
        words = (f"{n}: {row[f'{n}: method']} in {row[f'{n}: parts']}, {row[f'{n}: RMS']:.2f}" for n in WAYS)
        print(f"{row['case']}: {'; '.join(words)}")
    print(summary(rows))


if __name__ == "__main__":
    main()
