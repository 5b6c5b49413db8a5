"""Signals with time stamps of their own."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import alssnn
from alssnn.datasets import make_duffing, on_grid


def test_an_even_record_stays_what_it_was():
    rng = np.random.default_rng(0)
    u, y, t = rng.standard_normal((50, 2)), rng.standard_normal((50, 3)), np.arange(50)
    for hold in ("zoh", "linear", "cubic"):
        record = on_grid(u, 7 + 0.1 * t, y, 7 + 0.1 * t, hold=hold)
        assert record.dt == pytest.approx(0.1, rel=1e-9)
        np.testing.assert_allclose(record.u, u, atol=1e-9)
        np.testing.assert_array_equal(record.y, y)


def test_several_rates_meet_on_their_common_grid():
    u, y1, y2 = np.arange(21.0), np.arange(11.0), np.arange(8.0)
    t_u, t_1, t_2 = 0.2 * np.arange(21), 0.4 * np.arange(11), 0.5 * np.arange(8)
    record = on_grid(u, t_u, [y1, y2], [t_1, t_2], inputs="valve", outputs=["p", "q"])
    assert record.dt == pytest.approx(0.1) and len(record) == 41
    assert record.inputs == ["valve"] and record.outputs == ["p", "q"]
    np.testing.assert_array_equal(record.u[:, 0], np.repeat(u, 2)[:41])
    np.testing.assert_array_equal(record.y[::4, 0], y1)
    np.testing.assert_array_equal(record.y[::5, 1][:8], y2)
    assert np.isfinite(record.y).sum() == 19


@pytest.mark.parametrize("hold", ["linear", "cubic"])
def test_inputs_that_go_on_are_known_between_their_stamps(hold):
    rng = np.random.default_rng(1)
    t_u = np.sort(rng.uniform(0, 10, 200))
    t_y = np.arange(0.5, 9.5, 0.25)
    u = np.sin(t_u)
    with pytest.warns(UserWarning, match="are moved"):
        record = on_grid(u, t_u, t_y, t_y, dt=0.05, hold=hold)
    t = t_u[0] + 0.05 * np.arange(len(record))
    curve = CubicSpline(t_u, u) if hold == "cubic" else lambda t: np.interp(t, t_u, u)
    np.testing.assert_allclose(record.u[:, 0], curve(t), atol=1e-12)


def test_dates_are_times():
    start = np.datetime64("2026-01-02T03:04:05")
    t = start + np.arange(30) * np.timedelta64(250, "ms")
    u = np.arange(30.0)
    record = on_grid(u, t, u[::2], t[::2])
    assert record.dt == 0.25 and len(record) == 29
    pandas = pytest.importorskip("pandas")
    zone = pandas.DatetimeIndex(t).tz_localize("Europe/Paris")
    other = zone.tz_convert("UTC")
    same = on_grid(u, zone, u[::2], list(other[::2]))
    np.testing.assert_array_equal(same.y, record.y)
    numbers = on_grid(u, np.arange(30, dtype=object), u[::2], np.arange(0, 30, 2))
    assert numbers.dt == 1.0
    text = on_grid(u, t.astype(str), u[::2], t[::2])
    assert text.dt == 0.25


def test_stamps_with_jitter_are_moved_and_told():
    rng = np.random.default_rng(0)
    t = np.arange(400) + rng.uniform(-0.1, 0.1, 400)
    t[0] = 0.0
    with pytest.warns(UserWarning, match="Time stamps are moved by"):
        record = on_grid(np.sin(t), t, np.cos(t), t)
    assert 0.05 < record.dt < 1.0
    at = np.flatnonzero(np.isfinite(record.y[:, 0]))
    assert len(at) == 400
    assert np.sqrt(np.mean((at * record.dt - t) ** 2)) < 0.05
    np.testing.assert_array_equal(record.y[at, 0], np.cos(t))


def test_samples_that_meet_are_averaged_and_what_lies_outside_is_left():
    t_y = [-3.0, 0.999, 1.001, 2.0]
    record = on_grid([1, 2], [0.0, 1.0], [9, 2, 4, 8], t_y, dt=1.0)
    np.testing.assert_array_equal(record.y[:, 0], [np.nan, 3, 8])
    np.testing.assert_array_equal(record.u[:, 0], [1, 2, 2])


def test_a_longer_sampling_time_takes_every_other_sample_alike():
    t = 0.1 * np.arange(100)
    with pytest.warns(UserWarning, match="are moved"):
        record = on_grid(t, t, t, t, dt=0.2)
    np.testing.assert_allclose(np.diff(record.u[:49, 0]), 0.2)
    np.testing.assert_allclose(np.diff(record.y[1:49, 0]), 0.2)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_a_model_of_a_slow_sensor():
    fine = make_duffing(800, noise=0.01, random_state=0)
    t = fine.dt * np.arange(800)
    record = on_grid(fine.u, t, fine.y[::3], t[::3])
    assert record.dt == pytest.approx(fine.dt) and np.isnan(record.y).mean() > 0.6
    options = {"nx": 2, "n_h": 4, "feedback": "output", "n_init": 1, "random_state": 0}
    options |= {"alpha": 1e-6, "max_iter": 40}
    test = make_duffing(400, random_state=5)
    scores = [
        alssnn.FlSsnn(dt=fine.dt, **options).fit(*data).score(*test)
        for data in (fine, record)
    ]
    assert 1 - scores[1] < 3 * (1 - scores[0]) + 0.003, scores


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t_u": [0, 2, 1, 3]}, "`t_u` must ascend, got one that goes back at row 2"),
        ({"t_y": [0, 1, 1, 3]}, "`t_y` must ascend, got one that repeats at row 2"),
        ({"t_u": [0, 1, 2]}, "`t_u` must have a time for each of 4 samples, got 3"),
        ({"t_u": [0, 1, np.nan, 3]}, "`t_u` must be finite times"),
        ({"t_y": [-9, -8, -7, -6]}, "must overlap"),
        ({"t_y": [20, 21, 22, 23]}, "must overlap"),
        ({"t_y": [20, 21, 22, 23], "hold": "linear"}, "must overlap"),
        ({"u": [1, np.nan, 2, 3]}, "`u` must be finite"),
        ({"hold": "spline"}, "`hold` must be 'zoh', 'linear' or 'cubic'"),
        ({"dt": -1.0}, "`dt` must be a positive number"),
        ({"dt": 1e-9}, "`dt` must be longer"),
        ({"t_y": [0, 1, 2, 1e7]}, "`dt` must be longer"),
        ({"t_y": np.arange(4).astype("datetime64[s]")}, "all be seconds or all be"),
        ({"t_u": ["now", "then", "soon", "late"]}, "seconds or dates, got 'now'"),
        ({"u": [], "t_u": []}, "`u` must be a nonempty array"),
        ({"t_u": [True, False, True, False]}, "times in seconds or dates"),
        ({"u": [[1, 2, 3, 4], [1, 2]]}, "`t_u` must be a list of 2 arrays"),
    ],
)
def test_what_is_wrong_is_told(changes, message):
    data = {"u": [1.0, 2, 3, 4], "t_u": [0, 1, 2, 3], "y": [1, 2, 3, 4]}
    data |= {"t_y": [0, 1, 2, 3]} | changes
    with pytest.raises(ValueError, match=message):
        on_grid(**data)


def test_names_of_columns_are_kept():
    pandas = pytest.importorskip("pandas")
    t = np.arange(5.0)
    u = pandas.DataFrame({"valve": t, "fan": t**2})
    one, two = pandas.Series(t, name="level"), pandas.Series(-t, name="flow")
    record = on_grid(u, t, [one, two], [t, t])
    assert record.inputs == ["valve", "fan"]
    assert record.outputs == ["level", "flow"]
    # an array among them has no name; a name that is given counts
    assert on_grid(u, t, [one, -t], [t, t]).outputs == ["y0", "y1"]
    assert on_grid(one, t, two, t, outputs="h").outputs == ["h"]
    assert on_grid(one, t, two, t, outputs="h").inputs == ["level"]
