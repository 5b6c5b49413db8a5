"""Several fitted models on one record: the table, the figures."""

import numpy as np
import pytest
from sklearn.base import clone

import alssnn
from alssnn import LinearStateSpace
from alssnn.datasets import make_wiener_hammerstein
from alssnn.metrics import rmse
from alssnn.plotting import BodeComparisonDisplay, BodeDisplay
from models import fit, record


@pytest.fixture(scope="module")
def models():
    train, _ = make_wiener_hammerstein(1500, random_state=0).split(1000)
    return {
        f"nx={n}": LinearStateSpace(nx=n, dt=train.dt, n_init_samples=20 * n).fit(
            *train
        )
        for n in (1, 4)
    }


@pytest.fixture(scope="module")
def test():
    return make_wiener_hammerstein(1500, random_state=0).split(1000)[1]


@pytest.fixture(scope="module")
def found(models, test):
    return alssnn.compare(models, *test)


def test_all_models_are_scored_on_the_same_samples(models, test, found):
    assert found.starts == [80] and [len(y) for y in found.y_true] == [420]
    for name, model in models.items():
        (prepared,) = model.prepare_records(*test)
        y_hat = model.predict(test.u, x0=prepared.x0).reshape(-1, 1)
        np.testing.assert_allclose(found[name].y_hat[0], y_hat[80:], atol=1e-12)
        expected = rmse(test.y[80:], y_hat[80:], multioutput="raw_values")
        np.testing.assert_allclose(found[name].rmse, expected)
    assert found["nx=4"].fit_percent > found["nx=1"].fit_percent
    np.testing.assert_array_equal(found.y_true[0], test.y[80:])


def test_the_table_has_a_row_per_model(found):
    head, *lines = str(found).splitlines()
    assert head.split() == [
        "model",
        "states",
        "parameters",
        "RMSE",
        "of",
        "y0",
        "fit,",
        "%",
    ]
    assert [line.split()[:2] for line in lines] == [["nx=1", "1"], ["nx=4", "4"]]
    frame = found.to_frame()
    assert frame.loc["nx=4", "rmse"] == found["nx=4"].rmse[0]
    assert frame.loc["nx=4", "n_params"] == 24
    with pytest.raises(KeyError, match="`name` must be one of nx=1, nx=4"):
        found["lti"]


def test_several_outputs_experiments_and_gaps():
    u, y, labels = record(2, 2)
    y = y.copy()
    y.iloc[150, 1] = np.nan
    model = fit(LinearStateSpace(nx=3), 2, 2)
    found = alssnn.compare(
        [model, clone(model).set_params(nx=1).fit(u, y)], u, y, labels
    )
    assert [row.name for row in found] == ["LinearStateSpace", "LinearStateSpace 2"]
    assert len(found.y_true) == 2 and found.output_names == ["level", "flow"]
    assert np.isfinite(found["LinearStateSpace"].rmse).all()
    assert "rmse[flow]" in found.to_frame().columns
    display = found.plot(which=1)
    assert display.axes_.shape == (2, 2)
    assert display.axes_[0, 1].get_ylabel() == "flow"


def test_one_measurement_and_a_color_per_model(found):
    top, bottom = found.plot().axes_[:, 0]
    labels = [text.get_text() for text in top.get_legend().get_texts()]
    assert labels[0] == "measured" and labels.count("measured") == 1
    assert [label.split(",")[0] for label in labels[1:]] == ["nx=1", "nx=4"]
    colors = [line.get_color() for line in top.lines[1:]]
    assert len(set(colors)) == 2
    assert [line.get_color() for line in bottom.lines] == colors
    assert top.get_shared_x_axes().joined(top, bottom)
    residual = found.y_true[0] - found["nx=4"].y_hat[0]
    np.testing.assert_array_equal(bottom.lines[1].get_ydata(), residual[:, 0])


def test_a_model_that_diverges_does_not_hide_the_others(models, test):
    wild = clone(models["nx=1"]).fit(*test)
    found = alssnn.compare({"good": models["nx=4"], "wild": wild}, *test)
    for z in found["wild"].y_hat:
        z[:] = 1e6
    top, bottom = found.plot().axes_[:, 0]
    span = np.ptp(test.y)
    for ax in (top, bottom):
        low, high = ax.get_ylim()
        assert high - low < 3 * span
    assert "out of view" in top.get_legend().get_texts()[2].get_text()


def test_frequency_responses_with_bands(models):
    rng = np.random.default_rng(0)
    u, e = rng.standard_normal((2, 600))
    y = np.convolve(u, [0, 1, 0.8, 0.64])[:600] + 0.1 * e
    test = u[:, None], y
    models = {f"nx={n}": LinearStateSpace(nx=n).fit(*test) for n in (2, 4)}
    found = alssnn.compare(models, *test)
    band = models["nx=4"].parameter_covariance(*test).frequency_response()
    display = found.plot_bode(bands={"nx=4": band}, decibel=True)
    magnitude, phase = display.axes_[:, 0]
    assert magnitude.get_ylabel().endswith("dB") and len(phase.lines) == 2
    f, size = magnitude.lines[1].get_data()
    G = models["nx=4"].to_statespace()(np.exp(2j * np.pi * f))
    np.testing.assert_allclose(size, 20 * np.log10(np.abs(G)), atol=1e-9)
    assert len(magnitude.collections) == 1  # the band
    assert found.plot_bode().axes_[0, 0].get_yscale() == "log"
    with pytest.raises(ValueError, match="`bands` must belong to models"):
        found.plot_bode(bands={"lti": band})
    one = BodeDisplay.from_estimator(models["nx=4"], band=band, decibel=True)
    np.testing.assert_allclose(one.axes_[0, 0].lines[0].get_ydata().max(), size.max())


def test_errors(models, test):
    with pytest.raises(ValueError, match="at least one fitted model"):
        alssnn.compare([], *test)
    other = clone(models["nx=1"]).set_params(dt=2.0).fit(*test)
    with pytest.raises(ValueError, match="must have the same sampling time"):
        alssnn.compare({"a": models["nx=1"], "b": other}, *test)
    with pytest.raises(ValueError, match="`which` must be between 0 and 0, got 1"):
        alssnn.compare(models, *test).plot(which=1)
    two = fit(LinearStateSpace(nx=1, dt=models["nx=1"].dt), 2, 1)
    with pytest.raises(ValueError, match="same numbers of inputs and outputs"):
        BodeComparisonDisplay({"a": models["nx=1"], "b": two})
