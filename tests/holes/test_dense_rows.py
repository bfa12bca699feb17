"""Operations on rows next to numpy."""

import numpy as np
import pytest
from compiled import from_python

from bezier_filters.holes.dense_rows import add_row, dot


@pytest.mark.parametrize("size", [1, 7, 100])
def test_rows_are_added_and_multiplied(size):
    random = np.random.default_rng(size)
    a, b = random.standard_normal((2, size))
    for start in (0, size // 2, size):
        assert from_python(dot)(a, b, start) == pytest.approx(a[start:] @ b[start:], abs=1e-12)
    total = a.copy()
    from_python(add_row)(total, -2.5, b)
    np.testing.assert_allclose(total, a - 2.5 * b, atol=1e-12)
