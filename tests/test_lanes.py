import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bezier_filters.lanes import LANES, add_products, cholesky_solve, powers


@given(st.integers(1, 25), st.integers(0, 100))
def test_cholesky_agrees_with_a_dense_solver_in_every_lane(order, seed):
    rng = np.random.default_rng(seed)
    factor = rng.standard_normal((LANES, order + 3, order))
    matrix = np.einsum("lki,lkj->lij", factor, factor)
    rhs = rng.standard_normal((LANES, order))
    packed = np.stack([one[np.tril_indices(order)] for one in matrix], axis=1)
    solution, singular = rhs.T.copy(), np.zeros(LANES, dtype=bool)
    cholesky_solve(packed, solution, order, np.zeros((order, LANES)), singular)
    expected = np.linalg.solve(matrix, rhs[..., None])[..., 0]
    condition = np.linalg.cond(matrix)
    for lane in np.flatnonzero(~singular):
        np.testing.assert_allclose(
            solution[:, lane], expected[lane], atol=1e-14 * condition[lane] * np.abs(expected[lane]).max()
        )
    assert not singular[condition < 1e5].any()


def test_a_singular_lane_is_flagged_and_leaves_the_others_alone():
    packed = np.ones((3, LANES))  # [[1, 1], [1, 1]]
    packed[2, 3] = 2.0  # regular in lane 3 alone
    rhs, singular = np.ones((2, LANES)), np.zeros(LANES, dtype=bool)
    cholesky_solve(packed, rhs, 2, np.zeros((2, LANES)), singular)
    assert singular.tolist() == [lane != 3 for lane in range(LANES)]
    np.testing.assert_allclose(rhs[:, 3], [1.0, 0.0], atol=1e-15)
    assert np.isfinite(rhs).all()


def test_powers_and_products():
    t = np.linspace(-0.2, 1.1, LANES)
    out = np.zeros((4, LANES))
    powers(t, 3, out)
    np.testing.assert_allclose(out, t ** np.arange(4)[:, None], atol=1e-15)
    total = np.ones((2, LANES))
    add_products(out, 2 * out, np.array([[0, 3], [2, 1]], dtype=np.int32), total)
    np.testing.assert_allclose(total, [1 + 2 * t**3, 1 + 2 * t**3])
