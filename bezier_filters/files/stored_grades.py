"""Columns of grades as other programs, and earlier versions, leave them: see `FitStatus`."""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.status import FitStatus


def are_grades(values: FloatArray) -> BoolArray:
    """Which numbers of a column (n,) are grades. Others are what was in memory when a program added vertices."""
    return np.isin(values, [status.grade for status in FitStatus])


def grades_of_codes(codes: FloatArray, rings: FloatArray | None) -> FloatArray:
    """Grades of the codes that version 0.2.0 and earlier ones stored, (n,), by the column of the rings if there is one.

    A code 0 was `FitStatus.OK`, or of a vertex that was added later. The latter have 0 rings; without that column
    nothing says that there was an estimate.

    >>> grades_of_codes(np.array([0.0, 0.0, 7.0]), np.array([2.0, 0.0, 0.0])).tolist()
    [9.0, 0.0, 2.0]
    """
    grades = FitStatus.SKIPPED - codes
    has_estimate = (codes != FitStatus.OK) | (False if rings is None else rings > 0)
    return np.where(are_grades(grades) & has_estimate, grades, 0.0)
