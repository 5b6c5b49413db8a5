"""Shapes: what comes back is like what was given, and what is no record is refused."""

import numpy as np
import pandas as pd
import pytest
from scipy.sparse import csr_matrix

from alssnn import LinearStateSpace
from models import fit, fl_ssnn

N = 400


@pytest.fixture(scope="module")
def record():
    rng = np.random.default_rng(0)
    u, y = rng.standard_normal((N, 1)), np.zeros(N)
    for k in range(N - 1):
        y[k + 1] = 0.8 * y[k] + u[k, 0]
    return u, y + 0.01 * rng.standard_normal(N)


@pytest.fixture(scope="module")
def pair():
    """Return a model of two inputs, two outputs and two states."""
    return fit(fl_ssnn(nx=2, n_h=2, max_iter=2, tol=1e-1, random_state=0), 2, 2)


@pytest.fixture(scope="module")
def linear(record):
    return LinearStateSpace(nx=1).fit(*record)


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


def test_a_list_of_flat_inputs_is_one_input(record):
    u, y = record
    model = LinearStateSpace(nx=1).fit([u[:, 0], u[:, 0]], [y, y])
    np.testing.assert_array_equal(
        model.A_, LinearStateSpace(nx=1).fit([u, u], [y, y]).A_
    )
    assert [z.shape for z in model.predict([u[:, 0], u[:100, 0]])] == [(N,), (100,)]
    assert model.score([u[:, 0]], [y]) == model.score([u], [y])


# -- what is no record -----------------------------------------------------------------

WRONG = {
    "three dimensions": lambda z: np.reshape(z, (N, 1, 1)),
    "a number": lambda z: 3.0,
    "nothing": lambda z: None,
    "complex": lambda z: 1j * z,
    "text": lambda z: "abc",
    "texts": lambda z: np.full((N, 1), "a"),
    "objects": lambda z: np.array([[object()]] * N),
    "sparse": lambda z: csr_matrix(np.reshape(z, (N, 1))),
    "shorter": lambda z: z[:-3],
    "empty": lambda z: z[:0],
    "infinite": lambda z: np.where(
        np.arange(N).reshape(-1, *z.shape[1:]) == 3, np.inf, z
    ),
    "a dict": lambda z: {"a": 1},
    "ragged": lambda z: [[1, 2], [3]] * (N // 2),
    "dates": lambda z: np.full((N, 1), np.datetime64("2020-01-01")),
    "a generator": lambda z: (i for i in range(3)),
    "a list": lambda z: [np.zeros((5, 1, 1))],
    "across": lambda z: np.reshape(z, (1, N)),
}
CALLS = {
    "fit": lambda model, u, y: LinearStateSpace(nx=1).fit(u, y),
    "predict": lambda model, u, y: model.predict(u),
    **{
        name: lambda model, u, y, name=name: getattr(model, name)(u, y)
        for name in ("score", "simulate_test", "estimate_x0", "predict_ahead")
    },
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("name", ["u", "y"])
def test_wrong_data_are_named_in_few_words(record, linear, name, kind, call):
    if call == "predict" and (name == "y" or kind in ("shorter", "across")):
        pytest.skip("no wrong data of this call")
    data = dict(zip("uy", record, strict=True))
    data[name] = WRONG[kind](data[name])
    with pytest.raises((TypeError, ValueError), match=f"`{name}`") as caught:
        CALLS[call](linear, data["u"], data["y"])
    message = str(caught.value)
    assert len(message) < 300 and "\n" not in message
    assert "for X" not in message and "Input X" not in message


def test_lists_that_do_not_fit_are_named(record):
    u, y = record
    model = LinearStateSpace(nx=1)
    with pytest.raises(ValueError, match=r"`u\[1\]` and `y\[1\]` must have the same"):
        model.fit([u, u], [y, y[:-1]])
    with pytest.raises(ValueError, match="`y` must be a list of records"):
        model.fit([u, u], np.r_[y, y])


@pytest.mark.parametrize(
    ("verb", "args", "message"),
    [
        ("step", ([0, 0], [300.0]), r"`u` must have shape \(2,\) or \(N, 2\)"),
        ("step", (np.zeros(3), np.zeros(2)), "`x` must have shape"),
        ("jacobian", (np.zeros((4, 2)), np.zeros(2)), "`x` and `u` .* 4 and 1"),
        ("output", (np.zeros(3),), "`x` must have shape"),
        ("virtual", (np.zeros(2), 1.0), "`u` must have shape"),
        ("law", ([0.0], [0.0, 0.0]), "`v` must have shape"),
        ("law", ([0.0, 0.0], [0.0]), "`s` must have shape"),
        ("cancelled", ([0.0],), "`s` must have shape"),
    ],
)
def test_a_plant_refuses_what_numpy_would_broadcast(pair, verb, args, message):
    with pytest.raises(ValueError, match=message):
        getattr(pair.plant_, verb)(*args)


def test_a_plant_takes_lists(pair):
    plant = pair.plant_
    x, u = np.array([0.1, -0.2]), plant.u_offset + 0.3
    np.testing.assert_array_equal(plant.step(x.tolist(), u.tolist()), plant.step(x, u))
    rows = plant.step([x.tolist()] * 3, [u.tolist()] * 3)
    np.testing.assert_allclose(rows, [plant.step(x, u)] * 3, rtol=1e-12)
    y = plant.output(x.tolist())
    np.testing.assert_allclose(plant.law(u.tolist(), y.tolist()), plant.law(u, y))


def test_columns_of_two_levels_come_back(record):
    u, y = record
    levels = pd.MultiIndex.from_tuples([("tank", "level")])
    frame = pd.DataFrame(y[:, None], columns=levels)
    model = LinearStateSpace(nx=1).fit(u, frame)
    assert model.predict(u).columns.equals(levels)
