"""Records of the user's own: read, looked at, prepared, joined."""

import warnings

import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import ConvergenceWarning

from alssnn import LinearStateSpace
from alssnn.datasets import (
    Record,
    make_fan_arm,
    make_pendulum,
    make_valve_tank,
    make_wiener_hammerstein,
)

N = 600


@pytest.fixture(scope="module")
def plain():
    return make_pendulum(N, noise=0.01, random_state=0)


@pytest.fixture
def table(plain):
    t = 3.0 + plain.dt * np.arange(N)
    columns = [("time", t), ("torque [Nm]", plain.u[:, 0]), ("angle", plain.y[:, 0])]
    return pd.DataFrame(dict(columns))


NAMES = "torque [Nm]", "angle"


def test_a_csv_file_becomes_a_record(plain, table, tmp_path):
    path = tmp_path / "pendulum.csv"
    table.to_csv(path, index=False)
    record = Record.from_csv(path, *NAMES)
    np.testing.assert_array_equal(record.u, plain.u)
    np.testing.assert_array_equal(record.y, plain.y)
    assert record.dt == pytest.approx(plain.dt, rel=1e-9)
    assert record.inputs == ["torque [Nm]"] and record.outputs == ["angle"]
    assert record.name == str(path)
    assert Record.from_csv(path, *NAMES, dt=2.0, name="mine").dt == 2.0
    renamed = tmp_path / "renamed.csv"
    table.rename(columns={"time": "clock"}).to_csv(renamed, index=False)
    with pytest.raises(ValueError, match="`dt` must be given where no column of time"):
        Record.from_csv(renamed, *NAMES)
    again = Record.from_csv(renamed, *NAMES, time="clock")
    assert again.dt == pytest.approx(plain.dt, rel=1e-9)


def test_gaps_of_outputs_are_kept(plain, table, tmp_path):
    table.loc[7, "angle"] = np.nan
    table.to_csv(tmp_path / "gaps.csv", index=False)
    record = Record.from_csv(tmp_path / "gaps.csv", *NAMES)
    assert np.flatnonzero(np.isnan(record.y[:, 0])).tolist() == [7]
    with pytest.raises(ValueError, match="got a gap at row 7"):
        record.decimate(2)
    rest = record.detrend().y - record.y
    assert np.isnan(rest[7]) and np.abs(np.nanmean(rest)) < 1e-12
    with pytest.raises(ValueError, match="`y` must be finite, got inf at row 0"):
        Record([0.0], [np.inf], 1.0)


@pytest.mark.parametrize(
    "index",
    [
        lambda dt: pd.date_range("2024-05-01", periods=N, freq=f"{1000 * dt:g}ms"),
        lambda dt: pd.to_timedelta(dt * np.arange(N), unit="s"),
        # of a zone, where a clock goes back by an hour
        lambda dt: pd.date_range(
            "2024-10-27T00:59:59Z", periods=N, freq=f"{1000 * dt:g}ms"
        ).tz_convert("Europe/Rome"),
    ],
)
def test_dates_tell_the_sampling_time(plain, table, index):
    frame = table.set_index(index(plain.dt))
    assert Record.from_dataframe(frame, *NAMES).dt == pytest.approx(plain.dt)
    column = frame.rename_axis("when").reset_index()
    assert Record.from_dataframe(column, *NAMES, time="when").dt == pytest.approx(
        plain.dt
    )


def test_other_frames(plain, table):
    polars = pytest.importorskip("polars")
    record = Record.from_dataframe(polars.DataFrame(table), *NAMES, time="time")
    np.testing.assert_array_equal(record.u, plain.u)
    assert record.dt == pytest.approx(plain.dt)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: np.r_[t[:5], t[5:] + 1.0], "got a step of 1.05 s after sample 4"),
        (lambda t: t[::-1], "must rise evenly, got a step of -0.05 s after sample 0"),
        (lambda t: 0 * t, "must rise evenly, got a step of 0 s"),
    ],
)
def test_uneven_times_are_refused(table, change, message):
    table["time"] = change(table["time"].to_numpy())
    with pytest.raises(ValueError, match=message):
        Record.from_dataframe(table, *NAMES, time="time")
    assert Record.from_dataframe(table, *NAMES, time="time", dt=1.0).dt == 1.0


def test_columns_that_are_missing(table):
    with pytest.raises(ValueError, match="none called 'speed' among time, torque"):
        Record.from_dataframe(table, "torque [Nm]", "speed", dt=1.0)
    with pytest.raises(ValueError, match="`dt` must be given"):
        Record.from_dataframe(table, *NAMES)


def test_columns_may_have_numbers_for_names(table):
    numbered = table.set_axis(range(len(table.columns)), axis=1)
    places = [table.columns.get_loc(name) for name in ("time", *NAMES)]
    record = Record.from_dataframe(numbered, places[1:2], places[2:], time=places[0])
    np.testing.assert_array_equal(record.y[:, 0], table[NAMES[1]])
    assert record.inputs == [str(places[1])]
    assert record.dt == Record.from_dataframe(table, *NAMES, time="time").dt


def test_names(plain):
    assert plain.inputs == ["u0"] and not plain.is_named
    with pytest.raises(ValueError, match="`outputs` must be 1 names, one per column"):
        Record(plain.u, plain.y, 1.0, outputs=["a", "b"])
    with pytest.raises(ValueError, match="must be different names"):
        Record(plain.u, plain.y, 1.0, inputs="a", outputs="a")


def test_frames_carry_names_to_the_model(table):
    record = Record.from_dataframe(table, *NAMES, time="time")
    model = LinearStateSpace(nx=2, dt=record.dt).fit(*record.to_frames())
    assert model.plant_.inputs == ["torque [Nm]"]
    assert model.output_names_ == ["angle"]


def test_a_drift_of_the_sensor_goes_and_the_mean_stays(plain):
    drift = np.linspace(-3, 5, N)[:, None]
    drifting = Record(plain.u, plain.y + drift, plain.dt)
    record = drifting.detrend()
    line = np.polynomial.Polynomial.fit(np.arange(N), plain.y[:, 0], 1)
    expected = plain.y[:, 0] - line(np.arange(N)) + (plain.y + drift).mean()
    np.testing.assert_allclose(record.y[:, 0], expected, atol=1e-10)
    np.testing.assert_array_equal(record.u, drifting.u)
    moved = drifting.detrend(inputs=True).u
    assert abs(np.polyfit(np.arange(N), moved[:, 0], 1)[0]) < 1e-12
    assert moved.mean() == pytest.approx(plain.u.mean())


def test_a_lower_rate_keeps_what_is_slow_and_has_no_aliases():
    t = 0.01 * np.arange(4000)
    slow, fast = np.sin(2 * np.pi * 0.5 * t), np.sin(2 * np.pi * 13.0 * t)
    record = Record(5 + slow, 7 + slow + fast, 0.01, "sines", inputs="a", outputs="b")
    for other in (record.decimate(5), record.resample(0.05)):
        assert other.dt == pytest.approx(0.05) and len(other) == 800
        assert (other.inputs, other.outputs) == (["a"], ["b"])
        inner = slice(20, -20)
        expected = np.sin(2 * np.pi * 0.5 * other.t)
        assert np.abs(other.u[inner, 0] - 5 - expected[inner]).max() < 0.01
        assert np.abs(other.y[inner, 0] - 7 - expected[inner]).max() < 0.01
    faster = record.resample(0.01 * 2 / 3)
    assert faster.dt == pytest.approx(0.01 * 2 / 3)
    assert (
        np.abs(faster.u[50:-50, 0] - 5 - np.sin(np.pi * faster.t)[50:-50]).max() < 0.01
    )
    assert record.decimate(1) is record
    for wrong in (0.01 * np.pi, 0.01 / 1001, 1e-9, 1e-300, 1e300):
        with pytest.raises(ValueError, match="ratio of whole numbers up to 1000"):
            record.resample(wrong)
    assert len(record.resample(0.01 / 1000)) == 1000 * len(record)
    for wrong in (0, 2.5, True):
        with pytest.raises(ValueError, match="`q` must be a positive integer"):
            record.decimate(wrong)
    with pytest.raises(ValueError, match="`dt` must be positive and finite"):
        record.resample(-1.0)


def test_parts_keep_names(table):
    record = Record.from_dataframe(table, *NAMES, time="time", name="arm")
    first, rest = record.split(0.5)
    assert rest.inputs == ["torque [Nm]"] and rest.name == f"arm[{N // 2}:]"
    assert first.dt == record.dt


def test_experiments_are_merged_for_a_fit(plain, table):
    named = Record.from_dataframe(table, *NAMES, time="time")
    for record in (plain, named):
        parts = record.split(0.4)
        u, y, experiment = Record.merge(parts)
        model = LinearStateSpace(nx=2, dt=record.dt).fit(u, y, experiment)
        assert model.experiments_ == [0, 1]
        np.testing.assert_array_equal(np.asarray(u), record.u)
        assert hasattr(u, "columns") == record.is_named
    with pytest.raises(ValueError, match="must have the same inputs"):
        Record.merge([named, plain])
    with pytest.raises(ValueError, match="list of records, got none"):
        Record.merge([])
    with pytest.raises(ValueError, match="list of records, got a record itself"):
        Record.merge(plain)


def test_signals_are_drawn(table):
    record = Record.from_dataframe(table, *NAMES, time="time", name="arm")
    display = record.plot()
    assert [ax.get_ylabel() for ax in display.axes_[:, 0]] == ["angle", "torque [Nm]"]
    np.testing.assert_array_equal(
        display.axes_[1, 0].lines[0].get_ydata(), record.u[:, 0]
    )


# -- what a fit says of a record that was given in another way -------------------------


@pytest.mark.parametrize(
    "make", [make_pendulum, make_wiener_hammerstein, make_fan_arm, make_valve_tank]
)
def test_a_fit_of_exchanged_signals_says_so(make):
    record = make(1500, random_state=0)
    model = LinearStateSpace(nx=2, dt=record.dt)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.fit(record.u, record.y)
    with pytest.warns(ConvergenceWarning, match="exchange them"):
        model.fit(record.y, record.u)


def test_files_of_one_rate_are_merged_whatever_their_times_round_to(tmp_path):
    records = []
    for name, start, n in (("a", 0.0, 1200), ("b", 60.0, 777)):
        t = start + 0.05 * np.arange(n)
        lines = [f"{z:.2f},{np.sin(z):.3f},{np.cos(z):.3f}" for z in t]
        path = tmp_path / f"{name}.csv"
        path.write_text("\n".join(["time,u,y", *lines]))
        records.append(Record.from_csv(path, "u", "y"))
    assert [record.dt for record in records] == [0.05, 0.05]
    assert len(Record.merge(records)[0]) == 1977


def test_an_input_at_rest_is_no_sign_of_exchanged_signals():
    record = make_pendulum(1500, random_state=0)
    moves = np.r_[np.zeros(1400), np.random.default_rng(0).standard_normal(100)]
    u = np.hstack([record.y, moves[:, None]])
    with pytest.warns(ConvergenceWarning, match="exchange them"):
        LinearStateSpace(nx=2, dt=record.dt).fit(u, record.u, np.arange(1500) >= 1400)


def test_noise_is_not_taken_for_exchanged_signals():
    u, y = np.random.default_rng(0).standard_normal((2, 1500))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        LinearStateSpace(nx=1).fit(u, y)


def test_a_sampling_time_that_was_forgotten_is_named(plain, table):
    index = pd.date_range("2024-05-01", periods=N, freq=f"{1000 * plain.dt:g}ms")
    frame = table.set_index(index)
    u, y = frame[["torque [Nm]"]], frame["angle"]
    with pytest.warns(
        UserWarning, match=r"steps of 0.05 s, and `dt` is 1 s.* Fit with dt=0\.05\.$"
    ):
        LinearStateSpace(nx=2).fit(u, y)
    with pytest.warns(UserWarning, match=r"steps of 0.05 s"):
        LinearStateSpace(nx=2).fit(u["torque [Nm]"], y)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        LinearStateSpace(nx=2, dt=plain.dt).fit(u, y)
        LinearStateSpace(nx=2).fit(u.reset_index(drop=True), y.reset_index(drop=True))


def test_times_of_a_record_are_told_after_the_fit(plain, table):
    index = pd.date_range("2024-05-01", periods=N, freq="50ms")
    frame = table.set_index(index)
    u, y = frame[["torque [Nm]"]], frame["angle"]
    model = LinearStateSpace(nx=2, dt=plain.dt).fit(u, y)
    slow = pd.date_range("2024-05-01", periods=N, freq="100ms", tz="UTC")
    verbs = [lambda u, y: model.predict(u), model.score, model.validate]
    verbs += [model.predict_ahead, lambda u, y: model.score([u], [y])]
    words = (
        r"steps of 0.1 s, and `dt` is 0.05 s.*"
        r"Resample the record, or fit with dt=0\.1\.$"
    )
    for verb in verbs:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            verb(u, y)
        with pytest.warns(UserWarning, match=words):
            verb(u.set_axis(slow), y.set_axis(slow))


def test_the_name_of_a_column_tells_the_unit_of_time(plain, table, tmp_path):
    milliseconds = 1000 * plain.dt * np.arange(N)
    columns = "torque [Nm]", "angle"
    frame = table.assign(**{"t [ms]": milliseconds})
    record = Record.from_dataframe(frame, *columns, time="t [ms]")
    assert record.dt == pytest.approx(plain.dt)
    dates = pd.Timestamp("2024-05-01") + pd.to_timedelta(milliseconds, unit="ms")
    record = Record.from_dataframe(
        frame.assign(**{"t [ms]": dates}), *columns, time="t [ms]"
    )
    assert record.dt == pytest.approx(plain.dt)
    frame.drop(columns="time").to_csv(tmp_path / "plant.csv", index=False)
    assert Record.from_csv(tmp_path / "plant.csv", *columns).dt == pytest.approx(
        plain.dt
    )


def test_gaps_between_dates_are_told(plain, table):
    index = pd.date_range("2024-05-01", periods=N, freq="50ms")
    late = np.arange(N) >= N // 2
    index += pd.to_timedelta(5.0 * late, unit="s")
    frame = table.set_index(index)
    u, y = frame[["torque [Nm]"]], frame["angle"]
    words = rf"a step of 5.05 s behind row {N // 2 - 1}, where others are 0.05 s"
    model = LinearStateSpace(nx=2, dt=plain.dt)
    with pytest.warns(UserWarning, match=words):
        model.fit(u, y)
    with pytest.warns(UserWarning, match=words):
        model.predict(u)
    twice = frame.index.append(frame.index)  # the clock goes back, too
    with pytest.warns(UserWarning, match="and 2 more like it"):
        model.predict(pd.concat([u, u]).set_axis(twice))
    jitter = np.random.default_rng(0).uniform(-0.01, 0.01, N)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.fit(u, y, experiment=late)
        model.score([u[~late], u[late]], [y[~late], y[late]])
        model.predict(
            u[~late].set_axis(index[~late] + pd.to_timedelta(jitter[~late], unit="s"))
        )


def test_rows_of_other_times_are_not_paired(plain, table):
    """By position, as in scikit-learn, unless the rows say that they do not meet."""
    frame = table.set_index(pd.date_range("2024-05-01", periods=N, freq="50ms"))
    u, y = frame[["torque [Nm]"]], frame["angle"]
    model = LinearStateSpace(nx=2, dt=plain.dt).fit(u, y)
    score = model.score(u, y)
    assert model.score(u.reset_index(drop=True), y) == score
    numbered = y.reset_index(drop=True)
    numbered.index += 7
    assert model.score(u.reset_index(drop=True), numbered) == score
    late = y.set_axis(y.index + pd.Timedelta("50ms"))
    for seen, words in ((late, "same times.*on_grid"), (y[::-1], "order.*y.loc")):
        with pytest.raises(ValueError, match=words):
            model.fit(u, seen)
        with pytest.raises(ValueError, match=words):
            model.score([u, u], [y, seen])
        with pytest.raises(ValueError, match=words):
            Record(u, seen, plain.dt)
    assert model.score(u, y[::-1].loc[u.index]) == score
