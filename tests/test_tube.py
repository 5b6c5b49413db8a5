"""Tubes of the plant around the model: the level is kept, what is missing is said."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from alssnn import LinearStateSpace
from alssnn.certificates import _error_gain, error_gain, iss_certificate
from alssnn.certificates._tube_bound import in_words, plain
from alssnn.certificates._units import (
    Run,
    conformal_quantile,
    fit_scale,
    least_units,
    lengths,
    measure,
    rank,
    scale,
    scores_of,
    simulated_runs,
    units_of,
)
from alssnn.datasets import (
    make_duffing,
    make_pendulum,
    make_valve_tank,
    make_wiener_hammerstein,
)
from helpers import simulate_linear


def records(make, seeds, n=120):
    pairs = [make(n, noise=0.01, random_state=seed) for seed in seeds]
    return [pair.u for pair in pairs], [pair.y for pair in pairs]


def wrong_model(make):
    """Return a linear model, which no such plant is."""
    train = make(1000, noise=0.01, random_state=0)
    return LinearStateSpace(nx=2, dt=train.dt).fit(*train)


# -- the level -------------------------------------------------------------------------


def test_fresh_records_keep_the_level():
    """On average over calibrations: that of one has a standard deviation of 5 %.

    One calibration and 60 fresh records alone would leave that of the average at 5 %
    and 4 %. So both are drawn 200 times from a pool.
    """
    level, n = 0.9, 39
    model = wrong_model(make_valve_tank)
    u, y = records(make_valve_tank, range(1, 113), 60)
    tube = model.tube(u[:52], y[:52], level=level)  # 13 of which fit the scale
    assert tube.finite and tube.n_blocks.tolist() == [n] and tube.block is None
    # scores of the rest by the scale of the first: what `contains` compares
    inside, fresh = tube.contains(u[52:], y[52:]), rescored(tube, u[52:], y[52:])
    np.testing.assert_array_equal(inside, fresh <= tube.quantile[0])
    low, high = tube.coverage_range[0]
    assert low - 0.08 < inside.mean() < high + 0.08
    pool, kept = np.concatenate([tube.scores[:, 0], fresh]), []
    rng = np.random.default_rng(0)
    for _ in range(200):
        drawn = rng.permutation(pool)
        kept.append(np.mean(drawn[n:] <= conformal_quantile(drawn[:n], level)))
    assert abs(np.mean(kept) - level) < 0.02
    # what is promised of one calibration
    assert 0.04 < np.std(kept) < 0.08


def rescored(tube, u, y):
    runs = simulated_runs(tube.model, u, y, None, None)
    centers = tube.model.u_offset_, tube.model.y_offset_
    errors, sizes = measure(units_of(runs, None, 0), *centers)
    return (errors / (sizes @ tube.coefficients.T)[:, :, 0])[:, 0]


def test_blocks_of_fresh_records_keep_the_level():
    """Where blocks are no experiments, and exchangeable only nearly."""
    model, kept = wrong_model(make_wiener_hammerstein), []
    fresh = records(make_wiener_hammerstein, range(100, 104), 4000)
    for seed in range(1, 21):
        record = make_wiener_hammerstein(4000, noise=0.01, random_state=seed)
        tube = model.tube(*record, block=40, gap=20)
        assert tube.n_blocks.tolist() == [49]
        kept.append(tube.contains(*fresh).mean())
    assert abs(np.mean(kept) - 45 / 50) < 0.02


@pytest.mark.parametrize("n", [8, 9, 10, 39, 40])
def test_the_quantile_is_exact(n):
    """A fresh score of n + 1 different ones is kept r times of n + 1."""
    scores, level = np.random.default_rng(n).standard_normal(n + 1), 0.9
    kept = [conformal_quantile(np.delete(scores, i), level) for i in range(n + 1)]
    expected = int(np.ceil(np.round((n + 1) * level, 6)))
    assert rank(n, level) == expected
    assert np.sum(scores <= kept) == min(expected, n + 1)
    assert np.isinf(kept).all() == (n < 9)
    assert least_units(level) == 9 and least_units(0.95) == 19


def test_missing_scores_do_not_count():
    scores = np.r_[np.arange(9.0), np.nan]
    assert conformal_quantile(scores, 0.9) == 8.0
    assert conformal_quantile(scores[1:], 0.9) == np.inf


# -- widths ----------------------------------------------------------------------------


def test_widths_follow_the_size_of_the_signals():
    """Without that, records with large inputs would leave the tube more often."""
    sizes = np.random.default_rng(0).uniform(0.05, 0.6, 80)

    def of(a, seed):
        record = make_duffing(120, noise=0.0, amplitude=a, random_state=seed)
        return record.u, record.y

    model = wrong_model(make_duffing)
    pairs = [of(a, seed) for seed, a in enumerate(sizes)]
    u, y = [p[0] for p in pairs], [p[1] for p in pairs]
    tube = model.tube(u[:40], y[:40])
    assert tube.n_blocks.tolist() == [30]
    widths = np.array([tube.half_width(z)[0, 0] for z in u[40:]])
    small, large = sizes[40:] < 0.2, sizes[40:] > 0.45
    assert widths[large].mean() > 2 * widths[small].mean()
    inside = tube.contains(u[40:], y[40:])
    assert inside[large].mean() > 0.6 and inside.mean() > 0.8


def test_the_scale_of_known_errors(rng):
    sizes = np.ones((400, 1, 3))
    sizes[:, 0, 1:] = rng.uniform(0.5, 2, (400, 2))
    errors = (sizes @ np.array([0.1, 0.5, 0.2])) * rng.uniform(0.99, 1.01, (400, 1))
    fits, coefficients = fit_scale(errors, sizes, 0.9)
    assert fits.sum() == 100
    np.testing.assert_allclose(coefficients[0], [0.1, 0.5, 0.2], atol=0.01)
    # too few, or no error at all: the same width for all
    for e, s in ((errors[:12], sizes[:12]), (0 * errors, sizes)):
        np.testing.assert_array_equal(fit_scale(e, s, 0.9)[1], [[1, 0, 0]])
    assert not fit_scale(errors[:12], sizes[:12], 0.9)[0].any()


# -- many outputs, gaps, shapes --------------------------------------------------------


@pytest.fixture(scope="module")
def two_outputs():
    rng = np.random.default_rng(0)
    A, B, C = np.array([[0.8, 0.1], [-0.2, 0.7]]), np.eye(2), np.eye(2)
    us = [rng.standard_normal((60, 2)) for _ in range(81)]
    ys = [simulate_linear(A, B, C, u) for u in us]
    ys = [y + 0.1 * rng.standard_t(3, y.shape) * [1, 5] for y in ys]
    return LinearStateSpace(nx=2, dt=1.0).fit(us[0], ys[0]), us[1:], ys[1:]


def test_every_output_has_its_level(two_outputs):
    model, u, y = two_outputs
    each = model.tube(u[:40], y[:40])
    joint = model.tube(u[:40], y[:40], joint=True)
    assert each.n_blocks.tolist() == joint.n_blocks.tolist() == [30, 30]
    assert (joint.quantile >= each.quantile).all() and each.typical[1] > each.typical[0]
    assert joint.quantile[0] == joint.quantile[1]
    assert each.contains(u[40:], y[40:]).shape == (40, 2)
    assert joint.contains(u[40:], y[40:]).shape == (40,)
    band = each.around(u[40], y[40])
    assert band.y.shape == band.lower.shape == (60, 2)
    assert "of all outputs together" in repr(joint)
    assert "stay within, each output alone, free run" in repr(each)
    words = "of the calibration, of each output alone, |y_plant - y_lin|"
    assert words in repr(each.with_bound(0.1))
    assert "of the calibration, |y_plant" in repr(joint.with_bound(0.1))
    local = SimpleNamespace(output_bounds=np.ones(2), verdict="holds")
    words = "while v stays within the amplitude of the certificate, from rest.\n"
    assert words in repr(each.with_bound(local))


def test_missing_outputs_do_not_count(two_outputs):
    model, u, y = two_outputs
    whole = model.tube(u[:40], y[:40])
    holes = [z.copy() for z in y[:40]]
    holes[3][:, 0] = np.nan  # never measured
    tube = model.tube(u[:40], holes)
    assert tube.n_blocks.tolist() == [29, 30]
    assert tube.quantile[1] == pytest.approx(whole.quantile[1])
    # what was not measured was not outside
    wild = y[41].copy()
    wild[30] = 1e6
    assert not whole.contains(u[41], wild).any()
    wild[30] = np.nan
    kept = whole.contains([u[41]], [y[41]])
    np.testing.assert_array_equal(whole.contains([u[41]], [wild]), kept)


def test_a_band_is_what_contains_compares(two_outputs):
    model, u, y = two_outputs
    for tube in (
        model.tube(u[:40], y[:40]),
        model.tube(u[:40], y[:40], horizon=2),
        model.tube(u[:40], y[:40], block=20, gap=0),
    ):
        for u_i, y_i in zip(u[40:44], y[40:44], strict=True):
            band = tube.around(u_i, y_i)
            inside = (band.lower <= y_i) & (y_i <= band.upper)
            width = tube.half_width(u_i, y_i)
            np.testing.assert_allclose(band.upper - band.y, width)
            if tube.block is None:  # blocks of `around` begin with the record
                counted = inside[15:]  # a quarter of it estimates the initial state
                np.testing.assert_array_equal(
                    tube.contains(u_i, y_i), [counted.all(axis=0)]
                )


def test_shapes_and_containers():
    rng = np.random.default_rng(1)
    u = rng.standard_normal(900)
    y = simulate_linear(np.eye(1) / 2, np.eye(1), np.eye(1), u[:, None])[:, 0]
    y += 0.1 * rng.standard_normal(900)
    model = LinearStateSpace(nx=1, dt=1.0).fit(u[:200], y[:200])
    tube = model.tube(u[200:], y[200:])
    assert tube.block >= 10 and tube.finite
    band = tube.around(u[200:])
    assert band.y.shape == band.upper.shape == (700,)
    np.testing.assert_allclose(band.y, model.predict(u[200:]))
    np.testing.assert_array_equal(tube.around(u[200:, None].tolist()).y, band.y)
    wider = tube.with_bound(0.3).half_width(u[200:])
    np.testing.assert_allclose(wider, tube.half_width(u[200:]) + 0.3)
    frame = LinearStateSpace(nx=1, dt=1.0).fit(
        pd.DataFrame({"u": u[:200]}), pd.DataFrame({"y": y[:200]})
    )
    same = frame.tube(pd.DataFrame({"u": u[200:]}), pd.DataFrame({"y": y[200:]}))
    np.testing.assert_allclose(same.quantile, tube.quantile, rtol=1e-6)
    x0 = np.ones(1)
    np.testing.assert_allclose(
        tube.around(u[200:], x0=x0).y, model.predict(u[200:], x0=x0)
    )
    ahead = model.tube(u[200:], y[200:], horizon=1)
    assert ahead.around(u, y).y.shape == (900,) and "1 samples ahead" in repr(ahead)


def test_slow_errors_make_long_blocks():
    rng, spans = np.random.default_rng(0), []
    for pole in (0.0, 0.95):
        e = np.zeros((20000, 1))
        for k in range(1, len(e)):
            e[k] = pole * e[k - 1] + rng.standard_normal()
        run = Run(np.zeros_like(e), e, np.zeros_like(e), 0)
        block, gap = lengths([run], 0.9, "auto", None)
        spans.append(block)
        assert gap == pytest.approx(block / 2, abs=4)
    assert spans[0] == 10
    assert spans[1] == pytest.approx(4 * 1.95 / 0.05, rel=0.4)


# -- what is missing is said -----------------------------------------------------------


def test_too_few_units_make_no_tube(two_outputs):
    model, u, y = two_outputs
    tube = model.tube(u[:8], y[:8], block="experiment")
    assert not tube.finite and np.isinf(tube.half_width(u[0])).all()
    assert "8 experiments are too few for the level 0.9, which takes 9" in tube.reason
    assert repr(tube).startswith("Tube: infinite, free run. 8 experiments are too few")
    assert tube.contains(u[10:], y[10:]).all()
    assert tube.coverage_range.tolist() == [[1, 1], [1, 1]]
    assert "infinite" in repr(tube.with_bound(0.1))
    none = model.tube(u[:8], y[:8], block=1000)
    assert none.n_blocks.tolist() == [0, 0] and "0 blocks" in none.reason
    # blocks instead of experiments, of themselves
    assert model.tube(u[:8], y[:8]).block is not None


def test_a_simulation_that_diverges_is_outside(two_outputs, monkeypatch):
    model, u, y = two_outputs
    runs = simulated_runs(model, u[:40], y[:40], None, None)
    runs[:12] = [run._replace(y_hat=run.y_hat * np.inf) for run in runs[:12]]
    monkeypatch.setattr(
        "alssnn.certificates._tube.simulated_runs", lambda *_, **__: runs
    )
    tube = model.tube(u, y)
    assert tube.n_blocks.tolist() == [30, 30] and np.isinf(tube.scores[:9]).all()
    assert "diverges in more than 0.1 of 30 experiments" in tube.reason
    # nine of 30 are fewer than four of ten
    tube = model.tube(u, y, level=0.6)
    assert tube.finite and tube.contains(u, y)[12:].mean() > 0.6
    assert not tube.contains(u, y)[:12].any()
    assert np.isinf(tube.half_width(u[0]).reshape(40, -1)[:12]).any()


def test_a_tube_says_what_it_rests_on(two_outputs):
    model, u, y = two_outputs
    tube = model.tube(u[:40], y[:40])
    text = repr(tube)
    assert "0.9 of future experiments" in text and "calibrated on 30" in text
    assert "if the experiments of the calibration" in text
    blocks = model.tube(u[:40], y[:40], block=20, gap=5)
    assert "not of a whole record" in blocks.assumption and "gaps of 5" in repr(blocks)
    for one in (tube, blocks):  # a unit with gaps shows less of its largest error
        assert "share of samples that are measured" in one.assumption
    few = replace(blocks, n_blocks=np.full_like(blocks.n_blocks, 17))
    enough = replace(blocks, n_blocks=np.full_like(blocks.n_blocks, 18))
    assert "the blocks are few" in repr(few) and "few" not in repr(enough)
    assert "few" not in repr(replace(few, block=None))


def test_a_tube_with_a_bound(two_outputs):
    model, u, y = two_outputs
    tube = model.tube(u[:40], y[:40])
    certificate = iss_certificate(model.A_, model.C_, eps=0.1)
    both = tube.with_bound(certificate)
    np.testing.assert_array_equal(both.bound, certificate.output_bounds)
    np.testing.assert_allclose(
        both.half_width(u[50]), tube.half_width(u[50]) + certificate.output_bounds
    )
    assert "within the number that was given" in repr(both)
    assert "With 0.9 of future experiments like" in both.statement
    blocks = model.tube(u[:40], y[:40], block=20, gap=5).with_bound(0.1)
    assert "With 0.9 of future blocks of 20 samples like" in blocks.statement
    assert "of them the tube says nothing until" in both.statement
    assert "plus 0.2.\n" in repr(tube.with_bound(0.2))
    assert "infinite" in repr(tube.with_bound(np.inf))
    for wrong in (-1.0, [1, 2, 3], "much"):
        with pytest.raises(ValueError, match="`bound` must be at least 0"):
            tube.with_bound(wrong)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"level": 1.0}, "`level` must be between 0 and 1, got 1.0"),
        ({"level": "high"}, "`level` must be between 0 and 1, got 'high'"),
        ({"block": 0}, "`block` must be 'auto', 'experiment' or a positive"),
        ({"block": "day"}, "`block` must be 'auto'"),
        ({"horizon": 0}, "`horizon` must be an integer of at least 1 or None"),
        ({"gap": -1}, "`gap` must be an integer of at least 0 or None"),
    ],
)
def test_wrong_arguments(two_outputs, options, said):
    model, u, y = two_outputs
    with pytest.raises(ValueError, match=said):
        model.tube(u, y, **options)


def test_a_horizon_needs_outputs(two_outputs):
    model, u, y = two_outputs
    tube = model.tube(u[:40], y[:40], horizon=3)
    with pytest.raises(ValueError, match="`y` must be given for a tube 3 samples"):
        tube.around(u[50])
    with pytest.raises(ValueError, match=r"`x0` must be finite, of shape \(2,\)"):
        model.tube(u[:40], y[:40]).around(u[50], x0=np.zeros(3))


def test_the_gain_of_a_known_error(rng):
    """The plant adds a tenth of the input: every block has that gain."""
    u, plant = rng.standard_normal((3_000, 1)), make_wiener_hammerstein(800)
    model = LinearStateSpace(nx=4, dt=plant.dt).fit(*plant)
    y = model.simulate(u, x0=np.zeros(4)) + 0.1 * u
    y[100:130] = np.nan
    error = error_gain(model, u, y, block=100)
    assert error.gain.shape == (1, 1) and error.n_blocks >= 9
    assert error.gain[0, 0] == pytest.approx(0.1, rel=0.1)
    assert f"{error.n_blocks} that were used" in repr(error)
    still = np.full((500, 1), model.u_offset_[0])
    lost = np.full((500, 1), np.nan)
    units = (
        [u[:500], u[500:1000], still, u[:500]],
        [y[:500], y[500:1000], y[:500], lost],
    )
    some = error_gain(model, *units, block="experiment", level=0.5)
    assert (
        some.n_blocks == 2 and np.isfinite(some.gain).all()
    )  # the others tell nothing
    assert "No input leaves" in repr(error_gain(model, [still] * 9, [y[:500]] * 9))
    few = error_gain(model, u[:300], y[:300], block=100)
    assert np.isinf(few.gain).all() and "too few" in repr(few)
    half = np.float32(0.5)  # of NumPy is a number, too
    assert error_gain(model, *units, block="experiment", level=half).n_blocks == 2
    with pytest.raises(ValueError, match="`level` must be between 0 and 1"):
        error_gain(model, u, y, level=2.0)


def test_fresh_records_keep_the_gain_of_the_error():
    model = wrong_model(make_pendulum)
    u, y = records(make_pendulum, range(600, 640))
    error = error_gain(model, u, y)
    fresh = records(make_pendulum, range(700, 800))
    kept = []
    for u_k, y_k in zip(*fresh, strict=True):
        one = error_gain(model, [u_k], [y_k], level=0.5, block="experiment")
        kept.append(one.gain[0, 0] <= error.gain[0, 0])
    assert 0.8 <= np.mean(kept) <= 0.98


# -- units in exact numbers ------------------------------------------------------------


def run_of(u, y, y_hat, start=0):
    columns = (np.asarray(z, dtype=float).reshape(len(z), -1) for z in (u, y, y_hat))
    return Run(*columns, start)


def test_scores_are_errors_over_their_scale():
    """The scale is 1 + 3 y_size + 2 u_size of the first output, 4 of the second."""
    errors = np.array([[16.0, 1.0], [np.nan, np.inf], [8.0, 0.0]])
    sizes = np.ones((3, 2, 3))
    sizes[0, 0, 1:] = 1.0, 2.0
    sizes[2, 0, 1:] = 0.0, np.inf
    coefficients = np.array([[1.0, 3.0, 2.0], [4.0, 0.0, 0.0]])
    expected = [[1 + 3 + 4, 4], [1 + 3 + 2, 4], [np.inf, 4]]
    np.testing.assert_array_equal(scale(sizes, coefficients), expected)
    scores = scores_of(errors, sizes, coefficients)
    np.testing.assert_array_equal(scores, [[2, 1 / 4], [np.nan, np.inf], [0, 0]])
    # of a run that diverges nothing else is known
    errors, sizes[2, 0, 1:] = np.full((3, 2), np.inf), (np.inf, 1.0)
    assert np.isinf(scores_of(errors, sizes, coefficients)).all()


def test_units_are_measured_around_the_operating_point():
    y = [[3.0, 1.0], [np.nan, 1.0], [0.0, 1.0]]
    y_hat = [[1.0, 1.0], [9.0, -1.0], [-1.0, 2.0]]
    unit = run_of([[5.0], [7.0], [3.0]], y, y_hat)
    errors, sizes = measure([unit], np.array([5.0]), np.array([1.0, 0.0]))
    np.testing.assert_array_equal(errors, [[2.0, 2.0]])
    u_size = np.sqrt((0 + 4 + 4) / 3)
    expected = [[1, np.sqrt((0 + 64 + 4) / 3), u_size], [1, np.sqrt(2), u_size]]
    np.testing.assert_allclose(sizes[0], expected)
    none = unit._replace(y=np.full((3, 2), np.nan), y_hat=np.full((3, 2), np.inf))
    assert np.isnan(measure([none], np.zeros(1), np.zeros(2))[0]).all()
    diverges = unit._replace(
        y_hat=np.array([[1.0, 1.0], [np.nan, 1.0], [-1.0, np.nan]])
    )
    errors = measure([diverges], np.zeros(1), np.zeros(2))[0]
    np.testing.assert_array_equal(errors, [[2.0, np.inf]])  # y was missing where it did


def test_units_are_cut_with_gaps():
    run = run_of(np.arange(20), np.arange(20), np.zeros(20), start=3)
    whole = units_of([run, run_of([1, 2], [1, 2], [0, 0], start=2)], None, 0)
    assert [len(unit.u) for unit in whole] == [17] and whole[0].u[0] == 3
    first = [int(unit.y[0, 0]) for unit in units_of([run], 5, 1)]
    assert first == [3, 9, 15] and units_of([run], 5, 1)[-1].y[-1] == 19
    assert [int(unit.u[0, 0]) for unit in units_of([run], 6, 1)] == [3, 10]
    assert units_of([run], 18, 0) == [] and whole[0].start == 0


def test_lengths_of_blocks():
    noise = np.random.default_rng(0).standard_normal((400, 1))
    run = run_of(np.zeros(400), noise, np.zeros(400))
    assert lengths([run], 0.9, "experiment", None) == (None, 0)
    assert lengths([run] * 9, 0.9, "auto", None) == (None, 0)
    assert lengths([run] * 8, 0.9, "auto", None)[0] == 10
    # experiments without a sample that counts are none
    assert lengths([run] * 8 + [run._replace(start=400)], 0.9, "auto", 0) == (10, 0)
    assert lengths([run._replace(start=399)] * 9, 0.9, "auto", None) == (None, 0)
    block, gap = lengths([run], 0.9, 7, None)
    assert block == 7 and gap in (2, 3)
    assert lengths([run], 0.9, 7, 4) == (7, 4)
    slow = 50 * np.sin(np.arange(400) / 100)[:, None]  # of the plant and its model
    same = run._replace(y=slow + noise, y_hat=slow)
    assert lengths([same], 0.9, 7, None) == (block, gap)
    # what diverges counts as no error, as what was not measured does
    missing = run._replace(y=np.r_[noise[:350], np.full((50, 1), np.nan)])
    for end in (np.inf, -np.inf, np.nan):
        diverges = run_of(np.zeros(400), noise, np.r_[np.zeros(350), np.full(50, end)])
        assert lengths([diverges], 0.9, 7, None) == lengths([missing], 0.9, 7, None)
    # sizes that come and go
    size = np.where(np.arange(400) // 50 % 2, 0.1, 3.0)[:, None]
    assert lengths([run._replace(y=noise * size)], 0.9, "auto", 0)[0] > 40


def test_the_scale_is_never_below_a_tenth_of_the_median(rng):
    """Errors that are proportional to the input need no constant, yet have one."""
    sizes = np.ones((80, 2, 3))
    sizes[:, :, 1], sizes[:, :, 2] = 0.0, rng.uniform(1, 9, (80, 1))
    errors = 0.5 * sizes[:, :, 2] * [1, 10]
    errors[0, 0], sizes[4, 1, 2] = np.inf, np.nan  # tell nothing
    fits, coefficients = fit_scale(errors, sizes, 0.9)
    assert np.flatnonzero(fits).tolist() == list(range(0, 80, 4))
    np.testing.assert_allclose(coefficients[:, 2], [0.5, 5.0], rtol=1e-6)
    fitted = errors[fits]
    for i, known in enumerate((np.arange(20) > 0, np.arange(20) != 1)):
        least = 0.1 * np.median(fitted[known, i])
        assert coefficients[i, 0] == pytest.approx(least)
    # the rest has to be enough for the level: 9 of 12, 12 of 16
    for n, of in ((24, True), (20, False)):
        assert fit_scale(errors[:n], sizes[:n], 0.9)[0].any() == of
    assert not fit_scale(errors, sizes, 0.99)[0].any()


def test_states_of_a_given_start_have_its_units():
    """A system whose states are a thousand times as large as those of the fit."""
    rng = np.random.default_rng(0)
    A, B, C = np.array([[0.5]]), np.array([[1e3]]), np.array([[1e-3]])
    u = rng.standard_normal((300, 1))
    y = simulate_linear(A, B, C, u) + 0.01 * rng.standard_normal((300, 1))
    model = LinearStateSpace(nx=1, dt=1.0, linear_start=(A, B, C)).fit(u, y)
    x0 = np.array([2e3])
    (run,) = simulated_runs(model, u, y, None, None, x0)
    np.testing.assert_allclose(run.y_hat, model.predict(u, x0=x0))
    assert run.y_hat[0] == pytest.approx(2.0, rel=0.1)
    for horizon, start in ((2, run.start), (run.start + 7, run.start + 7)):
        (ahead,) = simulated_runs(model, u, y, None, horizon)
        assert ahead.start == start


def test_the_gain_of_the_error_is_that_of_its_size(monkeypatch):
    """Errors of 1, 2, ..., 9 times the input; the moved one, in units of 4."""
    u = np.column_stack([[7.0, 7.0, 7.0, 7.0], [1.0, 5.0, 1.0, 5.0]])
    still = run_of(np.tile([9.0, 3.0], (4, 1)), np.ones(4), np.zeros(4))
    size = np.array([1.0, -1.0, 1.0, 1.0])
    says = np.array([3.0, 1.0, -2.0, 5.0])  # the model
    runs = [run_of(u, says + k * size, says) for k in range(1, 10)]
    plant = SimpleNamespace(
        ny=1,
        moved=np.array([1]),
        u_offset=np.array([9.0, 3.0]),
        v_scale=np.array([4.0]),
    )
    model = SimpleNamespace(plant_=plant)

    def gain(runs, **options):
        monkeypatch.setattr(_error_gain, "simulated_runs", lambda *_: runs)
        return error_gain(model, None, None, block="experiment", **options)

    found = gain(runs)  # u deviates by 2, or half of its unit
    np.testing.assert_allclose(found.gain, [[9 / 0.5 / 4]])
    assert found.n_blocks == 9 and not found.reason
    assert "<= 4.5 |u| in l2 in 0.9 of future experiments like the 9" in repr(found)
    assert "alone" not in repr(found)
    two = replace(found, gain=np.ones((2, 1)))
    assert repr(two).endswith("that were used, of each output alone")
    np.testing.assert_allclose(gain(runs, level=0.5).gain, [[5 / 0.5 / 4]])
    # the largest of ten is that of eleven at most
    assert np.isinf(gain(runs[:8]).gain) and "8 experiments are too few" in repr(
        gain(runs[:8])
    )
    # what says nothing does not count, what diverges does
    lost = runs[0]._replace(y=np.full((4, 1), np.nan))
    assert gain([*runs, still, lost]).n_blocks == 9
    diverges = runs[0]._replace(y_hat=np.full((4, 1), np.inf))
    found = gain([*runs[:8], diverges])
    assert np.isinf(found.gain) and "diverges" in found.reason
    # missing samples are left out of the mean
    for measured in ([0, 3], [2]):
        some = np.full((4, 1), np.nan)
        some[measured, 0] = says[measured] + 9.0
        found = gain([*runs[:8], runs[8]._replace(y=some)])
        np.testing.assert_allclose(found.gain, [[9 / 0.5 / 4]])
    assert "No input leaves the operating point" in repr(gain([still] * 9))
    blocks = gain([run_of(np.tile(u, (2, 1)), np.tile(size, 2), np.zeros(8))] * 9)
    np.testing.assert_allclose(blocks.gain, [[1 / 0.5 / 4]])


def test_what_leaves_the_tube_at_one_sample_is_outside(two_outputs):
    """The half width is what errors are compared with, up to the last digit."""
    model, u, y = two_outputs
    tube = model.tube(u[:40], y[:40])
    band = tube.around(u[45], y[45])
    start = model.prepare_records([u[45]], [y[45]])[0].start
    width = tube.half_width(u[45], y[45])
    for share, inside in ((0.999, True), (1.001, False)):
        for sign in (1, -1):
            moved = y[45].copy()
            moved[start:] = (band.y + 0.1 * width)[start:]
            moved[-1] = (band.y + sign * share * width)[-1]
            assert tube.contains([u[45]], [moved]).all() == inside


def test_what_one_calibration_keeps_is_beta_distributed(two_outputs):
    """The largest of 12 scores is that of 13: the share below it is beta(12, 1)."""
    model, u, y = two_outputs
    tube = model.tube(u[:12], y[:12], level=0.9, block="experiment")
    assert tube.n_blocks.tolist() == [12, 12]
    expected = np.array([0.05, 0.95]) ** (1 / 12)
    np.testing.assert_allclose(tube.coverage_range, [expected, expected])
    np.testing.assert_array_equal(tube.quantile, tube.scores.max(axis=0))
    np.testing.assert_allclose(tube.typical, tube.quantile)  # the scale is one


def test_gains_in_words():
    assert in_words(np.array([[4.5]])) == "4.5"
    assert in_words(np.array([[1.0, 2.0]])) == "[[1, 2]]"
    assert in_words(np.array([[1.0, 2.0], [3.0, 4.0]])) == "[[1, 2], [3, 4]]"
    assert plain(np.array([2.0, 2.0])) == "2" and plain([1, 2.5]) == "[1, 2.5]"
