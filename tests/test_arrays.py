"""Operations on arrays next to numpy."""

import numpy as np
import pytest

from bezier_filters.arrays import unique_rows


@pytest.mark.parametrize("columns", [1, 2, 3])
@pytest.mark.parametrize("dtype", [np.int32, np.float64])
def test_unique_rows_are_those_of_numpy(columns, dtype):
    rows = np.random.default_rng(0).integers(0, 4, (50, columns)).astype(dtype)
    expected, place = np.unique(rows, axis=0, return_inverse=True)
    got = unique_rows(rows)
    np.testing.assert_array_equal(got[0], expected)
    np.testing.assert_array_equal(got[1], place.ravel())
    assert len(unique_rows(rows[:0])[0]) == 0
