"""The adjoint of a simulation: J'c for given c, without J.

For residuals c of the channels, the adjoint runs through the record backwards
(eq. adjoint),

    lambda = F' lambda+ + H' c,        lambda behind the last sample = 0,

with F and H of (eq. sens), and the gradient by Theta is a sum over the samples,

    sum_k [lambda+; c; nu]_k phi_k',   nu = (W R)' [lambda+; c],

which `structures.pull` takes to theta.  It costs about as much as a simulation,
whatever the number of parameters.

`pulled_change` takes c from two simulations next to each other: how the residual
changes along a part of a step (eq. geodesic).  Where the initial state is that of a
period, it follows theta: the adjoint behind the last sample is then not zero, but the
one that comes back after a period (eq. steady).  All of it takes as long as
two to four simulations.
"""

import numpy as np

from .experiments import chunks
from .kernels import retrace
from .simulation import linearized, regressors, simulate
from .structures import pull

KEPT_BYTES = 48_000_000  # states that are kept; those of longer records are repeated
GAINS_BYTES = 1_600_000  # gains of the samples that are treated at a time


def pulled_change(structure, thetas, x0s, u, weight, missing, periodic=False):
    """Return J' (r_2 - r_1) for the residuals at two points.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    thetas : sequence of two ndarray of shape (n_params,)
        Parameters; J belongs to the first ones.
    x0s : sequence of two ndarray of shape (n_x0,)
        Free parts of the initial states.
    u : array of shape (N, nu)
        Inputs; only sliced.
    weight : ndarray of shape (nz,)
        Factors of the residual.
    missing : callable
        Called with a slice: which values of the first channels have no residual, as an
        ndarray of bool of shape (L, n_measured).
    periodic : bool, default=False
        Whether the initial states are those of periods, which follow theta
        (eq. steady).

    Returns
    -------
    by_theta : ndarray of shape (n_params,)
        Part by the parameters; nan if a simulation diverges.
    by_x0 : ndarray of shape (n_x0,)
        Part by the initial state.
    """
    lures = [structure.lure(theta) for theta in thetas]
    x = [structure.initial_state(x0) for x0 in x0s]
    length = max(1, KEPT_BYTES // (8 * len(lures) * max(structure.nx, 1)))
    spans, starts, X = chunks(len(u), length=length), [], x
    for span in spans:
        starts.append(x)
        X = [simulate(lure, u[span], at) for lure, at in zip(lures, x, strict=True)]
        x = [states[-1].copy() for states in X]  # a view would keep all states
        if not np.isfinite(x).all():
            nan = np.full(structure.n_params, np.nan)
            return nan, np.full(structure.n_x0, np.nan)
    n = structure.n_x0

    def sweep(backwards):
        states = X
        for span, x in zip(reversed(spans), reversed(starts), strict=True):
            if span is not spans[-1]:
                pairs = zip(lures, x, strict=True)
                states = [simulate(lure, u[span], at) for lure, at in pairs]
            backwards(u[span], states, missing(span))
        return backwards

    end = np.zeros(structure.nx)
    if periodic:
        once = sweep(_Backwards(lures, weight, end, np.eye(n, structure.nx)))
        end[:n] = np.linalg.solve(np.eye(n) - once.through[:, :n].T, once.carried[:n])
    found = sweep(_Backwards(lures, weight, end))
    by_x0 = np.zeros(n) if periodic else found.carried[:n]
    return pull(structure, thetas[0], found.by_Theta), by_x0


class _Backwards:
    """Carry the adjoint backwards, and sum the gradient by Theta.

    Rows that are carried ``through`` become derivatives of the states behind the record
    by those at its start, if they begin as the identity.
    """

    def __init__(self, lures, weight, end, through=()):
        self.lures, lure = lures, lures[0]
        self.square = weight**2
        self.n_rows = lure.nx + lure.nz
        self.by_Theta = np.zeros_like(lure.Theta)
        self.carried, self.through = end.copy(), np.array(through)
        size = 8 * self.n_rows * (lure.nw + lure.nx + 1)
        self.length = max(8, GAINS_BYTES // size)

    def __call__(self, u, X, missing):
        """Go back through the samples of a span."""
        for part in reversed(chunks(len(u), length=self.length)):
            Phi = [
                regressors(lure, states[part], u[part])
                for lure, states in zip(self.lures, X, strict=True)
            ]
            at, after = (
                phi @ lure.rows_z.T for lure, phi in zip(self.lures, Phi, strict=True)
            )
            c = (after - at) * self.square
            c[:, : missing.shape[1]][missing[part]] = 0.0
            self._back(Phi[0], c)

    def _back(self, Phi, c):
        """Go back through some samples (eq. adjoint)."""
        lure, n_rows = self.lures[0], self.n_rows
        rows = np.hstack([np.empty((len(c), lure.nx)), c])
        apart = not lure.E.any()
        gains, FH = linearized(lure, lure.W, lure.M, Phi, apart)
        retrace(FH, self.carried, rows)
        for row in self.through:
            retrace(FH, row, np.zeros((len(c), n_rows)))
        if apart:
            inside = (rows @ lure.W) * gains[:, 0]
        else:
            inside = np.einsum("kr,krn->kn", rows, gains)
        self.by_Theta[:n_rows] += rows.T @ Phi
        self.by_Theta[n_rows:] += inside.T @ Phi
