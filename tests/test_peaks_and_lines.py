"""Peak gains, lines and chords: bounds that hold, no wider than they must be."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alssnn.activations import ACTIVATIONS, Activation
from alssnn.certificates import _peaks, peaks
from alssnn.certificates._lines import chords, lines
from alssnn.certificates._peaks import TooSlow
from helpers import stable

# -- peak gains ------------------------------------------------------------------------


@pytest.mark.parametrize("radius", [0.3, 0.9, 0.999])
def test_a_peak_gain_is_attained_by_the_sign_of_the_response(rng, radius):
    A, B = stable(rng, 3, radius), rng.standard_normal((3, 2))
    C, D = rng.standard_normal((2, 3)), rng.standard_normal((2, 2))
    found = peaks(A, B, C, D)
    for i in range(2):
        h = [D[i]]
        X = B
        for _ in range(30_000):
            h.append(C[i] @ X)
            X = A @ X
        exact = np.abs(h).sum(axis=0)
        assert np.all(found.gain[i] >= exact * (1 - 1e-12))
        np.testing.assert_allclose(found.gain[i], exact, rtol=1e-4)


def test_the_response_to_constants_stays_in_its_range(rng):
    A, C = stable(rng, 3, 0.97), rng.standard_normal((2, 3))
    c, d = rng.standard_normal(3), rng.standard_normal(2)
    found = peaks(A, np.zeros((3, 0)), C, np.zeros((2, 0)), c, d)
    x, seen = np.zeros(3), []
    for _ in range(3_000):
        seen.append(C @ x + d)
        x = A @ x + c
    np.testing.assert_allclose(found.low, np.min(seen, axis=0), rtol=1e-5)
    np.testing.assert_allclose(found.high, np.max(seen, axis=0), rtol=1e-5)
    assert np.all(found.low <= np.min(seen, axis=0))
    assert np.all(found.high >= np.max(seen, axis=0))


@pytest.mark.parametrize(
    ("radius", "match"), [(1.0, "not below one"), (1 - 1e-9, "modulus")]
)
def test_poles_at_the_circle_have_no_sum(radius, match):
    A = np.array([[radius]])
    with pytest.raises(TooSlow, match=match):
        peaks(A, np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))


def test_peak_gains_of_whole_numbers_round_upwards():
    """Nothing follows the second sample, and all sums are exact."""
    A = np.array([[0.0, 1.0], [0.0, 0.0]])
    B, C = np.array([[1.0, 0.0], [0.0, -2.0]]), np.array([[3.0, 4.0], [0.0, -1.0]])
    D, c, d = np.array([[1.0, -1.0], [0.0, 5.0]]), np.array([1.0, 2.0]), np.ones(2)
    found = peaks(A, B, C, D, c, d)
    exact = np.array([[4.0, 1 + 8 + 6], [0.0, 5 + 2]])
    reached = exact > 0
    assert np.all(found.gain[reached] > exact[reached])
    np.testing.assert_allclose(found.gain, exact, rtol=2e-9)
    # x = 0, [1, 2], [3, 2], [3, 2], ..., y = C x + 1
    assert found.high[0] > 18.0 and found.high[0] == pytest.approx(18, rel=2e-9)
    assert found.low[1] < -1.0 and found.low[1] == pytest.approx(-1, rel=2e-9)
    assert found.low[0] == found.high[1] == 1.0
    assert found.n_terms >= 2


@pytest.mark.parametrize("end", [0.7, 0.01, 1e-9])
@pytest.mark.parametrize("pole", [0.5, 0.97, 0.999, -0.9])
def test_peak_gains_hold_wherever_the_sum_ends(monkeypatch, end, pole):
    """The bound of what follows is exact for one pole: b / (1 - |a|) in all."""
    monkeypatch.setattr(_peaks, "SMALL", end)
    A, B, C = np.full((1, 1), pole), np.array([[2.0, 0.5]]), np.array([[-3.0]])
    found = peaks(A, B, C, np.array([[0.25, 0.0]]), np.ones(1), np.array([0.5]))
    exact = np.array([[6.25, 1.5]]) + np.array([[6.0, 1.5]]) * abs(pole) / (
        1 - abs(pole)
    )
    assert np.all(found.gain > exact * (1 - 1e-12))
    np.testing.assert_allclose(found.gain, exact, rtol=1e-8)
    x, seen = 0.0, []
    for _ in range(30_000):
        seen.append(0.5 - 3 * x)
        x = pole * x + 1
    assert found.low[0] <= min(seen) and found.high[0] >= max(seen)
    if end == 1e-9:
        np.testing.assert_allclose(found.low, min(seen), rtol=1e-5)
        np.testing.assert_allclose(found.high, max(seen), rtol=1e-5)


@pytest.mark.parametrize("end", [0.5, 0.1])
def test_peak_gains_of_several_poles_hold_wherever_the_sum_ends(monkeypatch, rng, end):
    for _ in range(20):
        A, B = stable(rng, 3, 0.9), rng.standard_normal((3, 2))
        C, D, c, d = (
            rng.standard_normal((2, 3)),
            *rng.standard_normal((3, 2, 2))[:1],
            (rng.standard_normal(3)),
            rng.standard_normal(2),
        )
        whole = peaks(A, B, C, D, c, d)
        with monkeypatch.context() as patched:
            patched.setattr(_peaks, "SMALL", end)
            early = peaks(A, B, C, D, c, d)
        assert early.n_terms < whole.n_terms
        assert np.all(early.gain >= whole.gain * (1 - 3e-9))
        assert np.all(early.low <= whole.low + 1e-8 * np.abs(whole.low))
        assert np.all(early.high >= whole.high - 1e-8 * np.abs(whole.high))


def test_a_system_without_states_passes_its_inputs_at_once():
    none = np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), np.array([[1.0, -2.0]])
    found = peaks(*none, d=np.array([3.0]))
    np.testing.assert_array_equal(found.gain, [[1.0, 2.0]])
    assert found.low == found.high == 3.0 and found.n_terms == 0


# -- lines -----------------------------------------------------------------------------

SOFTSIGN = Activation(
    "softsign",
    lambda v: v / (1 + abs(v)),
    lambda v, w: (1 - abs(w)) ** 2,
    slope=(0, 1),
    bound=1,
)


@pytest.mark.parametrize("activation", [*ACTIVATIONS.values(), SOFTSIGN])
@settings(max_examples=40, deadline=None)
@given(
    low=st.floats(-8, 8),
    width=st.floats(0, 10),
    pieces=st.integers(1, 70),
    slopes=st.sampled_from([1, 9]),
)
def test_a_line_holds_on_its_interval(activation, low, width, pieces, slopes):
    a, b = np.array([low]), np.array([low + width])
    s, m, d = lines(activation, a, b, pieces, slopes)
    nu = np.linspace(low, low + width, 1_001)
    error = np.abs(activation.value(nu) - s * nu - m)
    assert error.max() <= d[0] * (1 + 1e-12) + 1e-15
    least, largest = activation.slopes(a, b)
    derivative = activation.derivative(nu, activation.value(nu))
    inner = derivative[1:-1] if activation.name == "relu" else derivative
    assert np.all(inner >= least - 1e-12) and np.all(inner <= largest + 1e-12)


@pytest.mark.parametrize("name", ["tanh", "sigmoid", "relu", "sin"])
def test_pieces_make_a_line_tight(name):
    activation = ACTIVATIONS[name]
    low, high = np.array([-2.0, 0.1, -0.5]), np.array([1.0, 0.4, 3.0])
    s, m, d = lines(activation, low, high, 400, 1)
    for i in range(3):
        nu = np.linspace(low[i], high[i], 5_001)
        error = np.abs(activation.value(nu) - s[i] * nu - m[i]).max()
        assert d[i] <= 1.02 * error + 1e-12


def exactly(value):
    return Fraction(float(value))


@pytest.mark.parametrize("name", ["relu", "identity"])
@pytest.mark.parametrize("slopes", [1, 5])
def test_a_line_covers_its_own_rounding(name, slopes, rng):
    """Activations that are lines themselves, in exact arithmetic."""
    low = rng.uniform(0.1, 5.0, 200)
    high = low + rng.exponential(1.0, 200)
    s, m, d = lines(ACTIVATIONS[name], low, high, 1, slopes)
    for i in range(200):
        for nu in (low[i], high[i], (low[i] + high[i]) / 2):
            error = exactly(nu) - exactly(s[i]) * exactly(nu) - exactly(m[i])
            assert abs(error) <= exactly(d[i])
    assert np.all(d > 0) and np.all(d <= 1e-13 * (1 + high))


def test_the_line_of_a_point_is_its_value():
    at = np.array([-0.5, 0.0, 2.0])
    s, m, d = lines(ACTIVATIONS["tanh"], at, at)
    np.testing.assert_allclose(s * at + m, np.tanh(at))
    assert np.all(d >= 0) and np.all(d <= 1e-15)


@pytest.mark.parametrize("name", ["tanh", "sigmoid", "relu", "sin"])
def test_more_slopes_find_the_best_line(name):
    activation = ACTIVATIONS[name]
    low, high = np.array([-3.0, -0.2, -1.0, -6.0]), np.array([1.0, 2.5, 4.0, 6.0])
    s, m, d = lines(activation, low, high, 400, 33)
    chord = lines(activation, low, high, 400, 1)[2]
    for i in range(4):
        nu = np.linspace(low[i], high[i], 2_001)
        w = activation.value(nu)
        best = min(np.ptp(w - t * nu) / 2 for t in np.linspace(-1, 1, 801))
        assert np.abs(w - s[i] * nu - m[i]).max() <= d[i] <= chord[i]
        assert d[i] <= 1.05 * best + 1e-3 * np.ptp(w)


def sloped(a, b=None):
    """Return an activation with a slope that is known nowhere better than [a, b]."""
    value = lambda v: a * v  # noqa: E731
    return Activation("sloped", value, lambda v, w: a + 0 * v, slope=(a, b or a))


@pytest.mark.parametrize("slope", [0.1, -0.3, 1.0, 1 / 3])
def test_chords_are_rounded_outwards(slope):
    about, low, high = np.array([0.3]), np.array([-1.0]), np.array([2.0])
    least, largest = chords(sloped(slope), about, low, high)
    assert least < slope < largest
    np.testing.assert_allclose([least[0], largest[0]], slope, rtol=1e-12)
    alone = chords(sloped(slope), about[0], low[0], high[0])  # of one neuron
    np.testing.assert_array_equal(alone, [least[0], largest[0]])


def test_chords_start_at_their_point():
    """The chord of relu from 1 to -1 is a half, from 1 to 3 one, from 0 any."""
    about = np.array([1.0, 0.0, -1.0])
    least, largest = chords(ACTIVATIONS["relu"], about, about - 2, about + 2)
    np.testing.assert_allclose(least, [1 / 2, 0, 0], atol=0.02)
    np.testing.assert_allclose(largest, [1, 1, 1 / 2], atol=0.02)
    assert np.all(least <= [1 / 2, 0, 0]) and np.all(largest >= [1, 1, 1 / 2])
    alone = chords(ACTIVATIONS["tanh"], about, about, about)
    derivative = 1 - np.tanh(about) ** 2
    np.testing.assert_allclose(alone, [derivative, derivative], rtol=1e-9)


@pytest.mark.parametrize("name", ["tanh", "sigmoid", "relu", "sin"])
def test_chords_lie_in_their_range(name, rng):
    activation = ACTIVATIONS[name]
    about = rng.normal(0, 2, 20)
    low, high = about - rng.exponential(2, 20), about + rng.exponential(2, 20)
    least, largest = chords(activation, about, low, high)
    nu = low + (high - low) * rng.random((500, 20))
    w = activation.value(nu) - activation.value(about)
    chord = w / (nu - about)
    assert np.all(chord >= least - 1e-9) and np.all(chord <= largest + 1e-9)
    # and are tighter than slopes, and nearly attained
    slopes = activation.slopes(low, high)
    assert np.all(least >= slopes[0] - 1e-9) and np.all(largest <= slopes[1] + 1e-9)
    assert np.all(largest - least <= np.ptp(chord, axis=0) + 0.1)


def test_the_slopes_of_an_own_activation_may_be_one_number_for_all():
    steep = Activation(
        "steep",
        lambda v: 2.0 * v,
        lambda v, w: 2.0 + 0.0 * v,
        slope=[2, 2],
        bound=np.inf,
        slope_range=lambda low, high: (2.0, 2.0),
    )
    low, high = np.array([-1.0, 0.5]), np.array([1.0, 0.5])
    for activation in (steep, replace(steep, slope_range=None)):
        np.testing.assert_array_equal(activation.slopes(low, high), np.full((2, 2), 2))
    least, largest = chords(steep, np.zeros(2), low - 1, high + 1)
    np.testing.assert_allclose([least, largest], 2.0)
