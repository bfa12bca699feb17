"""Hashes of every array that the public functions return on some meshes: what no merge, move or renaming may change.

    python tests/frozen.py                   # compare with tests/frozen.json; says what is no longer the same
    python tests/frozen.py --only smooth     # the cases whose name contains a text
    python tests/frozen.py --arrays FOLDER   # keep the arrays, too; with arrays there, say how far the new ones are
    python tests/frozen.py --save            # after a change on purpose, which is measured and committed on its own

The last bits depend on the processor and on the versions of the libraries, which are kept with the hashes: where they
differ there is nothing to compare with, and the script says so and ends with 3.
"""

import argparse
import dataclasses
import hashlib
import json
import platform
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import bezier_filters as bf
from bezier_filters.surfaces import block_with_sharp_edges, bumpy_star, torus, waves

HASHES = Path(__file__).with_suffix(".json")
SAMPLES = Path(__file__).parents[1] / "sample_meshes"
LIBRARIES = ("numpy", "scipy", "numba", "llvmlite", "pymeshlab")


def machine() -> dict[str, str]:
    """What the last bits depend on."""
    cpuinfo = Path("/proc/cpuinfo")
    words = set(cpuinfo.read_text(encoding="utf-8").split()) if cpuinfo.exists() else set()
    features = sorted({"avx2", "fma", "avx512f"} & words)
    return {"processor": platform.machine() + "".join(f" {name}" for name in features)} | {
        name: version(name) for name in LIBRARIES
    }


def shaken(vertices, faces, share, seed=0, directions=None):
    """Vertices with white noise in every coordinate, or along some directions, in mean edges."""
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    rng = np.random.default_rng(seed)
    if directions is None:
        return vertices + share * edge * rng.standard_normal(vertices.shape)
    return vertices + share * edge * rng.standard_normal((len(vertices), 1)) * directions


def star(resolution=24):
    surface = bumpy_star(resolution=resolution, jitter=0.2)
    return surface.vertices, surface.faces


def noisy_star():
    """Noise on one half only, so that parts are fitted differently."""
    vertices, faces = star()
    return np.where(vertices[:, 2:] > 0.0, shaken(vertices, faces, 0.1), vertices), faces


def sheet():
    surface = waves(resolution=40)
    return surface.vertices, surface.faces


def block():
    return block_with_sharp_edges(resolution=16)


def noisy_block():
    vertices, faces = block_with_sharp_edges(resolution=16, jitter=0.2)
    return shaken(vertices, faces, 0.1), faces


def broken():
    """Faces that exist twice, join what is far apart, or are none, and vertices without faces."""
    vertices, faces = noisy_star()
    rng = np.random.default_rng(2)
    faces = np.concatenate([faces, faces[:40][:, ::-1], rng.integers(0, len(vertices), (10, 3)), faces[:5, [0, 0, 1]]])
    return np.concatenate([vertices, rng.uniform(-1.0, 1.0, (50, 3))]), faces.astype(np.int32)


def large():
    """More vertices than what is learned is learned from."""
    surface = torus(resolution=200, jitter=0.2)
    return shaken(surface.vertices, surface.faces, 0.15, directions=surface.normals), surface.faces


def wheel_sample(name):
    """A mesh that the pymeshlab wheel ships."""
    import pymeshlab

    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(Path(pymeshlab.__file__).parent / "tests" / "sample_meshes" / name))
    return ms.current_mesh().vertex_matrix(), ms.current_mesh().face_matrix().astype(np.int32)


def punched():
    """A sample mesh with several holes."""
    import pymeshlab

    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(SAMPLES / "punched_patch.ply"))
    return ms.current_mesh().vertex_matrix(), ms.current_mesh().face_matrix().astype(np.int32)


def punched_block():
    """A block without what is near a corner, the middle of an edge and the middle of a side."""
    vertices, faces = block()
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middles = vertices[faces].mean(axis=1)
    radius = 0.12 * np.linalg.norm(high - low)
    for center in (high, [(low[0] + high[0]) / 2, low[1], low[2]], [low[0], *(low + high)[1:] / 2]):
        faces, middles = (a[np.linalg.norm(middles - center, axis=1) > radius] for a in (faces, middles))
    return vertices, faces


def bunny():
    return wheel_sample("bunny.obj")


MESHES = {
    "star": star, "noisy star": noisy_star, "sheet": sheet, "block": block, "noisy block": noisy_block,
    "broken": broken, "bunny": bunny,
}  # fmt: skip
ESTIMATES = {
    "automatic": {},
    "rings 2": {"rings": 2, "alpha": 0.8},
    "degree 4": {"rings": 3, "degree": 4, "alpha": 0.9},
    "rings 2, learned": {"rings": 2},
    "robust": {"robust": True},
    "robust, rings 3": {"robust": True, "rings": 3, "alpha": 0.8},
    "radius": {"radius": 0.03},  # of the diagonal
    "paper": {"rings": 2, "alpha": 0.8, "smoothness": "paper"},
    "conditions": {"conditions": True},
}


def estimates(name: str, options: dict[str, object]) -> object:
    vertices, faces = MESHES[name]()
    if "radius" in options:
        options = options | {"radius": float(options["radius"] * np.linalg.norm(np.ptp(vertices, axis=0)))}
    return bf.estimate_vertex_geometry(vertices, faces, **options)


def of_file(
    mesh: Callable[[], tuple[np.ndarray, np.ndarray]], quantity: str, robust: bool = False
) -> dict[str, object]:
    """Columns of an estimate in tiles."""
    from bezier_filters.scale import FitOptions, estimate_file

    with TemporaryDirectory() as folder:
        for name, values in zip("vf", mesh(), strict=True):
            np.save(f"{folder}/{name}.npy", values)
        source, target = (f"{folder}/v.npy", f"{folder}/f.npy"), f"{folder}/out.ply"
        options = FitOptions(robust=robust)
        report = estimate_file(source, target, quantity, options=options, tile_vertices=512, scheduler="synchronous")
        return {**bf.read_fields(target), "status": np.array(sorted(report["status"].values()))}


def cases() -> dict[str, Callable[[], object]]:
    """Every case by its name."""
    found: dict[str, Callable[[], object]] = {}
    for mesh in MESHES:
        for how, options in ESTIMATES.items():
            if mesh != "bunny" or how in ("automatic", "rings 2, learned", "robust"):
                found[f"estimate: {mesh}, {how}"] = lambda mesh=mesh, options=options: estimates(mesh, options)
        found[f"smooth: {mesh}"] = lambda mesh=mesh: bf.smooth(*MESHES[mesh]())
        found[f"creases: {mesh}"] = lambda mesh=mesh: bf.find_creases(*MESHES[mesh]())
    for mesh in ("star", "noisy star", "sheet"):
        found[f"points: {mesh}"] = lambda mesh=mesh: bf.estimate_vertex_geometry(MESHES[mesh]()[0], None)
    found["estimate: large"] = lambda: bf.estimate_vertex_geometry(*large())
    found["smooth: large"] = lambda: bf.smooth(*large())
    found["smooth: noisy star, twice, fixed"] = lambda: bf.smooth(*noisy_star(), iterations=2, borders="fixed")
    found["smooth: noisy block, paper"] = lambda: bf.smooth(*noisy_block(), "paper", keep_volume=True)
    found["smooth: noisy sheet"] = lambda: bf.smooth(shaken(*sheet(), 0.2), sheet()[1])
    for method in ("auto", "paper"):
        found[f"fill: punched patch, {method}"] = lambda method=method: bf.fill_holes(*punched(), method)
        found[f"fill: punched block, {method}"] = lambda method=method: bf.fill_holes(*punched_block(), method)
    found["fill: noisy block"] = lambda: bf.fill_holes(shaken(*punched_block(), 0.05), punched_block()[1])
    found["fill: bunny"] = lambda: bf.fill_holes(*wheel_sample("bunny10k_textured.obj"), outer_rims=True)
    for mesh in ("noisy star", "broken"):
        for quantity in ("curvature", "normals", "torsion"):
            found[f"file: {mesh}, {quantity}"] = lambda mesh=mesh, q=quantity: of_file(MESHES[mesh], q)
    found["file: noisy star, robust"] = lambda: of_file(noisy_star, "curvature", robust=True)
    return found


def arrays(value: object, name: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """All arrays and numbers in a result, by where they are."""
    if dataclasses.is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        for key, item in value.items():
            yield from arrays(item, f"{name}.{key}".lstrip("."))
    elif isinstance(value, list | tuple):
        for k, item in enumerate(value):
            yield from arrays(item, f"{name}[{k}]")
    else:
        yield name, np.asarray(value)


def digest(array: np.ndarray) -> str:
    if array.dtype == object or array.dtype.kind == "U":
        return hashlib.sha256(str(array).encode()).hexdigest()[:16]
    array = np.ascontiguousarray(array)
    return hashlib.sha256(f"{array.dtype} {array.shape}".encode() + array.tobytes()).hexdigest()[:16]


def distance(old: np.ndarray, new: np.ndarray) -> str:
    """How far an array is from what it was."""
    if old.shape != new.shape or old.dtype.kind not in "fiub":
        return f"{old.dtype} {old.shape} is now {new.dtype} {new.shape}"
    apart = np.abs(new.astype(float) - old.astype(float))
    size = max(float(np.abs(old).max(initial=0.0)), 1e-300)
    return (
        f"largest {apart.max(initial=0.0) / size:.1e}, rms {np.sqrt(np.mean(apart**2)) / size:.1e} of the largest value"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--save", action="store_true", help="keep the hashes of this state")
    parser.add_argument("--only", default="", help="text that the names of the cases contain")
    parser.add_argument("--arrays", type=Path, help="folder of arrays to compare with, or to write")
    options = parser.parse_args()
    kept = json.loads(HASHES.read_text(encoding="utf-8")) if HASHES.exists() else {"machine": machine(), "cases": {}}
    if kept["machine"] != machine() and not options.save:
        print(f"no hashes for this machine: {machine()}, there are some for {kept['machine']}")
        return 3
    changed = 0
    for name, run in cases().items():
        if options.only not in name:
            continue
        found = dict(arrays(run()))
        hashes = {key: digest(array) for key, array in found.items()}
        before = kept["cases"].get(name, {})
        differing = [key for key in before if hashes.get(key) != before[key]]
        changed += bool(differing)
        print(f"{'CHANGED' if differing else 'same   '} {name}", flush=True)
        path = options.arrays and options.arrays / f"{name.replace(':', '').replace(' ', '_')}.npz"
        there = np.load(path, allow_pickle=True) if path and path.exists() else {}
        for key in differing:
            how_far = f": {distance(there[key], found[key])}" if key in there and key in found else ""
            print(f"        {key}{how_far}" if key in found else f"        {key} is gone")
        if path and not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            np.savez(path, **found)
        if options.save:
            kept["cases"][name] = hashes
    if options.save:
        kept["machine"] = machine()
        HASHES.write_text(json.dumps(kept, indent=0, sort_keys=True) + "\n", encoding="utf-8")
    print(f"{changed} of the cases changed")
    return int(changed > 0 and not options.save)


if __name__ == "__main__":
    sys.exit(main())
