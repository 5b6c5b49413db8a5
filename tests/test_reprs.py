"""What a terminal and a notebook show: short, and what matters."""

import inspect
import pkgutil
import warnings
from html.parser import HTMLParser
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from sklearn.base import clone

import alssnn
from alssnn import LinearStateSpace, feedback, plotting
from alssnn.certificates import error_gain
from alssnn.datasets import make_pendulum
from alssnn.model_selection import gamma_path, law_rates
from alssnn.persistence import Fmu
from alssnn.report import Summary
from models import al_ssnn, fit, record

LINE = 400  # characters of a repr of one line
TABLE = 2600  # of one of several, which is a table
SMALL = {"max_iter": 3, "tol": 1e-2, "random_state": 0, "dt": 0.05}


@pytest.fixture(scope="module")
def model():
    data = make_pendulum(400, noise=0.01, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return al_ssnn(nx=2, n_h=8, n_g=8, **SMALL).fit(*data)


@pytest.fixture(scope="module")
def objects(model, roughly):
    """Return what users get in their hands, most of it from a fitted model."""
    data = make_pendulum(400, noise=0.01, random_state=0)
    with warnings.catch_warnings(), roughly():
        warnings.simplefilter("ignore")
        linear = LinearStateSpace(nx=2, dt=0.05).fit(*data)
        covariance = linear.parameter_covariance(*data)
        ladder = alssnn.model_ladder(*data, nx=2, dt=0.05, models=["lti"])
        path = gamma_path(clone(model), *data, gammas=[10, 0.1])
        controller = model.controller()
        mpc = model.mpc(horizon=5)
        runs = [c.simulate(model, np.full((50, 1), 0.1)) for c in (controller, mpc)]
        validation = model.validate(*data)
        linearizability = model.linearizability(*data)
        flow = alssnn.FlSsnn(nx=2, n_h=2, n_init=1, time="continuous", alpha=0.0)
        flow = flow.set_params(**SMALL).fit(*data)
        comparison = alssnn.compare([model, linear], *data)
        tube = linear.tube(*data)
        page = alssnn.look(*data)
        response = alssnn.nonparametric.local_polynomial(*data, dt=0.05)
        return [
            data,
            model,
            linear,
            alssnn.FlSsnn(),
            alssnn.GrSsnn(),
            model.plant_,
            model.plant_.region,
            model.plant_.lure,
            model.fitted_,
            model.fitted_.structure,
            model.linearizing_law(u_min=-1, u_max=[2.0]),
            model.observer(gate=10),
            feedback.DisturbanceObserver(model),
            feedback.what_is_missed(model.plant_, model.prepare_records(*data)),
            feedback.design_distance(model, model.prepare_records(*data)),
            controller,
            controller.linear,
            controller.info_,
            mpc,
            mpc.info_,
            *runs,
            runs[0].plot(),
            model.to_nlsys(),
            str(model.to_nlsys()),
            feedback.closed_loop(model, controller),
            model.iss_certificate(*data),
            model.gain_certificate(),
            linear.local_certificate(),
            linear.controller().certificate(),
            alssnn.certificates.peaks(*linear.plant_.linear()),
            tube,
            tube.around(data.u[:3]),
            tube.with_bound(0.1),
            error_gain(linear, *data),
            covariance,
            covariance.frequency_response(),
            covariance.poles(),
            ladder,
            ladder["LTI"],
            path,
            validation,
            validation["free run"],
            alssnn.validation.residual_tests(
                alssnn.validation.scored_experiments(model, *data)[0]
            ),
            alssnn.validation.feedback_tests(
                alssnn.validation.scored_experiments(model, *data)[0]
            ),
            alssnn.validation.ahead_fit(model, *data),
            alssnn.validation.loop_deviation(model, *data)[0],
            linearizability,
            linearizability.bands,
            law_rates(flow, *data, law_dt=[0.1, 0.05]),
            flow.plant_.rates,
            model.prepare_records(*data)[0],
            comparison,
            comparison.rows[0],
            comparison.plot(),
            comparison.plot_bode(),
            model.summary(*data),
            page,
            page.findings[0],
            page.recommendation,
            response,
            response.plot(),
            model.history_[0],
            alssnn.excitation.prbs(7),
            Fmu(Path("plant.fmu"), "3.0", "binaries/plant.so", ""),
            plotting.SimulationDisplay.from_estimator(model, *data),
        ]


def test_reprs_are_short(objects):
    for one in objects:
        text = one if isinstance(one, str) else repr(one)
        limit = LINE if "\n" not in text else TABLE
        assert len(text) <= limit, (type(one).__name__, len(text))
        assert " at 0x" not in text, text
        assert max(map(len, text.splitlines())) <= LINE
        assert len(str(one)) <= TABLE


# what nobody has in his hands, what tests of its own have, and what holds no numbers
LEFT_OUT = {
    # of the declaration of a structure
    *("AtRest", "Diagonal", "Factor", "Matrix", "Networks", "Signal"),
    "Term",
    "Activation",
    "Identity",
    "Remote",
    "Scorer",
    "BlockedTimeSeriesSplit",
    "ExperimentKFold",
}


def test_no_public_class_is_forgotten(objects):
    """A class that a page of the reference names is walked, or is left out by name."""
    seen = {base.__name__ for one in objects for base in type(one).__mro__}
    public = set()
    for module in pkgutil.iter_modules(alssnn.__path__):
        if module.name.startswith("_") or module.name == "cli":
            continue
        package = import_module(f"alssnn.{module.name}")
        public |= {
            name
            for name in getattr(package, "__all__", ())
            if inspect.isclass(getattr(package, name))
        }
    public |= {
        name for name in alssnn.__all__ if inspect.isclass(getattr(alssnn, name))
    }
    missing = {
        name
        for name in public - seen - LEFT_OUT
        if not name.endswith("Display") and not name.endswith("Error")
    }
    assert not missing


def test_all_displays_show_themselves():
    for name in plotting.__all__:
        if name.endswith("Display"):
            assert hasattr(getattr(plotting, name), "_repr_png_"), name


def test_displays_are_pictures_in_a_notebook(model):
    data = make_pendulum(400, noise=0.01, random_state=0)
    display = plotting.SimulationDisplay.from_estimator(model, *data)
    assert display._repr_png_().startswith(b"\x89PNG")
    assert repr(display) == "SimulationDisplay(2 axes)"
    assert plotting.RecordDisplay(data)._repr_png_() is None
    assert repr(plotting.RecordDisplay(data)) == "RecordDisplay(not drawn)"


# -- the summary -----------------------------------------------------------------------


class Balanced(HTMLParser):
    """Check that what is opened is closed."""

    def __init__(self):
        super().__init__()
        self.open, self.text = [], []

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def test_the_summary_says_what_the_model_is(model):
    data = make_pendulum(400, noise=0.01, random_state=1)
    lines = dict(model.summary(*data).lines)
    assert not np.any(model.params_["W_h"])  # so few steps leave it linear
    assert lines["equation"] == "x+ = A x + B du"
    assert lines["states"] == "2" and lines["dt"] == "0.05 s"
    assert lines["parameters"] == str(model.fitted_.free.sum())
    y_true, y_hat = model.simulate_test(*data)
    error = np.sqrt(np.mean((y_true - y_hat) ** 2))
    assert lines["test RMSE"].startswith(f"{error:.3g}, ")
    share = model.linearizability(*data).linearization_error[0]
    assert lines["e / y"].startswith(f"{100 * share:.3g} % along the record")
    missed = 100 * np.sqrt(1 - model.train_score_)
    assert lines["train"] == f"misses {missed:.3g} % of the output"
    assert lines["training"].endswith(model.message_)
    assert lines["training"].startswith("not settled") != model.converged_
    radius = np.abs(np.linalg.eigvals(model.A_)).max()
    assert float(lines["|poles|"].split(", ")[0]) == pytest.approx(radius, rel=1e-3)
    assert "summary(u, y)" in dict(model.summary().lines)["test, e / y"]
    with pytest.raises(ValueError, match="`u` and `y` must be given together"):
        model.summary(data.u)


def test_several_outputs_have_a_line_each():
    model = fit(LinearStateSpace(nx=3), 2, 2)
    text = str(model.summary(*record(2, 2)))
    assert text.count("flow: ") == 2 and "inputs      valve.a, p*/" in text


def test_a_notebook_shows_summary_and_diagram(model):
    html = model._repr_mimebundle_()["text/html"]
    table, diagram = html[: html.index("</table>") + 8], html
    parser = Balanced()
    parser.feed(table)
    assert not parser.open and "misses" in " ".join(parser.text)
    assert "sk-estimator" in diagram or "sk-container" in diagram
    assert "<table><caption>" not in LinearStateSpace()._repr_html_()
    name = Summary("<b>", (("a", "<script>"),)).to_html()
    assert "<script>" not in name and "<b>" not in name
