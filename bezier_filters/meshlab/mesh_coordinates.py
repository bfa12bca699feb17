"""New vertex coordinates for a mesh inside a MeshSet, bit for bit.

They come with a point cloud, a layer that goes away again, to which the mesh is morphed: ``source +
(target - source)``, twice, since the first time rounds. Expressions would leave attributes behind and take
five times as long. pymeshlab sets the normals from the new coordinates at each morph, to sums that are
longer than one; they are computed once more.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.meshlab.meshset import BezierFilterError, Mesh, MeshSet, current_mesh


def write_coordinates(ms: MeshSet, vertices: FloatArray) -> None:
    """Set the coordinates of the current mesh, and its normals to unit normals of the new faces.

    Everything else stays, except that the id of the next layer skips one.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
    vertices : (n, 3) float64
        Finite, one row for each vertex of the current mesh.

    Raises
    ------
    BezierFilterError
        If pymeshlab did not take the coordinates over bit for bit.
    """
    mesh = current_mesh(ms)
    wanted = mesh.id()
    others = {layer.id() for layer in ms}
    ms.add_mesh(Mesh(vertices), "coordinates", set_as_current=False)
    carrier = next(layer.id() for layer in ms if layer.id() not in others)
    try:
        for _ in range(2):
            ms.compute_coord_linear_morphing(targetmesh=carrier, percentmorph=100)
    finally:
        ms.set_current_mesh(carrier)
        ms.delete_current_mesh()
        ms.set_current_mesh(wanted)
    if not np.array_equal(current_mesh(ms).vertex_matrix(), vertices):
        raise BezierFilterError("pymeshlab did not take the new coordinates over bit for bit; they are too far apart")
    ms.compute_normal_per_vertex()


@contextmanager
def coordinates_restored_on_failure(ms: MeshSet) -> Iterator[None]:
    """Put the coordinates back if the block fails or is interrupted.

    Face normals, which pymeshlab lets nobody set, are computed from them once more.
    """
    vertices = np.array(current_mesh(ms).vertex_matrix(), dtype=np.float64, order="C")
    try:
        yield
    except BaseException:
        if not np.array_equal(current_mesh(ms).vertex_matrix(), vertices):
            write_coordinates(ms, vertices)
        raise
