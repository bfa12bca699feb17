"""What the examples share: where the sample meshes are, how a mesh is read, drawn and an example run."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab

from bezier_filters.pictures.scene import Panel

SAMPLES = Path(__file__).parent.parent / "sample_meshes"


def load(name: str) -> pymeshlab.MeshSet:
    """A sample mesh in a MeshSet of its own."""
    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(SAMPLES / name))
    return ms


def arrays(ms: pymeshlab.MeshSet) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and faces (m, 3) of the current mesh."""
    mesh = ms.current_mesh()
    return mesh.vertex_matrix(), mesh.face_matrix().astype(np.int32)


def flat_panel(vertices: np.ndarray, faces: np.ndarray, title: str, colors: np.ndarray | None = None) -> Panel:
    """A mesh whose faces are drawn flat, one by one, with a colour for each: nothing hides a rough surface."""
    corners = np.ascontiguousarray(vertices[faces].reshape(-1, 3))
    of_faces = np.full((len(faces), 3), 0.75) if colors is None else colors
    separate = np.arange(faces.size, dtype=np.int32).reshape(-1, 3)
    return Panel(corners, separate, colors=np.repeat(of_faces, 3, axis=0), title=title)


def run(main: Callable[[Path], Any]) -> None:
    """Run an example from a shell: python EXAMPLE.py [FOLDER]."""
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    out.mkdir(parents=True, exist_ok=True)
    for name, value in main(out).items():
        print(f"{name}: {value}")
