"""Speed and memory of the curvature estimate next to MeshLab's, libigl's, VTK's, CGAL's and trimesh2's, in one run.

The mesh is the bunny that pymeshlab ships, Loop-subdivided. Every contender runs in a process of its
own: once on the smallest mesh to load its code, then as often as is said on the mesh in question, of
which the best counts. Times are those of the whole call, arrays in, arrays out; for filters, on a mesh
that is already in a MeshSet. Memory is the most that the process held beyond what it held before the
first call, less what the call returned.
"""

import argparse
import csv
import ctypes
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pymeshlab

import bezier_filters as bf

TRIMESH2 = "TRIMESH2"
BUNNY = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes" / "bunny.obj"
RESULTS = Path(__file__).parent / "results"
LEVELS = (0, 2, 3, 4)
NOISE = 0.05
"""Of the mean edge, for the noisy contender."""
REPETITIONS = {0: 7, 2: 5, 3: 2, 4: 2}
SLOW_LEVELS = (0, 2)
"""For contenders that take more than ten times as long as the others."""

Call = Callable[[], object]
MESHLAB = "MeshLab, quadric fitting (filter)"


def subdivided_bunny(level: int) -> tuple[np.ndarray, np.ndarray]:
    meshset = pymeshlab.MeshSet()
    meshset.load_new_mesh(str(BUNNY))
    if level:
        meshset.meshing_surface_subdivision_loop(iterations=level, threshold=pymeshlab.PercentageValue(0))
    mesh = meshset.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int32)


def noisy(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    return vertices + NOISE * edge * np.random.default_rng(0).standard_normal(vertices.shape)


def estimate(threads: int, **options: object) -> Callable[[np.ndarray, np.ndarray], Call]:
    return lambda vertices, faces: lambda: bf.estimate_vertex_geometry(vertices, faces, threads=threads, **options)


def estimate_noisy(vertices: np.ndarray, faces: np.ndarray) -> Call:
    return estimate(2)(noisy(vertices, faces), faces)


def bezier_filter(**options: object) -> Callable[[np.ndarray, np.ndarray], Call]:
    def prepare(vertices: np.ndarray, faces: np.ndarray) -> Call:
        meshset = pymeshlab.MeshSet()
        meshset.add_mesh(pymeshlab.Mesh(vertices, faces))
        return lambda: bf.compute_curvature_by_bezier_patch_per_vertex(meshset, threads=2, **options) and None

    return prepare


def meshlab_filter(vertices: np.ndarray, faces: np.ndarray) -> Call:
    meshset = pymeshlab.MeshSet()
    meshset.add_mesh(pymeshlab.Mesh(vertices, faces))
    return lambda: meshset.compute_curvature_principal_directions_per_vertex(method="Quadric Fitting") and None


def libigl(vertices: np.ndarray, faces: np.ndarray) -> Call:
    import igl

    return lambda: igl.principal_curvature(vertices, faces, 2)


def vtk_discrete(vertices: np.ndarray, faces: np.ndarray) -> Call:
    import pyvista

    surface = pyvista.PolyData.from_regular_faces(vertices, faces)
    return lambda: surface.curvature("mean")


def corrected(radius: float) -> Callable[[np.ndarray, np.ndarray], Call]:
    """Interpolated corrected curvatures in balls of a radius in mean edges, by the code beside this file."""

    def prepare(vertices: np.ndarray, faces: np.ndarray) -> Call:
        from corrected_curvatures import corrected_curvatures
        from strongest_peer import mean_edge

        return lambda: corrected_curvatures(vertices, faces, radius * mean_edge(vertices, faces))

    return prepare


def compiled(source: str, flags: Callable[[], list[str]], degree: int = 0) -> Callable[[np.ndarray, np.ndarray], Call]:
    """A C++ function beside this file that writes principal curvatures, compiled here with some flags and files."""

    def prepare(vertices: np.ndarray, faces: np.ndarray) -> Call:
        library = Path(tempfile.mkdtemp()) / "peer.so"
        usual = ["-O3", "-march=native", "-DNDEBUG", "-shared", "-fPIC", "-w"]
        path = str(Path(__file__).parent / source)
        subprocess.run(["g++", *usual, path, *flags(), "-o", str(library)], check=True)
        function = ctypes.CDLL(str(library)).principal_curvatures
        array, number = ctypes.c_void_p, ctypes.c_long
        function.argtypes = array, number, array, number, number, array
        points, triangles = np.ascontiguousarray(vertices), np.ascontiguousarray(faces, dtype=np.int32)

        def call() -> tuple[np.ndarray]:
            result = np.empty((len(points), 2))
            function(points.ctypes.data, len(points), triangles.ctypes.data, len(triangles), degree, result.ctypes.data)
            return (result,)

        return call

    return prepare


def of_cgal() -> list[str]:
    """Needs the headers of CGAL and Eigen."""
    return ["-I/usr/include/eigen3", "-lgmp", "-lmpfr"]


def of_trimesh2() -> list[str]:
    """Needs its source (github.com/Forceflow/trimesh2), in a folder that the variable TRIMESH2 names."""
    if TRIMESH2 not in os.environ:
        raise SystemExit(f"no source of trimesh2: {TRIMESH2}=folder says where it is")
    folder = Path(os.environ[TRIMESH2])
    sources = [str(path) for path in sorted((folder / "libsrc").glob("*.cc")) if not path.name.startswith("GL")]
    return [*sources, "-I" + str(folder / "include")]


CONTENDERS: dict[str, Callable[[np.ndarray, np.ndarray], Call]] = {
    MESHLAB: meshlab_filter,
    "libigl, quadric, radius 2": libigl,
    "VTK, discrete mean curvature": vtk_discrete,
    "trimesh2, 1 ring, 1 thread": compiled("trimesh2_curvature.cpp", of_trimesh2),
    "CGAL, jets of degree 3, 2 rings": compiled("cgal_jets.cpp", of_cgal, 3),
    "CGAL, jets of degree 4, 2 rings": compiled("cgal_jets.cpp", of_cgal, 4),
    "corrected curvatures, radius 2 edges, our code, 1 thread": corrected(2.0),
    "corrected curvatures, radius 6 edges, our code, 1 thread": corrected(6.0),
    "2 rings, degree 3, 1 thread": estimate(1, rings=2, alpha=0.8),
    "2 rings, degree 3, 2 threads": estimate(2, rings=2, alpha=0.8),
    "paper, 2 threads": estimate(2, smoothness="paper"),
    "automatic, 1 thread": estimate(1),
    "automatic, 2 threads": estimate(2),
    "automatic, noise 5 %, 2 threads": estimate_noisy,
    "2 rings, degree 3 (filter), 2 threads": bezier_filter(rings=2, alpha=0.8),
    "automatic (filter), 2 threads": bezier_filter(),
}

PEERS = ("MeshLab", "libigl", "VTK", "CGAL", "trimesh2", "corrected")


def resident(field: str) -> int:
    """Bytes, from the kernel's table of this process."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(field))


def returned(result: object) -> int:
    """Bytes of the arrays of a result, but for standard errors that were not estimated, which take no room."""
    if isinstance(result, bf.VertexGeometry):
        parts = vars(result)
    else:
        parts = dict(enumerate(result)) if isinstance(result, tuple) else {"values": result}
    arrays = {name: part for name, part in parts.items() if isinstance(part, np.ndarray)}
    return sum(array.nbytes for name, array in arrays.items() if "std" not in str(name) or array.any())


def measure(name: str, meshes: Path, level: int) -> dict[str, float]:
    """Run one contender in this process."""

    def prepared(level: int) -> tuple[int, Call]:
        with np.load(meshes / f"{level}.npz") as mesh:
            return len(mesh["vertices"]), CONTENDERS[name](mesh["vertices"], mesh["faces"])

    prepared(0)[1]()
    n, call = prepared(level)
    before = resident("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # forget the peak so far
    times = []
    for repetition in range(REPETITIONS[level]):
        start = time.perf_counter()
        result = call()
        times.append(time.perf_counter() - start)
        if repetition == 0:
            peak = resident("VmHWM") - before - returned(result)
        del result
    return {"vertices": n, "seconds": min(times), "bytes_per_vertex": peak / n}


def growth(rows: list[dict[str, object]], name: str) -> float:
    """Exponent of the time in the number of vertices, by least squares in the logarithms."""
    points = [(float(row["vertices"]), float(row["seconds"])) for row in rows if row["contender"] == name]
    return float(np.polyfit(*np.log(np.array(points)).T, 1)[0]) if len(points) > 1 else float("nan")


def plot(rows: list[dict[str, object]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(8, 5), constrained_layout=True)
    colors: dict[str, str] = {}  # our filters have those of the functions that they call
    for name in CONTENDERS:
        of_name = [row for row in rows if row["contender"] == name]
        if of_name and "1 thread" not in name:
            style = ":" if name.startswith(PEERS) else "--" if "filter" in name else "-"
            function = name.split(" (filter)")[0].removesuffix(", 2 threads")
            axes.loglog(
                [row["vertices"] for row in of_name],
                [1e6 * row["seconds"] / row["vertices"] for row in of_name],
                style,
                color=colors.setdefault(function, f"C{len(colors)}"),
                marker="o",
                label=name.removesuffix(", 2 threads"),
            )
    axes.set(xlabel="vertices", ylabel="microseconds per vertex", title="Curvature of the subdivided bunny, 2 threads")
    axes.grid(which="both", alpha=0.3)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, dpi=120)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--levels", type=int, nargs="+", default=[0, 2], choices=LEVELS, help="subdivisions (4x each)")
    parser.add_argument("--only", nargs="+", default=[""], help="contenders whose names start with one of these texts")
    parser.add_argument("--save", action="store_true", help="write benchmarks/results/speed.csv and .png")
    parser.add_argument("--measure", nargs=3, metavar=("NAME", "MESHES", "LEVEL"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        name, meshes, level = options.measure
        print(json.dumps(measure(name, Path(meshes), int(level))))
        return
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as folder:
        for level in sorted({0, *options.levels}):
            vertices, faces = subdivided_bunny(level)
            np.savez(Path(folder) / f"{level}.npz", vertices=vertices, faces=faces)
        for level in options.levels:
            meshlab = None
            for name in CONTENDERS:
                if (name.startswith("CGAL") and level not in SLOW_LEVELS) or not name.startswith(tuple(options.only)):
                    continue
                command = [sys.executable, __file__, "--measure", name, folder, str(level)]
                done = subprocess.run(command, capture_output=True, text=True, env=os.environ, check=False)
                if done.returncode:
                    print(f"  {name}: left out ({done.stderr.strip().splitlines()[-1]})")
                    continue
                row = {"contender": name, **json.loads(done.stdout)}
                rows.append(row)
                n, seconds = row["vertices"], row["seconds"]
                if name == MESHLAB:
                    meshlab = seconds
                    print(
                        f"\n{n:,} vertices{'':22}us/vertex  vertices/s  times MeshLab  bytes/vertex beyond the result"
                    )
                times = meshlab / seconds if meshlab else float("nan")
                print(
                    f"  {name:38}{seconds / n * 1e6:7.2f} {n / seconds:12,.0f} {times:11.1f} "
                    f"{row['bytes_per_vertex']:13.0f}",
                    flush=True,
                )
    if len(options.levels) > 1:
        print("\nexponent of the time in the number of vertices")
        for name in CONTENDERS:
            print(f"  {name:38}{growth(rows, name):7.2f}")
    if options.save:
        with (RESULTS / "speed.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, rows[0])
            writer.writeheader()
            writer.writerows(rows)
        plot(rows, RESULTS / "speed.png")


if __name__ == "__main__":
    main()
