"""All checks of a mesh file before it is read."""

from pathlib import Path

from bezier_filters.files.companions import check_companions
from bezier_filters.files.file_contents import read_contents
from bezier_filters.files.gltf import check_gltf
from bezier_filters.files.mesh_counts import MeshCounts, count_mesh
from bezier_filters.files.mesh_headers import check_header


def check_mesh_file(path: Path) -> MeshCounts:
    """Counts that a file announces; `FieldFileError` if it cannot hold them, or refers to forbidden files."""
    if path.suffix.lower() in (".gltf", ".glb"):
        return MeshCounts(check_gltf(path))
    check_header(path)
    check_companions(path)
    counts = count_mesh(path)
    if counts.is_odd:
        read_contents(path)
    return counts
