"""Remarks of commands on rows of a mesh file that are not in the mesh."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from bezier_filters.cli import console
from bezier_filters.errors import MeshFileNote, MeshFileWarning


@dataclass(frozen=True)
class FileRemarks:
    """Remarks on the files that were read, each once."""

    notes: dict[str, None] = field(default_factory=dict)
    losses: dict[str, None] = field(default_factory=dict)

    def show(self) -> None:
        """Print them on stderr."""
        for note in self.notes:
            console.err().print(f"note: {note}", markup=False)
        for loss in self.losses:
            console.err().print(f"look at {loss}", markup=False)


@contextmanager
def file_remarks() -> Iterator[FileRemarks]:
    """Collect the remarks on files that are read in the block; other warnings are shown as usual."""
    found = FileRemarks()
    with warnings.catch_warnings():
        show = warnings.showwarning

        def gather(message: Warning | str, category: type[Warning], *where: object, **options: object) -> None:
            if issubclass(category, MeshFileWarning):
                found.losses[str(message)] = None
            elif issubclass(category, MeshFileNote):
                found.notes[str(message)] = None
            else:
                show(message, category, *where, **options)  # type: ignore[arg-type]

        warnings.showwarning = gather
        for kind in (MeshFileWarning, MeshFileNote):
            warnings.simplefilter("always", kind)
        yield found
