"""The fields of vertices: one table for filters, commands, tiles, pictures and documents."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bezier_filters.arrays import FloatArray

PREFIX = "bz_"
AXES = "xyz"  # names of components of vectors
NORMAL_COLUMNS = ("nx", "ny", "nz")  # columns of the normals of a mesh
VIEWPOINT_COLUMNS = tuple(f"{PREFIX}viewpoint_{axis}" for axis in AXES)  # places from which points were seen
QUALITY = "quality"  # column of the quality of a mesh
NORMAL = PREFIX + "normal"  # array of the normals where vectors are arrays
GRADE = PREFIX + "fit_grade"  # column of the grades of fits: see `FitStatus`
# the filters that write fields, by their commands
NORMALS, CURVATURE, TORSION, SMOOTH, CREASES = "normals", "curvature", "torsion", "smooth", "creases"
BAKE = "bake"  # the command whose filter writes an image
MEASURES = "measure"  # the command whose filter reports integrals over a surface
DEVIATION = "compare"  # the command whose filter compares a mesh with a reference
ESTIMATES = (NORMALS, CURVATURE, TORSION)  # filters whose fields are values of a `VertexGeometry`


@dataclass(frozen=True)
class Field:
    """A number per vertex."""

    name: str  # with the prefix ``bz_`` the name of the attribute on a mesh and of the column in files
    label: str  # for legends and documents, for example ``"mean curvature"``,
    unit: str  # and ``"1/length"``
    filters: tuple[str, ...]  # the filters that write it
    signed: bool = False  # whether zero is the middle of its natural range, and so of the colours
    quality: str = ""  # word by which users make it the quality of a mesh; empty where they cannot
    attribute: str | None = ""  # attribute of the result, if named differently; None if the filter computes the values
    component: int | None = None  # component of the vectors in the result
    integer: bool = False  # whether the values are codes or counts
    remark: str = ""  # additional text in documents

    @property
    def column(self) -> str:
        """Name of the custom attribute and of the PLY property, for example ``bz_k_min``."""
        return PREFIX + self.name

    @property
    def array(self) -> str:
        """Name of the array in programs that know vectors, for example ``bz_direction_max``."""
        return self.column if self.component is None else self.column.removesuffix(f"_{AXES[self.component]}")

    @property
    def source(self) -> str:
        """Name of the attribute of the result."""
        return self.attribute or self.name


def _vector(
    name: str, label: str, filters: tuple[str, ...], *, attribute: str = "", quality: str = "", remark: str = ""
) -> list[Field]:
    """The three components of a unit vector."""
    return [
        Field(
            f"{name}_{axis}",
            f"{axis} of the {label}",
            "",
            filters,
            signed=True,
            quality=axis if axis in quality else "",
            attribute=attribute or name,
            component=k,
            remark=remark,
        )
        for k, axis in enumerate(AXES)
    ]


def _derivative_remark(curvature: str) -> str:
    return f"derivative of {curvature} along its direction, with whose sign it changes"


_ANY_SIGN = "unit vector of arbitrary sign"
_ERROR, _LEARNED = "standard error of the", "0 where alpha is given"
_DIRECTED = "if a direction is given; 0 where that is along the normal"
FIELDS = (
    Field("normal_angle", "angle to the previous normal", "degrees", (NORMALS,), quality="angle", attribute=None),
    *_vector("normal", "normal", (NORMALS,), attribute="normals", quality="xyz"),
    Field("normal_std", f"{_ERROR} normal", "radians", (NORMALS,), remark=_LEARNED),
    Field("mean_curvature", "mean curvature", "1/length", (CURVATURE,), signed=True, quality="mean"),
    Field("gaussian_curvature", "Gaussian curvature", "1/length²", (CURVATURE,), signed=True, quality="gaussian"),
    Field("k_min", "smallest principal curvature", "1/length", (CURVATURE,), signed=True, quality="min"),
    Field("k_max", "largest principal curvature", "1/length", (CURVATURE,), signed=True, quality="max"),
    Field("curvedness", "curvedness", "1/length", (CURVATURE,), quality="curvedness"),
    Field("shape_index", "shape index", "", (CURVATURE,), signed=True, quality="shape_index"),
    Field("mean_curvature_std", f"{_ERROR} mean curvature", "1/length", (CURVATURE,), quality="std", remark=_LEARNED),
    Field("gaussian_curvature_std", f"{_ERROR} Gaussian curvature", "1/length²", (CURVATURE,), remark=_LEARNED),
    *_vector("direction_min", "direction of k_min", (CURVATURE,), remark=_ANY_SIGN),
    *_vector("direction_max", "direction of k_max", (CURVATURE,), remark=_ANY_SIGN),
    Field(
        "extremality_min",
        "extremality of k_min",
        "1/length²",
        (CURVATURE,),
        signed=True,
        remark=_derivative_remark("k_min"),
    ),
    Field(
        "extremality_max",
        "extremality of k_max",
        "1/length²",
        (CURVATURE,),
        signed=True,
        remark=_derivative_remark("k_max"),
    ),
    Field(
        "curvature_along",
        "normal curvature along the direction",
        "1/length",
        (CURVATURE,),
        signed=True,
        quality="along",
        attribute=None,
        remark=_DIRECTED,
    ),
    Field(
        "curvature_across",
        "normal curvature across the direction",
        "1/length",
        (CURVATURE,),
        signed=True,
        quality="across",
        attribute=None,
        remark=_DIRECTED,
    ),
    Field(
        "plan_curvature",
        "plan curvature",
        "1/length",
        (CURVATURE,),
        signed=True,
        quality="plan",
        attribute=None,
        remark=_DIRECTED,
    ),
    Field("geodesic_torsion", "principal geodesic torsion", "1/length", (TORSION,), quality="torsion"),
    *_vector("torsion_direction_plus", "direction of +t_max", (TORSION,), remark=_ANY_SIGN),
    *_vector("torsion_direction_minus", "direction of -t_max", (TORSION,), remark=_ANY_SIGN),
    Field(
        "fit_grade",
        "grade of the fit",
        "",
        ESTIMATES,
        integer=True,
        remark="9 fitted as asked, 0 not at all, see `FitStatus`",
    ),
    Field("rings_used", "rings", "edges", ESTIMATES, integer=True, remark="how far the neighbourhood goes"),
    Field("residual", "residual", "length", ESTIMATES, remark="weighted RMS height of the points over the patch"),
    Field("displacement", "displacement", "length", (SMOOTH,), quality="displacement", remark="how far it moved"),
    Field(
        "sharpness", "sharpness", "", (SMOOTH,), quality="sharpness", remark="1 where edges were kept, 0 where none was"
    ),
    Field(
        "crease",
        "crease: ridge above 0, ravine below",
        "",
        (CREASES,),
        signed=True,
        attribute=None,
        integer=True,
        remark="0 where none was found, 1 at a ridge, -1 at a ravine, 2 and -2 at sharp edges of these kinds",
    ),
    Field("crease_strength", "strength of creases", "radii of curvature", (CREASES,), attribute=None),
    Field(
        "deviation",
        "deviation",
        "length",
        (DEVIATION,),
        signed=True,
        quality="deviation",
        attribute="distances",
        remark="signed distance from the reference, positive on the side of its normals",
    ),
    Field("deviation_std", f"{_ERROR} deviation", "length", (DEVIATION,), attribute="distance_std"),
    Field(
        "deviation_z",
        "deviation over its standard error",
        "",
        (DEVIATION,),
        signed=True,
        quality="z",
        attribute="z_scores",
        remark="0 where the noise could not be learned",
    ),
    Field(
        "regional_deviation",
        "regional mean deviation",
        "length",
        (DEVIATION,),
        signed=True,
        quality="regional",
        attribute="regional_distances",
        remark="mean over the vertices around it",
    ),
    Field(
        "regional_deviation_std", f"{_ERROR} regional mean deviation", "length", (DEVIATION,), attribute="regional_std"
    ),
    Field(
        "deviation_grade",
        "grade of the comparison",
        "",
        (DEVIATION,),
        attribute="grades",
        integer=True,
        remark="8 compared as asked, below 6 not at all, see `DeviationStatus`",
    ),
)


def fields_of(*filters: str) -> list[Field]:
    """Fields that one of some filters writes, in the order of the table."""
    return [field for field in FIELDS if set(filters) & set(field.filters)]


def qualities(*filters: str) -> dict[str, Field]:
    """Fields of some filters that can be the quality of a mesh, by the words that users type."""
    return {field.quality: field for field in fields_of(*filters) if field.quality}


def result_qualities(*filters: str) -> dict[str, Field]:
    """Qualities that are stored in results, by the words that users type."""
    return {word: field for word, field in qualities(*filters).items() if field.attribute is not None}


def columns(name: str, result: object) -> dict[str, "FloatArray"]:
    """Columns of a filter, each (n,), from a `VertexGeometry` or a `SmoothingResult`."""
    return values_of([field for field in fields_of(name) if field.attribute is not None], result)


def values_of(fields: Sequence[Field], result: object) -> dict[str, "FloatArray"]:
    """Columns of fields stored in a result, each (n,)."""
    arrays = {source: getattr(result, source).astype(float, copy=False) for source in {f.source for f in fields}}
    return {f.column: arrays[f.source] if f.component is None else arrays[f.source][:, f.component] for f in fields}


def column_names(*filters: str) -> list[str]:
    """Columns that some filters write."""
    return [field.column for field in fields_of(*filters)]
