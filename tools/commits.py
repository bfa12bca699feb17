"""Times of this tree next to those of another commit, in turns, so that what else the machine does falls on both.

    python tools/commits.py --old v0.1.0

Every round starts a process for each tree, which calls everything once before the clock runs, and takes the best of
some calls. Seconds are wall clock with two threads; the best of all rounds counts.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
CASES = ("rings=2", "automatic, clean", "automatic, noisy", "robust", "filter", "smooth 1M", "289 holes in 1M")
CALLS = {"rings=2": 7, "automatic, clean": 7, "automatic, noisy": 5, "robust": 2, "filter": 4}
"""How often the cases are called in a process; the others once."""


def save_meshes(folder: Path) -> None:
    """A bunny of 450,000 vertices, the same with noise, a noisy torus and a perforated sphere of a million."""
    from bezier_filters.surfaces import torus
    from many_holes import perforated
    from speed import noisy, subdivided_bunny

    vertices, faces = subdivided_bunny(2)
    np.savez(folder / "bunny.npz", vertices=vertices, faces=faces, noisy=noisy(vertices, faces))
    surface = torus(resolution=632)
    edge = np.linalg.norm(np.diff(surface.vertices[surface.faces[:, :2]], axis=1), axis=2).mean()
    heights = 0.2 * edge * np.random.default_rng(0).standard_normal((len(surface.vertices), 1))
    np.savez(folder / "torus.npz", vertices=surface.vertices + heights * surface.normals, faces=surface.faces)
    vertices, faces = perforated(316, 300)
    np.savez(folder / "holes.npz", vertices=vertices, faces=faces)


def calls(folder: Path, wanted: list[str]) -> dict[str, Callable[[], object]]:
    """What is timed."""
    import pymeshlab

    import bezier_filters as bf

    bunny, torus, holes = (np.load(folder / f"{name}.npz") for name in ("bunny", "torus", "holes"))
    vertices, noisy, faces = bunny["vertices"], bunny["noisy"], bunny["faces"]
    meshset = pymeshlab.MeshSet()
    meshset.add_mesh(pymeshlab.Mesh(vertices, faces))
    million, punched = dict(torus), dict(holes)
    found: dict[str, Callable[[], object]] = {
        "rings=2": lambda: bf.estimate_vertex_geometry(vertices, faces, rings=2, alpha=0.8, threads=2),
        "automatic, clean": lambda: bf.estimate_vertex_geometry(vertices, faces, threads=2),
        "automatic, noisy": lambda: bf.estimate_vertex_geometry(noisy, faces, threads=2),
        "robust": lambda: bf.estimate_vertex_geometry(noisy, faces, robust=True, threads=2),
        "filter": lambda: bf.compute_curvature_by_bezier_patch_per_vertex(meshset, threads=2),
        "smooth 1M": lambda: bf.smooth(million["vertices"], million["faces"], threads=2),
        "289 holes in 1M": lambda: bf.fill_holes(punched["vertices"], punched["faces"], threads=2),
    }
    return {name: found[name] for name in wanted}


def run(folder: Path, wanted: list[str]) -> dict[str, float]:
    """Seconds of each case in this process."""
    seconds = {}
    for name, call in calls(folder, wanted).items():
        times = []
        for _ in range(1 + CALLS.get(name, 1)):
            start = time.perf_counter()
            call()
            times.append(time.perf_counter() - start)
        seconds[name] = min(times[1:])
    return seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--old", help="commit or tag to compare with")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--run", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.run:
        print(json.dumps(run(options.run, options.cases)))
        return
    with tempfile.TemporaryDirectory() as name:
        folder, trees = Path(name), {"old": Path(name) / "old", "new": ROOT}
        subprocess.run(["git", "worktree", "add", "-q", "--detach", trees["old"], options.old], check=True, cwd=ROOT)
        try:
            save_meshes(folder)
            seconds: dict[str, dict[str, float]] = {"old": {}, "new": {}}
            for _ in range(options.rounds):
                for tree, path in trees.items():
                    command = [sys.executable, __file__, "--run", folder, "--cases", *options.cases]
                    environment = os.environ | {"PYTHONPATH": str(path)}
                    done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, cwd=folder)
                    for case, value in json.loads(done.stdout).items():
                        seconds[tree][case] = min(value, seconds[tree].get(case, np.inf))
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", trees["old"]], check=True, cwd=ROOT)
    print(f"{'case':20} {'old, s':>8} {'new, s':>8} {'new / old':>10}")
    for case, old in seconds["old"].items():
        new = seconds["new"][case]
        print(f"{case:20} {old:8.3f} {new:8.3f} {new / old:10.2f}")


if __name__ == "__main__":
    main()
