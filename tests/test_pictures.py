"""Pictures whose words and axes have to be true of what they show."""

import json
import warnings
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

from alssnn import LinearStateSpace
from alssnn.cli import main
from alssnn.datasets import Record, make_duffing, make_valve_tank
from alssnn.estimators._fitted import publish_parameters
from alssnn.excitation import multisine
from alssnn.ladder import model_ladder
from alssnn.linearizability import words_left
from alssnn.model_selection import GammaPath, law_rates
from alssnn.nonparametric import best_linear_approximation
from alssnn.plotting import (
    BodeComparisonDisplay,
    BodeDisplay,
    CertificateDisplay,
    GammaPathDisplay,
    LawRatesDisplay,
    ResidualDisplay,
    SimulationDisplay,
    figure_curves,
    plot_model,
)
from alssnn.report._control import controller
from alssnn.report._sections import equations, in_words, summary
from alssnn.validation import frequency_response
from helpers import linear_plant
from models import al_ssnn, fl_ssnn, lively


def fitted(model, u, y):
    """Return a model after a few steps of training, which do."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return model.fit(u, y)


def phases(display, row=1):
    """Return the phases of all curves of an axes."""
    return [line.get_ydata() for line in display.axes_[row, 0].get_lines()]


def test_equal_responses_have_equal_phases():
    f = np.geomspace(0.01, 1.0, 30)
    G = -1.0 / (1 + 1j * f) * np.exp(0.1j)  # begins beyond 180 degrees
    H = -1.0 / (1 + 1j * f) * np.exp(-0.1j)  # begins before
    with_gap = np.where(f < 0.02, np.nan, H)
    responses = [("near", f, H[:, None, None]), ("gap", f, with_gap[:, None, None])]
    display = BodeDisplay(f, G[:, None, None], ["u"], ["y"], responses).plot()
    first, near, gap = phases(display)
    np.testing.assert_allclose(first - near, np.degrees(0.2))
    np.testing.assert_allclose(first[f > 0.02] - gap[f > 0.02], np.degrees(0.2))
    lost = [("lost", f, np.full((30, 1, 1), np.nan))]
    assert np.isnan(
        phases(BodeDisplay(f, G[:, None, None], ["u"], ["y"], lost).plot())[1]
    ).all()


@pytest.fixture
def model():
    """Return a model of two inputs with long names."""
    pandas = pytest.importorskip("pandas")
    rng = np.random.default_rng(0)
    u = pandas.DataFrame(rng.standard_normal((300, 2)), columns=["valve [%]", "pump"])
    x, y = 0.0, np.empty(300)
    for k, row in enumerate(u.to_numpy()):
        y[k] = x
        x = 0.8 * x + row @ [1.0, -0.5]
    y = pandas.DataFrame(y, columns=["level of the tank [m]"])
    return LinearStateSpace(nx=1).fit(u, y)


def test_amplitudes_stand_in_the_order_of_the_inputs(model):
    display = BodeDisplay.from_estimator(
        model, [[2.0, 0.5], [1.0, 1.0]], n_frequencies=3, period=16
    )
    _, *words = display.axes_[0, 0].get_legend_handles_labels()[1]
    assert words == ["model, amplitude 2, 0.5", "model, amplitude 1"]


@pytest.mark.parametrize("pole", [1.02, 1.3])
def test_sines_that_diverge_say_so(pole):
    rng = np.random.default_rng(0)
    u, x, y = np.empty(400), 0.0, np.empty(400)
    for k in range(400):
        y[k] = x
        u[k] = rng.standard_normal() - 0.8 * x
        x = pole * x + u[k] + 0.01 * rng.standard_normal()
    with pytest.warns(ConvergenceWarning, match="unstable"):
        model = LinearStateSpace(nx=1, noise="innovations").fit(u, y)
    display = BodeDisplay.from_estimator(model, [1.0], n_frequencies=3)
    axes = display.axes_[0, 0]
    assert axes.get_legend_handles_labels()[1][-1] == "model, amplitude 1, diverges"
    assert np.isnan(axes.get_lines()[-1].get_ydata()).all()


@pytest.mark.parametrize("draw", [BodeDisplay.from_estimator, None])
def test_long_names_take_two_lines_beside_an_axis(model, draw):
    if draw is None:
        display = BodeComparisonDisplay({"one": model}).plot()
    else:
        display = draw(model)
    assert display.axes_[0, 0].get_ylabel() == "|level of the tank [m] /\nvalve [%]|"


def test_a_simulation_that_goes_far_leaves_the_measured_output_in_view():
    y = np.sin(np.arange(200) / 5)
    far = SimulationDisplay.from_predictions(y, y * np.exp(np.arange(200) / 2))
    low, high = far.axes_[0, 0].get_ylim()
    assert -4 < low < -1 and 1 < high < 4
    label = far.axes_[0, 0].get_legend_handles_labels()[1][1]
    assert "partly out of view: -1.2e+40 to 1.4e+43" in label
    panels = json.loads(figure_curves(far.figure_))
    np.testing.assert_allclose(panels[0]["limits"], [low, high], rtol=1e-4)
    near = SimulationDisplay.from_predictions(y, y + 5)  # a level alone hides nothing
    assert "view" not in near.axes_[0, 0].get_legend_handles_labels()[1][1]
    assert near.axes_[0, 0].get_ylim()[1] > 6
    assert json.loads(figure_curves(near.figure_))[0]["limits"] is None
    lost = SimulationDisplay.from_predictions(y, np.where(y < 0.9, y, np.inf))
    assert "diverges" in lost.axes_[0, 0].get_legend_handles_labels()[1][1]


def test_the_range_of_the_training_data_is_in_the_figure_of_the_page():
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0.0, 2.0], [1.0, 3.0], label="model")
    axes.axhspan(-1.0, 2.0, facecolor="0.93", label="range of the training data")
    (panel,) = json.loads(figure_curves(figure))
    band, line = panel["series"]
    assert band["kind"] == "band" and band["name"] == "range of the training data"
    assert band["x"] == [0, 2] and line["x"] == [0, 2]
    assert band["y"] == [-1, -1] and band["high"] == [2, 2]
    axes.set(yscale="log", ylim=(0.1, 100.0))  # what is shown is of the logarithm
    (panel,) = json.loads(figure_curves(figure))
    assert panel["limits"] == [-1, 2] and panel["series"][1]["y"][0] == 0
    axes.lines[0].remove()  # a range is as long as the curves
    assert json.loads(figure_curves(figure))[0]["series"] == []


@pytest.fixture(scope="module")
def oscillator():
    """Return a model of continuous time that has h and no g, and its record."""
    record = make_duffing(300, random_state=0)
    options = {"hold": "linear", "time": "continuous", "dt": record.dt}
    model = fl_ssnn(
        nx=2, n_h=2, feedback="state", max_iter=5, random_state=0, **options
    )
    return fitted(model, *record), record


def test_what_moves_while_u_is_held_is_not_called_g(oscillator, tmp_path):
    model, record = oscillator
    for ahead in (False, True):
        found = model.linearizability(*record, ahead=ahead, in_loop=False)
        text = " ".join(str(found).split())
        assert found.ratio_g_max > 0  # a model without g
        assert "|omega| / |Ax+Bu| mean" in text and "H2 gain from omega to y" in text
        assert "|g|" not in text and "from g" not in text
        assert "spectral radius of sampled A" in text
        assert "by g, and by h where it moves while u is held" in text
    assert words_left(model.plant_).endswith("and h, which moves while u is held")
    plain = linear_plant([[0.5]], [[1.0]])
    assert words_left(plain) == "What g leaves at the output"


def test_equations_of_derivatives_say_what_they_are(oscillator):
    model, _ = oscillator
    text = equations(model)
    assert "x&#x27; is the derivative of x by the time in seconds, x+ is" in text
    assert "and hold their inputs, unlike the simulation of this record." in text
    assert str(model.summary()).count("of the sampled A") == 1


@pytest.fixture(scope="module")
def valve():
    """Return a model with a monotone map and a disturbance, and its record."""
    tank = make_valve_tank(250, noise=0.01, random_state=0)
    options = {"disturbances": [1], "dt": tank.dt, "max_iter": 3, "random_state": 0}
    options |= {"feedback": "state", "input_map": "monotone"}
    return fitted(al_ssnn(nx=1, n_h=2, n_g=1, **options), tank.u, tank.y), tank


def test_the_input_behind_a_map_is_not_called_the_recorded_one(valve):
    model, tank = valve
    text = " ".join(str(model.linearizability(tank.u, tank.y, in_loop=False)).split())
    said = "v is the recorded input, brought to the mean and the size that v had; its"
    assert said in text


def test_what_a_law_leaves_includes_disturbances(valve):
    options = {"disturbances": [1], "feedback": "state", "max_iter": 2}
    options |= {"random_state": 0}
    tank = valve[1]
    model = lively(fitted(al_ssnn(nx=1, n_h=2, n_g=1, **options), tank.u, tank.y))
    said = "The law leaves (A, B, C) from v and G dd, and what it does not cancel."
    assert said in equations(model)


def test_parts_of_a_figure_have_the_width_that_they_need(valve):
    model, tank = valve
    figure = plot_model(model, tank.u, tank.y)
    figure.draw_without_rendering()  # a warning says that axes collapsed
    width = figure.get_size_inches()[0]
    law = [ax for ax in figure.axes if "density" in ax.get_xlabel()]
    assert len(law) == 3
    assert min(ax.get_position().width for ax in law) * width > 2.5
    assert law[0].get_ylim() != law[2].get_ylim()  # h is not of the size of phi


def test_models_without_a_linearization_error_stay_in_the_figure():
    ones = np.ones(3)
    path = GammaPath(
        gammas=np.array([10.0, 1.0, 0.1]),
        models=(None,) * 3,
        rmse_train=ones,
        rmse_test=np.array([2.0, 1.5, 1.2]),
        linearization_error=np.array([0.0, 0.01, 0.1]),
        spectral_radius=0.9 * ones,
        seconds=ones,
    )
    axes = GammaPathDisplay.from_path(path).ax_
    axes.figure.draw_without_rendering()
    assert axes.get_xlim()[0] <= 0 < axes.get_xlim()[1]
    none = replace(path, linearization_error=np.zeros(3))
    GammaPathDisplay.from_path(none).figure_.draw_without_rendering()


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_the_axis_of_a_response_ends_where_its_errors_do(unit):
    excitation = multisine(64, dt=0.01, random_state=0)
    noise = np.random.default_rng(0).standard_normal((len(excitation), 1))
    y = unit * (excitation.u + 1e-3 * noise)
    found = best_linear_approximation(excitation, y)
    smallest = np.fmin(found.std, found.noise_std).min()
    low, high = found.plot().axes_[0, 0].get_ylim()
    assert 0.1 * smallest < low < smallest and unit < high < 10 * unit


def test_numbers_with_units_do_not_run_into_each_other():
    excitation = multisine(1024, random_state=0)  # one sample per second
    display = excitation.plot(lw=2, ls=":")
    assert display.axes_[0, 0].lines[0].get_linewidth() == 2
    figure = display.figure_
    figure.draw_without_rendering()
    for axes in figure.axes:
        boxes = [t.get_window_extent() for t in axes.get_xticklabels() if t.get_text()]
        low, high = axes.bbox.intervalx
        ends = [(b.x0, b.x1) for b in boxes if low < (b.x0 + b.x1) / 2 < high]
        assert all(a[1] < b[0] for a, b in pairwise(ends)) and len(ends) > 2


def test_a_legend_stands_above_the_power_of_ten():
    y = 3e-5 + 1e-7 * np.sin(np.arange(300) / 9)
    display = SimulationDisplay.from_predictions(y, y)
    axes = display.axes_[0, 0]
    display.figure_.draw_without_rendering()
    power = axes.yaxis.get_offset_text()
    assert power.get_text()
    boxes = [one.get_window_extent() for one in (axes.get_legend(), power)]
    assert not boxes[0].overlaps(boxes[1])


def test_rounding_is_no_deviation_of_a_loop():
    rng = np.random.default_rng(1)
    u = rng.standard_normal(300)
    y = np.convolve(u, 0.9 ** np.arange(30))[:300]
    options = {"feedback": "state", "max_iter": 5, "random_state": 0}
    model = fitted(fl_ssnn(nx=2, n_h=2, **options), u, y)
    certificate = model.iss_certificate(u, y)
    assert certificate.level == 0  # nothing but h, which the law cancels
    display = CertificateDisplay.from_estimator(model, certificate, u, y)
    assert display.inside_ == 1


def test_a_band_in_continuous_time_is_around_its_response():
    record = make_duffing(400, amplitude=0.01, noise=0.01, random_state=0)
    options = {"time": "continuous", "dt": record.dt}
    model = fitted(LinearStateSpace(nx=2, **options), record.u, record.y)
    omega = 2 * np.pi * np.geomspace(0.01, 1.2, 30)
    band = model.parameter_covariance(*record).frequency_response(omega)
    low, high = (limit[:, 0, 0] for limit in band.magnitude_band())
    held = np.abs(
        frequency_response(model.to_statespace(dt=record.dt), omega / 2 / np.pi)
    )
    assert (held[:, 0, 0] < low).any()  # what is sampled is another response
    for display in (
        BodeDisplay.from_estimator(model, band=band),
        BodeComparisonDisplay({"(A, B, C, D)": model}, {"(A, B, C, D)": band}).plot(),
    ):
        (line,) = display.axes_[0, 0].get_lines()
        f, G = line.get_data()
        assert line.get_label() == "(A, B, C, D), inputs not held"
        assert (np.interp(f, omega / 2 / np.pi, low) <= G * (1 + 1e-12)).all()
        assert (np.interp(f, omega / 2 / np.pi, high) >= G * (1 - 1e-12)).all()


def test_a_figure_of_another_law_than_the_judged_one_says_so(
    tmp_path, undrawn, monkeypatch
):
    monkeypatch.setattr("alssnn.report._control.certificates", lambda *_: "")
    record = make_duffing(300, random_state=0)
    options = {"time": "continuous", "dt": record.dt, "random_state": 0}
    model = fitted(al_ssnn(nx=2, n_h=2, n_g=2, max_iter=3, **options), *record)
    page = tmp_path / "report.html"
    model.report(page, *record, law_dt=0.1)
    section = page.read_text(encoding="utf-8").split("<section ")[4]
    said = section.index("Of the law at the sampling time of the record, 0.4 s, and")
    assert section.index("By frequency") < said < section.index("What g leaves at")


def test_an_output_that_one_experiment_did_not_measure_is_simulated():
    rng = np.random.default_rng(1)
    y = rng.standard_normal((50, 2))
    y[:, 1] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        display = SimulationDisplay.from_predictions(y, np.zeros((50, 2)))
        display.figure_.draw_without_rendering()
    words = [ax.get_legend_handles_labels()[1][1] for ax in display.axes_[0]]
    assert "fit" in words[0] and words[1] == "simulated, not measured"
    assert np.isnan(display.fit_percent_).tolist() == [False, True]


def test_samples_that_are_measured_seldom_are_drawn():
    y = np.full((120, 1), np.nan)
    y[::4] = np.sin(np.arange(30))[:, None]
    y[50:53] = 0.5  # a stretch is a line
    y_hat = np.zeros((120, 1))
    alone = [i for i in range(0, 120, 4) if i != 52]
    display = SimulationDisplay.from_predictions(y, y_hat)
    top, bottom = display.axes_[:, 0]
    for line in (top.lines[0], bottom.lines[0]):
        assert line.get_marker() == "." and line.get_markevery() == alone
    assert top.lines[1].get_marker() == "None"
    outputs, inputs = Record(y_hat, y, 0.1).plot().axes_[:, 0]
    assert outputs.lines[0].get_markevery() == alone
    assert inputs.lines[0].get_marker() == "None"


def test_lags_that_no_two_samples_have_are_not_drawn():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((600, 1))
    y = np.full((600, 1), np.nan)
    y[::2] = rng.standard_normal((300, 1))
    axes = ResidualDisplay.from_predictions(u, y, np.zeros((600, 1))).axes_[0, 0]
    lags = axes.lines[0].get_xdata()
    assert (lags % 2 == 0).all() and f"of {len(lags) - 1} outside" in axes.get_title(
        "left"
    )


@pytest.mark.parametrize(("size", "said"), [(1.0, "misses 100 % of"), (0.01, "1 % of")])
def test_shares_of_a_report_have_no_exponent(size, said, model, monkeypatch):
    y = np.random.default_rng(0).standard_normal((500, 1))
    pair = y, y * (1 - size) if size < 1 else np.full_like(y, y.mean() + 0.01)
    monkeypatch.setattr(type(model), "simulate_test", lambda *_: pair)
    data = [SimpleNamespace(y=y)]
    assert said in summary(model, data, (None, None, None), None)


def test_networks_that_were_left_are_not_in_the_equations(valve):
    tank = valve[1]
    options = {"feedback": "state", "max_iter": 2, "random_state": 0}
    model = lively(fitted(al_ssnn(nx=1, n_h=2, n_g=1, **options), tank.u, tank.y))
    assert in_words(model)[0] == "x+ = A x + B (du + h(x)) + g(x, du)"
    for name in model._structure.network_parameters:  # as a search does
        model._theta[model._structure.slices[name]] = 0.0
    publish_parameters(model)
    assert in_words(model)[0] == "x+ = A x + B du"
    assert str(model.summary()).splitlines()[1] == "equation     x+ = A x + B du"


def test_poles_of_derivatives_have_a_unit(oscillator, tmp_path, capsys):
    model, _ = oscillator
    model.save(tmp_path / "model.npz")
    main(["info", str(tmp_path / "model.npz")])
    (poles,) = [z for z in capsys.readouterr().out.splitlines() if "poles" in z]
    assert poles.endswith(" per second")


def test_a_table_of_models_says_what_its_radius_is():
    record = make_duffing(200, random_state=0)
    options = {"nx": 2, "models": ["lti"], "max_iter": 2, "dt": record.dt}
    said = "Radius of A: that of the sampled A, in continuous time."
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        assert said in str(model_ladder(*record, time="continuous", **options))
        assert said not in str(model_ladder(*record, **options))


def test_the_larger_error_of_two_loops_has_no_name_of_one(oscillator):
    model, record = oscillator
    rates = law_rates(model, *record, law_dt=[record.dt])
    assert str(rates).splitlines()[0].split(", ")[1].startswith("s  error")
    label = LawRatesDisplay.from_rates(rates).ax_.get_ylabel()
    assert label == "linearization error, %"


def test_columns_of_a_gain_with_late_inputs_are_told(model, undrawn):
    late = clone(model).set_params(input_delay=[0, 2])
    rng = np.random.default_rng(0)
    late.fit(rng.standard_normal((300, 2)), rng.standard_normal(300))
    said = "z+ = z + y - r; x with the last inputs behind it, oldest first"
    assert said in controller(late) and said not in controller(model)
