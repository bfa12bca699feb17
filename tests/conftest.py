"""Shared settings and meshes of the tests."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

settings.register_profile("project", deadline=None)  # the first call of a kernel may compile it
settings.load_profile("project")


def pymeshlab_sample(name):
    """Vertices and faces of a mesh that the pymeshlab wheel ships."""
    import pymeshlab

    meshset = pymeshlab.MeshSet()
    meshset.load_new_mesh(str(Path(pymeshlab.__file__).parent / "tests" / "sample_meshes" / name))
    mesh = meshset.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int32)


@pytest.fixture(scope="session")
def bunny():
    """The closed Stanford bunny, 28,088 vertices."""
    return pymeshlab_sample("bunny.obj")
