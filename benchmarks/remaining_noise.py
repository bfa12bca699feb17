"""The noise after smoothing, as it is stated, over the error of the smoothed vertices.

    python benchmarks/remaining_noise.py [NOISY CLEAN]...

Noise is along the normals, in mean edges. Further pairs of meshes with the same vertices may be given.
"""

import sys
from collections.abc import Iterator

import numpy as np

import bezier_filters as bf
from bezier_filters.surfaces import bumpy_star, ellipsoid, torus

LEVELS, SEED = (0.02, 0.1, 0.4, 1.0), 1
BODIES = {
    "torus": torus(resolution=30, jitter=0.2),
    "bumpy star": bumpy_star(resolution=20, jitter=0.3),
    "ellipsoid": ellipsoid(resolution=20, jitter=0.2),
}
Case = tuple[str, np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # name, noisy and clean vertices, faces, normals


def cases(pairs: list[str]) -> Iterator[Case]:
    """The bodies with noise, and pairs of files."""
    for name, body in BODIES.items():
        edge = float(np.linalg.norm(np.diff(body.vertices[body.faces[:, :2]], axis=1), axis=2).mean())
        for level in LEVELS:
            heights = np.random.default_rng(SEED).standard_normal((len(body.vertices), 1))
            noisy = body.vertices + level * edge * heights * body.normals
            yield f"{name}, {level:g}", noisy, body.vertices, body.faces, body.normals
    for one, other in zip(pairs[::2], pairs[1::2], strict=True):
        noisy, faces = bf.mesh_arrays(one)
        clean, _ = bf.mesh_arrays(other)
        yield one, noisy, clean, faces, bf.estimate_vertex_geometry(clean, faces, rings=2, alpha=0.8).normals


def main(pairs: list[str]) -> None:
    """Print the table."""
    print("| mesh, noise | stated before | stated after | true after | stated / true |\n|---|---|---|---|---|")
    for name, noisy, clean, faces, normals in cases(pairs):
        found = bf.smooth(noisy, faces)
        error = np.einsum("ij,ij->i", found.vertices - clean, normals)
        true = float(np.sqrt(np.square(error).mean())) / found.mean_edge
        before, after = (value / found.mean_edge for value in (found.noise_before, found.noise_after))
        print(f"| {name} | {before:.3f} | {after:.4f} | {true:.4f} | {after / true:.2f} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
