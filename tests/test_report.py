"""The report: one page, valid, complete, without network, with every name escaped."""

import json
import re
from copy import deepcopy
from functools import cache
from html.parser import HTMLParser

import numpy as np
import pytest
from test_extending import SOFTSIGN

import browser
from alssnn import LinearStateSpace, __version__, load
from alssnn.activations import ACTIVATIONS
from alssnn.datasets import make_inverted_pendulum
from alssnn.estimators._fitted import publish_parameters
from alssnn.feedback import (
    balanced_weights,
    closed_loop,
    designed_loop,
    input_range,
    lqi,
    step_comparison,
)
from alssnn.plotting import (
    BodeDisplay,
    LoopDisplay,
    NonlinearityDisplay,
    ResidualNonlinearityDisplay,
    SimulationDisplay,
    figure_curves,
)
from alssnn.report import model_steps
from alssnn.report._control import controller
from alssnn.split import as_trained
from exported import NAMES, make_plant, signals
from helpers import simulate_linear
from models import al_ssnn, fl_ssnn, gr_ssnn

SECTIONS = {
    "summary",
    "equations",
    "accuracy",
    "validation",
    "linearizability",
    "certificates",
    "control",
}
VOID = {"meta", "img", "br", "hr", "link", "input"}
SVG = "http://www.w3.org/2000/svg"  # a name, not an address
SHOWN_SECTIONS = """[...document.querySelectorAll("section")]
    .filter(s => s.getBoundingClientRect().height > 50).map(s => s.id)"""
BROKEN_IMAGES = "[...document.images].filter(i => !i.naturalWidth).length"
DRAWN = """[...document.querySelectorAll("figure.curves .plots svg[role] path")]
    .filter(path => path.getTotalLength() > 50).length"""
PAPER = "getComputedStyle(document.body).backgroundColor"
PAPERS = {"light": "rgb(255, 255, 255)", "dark": "rgb(22, 24, 26)"}
ZOOM = """(() => {
  const figure = document.querySelector("figure.curves");
  const svg = figure.querySelector("svg[role]"), {left, top, width} =
    svg.getBoundingClientRect();
  const ticks = () => [...svg.querySelectorAll("text")].map(t => t.textContent).join();
  const point = (kind, share) => svg.dispatchEvent(new PointerEvent(kind,
    {clientX: left + share * width, clientY: top + 20, pointerId: 1, bubbles: true}));
  svg.setPointerCapture = () => {};  // there is no true pointer
  const before = ticks();
  point("pointerdown", 0.4);
  point("pointermove", 0.6);
  const said = figure.querySelector(".readout").textContent;
  point("pointerup", 0.6);
  const after = ticks();
  svg.dispatchEvent(new MouseEvent("dblclick", {bubbles: true}));
  return [before, after, ticks(), said];
})()"""
HOSTILE = ["<script>alert(1)</script>", 'a"&b']

pytestmark = pytest.mark.filterwarnings(
    "ignore::sklearn.exceptions.ConvergenceWarning",
    "ignore:X does not have valid feature names",  # named after the fit
)


class Checker(HTMLParser):
    """Collect what a page has, and what is wrong with its tags."""

    def __init__(self):
        super().__init__()
        self.open, self.faults, self.sections = [], [], set()
        self.tags, self.links, self.metas, self.text = {}, [], [], []

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.tags[tag] = self.tags.get(tag, 0) + 1
        self.links += [attrs[name] for name in ("src", "href") if name in attrs]
        if tag == "section":
            self.sections.add(attrs["id"])
        if tag == "meta":
            self.metas.append(attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.faults.append(tag)

    def handle_data(self, data):
        self.text.append(data)


def check(path):
    text = path.read_text(encoding="utf-8")
    checker = Checker()
    checker.feed(text)
    checker.close()
    assert checker.faults == [] and checker.open == []
    assert checker.sections == SECTIONS
    assert all(
        link.startswith(("#", "data:image/png;base64,")) for link in checker.links
    )
    assert not re.search(r"https?:|url\(|@import|<script [^t]", text.replace(SVG, ""))
    assert checker.tags["script"] == 1 + text.count('<figure class="curves">')
    for curves in re.findall(r'<script type="application/json">(.*?)</script>', text):
        assert all(
            len(one["x"]) for panel in json.loads(curves) for one in panel["series"]
        )
    assert "`" not in re.sub("(?s)<script.*?</script>", "", text)
    assert {"name", "content"} <= set(checker.metas[1])
    assert checker.metas[1]["content"].startswith("width=device-width")
    assert checker.tags["table"] == text.count('<div class="scroll"><table')
    return checker, " ".join(checker.text)


def plant(n=700, seed=0):
    """Return a record of a plant with two inputs and outputs, coupled."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((n, 2))
    A = np.array([[0.8, 0.1], [-0.1, 0.7]])
    bent = u + 0.2 * np.tanh(u[:, ::-1])
    y = simulate_linear(A, np.array([[0.3, 0.1], [0.0, 0.4]]), np.eye(2), bent)
    y += 0.01 * rng.standard_normal(y.shape)
    return u, y, np.repeat(["a", "b"], [n // 2, n - n // 2])


RECORD, TEST = plant(), plant(seed=1)
PART = tuple(z[230:470] for z in TEST)  # of both experiments, where the words matter
OPTIONS = {"dt": 0.1, "max_iter": 8, "n_init_samples": 20}
MODELS = {
    "lti": LinearStateSpace(nx=2, **OPTIONS),
    "fl": fl_ssnn(nx=2, n_h=3, random_state=0, **OPTIONS),
    "al": al_ssnn(nx=2, n_h=(2, 3), n_g=3, feedback="state", random_state=0, **OPTIONS),
    "gr": gr_ssnn(nx=2, n_f=3, random_state=0, **OPTIONS),
    "feedthrough": al_ssnn(
        nx=2, n_h=2, n_g=2, n_k=2, feedthrough=True, random_state=0, **OPTIONS
    ),
    "delay": fl_ssnn(nx=2, n_h=2, input_delay=[0, 2], random_state=0, **OPTIONS),
}


@cache
def fitted(name):
    """Return a fitted model, which no test changes."""
    return MODELS[name].fit(*RECORD)


@cache
def verdict(name):
    """Return what is found of a fitted model on the test."""
    return fitted(name).validate(*TEST)


@pytest.fixture(scope="module", autouse=True)
def hardly_any_search(roughly):
    """Bound the loop roughly, which no page has to know exactly."""
    with roughly():
        yield


@pytest.fixture(scope="module")
def boiler(tmp_path_factory):
    """Return the page of a model that has a law, with a name and a source."""
    path = tmp_path_factory.mktemp("boiler") / "report.html"
    about = {"name": "Boiler <4>", "source": "Model b.npz, record c.csv"}
    fitted("fl").report(path, *TEST, **about)
    return path


@pytest.mark.parametrize("name", MODELS)
def test_page_is_complete_and_stands_alone(name, request, tmp_path):
    model = fitted(name)
    if name not in ("al", "gr"):
        request.getfixturevalue("undrawn")  # the same displays
    path = tmp_path / "report.html"
    model.report(path, *TEST, train=RECORD)
    checker, text = check(path)
    assert type(model).__name__ in text
    for matrix, values in (("A", model.A_), ("C", model.C_)):
        assert f"{matrix} = np.array({values.tolist()!r})" in text  # exact to the bit
    for check_ in verdict(name):
        assert check_.sentence.replace("`", "") in "".join(checker.text)
    assert "training" in text and "this record" in text
    assert checker.tags["img"] >= 2
    assert all(0 < len(link) < 2_000_000 for link in checker.links)
    assert ("u = v - h(" in text) == model.plant_.cancels


def test_the_page_begins_with_its_origin_and_the_verdict(boiler):
    text = " ".join(check(boiler)[1].split())
    origin = f"Model b.npz, record c.csv. Written by alssnn {__version__} on 20"
    places = ["Boiler <4>: report", origin, verdict("fl").verdict]
    places += ["On this record the simulation misses", "In training it missed"]
    places += ["Errors of the free-run simulation", "response of (A, B, C) once h"]
    places += ["Copy the gain as Python", "Copy all numbers as Python"]
    at = [text.index(words) for words in places]
    assert at == sorted(at)


def test_inputs_beyond_the_training_data_are_said(boiler):
    model = fitted("fl")
    low, high = input_range(model)
    u = step_comparison(model, lqi(model, *balanced_weights(model)))["model"].outputs[
        4:
    ]
    beyond = (u.min(axis=1) < low) | (u.max(axis=1) > high)
    text = check(boiler)[1]
    for i, left in enumerate(beyond):
        assert (f"u{i} goes from" in text) == left


def test_a_design_that_leaves_the_data_says_so_before_its_gain(undrawn):
    rng = np.random.default_rng(0)
    u = rng.standard_normal((400, 1))  # moves fast, and slow steps take more of it
    y = simulate_linear(np.array([[-0.95]]), np.eye(1), np.eye(1), u)
    model = LinearStateSpace(nx=1, integrators=0).fit(u, 3.0 * y)
    page = controller(model)
    said = page.index("In the step below, u0 goes from")
    assert page.index("This is a proposal to begin with.") < said
    assert said < page.index("Copy the gain as Python")


def test_a_gain_stays_where_its_step_cannot_be_drawn(undrawn, monkeypatch):
    def refuse(*_):
        raise ValueError("no such axes")

    monkeypatch.setattr(LoopDisplay, "from_steps", refuse)
    page = controller(fitted("lti"))
    assert "Step response: not available. no such axes" in page
    assert "Copy the gain as Python" in page and "In the step below" not in page


def test_curves_of_long_records_keep_their_extremes():
    rng = np.random.default_rng(0)
    y = rng.standard_normal(50_000)
    y[31_234], y[100] = 9.0, np.nan
    drawn = SimulationDisplay.from_predictions(y, 0 * y, dt=0.5)
    above, below = json.loads(figure_curves(drawn.figure_))
    measured, simulated = above["series"]
    assert len(measured["x"]) <= 6_000
    assert measured["y"][measured["x"].index(31_234 * 0.5)] == 9.0
    assert max(z for z in measured["y"] if z is not None) == 9.0
    assert measured["name"] == "measured" and simulated["name"].startswith("simulated")
    assert below["ylabel"] == "residual of y0" and below["xlabel"] == "time, s"


def test_curves_of_networks_have_densities_and_logarithms():
    model = fitted("al")
    law = NonlinearityDisplay.from_estimator(model, *TEST)
    panels = json.loads(figure_curves(law.figure_))
    assert len(panels) == law.axes_.size  # the axes of the densities are in them
    for panel, axes in zip(panels, law.axes_.ravel(), strict=True):
        density, curve = panel["series"]
        assert (density["kind"], density["name"]) == ("band", "density")
        low, high = axes.get_ylim()
        size = high - low
        np.testing.assert_allclose(density["y"], low, rtol=1e-4, atol=1e-4 * size)
        assert low + 0.5 * size < max(density["high"]) <= high + 1e-4 * size
        np.testing.assert_allclose(
            curve["y"], axes.get_lines()[0].get_ydata(), rtol=1e-4
        )
    rest = ResidualNonlinearityDisplay.from_estimator(model, *TEST)
    left, right = json.loads(figure_curves(rest.figure_))[:2]
    (counts,) = left["series"]
    assert sum(counts["high"][::2]) == sum(map(len, rest.e))
    assert "rms(e)" in counts["name"]
    assert right["xlog"] and right["ylog"] and not left["xlog"]
    line = rest.axes_[0, 1].get_lines()[0]
    found = 10.0 ** np.array(right["series"][0]["x"])
    np.testing.assert_allclose(found, line.get_xdata(), rtol=1e-5)


def test_bands_and_levels_stand_on_logarithmic_axes_as_curves_do():
    f = np.array([0.1, 1.0, 10.0])
    G = np.array([10.0, 1.0, 0.1])[:, None, None]
    display = BodeDisplay(f, G, ["u"], ["y"], band=(f, 0.5 * G, 2 * G)).plot()
    display.axes_[0, 0].axhline(100.0)
    band, curve, level = json.loads(figure_curves(display.figure_))[0]["series"]
    assert level["x"] == [-1, 1] and level["y"] == [2, 2]
    assert band["x"] == curve["x"] == [-1, 0, 1] and curve["y"] == [1, 0, -1]
    np.testing.assert_allclose(band["y"], np.log10(0.5) + np.array([1, 0, -1]), 1e-4)
    np.testing.assert_allclose(band["high"], np.log10(2) + np.array([1, 0, -1]), 1e-4)


def test_numbers_of_the_page_are_those_of_the_model(boiler):
    model = fitted("fl")
    _, text = check(boiler)
    y_true, y_pred = model.simulate_test(*TEST)
    rmse = np.sqrt(np.mean((y_true - y_pred) ** 2, axis=0))
    assert all(f"{value:.3g}" in text for value in rmse)
    code = re.findall(r"K = np\.array\((.*?)\)\s", text)[-1]
    K = lqi(model, *balanced_weights(model))
    np.testing.assert_array_equal(np.array(eval(code)), K)
    assert f"{model.gain_certificate().gamma:.3g}" in text
    assert f"{model.iss_certificate(*TEST).psi:.3g}" in text


def test_names_are_escaped(tmp_path, undrawn):
    model = deepcopy(fitted("fl"))
    model.feature_names_in_ = np.array(HOSTILE, dtype=object)
    model.output_names_ = [name + "y" for name in HOSTILE]
    path = tmp_path / "report.html"
    model.report(path, *PART)
    _, text = check(path)
    assert all(name in text for name in [*HOSTILE, *model.output_names_])
    assert HOSTILE[0] not in path.read_text(encoding="utf-8")


def test_what_cannot_be_computed_says_why(tmp_path, undrawn):
    model = fitted("feedthrough")
    path = tmp_path / "report.html"
    model.report(path, *PART)
    assert "algebraic loop" in check(path)[1]
    short = [z[:60] for z in TEST[:2]]
    model.report(path, *short)  # too short for the lags of the tests
    assert "too short for tests of residuals" in check(path)[1]


def test_a_failed_model_is_not_praised(tmp_path, undrawn):
    model = fitted("fl")
    u, y, runs = PART
    rng = np.random.default_rng(0)
    spoiled = 3 * rng.standard_normal(y.shape)
    assert not model.validate(u, spoiled, runs).passed
    model.report(tmp_path / "report.html", u, spoiled, runs)
    text = " ".join(check(tmp_path / "report.html")[1].split())
    assert "Do not use this design on the plant. The model fails: free run" in text
    assert "is nearly (A, B, C)" not in text and " Holds. " not in text
    assert "Conditional: holds while |omega|, what the linear part lacks of" in text
    assert "Holds for the model, not for the plant." in text


def test_an_unstable_model_is_not_called_no_linear_one(tmp_path, undrawn):
    record = make_inverted_pendulum(800, random_state=0)
    model = fl_ssnn(
        nx=2, n_h=3, noise="innovations", dt=record.dt, max_iter=8, random_state=0
    ).fit(record.u, record.y)
    linear = model.validate(record.u, record.y)["linearizability"]
    assert (
        not (linear.passed or linear.decides) and "spectral radius" in linear.sentence
    )
    model.report(tmp_path / "report.html", record.u, record.y)
    text = " ".join(check(tmp_path / "report.html")[1].split())
    assert "is not linearizable" not in text  # h is all that it has
    assert "How linear the model is was not judged. The spectral radius of A is" in text
    assert "|g|, mean 0 " in text and "H2 gain" not in text  # there is no g


def test_the_error_of_the_loop_is_relative_to_its_linear_response(boiler):
    text = " ".join(check(boiler)[1].split())
    assert "relative to the linear response to v, rms(e) / std(y_lin)." in text


def test_a_law_of_nothing_has_no_figure(tmp_path, undrawn):
    model = deepcopy(
        fitted("fl")
    )  # as a search returns it, whose networks did not help
    structure, theta = as_trained(model._structure, model._theta)
    for name in structure.network_parameters:
        theta[structure.slices[name]] = 0.0
    model._structure, model._theta = structure, theta
    publish_parameters(model)
    assert not model.plant_.cancels
    model.report(tmp_path / "report.html", *PART)
    assert "Figure of h" not in check(tmp_path / "report.html")[1]


def test_disturbances_of_a_bound_are_told(tmp_path, undrawn):
    u, y, runs = (z[230:470] for z in RECORD)
    model = LinearStateSpace(nx=2, disturbances=[1], **OPTIONS).fit(u, y, runs)
    model.report(tmp_path / "report.html", u, y, runs)
    text = " ".join(check(tmp_path / "report.html")[1].split())
    assert "input v of this size, with measured disturbances within theirs" in text
    assert "largest input for u0, around the operating point" in text
    assert "largest disturbance u1, around the operating point" in text
    assert "|Ax+Bu+Gd|, mean" in text and "|Ax+Bu|" not in text
    assert "spectral radius of A" in text  # discrete: of the A that is printed


def test_a_solver_that_breaks_down_decides_nothing(tmp_path, undrawn, monkeypatch):
    model = fitted("fl")

    def solve(*_, **__):
        raise RuntimeError("The solver CLARABEL broke down.")

    monkeypatch.setattr("alssnn.certificates._gain.smallest_gain", solve)
    certificate = model.gain_certificate()
    assert certificate.verdict == "undecided" and "undecided" in repr(certificate)
    assert "does not hold" not in repr(certificate)
    model.report(tmp_path / "report.html", *PART)
    text = " ".join(check(tmp_path / "report.html")[1].split())
    assert "Undecided. The solver CLARABEL broke down." in text
    assert "Does not hold. The solver" not in text


def test_wrong_arguments(tmp_path):
    model = fitted("lti")
    with pytest.raises(ValueError, match="`train` must be a Record"):
        model.report(tmp_path / "r.html", *TEST, train=(1,))
    with pytest.raises(ValueError, match="feature"):
        model.report(tmp_path / "r.html", TEST[0][:, :1], TEST[1])
    assert not (tmp_path / "r.html").exists()


@pytest.mark.parametrize(
    "name",
    [
        "fl",
        pytest.param("al", marks=pytest.mark.slow),
        pytest.param("delay", marks=pytest.mark.slow),
    ],
)
def test_a_browser_shows_the_page(tmp_path, boiler, name):
    if browser.find() is None:
        pytest.skip(f"none of {', '.join(browser.NAMES)} is installed")
    path = boiler
    if name != "fl":
        path = tmp_path / f"{name}.html"
        fitted(name).report(path, *TEST)
    with browser.Browser(tmp_path / "profile") as window:
        looks = [(375, "light"), (390, "dark"), (1280, "light"), (1100, "dark")]
        for width, scheme in looks:
            window.prefer(scheme)
            window.open(path, width)
            assert window.evaluate(DRAWN) >= 2
            assert window.evaluate(PAPER) == PAPERS[scheme]
            sections = window.evaluate(SHOWN_SECTIONS)
            assert set(sections) == SECTIONS
            assert window.evaluate("document.documentElement.scrollWidth") == width
            assert window.overflowing() == []
            assert window.complaints() == []
            asked = window.requests()
            assert asked.count(path.as_uri()) == 1  # so that requests are seen
            assert all(a.startswith(("file:", "data:")) for a in asked)
            assert window.evaluate(BROKEN_IMAGES) == 0
        before, after, again, said = window.evaluate(ZOOM)
        assert after != before == again
        assert said.startswith("time, s: ") and "measured: " in said


def test_the_browser_sees_what_is_wrong(tmp_path):
    if browser.find() is None:
        pytest.skip(f"none of {', '.join(browser.NAMES)} is installed")
    path = tmp_path / "wrong.html"
    path.write_text(
        '<!DOCTYPE html><meta name="viewport" content="width=device-width"><body>'
        '<p style="width: 500px">wide</p><script>console.error("no")</script>'
        '<img src="http://127.0.0.1:9/no.png">'
    )
    with browser.Browser(tmp_path / "profile") as window:
        window.open(path, 375)
        assert any("wide" in node for node in window.overflowing())
        assert window.complaints()
        assert "http://127.0.0.1:9/no.png" in window.requests()
        assert window.evaluate(BROKEN_IMAGES) == 1


def test_missing_outputs_and_experiments_are_told(tmp_path, undrawn):
    model = fitted("delay")
    u, y, runs = PART
    y = y.copy()
    y[::4, 1] = np.nan
    model.report(tmp_path / "report.html", u, y, runs)
    _, text = check(tmp_path / "report.html")
    assert "not measured" in text and "y0 0 %, y1 25 %" in text
    assert "in the first of 2 experiments alone" in text
    assert "u1 arrives 2 samples late" in text


# the proposal


def test_balanced_weights_do_not_depend_on_units():
    u, y, runs = RECORD
    factor = np.array([10.0, 0.1])
    one = LinearStateSpace(nx=2, **OPTIONS).fit(u, y, runs)
    two = LinearStateSpace(nx=2, **OPTIONS).fit(factor * u, y / factor, runs)
    poles = [
        np.sort_complex(
            designed_loop(m, lqi(m, *balanced_weights(m, state=0.1))).poles()
        )
        for m in (one, two)
    ]
    np.testing.assert_allclose(*poles, rtol=1e-6)


def test_larger_weights_of_integrators_are_faster():
    model = fitted("lti")
    radius = [
        np.abs(
            designed_loop(
                model, lqi(model, *balanced_weights(model, integral=q))
            ).poles()
        ).max()
        for q in (1e-3, 1e-1)
    ]
    assert radius[1] < radius[0] < 1


def test_exactly_linearizable_models_follow_the_design():
    model = fitted("fl")
    K = lqi(model, *balanced_weights(model))
    step = [0.5, -0.2]
    responses = step_comparison(model, K, step=step)
    design, whole = responses["design"], responses["model"]
    assert design.output_labels == ["y[0]", "y[1]", "v[0]", "v[1]"]
    assert whole.output_labels == [*design.output_labels, "u[0]", "u[1]"]
    np.testing.assert_allclose(whole.outputs[:4], design.outputs, atol=1e-8)
    # the plant, fed with u alone, gives the outputs that were reached
    y = model.predict(whole.outputs[4:].T, x0=np.zeros((1, model.nx_)))
    np.testing.assert_allclose(y.T, whole.outputs[:2], atol=1e-8)
    np.testing.assert_allclose(whole.outputs[:2, -1], model.y_offset_ + step, atol=0.02)
    assert closed_loop(model, model, K).ninputs == 2


def test_limits_of_the_law_keep_the_model_from_the_design():
    model = fitted("fl")
    K = lqi(model, *balanced_weights(model, integral=1.0, control=0.01))
    law = model.linearizing_law(-0.2, 0.2)
    responses = step_comparison(model, K, law=law, n_samples=50)
    design, whole = (responses[name].outputs[:2] for name in ("design", "model"))
    assert np.abs(design - whole).max() > 0.1
    u = responses["model"].outputs[4:]
    assert np.abs(u).max() == pytest.approx(0.2)


def test_the_range_of_the_inputs_is_that_of_the_data(tmp_path):
    u, y, runs = RECORD
    factor = np.array([10.0, 0.1])
    model = LinearStateSpace(nx=2, **OPTIONS).fit(factor * u + 3.0, y, runs)
    model.save(tmp_path / "model.npz")
    for one in (model, load(tmp_path / "model.npz")):
        low, high = input_range(one)
        np.testing.assert_allclose(low, 3.0 + factor * u.min(axis=0), rtol=1e-9)
        np.testing.assert_allclose(high, 3.0 + factor * u.max(axis=0), rtol=1e-9)


def test_weights_of_many_states_are_exactly_symmetric():
    rng = np.random.default_rng(0)
    A = 0.9 * np.linalg.qr(rng.standard_normal((9, 9)))[0]
    u = rng.standard_normal((600, 2))
    y = simulate_linear(
        A, rng.standard_normal((9, 2)), rng.standard_normal((2, 9)), u
    ) + 0.01 * rng.standard_normal((600, 2))
    Q, _ = balanced_weights(LinearStateSpace(nx=9, max_iter=3).fit(u, y))
    np.testing.assert_array_equal(Q, Q.T)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"integral": 0.0}, "`integral` must be positive and finite, got 0.0"),
        ({"output": -1.0}, "`output` must be nonnegative and finite, got -1.0"),
        ({"control": np.inf}, "`control` must be positive and finite, got inf"),
    ],
)
def test_wrong_weights(options, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        balanced_weights(fitted("lti"), **options)


def test_wrong_steps():
    model = fitted("lti")
    K = lqi(model, *balanced_weights(model))
    with pytest.raises(ValueError, match="columns for integrators"):
        step_comparison(model, K[:, :2])
    with pytest.raises(ValueError, match="one finite number per output"):
        step_comparison(model, K, step=[1.0, 2.0, 3.0])
    for n_samples in (1, 2.5):
        with pytest.raises(ValueError, match="`n_samples` must be at least 2 and an"):
            step_comparison(model, K, n_samples=n_samples)


@pytest.mark.parametrize("name", NAMES)
def test_the_steps_of_the_page_compute_the_model(name):
    """Every line is a formula over the numbers that are printed with it."""
    plant = make_plant(name)
    lines, arrays = model_steps(plant)
    x, u, s = (z[0] for z in signals(plant))
    x = x[: plant.nx]
    values = {"x": x, "du": u, "s": s}
    for line in lines:
        left, _, right = line.partition(" = ")
        right = re.sub(r"(\w+) (x|du|s|\w*w\d+)\b", r"\1 @ \2", right)
        scope = {**arrays, **values, **{a.name: a.value for a in ACTIVATIONS.values()}}
        values[left] = eval(right, {"softsign": SOFTSIGN.value}, scope)
    if not plant.form.nw:
        assert not lines
        return
    form = plant.arrived()
    at = u + plant.u_offset
    np.testing.assert_allclose(values["x+"], form.step(x, at), rtol=1e-12, atol=1e-13)
    y = form.output(x, at) - plant.y_offset
    np.testing.assert_allclose(values["y - y_e"] + np.zeros(plant.ny), y, atol=1e-13)
    if plant.cancels:
        measured = s + (plant.y_offset if plant.feedback == "output" else 0)
        v = u + plant.cancelled(measured, at)
        np.testing.assert_allclose(values["v - u_e"], v, atol=1e-13)


def test_settings_that_are_pairs_of_unequal_length(tmp_path, undrawn, rng):
    u = rng.standard_normal((200, 2))
    y = np.convolve(u.sum(axis=1), 0.5 ** np.arange(20))[:200]
    model = LinearStateSpace(nx=1, operating_point=([0, 0], [0])).fit(u, y)
    path = tmp_path / "report.html"
    model.report(path, u, y)
    assert "([0, 0], [0])" in path.read_text().split("Settings")[1]
