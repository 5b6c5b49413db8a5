"""What a model may miss, by its residual along a record (eq. missed).

A residual is noise, and what the plant does that the model does not.  The latter acts
on the states, x+ = f(x, u) + w(x, u), and moves the output by what is linear in w along
the record.  Nobody knows w.  So it is taken for a smooth function, a normal process
with a Gaussian kernel of z = [x; u] in the ellipsoid of the training data, whose series
ends at a degree.  How large it is before the record is seen, the hidden samples of the
fit tell (eq. missing): where a record has few states, its own residual tells too
little, for the fit has taken it out.  The record then leaves those that agree with the
residual: a mean, and a covariance that noise makes.

No option is to be set.  The noise is what no w explains.
"""

from dataclasses import dataclass
from math import ceil, comb, factorial, sqrt

import numpy as np
from sklearn.preprocessing import PolynomialFeatures

from ..holdout import hold_out
from ..region import Region, independent_samples
from ..shown import short_repr
from ..simulation import simulate

DEGREE = 6  # of the series, at most
# In true loops of models that nearly fit (`benchmarks.true_loops`), a kernel that grows
# outwards, exp(4 z'z'), tells less well what happens, as do errors of one size for all.
TURN = 3.0  # w may turn within the radius of the training data over this
# Share of the variance of the output that w makes a priori, unless the residual is more
EXPECTED = 0.01
LOG_SPREAD = 1.6  # a factor of five: how far this may be off, before anything is hidden
LOG_SPAN = 9.2  # a factor of 10,000: how far it is looked for
MOST = 400  # coefficients of w
PER_COEFFICIENT = 5  # samples that each of them needs
LONGEST = 20_000  # samples of all experiments that are looked at, at most
ENTRIES = 2e7  # effects of coefficients on samples, at most: 160 MB
PASSES = 6  # to find the size of the noise
CONVERGED = 0.02  # relative, of its square
LEAST = 1e-12  # square of the noise over that of the output: rounding
RANK_TOL = 1e-8  # relative: effects of the start that cannot be told apart
TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Missed:
    """Hold the errors w(x, u) = root Theta psi(z) of a model that a record leaves.

    Parameters
    ----------
    region : Region
        Region of the training data, in which w is a function of z.
    powers : ndarray of int of shape (n_terms, n_z)
        Powers of z in every term of psi.
    root : ndarray of shape (nx, nx)
        Factor of the covariance of the states: no basis is preferred.
    mean : ndarray of shape (nx * n_terms,)
        Coefficients Theta that the residual speaks for, row by row.
    factor : ndarray of shape (nx * n_terms, nx * n_terms)
        Factor of their covariance.
    noise : ndarray of shape (ny,)
        Root mean square of what no w explains, in the units of y.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.feedback import what_is_missed
    >>> missed = what_is_missed(model.plant_, model.prepare_records(*record))
    >>> bool(missed.noise[0] < 0.15 * record.y.std())
    True
    """

    __repr__ = short_repr

    region: Region
    powers: np.ndarray
    root: np.ndarray
    mean: np.ndarray
    factor: np.ndarray
    noise: np.ndarray

    def draw(self, n, random_state):
        """Draw errors that the record does not rule out.

        Parameters
        ----------
        n : int
            Number of draws.
        random_state : RandomState instance
            Source of the draws.

        Returns
        -------
        draws : ndarray of shape (n, nx * n_terms)
            Coefficients.
        """
        white = random_state.standard_normal((n, len(self.mean)))
        return self.mean + white @ self.factor.T

    def push(self, theta, X, du):
        """Return w for one model error per row.

        Parameters
        ----------
        theta : ndarray of shape (N, nx * n_terms)
            Coefficients.
        X : ndarray of shape (N, nx)
            States.
        du : ndarray of shape (N, nu)
            Deviations of the inputs that have arrived.

        Returns
        -------
        w : ndarray of shape (N, nx)
            What is added to the next states.
        """
        psi = _terms(self.region, self.powers, X, du)
        by_state = theta.reshape(len(theta), len(self.root), -1)
        return np.einsum("nij,nj->ni", by_state, psi) @ self.root.T


def what_is_missed(plant, records):
    """Return the errors of a model that a record does not rule out (eq. missed).

    Parameters
    ----------
    plant : Plant
        Model whose inputs have arrived.
    records : sequence of PreparedRecord
        Experiments, of which `du`, `dy` and `x0` count.

    Returns
    -------
    missed : Missed or None
        The errors; None if the model diverges along the record.

    Notes
    -----
    Of N samples and n coefficients of w, at most 400 or those of first degree, the
    cost is that of N n^2 multiplications, and a few arrays of N n numbers for every
    output: as many samples count, at most 20,000, as keep each of them below 160 MB.
    """
    plant = plant.arrived()
    given = _first([(record.du, record.dy) for record in records], LONGEST)
    runs = [
        (_states(plant, du, dy, record.x0), du, dy)
        for (du, dy), record in zip(given, records, strict=True)
    ]
    states, inputs = (np.vstack([run[i] for run in runs]) for i in (0, 1))
    if not np.isfinite(states).all():
        return None
    region = plant.region
    if region is None:
        y = plant.output(states, inputs + plant.u_offset) - plant.y_offset
        region = Region.of(states, inputs, y)
    powers = _powers(region, plant.nx, len(states) * plant.ny)
    root = _root(states)
    runs = _first(runs, ENTRIES / (plant.nx * (len(powers) + 1) * plant.ny))
    y = [plant.output(X, du + plant.u_offset) - plant.y_offset for X, du, _ in runs]
    r = [run[2] - y_hat for run, y_hat in zip(runs, y, strict=True)]
    J = [
        _effects(plant, X, du, root, _terms(region, powers, X, du)) for X, du, _ in runs
    ]
    dy = np.vstack([run[2] for run in runs])
    told = None
    # a predictor is judged by its simulation, and its residual is of one step
    if plant.hidden_error is not None and plant.K is None:
        told = plant.hidden_error, _hidden(runs)
    return Missed(region, powers, root, *_posterior(J, r, dy, plant.nx, told))


def _hidden(runs):
    """Return by fold which samples of all experiments a search would hide."""
    folds = hold_out([run[1:] for run in runs])
    every = [[np.isfinite(y).all(axis=1) for _, y in fold.hidden] for fold in folds]
    return [np.concatenate(parts) for parts in every]


def _states(plant, du, dy, x0):
    """Return the states of the model along an experiment, as its fit had them."""
    if plant.K is None:
        return simulate(plant.lure, du, x0, plant.x_scale)[:-1]
    X, x, u = np.empty((len(du), plant.nx)), x0, du + plant.u_offset
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(len(X)):
            X[k] = x
            eps = dy[k] - (plant.output(x, u[k]) - plant.y_offset)
            x = plant.step(x, u[k]) + plant.K @ np.nan_to_num(eps)
    return X


def _first(experiments, n):
    """Return the first rows of experiments, n of all, the same share of every one."""
    share = min(1.0, n / sum(len(first) for first, *_ in experiments))
    return [tuple(z[: ceil(share * len(z))] for z in each) for each in experiments]


def _powers(region, nx, n_samples):
    """Return the powers of all terms, up to the degree that the record bears."""
    n = region.whiten.shape[1]
    most = min(MOST, n_samples / PER_COEFFICIENT)
    # the terms of first degree are rather too many, if the samples that `ENTRIES`
    # leaves determine them
    linear = sqrt(ENTRIES / PER_COEFFICIENT)
    degree = DEGREE
    while degree > 0 and nx * comb(n + degree, degree) > (
        most if degree > 1 else linear
    ):
        degree -= 1
    return PolynomialFeatures(degree).fit(np.zeros((1, n))).powers_


def _terms(region, powers, X, du):
    """Return psi of the samples: psi(z)'psi(z') is the kernel but for its end."""
    z = np.hstack([X, du])[:, : len(region.center)] - region.center
    z = z @ region.whiten / region.radius
    z /= np.maximum(np.linalg.norm(z, axis=1, keepdims=True), 1.0)  # no extrapolation
    near = np.exp(-(TURN**2) / 2 * np.sum(z**2, axis=1, keepdims=True))
    every = z[:, :, None] ** np.arange(powers.max() + 1)
    # (1, TURN, TURN^2 / sqrt 2!, ...)
    every *= [TURN**i / sqrt(factorial(i)) for i in range(every.shape[2])]
    terms = every[:, 0, powers[:, 0]]
    for j in range(1, z.shape[1]):
        terms = terms * every[:, j, powers[:, j]]
    return near * terms


def _root(states):
    """Return a factor of the covariance of the states."""
    _, spread, Vt = np.linalg.svd(states - states.mean(axis=0), full_matrices=False)
    return (Vt.T * spread) @ Vt / np.sqrt(len(states))


def _effects(plant, X, du, root, psi):
    """Return what every coefficient, and the start, do to y, (N, ny, n)."""
    F, _, C, _ = plant.jacobian(X, du + plant.u_offset)
    if plant.K is not None:
        F = F - plant.K @ C
    nx = plant.nx
    n = nx * psi.shape[1]
    S = np.hstack([np.zeros((nx, n)), root])
    J = np.empty((len(X), plant.ny, S.shape[1]))
    for k in range(len(X)):
        J[k] = C[k] @ S
        S = F[k] @ S
        S[:, :n] += (root[:, :, None] * psi[k]).reshape(nx, -1)
    return J


def _without_start(J, r, nx):
    """Return effects and residual of an experiment without what its start explains."""
    ok = np.isfinite(r)
    J, r = np.where(ok[..., None], J, 0.0), np.where(ok, r, 0.0)
    shape, n = J.shape[:2], J.shape[2] - nx
    J = J.reshape(-1, n + nx)
    U, spread, _ = np.linalg.svd(J[:, n:], full_matrices=False)
    U = U[:, spread > RANK_TOL * spread.max(initial=0.0)]
    both = np.hstack([J[:, :n], r.reshape(-1, 1)])
    both -= U @ (U.T @ both)
    return both[:, :-1].reshape(*shape, n), both[:, -1].reshape(shape), ok


def _posterior(J, r, dy, nx, told):
    """Return mean and factor of the covariance of the coefficients, and the noise."""
    size = np.sqrt(np.maximum(np.nanvar(dy, axis=0), TINY))
    parts = [
        _without_start(J_i / size[:, None], r_i / size, nx)
        for J_i, r_i in zip(J, r, strict=True)
    ]
    every, given, known = (np.concatenate(z) for z in zip(*parts, strict=True))
    count = np.maximum(known.sum(axis=0), 1)
    gram = _gram(every)
    slope = np.stack([every[:, i].T @ given[:, i] for i in range(len(size))])
    made = np.mean(np.trace(gram, axis1=1, axis2=2) / count)  # by coefficients of one
    expected = max(EXPECTED, float(np.mean(np.sum(given**2, axis=0) / count)))
    prior = max(made / expected, TINY)
    noise, rest = _noise(every, given, count, gram, slope, prior)
    # what is left is seldom white: so many samples are as good as independent ones
    ends = np.cumsum([len(r_i) for r_i in r])[:-1]
    independent = sum(map(independent_samples, np.split(rest, ends)))
    weight = independent / len(rest) / noise
    if told is not None and np.isfinite(told[0]):
        observed, hidden = told
        of_noise = np.mean(noise)  # nothing can be less
        squares = max(observed**2, of_noise), of_noise
        prior /= _enlarged(every, gram, weight, hidden, *squares, prior)
        noise, rest = _noise(every, given, count, gram, slope, prior)
        weight = independent / len(rest) / noise
    H = np.tensordot(weight, gram, axes=1)
    values, V = np.linalg.eigh(prior * np.eye(len(H)) + H)
    factor = V / np.sqrt(values)
    return factor @ (factor.T @ (weight @ slope)), factor, size * np.sqrt(noise)


def _gram(every):
    """Return J'J of every output."""
    return np.stack([J_i.T @ J_i for J_i in every.swapaxes(0, 1)])


def _noise(every, given, count, gram, slope, prior):
    """Return the mean square that no w explains, and what is left of the residual."""
    noise, rest = np.maximum(np.sum(given**2, axis=0) / count, LEAST), given
    for _ in range(PASSES):
        H = prior * np.eye(gram.shape[1]) + np.tensordot(1 / noise, gram, axes=1)
        rest = given - every @ np.linalg.solve(H, (1 / noise) @ slope)
        before, noise = noise, np.maximum(np.sum(rest**2, axis=0) / count, LEAST)
        if np.allclose(noise, before, rtol=CONVERGED, atol=0.0):
            break
    return noise, rest


def _enlarged(every, gram, weight, hidden, observed, noise, prior):
    """Return how much larger the variance of w is than expected (eq. missing).

    `observed` and `noise` are mean squares, that of the fits on hidden samples and that
    of the noise; `prior` is the expected precision of every coefficient.
    """
    ny, spectra = every.shape[1], []
    for rows in hidden:
        unseen = _gram(every[rows])
        values, V = np.linalg.eigh(np.tensordot(weight, gram - unseen, axes=1))
        parts = np.einsum("ij,kil,lj->j", V, unseen, V, optimize=True)
        spectra.append((np.maximum(values, 0.0), parts / max(ny * rows.sum(), 1)))
    n_hidden = max(ny * sum(rows.sum() for rows in hidden), 1)
    logs = np.linspace(-LOG_SPAN, LOG_SPAN, 161)
    made = np.array(
        [
            np.mean([np.sum(z / (prior * np.exp(-s) + L)) for L, z in spectra])
            for s in logs
        ]
    )
    total = noise + made
    spread = np.hypot(np.sqrt(2 / n_hidden) * noise, made) / total
    off = np.log(observed / total) / spread
    misfit = off**2 + 2 * np.log(spread) + (logs / LOG_SPREAD) ** 2
    return float(np.exp(logs[np.argmin(misfit)]))
