"""Hold-out: quarters of a record that judge a model which is simulated through them.

A fold hides a quarter of every experiment: its outputs become nan, so that a fit does
not see them, while the simulation runs on through the gap.  The error on the hidden
samples (eq. holdout) is then that of a free run from a state that the model itself has
reached: no initial state has to be estimated, and short experiments need not be cut.
The first quarter is never hidden, for it tells the initial state.
"""

from dataclasses import dataclass

import numpy as np

from .criterion import DIVERGED_NORM, Criterion
from .simulation import outputs, simulate

SHARE = 0.25  # of every experiment, hidden in one fold
NUDGE, STARTS = 0.1, 2  # size of a change of the initial state, and how many
ELSEWHERE = 4  # states along the record, from which a simulation begins anew
BLOCKS = 8  # of a fold, by which chance is told
TINY = np.finfo(float).tiny
FEW, MANY = 1_200, 4_000  # samples up to which three folds, two folds judge


@dataclass(frozen=True, eq=False)
class Fold:
    """Hold the samples that are fitted, and those that judge.

    Parameters
    ----------
    fitted : list of tuple of ndarray
        Pairs (u, y), where the hidden samples of y are nan. Those of the only fold of a
        record end before its hidden samples, which would cost time and not count.
    hidden : list of tuple of ndarray
        Pairs (u, y), where all but the hidden samples of y are nan.
    integrators : int, default=0
        Number of last states whose initial values are not changed: what integrates
        keeps every change for ever.
    """

    fitted: list
    hidden: list
    integrators: int = 0

    @property
    def whole(self):
        """Return the experiments with all their samples."""
        whole = []
        for (_, seen), (u, unseen) in zip(self.fitted, self.hidden, strict=True):
            y = unseen.copy()
            y[: len(seen)] = np.where(np.isnan(seen), y[: len(seen)], seen)
            whole.append((u, y))
        return whole

    def error(self, structure, theta, x0, output_weight=None, *, elsewhere=False):
        """Return the mean square error of a simulation on the hidden samples.

        Parameters
        ----------
        structure : Structure
            Structure of the model.
        theta : ndarray of shape (n_params,)
            Its parameters.
        x0 : ndarray of shape (n_experiments, n_x0)
            Initial states of the experiments.
        output_weight : ndarray of shape (ny,) or None, default=None
            Weight of every output; None means one.
        elsewhere : bool, default=False
            Whether simulations begin in four states along the record (eq. elsewhere)
            and not next to x0. No effect where a state integrates: it keeps for ever
            what differs.

        Returns
        -------
        error : float
            Mean square over outputs of unit variance, of the worst of these starts
            (eq. holdout); inf where it diverges.
        """
        (y,) = structure.channels
        weight = _shares(output_weight, structure.sizes[y])
        criterion = Criterion(structure, self.hidden, weights={y: weight})
        if elsewhere and not self.integrators:
            starts = self._along(structure, theta, x0)
        else:
            starts = self._nudged(x0)
        norm = max(criterion.norm(criterion.join(theta, start)) for start in starts)
        return norm**2 if norm < DIVERGED_NORM else np.inf

    def asked(self, penalized, theta, x0, weights):
        """Return what the cost asks beside the outputs (eq. judged).

        Parameters
        ----------
        penalized : Structure
            Structure of the model, with the channels that are penalized.
        theta : ndarray of shape (n_params,)
            Its parameters.
        x0 : ndarray of shape (n_experiments, n_x0)
            Initial states of the experiments.
        weights : dict of str to float or ndarray
            Weight of the square of every channel.

        Returns
        -------
        asked : float
            Weighted mean square of the penalized channels over all samples, relative
            to the weights of the outputs as in `error`; inf where the model diverges.
        """
        y, *others = penalized.channels
        if not others:
            return 0.0
        total = np.sum(np.broadcast_to(weights[y], penalized.sizes[y]))
        criterion = Criterion(penalized, self.hidden, weights={**weights, y: 0.0})
        norm = criterion.norm(criterion.join(theta, x0))
        return norm**2 / total if norm < DIVERGED_NORM else np.inf

    def squares(self, structure, theta, x0, output_weight=None):
        """Return the squared errors of the hidden samples, each times its weight.

        Parameters
        ----------
        structure : Structure
            Structure of the model.
        theta : ndarray of shape (n_params,)
            Its parameters.
        x0 : ndarray of shape (n_experiments, n_x0)
            Initial states of the experiments.
        output_weight : ndarray of shape (ny,) or None, default=None
            Weight of every output; None means one.

        Returns
        -------
        squares : ndarray of shape (n_hidden, ny)
            Of all samples with a measured output; zero where another was not, and not
            finite from where the simulation diverges.
        """
        lure, ny = structure.lure(theta), structure.sizes["y"]
        weight, squares = _shares(output_weight, ny), []
        for (u, y), start in zip(self.hidden, x0, strict=True):
            rows = np.isfinite(y[:]).any(axis=1)
            with np.errstate(over="ignore", invalid="ignore"):
                y_hat = outputs(lure, u, structure.initial_state(start))[rows, :ny]
                missed = np.where(np.isnan(y[rows]), 0.0, y_hat - y[rows])
                squares.append(weight * missed**2)
        return np.vstack(squares)

    def _nudged(self, x0):
        """Return initial states, and others next to them."""
        signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(STARTS, *x0.shape))
        signs[..., x0.shape[1] - self.integrators :] = 0.0
        return [x0, *(x0 + NUDGE * signs)]

    def _along(self, structure, theta, x0):
        """Return states along the simulation of all experiments, one for all of them.

        Of a simulation that diverges, its initial states.
        """
        lure, n = structure.lure(theta), x0.shape[1]
        runs = [
            simulate(lure, u, structure.initial_state(start))[:-1, :n]
            for (u, _), start in zip(self.fitted, x0, strict=True)
        ]
        X = np.concatenate(runs)
        if not np.isfinite(X).all():
            return [x0]
        rows = ((np.arange(ELSEWHERE) + 0.5) / ELSEWHERE * len(X)).astype(int)
        return [np.tile(state, (len(x0), 1)) for state in X[rows]]


def certainty(pairs):
    """Return a mean difference of squares over its standard error (eq. certainty).

    Parameters
    ----------
    pairs : sequence of tuple of ndarray
        By fold, the squared errors of one model and those of another, of shape
        (n_hidden, ny).

    Returns
    -------
    certainty : float
        Of eight blocks of every fold: how many standard errors the second model is
        better; infinite where the first alone diverges, zero if too little is hidden.
    """
    blocks = []
    for ours, theirs in pairs:
        if not np.isfinite(theirs).all():
            return -np.inf
        if not np.isfinite(ours).all():
            return np.inf
        gain = np.sum(ours - theirs, axis=1)
        parts = np.array_split(gain, BLOCKS)
        blocks += [part.mean() for part in parts if len(part)]
    if len(blocks) < 2:
        return 0.0
    error = np.std(blocks, ddof=1) / np.sqrt(len(blocks))
    return float(np.mean(blocks) / max(error, TINY))


def _shares(output_weight, ny):
    """Return the weights of the outputs, their sum one."""
    weight = np.ones(1) if output_weight is None else np.asarray(output_weight)
    weight = np.broadcast_to(weight, ny)
    return weight / weight.sum()


def hold_out(experiments, share=SHARE, integrators=0):
    """Return the folds that judge models of some experiments.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    share : float, default=0.25
        Share of every experiment that one fold hides.
    integrators : int, default=0
        Number of last states that integrate.

    Returns
    -------
    folds : list of Fold
        One for long records, whose last part tells enough; up to three for short ones,
        as long as the beginning stays visible.
    """
    n_samples = sum(len(u) for u, _ in experiments)
    wanted = 3 if n_samples <= FEW else 2 if n_samples <= MANY else 1
    n_folds = max(1, min(wanted, int(np.floor(1 / share + 1e-9)) - 1))
    # what the only one hides ends every experiment; of several, one alone could be cut
    is_cut = n_folds == 1
    return [_fold(experiments, share, i, integrators, is_cut) for i in range(n_folds)]


def _fold(experiments, share, i, integrators, is_cut):
    """Hide the i-th part of every experiment, counted from its end."""
    fitted, hidden = [], []
    for u, y in experiments:
        u, y = np.array(u), np.array(y)
        part = slice(
            len(u) - round((i + 1) * share * len(u)), len(u) - round(i * share * len(u))
        )
        seen, unseen = y.copy(), np.full_like(y, np.nan)
        seen[part] = np.nan
        unseen[part] = y[part]
        end = part.start if is_cut else len(u)
        fitted.append((u[:end], seen[:end]))
        hidden.append((u, unseen))
    return Fold(fitted, hidden, integrators)
