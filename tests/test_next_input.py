"""The experiment that a model asks for."""

import warnings

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn.criterion import Criterion
from alssnn.excitation import menu, steps
from alssnn.informative import information, law_weight
from alssnn.models import state_space
from benchmarks import next_input as benchmark
from helpers import dense_jacobian, random_theta


def plant(u):
    """Return the output of an oscillator with a spring; the last input is a load."""
    x, y = np.zeros(2), []
    for one in u:
        y.append(0.15 * x[0] + 0.1 * x[1])
        v = one[0] - 0.8 * np.tanh(2 * y[-1]) + (0.3 * one[-1] if len(one) > 1 else 0)
        x = np.array([1.6 * x[0] - 0.8 * x[1] + v, x[0]])
    return np.array(y)


def fitted(u, y, cls="FlSsnn", **options):
    options = {"n_h": 4, "n_init": 1, "alpha": 1e-4, "random_state": 0, **options}
    if cls == "LinearStateSpace":
        options = {}
    if cls == "GrSsnn":
        options["n_f"] = options.pop("n_h")
    model = getattr(alssnn, cls)(nx=2, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return model.fit(u, y)


@pytest.fixture(scope="module")
def record():
    u = steps(300, low=-0.5, high=0.5, hold=(5, 40), random_state=0).u
    return u, plant(u) + 0.02 * np.random.default_rng(0).standard_normal(300)


@pytest.fixture(scope="module")
def model(record):
    return fitted(*record, feedback="output")


def test_information_is_that_of_the_jacobian(structure, experiments, rng):
    theta, n = random_theta(structure, rng), structure.n_params
    x0 = rng.standard_normal((2, structure.n_x0))
    weight = rng.uniform(0.5, 2.0, structure.sizes["y"])
    plain = structure.observe("y")
    for i, pair in enumerate(experiments):
        criterion = Criterion(plain, [pair], weights={"y": weight})
        J = (
            dense_jacobian(criterion, criterion.join(theta, x0[i]))
            / criterion.one.weight[0]
        )
        J = J[: -criterion.n] * np.sqrt(weight[0])
        from_rest = dense_jacobian(criterion, criterion.join(theta, 0 * x0[i]))
        from_rest = from_rest[: -criterion.n] / criterion.one.weight[0]
        from_rest *= np.sqrt(weight[0])
        (H,) = information(structure, theta, [pair], weight)
        np.testing.assert_allclose(H, from_rest.T[:n] @ from_rest[:, :n], atol=1e-9)
        (H,) = information(structure, theta, [pair], weight, x0[i : i + 1])
        start = J[:, n:]  # what the initial state can explain is no information
        rest = J[:, :n] - start @ np.linalg.lstsq(start, J[:, :n], rcond=None)[0]
        np.testing.assert_allclose(H, rest.T @ rest, atol=1e-8)


@pytest.mark.parametrize("options", [{}, {"feedback": "state"}])
def test_what_no_record_tells_is_no_error_of_the_law(options, rng):
    structure = state_space(3, 2, 2, n_h=4, C=rng.standard_normal((2, 3)), **options)
    theta = random_theta(structure, rng)
    X, u = rng.standard_normal((50, 3)), rng.standard_normal((50, 2))
    M = law_weight(structure, theta, X, u)
    assert np.linalg.eigvalsh(M).min() > -1e-12
    size = np.sqrt(np.abs(M).max(axis=0))
    assert (
        not size[structure.slices["b_h"]].max() > 1e-7
    )  # constants: the offset of A x
    for name in ("A", "B"):
        assert not size[structure.slices[name]].any()  # no part of the law
    assert size[structure.slices["W_h"]].min() > 1e-3


def test_silence_tells_nothing_and_a_repetition_halves_the_variance(record):
    u, y = record
    # a larger decay would be a part of what is known
    model = fitted(*record, feedback="output", alpha=1e-5)
    repeated, silent = u, np.tile(model.u_offset_, (300, 1))
    chosen = model.next_input(u, y, candidates=[silent, repeated])
    assert chosen.best == 1 and chosen.excitation is repeated
    assert 0.97 < chosen.expected[0] <= 1.0
    assert 0.65 < chosen.expected[1] < 0.75  # 1 / sqrt(2), but for the initial state


def test_the_law_is_better_after_what_was_chosen(record, model):
    u, y = record
    options = {"low": -1.0, "high": 1.0, "random_state": 1}
    signals = menu(300, n_candidates=12, **options)
    chosen = model.next_input(u, y, candidates=signals)
    same = model.next_input(u, y, candidates=12, n_samples=300, **options)
    np.testing.assert_allclose(same.expected, chosen.expected)
    assert chosen.target == "law" and chosen.expected.max() < 1
    region = plant(steps(2_000, hold=(5, 40), random_state=9).u)[:, None]
    Q = np.linalg.qr(np.hstack([np.ones_like(region), region]))[0]
    errors = []
    for i in (chosen.best, int(np.argmax(chosen.expected))):
        sent = signals[i].u
        noise = 0.02 * np.random.default_rng(1).standard_normal(300)
        both = fitted([u, sent], [y, plant(sent) + noise], feedback="output")
        wrong = both.plant_.law(0 * region, region) - 0.8 * np.tanh(2 * region)
        errors.append(np.linalg.norm(wrong - Q @ (Q.T @ wrong)))
    assert errors[0] < 0.5 * errors[1]


def test_units_do_not_matter(record, monkeypatch):
    u, y = record
    # straight steps take both fits to the same one of several minima
    monkeypatch.setattr(Criterion, "pulled", lambda *_: None)
    # to the minimum: soft directions of the information still move at the usual tol
    options = {"feedback": "output", "tol": 1e-9, "max_iter": 1000}
    model = fitted(u, y, **options)
    other = fitted(1e3 * u + 7, y / 50 - 3, **options)
    signals = [one.u for one in menu(200, n_candidates=6, random_state=0)]
    chosen = model.next_input(u, y, candidates=signals)
    scaled = other.next_input(
        1e3 * u + 7, y / 50 - 3, candidates=[1e3 * one + 7 for one in signals]
    )
    np.testing.assert_allclose(scaled.expected, chosen.expected, rtol=0.01)


@pytest.mark.parametrize("cls", ["LinearStateSpace", "GrSsnn", "AlSsnn"])
def test_every_model_asks_for_something(cls, record):
    u, y = record
    chosen = fitted(u, y, cls).next_input(u, y, candidates=4, random_state=0)
    assert chosen.target == ("law" if cls == "AlSsnn" else "output")
    assert np.all((chosen.expected > 0) & (chosen.expected < 1))
    sent = chosen.excitation.u
    assert len(sent) == 300 and u.min() <= sent.min() and sent.max() <= u.max()


def test_disturbances_are_those_of_the_record():
    rng = np.random.default_rng(0)
    u = np.hstack([steps(300, random_state=0).u, rng.standard_normal((300, 1))])
    y = plant(u) + 0.01 * rng.standard_normal(300)
    model = fitted(u, y, feedback="output", disturbances=[1], input_delay=[0, 2])
    (signal,) = menu(200, n_candidates=1, random_state=0)
    whole = np.hstack([signal.u, u[:200, 1:]])
    chosen = model.next_input(u, y, candidates=[signal, whole])
    np.testing.assert_allclose(*chosen.expected)


def test_what_leads_the_output_too_far_is_left_out(record, model):
    u, y = record
    small, large = 0.1 * u, 2 * u
    chosen = model.next_input(u, y, candidates=[small, large], y_low=-0.5, y_high=0.5)
    assert np.isnan(chosen.expected[1]) and chosen.best == 0
    with pytest.raises(ValueError, match="keep the outputs within `y_low`"):
        model.next_input(u, y, candidates=[large], y_low=-0.1, y_high=0.1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"candidates": []}, r"positive integer or a list of signals, got \[\]"),
        ({"candidates": "steps"}, "positive integer or a list of signals, got 'steps'"),
        ({"candidates": True, "low": -1}, "or a list of signals, got True"),
        ({"candidates": [np.array([])]}, r"with samples, got one of shape \(0,\)"),
        ({"candidates": [5.0]}, "must be signals with samples"),
        (
            {"candidates": [np.ones(9)], "n_samples": 0},
            "must be an integer of at least 1",
        ),
        ({"candidates": [np.ones(9)], "n_samples": 1.5}, "`n_samples` must be an int"),
        ({"candidates": [np.ones((9, 3))]}, r"all 1, got shape \(9, 3\)"),
        ({"candidates": [np.ones((9, 1))], "low": -1}, "`candidates` must be a number"),
        ({"candidates": 0}, "`n_candidates` must be"),
    ],
)
def test_what_is_no_candidate_is_refused(options, message, record, model):
    with pytest.raises(ValueError, match=message):
        model.next_input(*record, **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"noise": "innovations"}, "`noise` must be 'output'"),
        ({"time": "continuous", "dt": 0.1}, "`time` must be 'discrete'"),
    ],
)
def test_models_of_another_kind_are_refused(options, message, record):
    model = alssnn.LinearStateSpace(nx=2, **options).fit(*record)
    with pytest.raises(ValueError, match=message):
        model.next_input(*record)


def test_a_menu_keeps_its_limits():
    options = {"low": [0.0, -2.0], "high": [5.0, 2.0], "operating_point": [1.0, 0.0]}
    signals = menu(128, 2, rate=3.0, n_candidates=18, random_state=0, **options)
    assert len(signals) == 18 and {one.kind for one in signals} == {
        "steps",
        "multisine",
    }
    for one in signals:
        assert one.u.shape == (128, 2) and one.n_experiments == 1
        assert np.all((one.u >= options["low"]) & (one.u <= options["high"]))
        assert np.abs(np.diff(one.u, axis=0)).max() <= 3.0 + 1e-9


@pytest.mark.parametrize("name", benchmark.PLANTS)
def test_the_benchmark_knows_the_law(name):
    truth = benchmark.PLANTS[name]
    y = truth(steps(500, truth.B.shape[1], random_state=0).u)
    L = np.ones((truth.B.shape[1], y.shape[1]))

    class Known:
        class plant_:
            @staticmethod
            def law(v, y):
                return v - share * truth.h(y) + y @ L.T - 0.3

    for share in (1.0, 0.7):
        error = benchmark.law_error(Known, truth, y)
        np.testing.assert_allclose(error, 1 - share, atol=1e-9)


def test_the_table_of_the_benchmark():
    rows = [(np.array([0.5, 0.1, 0.2, 0.1]), (1, 2, 3))] * 3
    text = benchmark.table({"spring": rows})
    assert "| 50.0 % | 10.0 % | 20.0 % | 10.0 % | 0.50 (0.50 to 0.50), below 1" in text
