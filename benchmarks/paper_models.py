"""Models and pictures of the paper's figures."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pymeshlab

import bezier_filters as bf
from cut_holes import normals
from sub_holes import load

FAN = Path(__file__).parents[1] / "sample_meshes" / "fan.ply"
OLD, NEW = (0.75, 0.75, 0.75), (1.0, 0.6, 0.2)
FORMATS = (".obj", ".off", ".ply", ".stl")
MAX_PAGE_FACES = 100_000
"""Faces of a model, beyond which it is simplified to so many: twice as many take twice the time of Figure 8."""


class Found(NamedTuple):
    """What is shown of a figure or table."""

    title: str
    picture: Path | None
    rows: list[dict[str, object]]
    note: str = ""


class Model(NamedTuple):
    """A mesh and its name."""

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    is_found: bool = True
    """Whether it is the model that was asked for, not a stand-in."""


class Where(NamedTuple):
    """Folder that pictures are written to, and that of models, if there is one."""

    out: Path
    models: Path | None

    def model(self, name: str, words: tuple[str, ...], stand_in: Path) -> Model:
        """The mesh whose file name has the first of some words, the shortest such name; else one that stands in."""
        files = [] if self.models is None else [p for p in self.models.rglob("*") if p.suffix.lower() in FORMATS]
        paths = next(filter(None, ([p for p in files if word in p.stem.lower()] for word in words)), [])
        if not paths:
            return Model(f"{stand_in.stem} in the place of the {name}", *load(stand_in), is_found=False)
        path = min(paths, key=lambda p: (len(p.name), p))
        meshset = pymeshlab.MeshSet()
        meshset.load_new_mesh(str(path))
        count = meshset.current_mesh().face_number()
        if count > MAX_PAGE_FACES:
            meshset.meshing_decimation_quadric_edge_collapse(targetfacenum=MAX_PAGE_FACES)
            name += f", {MAX_PAGE_FACES:,} of {count:,} faces"
        mesh = meshset.current_mesh()
        return Model(name, mesh.vertex_matrix(), mesh.face_matrix().astype(np.int32))


def flat(vertices: np.ndarray, faces: np.ndarray, title: str, new: np.ndarray | None = None) -> bf.Panel:
    """A mesh drawn face by face, new faces in orange."""
    directions = normals(vertices, faces)
    level = directions @ [0.3, 0.5, 0.8] / np.maximum(np.linalg.norm(directions, axis=1), 1e-300)
    is_new = np.zeros(len(faces), dtype=bool) if new is None else new
    colors = np.where(is_new[:, None], NEW, OLD) * (0.65 + 0.35 * np.abs(level)[:, None])
    corners = np.ascontiguousarray(vertices[faces].reshape(-1, 3))
    separate = np.arange(faces.size, dtype=np.int32).reshape(-1, 3)
    return bf.Panel(corners, separate, colors=np.repeat(np.minimum(colors, 1.0), 3, axis=0), title=title)


def joined(path: Path, pictures: list[Path], *, axis: int = 0) -> None:
    """Pictures below one another (axis 0) or side by side (1), on white; they are deleted."""
    from matplotlib.image import imread, imsave

    images = [imread(picture)[..., :3] for picture in pictures]
    longest = max(image.shape[1 - axis] for image in images)
    sides = [((0, longest - i.shape[0]), (0, 0)) if axis else ((0, 0), (0, longest - i.shape[1])) for i in images]
    padded = [np.pad(i, (*side, (0, 0)), constant_values=1.0) for i, side in zip(images, sides, strict=True)]
    for picture in pictures:
        picture.unlink()
    imsave(path, np.concatenate(padded, axis=axis))
