"""Inputs that are measured but not moved: models, laws, loops, certificates."""

from dataclasses import replace

import control
import numpy as np
import pytest

import alssnn
from alssnn.feedback import closed_loop, designed_loop, lqi
from alssnn.inputs import join_inputs, split_inputs
from alssnn.models import state_space
from alssnn.simulation import simulate

pytestmark = pytest.mark.filterwarnings(
    "ignore::sklearn.exceptions.ConvergenceWarning"  # short fits are enough
)


@pytest.fixture(scope="module")
def record():
    """Return a record of three inputs, the first and the last of which disturb."""
    rng = np.random.default_rng(0)
    n = 600
    d = np.repeat(rng.standard_normal((n // 20, 2)), 20, axis=0)
    u = np.repeat(rng.standard_normal((n // 5, 1)), 5, axis=0)
    x, y = 0.0, np.empty(n)
    for k in range(n):
        y[k] = 3.0 + x
        v = u[k, 0] + 0.3 * np.tanh(x + d[k, 1])
        x = 0.8 * x + 0.5 * v + 0.4 * d[k, 0]
    u = np.column_stack([5.0 + d[:, 0], 2.0 + u[:, 0], -1.0 + 2 * d[:, 1]])
    return u, y + 0.001 * rng.standard_normal(n)


MODELS = {
    "linear": lambda **o: alssnn.LinearStateSpace(nx=1, **o),
    "FL of y": lambda **o: alssnn.FlSsnn(
        nx=1, n_h=3, n_init=1, feedback="output", random_state=0, alpha=1e-5, **o
    ),
    "FL of x": lambda **o: alssnn.FlSsnn(
        nx=1, n_h=3, n_init=1, random_state=0, alpha=1e-5, **o
    ),
    "monotone": lambda **o: alssnn.FlSsnn(
        nx=1,
        n_h=3,
        n_init=1,
        random_state=0,
        input_map="monotone",
        alpha=1e-5,
        max_iter=60,
        **o,
    ),
    "AL": lambda **o: alssnn.AlSsnn(
        nx=1, n_h=3, n_g=2, n_init=1, random_state=0, alpha=1e-5, **o
    ),
    "AL with D and k": lambda **o: alssnn.AlSsnn(
        nx=1,
        n_h=3,
        n_g=2,
        n_k=2,
        feedthrough=True,
        n_init=1,
        random_state=0,
        alpha=1e-4,
        max_iter=60,
        **o,
    ),
    "GR": lambda **o: alssnn.GrSsnn(
        nx=1, n_f=3, n_init=1, random_state=0, alpha=1e-5, **o
    ),
}
WITH_LAW = [name for name in MODELS if name not in ("linear", "GR")]


@pytest.fixture(scope="module")
def models(record):
    """Return a function that fits a model once."""
    known = {}

    def fitted(name):
        if name not in known:
            known[name] = MODELS[name](disturbances=[0, 2]).fit(*record)
        return known[name]

    return fitted


def test_columns_are_split_and_joined():
    moved, given = split_inputs(4, (3, 1))
    np.testing.assert_array_equal(moved, [0, 2])
    np.testing.assert_array_equal(given, [1, 3])
    u = np.arange(8.0).reshape(2, 4)
    joined = join_inputs(u[:, moved], u[:, given], given)
    np.testing.assert_array_equal(joined, u)


@pytest.mark.parametrize("disturbances", [(4,), (-1,)])
def test_columns_that_do_not_exist_are_refused(disturbances):
    with pytest.raises(ValueError, match="columns of u, 0 to 3"):
        split_inputs(4, disturbances)


@pytest.mark.parametrize("input_map", ["identity", "monotone"])
@pytest.mark.parametrize("feedback", ["output", "state"])
def test_structure_is_the_equation(feedback, input_map):
    nu, given, moved = 3, [0], [1, 2]
    C = np.array([[1.0, 0.5], [0.2, 1.0]])
    structure = state_space(
        2,
        nu,
        2,
        n_h=3,
        n_g=2,
        C=C,
        feedback=feedback,
        input_map=input_map,
        disturbances=(0,),
    )
    rng = np.random.default_rng(0)
    theta = rng.standard_normal(structure.n_params)
    p = structure.split(theta)
    x, u = rng.standard_normal(2), rng.standard_normal(nu)
    m, d = u[moved], u[given]
    s, W_s = (C @ x, p["W_y"]) if feedback == "output" else (x, p["W_s"])
    bias = p["b_y"] if feedback == "output" else p["b_s"]
    v = p["W_h"] @ np.tanh(W_s @ s + p["W_d"] @ d + bias) + p["b_h"]
    if input_map == "identity":
        v = v + m
    else:
        w = np.tanh(p["U_phi"] @ m + p["V_phi"] @ s + p["V_phid"] @ d + p["b_phi"])
        v = v + (0.01 + p["r_phiu"] ** 2) * m + p["U_phi"].T @ (p["r_phi"] ** 2 * w)
    a, b = p["W_x"] @ x + p["W_u"] @ u + p["b_x"], p["b_x"]
    g = p["W_g"] @ (np.tanh(a) - np.tanh(b))
    expected = p["A"] @ x + p["B"] @ v + p["G"] @ d + g
    X = simulate(structure.observe("y").lure(theta), u[None], x)
    np.testing.assert_allclose(X[1], expected, rtol=1e-13)


@pytest.mark.parametrize("name", MODELS)
def test_shapes_and_fit(models, record, name):
    model, (u, y) = models(name), record
    assert model.B_.shape == model.D_.T.shape == (1, 1)
    assert model.G_.shape == model.H_.shape == (1, 2)
    np.testing.assert_array_equal(model.disturbances_, [0, 2])
    assert model.score(u, y) > (0.9 if name == "linear" else 0.99)
    if name != "linear":  # the second disturbance acts through h alone
        assert abs(model.G_[0, 0] / model.B_[0, 0] - 0.8) < 0.1
    sys = model.to_statespace()
    assert (sys.ninputs, sys.input_labels) == (1, ["u[1]"])
    whole = model.to_statespace(disturbances=True)
    assert whole.input_labels == ["u[1]", "u[0]", "u[2]"]
    np.testing.assert_allclose(whole.B, np.hstack([model.B_, model.G_]))


@pytest.mark.parametrize("name", MODELS)
def test_parts_add_up(models, record, name):
    plant, u = models(name).plant_, record[0][:50]
    x = np.random.default_rng(0).standard_normal((50, plant.nx))
    (A, B, C, D), (G, H) = plant.linear(), plant.disturbed_by()
    dv = plant.virtual(x, u) - plant.v_offset
    dd = u[:, list(plant.given)] - plant.d_offset
    rest = alssnn.simulation.channels(plant.observed, x, u - plant.u_offset)
    omega, eta = np.split(rest[:, plant.ny + plant.nv :], [plant.nx], axis=1)
    np.testing.assert_allclose(
        plant.step(x, u), x @ A.T + dv @ B.T + dd @ G.T + omega, atol=1e-12
    )
    np.testing.assert_allclose(
        plant.output(x, u) - plant.y_offset,
        x @ C.T + dv @ D.T + dd @ H.T + eta,
        atol=1e-12,
    )


@pytest.mark.parametrize("name", WITH_LAW)
def test_law_feeds_disturbances_forward(models, record, name):
    model, u = models(name), record[0]
    law, plant = model.linearizing_law(), model.plant_
    x = np.random.default_rng(0).standard_normal((50, plant.nx))
    s = x if law.feedback == "state" else plant.output(x, u[:50])
    v, d = plant.virtual(x, u[:50]), u[:50, [0, 2]]
    np.testing.assert_allclose(law(v, s, d), u[:50, [1]], atol=1e-10)
    np.testing.assert_allclose(law.h(s, u[:50, [1]], d), v - u[:50, [1]], atol=1e-12)
    np.testing.assert_allclose(law(v[0], s[0], d[0]), u[0, [1]], atol=1e-10)
    at_rest = law(v, s, np.tile(plant.d_offset, (50, 1)))
    assert np.abs(at_rest - u[:50, [1]]).max() > 0.01  # what it would miss
    with pytest.raises(ValueError, match=r"`d` must have the 2 measured"):
        law(v, s)
    with pytest.raises(ValueError, match=r"`d` must have shape \(2,\)"):
        law(v, s, d[:, :1])


@pytest.mark.parametrize("name", ["linear", *WITH_LAW])
def test_loop_is_the_design_with_given_disturbances(models, record, name):
    """Without g, y in the loop is the response of the design to r and d, to digits."""
    model, u = models(name), record[0]
    plant = model.plant_
    gain = lqi(model, np.eye(2), np.eye(1))
    loop = closed_loop(model, model, gain)
    assert loop.input_labels == ["r[0]", "u[0]", "u[2]"]
    assert loop.output_labels == ["y[0]", "u[1]", "v[0]"]
    n = 80
    d = u[:n, [0, 2]].T
    r = np.full((1, n), plant.y_offset[0] + 0.5)
    t = model.dt * np.arange(n)
    response = control.input_output_response(loop, t, np.vstack([r, d])).outputs
    design = designed_loop(model, gain)
    assert design.input_labels == ["r[0]", "u[0]", "u[2]"]
    deviations = np.vstack([r - plant.y_offset[0], d - plant.d_offset[:, None]])
    linear = control.forced_response(design, t, deviations).outputs
    off = response[0] - plant.y_offset[0] - linear[0]
    if name.startswith("AL"):
        assert np.abs(off).max() < 0.5
    else:
        np.testing.assert_allclose(off, 0.0, atol=1e-9)
    # what the loop says of u is what makes its v
    x0 = np.zeros((1, plant.nx))
    if name != "AL with D and k":
        first = plant.every_input(response[1][:1], d[:, 0])
        np.testing.assert_allclose(plant.virtual(x0, first[None]), response[2][0])


def test_observer_takes_the_inputs_of_the_record(models, record):
    model, (u, y) = models("FL of x"), record
    X = model.observer().filter(u, y)
    y_hat = model.plant_.output(X)
    assert np.std(y_hat[50:, 0] - y[50:]) < 0.02
    gain = lqi(model, np.eye(2), np.eye(1))
    loop = closed_loop(model, model, gain, observer=model.observer())
    n = 100
    d = u[:n, [0, 2]].T
    r = np.full((1, n), model.y_offset_[0])
    inputs = np.vstack([r, d])
    own = control.input_output_response(loop, np.arange(n), inputs).outputs
    true = closed_loop(model, model, gain)
    known = control.input_output_response(true, np.arange(n), inputs).outputs
    np.testing.assert_allclose(own, known, atol=1e-8)


@pytest.mark.parametrize("name", WITH_LAW)
def test_linearizability_takes_disturbances_as_given(models, record, name):
    figures = models(name).linearizability(*record)
    table = str(figures).splitlines()
    (mean,) = [line for line in table if line.startswith("|g| / |Ax+Bu+Gd|  mean ")]
    assert "|Ax+Bu| " not in str(figures)  # G d counts, and its label says so
    assert table[table.index(mean) + 1].index("max") == mean.index("mean")
    if name.startswith("FL") or name == "monotone":
        assert np.max(figures.linearization_error) < 1e-9
        assert np.max(figures.closed_linearization_error) < 1e-9
    else:
        assert 0 < np.max(figures.closed_linearization_error) < 0.5


@pytest.mark.parametrize("name", ["FL of x", "monotone", "AL"])
def test_certificates_hold_for_given_disturbances(models, record, name):
    """The bound on y - y_lin is met along records; d is the same in both."""
    model = models(name)
    certificate = model.iss_certificate(*record)
    assert certificate.holds
    figures = model.linearizability(*record)
    assert np.abs(figures.e).max() <= np.max(certificate.output_bound) + 1e-9


def test_gain_certificate_is_that_of_the_inputs_that_are_moved(models):
    certificate = models("FL of x").gain_certificate()
    model = models("FL of x")
    response = model.to_statespace()(np.exp(1j * np.linspace(0, np.pi, 500)))
    expected = np.abs(response).max()
    assert expected <= certificate.gamma <= 1.05 * expected


@pytest.mark.parametrize("name", ["linear", "monotone", "AL with D and k"])
def test_models_are_saved(models, record, name, tmp_path):
    model, u = models(name), record[0]
    model.save(tmp_path / "model")
    again = alssnn.load(tmp_path / "model")
    np.testing.assert_array_equal(again.predict(u), model.predict(u))
    np.testing.assert_array_equal(again.disturbances_, [0, 2])
    np.testing.assert_array_equal(again.G_, model.G_)
    assert again.plant_.given == model.plant_.given


def test_disturbances_go_by_name(record):
    pd = pytest.importorskip("pandas")
    u = pd.DataFrame(record[0], columns=["flow", "valve", "load"])
    model = alssnn.LinearStateSpace(nx=1, disturbances=["flow", "load"])
    model.fit(u, record[1])
    by_number = alssnn.LinearStateSpace(nx=1, disturbances=[0, 2]).fit(*record)
    np.testing.assert_allclose(model.G_, by_number.G_, rtol=1e-9)
    assert model.to_statespace().input_labels == ["valve"]
    loop = closed_loop(model, model, lqi(model, np.eye(2), np.eye(1)))
    assert loop.input_labels == ["r[0]", "flow", "load"]
    with pytest.raises(ValueError, match=r"`disturbances` must hold .* got 'wind'"):
        alssnn.LinearStateSpace(nx=1, disturbances=["wind"]).fit(u, record[1])


@pytest.mark.parametrize(
    ("disturbances", "words"),
    [
        ([0, 1, 2], "leave a column of u that a controller can move"),
        ([3], "numbers of the inputs, 0 to 2"),
        (["u"], "Names need data frames"),
        (range(10**18), "got more than 10000 of them"),
    ],
)
def test_wrong_disturbances_are_refused(record, disturbances, words):
    with pytest.raises(ValueError, match=words):
        alssnn.LinearStateSpace(nx=1, disturbances=disturbances).fit(*record)


def test_a_constant_disturbance_is_refused(record):
    u = record[0].copy()
    u[:, 2] = 7.0
    with pytest.raises(ValueError, match="constant column 2"):
        alssnn.FlSsnn(nx=1, disturbances=[2]).fit(u, record[1])


def test_start_and_bounds_know_disturbances(models, record):
    linear = models("linear")
    again = alssnn.LinearStateSpace(
        linear_start=linear, disturbances=[0, 2], max_iter=1, integrators=0
    ).fit(*record)
    np.testing.assert_allclose(again.G_, linear.G_, rtol=1e-3)
    held = alssnn.LinearStateSpace(
        linear_start=linear, disturbances=[0, 2], bounds={"G": (0.0, 0.01)}
    ).fit(*record)
    assert held.G_.min() >= 0
    assert held.G_.max() <= 0.01
    # the same system, whoever moves its inputs
    moved = alssnn.LinearStateSpace(linear_start=linear, integrators=0, max_iter=1)
    moved.fit(*record)
    np.testing.assert_allclose(moved.B_[:, [1]], linear.B_, rtol=1e-3)


def test_warm_start_asks_for_the_same_disturbances(record):
    model = alssnn.FlSsnn(
        nx=1,
        n_h=2,
        n_init=1,
        random_state=0,
        alpha=1e-4,
        max_iter=5,
        warm_start=True,
        disturbances=[0],
    )
    model.fit(*record)
    model.set_params(disturbances=[2]).fit(*record)
    np.testing.assert_array_equal(model.disturbances_, [2])
    assert model.G_.shape == (1, 1)


def test_h_may_leave_a_disturbance_out(record):
    model = MODELS["FL of x"](disturbances=[0, 2], h_inputs={"x": "all", "d": [1]})
    model.fit(*record)
    np.testing.assert_array_equal(model.params_["W_d"][:, 0], 0.0)
    assert np.abs(model.params_["W_d"][:, 1]).max() > 0


def test_late_inputs_leave_no_law_but_a_loop_of_the_linear_model(record):
    u, y = record
    late = np.roll(u, -2, axis=0)[:-2]
    model = alssnn.LinearStateSpace(
        nx=1, disturbances=[0, 2], input_delay=[2, 2, 2]
    ).fit(late, y[:-2])
    plant = model.plant_.late()
    assert plant.nx == 7
    assert plant.nv == 1
    gain = lqi(model, np.eye(8), np.eye(1))
    loop = closed_loop(model, model, gain)
    assert loop.ninputs == 3


def test_a_law_needs_no_late_disturbance_that_h_does_not_see(record):
    u, y = record
    options = {"disturbances": [0, 2], "input_delay": [2, 0, 0]}
    model = MODELS["FL of x"](**options).fit(u, y)
    reason = model.plant_.no_law
    assert "measured disturbance of 2 samples ago" in reason
    sees = MODELS["FL of x"](h_inputs={"x": "all", "d": [1]}, **options).fit(u, y)
    assert sees.plant_.no_law == ""
    plant = sees.plant_.late()
    law = sees.linearizing_law()
    x = np.random.default_rng(0).standard_normal((20, plant.nx))
    v = plant.virtual(x, u[:20])
    np.testing.assert_allclose(law(v, x[:, :1], u[:20, [0, 2]]), u[:20, [1]])


def test_a_part_of_another_model_is_refused(models, record):
    model = models("FL of x")
    other = MODELS["FL of x"](disturbances=[0]).fit(*record)
    K = lqi(model, np.eye(2), np.eye(1))
    with pytest.raises(ValueError, match="`observer` must have the measured"):
        closed_loop(model, model, K, observer=other.observer())
    with pytest.raises(ValueError, match="`law` must have the measured"):
        closed_loop(model, model, K, law=other.linearizing_law())
    with pytest.raises(ValueError, match="`observer` must have the measured"):
        model.mpc(observer=alssnn.feedback.DisturbanceObserver(other))


def test_a_structure_that_moves_disturbances_is_refused(record):
    class Own(alssnn.GrSsnn):
        def _declare(self, nx, nu, ny, *, C, **networks):
            return state_space(nx, nu, ny, C=C, **networks)

    with pytest.raises(ValueError, match="known to the structure that `_declare`"):
        Own(nx=1, n_f=2, disturbances=[0], alpha=1e-3).fit(*record)


def test_names_of_disturbances_may_be_those_of_the_loop(record):
    pd = pytest.importorskip("pandas")
    u = pd.DataFrame(record[0], columns=["r[0]", "valve", "v[0]"])
    model = alssnn.LinearStateSpace(nx=1, disturbances=["r[0]", "v[0]"])
    model.fit(u, record[1])
    loop = closed_loop(model, model, lqi(model, np.eye(2), np.eye(1)))
    assert len(set(loop.input_labels)) == 3
    rest = np.concatenate([model.y_offset_, model.plant_.d_offset])[:, None]
    y = control.input_output_response(loop, np.arange(5), np.tile(rest, 5)).outputs[0]
    np.testing.assert_allclose(y, model.y_offset_[0])
    assert len(set(model.linearizing_law().to_nlsys().input_labels)) == 4


def test_carried_knows_what_disturbances_do_to_the_output(record):
    """On its own output a model without g is in the loop what was designed."""
    u, y = record
    y = y + 0.8 * (u[:, 0] - u[:, 0].mean())
    model = alssnn.AlSsnn(
        nx=1,
        n_h=3,
        n_g=0,
        n_init=1,
        feedback="output",
        feedthrough=True,
        bounds={"D": (0.0, 0.0)},
        random_state=0,
        alpha=1e-5,
        disturbances=[0, 2],
    ).fit(u, y)
    assert abs(model.H_[0, 0] - 0.8) < 0.05
    assert model.plant_.no_law == ""
    own = model.predict(u)
    found = model.linearizability(u, own)
    assert found.carried_model.max() < 1e-4


class OwnSsnn(alssnn.GrSsnn):
    """A model that declares its own structure and knows disturbances."""

    def _declare(self, nx, nu, ny, *, C, **_):
        given = self.disturbances_
        structure = state_space(nx, nu, ny, C=C, n_g=2, disturbances=given)
        return replace(structure, options={"disturbances": tuple(map(int, given))})


def test_a_declared_structure_with_disturbances_is_saved(record, tmp_path):
    model = OwnSsnn(nx=1, n_f=2, alpha=1e-3, max_iter=3, disturbances=[0, 2])
    model.fit(*record)
    model.save(tmp_path / "own")
    again = alssnn.load(tmp_path / "own", classes=[OwnSsnn])
    np.testing.assert_array_equal(again.predict(record[0]), model.predict(record[0]))
    np.testing.assert_array_equal(again.disturbances_, [0, 2])
