"""Curvatures of parametric surfaces by the textbook: from the fundamental forms, with MeshLab's sign.

Derivatives of the surface are (n, 3), what follows from them is (n,).
"""

from typing import NamedTuple

import numpy as np

from bezier_filters.differential_geometry import principal_curvatures_of


class FundamentalForms(NamedTuple):
    E: np.ndarray
    F: np.ndarray
    G: np.ndarray
    L: np.ndarray
    M: np.ndarray
    N: np.ndarray


class PrincipalCurvatures(NamedTuple):
    k_min: np.ndarray
    k_max: np.ndarray
    direction_min: np.ndarray
    direction_max: np.ndarray


def unit_normals(du, dv):
    normal = np.cross(du, dv)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def fundamental_forms(du, dv, duu, duv, dvv):
    normal = unit_normals(du, dv)
    pairs = [(du, du), (du, dv), (dv, dv), (duu, normal), (duv, normal), (dvv, normal)]
    return FundamentalForms(*(np.einsum("nk,nk->n", a, b) for a, b in pairs))


def mean_curvature(forms):
    E, F, G, L, M, N = forms
    return -(N * E - 2.0 * M * F + L * G) / (2.0 * (E * G - F**2))


def gaussian_curvature(forms):
    E, F, G, L, M, N = forms
    return (L * N - M**2) / (E * G - F**2)


def principal_curvatures(du, dv, forms):
    """From the shape operator in the orthonormal tangents e1 ~ B_u and e2 = normal x e1."""
    E, F, G, L, M, N = forms
    shear = F / E
    length_u, length_v = np.sqrt(E), np.sqrt(G - F * shear)
    e1 = du / length_u[:, np.newaxis]
    e2 = (dv - shear[:, np.newaxis] * du) / length_v[:, np.newaxis]
    s12 = -(M - shear * L) / (length_u * length_v)
    s22 = -(N - 2.0 * shear * M + shear**2 * L) / length_v**2
    return PrincipalCurvatures(*principal_curvatures_of(-L / E, s12, s22, e1, e2))
