"""Frequency responses without a model: exact where they can be, and honest bands."""

import control
import numpy as np
import pandas as pd
import polars
import pytest
from scipy.signal import butter, freqz, lfilter
from scipy.stats import f as f_distribution
from scipy.stats import t as t_distribution

from alssnn.datasets import fetch_silverbox
from alssnn.excitation import multisine, prbs, steps
from alssnn.nonparametric import (
    best_linear_approximation,
    local_polynomial,
    noise_of_repeats,
)
from benchmarks import nonparametric as benchmark

FIRST, SECOND = butter(2, 0.3), butter(2, 0.4)
MIX = np.array([[1.0, 0.5], [-0.3, 2.0], [0.4, 0.0]])
METHODS = {
    "robust": {"n_realizations": 4},
    "fast": {"grid": "odd-random", "n_realizations": 1},
}


def plant(u):
    """Return the outputs of a linear plant; (N, nu) to (N, nu + 1)."""
    nu = u.shape[1]
    systems = (FIRST, SECOND)[:nu]
    x = [lfilter(*s, z) for s, z in zip(systems, u.T, strict=True)]
    return np.stack(x, axis=1) @ MIX[: nu + 1, :nu].T


def response(frequencies, nu):
    """Return its true frequency response, (n, nu + 1, nu), at dt = 1."""
    systems = (FIRST, SECOND)[:nu]
    g = np.stack([freqz(*s, 2 * np.pi * frequencies)[1] for s in systems], axis=1)
    return MIX[: nu + 1, :nu] * g[:, None, :]


def measured(excitation, noise=0.0, seed=0, system=plant):
    """Return the outputs of all experiments, each from rest, with white noise."""
    y = np.concatenate([system(u) for u in excitation.experiments])
    return y + noise * np.random.default_rng(seed).standard_normal(y.shape)


# -- periodic records ------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("nu", [1, 2])
def test_without_noise_a_linear_plant_is_found_exactly(nu, method):
    excitation = multisine(256, nu, random_state=0, **METHODS[method])
    bla = best_linear_approximation(excitation, measured(excitation))
    assert bla.method == method
    assert bla.G.shape == (len(excitation.lines), nu + 1, nu)
    np.testing.assert_allclose(bla.frequencies, excitation.frequencies)
    # the transient of the first period, which is left out, has decayed below 1e-12
    np.testing.assert_allclose(bla.G, response(bla.frequencies, nu), atol=1e-10)
    assert bla.p_linear > 0.05
    assert bla.noise_rms.max() < 1e-10 and bla.total_rms.max() < 1e-10


def test_the_robust_method_is_mean_and_scatter_of_quotients():
    """The oracle of one input: Y / U of every realization, their mean and variance."""
    excitation = multisine(128, n_realizations=5, n_periods=4, random_state=0)
    y = measured(excitation, 0.1, system=lambda u: u + 0.3 * u**3)
    bla = best_linear_approximation(excitation, y)
    u, y = (z.reshape(5, 4, 128)[:, 1:] for z in (excitation.u, y))
    U, Y = (np.fft.rfft(z.mean(axis=1))[:, excitation.lines] for z in (u, y))
    G = Y / U
    np.testing.assert_allclose(bla.G[:, 0, 0], G.mean(axis=0), rtol=1e-10)
    variance = G.var(axis=0, ddof=1) / 5
    np.testing.assert_allclose(bla.std[:, 0, 0] ** 2, variance, rtol=1e-9)
    assert bla.dof == 4
    # three periods have two bins of noise around each line, and their squares add up
    # to the variance between the periods
    between = y.var(axis=1, ddof=1).mean()
    assert bla.noise_rms[0] ** 2 == pytest.approx(between, rel=1e-9)


def test_several_inputs_need_not_be_orthogonal_but_independent():
    rng = np.random.default_rng(0)
    period = rng.standard_normal((5, 1, 64, 2))
    u = np.tile(period, (1, 4, 1, 1)).reshape(5, -1, 2)
    y = [plant(z) + 0.01 * rng.standard_normal((256, 3)) for z in u]
    bla = best_linear_approximation(list(u), y, period=64)
    assert bla.method == "robust" and bla.dof == 3
    G = response(bla.frequencies, 2)
    assert bla.covers(G).mean() > 0.9
    # least squares at one line, by NumPy's own solver
    k = 10
    U, Y = (
        np.fft.rfft(np.mean([z[64:128], z[128:192], z[192:]], 0), axis=0)[k]
        for z in (u[0], y[0])
    )
    rows = [
        tuple(np.fft.rfft(z.reshape(4, 64, -1)[1:].mean(0), axis=0)[k] for z in pair)
        for pair in zip(u, y, strict=True)
    ]
    np.testing.assert_allclose(rows[0][0], U)
    np.testing.assert_allclose(rows[0][1], Y)
    A, B = (np.array(z) for z in zip(*rows, strict=True))
    solution = np.linalg.lstsq(A, B)[0].T
    (at,) = np.flatnonzero(np.isclose(bla.frequencies, k / 64))
    np.testing.assert_allclose(bla.G[at], solution, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_bands_cover_the_truth_as_often_as_they_say(method):
    covered, bands, called = [], [], []
    for seed in range(60):
        excitation = multisine(256, 2, random_state=seed, **METHODS[method])
        bla = best_linear_approximation(excitation, measured(excitation, 0.1, seed))
        G = response(bla.frequencies, 2)
        covered.append(bla.covers(G).mean())
        low, high = bla.band()
        bands.append(np.mean((low <= np.abs(G)) & (np.abs(G) <= high)))
        called.append(bla.p_linear < 0.05)
    assert np.mean(covered) == pytest.approx(0.95, abs=0.01)
    assert np.mean(bands) == pytest.approx(0.95, abs=0.02)
    assert np.mean(called) < 0.15  # 0.05 but for chance


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_levels_of_noise_are_true_at_every_frequency(pole):
    excitation = multisine(256, n_realizations=40, n_periods=5, random_state=0)
    rng = np.random.default_rng(0)
    e = 0.1 * rng.standard_normal(len(excitation))
    y = excitation.u[:, 0] + lfilter([1], [1, -pole], e)
    bla = best_linear_approximation(excitation, y)
    z = np.exp(2j * np.pi * bla.frequencies)
    expected = 0.1 * np.abs(1 / (1 - pole / z)) * np.sqrt(2 / 256)
    ratio = bla.noise[:, 0] / expected
    assert ratio.mean() == pytest.approx(1, abs=0.02)
    assert np.abs(ratio - 1).max() < 0.25  # six lines of 160 samples
    assert bla.noise_rms[0] == pytest.approx(0.1 / np.sqrt(1 - pole**2), rel=0.05)
    # nothing but noise: by chance, and far below
    assert np.mean(bla.distortion**2) < 0.1 * np.mean(bla.noise**2)
    assert bla.total_rms[0] == pytest.approx(bla.noise_rms[0], rel=0.02)


@pytest.mark.parametrize(
    ("curve", "even", "odd"),
    [(lambda u: u + u**2, True, False), (lambda u: u + u**3, False, True)],
)
@pytest.mark.parametrize("method", METHODS)
def test_even_and_odd_are_told_apart(curve, even, odd, method):
    options = METHODS[method] | {"grid": "odd-random"}
    excitation = multisine(1024, n_periods=4, random_state=0, **options)
    y = measured(excitation, 1e-4, system=curve)
    bla = best_linear_approximation(excitation, y)
    assert bla.method == method and bla.p_linear < 1e-10
    powers = [np.mean(level**2) for level in (bla.even, bla.odd)]
    gap = 10 * np.log10(powers[0] / powers[1])
    assert gap > 20 if even else gap < -20
    # an even one does not disturb what was excited
    disturbed = np.mean(bla.distortion**2) > 10 * np.mean(bla.noise**2)
    assert disturbed == odd


def test_distortion_is_that_of_many_realizations():
    def system(u):
        x = lfilter(*FIRST, u, axis=0)
        return x + x**2 - x**3

    excitation = multisine(256, band=(0, 0.2), n_realizations=200, random_state=0)
    y = measured(excitation, 0.0, system=system)
    U, Y = (
        np.fft.rfft(z.reshape(200, 3, 256)[:, 1]) for z in (excitation.u[:, 0], y[:, 0])
    )
    G = np.sum(Y * U.conj(), axis=0)[excitation.lines]
    G /= np.sum(np.abs(U) ** 2, axis=0)[excitation.lines]
    rest = Y[:, excitation.lines] - G * U[:, excitation.lines]
    expected = np.mean(np.abs(np.sqrt(2) / 256 * rest) ** 2)
    part = len(y) * 8 // 200
    few = [excitation.u[:part], y[:part], excitation.experiment[:part]]
    bla = best_linear_approximation(*few, period=256, lines=excitation.lines)
    assert bla.dof == 7
    assert 10 * np.log10(np.mean(bla.distortion**2) / expected) == pytest.approx(
        0, abs=1
    )
    assert np.all(np.isnan(bla.even)) and np.all(np.isnan(bla.odd))  # a full grid


def test_lists_and_labels_are_the_same_record():
    excitation = multisine(64, random_state=0)
    y = measured(excitation, 0.1)[:, 0]
    one = best_linear_approximation(excitation, y)
    parts = np.split(y, 4)
    two = best_linear_approximation(excitation, parts)
    three = best_linear_approximation(excitation.experiments, parts, period=64)
    for other in (two, three):
        np.testing.assert_array_equal(other.G, one.G)
        np.testing.assert_array_equal(other.covariance, one.covariance)
    pair = local_polynomial([excitation.u, excitation.u], [y, y])
    assert pair.G.shape[1:] == (1, 1)


def test_periods_with_gaps_do_not_count():
    excitation = multisine(64, n_periods=6, random_state=0)
    y = measured(excitation, 0.1)
    gaps = y.copy()
    gaps[64 * 5 + 3, 1] = np.nan  # the last period of the first experiment
    one = best_linear_approximation(excitation, gaps)
    us, ys = excitation.experiments, np.split(y, 4)
    us[0], ys[0] = us[0][: 64 * 5], ys[0][: 64 * 5]
    two = best_linear_approximation(us, ys, period=64, lines=excitation.lines)
    np.testing.assert_allclose(one.G, two.G)
    np.testing.assert_allclose(one.covariance, two.covariance)
    # in the middle it leaves two runs of periods, one of them too short for noise
    gaps = y.copy()
    gaps[64 * 2 + 3] = np.nan
    three = best_linear_approximation(excitation, gaps)
    assert three.covers(response(three.frequencies, 1)).mean() > 0.85


def test_lines_are_found_in_the_input():
    excitation = multisine(256, 2, grid="odd-random", random_state=0)
    y = measured(excitation, 0.01)
    named = best_linear_approximation(excitation, y)
    u = excitation.u + 1e-4 * np.random.default_rng(0).standard_normal(
        excitation.u.shape
    )
    found = best_linear_approximation(u, y, excitation.experiment, period=256)
    np.testing.assert_allclose(found.frequencies, named.frequencies)
    np.testing.assert_allclose(found.G, named.G, atol=0.02)


def test_noise_of_a_measured_input_counts_with_its_effect():
    excitation = multisine(256, n_realizations=8, n_periods=6, random_state=0)
    y = measured(excitation)
    rng = np.random.default_rng(0)
    u = excitation.u + 0.02 * rng.standard_normal(excitation.u.shape)
    bla = best_linear_approximation(
        u, y, excitation.experiment, period=256, lines=excitation.lines
    )
    G = response(bla.frequencies, 1)
    expected = 0.02 * np.sqrt(2 / 256) * np.abs(G[:, :, 0])
    ratio = np.mean(bla.noise**2, axis=0) / np.mean(expected**2, axis=0)
    np.testing.assert_allclose(ratio, 1, atol=0.15)
    assert bla.covers(G).mean() == pytest.approx(0.95, abs=0.03)


def test_units_of_the_data_are_those_of_the_result():
    excitation = multisine(128, 2, random_state=0)
    y = measured(excitation, 0.1)
    one = best_linear_approximation(excitation, y)
    u_unit, y_unit = np.array([1e3, 1e-3]), np.array([1e-6, 1.0, 1e4])
    other = best_linear_approximation(
        excitation.u * u_unit, y * y_unit, excitation.experiment, period=128, dt=0.1
    )
    unit = y_unit[:, None] / u_unit
    np.testing.assert_allclose(other.G, one.G * unit)
    np.testing.assert_allclose(other.std, one.std * unit)
    np.testing.assert_allclose(other.radius(0.9), one.radius(0.9) * unit)
    np.testing.assert_allclose(other.noise, one.noise * y_unit)
    np.testing.assert_allclose(other.total_rms, one.total_rms * y_unit)
    np.testing.assert_allclose(other.frequencies, 10 * one.frequencies)
    assert other.p_linear == pytest.approx(one.p_linear, rel=1e-6)


def test_covariances_of_entries_are_those_of_many_records():
    """Errors of entries are correlated, and complex, as is said: at every line.

    Three experiments of two inputs that are not orthogonal, so that errors of the two
    columns of G depend on each other.
    """
    u = np.tile(np.random.default_rng(0).standard_normal((3, 1, 16, 2)), (1, 3, 1, 1))
    u = list(u.reshape(3, 48, 2))
    shaped = np.array([[1.0, 0.8], [0.0, 0.6]])
    errors, said = [], []
    for seed in range(1000):
        e = np.random.default_rng(seed).standard_normal((3, 48, 2)) @ shaped
        bla = best_linear_approximation(
            u, [a + b for a, b in zip(u, e, strict=True)], period=16, lines=range(1, 8)
        )
        errors.append((bla.G - np.eye(2)).reshape(-1, 4))
        said.append(bla.noise_covariance)
    found = np.einsum("ski,skj->kij", errors, np.conj(errors)) / 1000
    for ours, theirs in zip(np.mean(said, axis=0), found, strict=True):
        size = np.sqrt(np.outer(np.diag(theirs), np.diag(theirs)).real)
        # correlations of 1,000 errors, five standard deviations of chance
        np.testing.assert_allclose(ours / size, theirs / size, atol=5 / np.sqrt(1000))
    assert np.abs(found.imag / size).max() > 0.5  # or it would not matter


# -- local polynomials -----------------------------------------------------------------


def test_a_static_gain_is_found_exactly_whatever_the_input():
    u = steps(500, 2, hold=(1, 9), random_state=0).u
    result = local_polynomial(u, u @ MIX.T, n_frequencies=None)
    np.testing.assert_allclose(
        result.G, np.broadcast_to(MIX, result.G.shape), atol=1e-9
    )
    assert result.method == "local" and len(result.frequencies) == 249
    assert np.isnan(result.p_linear) and np.isnan(result.noise).all()
    assert result.total_rms.max() < 1e-9


def test_transients_do_not_disturb():
    """The output starts far from rest: a plain quotient of spectra is useless."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal((3000, 1))
    b, a = butter(2, 0.1)
    y, _ = lfilter(b, a, u[:, 0], zi=np.array([40.0, -30.0]))
    result = local_polynomial(u, y)
    G = freqz(b, a, 2 * np.pi * result.frequencies)[1]
    error = np.abs(result.G[:, 0, 0] - G)
    plain = np.fft.rfft(y)[1:-1] / np.fft.rfft(u[:, 0])[1:-1]
    reference = freqz(b, a, 2 * np.pi * np.arange(1, 1500) / 3000)[1]
    assert np.sqrt(np.mean(error**2)) < 1e-3
    assert np.sqrt(np.mean(np.abs(plain - reference) ** 2)) > 0.1


@pytest.mark.parametrize("kind", ["noise", "steps", "two", "gaps"])
def test_bands_of_arbitrary_records_cover(kind):
    covered, levels = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u = rng.standard_normal((2000, 2))
        if kind == "steps":
            u = steps(2000, 2, hold=(1, 20), random_state=seed).u
        y = plant(u) + 0.05 * rng.standard_normal((2000, 3))
        experiment = np.repeat(["a", "b"], [1300, 700]) if kind == "two" else None
        if kind == "gaps":
            y[500:540, 0], y[1200], y[1800:1803, 2] = np.nan, np.nan, np.nan
        result = local_polynomial(u, y, experiment, n_frequencies=100)
        covered.append(result.covers(response(result.frequencies, 2)).mean())
        levels.append(result.total_rms)
    assert np.mean(covered) == pytest.approx(0.95, abs=0.015)
    np.testing.assert_allclose(np.mean(levels, axis=0), 0.05, rtol=0.03)


def test_a_gap_begins_a_new_experiment():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((1000, 1))
    y = plant(u) + 0.1 * rng.standard_normal((1000, 2))
    gaps = y.copy()
    gaps[600:620, 1] = np.nan
    one = local_polynomial(u, gaps)
    two = local_polynomial([u[:600], u[620:]], [y[:600], y[620:]])
    np.testing.assert_array_equal(one.G, two.G)
    np.testing.assert_array_equal(one.covariance, two.covariance)


def test_the_sampling_time_is_that_of_the_excitation_or_given():
    excitation = steps(300, dt=0.1, random_state=0)
    y = measured(excitation)
    assert local_polynomial(excitation, y).dt == 0.1
    assert local_polynomial(excitation, y, dt=0.2).dt == 0.2
    series = pd.Series(excitation.u[:, 0], name="valve")  # has a `dt` of its own
    result = local_polynomial(series, y)
    assert result.dt == 1.0 and result.input_names == ("valve",)


def test_names_of_series_are_those_that_a_fit_remembers():
    rng = np.random.default_rng(0)
    u = rng.standard_normal(300)
    y = plant(u[:, None])[:, 0] + 0.1 * rng.standard_normal(300)
    for series, name in (
        (pd.Series(y, name="level"), "level"),
        (pd.Series(y, name=3), "3"),
        (pd.Series(y), "y[0]"),
        (polars.Series(y), "y[0]"),  # its name is empty
    ):
        assert local_polynomial(u, series).output_names == (name,)


def test_a_wider_window_is_smoother():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((3000, 1))
    y = 2 * u + 0.1 * rng.standard_normal((3000, 1))
    narrow, wide = (local_polynomial(u, y, dof=dof) for dof in (8, 60))
    assert wide.dof >= 60 and narrow.dof >= 8
    assert np.median(wide.radius()) < 0.6 * np.median(narrow.radius())
    assert wide.covers(np.full_like(wide.G, 2)).mean() > 0.9


def test_frequencies_that_are_not_excited_are_nan():
    rng = np.random.default_rng(0)
    u = multisine(2000, band=(0, 0.2), n_realizations=1, n_periods=1, random_state=0).u
    y = plant(u) + 0.01 * rng.standard_normal((2000, 2))
    result = local_polynomial(u, y)
    known = np.isfinite(result.G[:, 0, 0])
    assert known[result.frequencies < 0.19].all()
    frd = result.to_frd()
    assert frd.omega.max() / (2 * np.pi) < 0.25
    assert np.isfinite(result.total_rms).all()


@pytest.mark.parametrize("n_resting", [2, 1])
def test_what_is_left_where_inputs_rest_is_what_the_others_leave(n_resting):
    """Carried on from the last excited line, slow noise would count too much."""
    rng = np.random.default_rng(0)
    N = 4000
    options = {"band": (1 / N, 0.03), "n_periods": 1, "n_realizations": 1}
    slow = multisine(N, **options, random_state=0).u
    u = np.hstack([slow, rng.standard_normal((N, 1))])[:, : 3 - n_resting]
    noise = lfilter([1], [1, -0.98], rng.standard_normal(N))
    y = sum(lfilter(*butter(2, 0.2), column) for column in u.T) + noise
    response = local_polynomial(u, y)
    assert np.isnan(response.G[response.frequencies > 0.1]).any()
    noise_rms = np.std(noise)
    assert response.total_rms[0] == pytest.approx(noise_rms, rel=0.15)


# -- the result ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def result():
    excitation = multisine(
        128, 2, dt=0.1, n_realizations=3, names=["valve", "pump"], random_state=0
    )
    y = pd.DataFrame(
        measured(excitation, 0.1, system=lambda u: plant(u) + 0.1 * plant(u) ** 3),
        columns=["level", "flow", "heat"],
    )
    return best_linear_approximation(excitation, y)


def test_it_becomes_an_object_of_python_control(result):
    sys = result.to_frd()
    assert isinstance(sys, control.FrequencyResponseData) and sys.dt == 0.1
    assert sys.input_labels == ["valve", "pump"]
    assert sys.output_labels == ["level", "flow", "heat"]
    omega = 2 * np.pi * result.frequencies
    np.testing.assert_allclose(
        sys(1j * omega), np.moveaxis(result.G, 0, -1), rtol=1e-12
    )


@pytest.mark.parametrize("level", [0.5, 0.95, 0.99])
def test_bands_have_the_quantiles_of_their_distributions(result, level):
    quantile = f_distribution.ppf(level, 2, 2 * result.dof)
    np.testing.assert_allclose(result.radius(level), np.sqrt(quantile) * result.std)
    low, high = result.band(level)
    half = t_distribution.ppf((1 + level) / 2, 2 * result.dof) * result.std / np.sqrt(2)
    np.testing.assert_allclose(high, np.abs(result.G) + half)
    np.testing.assert_allclose(low, np.maximum(np.abs(result.G) - half, 0))
    assert result.covers(result.G + 0.999j * result.radius(level), level).all()
    assert not result.covers(result.G + 1.001j * result.radius(level), level).any()


def test_wrong_levels_and_responses_are_refused(result):
    for call in (result.radius, result.band):
        with pytest.raises(ValueError, match="`level` must be between 0 and 1, got 1"):
            call(1)
    with pytest.raises(ValueError, match="`G` must have shape"):
        result.covers(result.G[:-1])


def test_the_figure_has_a_response_per_input_and_levels(result):
    display = result.plot()
    assert display.axes_.shape == (3, 3)
    labels = display.axes_[0, -1].get_legend_handles_labels()[1]
    assert labels == ["output", "distortion", "noise"]  # a full grid: not even, odd
    line = display.axes_[1, 0].lines[0]
    np.testing.assert_allclose(line.get_ydata(), np.abs(result.G[:, 1, 0]))
    assert display.axes_[1, 1].get_ylabel() == "flow / pump"
    rng = np.random.default_rng(0)
    u = rng.standard_normal((500, 1))
    local = local_polynomial(u, u + 0.1 * rng.standard_normal((500, 1))).plot()
    labels = local.axes_[0, -1].get_legend_handles_labels()[1]
    assert labels == ["output", "not linear"]


def test_it_says_what_it_found_in_a_line(result):
    assert repr(result).startswith("BestLinearApproximation('robust', n_freq=51, ny=3")
    assert repr(result).endswith("nonlinear)")


# -- inputs that were sent more than once ----------------------------------------------


def sent_twice(seed=0, n=4000, copies=3, noise=(0.05, 0.2)):
    """Return experiments of a bent plant with one input, and one of another input."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((n, 1))
    inputs = [*[u] * copies, u[: n // 2], rng.standard_normal((n, 1))]
    outputs = []
    for one in inputs:
        x, start = lfilter([0.5], [1, -0.8], one, axis=0), rng.standard_normal()
        x = x + 5 * start * 0.8 ** np.arange(len(one))[:, None]  # its initial state
        clean = np.hstack([x, x**2])
        outputs.append(clean + noise * rng.standard_normal(clean.shape))
    return inputs, outputs


def test_what_differs_under_one_input_is_noise():
    found = [noise_of_repeats(*sent_twice(seed)) for seed in range(20)]
    np.testing.assert_allclose(np.mean(found, axis=0), [0.05, 0.2], rtol=0.01)
    us, ys = sent_twice()
    response = local_polynomial(us, ys)
    np.testing.assert_array_equal(response.noise_rms, noise_of_repeats(us, ys))
    assert response.total_rms[1] > 3 * response.noise_rms[1]  # it is not linear
    assert np.isnan(response.p_linear) and "noise" in repr(response)


def test_gaps_and_rounding_are_no_obstacle_to_repeats():
    us, ys = sent_twice()
    ys[0][::2, 0] = np.nan
    us[1] = us[1] + 1e-4 * np.random.default_rng(1).standard_normal(us[1].shape)
    found = noise_of_repeats(us, ys)
    np.testing.assert_allclose(found, [0.05, 0.2], rtol=0.1)
    for y in ys[1:]:
        y[:, 1] = np.nan
    assert noise_of_repeats(us, ys) is None  # of the second output there is one


@pytest.mark.parametrize("change", [lambda u: u + 0.01 * u**2, lambda u: 0 * u])
def test_other_inputs_tell_no_noise(change):
    us, ys = sent_twice(copies=1)
    assert noise_of_repeats(us[::2], ys[::2]) is None
    assert noise_of_repeats([us[0], change(us[0])], [ys[0], ys[0]]) is None
    still = [0 * us[0]] * 2  # nothing moves: two records at rest
    assert noise_of_repeats(still, [ys[0], ys[0]]) is None


def test_copies_are_further_periods():
    excitation = multisine(64, n_periods=7, n_realizations=3, random_state=0)
    rng = np.random.default_rng(0)
    us = [u for u in excitation.experiments]
    ys = [u + 0.1 * u**2 + 0.05 * rng.standard_normal(u.shape) for u in us]
    whole = best_linear_approximation(us, ys, period=64)
    us, ys = ([z[64 * i :][:192] for z in zs for i in (0, 2, 4)] for zs in (us, ys))
    parts = best_linear_approximation(us, ys, period=64)
    assert parts.method == "robust" and parts.dof == whole.dof == 2
    np.testing.assert_allclose(parts.G, whole.G, rtol=1e-12)
    np.testing.assert_allclose(parts.noise_rms, whole.noise_rms, rtol=1e-12)


# -- errors ----------------------------------------------------------------------------

GOOD = multisine(64, random_state=0)
ONE = multisine(64, n_realizations=1, random_state=0)
Y = GOOD.u + 0.1


def copies():
    excitation = prbs(6, n_realizations=3, random_state=0)
    return best_linear_approximation(excitation, excitation.u)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: best_linear_approximation(GOOD.u, Y), "`period` must be the samples"),
        (
            lambda: best_linear_approximation(GOOD, Y, period=50),
            "`period` must divide the number of samples, 192 of experiment 0, got 50",
        ),
        (
            lambda: best_linear_approximation(GOOD, Y, n_transient=2),
            "two complete periods of experiment 0 in a row behind the first 2, got 1",
        ),
        (
            lambda: best_linear_approximation(GOOD, Y, n_transient=-1),
            "`n_transient` must be an integer of at least 0",
        ),
        (
            lambda: best_linear_approximation(GOOD, Y, lines=[1, 40]),
            "`lines` must be from 1 to 31, below the Nyquist frequency, got 1 to 40",
        ),
        (
            lambda: best_linear_approximation(GOOD, Y, lines=[0.5]),
            "`lines` must be integers",
        ),
        (
            lambda: best_linear_approximation(ONE, ONE.u),
            "`u` must have more experiments than inputs, 1, or lines that are not",
        ),
        (
            lambda: best_linear_approximation(np.c_[ONE.u, ONE.u], ONE.u, period=64),
            "`experiment` must name at least as many experiments as there are inputs",
        ),
        (
            lambda: best_linear_approximation(
                np.c_[GOOD.u, GOOD.u], Y, GOOD.experiment, period=64
            ),
            "`u` must have independent inputs at every excited line, got none at",
        ),
        (
            lambda: best_linear_approximation(GOOD.u, Y, GOOD.experiment, period=48),
            "`u` must repeat itself after `period` = 48 samples",
        ),
        (
            lambda: best_linear_approximation(
                0 * GOOD.u, Y, GOOD.experiment, period=64
            ),
            "`u` must move",
        ),
        (copies, "got experiment 1 like 0 but for a shift in time"),
        (lambda: best_linear_approximation(GOOD, Y[:-1]), "the same number of samples"),
        (lambda: best_linear_approximation(GOOD, Y * np.inf), "`y` must be finite"),
        (lambda: best_linear_approximation(GOOD.u * np.nan, Y), "`u` must be finite"),
        (
            lambda: best_linear_approximation(GOOD, Y * 1j),
            "`y` must be an array of real",
        ),
        (lambda: best_linear_approximation(GOOD, Y, dt=-1), "`dt` must be a positive"),
        (
            lambda: best_linear_approximation([GOOD.u], Y, period=64),
            "`y` must be a list of records, as `u` is",
        ),
        (
            lambda: best_linear_approximation([GOOD.u], [Y], [1], period=64),
            "`experiment` must be None for a list",
        ),
        (
            lambda: local_polynomial(Y[:20], Y[:20]),
            "`y` must be measured over stretches",
        ),
        (lambda: local_polynomial(Y, Y, degree=-1), "`degree` must be an integer"),
        (lambda: local_polynomial(Y, Y, dof=0), "`dof` must be an integer"),
        (
            lambda: local_polynomial(Y, Y, n_frequencies=0),
            "`n_frequencies` must be an integer",
        ),
        (lambda: local_polynomial(0 * Y, Y), "inputs that are independent"),
        (
            lambda: local_polynomial(
                Y, np.where(np.arange(len(Y)) % 9, Y[:, 0], np.nan)
            ),
            "got at most 8 samples between two gaps",
        ),
    ],
)
def test_wrong_records_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


# -- real records, and the benchmark ---------------------------------------------------


def test_no_linear_model_of_silverbox_is_better_than_the_floor_says():
    """The best linear models that were published miss 6.96 mV on this multisine."""
    try:
        train, _ = fetch_silverbox()
    except FileNotFoundError as error:
        pytest.skip(str(error))
    found = local_polynomial(train.u, 1e3 * train.y, dt=train.dt)
    assert found.total_rms[0] == pytest.approx(6.9, abs=0.3)


@pytest.mark.parametrize("method", benchmark.METHODS)
def test_the_benchmark_counts(method, monkeypatch):
    monkeypatch.setattr(benchmark, "PERIOD", 256)
    monkeypatch.setattr(benchmark, "TRUTH", {"robust": 200, "fast": 50})
    covered, found, expected = benchmark.study("Wiener", method, 4)
    assert np.all(covered > 0.85)
    assert 10 * np.log10(found[:, 0].mean() / expected[:, 0].mean()) == pytest.approx(
        0, abs=0.5
    )
