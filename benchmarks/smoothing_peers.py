"""Filters that smooth, ours and others': functions of vertices and faces that give new vertices.

All at their defaults, or with one setting that is in the name; none is tuned to a case.
"""

from collections.abc import Callable
from importlib import import_module
from typing import TypeAlias

import numpy as np
import pymeshlab
from scipy.sparse import coo_array, diags_array, eye_array
from scipy.sparse.linalg import spsolve

import bezier_filters as bf
from baselines import adaptive_gaussian_smoothing

Smoother: TypeAlias = Callable[[np.ndarray, np.ndarray], np.ndarray]


def ours(method: str) -> Smoother:
    return lambda vertices, faces: bf.smooth(vertices, faces, method).vertices


def meshlab(name: str, **options: object) -> Smoother:
    """A filter of MeshLab; coordinates are all that it changes."""

    def smooth(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        meshset = pymeshlab.MeshSet()
        meshset.add_mesh(pymeshlab.Mesh(vertices, faces))
        getattr(meshset, name)(**options)
        return meshset.current_mesh().vertex_matrix()

    return smooth


def implicit_fairing(vertices: np.ndarray, faces: np.ndarray, edges: float = 1.0) -> np.ndarray:
    """Desbrun et al. 1999: one implicit step of mean curvature flow over `edges` squared mean edges, the old volume."""
    n = len(vertices)
    rows, columns, weights = [], [], []
    areas = np.zeros(n)
    for k in range(3):
        i, j, opposite = faces[:, k], faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]
        u, v = vertices[i] - vertices[opposite], vertices[j] - vertices[opposite]
        twice = np.maximum(np.linalg.norm(np.cross(u, v), axis=1), 1e-300)
        cotangent = np.clip((u * v).sum(axis=1) / twice, -10.0, 10.0)
        rows += [i, j]
        columns += [j, i]
        weights += [0.5 * cotangent, 0.5 * cotangent]
        np.add.at(areas, i, twice / 6.0)
    adjacency = coo_array(
        (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), shape=(n, n)
    ).tocsr()
    stiffness = diags_array(adjacency.sum(axis=1)) - adjacency
    time = edges * np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean() ** 2
    system = eye_array(n) + time * diags_array(1.0 / np.maximum(areas, 1e-300)) @ stiffness
    result = spsolve(system.tocsc(), vertices)
    if is_open(faces):
        return result
    center = result.mean(axis=0)
    return center + (volume(vertices, faces) / volume(result, faces)) ** (1.0 / 3.0) * (result - center)


def is_open(faces: np.ndarray) -> bool:
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return bool((np.unique(edges, axis=0, return_counts=True)[1] == 1).any())


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Enclosed by a closed mesh."""
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


def open3d_taubin(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    import open3d

    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(faces.astype(np.int32))
    )
    return np.asarray(mesh.filter_smooth_taubin(number_of_iterations=20).vertices)


def meshlib_denoise(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    from meshlib import mrmeshnumpy, mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(faces.astype(np.int32), vertices)
    mrmeshpy.meshDenoiseViaNormals(mesh, mrmeshpy.DenoiseViaNormalsSettings())
    return mrmeshnumpy.getNumpyVerts(mesh)


def meshlib_quadric(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    from meshlib import mrmeshnumpy, mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(faces.astype(np.int32), vertices)
    options = mrmeshpy.MeshApproxRelaxParams()
    options.type = mrmeshpy.RelaxApproxType.Quadric
    options.iterations = 3
    options.surfaceDilateRadius = 2.0 * np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    mrmeshpy.relaxApprox(mesh, options)
    return mrmeshnumpy.getNumpyVerts(mesh)


def windowed_sinc(steps: int, band: float) -> Smoother:
    """VTK's filter of Taubin, Zhang and Golub 1996."""

    def smooth(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        import pyvista

        mesh = pyvista.PolyData(vertices, np.insert(faces, 0, 3, axis=1))
        return np.asarray(mesh.smooth_taubin(n_iter=steps, pass_band=band, non_manifold_smoothing=True).points)

    return smooth


def settings() -> dict[str, Smoother]:
    """Other filters from weak to strong, by name, as far as they can run here."""
    taubin, laplacian, hc = (f"apply_coord_{name}_smoothing" for name in ("taubin", "laplacian", "hc_laplacian"))
    found = {f"MeshLab Taubin, {n} steps": meshlab(taubin, stepsmoothnum=n) for n in (5, 10, 20, 50, 100, 200)}
    found |= {f"MeshLab Laplacian, {n} steps": meshlab(laplacian, stepsmoothnum=n) for n in (1, 2, 5)}
    found |= {"MeshLab HC Laplacian": meshlab(hc)}
    found |= {
        f"MeshLab two steps, {n} steps, {angle} degrees": meshlab(
            "apply_coord_two_steps_smoothing", stepsmoothnum=n, normalthr=angle
        )
        for n in (3, 10)
        for angle in (30, 60)
    }
    found |= {
        f"implicit fairing, {edges:g} squared edges": lambda v, f, edges=edges: implicit_fairing(v, f, edges)
        for edges in (0.3, 1.0, 3.0, 10.0)
    }
    for module, its in {
        "pyvista": {f"windowed sinc, band {b:g}": windowed_sinc(50, b) for b in (0.3, 0.1, 0.03, 0.01, 0.003)},
        "meshlib": {"meshlib denoise": meshlib_denoise, "meshlib quadric relax": meshlib_quadric},
    }.items():
        try:
            import_module(module)
        except ImportError as error:
            print(f"{module} is left out: {error}")
        else:
            found |= its
    return found


def smoothers() -> dict[str, Smoother]:
    """All that can run here, by name."""
    found: dict[str, Smoother] = {
        "automatic": ours("auto"),
        "paper": ours("paper"),
        "MeshLab Taubin, 20 steps": meshlab("apply_coord_taubin_smoothing", stepsmoothnum=20),
        "MeshLab HC Laplacian": meshlab("apply_coord_hc_laplacian_smoothing"),
        "MeshLab Laplacian": meshlab("apply_coord_laplacian_smoothing"),
        "MeshLab two steps (Ohtake)": meshlab("apply_coord_two_steps_smoothing"),
        "implicit fairing (Desbrun)": implicit_fairing,
        "adaptive Gaussian (Ohtake)": adaptive_gaussian_smoothing,
    }
    others = {
        "open3d": {"open3d Taubin, 20 steps": open3d_taubin},
        "meshlib": {"meshlib denoise": meshlib_denoise, "meshlib quadric relax": meshlib_quadric},
    }
    for module, its in others.items():
        try:
            import_module(module)
        except ImportError as error:
            print(f"{module} is left out: {error}")
        else:
            found.update(its)
    return found
