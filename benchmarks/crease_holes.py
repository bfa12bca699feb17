"""How many holes get the sharp edges that were in them, judged by the edges of the whole mesh.

    python benchmarks/crease_holes.py fandisk.obj --seeds 0 1 --noise 0.1

Holes are random and connected: 25 that two sharp edges enter, 25 that four do, and 25 with a corner inside.
"""

import argparse
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

import bezier_filters as bf
from bezier_filters.meshes.half_edges import mesh_edges
from bezier_filters.meshes.mesh import triangle_mesh
from cut_holes import Case, compact, normals
from sub_holes import load, random_cuts, rms

TRULY_SHARP = 30.0  # degrees
KINDS = ("2", "4", "corner")


def keys(edges: np.ndarray, count: int) -> np.ndarray:
    """A number for each edge (e, 2) of a mesh of so many vertices, whatever its direction."""
    pairs = np.sort(edges.astype(np.int64), axis=1)
    return pairs[:, 0] * count + pairs[:, 1]


def edge_keys(faces: np.ndarray, count: int) -> np.ndarray:
    """The same for the edges of some faces."""
    return keys(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), count)


def kind_of(case: Case, sharp: np.ndarray) -> str:
    """Number of vertices of the rim at which sharp edges enter the hole, or "corner"; empty if it is of no use."""
    count = len(case.vertices)
    kept = edge_keys(case.faces, count)
    inside = np.setdiff1d(np.intersect1d(edge_keys(case.removed, count), sharp), kept)
    on_rim = np.zeros(count, dtype=bool)
    on_rim[np.intersect1d(case.removed, case.faces)] = True
    loops = bf.boundary_loops(triangle_mesh(case.vertices, case.faces))
    if not len(inside) or len(loops) != 1 or len(loops[0]) != on_rim.sum():
        return ""
    meeting = np.bincount(np.concatenate([inside // count, inside % count]), minlength=count)
    return "corner" if (meeting[~on_rim] > 2).any() else str((meeting[on_rim] > 0).sum())


def holes_of_kind(kind: str, vertices: np.ndarray, faces: np.ndarray, count: int, seed: int) -> Iterator[Case]:
    """Random holes of a kind."""
    edges = mesh_edges(triangle_mesh(vertices, faces))
    sharp = keys(edges.vertices[edges.angles > np.radians(TRULY_SHARP)], len(vertices))
    fitting = (case for case in random_cuts(kind, vertices, faces, seed) if kind_of(case, sharp) == kind)
    for number, case in enumerate(islice(fitting, count)):
        yield case._replace(name=f"{kind}, {number}")


def with_noise(vertices: np.ndarray, faces: np.ndarray, noise: float, seed: int) -> np.ndarray:
    """Vertices moved along their normals by independent errors of so many edges."""
    sums = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(sums, faces[:, corner], normals(vertices, faces))
    length = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2).mean()
    error = noise * length * np.random.default_rng(seed).standard_normal((len(vertices), 1))
    return vertices + error * sums / np.linalg.norm(sums, axis=1, keepdims=True)


def main() -> None:
    """Print the holes that failed, and a line for each seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path, help="a closed part with sharp edges")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="of the places and sizes")
    parser.add_argument("--count", type=int, default=25, help="number of holes of each kind")
    parser.add_argument("--noise", type=float, default=0.0, help="standard deviation along the normal, in edges")
    options = parser.parse_args()
    vertices, faces = load(options.mesh)
    for seed in options.seeds:
        made, errors = dict.fromkeys(KINDS, 0), []
        for kind in KINDS:
            for number, case in enumerate(holes_of_kind(kind, vertices, faces, options.count, seed)):
                points, kept = compact(case.vertices, case.faces)
                points = with_noise(points, kept, options.noise, 1000 * seed + number)
                result = bf.fill_holes(points, kept)
                (hole,) = result.holes
                made[kind] += len(hole.creases) > 0
                errors.append(rms(case, result.vertices, result.faces[len(kept) :]))
                if not len(hole.creases):
                    print(f"  {case.name}: {hole.method}; {hole.reason}")
        text = ", ".join(f"{kind}: {count}" for kind, count in made.items())
        print(
            f"seed {seed}: {sum(made.values())} of {len(errors)} holes get creases ({text}); off by "
            f"{np.median(errors):.2f} % in the median, {np.mean(errors):.2f} on average"
        )


if __name__ == "__main__":
    main()
