"""Residuals of a model: whether they are noise, or something is missing.

The residual r = y - y_hat of a simulation is not white where the noise is not: white
residuals are a surprise, colored ones no fault.  What counts is that r does not depend
on u.  So r is whitened first, by an autoregressive filter of its own (per output, order
by Akaike's criterion),

    r_w = r - a_1 r_{k-1} - ... - a_p r_{k-p},

which is noise if r is, whatever the color.  Then r_w is regressed on what it must not
depend on (eq. residuals), block by block,

    r_w ~ sensitivities | constant | lags of u | lags of squares | lags of cubes,

squares and cubes being those of u and of the *simulated* output (the measured one
carries the noise), and an F-test asks whether a block explains more of r_w than chance
does, beyond the blocks before it.  All of it comes out of one QR factorization.
Regression, unlike one correlation after the other, is right for any color of u.  The
sensitivities of the simulation, whitened alike, take up what errors of the estimated
parameters do (`_regression`); without them the model is taken for exact.

The errors eps of predictions one sample ahead (eq. innovations) are white and know
nothing of the past, whoever made u.  They are not whitened, and what they must not
depend on is all of the past (eq. ahead): u and the *measured* y, squares and cubes.
The u of the same sample counts only where no controller can have made it of that y.

Experiments are pooled; no lag reaches across a seam, and what was not measured drops
out.
"""

from dataclasses import dataclass
from functools import partial
from itertools import combinations_with_replacement
from numbers import Real

import numpy as np
from scipy.stats import chi2, norm

from ..checks import probability
from ..regression import Triangle, lagged
from ..shown import short_repr
from ._explained import explained_shares
from ._lags import LEAST, POWER_LAGS, choose_lags, rows_behind
from ._regression import regress
from ._scored import check_names, count_estimated, is_rounding

BLOCKS = ("independence", "squares", "cubes")
AUTO = "auto"


@dataclass(frozen=True, eq=False)
class ResidualTests:
    """Hold correlations and tests of the residuals of a model.

    Parameters
    ----------
    lags : ndarray of int of shape (n_lags + 1,)
        Lags of the autocorrelation, in samples.
    autocorrelation : ndarray of shape (n_lags + 1, ny)
        Autocorrelation of r, per output; one at lag 0.
    autocorrelation_band : ndarray of shape (n_lags + 1, ny)
        Half width of the band that holds it with probability 1 - `level` at every
        single lag if r is white.
    cross_lags : ndarray of int of shape (2 * n_lags + 1,)
        Lags of the cross-correlation; u is earlier than r at positive ones.
    cross_correlation : ndarray of shape (2 * n_lags + 1, ny, nu)
        Correlation of the whitened residual, or of the error one sample ahead as it
        is, with u. At negative lags it tells of feedback while the data were recorded.
    cross_band : ndarray of shape (2 * n_lags + 1, ny)
        Half width of its band if r does not depend on u.
    p_values : dict of str to ndarray of shape (ny,)
        Of the tests "whiteness" (of Ljung and Box; with sensitivities of Breusch and
        Godfrey, which allows for the parameters), "independence" (of u), "squares" and
        "cubes" (of u and the simulated output); of "parameters", whether others fit
        better, which they always do on data that the model was not trained on.
    shares : dict of str to ndarray of shape (ny,)
        Share of the variance of the whitened residual, but for what initial states
        explain, that each block explains; for
        "whiteness", the share of r that its own past explains.
    explained : dict of str to ndarray of shape (ny,)
        Share of the variance of r itself that each block explains beyond the blocks
        before it, on samples left out of the regression; nothing is whitened and no
        error of a parameter allowed for.
    n_parameters : int
        Number of parameters whose errors the tests allow for; 0 if the model is taken
        for exact.
    ar_order : ndarray of int of shape (ny,)
        Order of the whitening filters.
    n_samples : ndarray of int of shape (ny,)
        Number of measured samples.
    level : float
        Probability of a false alarm of each test and of the bands at each lag.
    dt : float
        Sampling time, in seconds.
    input_names, output_names : list of str
        Names of the signals.
    ahead : bool, default=False
        Whether the residuals are errors one sample ahead, not those of a free run.
    first_lag : int, default=0
        First lag of u that was tested.

    Examples
    --------
    >>> from alssnn.validation import residual_tests
    >>> rng = np.random.default_rng(0)
    >>> u, noise = rng.standard_normal((2, 500, 1))
    >>> tests = residual_tests([(u, 2 * u + noise, 2 * u)])
    >>> bool(tests.p_values["independence"] > 0.01)
    True
    """

    __repr__ = short_repr

    lags: np.ndarray
    autocorrelation: np.ndarray
    autocorrelation_band: np.ndarray
    cross_lags: np.ndarray
    cross_correlation: np.ndarray
    cross_band: np.ndarray
    p_values: dict
    shares: dict
    explained: dict
    n_parameters: int
    ar_order: np.ndarray
    n_samples: np.ndarray
    level: float
    dt: float
    input_names: list
    output_names: list
    ahead: bool = False
    first_lag: int = 0


def residual_tests(
    experiments,
    *,
    sensitivities=None,
    ahead=False,
    first_lag=0,
    level=0.01,
    n_lags="auto",
    dt=1.0,
    input_names=None,
    output_names=None,
):
    """Test the residuals of experiments (eq. residuals).

    Parameters
    ----------
    experiments : sequence of tuple of ndarray
        Tuples (u, y, y_hat) of shapes (N, nu), (N, ny), (N, ny): inputs, measured
        outputs, nan where not measured, and outputs of the model.
    sensitivities : sequence of callable or None, default=None
        What `scored_sensitivities` returns: the derivatives of the simulation by the
        parameters that were estimated, so that their errors, to first order, count for
        no dependence. None takes the model for exact, and finds these errors.
    ahead : bool, default=False
        Whether the outputs of the model are predictions one sample ahead, which know
        the past of y. Their errors are taken as they are, not whitened, and tested
        for what the past of y explains, too.
    first_lag : int, default=0
        First lag of u: 1 where u may depend on y of the same sample.
    level : float, default=0.01
        Probability of a false alarm, of each test and of the bands at each lag.
    n_lags : int or "auto", default="auto"
        Number of lags, which should cover the response of the plant; "auto" takes 25,
        or as many as a shorter record bears.
    dt : float, default=1.0
        Sampling time, in seconds.
    input_names, output_names : sequence of str or None, default=None
        Names of the signals; None means u0, u1, ... and y0, y1, ...

    Returns
    -------
    tests : ResidualTests
        Correlations, bands and p-values.

    Raises
    ------
    ValueError
        If `level` or `n_lags` is out of range, shapes or numbers of names do not fit
        together, inputs, outputs or a simulation are not finite, or there are too few
        samples for the lags.

    Examples
    --------
    >>> from alssnn.validation import residual_tests
    >>> rng = np.random.default_rng(0)
    >>> u, noise = rng.standard_normal((2, 500, 1))
    >>> tests = residual_tests([(u, 2 * u + noise, 1.5 * u)])
    >>> bool(tests.p_values["independence"] < 0.01)
    True
    """
    check_options(level, n_lags)
    experiments = _check_experiments(experiments)
    u = [u for u, _, _ in experiments]
    r = [y - y_hat for _, y, y_hat in experiments]
    seen = [_known(y, y_hat, ahead, first_lag) for _, y, y_hat in experiments]
    u, powers = _deviations(u), _powers(u, seen)
    nu, ny = u[0].shape[1], r[0].shape[1]
    input_names = check_names("input_names", input_names, "u", nu)
    output_names = check_names("output_names", output_names, "y", ny)
    z = norm.isf(level / 2)
    n_parameters = count_estimated(sensitivities)
    if n_lags == AUTO:
        n_lags = choose_lags(experiments, n_parameters, ahead) or LEAST
    _check_rows(experiments, n_lags, n_parameters, ahead)
    few = range(first_lag, min(n_lags, POWER_LAGS) + 1)
    past = _joined(u, _deviations(seen)) if ahead else u
    blocks = [(past, range(first_lag, n_lags + 1)), *((q, few) for q in powers)]
    columns, white, filters, explained = [], [], [], []
    for i in range(ny):
        r_i = [part[:, i] for part in r]
        y_i = [y[:, i] for _, y, _ in experiments]
        column, white_i, a = _test_output(r_i, y_i, u, n_lags, z, ahead)
        columns.append(column)
        white.append(white_i)
        filters.append(a)
        explained.append(explained_shares(r_i, blocks) * (column["share"] is not None))
    found = regress(white, filters, blocks, sensitivities)
    for i, (column, (p, share)) in enumerate(zip(columns, found, strict=True)):
        if column["share"] is None:  # nothing is left
            p, column["share"], share = [1.0] * len(p), 0.0, [0.0] * len(share)
        elif sensitivities is not None:
            column["p"] = _own_past(
                [part[:, [i]] for part in r], n_lags, sensitivities, i
            )
        column["p"] = np.array([column["p"], *p])
        column["share"] = np.array([column["share"], *share])
    stack = {key: np.stack([c[key] for c in columns], axis=-1) for key in columns[0]}
    names = ("whiteness", "parameters", *BLOCKS)
    return ResidualTests(
        lags=np.arange(n_lags + 1),
        autocorrelation=stack["auto"],
        autocorrelation_band=stack["auto_band"],
        cross_lags=np.arange(-n_lags, n_lags + 1),
        cross_correlation=np.moveaxis(stack["cross"], -1, 1),
        cross_band=stack["cross_band"],
        p_values=dict(zip(names, stack["p"], strict=True)),
        shares=dict(zip(names, stack["share"], strict=True)),
        explained=dict(zip(BLOCKS, np.transpose(explained), strict=True)),
        n_parameters=n_parameters,
        ar_order=stack["order"],
        n_samples=stack["n"],
        level=float(level),
        dt=float(dt),
        input_names=input_names,
        output_names=output_names,
        ahead=bool(ahead),
        first_lag=first_lag,
    )


def check_options(level, n_lags):
    """Refuse a level or a number of lags that is out of range.

    Parameters
    ----------
    level : float
        Probability of a false alarm.
    n_lags : int or "auto"
        Number of lags.

    Raises
    ------
    ValueError
        If `level` is not between 0 and 1 or `n_lags` not positive.
    """
    probability(level, "It is the probability of a false alarm, such as 0.01.")
    if isinstance(n_lags, str) and n_lags == AUTO:
        return
    number = isinstance(n_lags, Real) and not isinstance(n_lags, bool)
    if not (number and n_lags >= 1 and n_lags % 1 == 0):
        raise ValueError(
            f"`n_lags` must be a positive integer or 'auto', got {n_lags!r}. Give the "
            "number of samples over which the plant responds."
        )


def _check_experiments(experiments):
    """Return (u, y, y_hat) of every experiment as columns, or refuse them."""
    checked = [tuple(_columns(z) for z in zs) for zs in experiments]
    shapes = [tuple(z.shape for z in zs) for zs in checked]
    widths = {(u.shape[1:], y.shape[1:]) for u, y, _ in checked}
    if len(widths) != 1 or not all(
        u.ndim == y.ndim == 2 and len(u) == len(y) > 0 and y.shape == y_hat.shape
        for u, y, y_hat in checked
    ):
        raise ValueError(
            "`experiments` must hold one or more tuples (u, y, y_hat) of shapes "
            f"(N, nu), (N, ny), (N, ny), got {shapes}. Time runs down the rows."
        )
    for u, y, y_hat in checked:
        if not np.isfinite(y_hat).all():
            raise ValueError(
                "`y_hat` must be finite, got a simulation that diverges. Keep the data "
                "in the range of the training."
            )
        if not np.isfinite(u).all() or np.isinf(y).any():
            raise ValueError(
                "`u` must be finite, and `y` finite or nan, got other values. Only "
                "outputs may be nan, where they were not measured."
            )
    return checked


def _check_rows(experiments, n_lags, n_parameters, ahead):
    """Refuse a record that is too short for its regression."""
    rows, needed = rows_behind(experiments, n_lags, n_parameters, ahead)
    if rows < needed:
        raise ValueError(
            f"`y` must have at least {needed} measured samples behind the "
            f"first {n_lags} of the experiments, got {rows}. Take fewer `n_lags` or a "
            "longer record" + (", or exact=True." if n_parameters else ".")
        )


def _known(y, y_hat, ahead, first_lag):
    """Return outputs on which a residual must not depend, from `first_lag` on."""
    if not ahead:
        return y_hat
    y = np.where(np.isnan(y), y_hat, y)
    return y if first_lag else np.vstack([y[:1], y[:-1]])  # strictly of the past


def _test_output(r, y, u, n_lags, z, ahead):
    """Return correlations of one output, its whitened residual and the filter."""
    n = sum(int(np.isfinite(part).sum()) for part in r)
    nu = u[0].shape[1]
    mean = sum(np.nansum(part) for part in r) / n
    r = [part - mean for part in r]
    if is_rounding(r, y):
        return _nothing_left(n, n_lags, nu), [0 * part for part in r], np.zeros(0)
    auto, auto_pairs = _correlation(r, r, range(n_lags + 1))
    # Ljung and Box; pairs = n - k without gaps
    Q = n * (n + 2) * np.sum(auto[1:] ** 2 / np.maximum(auto_pairs[1:], 1))
    white, a, own_share = whiten(r)
    if ahead:
        white, a = r, np.zeros(0)
    lags = range(-n_lags, n_lags + 1)
    cross = [_correlation(white, [part[:, [j]] for part in u], lags) for j in range(nu)]
    n_white = sum(int(np.isfinite(part).sum()) for part in white)
    column = {
        "auto": auto,
        "auto_band": z * np.sqrt(auto_pairs) / n,
        "cross": np.stack([c for c, _ in cross], axis=-1),
        "cross_band": z * np.sqrt(cross[0][1]) / n_white,
        "p": chi2.sf(Q, n_lags),
        "share": own_share,
        "order": np.array(len(a)),
        "n": np.array(n),
    }
    return column, white, a


def _nothing_left(n, n_lags, nu):
    """Return the outcome of a residual that is rounding."""
    auto = np.zeros(n_lags + 1)
    auto[0] = 1.0
    return {
        "auto": auto,
        "auto_band": np.zeros(n_lags + 1),
        "cross": np.zeros((2 * n_lags + 1, nu)),
        "cross_band": np.zeros(2 * n_lags + 1),
        "p": 1.0,
        "share": None,
        "order": np.array(0),
        "n": np.array(n),
    }


# -- correlations ----------------------------------------------------------------------


def _correlation(a, b, lags):
    """Return the correlation of a_k with b_{k - lag} and the number of pairs.

    Lists of signals, one per experiment, with mean zero; nan does not count.
    """
    a = [part.ravel() for part in a]
    b = [part.ravel() for part in b]
    total = np.sqrt(
        sum(np.nansum(part**2) for part in a)
        * sum(
            np.sum(part_b[np.isfinite(part_a)] ** 2)
            for part_a, part_b in zip(a, b, strict=True)
        )
    )
    sums, pairs = np.zeros(len(lags)), np.zeros(len(lags))
    for part_a, part_b in zip(a, b, strict=True):
        for i, lag in enumerate(lags):
            late, early = part_a[max(lag, 0) :], part_b[max(-lag, 0) :]
            n = min(len(late), len(early))
            product = late[:n] * early[:n]
            sums[i] += np.nansum(product)
            pairs[i] += np.isfinite(product).sum()
    return sums / (total if total > 0 else 1.0), pairs


def _own_past(r, n_lags, sensitivities, i):
    """Return the p-value of the lags of one output's residual (Breusch, Godfrey)."""
    only = [partial(_of_output, parts, i) for parts in sensitivities]
    past = [(r, range(1, n_lags + 1))]
    (([_, p], _),) = regress([[part[:, 0] for part in r]], [np.zeros(0)], past, only)
    return p


def _of_output(parts, i):
    """Yield the sensitivities of one output."""
    for J, J_x0 in parts():
        yield J[:, [i]], J_x0[:, [i]]


# -- whitening -------------------------------------------------------------------------


def whiten(r):
    """Return what is left of a signal when its own past is used.

    Parameters
    ----------
    r : list of ndarray of shape (N,)
        One signal per experiment, of mean zero; nan where it is not known.

    Returns
    -------
    white : list of ndarray of shape (N,)
        Prediction errors of an autoregressive model; nan at the first samples of
        every experiment and behind unknown ones.
    a : ndarray of shape (order,)
        Coefficients of the model; order by Akaike's criterion, at most 10 log10(N).
    share : float
        Share of the variance that the past explains.
    """
    n = sum(int(np.isfinite(part).sum()) for part in r)
    highest = min(int(10 * np.log10(n)), n // 10, min(len(part) for part in r) // 4)
    while True:
        lags = range(1, highest + 1)
        rows = [np.column_stack([lagged(part[:, None], lags), part]) for part in r]
        triangle = Triangle(highest + 1)
        for block in rows:
            triangle.add(block)
        if triangle.n_rows > 4 * highest:
            break
        highest //= 2  # gaps leave too few complete rows
    R = triangle.factor()
    target = R[:, -1]
    rss = np.cumsum(target[::-1] ** 2)[::-1]  # of the orders 0, 1, ..., highest
    rss = np.maximum(rss, np.finfo(float).tiny)
    order = int(np.argmin(n * np.log(rss) + 2 * np.arange(highest + 1)))
    a = np.linalg.lstsq(R[:order, :order], target[:order], rcond=None)[0]
    white = [part - lagged(part[:, None], range(1, order + 1)) @ a for part in r]
    return white, a, float(1.0 - rss[order] / rss[0])


def _powers(u, y_hat):
    """Return squares, with products, and cubes of the signals, per experiment."""
    z = _joined(_deviations(u), _deviations(y_hat))
    nu = u[0].shape[1]
    kinds = (range(nu), range(nu, z[0].shape[1]))
    pairs = [ij for kind in kinds for ij in combinations_with_replacement(kind, 2)]
    squares = [
        np.column_stack([part[:, i] * part[:, j] for i, j in pairs]) for part in z
    ]
    return squares, [part**3 for part in z]


def _joined(a, b):
    """Return the columns of two signals side by side, per experiment."""
    return [np.hstack(pair) for pair in zip(a, b, strict=True)]


def _deviations(signals):
    """Return signals with mean zero and unit variance over all experiments."""
    every = np.vstack(signals)
    mean, std = every.mean(axis=0), every.std(axis=0)
    return [(z - mean) / np.where(std > 0, std, 1.0) for z in signals]


def _columns(z):
    z = np.asarray(z, dtype=float)
    return z[:, None] if z.ndim == 1 else z
