import numpy as np
import pytest
from sklearn.metrics import r2_score, root_mean_squared_error

from alssnn import scorers
from alssnn.metrics import fit_percent, nrmse, rmse

METRICS = [rmse, nrmse, fit_percent]
# What each metric gives for a perfect prediction, and for a constant output that is
# predicted wrong by 2.
PERFECT = {rmse: 0.0, nrmse: 0.0, fit_percent: 100.0}
CONSTANT_MISSED = {rmse: 2.0, nrmse: np.inf, fit_percent: -np.inf}


@pytest.fixture
def outputs():
    rng = np.random.default_rng(0)
    y_true = 3 + rng.standard_normal((200, 3)) * [1.0, 10.0, 1e-3]
    y_pred = y_true + rng.standard_normal((200, 3)) * [0.1, 20.0, 1e-4]
    return y_true, y_pred


def test_values_by_hand():
    # y around its mean 0: std 2; errors 1, 1, 1, -1: rmse 1
    y_true, y_pred = [2.0, -2.0, 2.0, -2.0], [1.0, -3.0, 1.0, -1.0]
    assert rmse(y_true, y_pred) == 1.0
    assert nrmse(y_true, y_pred) == 0.5
    assert fit_percent(y_true, y_pred) == 50.0


@pytest.mark.parametrize("multioutput", ["uniform_average", "raw_values"])
def test_rmse_equals_scikit_learn(outputs, multioutput):
    np.testing.assert_allclose(
        rmse(*outputs, multioutput=multioutput),
        root_mean_squared_error(*outputs, multioutput=multioutput),
        rtol=1e-14,
    )


def test_nrmse_squared_is_one_minus_r2(outputs):
    r2 = r2_score(*outputs, multioutput="raw_values")
    values = nrmse(*outputs, multioutput="raw_values")
    np.testing.assert_allclose(values**2, 1 - r2, rtol=1e-12)


def test_fit_percent_is_the_formula_of_compare(outputs):
    y_true, y_pred = outputs
    # MATLAB, documentation of compare: 100 (1 - |y - yhat| / |y - mean(y)|)
    expected = 100 * (
        1
        - np.linalg.norm(y_true - y_pred, axis=0)
        / np.linalg.norm(y_true - y_true.mean(axis=0), axis=0)
    )
    fit = fit_percent(y_true, y_pred, multioutput="raw_values")
    np.testing.assert_allclose(fit, expected, rtol=1e-12)
    assert fit[1] < 0  # worse than the mean


def test_the_mean_is_the_zero_of_the_scale(outputs):
    y_true, _ = outputs
    y_pred = np.broadcast_to(y_true.mean(axis=0), y_true.shape)
    assert nrmse(y_true, y_pred) == pytest.approx(1.0, rel=1e-12)
    assert fit_percent(y_true, y_pred) == pytest.approx(0.0, abs=1e-10)


@pytest.mark.parametrize("metric", METRICS)
def test_multioutput(outputs, metric):
    values = metric(*outputs, multioutput="raw_values")
    assert isinstance(values, np.ndarray) and values.shape == (3,)
    average = metric(*outputs)
    assert isinstance(average, float)
    assert average == pytest.approx(values.mean())
    for i in range(3):
        one = metric(outputs[0][:, i], outputs[1][:, i])
        assert one == pytest.approx(values[i], rel=1e-12)


@pytest.mark.parametrize("metric", METRICS)
def test_one_and_two_dimensions_agree(outputs, metric):
    y_true, y_pred = (y[:, 0] for y in outputs)
    expected = metric(y_true, y_pred)
    assert metric(y_true[:, np.newaxis], y_pred) == expected
    assert metric(list(y_true), y_pred[:, np.newaxis]) == expected
    assert metric(y_true, y_pred, multioutput="raw_values").shape == (1,)


@pytest.mark.parametrize("metric", METRICS)
def test_arguments_are_not_modified(outputs, metric):
    copies = [y.copy() for y in outputs]
    metric(*outputs)
    np.testing.assert_array_equal(outputs, copies)


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("value", [0.0, 0.1, -3.0])
def test_constant_output(metric, value):
    y_true = np.full(7, value)  # the mean of seven times 0.1 is not 0.1
    assert metric(y_true, y_true) == PERFECT[metric]
    assert metric(y_true, y_true + 2) == pytest.approx(CONSTANT_MISSED[metric])
    assert metric([value], [value]) == PERFECT[metric]


@pytest.mark.parametrize("metric", METRICS)
def test_constant_output_beside_another(outputs, metric):
    y_true, y_pred = (y[:, :2].copy() for y in outputs)
    expected = metric(y_true[:, 1], y_pred[:, 1])
    y_true[:, 0], y_pred[:, 0] = 1.0, 3.0
    values = metric(y_true, y_pred, multioutput="raw_values")
    np.testing.assert_allclose(values, [CONSTANT_MISSED[metric], expected], rtol=1e-12)


def test_diverged_simulation_does_not_overflow():
    y_true, y_pred = np.array([1.0, -1.0]), np.array([1e200, -1e200])
    assert rmse(y_true, y_pred) == pytest.approx(1e200)
    assert nrmse(y_true, y_pred) == pytest.approx(1e200)
    assert fit_percent(y_true, y_pred) == pytest.approx(-1e202)
    assert nrmse(1e-200 * y_true, y_pred) == np.inf


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize(
    ("y_true", "y_pred", "message"),
    [
        ([1, 2, 3], [1, 2], "same number of samples, got 3 and 2"),
        ([[1, 2]], [[1]], "same number of outputs, got 2 and 1"),
        ([1, 2], [1, np.nan], "Input y_pred contains NaN"),
        ([np.nan, np.nan], [1, 2], "measured sample in every output"),
        ([1, 2], [1, np.inf], "Input y_pred contains infinity"),
        ([], [], "minimum of 1 is required"),
        (np.zeros((2, 2, 2)), [1, 2], "dim 3"),
        ([1, 2], np.array([1, 2j]), "Complex data not supported"),
    ],
)
def test_errors(metric, y_true, y_pred, message):
    with pytest.raises(ValueError, match=message):
        metric(y_true, y_pred)


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("multioutput", ["variance_weighted", None, [0.5, 0.5]])
def test_unknown_multioutput(metric, multioutput):
    with pytest.raises(ValueError, match="`multioutput` must be 'uniform_average' or"):
        metric([1.0, 2.0], [1.0, 2.0], multioutput=multioutput)


@pytest.mark.parametrize("bad", [["a", "b"], 1.0, [[[1.0]]], [1j, 2j], [[1], [1, 2]]])
def test_arguments_that_are_no_outputs_are_named(bad):
    for arguments, name in (
        ((bad, [1.0, 2.0]), "y_true"),
        (([1.0, 2.0], bad), "y_pred"),
    ):
        with pytest.raises(ValueError, match=name):
            rmse(*arguments)


@pytest.mark.parametrize("bad", [np.ones(2), [], {}, None])
def test_choices_that_are_none_are_named(bad):
    with pytest.raises(ValueError, match="`multioutput`"):
        rmse([1.0, 2.0], [1.0, 2.0], multioutput=bad)
    with pytest.raises(ValueError, match="`metric`"):
        scorers.k_step(2, metric=bad)
    with pytest.raises(ValueError, match="`linearization_error`"):
        scorers.accuracy_subject_to(linearization_error=bad)
