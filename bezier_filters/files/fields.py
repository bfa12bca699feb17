"""The scalar fields that filters, files and pictures share: names, labels, units and signs."""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.estimation.vertex_geometry import VertexGeometry

PREFIX = "bz_"


@dataclass(frozen=True)
class ScalarField:
    """A per-vertex quantity that can be a mesh's quality.

    Attributes
    ----------
    name : str
        What users type, for example ``"mean"``.
    attribute : str
        Property of `VertexGeometry`, and with the prefix ``bz_`` the attribute on a mesh.
    label, unit : str
        For legends, for example ``"mean curvature"`` and ``"1/length"``.
    signed : bool
        Whether zero is the middle of its natural range, as for the mean curvature.
    """

    name: str
    attribute: str
    label: str
    unit: str
    signed: bool

    @property
    def mesh_attribute(self) -> str:
        """Name of the custom attribute and of the PLY property, for example ``bz_k_min``."""
        return PREFIX + self.attribute

    def values(self, geometry: VertexGeometry) -> FloatArray:
        """Values of this field, shape (n,)."""
        result: FloatArray = getattr(geometry, self.attribute)
        return result


CURVATURE_FIELDS = {
    field.name: field
    for field in (
        ScalarField("mean", "mean_curvature", "mean curvature", "1/length", signed=True),
        ScalarField("gaussian", "gaussian_curvature", "Gaussian curvature", "1/length²", signed=True),
        ScalarField("min", "k_min", "smallest principal curvature", "1/length", signed=True),
        ScalarField("max", "k_max", "largest principal curvature", "1/length", signed=True),
        ScalarField("curvedness", "curvedness", "curvedness", "1/length", signed=False),
        ScalarField("shape_index", "shape_index", "shape index", "", signed=True),
        ScalarField("std", "mean_curvature_std", "standard error of the mean curvature", "1/length", signed=False),
    )
}
TORSION_FIELD = ScalarField("torsion", "geodesic_torsion", "principal geodesic torsion", "1/length", signed=False)

DIAGNOSTIC_FIELDS = {
    field.name: field
    for field in (
        ScalarField("status", "fit_status", "status code", "", signed=False),
        ScalarField("rings", "rings_used", "rings", "edges", signed=False),
        ScalarField("residual", "residual", "residual", "length", signed=False),
        ScalarField("normal_std", "normal_std", "standard error of the normal", "radians", signed=False),
        ScalarField(
            "gaussian_std",
            "gaussian_curvature_std",
            "standard error of the Gaussian curvature",
            "1/length²",
            signed=False,
        ),
        ScalarField("extremality_min", "extremality_min", "extremality of k_min", "1/length²", signed=True),
        ScalarField("extremality_max", "extremality_max", "extremality of k_max", "1/length²", signed=True),
        *(
            ScalarField(name, name, name.replace("_", " "), "", signed=True)
            for vector in ("direction_min", "direction_max", "torsion_direction_plus", "torsion_direction_minus")
            for name in (f"{vector}_x", f"{vector}_y", f"{vector}_z")
        ),
    )
}
"""The other columns that filters write."""


def vector_components(attribute: str, vectors: FloatArray) -> dict[str, FloatArray]:
    """Columns ``bz_<attribute>_x``, ``_y``, ``_z`` of vectors of shape (n, 3)."""
    return {f"{PREFIX}{attribute}_{axis}": vectors[:, k] for k, axis in enumerate("xyz")}


def diagnostic_columns(geometry: VertexGeometry) -> dict[str, FloatArray]:
    """Columns that say how the fit went: status code, rings used, residual (length)."""
    return {
        PREFIX + "fit_status": geometry.status.astype(np.float64),
        PREFIX + "rings_used": geometry.rings_used.astype(np.float64),
        PREFIX + "residual": geometry.residual,
    }


def normal_columns(geometry: VertexGeometry) -> dict[str, FloatArray]:
    """Mesh columns of the normal filter."""
    return (
        vector_components("normal", geometry.normals)
        | {PREFIX + "normal_std": geometry.normal_std}
        | diagnostic_columns(geometry)
    )


def curvature_columns(geometry: VertexGeometry) -> dict[str, FloatArray]:
    """Mesh columns of the curvature filter: every curvature field, both directions and extremalities."""
    scalars = {field.mesh_attribute: field.values(geometry) for field in CURVATURE_FIELDS.values()}
    return (
        scalars
        | {PREFIX + "gaussian_curvature_std": geometry.gaussian_curvature_std}
        | vector_components("direction_min", geometry.direction_min)
        | vector_components("direction_max", geometry.direction_max)
        | {
            PREFIX + "extremality_min": geometry.extremality_min,
            PREFIX + "extremality_max": geometry.extremality_max,
        }
        | diagnostic_columns(geometry)
    )


def torsion_columns(geometry: VertexGeometry) -> dict[str, FloatArray]:
    """Mesh columns of the torsion filter: t_max and the directions of +t_max and -t_max."""
    plus, minus = geometry.torsion_directions()
    return (
        {TORSION_FIELD.mesh_attribute: geometry.geodesic_torsion}
        | vector_components("torsion_direction_plus", plus)
        | vector_components("torsion_direction_minus", minus)
        | diagnostic_columns(geometry)
    )
