"""The demonstration: normals, curvatures and torsion of one mesh as coloured PLY files and one picture."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from bezier_filters.arrays import Report
from bezier_filters.display import AUTO
from bezier_filters.fields import CURVATURE, NORMALS, QUALITY, TORSION, qualities
from bezier_filters.meshlab.mesh_files import load_mesh, save_mesh
from bezier_filters.meshlab.meshset import bunny_path, read_current_mesh
from bezier_filters.meshlab.vertex_filters import (
    compute_curvature_by_bezier_patch_per_vertex,
    compute_normal_by_bezier_patch_per_vertex,
    compute_torsion_by_bezier_patch_per_vertex,
)
from bezier_filters.pictures.field_panels import field_panels, read_mesh_file
from bezier_filters.pictures.render import render_panels
from bezier_filters.pictures.scene import Panel
from bezier_filters.pictures.views import file_up
from bezier_filters.runtime.parallel import Progress

_STEPS: list[tuple[str, Callable[..., Report], dict[str, Any]]] = [
    ("angle", compute_normal_by_bezier_patch_per_vertex, {}),
    ("mean", compute_curvature_by_bezier_patch_per_vertex, {"quality": "mean"}),
    ("gaussian", compute_curvature_by_bezier_patch_per_vertex, {"quality": "gaussian"}),
    ("torsion", compute_torsion_by_bezier_patch_per_vertex, {}),
]
_FIELDS = [qualities(NORMALS, CURVATURE, TORSION)[quality] for quality, *_ in _STEPS]


def run_demo(
    folder: Path,
    mesh: Path | None = None,
    stage: Callable[[str], Progress | None] = lambda _: None,
    *,
    skip: bool = False,
) -> Iterator[tuple[str, Path, Report]]:
    """Write the files of the demonstration one by one, of the bunny by default; the picture comes with the last.

    Yields the label, the path and the filter's report of each file. `stage` begins a stage, given its name, and returns
    the callback for its progress.
    """
    mesh = mesh or bunny_path()
    folder.mkdir(parents=True, exist_ok=True)
    *files, picture = paths(folder, mesh)
    panels = []
    for field, path, (_, run, options) in zip(_FIELDS, files, _STEPS, strict=True):
        ms = load_mesh(mesh, skip=skip)
        report = run(ms, color=True, progress=stage(field.label), **options)
        save_mesh(ms, path)
        if NORMALS in field.filters:  # which are shown as colours, the other fields by the values in their file
            arrays = read_current_mesh(ms)
            colors, title = 0.5 + 0.5 * arrays.vertex_normals, "normals (x, y, z as red, green, blue)"
            panels.append(Panel(arrays.vertices, arrays.faces, colors=colors, title=title, file_up=file_up(mesh)))
        else:
            (panel,) = field_panels([read_mesh_file(path)], QUALITY, colormap=AUTO, percentile=2.0)
            panels.append(replace(panel, title=field.label, file_up=file_up(mesh)))
        yield field.label, path, report
    stage("drawing")
    render_panels(picture, panels, views=("front", "back"), size=(480, 480))


def paths(folder: Path, mesh: Path | None = None) -> list[Path]:
    """Every file of the demonstration, the picture last."""
    stem = (mesh or bunny_path()).stem
    return [folder / f"{stem}_{field.name}.ply" for field in _FIELDS] + [folder / f"{stem}.png"]
