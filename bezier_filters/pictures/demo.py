"""The demonstration: normals, curvatures and torsion of one mesh as coloured PLY files and one picture."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bezier_filters.display.colors import round_limits
from bezier_filters.files.fields import CURVATURE_FIELDS, TORSION_FIELD, ScalarField
from bezier_filters.meshlab.curvature_filter import (
    compute_curvature_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)
from bezier_filters.meshlab.mesh_files import load_mesh, save_mesh
from bezier_filters.meshlab.meshset import MeshSet, read_current_mesh, shipped_bunny
from bezier_filters.meshlab.vertex_normal_filter import NORMAL_FIELDS, compute_normal_by_bezier_patch_per_vertex
from bezier_filters.pictures.render import render_panels
from bezier_filters.pictures.scene import Panel

VIEWS = ("front", "back")


@dataclass(frozen=True)
class DemoStep:
    """One file of the demonstration: what it shows and what the filter reported."""

    field: ScalarField
    path: Path
    report: dict[str, Any]


def run_demo(folder: Path, mesh: Path | None = None, *, size: tuple[int, int] = (480, 480)) -> Iterator[DemoStep]:
    """Write the files of the demonstration one by one; the picture comes with the last step.

    Parameters
    ----------
    folder : Path
        Where the files go; made if it does not exist.
    mesh : Path, optional
        Any mesh file; by default the bunny that pymeshlab ships.
    size : (int, int)
        Width and height of one image of the picture in pixels.

    Yields
    ------
    DemoStep
        After each PLY file.
    """
    mesh = mesh or shipped_bunny()
    folder.mkdir(parents=True, exist_ok=True)
    panels = []
    for field in (NORMAL_FIELDS["angle"], CURVATURE_FIELDS["mean"], CURVATURE_FIELDS["gaussian"], TORSION_FIELD):
        ms = load_mesh(mesh)
        report = _run(ms, field)
        path = folder / f"{mesh.stem}_{field.attribute}.ply"
        save_mesh(ms, path)
        panels.append(_panel(ms, field, report))
        yield DemoStep(field, path, report)
    render_panels(picture_path(folder, mesh), panels, views=VIEWS, size=size)


def picture_path(folder: Path, mesh: Path | None = None) -> Path:
    """Where the picture of the demonstration is written."""
    return folder / f"{(mesh or shipped_bunny()).stem}.png"


def _run(ms: MeshSet, field: ScalarField) -> dict[str, Any]:
    if field.name in CURVATURE_FIELDS:
        return compute_curvature_by_bezier_patch_per_vertex(ms, quality=field.name, color=True)
    if field is TORSION_FIELD:
        return compute_torsion_by_bezier_patch_per_vertex(ms, color=True)
    return compute_normal_by_bezier_patch_per_vertex(ms, color=True)


def _panel(ms: MeshSet, field: ScalarField, report: dict[str, Any]) -> Panel:
    """Normals are shown as colours, the other fields by their values."""
    arrays = read_current_mesh(ms)
    if field.name in NORMAL_FIELDS:
        colors = 0.5 + 0.5 * arrays.vertex_normals
        return Panel(arrays.vertices, arrays.faces, colors=colors, title="normals (x, y, z as red, green, blue)")
    return Panel(
        arrays.vertices,
        arrays.faces,
        values=np.array(ms.current_mesh().vertex_scalar_array()),
        label=field.label,
        unit=field.unit,
        signed=field.signed,
        limits=round_limits(*report["color_range"]),
        title=field.label,
    )
