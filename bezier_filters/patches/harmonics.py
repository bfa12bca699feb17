"""Polynomial circular harmonics r^j cos(l phi), r^j sin(l phi): the random effects of the surface model.

An isotropic prior has one variance per degree j and angular frequency l = j, j - 2, ...: terms with l = 0 determine the
mean curvature, terms with l = 2 the difference of the principal curvatures.
"""

from dataclasses import dataclass
from functools import cache
from math import comb

import numpy as np

from bezier_filters.arrays import FloatArray, IntArray
from bezier_filters.patches.polynomials import total_degree_space

HIGHEST_DEGREE = 8  # of the surface model; degrees above that of a fit contribute its bias


@dataclass(frozen=True)
class HarmonicBasis:
    """Harmonics up to `HIGHEST_DEGREE`, by ascending degree."""

    degrees: IntArray  # (M,): j of every term
    groups: IntArray  # (M,): number of the pair (j, l), ascending; sine and cosine share it
    monomials: FloatArray  # (M, M): column k holds the coefficients of term k for the monomials of `total_degree_space`

    def term_count(self, degree: int) -> int:
        """Number of terms up to a degree."""
        return (degree + 1) * (degree + 2) // 2


@cache
def harmonic_basis() -> HarmonicBasis:
    """All harmonics of the surface model."""
    place = {tuple(pair): k for k, pair in enumerate(total_degree_space(HIGHEST_DEGREE).exponents.tolist())}
    degrees: list[int] = []
    groups: list[int] = []
    columns: list[FloatArray] = []
    for degree in range(HIGHEST_DEGREE + 1):
        for frequency in range(degree, -1, -2):
            half = (degree - frequency) // 2
            term = np.zeros(len(place), dtype=np.complex128)  # (x^2 + y^2)^half (x + i y)^frequency
            for n in range(half + 1):
                for k in range(frequency + 1):
                    pair = (2 * (half - n) + frequency - k, 2 * n + k)
                    term[place[pair]] += comb(half, n) * comb(frequency, k) * 1j**k
            group = groups[-1] + 1 if groups else 0
            for component in (term.real, term.imag)[: 2 if frequency else 1]:
                degrees.append(degree)
                groups.append(group)
                columns.append(component)
    return HarmonicBasis(
        np.array(degrees, np.int32),
        np.array(groups, np.int32),
        np.column_stack(columns),
    )
