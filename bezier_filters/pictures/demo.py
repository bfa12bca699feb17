"""The demonstration: normals, curvatures and torsion of one mesh as coloured PLY files and one picture."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from bezier_filters.arrays import Report
from bezier_filters.display.colors import AUTO
from bezier_filters.fields import CURVATURE, NORMALS, QUALITY, TORSION, Field, qualities
from bezier_filters.meshlab.mesh_files import load_mesh, save_mesh
from bezier_filters.meshlab.meshset import MeshSet, read_current_mesh, shipped_bunny
from bezier_filters.meshlab.vertex_filters import (
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)
from bezier_filters.pictures.field_panels import field_panels, read_mesh_file
from bezier_filters.pictures.render import render_panels
from bezier_filters.pictures.scene import Panel
from bezier_filters.runtime.parallel import Progress

_FIELDS = [qualities(NORMALS, CURVATURE, TORSION)[name] for name in ("angle", "mean", "gaussian", "torsion")]


@dataclass(frozen=True)
class DemoStep:
    """One file of the demonstration: what it shows and what the filter reported."""

    field: Field
    path: Path
    report: Report


def run_demo(
    folder: Path, mesh: Path | None = None, stage: Callable[[str], Progress | None] = lambda _: None
) -> Iterator[DemoStep]:
    """Write the files of the demonstration one by one, of the bunny by default; the picture comes with the last.

    The stages are told by their names; their callbacks say how far each has come.
    """
    mesh = mesh or shipped_bunny()
    folder.mkdir(parents=True, exist_ok=True)
    panels = []
    for field in _FIELDS:
        ms = load_mesh(mesh)
        report = _run(ms, field, stage(field.label))
        path = _path(folder, mesh, field)
        save_mesh(ms, path)
        panels.append(_panel(ms, field, path))
        yield DemoStep(field, path, report)
    stage("drawing")
    render_panels(picture_path(folder, mesh), panels, views=("front", "back"), size=(480, 480))


def picture_path(folder: Path, mesh: Path | None = None) -> Path:
    """Where the picture of the demonstration is written."""
    return folder / f"{(mesh or shipped_bunny()).stem}.png"


def paths(folder: Path, mesh: Path | None = None) -> list[Path]:
    """Every file of the demonstration."""
    return [*(_path(folder, mesh or shipped_bunny(), field) for field in _FIELDS), picture_path(folder, mesh)]


def _path(folder: Path, mesh: Path, field: Field) -> Path:
    return folder / f"{mesh.stem}_{field.name}.ply"


def _run(ms: MeshSet, field: Field, progress: Progress | None) -> Report:
    if CURVATURE in field.filters:
        return compute_curvature_by_bezier_patch_per_vertex(ms, quality=field.quality, color=True, progress=progress)
    if TORSION in field.filters:
        return compute_torsion_by_bezier_patch_per_vertex(ms, color=True, progress=progress)
    return compute_normal_by_bezier_patch_per_vertex(ms, color=True, progress=progress)


def _panel(ms: MeshSet, field: Field, path: Path) -> Panel:
    """Normals are shown as colours, the other fields by the values in their file."""
    if NORMALS in field.filters:
        arrays = read_current_mesh(ms)
        colors = 0.5 + 0.5 * arrays.vertex_normals
        return Panel(arrays.vertices, arrays.faces, colors=colors, title="normals (x, y, z as red, green, blue)")
    (panel,) = field_panels([read_mesh_file(path)], QUALITY, colormap=AUTO, percentile=2.0)
    return replace(panel, title=field.label)
