"""The sums behind the covariance of parameters (eq. sandwich, eq. weighting).

What `uncertainty` holds and shows is computed here, chunk by chunk along the record.
"""

import numpy as np
from scipy.linalg import eigh
from scipy.stats import chi2

from .compression import equilibrated_eigh
from .noise import Moments
from .sensitivities import sensitivities
from .simulation import runs

RANK_FLOOR = 1e-11  # relative: smaller eigenvalues of J'J are rounding
LOSS = 0.1  # relative excess of a variance that is worth a test


def _residuals(structure, theta, x0, experiments):
    """Yield, of every experiment, what yields the errors of its simulation in parts."""
    ny = structure.sizes["y"]
    lure = structure.lure(theta)
    for (u, y), start in zip(experiments, x0, strict=True):
        simulation = runs(lure, u, structure.initial_state(start))
        yield (Z[:, :ny] - y[part] for part, _, _, Z in simulation)


def residual_moments(structure, theta, x0, experiments, n_lags=0):
    """Return sums of lagged products of the simulation errors.

    Parameters
    ----------
    structure : Structure
        Structure of the model, y its first channel.
    theta : ndarray of shape (n_params,)
        Parameters.
    x0 : ndarray of shape (n_experiments, n_x0)
        Initial states.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations; nan where an output was not measured.
    n_lags : int, default=0
        Largest lag.

    Returns
    -------
    moments : Moments
        Sums and numbers of pairs that were measured.
    """
    moments = Moments(n_lags, structure.sizes["y"])
    for parts in _residuals(structure, theta, x0, experiments):
        moments.start()
        for E in parts:
            moments.add(E)
    return moments


def score_covariance(structure, theta, x0, experiments, output_weight, noise):
    """Return the covariance of half the gradient of the cost (eq. colored).

    Parameters
    ----------
    structure : Structure
        Structure of the model, without penalized channels.
    theta : ndarray of shape (n_params,)
        Parameters.
    x0 : ndarray of shape (n_experiments, n_x0)
        Initial states.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations; nan where an output was not measured.
    output_weight : ndarray of shape (ny,)
        Weight of the squared error of every output over the number of samples.
    noise : Noise
        Autoregression of the noise.

    Returns
    -------
    covariance : ndarray of shape (n, n)
        Sum of F_k' W Gamma(k-l) W F_l, over (theta, x0 of all experiments).
    """
    n_params, n_x0 = structure.n_params, structure.n_x0
    n = n_params + n_x0 * len(experiments)
    total = np.zeros((n, n))
    values, Q = eigh(noise.backward_innovation)
    root = (Q * np.sqrt(np.maximum(values, 0.0))).T  # root' root is that covariance
    for i, ((u, y), start) in enumerate(zip(experiments, x0, strict=True)):
        where = np.r_[:n_params, n_params + i * n_x0 : n_params + (i + 1) * n_x0]
        parts = _measured(sensitivities(structure, theta, start, u, output_weight), y)
        for Z in noise.color(parts):
            Z = np.matmul(root, Z).reshape(-1, Z.shape[-1])
            total[np.ix_(where, where)] += Z.T @ Z
    return total


def _measured(parts, y):
    """Yield sensitivities, zero where the output was not measured."""
    for part, _, J in parts:
        J[np.isnan(y[part])] = 0.0
        yield J


def weighted_step(structure, theta, x0, experiments, output_weight, noise, score, free):
    """Return how weighing the noise moves a fit, and how likely (eq. weighting).

    Parameters
    ----------
    structure : Structure
        Structure of the model, without penalized channels.
    theta : ndarray of shape (n_params,)
        Parameters.
    x0 : ndarray of shape (n_experiments, n_x0)
        Initial states.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations; nan where an output was not measured.
    output_weight : ndarray of shape (ny,)
        Weight of the squared error of every output over the number of samples.
    noise : Noise
        Autoregression of the noise.
    score : ndarray of shape (n, n)
        What `score_covariance` returns.
    free : ndarray of bool of shape (n,)
        Entries of (theta, x0 of all experiments) that nothing holds.

    Returns
    -------
    force : ndarray of shape (n,)
        Gauss-Newton matrix of the simulation error times the step from its least
        squares to those of the whitened one; zero where something holds.
    p : float
        Probability of a step as large if the fit is sound; 1 for white noise.
    """
    n_params, n_x0 = structure.n_params, structure.n_x0
    n = n_params + n_x0 * len(experiments)
    H, g = np.zeros((2, n, n)), np.zeros((2, n))  # as they are, and whitened
    sqrt_W = np.sqrt(output_weight)[:, None]
    whiten = np.linalg.inv(np.linalg.cholesky(noise.innovation))
    for i, ((u, y), start) in enumerate(zip(experiments, x0, strict=True)):
        where = np.r_[:n_params, n_params + i * n_x0 : n_params + (i + 1) * n_x0]
        rows = _rows(structure, theta, start, u, y)
        for now, before in noise.whiten(rows):
            for which, (root, block) in enumerate(((sqrt_W, now), (whiten, before))):
                if which:
                    block = np.matmul(root, block)
                else:
                    block = np.nan_to_num(root * block)
                block = block.reshape(-1, block.shape[-1])
                block = block[np.isfinite(block).all(axis=1)]
                J, r = block[:, :-1], block[:, -1]
                H[which][np.ix_(where, where)] += J.T @ J
                g[which][where] += J.T @ r
    H, g, score = (M[..., free] for M in (H, g, score))
    H, score = H[:, free], score[free]
    plain = pseudo_inverse(H[0])[0]
    P = plain @ score @ plain
    values, Q, size = equilibrated_eigh(H[1], RANK_FLOOR)
    root = size[:, None] * Q * np.sqrt(values)  # root root' = H[1]
    back = Q / size[:, None] / np.sqrt(values)  # root' back = 1
    step = back.T @ g[1] - root.T @ plain @ g[0]
    force = np.zeros(n)
    force[free] = H[0] @ back @ step
    loss, U = eigh(root.T @ P @ root)  # variance over the least possible one
    told = loss - 1 > LOSS
    square = np.sum((U[:, told].T @ step) ** 2 / (loss[told] - 1))
    return force, float(chi2.sf(square, told.sum())) if told.any() else 1.0


def _rows(structure, theta, x0, u, y):
    """Yield [J, y - yhat] of one experiment; nan where not measured."""
    ones = np.ones(structure.sizes["y"])
    for part, Z, J in sensitivities(structure, theta, x0, u, ones):
        E = y[part] - Z
        rows = np.concatenate([J, E[:, :, None]], axis=2)
        rows[np.isnan(E)] = np.nan
        yield rows


def pseudo_inverse(H):
    """Return the pseudo-inverse of an equilibrated Gauss-Newton matrix, and its rank.

    Parameters
    ----------
    H : ndarray of shape (n, n)
        Symmetric, positive semidefinite up to rounding.

    Returns
    -------
    inverse : ndarray of shape (n, n)
        A generalized inverse; which one does not matter to what H sees.
    rank : int
        Number of eigenvalues above the level of rounding.
    """
    values, Q, size = equilibrated_eigh(H, RANK_FLOOR)
    Q = Q / size[:, None]
    return (Q / values) @ Q.T, len(values)
