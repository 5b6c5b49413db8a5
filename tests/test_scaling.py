import numpy as np
import pytest

from alssnn.scaling import Scaling


def test_scaled_deviations_have_mean_zero_and_unit_variance(rng):
    u, y = 3 + 2 * rng.standard_normal((50, 2)), 7 * rng.standard_normal((50, 1)) - 1
    scaling = Scaling.from_data(u, y, "mean")
    for signal in (scaling.scale_u(u), scaling.scale_y(y)):
        signal = np.asarray(signal)
        np.testing.assert_allclose(signal.mean(axis=0), 0, atol=1e-14)
        np.testing.assert_allclose(signal.std(axis=0), 1)


def test_operating_points(rng):
    u, y = 1 + rng.standard_normal((50, 2)), rng.standard_normal((50, 1))
    zero = Scaling.from_data(u, y, "zero")
    np.testing.assert_array_equal(zero.u_offset, [0, 0])
    given = Scaling.from_data(u, y, ([1.0, 2.0], 3.0))
    np.testing.assert_array_equal(given.u_offset, [1, 2])
    np.testing.assert_array_equal(given.y_offset, [3])
    np.testing.assert_allclose(given.u_scale, u.std(axis=0))


@pytest.mark.parametrize(
    "bad",
    [([1.0, 2.0, 3.0], 0.0), (np.nan, 0.0), ("a", "b"), ([[1.0], [2.0, 3.0]], 0.0)],
)
def test_operating_point_of_wrong_size(rng, bad):
    u, y = rng.standard_normal((9, 2)), rng.standard_normal((9, 1))
    with pytest.raises(ValueError, match="one finite value per column of `u`"):
        Scaling.from_data(u, y, bad)


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_constant_input_is_refused(rng, offset):
    u = np.column_stack([rng.standard_normal(20), np.full(20, offset)])
    with pytest.raises(ValueError, match=r"constant column 1.*remove it"):
        Scaling.from_data(u, rng.standard_normal((20, 1)), "mean")


def test_constant_output_keeps_a_scale_of_one(rng):
    u = rng.standard_normal((20, 1))
    with pytest.warns(UserWarning, match="does not move in column 0"):
        scaling = Scaling.from_data(u, np.ones((20, 1)), "mean")
    np.testing.assert_array_equal(scaling.y_scale, [1])
    np.testing.assert_array_equal(scaling.y_offset, [1])
