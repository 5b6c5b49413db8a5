import subprocess
import sys
import warnings
from functools import cache

import control
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn import LinearStateSpace
from alssnn.datasets import Record
from alssnn.feedback import lqr
from alssnn.model_selection import GammaPath
from alssnn.plotting import (
    BodeDisplay,
    CertificateDisplay,
    GammaPathDisplay,
    LoopDisplay,
    NonlinearityDisplay,
    PoleDisplay,
    ResidualDisplay,
    ResidualNonlinearityDisplay,
    SimulationDisplay,
    SingularValuesDisplay,
    plot_model,
)
from alssnn.validation import frequency_response, judged_experiments, residual_tests
from models import al_ssnn

pandas = pytest.importorskip("pandas")
DT = 0.1  # s


def plant(u):
    x, y = np.zeros(2), np.empty((len(u), 2))
    for k, u_k in enumerate(u):
        y[k] = x[0], 0.3 * x[0] + x[1]
        x = np.array([[0.8, 0.3], [-0.2, 0.7]]) @ x + u_k - 0.1 * np.tanh(x) ** 2
    return y


@pytest.fixture(scope="module")
def data():
    """Two experiments of two named inputs and outputs."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal((700, 2))
    y = np.vstack([plant(u[:300]), plant(u[300:])])
    y += 0.05 * rng.standard_normal(y.shape)
    return (
        pandas.DataFrame(u, columns=["fan [V]", "heater [V]"]),
        pandas.DataFrame(y, columns=["flow [l/s]", "temperature [K]"]),
        np.repeat([0, 1], [300, 400]),
    )


def part(data):
    """Return some samples of both experiments, where any samples would do."""
    return tuple(z[200:400] for z in data)


def fit(model, data):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return model.set_params(dt=DT).fit(*data)


@pytest.fixture(scope="module")
def fitted(data):
    """Return how to get a model of a feedback, which is fitted once."""
    options = {"max_iter": 6, "random_state": 0}
    return cache(
        lambda s: fit(al_ssnn(nx=2, n_h=2, n_g=3, feedback=s, **options), data)
    )


@pytest.fixture(params=["output", "state"])
def model(request, fitted):
    return fitted(request.param)


@pytest.fixture(scope="module")
def linear(data):
    return fit(LinearStateSpace(nx=2), data)


def labels(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def texts(axes):
    return [ax.get_ylabel() for ax in np.ravel(axes)]


# -- what all displays share -----------------------------------------------------------


def draw(name, model, data, **options):
    """Make any of the displays from a fitted model."""
    if name == "LoopDisplay":
        response = control.step_response(model.to_statespace(), input=0)
        return LoopDisplay.from_responses({"linear": response}, **options)
    if name == "GammaPathDisplay":
        return GammaPathDisplay.from_path(make_path(), **options)
    if name == "CertificateDisplay":
        certificate = model.iss_certificate(*data)
        return CertificateDisplay.from_estimator(model, certificate, *data, **options)
    display = getattr(alssnn.plotting, name)
    if name == "RecordDisplay":
        u, y, _ = data
        record = Record(u, y, DT, inputs=list(u), outputs=list(y))
        return display(record).plot(**options)
    if name == "RunDisplay":
        run = model.controller(lqr(model, np.eye(2), np.eye(2)), u_max=0.1)
        return display(run.plot().record).plot(**options)
    if name == "ComparisonDisplay":
        return display(alssnn.compare([model], *data)).plot(**options)
    if name == "BodeComparisonDisplay":
        return display({"one": model, "two": model}).plot(**options)
    if name in ("BodeDisplay", "PoleDisplay", "SingularValuesDisplay"):
        return display.from_estimator(model, **options)
    return display.from_estimator(model, *data, **options)


DISPLAYS = {
    "SimulationDisplay": 4,
    "ResidualDisplay": 6,
    "BodeDisplay": 8,
    "PoleDisplay": 1,
    "SingularValuesDisplay": 1,
    "NonlinearityDisplay": 4,
    "ResidualNonlinearityDisplay": 4,
    "GammaPathDisplay": 1,
    "CertificateDisplay": 1,
    "LoopDisplay": 2,
    "RecordDisplay": 4,
    "RunDisplay": 4,
    "ComparisonDisplay": 4,
    "BodeComparisonDisplay": 8,
}


# with tests of their own: what comes before a model, and what takes other models
OTHERS = {"ExcitationDisplay", "ApproximationDisplay", "LawRatesDisplay"}


def test_the_list_of_displays_is_complete():
    public = {name for name in alssnn.plotting.__all__ if name.endswith("Display")}
    assert public - OTHERS == set(DISPLAYS)


# what h sees is drawn by two of them, and is the same to the others
OF_NETWORKS = {"NonlinearityDisplay", "ResidualNonlinearityDisplay"}
CASES = [("output", name) for name in DISPLAYS]
CASES += [("state", name) for name in sorted(OF_NETWORKS)]


@pytest.mark.parametrize(("model", "name"), CASES, indirect=["model"])
def test_draws_on_own_and_given_axes(name, model, data):
    data = part(data)
    before = dict(mpl.rcParams)
    n = DISPLAYS[name]
    own = draw(name, model, data)
    axes = np.ravel(own.ax_ if n == 1 else own.axes_)
    assert len(axes) == n
    assert all(ax.figure is own.figure_ for ax in axes)
    assert all(ax.get_ylabel() for ax in axes)
    own.figure_.draw_without_rendering()
    given = Figure().subplots(1, n, squeeze=False).ravel()
    again = own.plot(given[0] if n == 1 else given)
    assert again is own and own.figure_ is given[0].figure
    for old, new in zip(axes, given, strict=True):
        assert old.get_ylabel() == new.get_ylabel()
        assert len(old.lines) == len(new.lines)
        for line, copy in zip(old.lines, new.lines, strict=True):
            np.testing.assert_array_equal(line.get_xydata(), copy.get_xydata())
    with pytest.raises(ValueError, match=rf"`ax` must hold {n} axes \(.*got {n + 1}"):
        own.plot(Figure().subplots(1, n + 1))
    assert dict(mpl.rcParams) == before


def takes_a_width(name):
    return "``linewidth``" in getattr(alssnn.plotting, name).plot.__doc__


@pytest.mark.parametrize(
    ("model", "name"), [z for z in CASES if takes_a_width(z[1])], indirect=["model"]
)
@pytest.mark.parametrize("option", ["linewidth", "lw"])
def test_draws_curves_of_a_given_width(name, model, data, option):
    display = draw(name, model, part(data)).plot(**{option: 3.25})
    lines = [line for ax in display.figure_.axes for line in ax.lines]
    assert 3.25 in [line.get_linewidth() for line in lines]


def test_drawing_leaves_pyplot_without_figures(tmp_path):
    code = """
import sys, numpy as np, alssnn
from alssnn.plotting import BodeDisplay, SimulationDisplay, plot_ladder
assert "matplotlib.pyplot" not in sys.modules
u = np.random.default_rng(0).standard_normal((400, 1))
record = u[1:], np.convolve(u[:, 0], [1.0, 0.5])[:399]
model = alssnn.LinearStateSpace(nx=2).fit(*record)
SimulationDisplay.from_estimator(model, *record).figure_.savefig(sys.argv[1])
assert "matplotlib.pyplot" not in sys.modules
BodeDisplay.from_estimator(model)
from matplotlib import pyplot  # python-control imports it
assert pyplot.get_fignums() == []
"""
    path = tmp_path / "simulation.png"
    subprocess.run([sys.executable, "-c", code, str(path)], check=True)
    assert path.stat().st_size > 1000


# -- one by one ------------------------------------------------------------------------


def test_simulation(model, data):
    u, y, label = data
    display = SimulationDisplay.from_estimator(model, u, y, label, which=1, color="C3")
    measured, simulated = model.simulate_test(u[300:], y[300:])
    start = 400 - len(measured)
    for i in range(2):
        top, bottom = display.axes_[:, i]
        np.testing.assert_array_equal(top.lines[0].get_ydata(), measured[:, i])
        np.testing.assert_allclose(top.lines[1].get_ydata(), simulated[:, i])
        np.testing.assert_allclose(
            bottom.lines[0].get_ydata(), (measured - simulated)[:, i]
        )
        assert top.lines[1].get_color() == bottom.lines[0].get_color() == "C3"
    t = display.axes_[0, 0].lines[0].get_xdata()
    np.testing.assert_allclose(t, DT * np.arange(start, 400))
    assert texts(display.axes_[0]) == ["flow [l/s]", "temperature [K]"]
    formatter = display.axes_[1, 0].xaxis.get_major_formatter()
    assert formatter.unit == "s"
    fit = 100 - 100 * np.linalg.norm((measured - simulated)[:, 0]) / np.linalg.norm(
        measured[:, 0] - measured[:, 0].mean()
    )
    assert labels(display.axes_[0, 0]) == ["measured", f"AlSsnn, fit {fit:.3g} %"]


def test_simulation_from_predictions():
    display = SimulationDisplay.from_predictions(
        [1.0, np.nan, 3.0], [1.0, 2.0, 3.5], dt=2.0, output_names=["level [m]"]
    )
    np.testing.assert_array_equal(display.t, [0, 2, 4])
    residual = display.axes_[1, 0].lines[0].get_ydata()
    np.testing.assert_array_equal(residual, [0, np.nan, -0.5])
    assert display.fit_percent_[0] == pytest.approx(100 * (1 - 0.5 / np.sqrt(2)))
    lost = SimulationDisplay.from_predictions([1.0, 2.0], [1.0, np.inf])
    assert lost.fit_percent_[0] == -np.inf


def test_residuals(model, data):
    found = model.validate(*data, n_lags=12)
    display = ResidualDisplay.from_estimator(model, *data, n_lags=12)
    tests = found.residuals
    for i in range(2):
        rows = display.axes_[:, i]
        out = np.abs(tests.autocorrelation) > tests.autocorrelation_band
        title = f"residual: {out[1:, i].sum()} of 12 outside the band"
        assert rows[0].get_title(loc="left") == title
        for row, r in zip(
            rows,
            [
                tests.autocorrelation[:, i],
                *np.moveaxis(tests.cross_correlation[:, i], -1, 0),
            ],
            strict=True,
        ):
            np.testing.assert_allclose(row.lines[0].get_ydata(), r)
        band = rows[1].collections[0].get_paths()[0].vertices[:, 1]
        assert band.max() == pytest.approx(tests.cross_band[:, i].max())
    assert labels(display.axes_[0, 0]) == ["99 % at each lag"]
    assert display.axes_[2, 1].get_ylabel() == (
        "whitened residual\nof temperature [K] with\nheater [V]"
    )
    assert display.axes_[2, 1].get_xlabel() == "lag, samples of 100 ms"
    u, y, _ = (part[:200] for part in data)  # too short for errors of the parameters
    judged, options = judged_experiments(model, u, y)
    with pytest.raises(ValueError, match="longer record"):
        residual_tests(judged, **options)
    assert ResidualDisplay.from_estimator(model, u, y).tests.lags[-1] == 4


def test_titles_of_residuals_count_what_is_drawn():
    rng = np.random.default_rng(0)
    u, e = rng.standard_normal((2, 400, 1))
    r = e + 0.5 * np.roll(u, 3, axis=0)
    r[1:] += 0.6 * r[:-1]
    display = ResidualDisplay.from_predictions(u, r, 0 * r, n_lags=8)
    tests = display.tests
    out = np.abs(tests.autocorrelation) > tests.autocorrelation_band
    cross = np.abs(tests.cross_correlation[..., 0]) > tests.cross_band
    late = tests.cross_lags >= 0
    titles = [ax.get_title(loc="left") for ax in display.axes_[:, 0]]
    assert titles == [
        f"residual: {out[1:].sum()} of 8 outside the band",
        f"u0, lags from 0 on: {cross[late].sum()} of 9 outside the band",
    ]
    assert out[1:].sum() >= 2 and cross[late].sum() >= 1


def test_residuals_from_predictions():
    rng = np.random.default_rng(0)
    u, r = rng.standard_normal((2, 400))
    display = ResidualDisplay.from_predictions(u, r, 0 * r, n_lags=8, level=0.05)
    assert labels(display.axes_[0, 0]) == ["95 % at each lag"]
    rho = np.corrcoef(r[3:], r[:-3])[0, 1]
    assert display.axes_[0, 0].lines[0].get_ydata()[3] == pytest.approx(rho, abs=0.01)


def test_bode(model):
    band_f = np.array([0.1, 1.0, 4.0])
    low, high = np.full((2, 3, 2, 2), 0.1) * np.array([1, 3])[:, None, None, None]
    display = BodeDisplay.from_estimator(
        model,
        [[0.1, 0.2], [1.0, 2.0]],
        n_frequencies=6,
        period=64,
        band=(band_f, low, high),
    )
    f = display.frequencies
    G = frequency_response(model.to_statespace(), f)
    z = np.exp(2j * np.pi * f[7] * DT)
    direct = model.C_ @ np.linalg.inv(z * np.eye(2) - model.A_) @ model.B_
    np.testing.assert_allclose(G[7], direct + model.D_)
    assert f[-1] == pytest.approx(0.5 / DT)
    for i in range(2):
        for j in range(2):
            magnitude, phase = display.axes_[2 * i : 2 * i + 2, j]
            np.testing.assert_allclose(
                magnitude.lines[0].get_ydata(), np.abs(G[:, i, j])
            )
            turns = np.radians(phase.lines[0].get_ydata()) - np.angle(G[:, i, j])
            np.testing.assert_allclose(np.exp(1j * turns), 1)
            assert len(magnitude.lines) == 3
            limits = magnitude.collections[0].get_paths()[0].vertices[:, 1]
            assert set(np.round(limits, 9)) == {0.1, 0.3}
    label = labels(display.axes_[0, 0])
    assert "model, amplitude 0.1, 0.2" in label and "(A, B, C, D)" in label
    assert display.axes_[2, 1].get_ylabel() == "|temperature [K] /\nheater [V]|"
    assert display.axes_[-1, 0].xaxis.get_major_formatter().unit == "Hz"


def test_bode_of_the_closed_loop_is_nearer_to_the_linear_one(model):
    distance = {}
    for loop in ("open", "closed"):
        display = BodeDisplay.from_estimator(
            model, [1.0], loop=loop, n_frequencies=6, period=64
        )
        ((_, f, G),) = display.responses
        G_lin = frequency_response(model.to_statespace(), f)
        distance[loop] = np.abs(G - G_lin).max()
    assert distance["closed"] < distance["open"]


def test_poles(model):
    K = np.array([[0.1, 0.0], [0.0, 0.2]])
    display = PoleDisplay.from_estimator(model, K=K)
    drawn = display.ax_.lines
    for line, poles in zip(drawn, display.poles.values(), strict=True):
        np.testing.assert_array_equal(line.get_xdata(), poles.real)
        np.testing.assert_array_equal(line.get_ydata(), poles.imag)
    np.testing.assert_allclose(
        np.sort_complex(display.poles["A - B K"]),
        np.sort_complex(np.linalg.eigvals(model.A_ - model.B_ @ K)),
    )
    radius = np.abs(np.linalg.eigvals(model.A_)).max()
    assert labels(display.ax_)[0] == f"A, once h is cancelled, radius {radius:.4g}"
    assert display.ax_.get_aspect() == 1.0
    far = PoleDisplay({"stable": np.array([0.5j, -0.5j]), "not": np.array([2.0])})
    assert far.plot().ax_.get_xlim() == pytest.approx((-2.2, 2.2))
    nothing = PoleDisplay({}).plot().ax_
    assert nothing.get_xlim() == pytest.approx((-1.1, 1.1))  # the unit circle


def test_singular_values(linear):
    display = SingularValuesDisplay.from_estimator(linear)
    line, chosen = display.ax_.lines
    np.testing.assert_array_equal(line.get_ydata(), linear.singular_values_)
    assert chosen.get_xdata()[0] == 2.5
    assert line.get_xdata()[0] == 1


def test_nonlinearity(model, data):
    _, y, _ = data
    display = NonlinearityDisplay.from_estimator(model, *data)
    law = model.linearizing_law()
    for j in range(2):
        s = np.tile(np.median(display.s, axis=0), (200, 1))
        s[:, j] = display.axes_[0, j].lines[0].get_xdata()
        h = -law(np.zeros((200, 2)), s)
        for i in range(2):
            drawn = display.axes_[i, j].lines[0].get_ydata()
            np.testing.assert_allclose(drawn, h[:, i], atol=1e-12)
    label = display.axes_[1, 0].get_xlabel()
    if law.feedback == "output":
        np.testing.assert_allclose(display.s, y.to_numpy())
        assert label == "flow [l/s] (gray: density of the data)"
    else:
        assert label == "x0 (gray: density of the data)"
    assert display.axes_[1, 0].get_ylabel() == "h, in units of heater [V]"


def test_what_g_leaves(model, data):
    display = ResidualNonlinearityDisplay.from_estimator(model, *data)
    record = model.linearizability(*data)
    # the display leaves out the samples that set the initial states
    np.testing.assert_allclose(display.share_, record.linearization_error, rtol=1e-12)
    left, right = display.axes_[1]
    counts = [patch.get_height() for patch in left.patches]
    assert sum(counts) == sum(len(e) for e in display.e) < 700
    f, amplitude = right.lines[1].get_data()
    assert f[-1] == pytest.approx(0.5 / DT)
    # Welch "spectrum" of the whole longest experiment: Hann has 1.5 bins of noise
    power = np.sum(amplitude**2) / 1.5
    assert power == pytest.approx(np.var(display.e[1][:, 1]), rel=0.5)
    assert left.get_xlabel() == "e, in units of temperature [K]"
    assert labels(right) == ["temperature [K]", "e"]


def test_a_model_on_one_figure(model, linear, data):
    data = part(data)
    parts = {  # below each other
        "simulation": SimulationDisplay,
        "residual": ResidualDisplay,
        "h": NonlinearityDisplay,
        "g": ResidualNonlinearityDisplay,
    }
    frames = plot_model(model, *data).subfigs
    for one, frame in zip(parts.values(), frames, strict=True):
        alone = one.from_estimator(model, *data).figure_
        for axes, ours in zip(alone.axes, frame.axes, strict=True):
            assert ours.get_ylabel() == axes.get_ylabel()
            for line, same in zip(axes.lines, ours.lines, strict=True):
                np.testing.assert_array_equal(line.get_ydata(), same.get_ydata())
    (only,) = plot_model(model, *data, parts=["h"]).subfigs
    assert only.get_suptitle() == "h, which the law cancels"
    assert len(plot_model(linear, *data).subfigs) == 2
    with pytest.raises(ValueError, match="some of simulation, residual for this model"):
        plot_model(linear, *data, parts=["g"])
    with pytest.raises(ValueError, match="at least one part"):
        plot_model(linear, *data, parts=[])


def make_path(**options):
    fields = {
        "gammas": np.array([10.0, 1.0, 0.1]),
        "models": (None, None, None),
        "rmse_train": np.array([3.0, 1.0, 0.9]),
        "rmse_test": np.array([3.0, 1.0, 0.9]),
        "linearization_error": np.array([0.01, 0.02, 0.5]),
        "spectral_radius": np.array([0.9, 0.9, 1.1]),
        "seconds": np.ones(3),
        **options,
    }
    return GammaPath(**fields)


def test_gamma_path():
    path = make_path()
    display = GammaPathDisplay.from_path(path)
    curve, knee = display.ax_.lines
    np.testing.assert_allclose(curve.get_xdata(), [1, 2, 50])
    np.testing.assert_array_equal(curve.get_ydata(), path.rmse_test)
    assert knee.get_ydata()[0] == path.rmse_test[path.knee()]
    assert [text.get_text() for text in display.ax_.texts] == ["10", "1", "0.1"]
    stable, unstable = display.ax_.collections
    assert len(stable.get_offsets()) == 2 and len(unstable.get_offsets()) == 1
    assert display.ax_.get_xscale() == display.ax_.get_yscale() == "log"


@pytest.mark.parametrize("of", ["states", "outputs"])
def test_certificate(model, data, of):
    certificate = model.iss_certificate(*data)
    display = CertificateDisplay.from_estimator(
        model, certificate, *data, pair=(1, 0), of=of
    )
    T = np.eye(2)[::-1] if of == "states" else model.C_[::-1]
    points = display.ax_.lines[0].get_xydata()
    # in the plane of all states the boundary has V = level
    x = np.linalg.solve(T, points.T).T
    V = np.einsum("ki,ij,kj->k", x, certificate.P, x)
    np.testing.assert_allclose(V, certificate.level)
    assert display.inside_ == 1.0  # eps is the largest omega along these very runs
    assert len(display.ax_.lines) == 3  # two experiments
    np.testing.assert_allclose(
        display.ax_.lines[2].get_xydata(), display.trajectories[1] @ T.T
    )
    name = "x1" if of == "states" else "temperature [K]"
    assert display.ax_.get_xlabel() == f"deviation of {name}"


def test_figures_of_loops_with_late_inputs_have_the_delay():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((300, 1))
    y = np.zeros((300, 1))
    for k in range(4, 300):
        y[k] = 0.9 * y[k - 1] + u[k - 4]
    model = LinearStateSpace(nx=1, input_delay=3).fit(u, y)
    K = 0.1 / model.B_
    certificate = model.iss_certificate(u, y, K=K)
    options = {"pair": (0, 3), "K": K}
    display = CertificateDisplay.from_estimator(model, certificate, u, y, **options)
    assert display.ax_.get_ylabel() == "deviation of x3"
    poles = PoleDisplay.from_estimator(model, K=K).poles["A - B K"]
    expected = np.roots([1, -model.A_[0, 0], 0, 0, 0.1])
    np.testing.assert_allclose(np.sort(np.abs(poles)), np.sort(np.abs(expected)))


def test_certificate_projects_more_states_than_it_shows():
    A = np.diag([0.8, 0.5, 0.2]) + 0.1
    certificate = alssnn.certificates.iss_certificate(A, eps=0.1)
    display = CertificateDisplay(certificate, np.eye(3)[[0, 2]], ["a", "b"]).plot()
    points = display.ax_.lines[0].get_xydata()
    axes = certificate.ellipse(0, 2)
    radius = np.linalg.norm(np.linalg.solve(axes, points.T), axis=0)
    np.testing.assert_allclose(radius, 1)
    assert display.inside_ is None


def test_loops():
    fast = control.ss([[0.5]], [[1.0]], [[1.0], [2.0]], 0, DT, outputs=["y", "u"])
    slow = control.ss([[0.8]], [[1.0]], [[1.0]], 0, DT, outputs=["y"])
    t = DT * np.arange(30)
    responses = {
        "design": control.forced_response(fast, t, np.ones(30)),
        "open loop": control.input_output_response(slow, t, np.ones(30)),
    }
    display = LoopDisplay.from_responses(responses, design="design")
    assert display.outputs == ["y"]
    k = np.arange(30)
    y = {"design": 2 * (1 - 0.5**k), "open loop": 5 * (1 - 0.8**k)}
    for line, expected in zip(display.axes_[0, 0].lines, y.values(), strict=True):
        np.testing.assert_allclose(line.get_xdata(), t)
        np.testing.assert_allclose(line.get_ydata(), expected)
    rms = np.sqrt(np.mean((y["design"] - y["open loop"]) ** 2))
    assert display.distance_["open loop"][0] == pytest.approx(rms)
    assert labels(display.axes_[0, 0])[1] == f"open loop, RMS from design {rms:.3g}"
    assert display.axes_[0, 0].lines[0].get_linestyle() == "--"
    # an output of the design alone is drawn without a distance
    display = LoopDisplay.from_responses(
        responses, outputs=["y", "u"], design="design", ranges={"u": (0.5, 1.5)}
    )
    above, below = display.axes_[:, 0]
    assert len(above.lines) == 2 and len(below.lines) == 1
    assert np.isfinite(display.distance_["open loop"]).tolist() == [True, False]
    band = below.patches[0].get_window_extent()
    low, high = below.transData.inverted().transform(band)[:, 1]
    assert (low, high) == pytest.approx((0.5, 1.5))
    assert not above.patches
    with pytest.raises(ValueError, match=r"`outputs` must .* \(u, y\), got w\."):
        LoopDisplay(responses, outputs=["y", "w"])
    with pytest.raises(ValueError, match="`design` must be one of design, open loop"):
        LoopDisplay(responses, design="other")
    with pytest.raises(ValueError, match="`responses` must hold at least one"):
        LoopDisplay({})


# -- wrong arguments -------------------------------------------------------------------


def test_wrong_arguments(model, linear, data):
    u, y, _ = data
    good = model.iss_certificate(*data)
    bad = alssnn.certificates.iss_certificate([[1.1]])
    given = fit(LinearStateSpace(nx=2, linear_start=linear.to_statespace()), data)
    S, B, C = SimulationDisplay, BodeDisplay, CertificateDisplay
    cases = [
        (lambda: S.from_estimator(model, *data, which=2), "`which` must be between 0"),
        (lambda: S.from_predictions([1, 2], [1, 2, 3]), "`y_true` and `y_pred` must"),
        (lambda: S.from_predictions([1], [1]), "`y_true` must have shape"),
        (
            lambda: S.from_predictions([1, 2], [1, 2], output_names=["a", "b"]),
            "`output_names` must have one name per signal",
        ),
        (lambda: B.from_estimator(model, [[1, 2, 3]]), "`amplitudes` must have shape"),
        (lambda: B.from_estimator(model, band=(1, 2)), "`band` must hold frequencies"),
        (lambda: PoleDisplay.from_estimator(model, K=[[1]]), "`K` must be a finite"),
        (
            lambda: C.from_estimator(model, good, *data, K=[[1]]),
            "`K` must be a finite matrix",
        ),
        (
            lambda: SingularValuesDisplay.from_estimator(given),
            "`model` must have singular values",
        ),
        (
            lambda: NonlinearityDisplay.from_estimator(linear, u, y),
            "`model` must have a network h",
        ),
        (
            lambda: C.from_estimator(model, good, *data, pair=(0, 2)),
            "`pair` must be two different states below 2",
        ),
        (lambda: C.from_estimator(model, good, *data, of="u"), "`of` must be 'states'"),
        (lambda: C(bad, [[1], [1]], ["a", "b"]), "`certificate` must hold"),
        (lambda: C(good, np.eye(3), ["a", "b"]), r"`T` must have shape \(2, 2\)"),
        (
            lambda: GammaPathDisplay.from_path(make_path(rmse_test=np.full(3, np.inf))),
            "`path` must have a model whose simulation is finite",
        ),
    ]
    for call, message in cases:
        with pytest.raises(ValueError, match=message):
            call()
