"""Poles held at one: integrators that are declared or found."""

import warnings

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn import LinearStateSpace, search
from alssnn.criterion import Criterion
from alssnn.estimators import _integrators, _safe
from alssnn.feedback import designed_loop, lqr
from alssnn.integrators import count_integrators, decouple, integrator_entries
from alssnn.limits import Limits
from alssnn.linear_model import LinearModel, simulation_error
from alssnn.metrics import rmse
from alssnn.models import state_space
from alssnn.stability import Contractive, contractive_basis
from alssnn.subspace import identify_linear
from benchmarks.field.independent import INDEPENDENT
from helpers import assert_jacobian, dense_residuals
from models import al_ssnn, fl_ssnn, gr_ssnn

DT = 0.02


def references(rng, N, hold):
    return np.repeat(rng.uniform(-1, 1, N // hold + 1), hold)[:N]


def servo(N, seed=0, noise=1e-3, offset=0.0):
    """Return voltage and angle of a motor with friction behind a controller.

    The states are rate and angle; `offset` is a voltage that the sensor of u adds.
    """
    rng = np.random.default_rng(seed)
    r = 2 * references(rng, N, 60)
    u, y, x = np.empty((N, 1)), np.empty(N), np.zeros(2)
    for k in range(N):
        y[k] = x[1] + noise * rng.standard_normal()
        u[k] = np.clip(
            8 * (r[k] - y[k]) - 0.4 * x[0] + 0.3 * rng.standard_normal(), -4, 4
        )
        for _ in range(4):
            friction = 0.5 * np.tanh(5 * x[0])
            x = x + DT / 4 * np.array([u[k, 0] - 0.8 * x[0] - friction, x[0]])
    return u + offset, y


def integrating(N, seed=0, noise=0.01, offset=0.0):
    """Return a record of a linear servo, weakly regulated."""
    rng = np.random.default_rng(seed)
    r = 3 * references(rng, N, 80)
    u, y, x = np.empty((N, 1)), np.empty(N), np.zeros(2)
    for k in range(N):
        y[k] = x[1] + noise * rng.standard_normal()
        u[k] = np.clip(0.5 * (r[k] - y[k]), -1, 1) + 0.1 * rng.standard_normal()
        x = np.array([0.9 * x[0] + 0.1 * u[k, 0], x[1] + 0.1 * x[0]])
    return u + offset, y


def slow(N, seed, noise=0.02):
    """Return a record of a stable plant with a time constant of a fifth of it."""
    rng = np.random.default_rng(seed)
    a, f, strength = np.exp(-5 / N), rng.uniform(0.5, 0.95), rng.uniform(0, 0.5)
    u = references(rng, N, int(rng.integers(5, 80)))[:, None]
    y, x = np.empty(N), np.zeros(2)
    for k in range(N):
        y[k] = x[0]
        drive = u[k, 0] + strength * np.tanh(2 * u[k, 0])
        x = np.array([a * x[0] + 10 * (1 - a) * x[1], f * x[1] + (1 - f) * drive])
    return u, y + noise * y.std() * rng.standard_normal(N)


def scaled(u, y):
    return [((u - u.mean(0)) / u.std(0), ((y - y.mean()) / y.std())[:, None])]


def cubic(N, integrates, seed=0):
    """Return a record of a plant with a cubic actuator, or of its integral."""
    rng = np.random.default_rng(seed)
    u, y, x = 2 * references(rng, N, 10), np.empty(N), np.zeros(2)
    for k in range(N):
        y[k] = x[int(integrates)] + 0.01 * rng.standard_normal()
        x = np.array([0.7 * x[0] + 0.3 * u[k] ** 3, x[1] + 0.2 * x[0]])
    return u[:, None], y


def fit(model, *data, **changes):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return clone(model).set_params(**changes).fit(*data)


MODELS = {
    "linear": LinearStateSpace(nx=2, dt=DT),
    "fl": fl_ssnn(nx=2, n_h=5, feedback="state", gamma_h=1e-4, random_state=0, dt=DT),
    "al": al_ssnn(nx=2, n_h=4, n_g=3, feedback="state", random_state=0, dt=DT),
    "gr": gr_ssnn(nx=2, n_f=5, n_k=2, random_state=0, dt=DT),
}
QUICK = {"max_iter": 15, "tol": 1e-3}


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("stability", [None, "contractive"])
def test_the_pole_is_exactly_one_and_nothing_sees_its_state(name, stability):
    changes = {"integrators": 1, **QUICK}
    if stability:
        if name != "al":
            pytest.skip("no such option")
        changes["stability"] = stability
    model = fit(MODELS[name], *servo(800), **changes)
    assert model.integrators_ == 1
    np.testing.assert_array_equal(model.A_[:, 1], [0, 1])
    np.testing.assert_array_equal(model.A_[1], [0, 1])
    assert abs(model.A_[0, 0]) < 1
    p = model.params_
    for W in ("W_s", "W_x", "W_kx"):
        if W in p:
            assert not p[W][:, 1].any()
            assert p[W][:, 0].all()
    if stability:
        assert np.linalg.norm(model.A_[:1, :1], 2) ** 2 < 1 - model.phi


@pytest.mark.parametrize("name", MODELS)
def test_a_shift_of_the_integrator_shifts_the_output(name):
    u, y = servo(800)
    model = fit(MODELS[name], u, y, integrators=1, **QUICK)
    x0 = model.x0_[0]
    shifted = model.predict(u, x0=x0 + np.array([0, 30.0]))
    expected = model.predict(u, x0=x0) + 30.0 * model.C_[0, 1]
    np.testing.assert_allclose(shifted, expected, rtol=0, atol=1e-9)


def test_a_servo_is_recovered_and_does_not_depend_on_where_it_stands():
    model = fit(MODELS["al"], *servo(2000), integrators=1, max_iter=60, tol=1e-5)
    u, y = servo(1500, seed=1, noise=0.0)
    y_true, y_hat = model.simulate_test(u, y)
    error = np.sqrt(np.mean((y_true - y_hat) ** 2)) / y.std()
    assert error < 0.02  # 0.6 %; 6.7 % with integrators=0
    # far away of everything that was seen: 1900 % with integrators=0
    _, far = model.simulate_test(u, y + 40.0)
    np.testing.assert_allclose(far - 40.0, y_hat, atol=0.01 * y.std())


def test_the_operating_point_is_where_the_integrator_rests():
    u, y = integrating(1500, offset=0.7)
    model = fit(MODELS["linear"], u, y, integrators=1)
    assert abs(np.mean(u) - 0.7) > 0.005  # the record does not end where it began
    assert model.u_offset_[0] == pytest.approx(0.7, abs=0.001)
    np.testing.assert_array_equal(model.y_offset_, [np.mean(y)])
    assert model.score(*integrating(1500, seed=1, offset=0.7)) > 0.99
    given = fit(MODELS["linear"], u, y, integrators=1, operating_point=([0.6], [0.0]))
    assert given.u_offset_ == [0.6]


def test_the_linear_model_is_that_of_the_plant():
    model = fit(MODELS["linear"], *integrating(1500, noise=1e-4), integrators=1)
    assert model.A_[0, 0] == pytest.approx(0.9, abs=1e-3)
    # y grows by 0.1 u per sample in the end: 0.1 * 0.1 / (1 - 0.9)
    assert model.C_[0, 1] * model.B_[1, 0] == pytest.approx(0.1, rel=1e-3)


def test_a_linear_model_that_integrates_is_valid():
    model = fit(MODELS["linear"], *integrating(1500), integrators=1)
    found = model.validate(*integrating(1500, seed=1))
    assert found.passed and found["linearizability"].passed
    assert "the loop of a first controller" in found["linearizability"].sentence
    # by a law that does not know the plant
    curved = fit(MODELS["linear"], *servo(1500), integrators=1)
    check = curved.validate(*servo(1500, seed=1))["linearizability"]
    assert not check.passed and "not accurate enough for a loop" in check.sentence


def test_a_pure_integrator():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((500, 1))
    y = np.r_[0.0, np.cumsum(0.3 * (u[:-1, 0] - 0.2))]
    for name in ("linear", "al", "fl"):
        model = fit(MODELS[name], u, y, nx=1, integrators=1, **QUICK)
        np.testing.assert_array_equal(model.A_, [[1.0]])
        assert model.u_offset_[0] == pytest.approx(0.2, abs=1e-2)
    contractive = fit(MODELS["al"], u, y, nx=1, integrators=1, stability="contractive")
    np.testing.assert_array_equal(contractive.A_, [[1.0]])


def test_two_axes_have_two_integrators():
    (u1, y1), (u2, y2) = (integrating(1200, seed=seed) for seed in (0, 1))
    u, y = np.hstack([u1, u2]), np.column_stack([y1, y2])
    model = fit(LinearStateSpace(nx=4, integrators=2), u, y)
    np.testing.assert_array_equal(model.A_[:, 2:], np.eye(4)[:, 2:])
    assert model.score(u, y) > 0.99
    assert fit(LinearStateSpace(nx=4, integrators="auto"), u, y).integrators_ == 2
    twice = np.column_stack([y1, 3 * y1])  # one integrator in two outputs
    auto = LinearStateSpace(nx=2, integrators="auto")
    assert fit(auto, u1, twice).integrators_ == 1


def test_several_experiments_and_missing_outputs():
    parts = [integrating(n, seed=i) for i, n in enumerate((700, 500))]
    us, ys = [u for u, _ in parts], [y.copy() for _, y in parts]
    ys[0][100:140] = np.nan
    model = fit(MODELS["linear"], us, ys, integrators=1)
    assert model.x0_.shape == (2, 2)
    assert model.score(*integrating(600, seed=5)) > 0.98


# -- a linear start of the user ------------------------------------------------------

MOTOR = (
    np.array([[0.97, 0.0], [DT, 1.0]]),
    np.array([[DT], [DT**2 / 2]]),
    np.array([[0.0, 1.0]]),
)


@pytest.mark.parametrize("name", MODELS)
def test_a_linear_start_keeps_its_states(name):
    changes = {"integrators": 1, "linear_start": MOTOR, **QUICK}
    model = fit(MODELS[name], *servo(800), **changes)
    # held as it was given, or else the basis would drift; up to units and back
    np.testing.assert_allclose(model.A_[1], [DT, 1], rtol=1e-12)
    np.testing.assert_array_equal(model.A_[:, 1], [0, 1])
    assert model.A_[0, 0] != 0.97
    free = model.fitted_.free[:4]
    np.testing.assert_array_equal(free, [True, False, False, False])


def test_a_contraction_decouples_a_linear_start():
    changes = {"integrators": 1, "linear_start": MOTOR, "stability": "contractive"}
    model = fit(MODELS["al"], *servo(800), **changes, **QUICK)
    np.testing.assert_array_equal(model.A_[1], [0, 1])


def test_decoupling_is_a_change_of_basis(rng):
    A = np.block([[0.3 * rng.standard_normal((2, 2)), np.zeros((2, 2))],
                  [rng.standard_normal((2, 2)), np.eye(2)]])  # fmt: skip
    B, C = rng.standard_normal((4, 1)), rng.standard_normal((2, 4))
    model = LinearModel(A, B, C, np.zeros((2, 1)), rng.standard_normal((1, 4)))
    other = decouple(model, 2)
    assert not other.A[2:, :2].any()
    for k in range(5):
        power, same = np.linalg.matrix_power(A, k), np.linalg.matrix_power(other.A, k)
        np.testing.assert_allclose(C @ power @ B, other.C @ same @ other.B)
        np.testing.assert_allclose(
            C @ power @ model.x0[0], other.C @ same @ other.x0[0]
        )


# -- refusals ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "changes", "message"),
    [
        ("linear", {"integrators": 2}, "`integrators` must be at most .* outputs"),
        ("linear", {"integrators": -1}, "integrators"),
        ("linear", {"integrators": "all"}, "integrators"),
        ("fl", {"integrators": 1, "feedback": "output"}, "`h_inputs` must say"),
        (
            "al",
            {"integrators": 1, "linear_start": MOTOR, "g_inputs": {"x": [1]}},
            "`g_inputs` must hold numbers of the states, 0 to 0, got 1",
        ),
        (
            "linear",
            {"integrators": 1, "linear_start": (MOTOR[0].T, *MOTOR[1:])},
            "`linear_start` must have its 1 integrators last",
        ),
        (
            "linear",
            {"integrators": 1, "linear_start": MOTOR, "bounds": {"A": (0, 0.9)}},
            "`bounds` of A must allow",
        ),
    ],
)
def test_contradictions_are_refused(model, changes, message):
    with pytest.raises(ValueError, match=message):
        fit(MODELS[model], *servo(300), **changes, **QUICK)


def test_bounds_of_the_rest_are_kept():
    bounds = {"A": ([[0.9, -np.inf], [-np.inf] * 2], [[0.95, np.inf], [np.inf] * 2])}
    changes = {"integrators": 1, "linear_start": MOTOR, "bounds": bounds}
    model = fit(MODELS["linear"], *servo(400), **changes)
    assert 0.9 <= model.A_[0, 0] <= 0.95
    np.testing.assert_array_equal(model.A_[:, 1], [0, 1])


# -- found ---------------------------------------------------------------------------


def counted(u, y, nx=2):
    experiments = scaled(u, y)
    return count_integrators(experiments, identify_linear(experiments, nx))


# 20 of 20 integrating records and 0 of 20 slow ones at N = 2000, nx = 2, 3 and 5
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("nx", [2, 4])
def test_integrators_are_found_and_slow_plants_are_none(seed, nx):
    assert counted(*integrating(1500, seed), nx) == 1
    assert counted(*slow(1500, seed), nx) == 0


@pytest.mark.slow
def test_eight_records_of_each_kind():
    assert sum(counted(*integrating(1000, seed)) for seed in range(8)) == 8
    assert sum(counted(*servo(1000, seed)) for seed in range(8)) >= 7
    assert sum(counted(*slow(1000, seed)) for seed in range(8)) == 0


def test_auto_says_what_it_found():
    auto = fit(MODELS["linear"], *integrating(1200), integrators="auto")
    assert auto.integrators_ == 1
    assert auto.message_.endswith("the record shows an integrator, its pole held at 1")
    times = {"integrators": "auto", "time": "continuous", "dt": 0.1}
    rate = fit(MODELS["linear"], *integrating(1200), **times)
    assert rate.message_.endswith("the record shows an integrator, its pole held at 0")
    assert np.abs(np.linalg.eigvals(rate.A_)).min() == 0
    u, y = slow(1200, 0)
    auto, plain = (fit(MODELS["linear"], u, y, integrators=n) for n in ("auto", 0))
    assert auto.integrators_ == 0
    np.testing.assert_array_equal(auto.A_, plain.A_)  # found on the way, used as it is
    np.testing.assert_array_equal(auto.u_offset_, plain.u_offset_)


# -- what follows a fit --------------------------------------------------------------


def caster(N, seed):
    """Return a record of a level, whose valve is late and bent, behind a controller."""
    rng = np.random.default_rng(seed)
    r, demand = 0.5 * references(rng, N, 40), 0.5 + 0.2 * references(rng, N, 25)
    u, y, x = np.empty((N, 2)), np.empty(N), np.array([0.5, 0.0])
    for k in range(N):
        y[k] = x[1] + 0.01 * rng.standard_normal()
        u[k] = 0.5 + 0.4 * (r[k] - y[k]) + 0.1 * rng.standard_normal(), demand[k]
        flow = 1.4 * x[0] ** 3 / (0.4 + abs(x[0]) ** 3)
        x = np.array([0.5 * x[0] + 0.5 * u[k, 0], x[1] + 0.3 * (flow - u[k, 1])])
    return u, y


@pytest.mark.parametrize(("nx", "orders"), [("auto", [1, 2, 3]), ([2, 4], [2, 4])])
def test_networks_of_an_integrating_plant_choose_their_order(nx, orders):
    runs = [caster(300, seed) for seed in range(3)]
    options = {"n_init": 1, "max_iter": 100, "integrators": 1, "random_state": 0}
    model = alssnn.GrSsnn(nx=nx, **options).fit(*map(list, zip(*runs, strict=True)))
    assert list(model.orders_["networks"])[: len(orders)] == orders
    assert set(model.orders_["linear"]) >= set(orders)
    assert model.integrators_ == 1
    np.testing.assert_array_equal(model.A_[-1], np.eye(model.nx_)[-1])
    u, y = caster(300, seed=9)
    linear = LinearStateSpace(nx=nx, integrators=1)
    linear.fit(*map(list, zip(*runs, strict=True)))
    assert 1 - model.score(u, y) < 0.2 * (1 - linear.score(u, y))


def test_quarters_of_a_short_record_do_not_choose_the_order():
    """Linear models fitted to what they leave began elsewhere: 3 states, error 1.1."""
    data = INDEPENDENT["mould"].load()
    records = [list(signals) for signals in zip(*data.train, strict=True)]
    model = alssnn.GrSsnn(n_init=1, max_iter=100, random_state=0).fit(*records)
    linear = LinearStateSpace().fit(*records)
    assert model.integrators_ == 1
    errors = [rmse(*m.simulate_test(*data.tests["fresh"][0])) for m in (model, linear)]
    assert errors[0] < 0.3 * errors[1]


@pytest.mark.parametrize("integrators", [1, 0])
@pytest.mark.parametrize(
    ("module", "name", "value", "says"),
    [
        (search, "certainty", lambda pairs: 1.5, "do not simulate hidden samples"),
        (_safe, "WHOLE", 1e-9, "an error above 40 % of y, as the plant integrates"),
    ],
)
def test_networks_of_a_plant_that_integrates_have_to_be_surer(
    monkeypatch, integrators, module, name, value, says
):
    u, y = cubic(400, integrators)
    monkeypatch.setattr(module, name, value)
    options = {"n_init": 1, "max_iter": 60, "random_state": 0}
    model = alssnn.GrSsnn(2, integrators=integrators, **options)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(u, y)
    assert any(says in str(w.message) for w in caught) == bool(integrators)
    assert (model.alpha_ == np.inf) == bool(integrators)


def test_a_short_record_of_an_integrating_plant_has_fewer_orders():
    u, y = integrating(9)
    model = alssnn.FlSsnn(integrators=1, n_h=1, n_init=1, max_iter=15, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(u, y)
    assert set(model.orders_["linear"]) == {1, 2}


@pytest.mark.parametrize(("ratio", "n"), [(1.015, 1), (1.025, 0)])
def test_a_slightly_better_fit_of_free_poles_is_no_reason(monkeypatch, ratio, n):
    """They follow the record, and no other one."""
    real = _integrators.identify_integrating

    def worse(near, model, *args, **options):
        found = real(near, model, *args, **options)
        found.model.result.cost = (ratio * simulation_error(near, model)) ** 2
        return found

    monkeypatch.setattr(_integrators, "identify_integrating", worse)
    model = fit(MODELS["linear"], *integrating(600), integrators="auto")
    assert model.integrators_ == n


def test_the_pole_is_certain():
    u, y = integrating(800)
    model = fit(MODELS["linear"], u, y, integrators=1)
    regions = model.parameter_covariance(u, y).poles()
    at_one = regions.poles == 1
    assert at_one.sum() == 1
    assert not regions.covariance[at_one].any()
    assert regions.modulus_std[~at_one] > 0


def test_a_warm_start_goes_on_and_another_number_begins_again():
    u, y = servo(600)
    model = clone(MODELS["fl"]).set_params(integrators=1, warm_start=True, **QUICK)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        cost = model.fit(u, y).cost_
        offset = model.u_offset_
        model.fit(u, y)
        assert model.cost_ < 1.2 * cost  # initial states are estimated anew
        np.testing.assert_array_equal(model.u_offset_, offset)
        assert not any(step.label.startswith("linear") for step in model.history_)
        model.set_params(integrators=0).fit(u, y)
    assert model.integrators_ == 0
    np.testing.assert_array_equal(model.u_offset_, u.mean(axis=0))


@pytest.mark.parametrize("name", MODELS)
def test_files_keep_integrators(name, tmp_path):
    u, y = servo(400)
    model = fit(MODELS[name], u, y, integrators="auto", **QUICK)
    model.save(tmp_path / "model.npz")
    loaded = alssnn.load(tmp_path / "model.npz")
    assert loaded.integrators_ == model.integrators_
    assert loaded.integrators == "auto"
    np.testing.assert_array_equal(loaded.predict(u), model.predict(u))


def test_validation_and_coarse_stages_know_the_operating_point():
    u, y = servo(900, offset=0.5)
    changes = {"coarse_samples": 300, "validation_fraction": 0.2, "integrators": 1}
    model = fit(MODELS["al"], u, y, **changes, **QUICK)
    assert model.u_offset_[0] == pytest.approx(0.5, abs=0.1)
    np.testing.assert_array_equal(model.A_[:, 1], [0, 1])


@pytest.mark.filterwarnings("ignore::DeprecationWarning:distributed")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_integrators_of_experiments_on_a_cluster():
    dask = pytest.importorskip("distributed", reason='needs the extra "cluster"')
    remote = pytest.importorskip("alssnn.distributed")
    parts = [integrating(n, seed=i, offset=0.5) for i, n in enumerate((700, 500))]
    here = fit(MODELS["al"], *zip(*parts, strict=True), integrators=1, **QUICK)
    options = {"processes": False, "dashboard_address": None, "n_workers": 1}
    with dask.Client(**options) as client:
        futures = client.scatter(parts)
        model = clone(MODELS["al"]).set_params(integrators=1, **QUICK)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            there = remote.fit(model, futures, client=client)
    assert there.integrators_ == 1
    np.testing.assert_allclose(there.u_offset_, here.u_offset_, rtol=1e-6)
    np.testing.assert_array_equal(there.A_[:, 1], [0, 1])
    assert there.score(*parts[0]) > 0.98


def test_a_loop_around_an_integrator():
    u, y = servo(1200)
    model = fit(MODELS["fl"], u, y, integrators=1, max_iter=40, tol=1e-4)
    K = lqr(model, np.eye(2), 0.1 * np.eye(1))
    loop = designed_loop(model, K)
    assert np.abs(loop.poles()).max() < 1
    assert model.linearizability(u, y).linearization_error < 0.05
    model.validate(u, y)


# -- derivatives ---------------------------------------------------------------------


def test_the_derivative_of_the_block_is_exact(rng):
    structure = state_space(4, 1, 2, n_g=2, C=rng.standard_normal((2, 4)))
    experiments = [(rng.standard_normal((20, 1)), rng.standard_normal((20, 2)))]
    criterion = Criterion(structure, experiments)
    free = 0.3 * rng.standard_normal(criterion.n)
    free[: structure.n_params] = structure.join(
        {**structure.split(free[: structure.n_params]), "A": np.diag([0.5, 0.4, 1, 1])}
    )
    problem = Contractive(criterion, 0.1, 2)
    A = problem.to_free(free)[:16].reshape(4, 4)
    np.testing.assert_array_equal(A[2:], np.eye(4)[2:])
    np.testing.assert_array_equal(A[:, 2:], np.eye(4)[:, 2:])
    assert np.linalg.norm(A[:2, :2], 2) ** 2 < 0.9
    np.testing.assert_allclose(problem.from_free(problem.to_free(free)), free)
    _, Jr, _ = problem.normal_equations(free)
    moved = [0, 1, 4, 5, 16, 20, 25]  # of Q and of what is behind A

    def square(part):
        whole = free.astype(complex)
        whole[moved] = part
        Q = whole[:16].reshape(4, 4)[:2, :2]
        S = np.eye(2) + Q.T @ Q
        root_det = np.sqrt(S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0])
        root = (S + root_det * np.eye(2)) / np.sqrt(np.trace(S) + 2 * root_det)
        adjugate = np.array([[root[1, 1], -root[0, 1]], [-root[1, 0], root[0, 0]]])
        whole[[0, 1, 4, 5]] = np.sqrt(0.9) * (Q @ adjugate / root_det).ravel()
        r = dense_residuals(criterion, whole)
        return np.array([r @ r])

    assert_jacobian(square, 2 * Jr[None, moved], free[moved], rtol=1e-9)


def test_limits_find_the_integrators_by_what_is_held():
    structure = state_space(3, 1, 1)
    held = integrator_entries(3, 1)
    low, high = (np.where(held, np.eye(3), bound) for bound in (-np.inf, np.inf))
    assert Limits(structure, 0.1, {"A": (low, high)}).n_integrators == 1
    assert Limits(structure, 0.1).n_integrators == 0


def test_the_contractive_basis_leaves_integrators_alone(rng):
    A = np.zeros((3, 3))
    A[:2, :2] = [[0.9, 5.0], [0.0, 0.8]]
    A[2, 2] = 1.0
    model = LinearModel(
        A, np.ones((3, 1)), np.ones((1, 3)), np.zeros((1, 1)), np.ones((1, 3))
    )
    other = contractive_basis(model, 0.01, 1)
    assert np.linalg.norm(other.A[:2, :2], 2) ** 2 < 0.99
    np.testing.assert_array_equal(other.A[2], [0, 0, 1])
    for k in range(4):
        power, same = np.linalg.matrix_power(A, k), np.linalg.matrix_power(other.A, k)
        np.testing.assert_allclose(model.C @ power @ model.B, other.C @ same @ other.B)


def test_an_experiment_that_was_never_measured_asks_for_nothing():
    rng = np.random.default_rng(0)
    us, ys = [], []
    for n in (200, 400):
        u, x, y = np.repeat(rng.uniform(-1, 1, n // 5), 5), np.zeros(2), np.empty(n)
        for k in range(n):
            y[k] = x[0] + 0.01 * rng.standard_normal()
            w = 0.05 * rng.standard_normal(2)
            x = np.array([[0.8, 0.1], [-0.1, 0.7]]) @ x + 0.4 * np.tanh(u[k]) + w
        us.append(u[:, None])
        ys.append(y)
    alone = LinearStateSpace(nx=2, integrators=1).fit(us[1], ys[1])
    model = LinearStateSpace(nx=2, integrators=1)
    model.fit(us, [np.full(200, np.nan), ys[1]])
    assert np.abs(model.x0_).max() < 100
    scores = (m.score(us[1], ys[1]) for m in (model, alone))
    assert np.subtract(*scores) == pytest.approx(0.0, abs=0.05)
