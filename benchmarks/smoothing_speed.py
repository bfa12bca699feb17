"""How long smoothing takes next to other filters, on meshes of a million vertices, with and without noise.

Every filter runs in turn, arrays in, arrays out; the best of some rounds counts. Ours uses all cores that may be
used, MeshLab's Taubin filter and VTK's windowed sinc (through PyVista) one, MeshLib's as many as it takes.

With ``--memory`` it is the memory that ours takes, on Linux.
"""

import argparse
import ctypes
import re
import time
from pathlib import Path

import numpy as np
import pyvista

from bezier_filters import surfaces
from smoothing_peers import Smoother, smoothers

COMPARED = ("automatic", "MeshLab Taubin, 20 steps", "VTK windowed sinc, 20 steps", "meshlib denoise")


def vtk_sinc(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    mesh = pyvista.PolyData.from_regular_faces(vertices, faces)
    return np.asarray(mesh.smooth_taubin(n_iter=20, pass_band=0.1).points)


def cases(million: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Vertices and faces: a smooth surface, one with detail and one with sharp edges, noise of a fifth of an edge."""
    scale = np.sqrt(million)
    found = {}
    for name, shape in {
        "torus": surfaces.torus(resolution=round(632 * scale)),
        "star": surfaces.bumpy_star(resolution=round(317 * scale)),
        "block": surfaces.block_with_sharp_edges(resolution=round(408 * scale)),
    }.items():
        vertices, faces = shape if isinstance(shape, tuple) else (shape.vertices, shape.faces)
        edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
        heights = 0.2 * edge * np.random.default_rng(0).standard_normal((len(vertices), 1))
        normals = np.zeros_like(vertices)
        corners = vertices[faces]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        for k in range(3):
            np.add.at(normals, faces[:, k], areas)
        found[f"{name}, clean"] = vertices, faces
        found[name] = vertices + heights * normals / np.linalg.norm(normals, axis=1, keepdims=True), faces
    return found


def seconds(smoother: Smoother, vertices: np.ndarray, faces: np.ndarray) -> float:
    start = time.perf_counter()
    smoother(vertices, faces)
    return time.perf_counter() - start


def peak_memory(smoother: Smoother, vertices: np.ndarray, faces: np.ndarray) -> float:
    """Most bytes that the process has beside what it has before, its result among them, per vertex."""
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    before = status_bytes("VmRSS")
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak begins anew
    smoother(vertices, faces)
    return (status_bytes("VmHWM") - before) / len(vertices)


def status_bytes(name: str) -> int:
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return 1024 * int(re.search(rf"{name}:\s+(\d+)", status)[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--million", type=float, default=1.0, help="vertices, in millions")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--quick", action="store_true", help="only ours and Taubin's; MeshLib's takes minutes")
    parser.add_argument("--memory", action="store_true", help="bytes per vertex beyond the input")
    arguments = parser.parse_args()
    known = smoothers() | {"VTK windowed sinc, 20 steps": vtk_sinc}
    compared = {name: known[name] for name in COMPARED[: 2 if arguments.quick else None] if name in known}
    for smoother in compared.values():  # compile, load
        smoother(*cases(0.002)["torus"])
    if arguments.memory:
        for name, (vertices, faces) in cases(arguments.million).items():
            print(f"{name}: {peak_memory(known['automatic'], vertices, faces):.0f} bytes per vertex", flush=True)
        return
    print("| seconds | vertices | " + " | ".join(compared) + " | automatic / Taubin |")
    print("|---" * (len(compared) + 3) + "|")
    for name, (vertices, faces) in cases(arguments.million).items():
        rounds = [[seconds(one, vertices, faces) for one in compared.values()] for _ in range(arguments.rounds)]
        best = np.min(rounds, axis=0)
        cells = " | ".join(f"{time:.2f}" for time in best)
        print(f"| {name} | {len(vertices):,} | {cells} | {best[0] / best[1]:.1f} |", flush=True)


if __name__ == "__main__":
    main()
