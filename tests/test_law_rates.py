"""The sampling time of the law, and a law that looks half a sample ahead."""

import numpy as np
import pytest
from scipy.linalg import expm

import alssnn
from alssnn.cli import main
from alssnn.datasets import make_duffing
from alssnn.feedback import LinearizingLaw
from alssnn.linearizability import worst_error
from alssnn.model_selection import law_rates
from alssnn.models import state_space
from alssnn.mpc import LinearizingMPC
from alssnn.plotting import LawRatesDisplay
from alssnn.simulation import channels, outputs
from benchmarks.continuous import loop_distance
from exported import looking_ahead

pytestmark = pytest.mark.filterwarnings(
    "ignore::sklearn.exceptions.ConvergenceWarning"  # short fits are enough
)

KINDS = {
    "h(y)": {"feedback": "output"},
    "h(x)": {"feedback": "state"},
    "monotone": {"feedback": "output", "input_map": "monotone"},
    "disturbance": {"feedback": "state", "disturbances": [1]},
    "two inputs": {"feedback": "state"},
    "two layers": {"feedback": "output", "n_h": (2, 3)},
}


@pytest.fixture(scope="module", params=KINDS, ids=str)
def model(request):
    """Return a model of a stiffening spring whose first fit is enough."""
    two = request.param in ("disturbance", "two inputs")
    record = make_duffing(300, random_state=0)
    u = record.u
    if two:
        u = np.hstack([u, 0.1 * np.random.default_rng(1).standard_normal(u.shape)])
    options = {"n_h": 3, **KINDS[request.param]}
    return alssnn.FlSsnn(
        nx=2,
        alpha=0.0,
        max_iter=15,
        n_init=1,
        time="continuous",
        dt=record.dt,
        random_state=0,
        **options,
    ).fit(u, record.y)


def signals(plant, n=40, size=0.3):
    """Return states and virtual inputs about the operating point."""
    rng = np.random.default_rng(3)
    X = size * rng.standard_normal((n, plant.nx)) * plant.x_scale
    v = plant.v_offset + size * rng.standard_normal((n, plant.nv)) * plant.v_scale
    d = plant.d_offset + 0.1 * rng.standard_normal((n, plant.nd)) if plant.nd else None
    return X, v, d


def whole(plant, u, d):
    """Return the inputs of the plant in the order of the record."""
    if d is None:
        return u
    out = np.empty((len(u), plant.nu))
    out[:, plant.moved], out[:, list(plant.given)] = u, d
    return out


def test_the_law_sees_the_middle_of_the_sample(model):
    now, plant = model.plant_, model.plant_.at(model.dt, ahead=True)
    assert plant.feedback == "state" and plant.looks_ahead and plant.no_law == ""
    X, v, d = signals(plant)
    # exact up to steps of Runge and Kutta, which a finer plant takes
    A, B, C, _ = now.linear()
    G = now.disturbed_by()[0]
    A, B, G = (model.A_, model.B_, getattr(model, "G_", np.zeros((2, 0))))
    n = 2 + B.shape[1] + G.shape[1]
    half = expm(np.pad(np.hstack([A, B, G]), [(0, n - 2), (0, 0)]) * model.dt / 2)[:2]
    dd = np.zeros((len(v), 0)) if d is None else d - plant.d_offset
    x_half = np.hstack([X, v - plant.v_offset, dd]) @ half.T
    s = x_half if now.feedback == "state" else x_half @ C.T + now.y_offset
    expected = now.law(v, s, d)
    u = plant.law(v, X, d)
    np.testing.assert_allclose(u, expected, atol=5e-3 * plant.v_scale.max())
    # v is what it says along any input, and the loop is that of the law
    np.testing.assert_allclose(plant.virtual(X, whole(plant, u, d)), v, atol=1e-9)
    loop = plant.close()
    assert not loop.implicit or not plant.law_map.is_sum
    driven = whole(plant, v, d) - plant.u_offset
    Z = channels(loop, X, driven)
    sent = Z[:, plant.ny :] + plant.u_offset
    np.testing.assert_allclose(sent, whole(plant, u, d), atol=1e-9)
    np.testing.assert_allclose(
        plant.step(X, sent), now.step(X, whole(plant, u, d)), atol=1e-12
    )


def test_a_law_with_limits_tells_what_they_cut_off(model):
    now, plant = model.plant_, model.plant_.at(model.dt, ahead=True)
    X, v, d = signals(plant)
    low, high = plant.v_offset - 0.2 * plant.v_scale, plant.v_offset + plant.v_scale
    law = LinearizingLaw(plant, low, high)
    u, cut = law.split(v, X, d)
    assert np.all(u >= low) and np.all(u <= high) and np.any(cut != 0)
    free = np.all(cut == 0, axis=1)
    reached = plant.virtual(X, whole(plant, u, d))
    np.testing.assert_allclose(reached[free], v[free], atol=1e-9)
    # with a limit, v in the middle of the sample is still the one that was wanted
    half = plant.middle.matrix @ np.hstack([X, deviations(plant, d, v)]).T
    phi = now.law_map.cancelled
    seen = [half.T] if d is None else [half.T, d - plant.d_offset]
    explicit = now.is_explicit
    du = u - plant.v_offset
    h = phi(np.hstack(seen)) if explicit else phi(np.hstack(seen), du)
    np.testing.assert_allclose(v - u - h, cut, atol=1e-9)
    most = 0.1 * np.abs(cut[~free]).max()
    np.testing.assert_allclose(reached, v - cut, atol=most)


def deviations(plant, d, v):
    """Return measured disturbances and virtual inputs, as deviations."""
    dv = v - plant.v_offset
    return dv if d is None else np.hstack([d - plant.d_offset, dv])


def test_a_plant_whose_law_looks_ahead_says_so(model):
    now, plant = model.plant_, model.plant_.at(model.dt, ahead=True)
    assert repr(plant).startswith("Plant(looks half a sample ahead, u_offset=")
    assert "s half a sample ahead)" in repr(LinearizingLaw(plant))
    for other in (now, plant.linearized()):
        assert "ahead" not in repr(other) + repr(LinearizingLaw(other))
    assert "ahead" in repr(plant.with_disturbance("output"))


@pytest.fixture(scope="module")
def record():
    return make_duffing(500, random_state=0)


def swing(record, **options):
    """Return a model in continuous time, before it is fitted."""
    options |= {"feedback": "output", "gamma_h": 1e-4, "n_init": 1, "random_state": 0}
    return alssnn.FlSsnn(nx=2, n_h=4, time="continuous", dt=record.dt, **options)


@pytest.fixture(scope="module")
def duffing(record):
    return swing(record, alpha=1e-12).fit(record.u, record.y), record


def test_the_error_falls_with_the_square_of_the_sampling_time(duffing):
    model, record = duffing
    rates = law_rates(model, record.u, record.y)
    np.testing.assert_allclose(
        rates.law_dt, record.dt * np.array([2, 1, 0.5, 0.25, 0.125])
    )
    order = np.log2(rates.error(ahead=True)[1:-1] / rates.error(ahead=True)[2:])
    assert np.all(np.abs(order - 2) < 0.4), order
    order = np.log2(rates.error()[-2] / rates.error()[-1])
    assert abs(order - 1) < 0.4
    assert np.all(rates.error(ahead=True) < 0.3 * rates.error())
    assert rates.slowest(0.05, ahead=True) > rates.slowest(0.05)
    assert np.isnan(rates.slowest(1e-9))
    assert rates.slowest(1e9) == rates.law_dt[0]
    assert str(rates).count("\n") == 6 and " *" in str(rates).splitlines()[2]
    frame = rates.to_frame()
    np.testing.assert_array_equal(frame["ahead"], rates.error(ahead=True))
    display = LawRatesDisplay.from_rates(rates)
    now, ahead, record_line = display.ax_.lines
    np.testing.assert_allclose(now.get_ydata(), 100 * rates.error())
    np.testing.assert_allclose(ahead.get_ydata(), 100 * rates.error(ahead=True))
    assert record_line.get_xdata()[0] == record.dt
    assert display.ax_.get_xscale() == display.ax_.get_yscale() == "log"


def test_figures_at_the_rate_of_the_record_are_the_same(duffing):
    model, record = duffing
    plain = model.linearizability(record.u, record.y)
    same = model.linearizability(record.u, record.y, law_dt=record.dt)
    assert str(plain) == str(same)
    finer = model.linearizability(record.u, record.y, law_dt=record.dt / 2)
    assert len(finer.e) == 2 * len(plain.e)
    assert worst_error(finer) < worst_error(plain)
    slower = model.linearizability(record.u, record.y, law_dt=3 * record.dt)
    assert len(slower.e) == len(plain.e) // 3


@pytest.mark.parametrize("hold", ["zoh", "linear", "cubic"])
def test_a_finer_record_is_what_the_fit_took_it_for(hold, record):
    from alssnn.linearizability import at_rate

    model = alssnn.LinearStateSpace(
        nx=2, time="continuous", hold=hold, dt=record.dt, max_iter=5
    ).fit(record.u, record.y)
    y = record.y.copy()
    y[40:50] = np.nan
    (prepared,) = model.prepare_records(record.u, y)
    plant, (finer,) = at_rate(model.plant_, [prepared], record.dt / 4, False)
    np.testing.assert_allclose(finer.dy[::4][:40], prepared.dy[:40], atol=1e-10)
    assert np.isnan(finer.dy[157:197]).all() and np.isfinite(finer.dy[:157]).all()
    simulated = outputs(plant.lure, finer.du, finer.x0)[::4, 0]
    held = outputs(model.plant_.lure, prepared.du, prepared.x0)[:, 0]
    if hold == "zoh":
        np.testing.assert_allclose(simulated, held, atol=0.02 * held.std())
    else:  # the model itself knows what u does in between
        y_hat = model.predict(record.u, x0=prepared.x0).ravel() - model.y_offset_
        assert np.std(simulated - y_hat) < 0.15 * np.std(held - y_hat)


def test_a_true_loop_at_a_slow_rate(duffing):
    model, record = duffing
    now, ahead = (
        loop_distance(model.plant_.at(record.dt, ahead=ahead), record.dt, 0)
        for ahead in (False, True)
    )
    assert ahead < 0.6 * now


@pytest.mark.filterwarnings("ignore:.*stopped after 3")
def test_a_predictive_controller_takes_the_law(record):
    model = swing(record, alpha=0.0, max_iter=3).fit(record.u, record.y)
    plant = model.plant_.at(model.dt, ahead=True)
    mpc = LinearizingMPC(plant, horizon=8)
    u = mpc.step(plant.y_offset + 0.1, plant.y_offset)
    assert np.isfinite(u).all()


def test_the_error_of_the_model_is_that_of_the_model(duffing):
    model, record = duffing
    u, y = record.u, record.y
    slow = model.linearizability(u, y, law_dt=2 * record.dt)
    assert slow.carried is None and "slower than the record" in repr(slow)
    # an input that goes on between samples is no error, whatever the law does
    t = record.dt * np.arange(400)
    u = (0.3 * np.sin(1.3 * t) + 0.2 * np.sin(2.9 * t + 1))[:, None]
    smooth = alssnn.FlSsnn(
        nx=2, n_h=3, hold="cubic", time="continuous", dt=record.dt, alpha=0.0, n_init=1
    ).set_params(max_iter=10, random_state=0)
    smooth.fit(u, make_duffing(400, random_state=2).y)
    prepared = smooth.prepare_records(u, smooth.predict(u, x0=np.zeros(2)))
    exact = smooth.predict(u, x0=prepared[0].x0)
    same = smooth.linearizability(u, exact, law_dt=record.dt, ahead=True)
    plain = smooth.linearizability(u, exact)
    for found in (same, plain):
        assert np.all(found.carried_missed < 0.05)


@pytest.mark.usefixtures("undrawn")
def test_verdicts_are_of_the_law_that_will_run(duffing, tmp_path, monkeypatch):
    # certificates of the report take long and know nothing of the rate
    monkeypatch.setattr("alssnn.report._control._local", lambda *_: "")
    model, record = duffing
    last = slice(300, None)
    data = record.u[last], record.y[last]
    plain = model.validate(*data)["linearizability"]
    finer = model.validate(*data, law_dt=0.05, ahead=True)["linearizability"]
    assert finer.value < 0.1 * plain.value
    page = tmp_path / "report.html"
    model.report(page, *data, law_dt=0.05, ahead=True)
    text = page.read_text(encoding="utf-8")
    assert "Linearizability, law at 0.05 s, half a sample ahead" in text
    # certificates and gain are of another law
    of_record = f"Of the law at the sampling time of the record, {record.dt:g} s, and"
    assert text.count(of_record) == 2
    assert text.count("take model.plant_.at(0.05, ahead=True).") == 2
    model.save(tmp_path / "model.npz")
    table = np.hstack([record.u, record.y])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="u,y", comments="")
    files = [str(tmp_path / name) for name in ("model.npz", "a.csv")]
    command = ["validate", files[0], "--data", files[1], "--last", "0.4"]
    command += ["--input", "u", "--output", "y"]
    main([*command, "--law-dt", "0.05", "--ahead", "-o", str(tmp_path / "b.csv")])
    rows = (tmp_path / "b.csv").read_text().splitlines()
    (row,) = [row for row in rows if row.startswith("linearizability")]
    assert float(row.split(",")[3]) == pytest.approx(finer.value, rel=1e-6)


def test_a_disturbance_that_comes_late_cannot_be_looked_ahead():
    rng = np.random.default_rng(0)
    C = np.ones((1, 2))
    structure = state_space(2, 2, 1, n_h=2, C=C, feedback="state", disturbances=(1,))
    p = {k: 0.3 * rng.standard_normal(s) for k, s in structure.shapes.items()}
    p["W_d"] *= 0  # the law itself does not see it
    for delay, G in (((0, 0), 1.0), ((0, 2), 0.0)):
        plant = looking_ahead(structure, {**p, "G": G * p["G"]}, rng, delay)
        assert plant.looks_ahead
    with pytest.raises(ValueError, match="of 2 samples ago"):
        looking_ahead(structure, p, rng, (0, 2))


def test_what_cannot_look_ahead_is_refused(duffing):
    model, record = duffing
    discrete = alssnn.FlSsnn(nx=1, n_h=1, alpha=0.0, max_iter=2, dt=record.dt)
    discrete.fit(record.u, record.y)
    with pytest.raises(ValueError, match="its time is discrete"):
        discrete.plant_.at(record.dt, ahead=True)
    with pytest.raises(ValueError, match="its time is discrete"):
        discrete.linearizability(record.u, record.y, law_dt=0.1)
    with pytest.raises(ValueError, match="part or a multiple"):
        model.linearizability(record.u, record.y, law_dt=0.3 * record.dt)
    with pytest.raises(ValueError, match="`dt` must be a positive number"):
        model.linearizability(record.u, record.y, law_dt=-1.0)
    plant = model.plant_.at(record.dt, ahead=True)
    assert plant.at(record.dt, ahead=True) is plant
    with pytest.raises(ValueError, match="the plant was changed"):
        plant.at(record.dt)
    with pytest.raises(ValueError, match="shorter than every experiment"):
        model.linearizability(record.u[:9], record.y[:9], law_dt=10 * record.dt)
    with pytest.raises(ValueError, match="must have sampling times"):
        law_rates(model, record.u, record.y, law_dt=[])
    with pytest.raises(ValueError, match="`law_dt` must be a positive number"):
        law_rates(model, record.u, record.y, law_dt=[0.1, -1.0])
    linear = alssnn.LinearStateSpace(nx=2, time="continuous", dt=record.dt, max_iter=2)
    linear.fit(record.u, record.y)
    assert not linear.plant_.at(0.1, ahead=True).looks_ahead  # nothing to look for
    with pytest.raises(ValueError, match="cancels something"):
        law_rates(linear, record.u, record.y)
    fed = alssnn.AlSsnn(nx=2, feedthrough=True, feedback="output", n_init=1)
    fed.set_params(time="continuous", dt=record.dt, alpha=0.0, max_iter=2, n_h=1, n_g=1)
    fed.fit(record.u, record.y)
    with pytest.raises(ValueError, match="algebraic loop"):
        fed.plant_.at(0.1, ahead=True)
    without = fed.linearizability(record.u, record.y, ahead=True)  # is no error
    assert "algebraic loop" in without.no_law
    assert np.isnan(without.closed_linearization_error).all()
