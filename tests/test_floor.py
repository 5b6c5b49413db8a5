"""A training ends at the noise floor, if it is told of one, and says so."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone

import alssnn
from alssnn.excitation import multisine
from alssnn.nonparametric import best_linear_approximation
from alssnn.watch import AT_FLOOR

PERIOD = 256


@pytest.fixture(scope="module")
def record():
    """Return a periodic record of an exactly linearizable plant, and its noise."""
    excitation = multisine(PERIOD, n_periods=3, n_realizations=3, random_state=0)
    rng, y = np.random.default_rng(1), []
    for u in excitation.experiments:
        x = np.zeros(2)
        for one in u[:, 0]:
            y.append((0.15 * x[0] + 0.1 * x[1], 1e3 * x[0]))
            v = one - 0.8 * np.tanh(2 * y[-1][0])
            x = np.array([1.6 * x[0] - 0.8 * x[1] + v, x[0]])
    noise = 0.05 * np.std(y, axis=0)
    return excitation, y + noise * rng.standard_normal((len(y), 2)), noise


def model(**options):
    return alssnn.FlSsnn(nx=2, n_init=1, alpha=0.0, random_state=0, **options)


def error(fit, excitation, y):
    pair = fit.simulate_test(excitation.u, y, excitation.experiment)
    return np.sqrt(np.mean((pair[0] - pair[1]) ** 2, axis=0))


@pytest.mark.parametrize(
    "told",
    [
        lambda u, y, label, noise: {"noise_floor": noise},
        lambda u, y, label, noise: {
            "noise_floor": best_linear_approximation(u, y, label, period=PERIOD)
        },
        lambda u, y, label, noise: {"noise_floor": True, "period": PERIOD},
    ],
    ids=["numbers", "response", "record"],
)
def test_a_training_ends_at_the_floor(record, told):
    excitation, y, noise = record
    data = excitation.u, y, excitation.experiment
    free = model().fit(*data)
    fit = model(**told(*data, noise)).fit(*data)
    assert fit.message_ == AT_FLOOR and fit.converged_
    assert fit.n_iter_ < free.n_iter_ and AT_FLOOR not in free.message_
    # the last step is the first one there
    np.testing.assert_allclose(error(fit, excitation, y), noise, rtol=0.15)
    costs = [step.cost for step in fit.history_ if step.label != "linear"]
    scaled = np.sum((noise / y.std(axis=0)) ** 2)
    assert costs[-1] <= 1.15 * scaled < 1.2 * costs[-2]


@pytest.mark.parametrize("cls", [alssnn.FlSsnn, alssnn.LinearStateSpace])
def test_noise_of_one_output_pays_for_no_error_of_another(cls):
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, 500), 3)
    x, y, noise = np.zeros(2), [], np.array([0.002, 0.3])
    bend = 0.8 if cls is alssnn.FlSsnn else 0.0
    for one in u:
        y.append((x[0], x[1]))
        v = one - bend * np.tanh(2 * x[0])
        x = np.array([0.9 * x[0] + 0.2 * x[1], 0.7 * x[1] - 0.1 * x[0] + 0.3 * v])
    y = np.array(y) + noise * rng.standard_normal((len(u), 2))
    options = {"n_init": 1, "alpha": 0.0, "random_state": 0, "n_h": 6} if bend else {}
    fit = cls(nx=2, noise_floor=noise, **options).fit(u, y)
    free = cls(nx=2, **options).fit(u, y)
    # the sum of both is that of the noise long before the first output is
    assert error_of(free, u, y)[0] > 1.9 * noise[0]
    assert fit.message_ == free.message_ != AT_FLOOR
    np.testing.assert_array_equal(fit.A_, free.A_)
    if bend:  # weighted, both come down to the noise
        weight = 0.1 * (noise[1] / noise) ** 2
        fit = cls(nx=2, noise_floor=noise, output_weight=weight, **options).fit(u, y)
        assert fit.message_ == AT_FLOOR
        assert np.all(error_of(fit, u, y) < 1.1 * noise)


def error_of(fit, u, y):
    return np.sqrt(np.mean(np.subtract(*fit.simulate_test(u, y)) ** 2, axis=0))


def test_a_floor_out_of_reach_changes_nothing(record):
    excitation, y, noise = record
    data = excitation.u, y, excitation.experiment
    free, fit = model().fit(*data), model(noise_floor=noise / 2).fit(*data)
    np.testing.assert_array_equal(fit.A_, free.A_)
    assert fit.n_iter_ == free.n_iter_ and fit.message_ == free.message_


def test_a_linear_model_may_end_there_too(record):
    excitation, y, _ = record
    u = excitation.u
    fit = alssnn.LinearStateSpace(nx=2, noise_floor=y.std(axis=0)).fit(
        u, y, excitation.experiment
    )
    assert fit.message_ == AT_FLOOR and fit.n_iter_ == 1


def test_means_of_periods_have_a_lower_floor(record):
    excitation, y, noise = record
    data = excitation.u, y, excitation.experiment
    periodic = {"initial_state": "periodic", "period": PERIOD}
    fit = model(noise_floor=noise, **periodic).fit(*data)
    last = fit.history_[-1].cost
    full = np.sum((noise / y.std(axis=0)) ** 2)
    # two of three periods are averaged: half the mean square is left
    assert last < 0.75 * full


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"noise_floor": True}, "only with a `period`, or with experiments that had"),
        ({"noise_floor": -1.0}, "must be positive"),
        ({"noise_floor": False}, "got False"),
        (
            {"noise_floor": alssnn.first_look.FirstLook(())},
            "got a FirstLook of a record without periods, which does not tell",
        ),
        ({"noise_floor": 1.0, "noise": "innovations"}, "must be None for noise="),
        ({"noise_floor": 1.0, "period": PERIOD}, "`period` must be None"),
    ],
)
def test_what_is_no_floor(record, options, message):
    excitation, y, _ = record
    with pytest.raises(ValueError, match=message):
        model(**options).fit(excitation.u, y, excitation.experiment)


def test_experiments_with_one_input_tell_the_floor(record):
    excitation, _, noise = record
    u = excitation.experiments[0]
    rng = np.random.default_rng(3)
    clean = (
        np.convolve(u[:, 0], np.r_[0, 0.5 ** np.arange(20)])[: len(u), None]
        * noise
        * 20
    )
    ys = [clean + noise * rng.standard_normal(clean.shape) for _ in range(3)]
    fit = alssnn.LinearStateSpace(nx=1, noise_floor=True).fit([u] * 3, ys)
    assert fit.message_ == AT_FLOOR


def test_a_floor_survives_copies_and_files(record, tmp_path):
    excitation, y, _ = record
    data = excitation.u, y, excitation.experiment
    response = best_linear_approximation(*data, period=PERIOD)
    fit = model(noise_floor=response).fit(*data)
    assert clone(fit).noise_floor is not None
    for other in (pickle.loads(pickle.dumps(fit)), _by_file(fit, tmp_path)):
        np.testing.assert_array_equal(other.noise_floor, response.noise_rms)


def _by_file(fit, folder):
    fit.save(folder / "model.alssnn")
    return alssnn.load(folder / "model.alssnn")
