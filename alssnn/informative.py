"""How much an experiment would tell: the information of inputs not sent yet.

The sensitivities of a simulation need no outputs (eq. sens).  An input u_c that is
sent next adds its Gauss-Newton matrix to that of the record, and the errors of the
parameters have the covariance (eq. next)

    P_c = s^2 (H + H_c)^+,        H = J'J of the record,   H_c = J'J of u_c from rest.

What matters is the law.  Its error at a sample of the region where it is to work is
dv/dtheta times that of the parameters, and the mean over samples is tr(M P_c), with
M the mean of (dv/dtheta)' (dv/dtheta).  Affine functions of what h sees are taken out
of dv/dtheta first: A and h may share them in any way, and no record tells which
(eq. gauge).
"""

from dataclasses import dataclass

import numpy as np

from .compression import equilibrated_eigh
from .contribution import Contribution
from .sensitivities import sensitivities
from .simulation import channels, simulate

RANK = 1e-9  # relative: what no candidate tells
LEAST = 1e-7  # prior knowledge, relative to what all experiments tell together
POINTS = 300  # samples of the region where the law is looked at


LAW, OUTPUT = "law", "output"  # what an error is of


@dataclass(frozen=True, eq=False, repr=False)
class NextInput:
    """Hold how much each of several experiments would tell.

    Parameters
    ----------
    candidates : list of Excitation or ndarray
        Inputs that may be sent next.
    expected : ndarray of shape (n_candidates,)
        Error that is expected after each of them, over that of the model as it is; nan
        where the model leaves its limits, or diverges.
    target : {"law", "output"}
        What the error is of.

    Examples
    --------
    >>> record = alssnn.datasets.make_pendulum(600, noise=0.01, random_state=0)
    >>> options = {"n_h": 3, "n_init": 1, "alpha": 1e-4, "random_state": 0}
    >>> model = alssnn.FlSsnn(nx=2, dt=record.dt, **options)
    >>> chosen = model.fit(record.u, record.y).next_input(
    ...     record.u, record.y, candidates=6, low=-15, high=15, random_state=0
    ... )
    >>> chosen, bool(chosen.expected.min() < 1)
    (NextInput(best=..., expected=..., target='law'), True)
    >>> chosen.excitation.kind in ("steps", "multisine")
    True
    """

    candidates: list
    expected: np.ndarray
    target: str

    @property
    def best(self):
        """Return the number of the candidate that tells most."""
        return int(np.nanargmin(self.expected))

    @property
    def excitation(self):
        """Return the candidate that tells most."""
        return self.candidates[self.best]

    def __repr__(self):
        """Return the best one in one line."""
        expected = self.expected[self.best]
        return (
            f"NextInput(best={self.best}, expected={expected:.3g}, "
            f"target={self.target!r})"
        )


def information(structure, theta, experiments, output_weight, x0=None):
    """Return the Gauss-Newton matrices of theta, initial states eliminated.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Parameters.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations; nan where not measured.
    output_weight : ndarray of shape (ny,)
        Weight of the squared error of every output.
    x0 : ndarray of shape (n_experiments, n_x0) or None, default=None
        Initial states, which have to be estimated, too; None starts at rest.

    Returns
    -------
    matrices : list of (ndarray of shape (n_params, n_params) or None)
        One per experiment; None where the simulation diverges.
    """
    structure = structure.observe(structure.measured)
    weight = np.sqrt(np.broadcast_to(output_weight, structure.sizes["y"]))
    one = Contribution(structure, weight)
    found: list[np.ndarray | None] = []
    for i, (u, y) in enumerate(experiments):
        start = np.zeros(structure.n_x0) if x0 is None else x0[i]
        try:
            arrow = one.arrow(theta, i, start, u, y)
        except FloatingPointError:
            found.append(None)
            continue
        head, n = arrow.head, structure.n_params
        if x0 is not None:
            rows = arrow.borders[i][0]
            head = head - rows[:, :n].T @ np.linalg.pinv(rows[:, n:]) @ rows[:, :n]
        found.append(head)
    return found


def simulated(structure, theta, inputs):
    """Return the states and outputs of simulations from rest.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Parameters.
    inputs : sequence of array of shape (N, nu)
        Scaled deviations.

    Returns
    -------
    runs : list of (tuple of ndarray or None)
        Pairs (X, y) of shapes (N, nx) and (N, ny); None where the simulation diverges.
    """
    structure = structure.observe(structure.measured)
    lure, found = structure.lure(theta), []
    start = structure.initial_state(np.zeros(structure.n_x0))
    for u in inputs:
        X = simulate(lure, u[:], start)[:-1]
        known = np.isfinite(X).all()
        found.append((X, channels(lure, X, u[:])) if known else None)
    return found


def law_weight(structure, theta, X, u):
    """Return what errors of the parameters do to the law (eq. next).

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Parameters.
    X : ndarray of shape (n_points, nx)
        States at samples of the region.
    u : ndarray of shape (n_points, nu)
        Inputs there.

    Returns
    -------
    M : ndarray of shape (n_params, n_params)
        Mean square error of the law, without affine functions of what it sees, as a
        quadratic form of the error of the parameters.
    """
    plain, law = structure.observe(structure.measured), structure.law()
    s = X[:, : structure.n_x0]
    if law.inputs[0] == structure.measured:
        s = channels(plain.lure(theta), X, u)
    v = structure.observe("v")
    ones, n = np.ones(v.nz), v.n_params
    J = np.empty((len(X), v.nz, n))
    for k in range(len(X)):  # one step each: what theta does to v at this state
        x0 = X[k, : v.n_x0]
        *_, (_, _, now) = sensitivities(v, theta, x0, u[k : k + 1], ones)
        J[k] = now[0, :, :n]
    affine = np.hstack([np.ones((len(s), 1)), s])
    Q = np.linalg.qr(affine)[0]
    J = J.reshape(len(X), -1)
    J = (J - Q @ (Q.T @ J)).reshape(-1, n)
    return J.T @ J / len(X)


def error(M, H, basis, prior):
    """Return tr(M P) of a Gauss-Newton matrix (eq. next), but for the noise.

    Parameters
    ----------
    M : ndarray of shape (n_params, n_params)
        What counts.
    H : ndarray of shape (n_params, n_params)
        Information.
    basis : ndarray of shape (n_params, n)
        Directions that some experiment tells.
    prior : ndarray of shape (n_params,)
        Diagonal of the information that was there before.

    Returns
    -------
    error : float
        Mean square error.
    """
    small = basis.T @ (H + np.diag(prior)) @ basis
    P = np.linalg.inv(small)
    return float(np.sum((basis.T @ M @ basis) * P))


def told(H):
    """Return the directions of parameters that some experiment tells.

    Parameters
    ----------
    H : ndarray of shape (n_params, n_params)
        Information of all experiments together.

    Returns
    -------
    basis : ndarray of shape (n_params, n)
        Directions, columns scaled to the information of each parameter.
    prior : ndarray of shape (n_params,)
        A little information on every parameter, which keeps sums regular.
    """
    _, Q, size = equilibrated_eigh(H, RANK)
    return Q / size[:, None], LEAST * size**2


def spread(X, u, y):
    """Return samples that lie spread over what all simulations visit.

    Parameters
    ----------
    X, u, y : ndarray of shape (N, nx), (N, nu), (N, ny)
        States, inputs and outputs.

    Returns
    -------
    X, u : ndarray of shape (n, nx), (n, nu)
        Samples at even levels of every output: rare ones count as much as others.
    """
    order = []
    for one in y.T:
        by_size = np.argsort(one)
        levels = np.linspace(one.min(), one.max(), max(2, POINTS // y.shape[1]))
        place = np.searchsorted(one[by_size], levels)
        order.append(by_size[np.minimum(place, len(one) - 1)])
    chosen = np.unique(np.concatenate(order))
    return X[chosen], u[chosen]
