"""What comes back has the shape of what was given: y_hat - y is never an outer product."""

import numpy as np
import pandas as pd
import pytest

from alssnn import LinearStateSpace

N = 400


@pytest.fixture(scope="module")
def record():
    rng = np.random.default_rng(0)
    u, y = rng.standard_normal((N, 1)), np.zeros(N)
    for k in range(N - 1):
        y[k + 1] = 0.8 * y[k] + u[k, 0]
    return u, y + 0.01 * rng.standard_normal(N)


KINDS = {
    "flat": lambda y: y,
    "column": lambda y: y[:, None],
    "series": lambda y: pd.Series(y, name="speed"),
    "frame": lambda y: pd.DataFrame({"speed": y}),
    "list": lambda y: y.tolist(),
}


@pytest.mark.parametrize("fitted", KINDS)
@pytest.mark.parametrize("given", KINDS)
def test_outputs_have_the_shape_of_y(record, fitted, given):
    u, y = record
    model = LinearStateSpace(nx=1).fit(u, KINDS[fitted](y))
    data = KINDS[given](y)
    shape = np.shape(data)
    y_true, y_hat = model.simulate_test(u, data)
    assert y_true.shape == y_hat.shape == (N - 50, *shape[1:])
    assert model.predict_ahead(u, data, 3).shape == shape
    assert model.predict(u).shape == np.shape(KINDS[fitted](y))
    assert model.score(u, data) == pytest.approx(0.999, abs=1e-3)


def test_so_have_those_of_lists(record):
    u, y = record
    model = LinearStateSpace(nx=1).fit([u, u], [y, y])
    y_true, y_hat = model.simulate_test([u, u], [y, y])
    assert y_true.shape == y_hat.shape == (2 * (N - 50),)
    assert [z.shape for z in model.predict_ahead([u, u], [y, y])] == [(N,), (N,)]
    assert model.simulate_test([u], [y[:, None]])[1].shape == (N - 50, 1)
    assert model.score([u, u], [y, y]) > 0.99
