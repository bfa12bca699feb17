"""Sharp edges that are found under noise, and normals beside them.

    python benchmarks/edges.py --cases FOLDER fandisk.obj

The truth are the edges of the clean mesh above 30 degrees. Cases have noise of 0.1, 0.2 and 0.3 mean edges along the
normal as `n1` to `n3`; other meshes and other seeds get it here. Normals are judged two edges away from sharp edges and
more, by those of the clean mesh; next to them, what is reached where the mesh is cut apart along its true edges.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

import bezier_filters as bf
from bezier_filters.meshes.half_edges import MeshEdges, mesh_edges
from bezier_filters.meshes.mesh import triangle_mesh
from crease_holes import TRULY_SHARP, keys, with_noise
from peers import angles
from sub_holes import load

LEVELS = (0.1, 0.2, 0.3)
ROUND = ("sphere", "star", "eight", "kitten")


def parts_between(edges: MeshEdges, is_sharp: np.ndarray) -> np.ndarray:
    """Number of the part of each face that is left if the mesh is cut along some edges."""
    of_faces = np.repeat(np.arange(len(edges.of_faces)), 3)
    order = np.argsort(edges.of_faces.ravel(), kind="stable")
    sides = edges.of_faces.ravel()[order]
    same = (sides[1:] == sides[:-1]) & ~is_sharp[sides[1:]]
    pairs = of_faces[order][:-1][same], of_faces[order][1:][same]
    count = len(edges.of_faces)
    return connected_components(coo_matrix((np.ones(same.sum()), pairs), shape=(count, count)), directed=False)[1]


def normals_of_parts(vertices: np.ndarray, faces: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Normals of the parts, each estimated as a mesh of its own."""
    result = np.zeros_like(vertices)
    for part in range(parts.max() + 1):
        used, local = np.unique(faces[parts == part], return_inverse=True)
        result[used] = bf.estimate_vertex_geometry(vertices[used], local.reshape(-1, 3).astype(np.int32)).normals
    return result


def judge(name: str, clean: np.ndarray, faces: np.ndarray, noisy: dict[str, np.ndarray]) -> None:
    """Print the F1 score of the sharp edges, and the mean errors of normals."""
    edges = mesh_edges(triangle_mesh(clean, faces))
    is_sharp = edges.angles > np.radians(TRULY_SHARP)
    truth, count = keys(edges.vertices[is_sharp], len(clean)), len(clean)
    near = np.zeros(count, dtype=bool)
    near[edges.vertices[is_sharp]] = True
    near[edges.vertices[near[edges.vertices].any(axis=1)]] = True
    parts = parts_between(edges, is_sharp)
    true_normals = normals_of_parts(clean, faces, parts)
    for level, vertices in {"clean": clean, **noisy}.items():
        found = keys(np.asarray(bf.find_creases(vertices, faces).sharp_edges).reshape(-1, 2), count)
        score = 2 * len(np.intersect1d(found, truth)) / max(len(found) + len(truth), 1)
        text = f"{name:10} {level:6} {len(found):5} sharp edges of {len(truth):5}"
        text += f", F1 {score:.3f}" if len(truth) else ""
        if len(truth) and level != "clean":
            ours = bf.estimate_vertex_geometry(vertices, faces).normals
            both = (ours, normals_of_parts(vertices, faces, parts))
            means = [np.mean(angles(normals[~near], true_normals[~near])) for normals in both]
            text += "; normals off by {:.2f} degrees, {:.2f} where cut apart".format(*means)
        print(text, flush=True)


def main() -> None:
    """Judge cases and meshes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", type=Path, nargs="*", help="further meshes without noise")
    parser.add_argument("--cases", type=Path, help="folder of cases/denoising")
    parser.add_argument("--names", nargs="+", default=["block", "cube", "Pyramid", "joint", *ROUND], help="of cases")
    parser.add_argument("--seed", type=int, help="noise of a seed instead of that of the cases")
    options = parser.parse_args()
    given: dict[str, tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]] = {}
    for name in options.names if options.cases else ():
        case = np.load(options.cases / f"{name}.npz")
        noisy = {level: case[level].astype(np.float64) for level in ("n1", "n2", "n3")}
        given[name] = case["clean"].astype(np.float64), case["faces"].astype(np.int32), noisy
    for path in options.meshes:
        given[path.stem] = *load(path), {}
    for name, (clean, faces, noisy) in given.items():
        if options.seed is not None or not noisy:
            noisy = {str(level): with_noise(clean, faces, level, options.seed or 0) for level in LEVELS}
        judge(name, clean, faces, noisy)


if __name__ == "__main__":
    main()
