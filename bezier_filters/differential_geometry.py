"""Fundamental forms and curvatures of parametric surfaces, with MeshLab's sign.

Every function works on arrays of n surface points at once. Curvatures are positive where the
surface is convex towards its normal (a sphere with outward normals).
"""

from dataclasses import dataclass

import numpy as np

from bezier_filters.arrays import FloatArray


@dataclass(frozen=True)
class FundamentalForms:
    """Coefficients of the first (E, F, G) and second (L, M, N) fundamental forms, each (n,).

    L, M, N are the textbook ones, taken with the unit normal B_u x B_v / |B_u x B_v|.
    """

    E: FloatArray
    F: FloatArray
    G: FloatArray
    L: FloatArray
    M: FloatArray
    N: FloatArray


class DerivedCurvatures:
    """What follows from principal curvatures, for classes that have them."""

    k_min: FloatArray
    k_max: FloatArray

    @property
    def mean_curvature(self) -> FloatArray:
        """Mean curvature H = (k_min + k_max) / 2, shape (n,), 1/length."""
        return 0.5 * (self.k_min + self.k_max)

    @property
    def gaussian_curvature(self) -> FloatArray:
        """Gaussian curvature K = k_min k_max, shape (n,), 1/length^2."""
        return self.k_min * self.k_max

    @property
    def geodesic_torsion(self) -> FloatArray:
        """Principal geodesic torsion t_max = (k_max - k_min) / 2 >= 0, shape (n,), 1/length."""
        return 0.5 * (self.k_max - self.k_min)


@dataclass(frozen=True)
class PrincipalCurvatures:
    """Principal curvatures (n,), ``k_min <= k_max``, and their unit directions (n, 3).

    ``direction_min = normal x direction_max``; signs are arbitrary.
    """

    k_min: FloatArray
    k_max: FloatArray
    direction_min: FloatArray
    direction_max: FloatArray


def unit_normals(du: FloatArray, dv: FloatArray) -> FloatArray:
    """Unit normals B_u x B_v / |B_u x B_v|, shape (n, 3)."""
    normal = np.cross(du, dv)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def fundamental_forms(
    du: FloatArray, dv: FloatArray, duu: FloatArray, duv: FloatArray, dvv: FloatArray
) -> FundamentalForms:
    """Fundamental forms from the first and second derivatives of a surface, each (n, 3)."""
    normal = unit_normals(du, dv)
    return FundamentalForms(
        E=_dot(du, du),
        F=_dot(du, dv),
        G=_dot(dv, dv),
        L=_dot(duu, normal),
        M=_dot(duv, normal),
        N=_dot(dvv, normal),
    )


def mean_curvature(forms: FundamentalForms) -> FloatArray:
    """Mean curvature -(N E - 2 M F + L G) / (2 (E G - F^2)), 1/length: MeshLab's sign."""
    return -(forms.N * forms.E - 2.0 * forms.M * forms.F + forms.L * forms.G) / (2.0 * _metric_determinant(forms))


def gaussian_curvature(forms: FundamentalForms) -> FloatArray:
    """Gaussian curvature (L N - M^2) / (E G - F^2), 1/length^2."""
    return (forms.L * forms.N - forms.M**2) / _metric_determinant(forms)


def principal_curvatures(du: FloatArray, dv: FloatArray, forms: FundamentalForms) -> PrincipalCurvatures:
    """Principal curvatures from the symmetric shape operator, so that k_max - k_min >= 0 always.

    Parameters
    ----------
    du, dv : (n, 3) float64
        First derivatives of the surface.
    forms : FundamentalForms
        Its fundamental forms.
    """
    # Orthonormal tangent basis e1 ~ B_u, e2 = normal x e1, and the operator in it.
    length_u = np.sqrt(forms.E)
    shear = forms.F / forms.E
    length_v = np.sqrt(forms.G - forms.F * shear)
    e1 = du / length_u[:, np.newaxis]
    e2 = (dv - shear[:, np.newaxis] * du) / length_v[:, np.newaxis]
    s11 = -forms.L / forms.E
    s12 = -(forms.M - shear * forms.L) / (length_u * length_v)
    s22 = -(forms.N - 2.0 * shear * forms.M + shear**2 * forms.L) / length_v**2
    return principal_curvatures_of(s11, s12, s22, e1, e2)


def principal_curvatures_of(
    s11: FloatArray, s12: FloatArray, s22: FloatArray, e1: FloatArray, e2: FloatArray
) -> PrincipalCurvatures:
    """Principal curvatures of symmetric shape operators, (n,) each entry, in orthonormal bases e1, e2, each (n, 3)."""
    mean, difference = 0.5 * (s11 + s22), 0.5 * (s11 - s22)
    torsion = np.hypot(difference, s12)
    angle = 0.5 * np.arctan2(s12, difference)[:, np.newaxis]
    return PrincipalCurvatures(
        k_min=mean - torsion,
        k_max=mean + torsion,
        direction_min=np.cos(angle) * e2 - np.sin(angle) * e1,
        direction_max=np.cos(angle) * e1 + np.sin(angle) * e2,
    )


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...k,...k->...", a, b))


def _metric_determinant(forms: FundamentalForms) -> FloatArray:
    return forms.E * forms.G - forms.F**2
