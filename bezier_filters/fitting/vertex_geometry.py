"""The result of the fit at every vertex: normals, curvatures and their derivatives, directions, torsion."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.differential_geometry import (
    DerivedCurvatures,
    TangentAngles,
    TerrainCurvature,
    tangent_angles,
    unit_directions,
)
from bezier_filters.display import noise_in_words, summary
from bezier_filters.field_arrays import result_arrays, split_vectors
from bezier_filters.fields import ESTIMATES, GRADE, fields_of
from bezier_filters.meshes.unit_size import CURVATURE, LENGTH, SQUARED_CURVATURE
from bezier_filters.result_tables import Table, TabularResult
from bezier_filters.status import FitStatus

# quantities that notebooks list, and their units
_SHOWN = {
    field.source: field.unit
    for field in fields_of(*ESTIMATES)
    if field.attribute is not None and field.component is None and field.column != GRADE
}


@dataclass(frozen=True)
class FitPart:
    """Fit of a region of a mesh, where noise or shape vary too much for one choice.

    Attributes
    ----------
    vertices : int
        Number of vertices.
    rings, degree : int
        As in `FitChoice`.
    noise_sigma : float
        Standard deviation of the noise of the region, a length.
    """

    vertices: int
    rings: int
    degree: int
    noise_sigma: float = field(metadata=LENGTH)


@dataclass(frozen=True)
class FitChoice:
    """How the vertices of a mesh were fitted.

    Attributes
    ----------
    rings : int
        Size of the neighbourhood in edges; some vertices may have needed another one. 0 if there is a `radius`, or a
        number of `neighbours`.
    degree : int
        Degree of the patch, or total degree of the polynomial where `alpha` is None.
    alpha : float or None
        Weight of the points; None where the weight of every degree was learned.
    noise_sigma : float or None
        Standard deviation of the noise along the normal, a length; None where it was not learned.
    parts : tuple of FitPart
        Where noise or shape vary, the choices for the regions of the surface; the attributes above are then the
        best single choice for all of it.
    radius : float or None
        Radius of the balls that are the neighbourhoods, a length; None if these are rings.
    noise_length : float or None
        Distance over which the noise is correlated; 0 if it is independent from vertex to vertex.
    noise_heavy : bool
        Whether the noise is so strong, as noise in all directions is, that single normals are useless.
    noise_reason : str
        Why the noise could not be learned; empty if it was. Then 2 rings, alpha 0.8 and the requested degree, 4 at
        most, or 3, replace the choices by the data.
    neighbours : int or None
        Number of points of the neighbourhoods, the vertex among them; None if these are rings or balls.
    """

    rings: int
    degree: int
    alpha: float | None
    noise_sigma: float | None = field(metadata=LENGTH)
    parts: tuple[FitPart, ...] = ()
    radius: float | None = field(default=None, metadata=LENGTH)
    noise_length: float | None = field(default=None, metadata=LENGTH)
    noise_heavy: bool = False
    noise_reason: str = ""
    neighbours: int | None = None

    @property
    def noise(self) -> str:
        """The noise in words; empty if it was not estimated."""
        if self.noise_sigma is None and not self.noise_reason:
            return ""
        return noise_in_words(self.noise_sigma, self.noise_length, self.noise_heavy, reason=self.noise_reason)


class _DerivedGeometry(DerivedCurvatures):
    """What follows from principal curvatures, directions and status; fields of a `VertexGeometry` of these names."""

    direction_min: FloatArray
    direction_max: FloatArray
    status: IntArray

    @property
    def fit_grade(self) -> IntArray:
        """`FitStatus` as files and meshes hold it, (n,) int32: from 9 for ``OK`` to 0 where nothing was estimated."""
        return np.int32(FitStatus.SKIPPED) - self.status

    @property
    def curvedness(self) -> FloatArray:
        """Koenderink's curvedness sqrt((k_min^2 + k_max^2) / 2), shape (n,), 1/length."""
        return np.asarray(np.hypot(self.k_min, self.k_max) * np.sqrt(0.5))

    @property
    def shape_index(self) -> FloatArray:
        """Koenderink's shape index (2/pi) atan((k_max + k_min) / (k_max - k_min)), in [-1, 1].

        +1 is a convex cap, 0.5 a ridge, 0 a symmetric saddle, -0.5 a rut, -1 a cup. It is 0
        where both curvatures vanish and the index is undefined.
        """
        return np.arctan2(self.k_max + self.k_min, self.k_max - self.k_min) * (2.0 / np.pi)

    @property
    def torsion_direction_plus(self) -> FloatArray:
        """Directions of the largest torsion, +t_max, (n, 3); undefined at umbilics, without sign."""
        return np.asarray((self.direction_max + self.direction_min) * np.sqrt(0.5))

    @property
    def torsion_direction_minus(self) -> FloatArray:
        """Directions of the smallest torsion, -t_max, (n, 3); undefined at umbilics, without sign."""
        return np.asarray((self.direction_max - self.direction_min) * np.sqrt(0.5))


@dataclass(frozen=True, repr=False)
class VertexGeometry(_DerivedGeometry, TabularResult):
    """Differential geometry at the vertices of a mesh; row ``i`` belongs to vertex ``i``.

    Curvatures are positive on a convex body with outward normals (MeshLab's sign) and have the
    unit 1/length; the Gaussian curvature has 1/length^2. Every value is finite: where `status`
    says that a quantity could not be estimated, it holds 0.

    Attributes
    ----------
    normals : (n, 3) float64
        Unit normals of the fitted patches; zero vectors at isolated vertices.
    k_min, k_max : (n,) float64
        Principal curvatures, ``k_min <= k_max``.
    direction_min, direction_max : (n, 3) float64
        Unit tangent directions of `k_min` and `k_max`, with
        ``direction_min = normals x direction_max``. Their signs are arbitrary, and at umbilics
        (``k_min == k_max``) so is the pair: compare lines, not vectors.
    extremality_min, extremality_max : (n,) float64
        Derivatives of the principal curvatures along their own directions, ``D_direction_min k_min``
        and ``D_direction_max k_max``, 1/length^2: crest lines run where they vanish. Each changes
        its sign with its direction. At umbilics they are as arbitrary as the directions, but
        finite; where the patch has a degree below 3 they are 0. A smoothness (alpha < 1, or
        learned) shrinks them, like all third derivatives of the patch.
    displacements : (n, 3) float64
        From each vertex p_i to its patch, B(u_i, v_i) - p_i: along the normal of the plane that the patch is a
        height field over.
    residual : (n,) float64
        Root mean square height of the fitted points over the patch, with their distance weights, a length: never more
        than the one over the tangent plane, unless the fit is robust.
    normal_std : (n,) float64
        Standard error of the normal: root mean square angle to the true one, in radians.
    mean_curvature_std, gaussian_curvature_std : (n,) float64
        Standard errors of H, 1/length, and K, 1/length^2. Like `normal_std` they follow from the
        noise and the smoothness that were learned from the mesh, and are 0 where alpha was given.
    rings_used : (n,) int32
        Number of rings of the neighbourhood that was fitted, or that its ball goes through, or 1 of a given number of
        points; 0 where nothing was.
    status : (n,) int32
        `FitStatus` codes.
    fit : FitChoice
        Neighbourhood, degree and weight that were used.
    condition_number : (n,) float64 or None
        Condition number of each fit, see `condition_numbers`: relative errors of the coefficients are a small multiple
        of its square times 1.1e-16. 0 where nothing was fitted; None if it was not requested.
    noise_free : (n, 3) float64 or None
        The denoised vertices, as in `smooth` before it restores volumes, if they were needed to find the sharp edges at
        which neighbourhoods end.
    flipped : int or None
        Number of points of a cloud whose normals face the wrong side of their viewpoints; None without viewpoints.
    mean_curvature, gaussian_curvature, geodesic_torsion, curvedness, shape_index : (n,) float64
        Derived from `k_min` and `k_max`, whenever they are read.
    torsion_direction_plus, torsion_direction_minus : (n, 3) float64
        Derived from the principal directions.
    fit_grade : (n,) int32
        Derived from `status`.
    """

    normals: FloatArray
    k_min: FloatArray = field(metadata=CURVATURE)
    k_max: FloatArray = field(metadata=CURVATURE)
    direction_min: FloatArray
    direction_max: FloatArray
    extremality_min: FloatArray = field(metadata=SQUARED_CURVATURE)
    extremality_max: FloatArray = field(metadata=SQUARED_CURVATURE)
    displacements: FloatArray = field(metadata=LENGTH)
    residual: FloatArray = field(metadata=LENGTH)
    normal_std: FloatArray
    mean_curvature_std: FloatArray = field(metadata=CURVATURE)
    gaussian_curvature_std: FloatArray = field(metadata=SQUARED_CURVATURE)
    rings_used: IntArray
    status: IntArray
    fit: FitChoice
    condition_number: FloatArray | None = None
    noise_free: FloatArray | None = field(default=None, metadata=LENGTH)
    flipped: int | None = None
    mean_curvature: FloatArray = field(init=False, metadata=CURVATURE)
    gaussian_curvature: FloatArray = field(init=False, metadata=SQUARED_CURVATURE)
    geodesic_torsion: FloatArray = field(init=False, metadata=CURVATURE)
    curvedness: FloatArray = field(init=False, metadata=CURVATURE)
    shape_index: FloatArray = field(init=False)
    torsion_direction_plus: FloatArray = field(init=False)
    torsion_direction_minus: FloatArray = field(init=False)
    fit_grade: IntArray = field(init=False)

    @property
    def noise_sigma(self) -> float | None:
        """Standard deviation of the noise along the normal, a length; None where it was not learned."""
        return self.fit.noise_sigma

    def curvature_along(self, directions: ArrayLike) -> FloatArray:
        """Normal curvature of the surface in given directions.

        By Euler's theorem it is k(theta) = k_max cos^2 theta + k_min sin^2 theta, theta being the angle from
        `direction_max` to the tangential part of the direction (do Carmo, "Differential geometry of curves and
        surfaces", 1976, section 3-2). Like all curvatures it is positive where the surface is convex towards its
        normal, and flipping the mesh negates it.

        Parameters
        ----------
        directions : (3,) or (n, 3) array_like of float
            One direction for all vertices, or one for each, of any length; the part along the normal is ignored.

        Returns
        -------
        (n,) float64
            Normal curvature, 1/length; 0 where there is no estimate, or a direction has no tangential part.

        Raises
        ------
        InvalidParameterError
            If the directions are not finite or have another shape.

        Examples
        --------
        A tube of radius 2 along z is straight that way and a circle around it:

        >>> from bezier_filters import estimate_vertex_geometry
        >>> from bezier_filters.surfaces import cylinder
        >>> tube = cylinder(radius=2.0)
        >>> geometry = estimate_vertex_geometry(tube.vertices, tube.faces)
        >>> bool(abs(geometry.curvature_along([0, 0, 1])).max() < 0.005)
        True
        >>> bool(abs(geometry.curvature_along(np.cross([0, 0, 1], tube.vertices)) - 0.5).max() < 0.005)
        True
        """
        angles = self._angles(directions)
        return self.k_max * angles.cosine**2 + self.k_min * angles.sine**2

    def torsion_along(self, directions: ArrayLike) -> FloatArray:
        """Geodesic torsion of the surface in given tangent directions.

        The torsion is t(theta) = t_max sin(2 theta), theta being the angle from `direction_max`
        to the direction, counter-clockwise about the normal. It is the Frenet torsion of the
        geodesic that leaves in that direction, positive for a right-handed helix, and does not
        depend on the orientation of the mesh.

        Parameters
        ----------
        directions : (n, 3) or (3,) array_like of float
            Directions, of any non-zero length; their normal component is ignored.

        Returns
        -------
        (n,) float64
            Torsion, 1/length; 0 where a direction has no tangential part.

        Raises
        ------
        InvalidParameterError
            If the directions are not finite or have another shape.
        """
        angles = self._angles(directions)
        return 2.0 * self.geodesic_torsion * angles.cosine * angles.sine

    def terrain_curvature(self, gravity: ArrayLike = (0.0, 0.0, -1.0)) -> TerrainCurvature:
        """Slope, and profile, tangential and plan curvature, of a land surface under gravity.

        Profile and tangential curvature are the normal curvatures along the line of steepest slope and across it,
        along the contour line; plan curvature is that of the contour line. For a height field z(x, y) under
        gravity (0, 0, -1), with p = z_x, q = z_y, r = z_xx, s = z_xy, t = z_yy and g = p^2 + q^2, they are

            profile = -(p^2 r + 2 p q s + q^2 t) / (g (1 + g)^(3/2))
            tangential = -(q^2 r - 2 p q s + p^2 t) / (g (1 + g)^(1/2))
            plan = -(q^2 r - 2 p q s + p^2 t) / g^(3/2)

        (Florinsky, "An illustrated introduction to general geomorphometry", Progress in Physical Geography 41, 2017:
        vertical, horizontal and plan curvature; Minar, Evans, Jenco, "A comprehensive system of definitions of land
        surface curvatures", Earth-Science Reviews 211, 2020: normal slope line, normal contour and projected contour
        curvature). The signs are those of these articles, convex positive, if the faces look up. Some programs negate
        one or the other.

        Parameters
        ----------
        gravity : (3,) or (n, 3) array_like of float
            Direction of gravity, downward, of any length; one for all vertices, or one for each.

        Returns
        -------
        TerrainCurvature
            Where the land is level to rounding there is no direction of slope, and curvatures are 0.

        Raises
        ------
        InvalidParameterError
            If gravity is not finite or has another shape.

        Notes
        -----
        The direction of a slope is as uncertain as the normal: where `slope` is not well above `normal_std`, so are
        these curvatures.

        Examples
        --------
        On a round hill profile and tangential curvature are the same, that of the sphere, and contour lines
        are circles around the axis:

        >>> from bezier_filters import estimate_vertex_geometry
        >>> from bezier_filters.surfaces import sphere
        >>> ball = sphere(radius=2.0, resolution=20)
        >>> terrain = estimate_vertex_geometry(ball.vertices, ball.faces).terrain_curvature()
        >>> bool(abs(terrain.profile[terrain.is_defined] - 0.5).max() < 1e-6)
        True
        >>> axis = np.hypot(*ball.vertices[:, :2].T)  # distance to it
        >>> bool(abs(terrain.plan * axis - 1.0)[axis > 0.1].max() < 1e-5)
        True
        """
        angles = self._angles(gravity)
        profile = self.k_max * angles.cosine**2 + self.k_min * angles.sine**2
        tangential = self.k_max * angles.sine**2 + self.k_min * angles.cosine**2
        plan = np.divide(tangential, angles.length, out=np.zeros_like(tangential), where=angles.exist)
        down = unit_directions(gravity, len(self.normals))
        sine = np.linalg.norm(np.cross(self.normals, down), axis=1)
        slope = np.where(self.normals.any(axis=1), np.arctan2(sine, -np.einsum("ij,ij->i", self.normals, down)), 0.0)
        return TerrainCurvature(slope, profile, tangential, plan, angles.exist)

    def _angles(self, directions: ArrayLike) -> TangentAngles:
        return tangent_angles(directions, self.direction_max, self.direction_min)

    def torsion_directions(self) -> tuple[FloatArray, FloatArray]:
        """Directions of the largest (+t_max) and the smallest (-t_max) torsion, each (n, 3).

        They bisect the principal directions. Like those they are undefined at umbilics and
        have no sign.
        """
        return self.torsion_direction_plus, self.torsion_direction_minus

    def status_counts(self) -> dict[str, int]:
        """Number of vertices per status name, from best to worst, without zeros."""
        counts = np.bincount(self.status, minlength=len(FitStatus))
        return {status.name: int(counts[status]) for status in FitStatus if counts[status]}

    def __repr__(self) -> str:
        """One line: how many vertices there are of every status, and how they were fitted."""
        return f"VertexGeometry({len(self.status)} vertices: {self.status_counts()}; {self.fit})"

    def _tables(self) -> list[Table]:
        known = self.status <= FitStatus.FOLDED
        rows = [summary(name, unit, getattr(self, name)[known]) for name, unit in _SHOWN.items()]
        counts = [(FitStatus[name].message, name, count) for name, count in self.status_counts().items()]
        title = ": ".join(filter(None, [f"Geometry of {len(self.status):,} vertices", self.fit.noise]))
        return [
            Table(title, ["", "unit", "min", "median", "max"], rows),
            Table("Fits", ["outcome", "status", "vertices"], counts),
        ]

    def _columns(self) -> dict[str, NDArray[Any]]:
        return split_vectors(result_arrays(self, *ESTIMATES))


def arrays_of(geometry: VertexGeometry) -> dict[str, FloatArray | IntArray]:
    """The arrays with a value or a vector for every vertex, by name."""
    return {name: values for name, values in vars(geometry).items() if isinstance(values, np.ndarray)}


def empty_geometry(n: int) -> VertexGeometry:
    """Geometry of n vertices that nothing is known of: zeros and `FitStatus.SKIPPED`.

    The numbers lie in one block of memory, which the system hands out in large pages: to get it in
    small ones takes a tenth of the time of a fit.
    """
    vectors = ("normals", "direction_min", "direction_max", "displacements")
    scalars = ["k_min", "k_max", "extremality_min", "extremality_max", "residual", "normal_std"]
    scalars += ["mean_curvature_std", "gaussian_curvature_std"]
    block = np.zeros((3 * len(vectors) + len(scalars)) * n)
    of_vectors, of_scalars = np.split(block, [3 * len(vectors) * n])
    arrays: dict[str, Any] = dict(zip(vectors, of_vectors.reshape(len(vectors), n, 3), strict=True))
    arrays |= dict(zip(scalars, of_scalars.reshape(len(scalars), n), strict=True))
    return VertexGeometry(
        **arrays,
        rings_used=np.zeros(n, dtype=np.int32),
        status=np.full(n, int(FitStatus.SKIPPED), dtype=np.int32),
        fit=FitChoice(0, 0, None, None),
    )
