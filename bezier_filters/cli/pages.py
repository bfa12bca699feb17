"""The page of a mesh file, and the summary of its contents that is also the report of `info`."""

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from bezier_filters._version import __version__
from bezier_filters.cli import console
from bezier_filters.runtime.file_names import printable_name, printable_path

if TYPE_CHECKING:
    from bezier_filters.arrays import Report
    from bezier_filters.meshes.prepared_mesh import PreparedMesh
    from bezier_filters.meshlab.meshset import CurrentMesh, MeshSet
    from bezier_filters.pictures.page import Page
    from bezier_filters.surface_lines.lines import SurfaceLines


def check_page(page: Path) -> None:
    """Refuse a file name that is not that of a page."""
    if page.suffix.lower() not in (".html", ".htm"):
        raise typer.BadParameter(f"PAGE: got {str(page)!r}, expected a file name that ends in .html")


def write_page(
    source: Path,
    page: Path,
    stage: console.Stage,
    *,
    cleaned: Path | None = None,
    up: str = "auto",
    front: str = "auto",
    skip: bool = False,
) -> "Page":
    """Write the page of a mesh file, or of its cleaning if that was written to a file."""
    from bezier_filters.pictures.page import report_page
    from bezier_filters.pictures.views import Orientation, file_up

    mesh, summary = inspect_file(source, stage, skip=skip)
    made = report_page(
        printable_name(source),
        mesh,
        console.summary_rows(summary),
        summary["findings"],
        source=printable_path(source),
        about=[*file_facts(source), *([] if cleaned is None else [f"cleaned: {printable_name(cleaned)}"])],
        cleaned=cleaned is not None,
        can_be_repaired=summary["can_be_repaired"],
        oriented=Orientation(up, front, file_up(source)),
        stage=stage,
    )
    made.save(page)
    return made


def write_line_page(
    source: Path,
    page: Path,
    mesh: "CurrentMesh",
    found: "SurfaceLines",
    *,
    up: str,
    front: str,
) -> None:
    """Write the page of a mesh file with lines on its surface."""
    from bezier_filters.pictures.page import page_of
    from bezier_filters.pictures.views import Orientation, file_up

    page_of(
        printable_name(source),
        mesh.vertices,
        mesh.faces,
        lines=found,
        about=file_facts(source),
        oriented=Orientation(up, front, file_up(source)),
    ).save(page)


def write_deviation_page(
    source: Path, page: Path, ms: "MeshSet", report: "Report", reference: str, *, up: str, front: str
) -> None:
    """Write the page of the deviation that the filter computed for the current mesh."""
    from bezier_filters.fields import DEVIATION, fields_of
    from bezier_filters.meshlab.mesh_attributes import read_columns
    from bezier_filters.meshlab.meshset import read_current_mesh
    from bezier_filters.pictures.page import page_of
    from bezier_filters.pictures.page_deviation import DeviationFields, deviation_sentences, deviation_tables
    from bezier_filters.pictures.views import Orientation, file_up

    mesh = read_current_mesh(ms)
    columns = read_columns(ms, [field.column for field in fields_of(DEVIATION)])
    page_of(
        f"{printable_name(source)}, compared with {reference}",
        mesh.vertices,
        mesh.faces,
        deviation=DeviationFields(columns, report["tolerance"]),
        sentences=deviation_sentences(report, reference),
        tables=deviation_tables(report),
        about=file_facts(source),
        oriented=Orientation(up, front, file_up(source)),
    ).save(page)


def file_facts(source: Path) -> list[str]:
    """Date, version, and size of a file."""
    size, unit = float(source.stat().st_size), "bytes"
    for larger in ("kB", "MB", "GB"):
        if size >= 1000.0:
            size, unit = size / 1000.0, larger
    return [time.strftime("%Y-%m-%d"), f"bezier-filters {__version__}", f"{size:.3g} {unit}"]


def inspect_file(source: Path, stage: console.Stage, *, skip: bool) -> tuple["CurrentMesh", "Report"]:
    """A mesh, and the report of `info`."""
    from bezier_filters.meshes.diagnosis import can_be_repaired, diagnose, inspect_mesh, is_fit
    from bezier_filters.meshes.mesh import triangle_mesh
    from bezier_filters.meshes.prepared_mesh import prepare_mesh
    from bezier_filters.meshlab.mesh_files import contents_of, load_mesh
    from bezier_filters.meshlab.meshset import read_current_mesh
    from bezier_filters.meshlab.topology import topology_of
    from bezier_filters.noise.rounded_coordinates import describe_rounding

    stage(f"reading {printable_name(source)}")
    ms = load_mesh(source, skip=skip)
    stage(f"inspecting {printable_name(source)}")
    loaded = read_current_mesh(ms)
    mesh = triangle_mesh(loaded.vertices, loaded.faces)
    topology = topology_of(mesh.vertices, mesh.faces).counts
    faults, prepared = inspect_mesh(mesh), prepare_mesh(mesh)
    stage("learning the noise")
    return loaded, {
        "vertices": mesh.vertex_count,
        "faces": mesh.face_count,
        **topology,
        **asdict(faults),
        "bounding_box": [mesh.vertices.min(axis=0).tolist(), mesh.vertices.max(axis=0).tolist()],
        "noise": _noise_of(prepared) if mesh.face_count else None,
        "fit_for_fitting": is_fit(mesh, faults),
        "findings": [*diagnose(mesh, faults), *filter(None, [describe_rounding(prepared)])],
        "can_be_repaired": can_be_repaired(faults),
        "contents": contents_of(ms),
    }


def _noise_of(mesh: "PreparedMesh") -> "Report":
    """Noise of a mesh, learned as for fitting and smoothing, as arguments of `noise_in_words`."""
    from bezier_filters.fitting.first_call import first_call
    from bezier_filters.fitting.noise_level import explain_unknown_noise, learn_mesh_noise
    from bezier_filters.runtime.parallel import use_threads

    with use_threads(), first_call():
        found = learn_mesh_noise(mesh)
        if found is None:
            reason = explain_unknown_noise(mesh)
            return {"sigma": None, "length": None, "heavy": False, "reason": reason}
    return {"sigma": found.sigma, "length": found.length, "heavy": found.heavy, "reason": ""}
