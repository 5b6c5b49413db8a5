"""Pictures whose words and axes have to be true of what they show."""

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning

from alssnn import LinearStateSpace
from alssnn.plotting import BodeComparisonDisplay, BodeDisplay


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
