"""Columns of grades from other programs and earlier versions: see `FitStatus`."""

import numpy as np

from bezier_filters.arrays import BoolArray, FloatArray
from bezier_filters.status import FitStatus


def are_grades(values: FloatArray) -> BoolArray:
    """Which numbers of a column (n,) are grades; others are uninitialised memory of programs that added vertices."""
    return np.isin(values, [status.grade for status in FitStatus])


def grades_of_codes(codes: FloatArray, rings: FloatArray | None) -> FloatArray:
    """Grades of the codes stored by versions up to 0.2.0, (n,), given the column of rings if there is one.

    Code 0 means `FitStatus.OK`, or a vertex that was added later, with 0 rings. Without that column, code 0 counts as
    not estimated.

    >>> grades_of_codes(np.array([0.0, 0.0, 7.0]), np.array([2.0, 0.0, 0.0])).tolist()
    [9.0, 0.0, 2.0]
    """
    grades = FitStatus.SKIPPED - codes
    has_estimate = (codes != FitStatus.OK) | (False if rings is None else rings > 0)
    return np.where(are_grades(grades) & has_estimate, grades, 0.0)
