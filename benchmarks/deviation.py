"""Deviations against patches and against facets, their calibration, and defects that are found.

    python benchmarks/deviation.py

Two noisy meshes of one surface with different vertices are compared. Without noise their deviation would be 0.

* `facets`: error of the deviation of points without noise from the faces of a noisy reference, in mean edges (rms), as
  of MeshLab's and other programs' distance from a mesh; `patches`: the same from the surface of its patches.
* `spread`: root mean square of the z-scores of `compare`, over all pairs, 1 if the standard errors hold; `regional`:
  that of the means over 200 vertices.
* `false`: share of the pairs in which a region deviates significantly, though none does; `found`: share of the pairs
  in which a defect of half the noise in height, over 200 vertices, is reported there.
"""

import argparse

import numpy as np

import bezier_filters as bf
from bezier_filters import surfaces
from bezier_filters.surfaces import SampledSurface
from strongest_peer import mean_edge

DEFECT_VERTICES, DEFECT_HEIGHT = 200, 0.5
"""Size of the defect, and its height in standard deviations of the noise."""
BODIES = {"torus": (surfaces.torus, 32), "ellipsoid": (surfaces.ellipsoid, 24), "bumpy star": (surfaces.bumpy_star, 28)}
LEVELS = (0.05, 0.1, 0.2)


def add_noise(body: SampledSurface, level: float, seed: int) -> np.ndarray:
    """Vertices with noise along the normals, in mean edges."""
    rng = np.random.default_rng(seed)
    heights = level * mean_edge(body.vertices, body.faces) * rng.standard_normal((len(body.vertices), 1))
    return body.vertices + heights * body.normals


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def facet_distances(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Distances from points to the nearest faces."""
    import pymeshlab

    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(vertices, faces))
    ms.add_mesh(pymeshlab.Mesh(points))
    ms.compute_scalar_by_distance_from_another_mesh_per_vertex(measuremesh=1, refmesh=0, signeddist=True)
    return np.array(ms.mesh(1).vertex_scalar_array())


def measure(name: str, level: float, pairs: int) -> dict[str, float]:
    """One row of the table."""
    make, resolution = BODIES[name]
    scan = make(resolution=resolution, jitter=0.3)
    model = make(resolution=round(1.2 * resolution), jitter=0.2, seed=5)
    edge = mean_edge(model.vertices, model.faces)
    step = DEFECT_HEIGHT * level * mean_edge(scan.vertices, scan.faces)
    errors, scores, regional, found = [], [], [], []
    for seed in range(pairs):
        vertices, reference = add_noise(scan, level, seed), add_noise(model, level, 1000 + seed)
        surface = bf.fit_surface(reference, model.faces)
        facets = facet_distances(scan.vertices, reference, model.faces)
        errors.append([rms(facets) / edge, rms(surface.query(scan.vertices).distances) / edge])
        plain = bf.compare(vertices, scan.faces, surface)
        scores.append(rms(plain.z_scores[plain.compared]))
        regional.append(rms(plain.regional_z_scores[plain.compared]))
        center = np.random.default_rng(seed).integers(len(vertices))
        near = np.argsort(np.linalg.norm(scan.vertices - scan.vertices[center], axis=1))[:DEFECT_VERTICES]
        vertices[near] += step * scan.normals[near]
        regions = bf.compare(vertices, scan.faces, surface).regions
        found.append([bool(plain.regions), any(np.isin(region.vertices, near).any() for region in regions)])
    facets, patches = np.sqrt(np.mean(np.square(errors), axis=0))
    false, right = np.mean(found, axis=0)
    row = {"facets": facets, "patches": patches, "spread": rms(scores), "regional": rms(regional)}
    return row | {"false": false, "found": right}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=12, help="pairs of noisy meshes of each kind")
    pairs = parser.parse_args().pairs
    print("| surface | noise, edges | facets | patches | spread | regional | false | found |")
    print("|---|---|---|---|---|---|---|---|")
    for name in BODIES:
        for level in LEVELS:
            row = measure(name, level, pairs)
            cells = [f"{row[key]:.3f}" for key in ("facets", "patches")]
            cells += [f"{row[key]:.2f}" for key in ("spread", "regional", "false", "found")]
            print(f"| {name} | {level:g} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
