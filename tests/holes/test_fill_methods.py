from typing import get_args

import numpy as np
from hole_cases import sheet, without_squares

from bezier_filters import fill_holes
from bezier_filters.holes.fill_methods import FILL_METHODS, FillingMethod
from bezier_filters.holes.smooth_fill import Attempt, first_fill


def test_the_table_has_all_methods():
    assert tuple(FILL_METHODS) == get_args(FillingMethod)


def test_a_further_method_is_a_function_and_a_line_in_the_table(monkeypatch):
    monkeypatch.setitem(FILL_METHODS, "soap", lambda task: iter([Attempt("soap", first_fill(task.region, 1))]))
    vertices, faces = sheet(10, 10)
    faces = without_squares(vertices, faces, lambda x, y: (abs(x - 5) < 2) & (abs(y - 5) < 3))
    result = fill_holes(vertices, faces, "soap")
    assert [hole.method for hole in result.holes if hole.filled] == ["soap"]
    assert np.abs(result.vertices[:, 2]).max() < 1e-9
