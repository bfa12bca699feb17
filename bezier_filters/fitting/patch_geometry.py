"""The result of the fit at every vertex with the patches themselves."""

from dataclasses import dataclass, field

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.fitting.vertex_geometry import VertexGeometry, empty_geometry
from bezier_filters.kernels.kernel_input import PatchTable
from bezier_filters.kernels.patch_rows import row_length


@dataclass(frozen=True, repr=False)
class PatchGeometry(VertexGeometry):
    """A `VertexGeometry` with the fitted polynomials, and the standard errors of their heights at the vertices."""

    patch_rows: FloatArray = field(kw_only=True)  # see `PatchTable`
    height_std: FloatArray = field(kw_only=True)  # (n,), a length


def patch_table(geometry: VertexGeometry) -> PatchTable | None:
    """The arrays for patches, if the geometry has them."""
    return PatchTable(geometry.patch_rows, geometry.height_std) if isinstance(geometry, PatchGeometry) else None


def empty_patch_geometry(n: int, total_degree: int) -> PatchGeometry:
    """Geometry of n vertices, and polynomials of that total degree or less, that nothing is known of."""
    plain = vars(empty_geometry(n))
    return PatchGeometry(**plain, patch_rows=np.zeros((n, row_length(total_degree))), height_std=np.zeros(n))
