"""Hole filling of other libraries, as far as they are installed, next to ours.

A filler takes vertices and faces and gives those of the filled mesh.
"""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import numpy as np

import bezier_filters as bf

Mesh: TypeAlias = tuple[np.ndarray, np.ndarray]
Filler: TypeAlias = Callable[[np.ndarray, np.ndarray], Mesh]


def ours(**options: object) -> Filler:
    def fill(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
        result = bf.fill_holes(vertices, faces, **options)
        return result.vertices, result.faces

    return fill


def meshlab(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
    import pymeshlab

    meshset = pymeshlab.MeshSet()
    meshset.add_mesh(pymeshlab.Mesh(vertices, faces))
    meshset.meshing_close_holes(maxholesize=len(faces), refinehole=True)
    mesh = meshset.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix()


def cgal(continuity: int) -> Filler:
    """Triangulate, refine and fair, with tangents (1) or curvatures (2) continued."""
    from CGAL import CGAL_Polygon_mesh_processing as processing
    from CGAL.CGAL_Polyhedron_3 import Polyhedron_3

    def fill(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "mesh.off"
            write_off(path, vertices, faces)
            mesh = Polyhedron_3(str(path))
            before = -1
            while mesh.size_of_facets() != before:  # until nothing is left that it can fill
                before = mesh.size_of_facets()
                border = next((edge for edge in mesh.halfedges() if edge.is_border()), None)
                if border is None:
                    break
                processing.triangulate_refine_and_fair_hole(mesh, border, [], [], np.sqrt(2.0), continuity)
            mesh.write_to_file(str(path))
            points = np.array([(point.x(), point.y(), point.z()) for point in mesh.points()])
            return points, read_faces(path)

    return fill


def write_off(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    with path.open("w") as file:
        file.write(f"OFF\n{len(vertices)} {len(faces)} 0\n")
        np.savetxt(file, vertices, fmt="%.17g")
        np.savetxt(file, np.column_stack([np.full(len(faces), 3), faces]), fmt="%d")


def read_faces(path: Path) -> np.ndarray:
    numbers = path.read_text().split()
    n, m = int(numbers[1]), int(numbers[2])
    return np.array(numbers[4 + 3 * n : 4 + 3 * n + 4 * m], dtype=np.int32).reshape(m, 4)[:, 1:]


def meshlib() -> Filler:
    from meshlib import mrmeshnumpy, mrmeshpy

    def fill(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
        mesh = mrmeshnumpy.meshFromFacesVerts(faces, vertices)
        for edge in mesh.topology.findHoleRepresentiveEdges():
            settings = mrmeshpy.FillHoleNicelySettings()
            settings.subdivideSettings.maxEdgeLen = mesh.averageEdgeLength()
            mrmeshpy.fillHoleNicely(mesh, edge, settings)
        return mrmeshnumpy.getNumpyVerts(mesh).astype(np.float64), mrmeshnumpy.getNumpyFaces(mesh.topology)

    return fill


def pymeshfix() -> Filler:
    from pymeshfix import PyTMesh

    def fill(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
        mesh = PyTMesh()
        mesh.set_quiet(True)
        mesh.load_array(vertices, faces.astype(np.int32))
        mesh.fill_small_boundaries(0, True)
        return mesh.return_arrays()

    return fill


def fillers(*, peers: bool) -> dict[str, Filler]:
    """All fillers by name; peers that are not installed are left out, with a notice."""
    found = {"ours": ours(), "ours, paper": ours(method="paper")}
    if not peers:
        return found
    found["MeshLab"] = meshlab
    for name, make in (
        ("CGAL, continuity 1", lambda: cgal(1)),
        ("CGAL, continuity 2", lambda: cgal(2)),
        ("MeshLib", meshlib),
        ("pymeshfix", pymeshfix),
    ):
        try:
            found[name] = make()
        except ImportError as error:
            print(f"{name}: left out ({error})")
    return found
