"""Speed of `estimate_vertex_geometry` next to MeshLab's and libigl's quadric fitting, in one run.

The mesh is the bunny that pymeshlab ships, Loop-subdivided. Each contender is run once to
warm up and then timed as the best of three; all times are for the whole call, arrays in,
arrays out (MeshLab: the filter on a mesh that is already loaded).
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pymeshlab

import bezier_filters as bf

BUNNY = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes" / "bunny.obj"


def subdivided_bunny(levels: int) -> pymeshlab.MeshSet:
    meshset = pymeshlab.MeshSet()
    meshset.load_new_mesh(str(BUNNY))
    if levels:
        meshset.meshing_surface_subdivision_loop(iterations=levels, threshold=pymeshlab.PercentageValue(0))
    return meshset


def best_of_three(call: Callable[[], object]) -> float:
    call()
    times = []
    for _ in range(3):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def contenders(meshset: pymeshlab.MeshSet) -> dict[str, Callable[[], object]]:
    vertices = meshset.current_mesh().vertex_matrix()
    faces = meshset.current_mesh().face_matrix().astype(np.int32)

    def ours(threads: int, **options: object) -> Callable[[], object]:
        return lambda: bf.estimate_vertex_geometry(vertices, faces, threads=threads, **options)

    calls = {
        "MeshLab quadric fitting": lambda: meshset.compute_curvature_principal_directions_per_vertex(
            method="Quadric Fitting"
        ),
        "2 rings, alpha 0.8, 1 thread": ours(1, rings=2, alpha=0.8),
        "2 rings, alpha 0.8, 2 threads": ours(2, rings=2, alpha=0.8),
        "automatic, 1 thread": ours(1),
        "automatic, 2 threads": ours(2),
        "paper, 2 threads": ours(2, smoothness="paper"),
    }
    try:
        import igl

        calls["libigl quadric, radius 2"] = lambda: igl.principal_curvature(vertices, faces, 2)
    except ImportError:
        print("libigl is not installed: left out (pip install 'bezier-filters[bench]')")
    return calls


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--levels", type=int, nargs="+", default=[0, 2], help="subdivision levels (4x vertices each)")
    for level in parser.parse_args().levels:
        meshset = subdivided_bunny(level)
        n = meshset.current_mesh().vertex_number()
        print(f"\n{n:,} vertices{'':24}us/vertex   vertices/s   times MeshLab's speed")
        meshlab = None
        for name, call in contenders(meshset).items():
            seconds = best_of_three(call)
            meshlab = meshlab or seconds
            print(f"  {name:34}{seconds / n * 1e6:9.2f} {n / seconds:12,.0f} {meshlab / seconds:12.1f}")


if __name__ == "__main__":
    main()
