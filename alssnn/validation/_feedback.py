"""Whether a record looks as if it was taken in a closed loop (eq. fedback).

A controller turns noise into input.  So every input that is moved is regressed, block
by block, on

    its past, that of the other inputs and of the simulated output | noise of the past
    | noise of the same sample,

and an F-test asks whether noise explains more of it than chance does.  What the past of
the inputs tells is granted, the simulated output being a function of it: then errors of
the model, which depend on past inputs, are not taken for noise.  Noise is the residual
of a free run, as a controller sees it, of which two samples tell nearly all; or the
errors one sample ahead, of which a controller sees sums of many.  That of the same
sample counts only if y does not depend on u of the same sample.

With feedback it matters whether anything else moves u.  A second regression puts the
outputs in the place of the noise, as a linear filter and as a broken line: what they
leave is what a reference has moved.

The error of a model repeats where the input does, as often as there are periods, and
would pass for noise that moves it.  But noise never repeats: inputs that do, in one
experiment or in two, were not moved by it, and of a known period only what differs
between periods is tested.
"""

from dataclasses import dataclass

import numpy as np

from ..periods import repeated
from ..regression import lagged
from ..shown import short_repr
from ._lags import LEAST, MOST, POWER_LAGS, ROWS
from ._regression import regress
from ._scored import is_rounding

KNOTS = np.arange(1, 10) / 10  # quantiles of y at which a broken line may bend
RESIDUALS = 2  # past samples of a residual, which is correlated over time as it is
NOTHING = 1e-10  # share of an input that its own past leaves, and that is rounding


@dataclass(frozen=True, eq=False)
class FeedbackTests:
    """Hold what the noise and the outputs tell of the inputs of a record.

    Parameters
    ----------
    p_values : ndarray of shape (n_moved, 2)
        Of the noise of the past, and of that of the same sample: probability that it
        explains as much of an input by chance.
    shares : ndarray of shape (n_moved, 2)
        Share that each explains of what the past of the inputs does not tell.
    by_outputs : ndarray of shape (n_moved,)
        Share of the same that the outputs explain.
    input_names : list of str
        Names of the inputs that are moved.

    Examples
    --------
    >>> from alssnn.validation import feedback_tests
    >>> rng = np.random.default_rng(0)
    >>> noise, r = rng.standard_normal((2, 500, 1))
    >>> y = np.cumsum(noise, axis=0)
    >>> u = r - 0.5 * np.vstack([[[0.0]], y[:-1]])  # who controls y by u
    >>> tests = feedback_tests([(u, y, y - noise)], ahead=True)
    >>> bool(tests.p_values[0, 0] < 0.01)
    True
    """

    __repr__ = short_repr

    p_values: np.ndarray
    shares: np.ndarray
    by_outputs: np.ndarray
    input_names: list

    @property
    def p(self):
        """Return the p-value of all inputs and both blocks together (Bonferroni)."""
        return float(min(1.0, self.p_values.size * self.p_values.min()))

    def found(self, level):
        """Return which blocks explain an input at a level, as `p_values` is ordered.

        Parameters
        ----------
        level : float
            Probability of a false alarm of all of them together.

        Returns
        -------
        found : ndarray of bool of shape (n_moved, 2)
            Whether they do.
        """
        return self.p_values.size * self.p_values < level


def feedback_tests(
    experiments,
    *,
    moved=None,
    input_names=None,
    simulated=None,
    ahead=False,
    direct=True,
    period=None,
):
    """Test whether the inputs of a record depend on its noise (eq. fedback).

    Parameters
    ----------
    experiments : sequence of tuple of ndarray
        Tuples (u, y, y_hat) of shapes (N, nu), (N, ny), (N, ny): inputs as they were
        sent, measured outputs, nan where not measured, and outputs of the model.
    moved : sequence of int or None, default=None
        Columns of u that a controller moves; None means all. Of the others, u of the
        same sample is granted, too.
    input_names : sequence of str or None, default=None
        Names of the inputs that are moved.
    simulated : sequence of ndarray of shape (N, ny) or None, default=None
        Outputs of a free run; None leaves them out.
    ahead : bool, default=False
        Whether y_hat is predicted one sample ahead, and its error noise as it is.
    direct : bool, default=True
        Whether noise of the same sample counts.
    period : int or None, default=None
        Samples after which what a reference moves repeats: of experiments of two
        periods and more, only what differs between them is tested.

    Returns
    -------
    tests : FeedbackTests or None
        P-values and shares; None if the record is too short. Experiments whose moved
        inputs repeat to the last digit, or those of another one, do not count: no
        noise has moved them.
    """
    nu = np.shape(experiments[0][0])[1]
    moved = list(range(nu)) if moved is None else list(moved)
    names = [f"u{j}" for j in moved] if input_names is None else list(input_names)
    runs = [[np.asarray(z, dtype=float) for z in one] for one in experiments]
    if simulated is not None:
        runs = [[*one, y_hat] for one, y_hat in zip(runs, simulated, strict=True)]
    moves = [one[0][:, moved] for one in runs]
    alone = [group[0] for group in repeated(moves, 0.0) if len(group) == 1]
    runs = [runs[i] for i in alone if not _repeats(moves[i])]
    if not runs:
        shape = len(moved), 2
        return FeedbackTests(np.ones(shape), np.zeros(shape), np.zeros(shape[0]), names)
    if period is not None:
        runs = [part for one in runs for part in _between_periods(one, period)]
    u, measured, y_hat, *free_runs = zip(*runs, strict=True)
    noise = _noise(measured, y_hat)
    y = [np.where(np.isnan(a), b, a) for a, b in zip(measured, y_hat, strict=True)]
    given = [j for j in range(nu) if j not in moved]
    n_lags = _n_lags(u, y[0].shape[1], len(given), bool(free_runs))
    if n_lags == 0:
        return None
    few, now = range(1, min(n_lags, POWER_LAGS) + 1), range(int(not direct), 1)
    past = [lagged(z, range(1, n_lags + 1)) for z in u]
    granted = [(y_hat, few) for y_hat in free_runs]
    for others, lags in (*granted, ([z[:, given] for z in u], range(1))):
        more = [lagged(z, lags) for z in others]
        past = [np.hstack(pair) for pair in zip(past, more, strict=True)]
    known = (past, range(1))
    told = few if ahead else range(1, RESIDUALS + 1)
    by_noise = [known, (noise, told), (noise, now)]
    first = 0 if direct else 1
    by_y = [known, (y, range(first, few[-1] + 1)), (_bent(y), range(first, first + 1))]
    found = []
    for j in moved:
        u_j = [z[:, j] for z in u]
        p, share = _explained(u_j, by_noise)
        found.append((p, share, sum(_explained(u_j, by_y)[1])))
    p_values, shares, by_outputs = map(np.array, zip(*found, strict=True))
    return FeedbackTests(p_values, shares, by_outputs, names)


def _repeats(u):
    """Tell whether signals repeat exactly, over two periods at least.

    The first half is looked for later on: where it is found first is a period of all
    signals, or they have none of at most half their length (Fine and Wilf).
    """
    rows = np.ascontiguousarray(u) + 0.0  # one zero, not two
    if len(rows) < 2 or not rows.size:
        return False
    text, size = rows.tobytes(), rows[0].nbytes
    half = text[: len(rows) // 2 * size]
    found = text.find(half, size)
    while found % size and found > 0:
        found = text.find(half, found + 1)
    return found > 0 and np.array_equal(rows[found // size :], rows[: -found // size])


def _between_periods(signals, period):
    """Return what differs between periods: one from the mean of those before it.

    Scaled as here (eq. helmert), the differences of white noise are white, independent,
    and one fewer than the periods: no sample counts twice.
    """
    n = len(signals[0]) // period
    if n < 2:
        return [signals]
    folded = [np.reshape(z[: n * period], (n, period, -1)) for z in signals]
    return [
        [(z[i] - z[:i].mean(axis=0)) * np.sqrt(i / (i + 1)) for z in folded]
        for i in range(1, n)
    ]


def _explained(u, blocks):
    """Return p-values and shares of the blocks behind the first one."""
    ((p, share),) = regress([u], [np.zeros(0)], blocks)
    left = 1.0 - share[1]  # the first entry is that of sensitivities
    if not left > NOTHING:
        return [1.0] * len(p[2:]), [0.0] * len(share[2:])
    return p[2:], [part / left for part in share[2:]]


def _noise(y, y_hat):
    """Return the noise of every experiment; zero where nobody knows it."""
    parts = []
    for i in range(y[0].shape[1]):
        measured = [z[:, i] for z in y]
        r = [z - z_hat[:, i] for z, z_hat in zip(measured, y_hat, strict=True)]
        mean = np.nanmean(np.concatenate(r))
        r = [part - mean for part in r]
        if is_rounding(r, measured):
            r = [0.0 * part for part in r]
        parts.append([np.nan_to_num(part) for part in r])
    return [np.column_stack(columns) for columns in zip(*parts, strict=True)]


def _n_lags(u, ny, n_given, simulates):
    """Return how many lags of the inputs the record bears; 0 if too few."""
    nu = u[0].shape[1]
    for n_lags in range(MOST, LEAST - 1, -1):
        few = min(n_lags, POWER_LAGS) + 1
        outputs = ny * (few + max(few * simulates, len(KNOTS)))
        needed = ROWS * (1 + nu * n_lags + n_given + outputs)
        if sum(max(len(z) - n_lags, 0) for z in u) >= needed:
            return n_lags
    return 0


def _bent(y):
    """Return what a broken line of every output needs beside the output itself."""
    knots = np.quantile(np.vstack(y), KNOTS, axis=0)
    return [np.maximum(z[:, None, :] - knots, 0.0).reshape(len(z), -1) for z in y]
