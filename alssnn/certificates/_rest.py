"""A loop as deviations from rest, and from its linear design (eq. distance).

Neurons enter as sectors: a neuron that differs from its value at rest by dw, where what
it sees differs by dnu, has dw = theta dnu with theta between the least and the largest
chord over the region.  Neurons of plant and observer with the same weights enter as
their difference, whose theta is a slope.  An error of the model is a neuron, too: the
measured output differs from that of the model by Delta(u), of which only the gain is
known.  Both make a form for the inequality of the gain (eq. slopes), whose signals are
then deviations in place of differences of two trajectories.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky

from ..forms import part
from ..lure import Lure
from ..simulation import simulate
from ._neurons import differences, seen_at
from ._whole import WholeLoop

LONG = 5_000  # samples after which a loop without inputs should rest
STILL = 1e-10  # of the largest state: what moves so little rests
SAME = 1e-7  # relative: what is recomputed, perhaps on another machine
ALIKE = 1e-9  # what neurons of one weight may see apart, relative


def at_rest(loop, extent=0.0):
    """Return what the neurons of a loop see where it rests without inputs.

    Parameters
    ----------
    loop : WholeLoop
        The loop.
    extent : float or ndarray of shape (nx,), default=0.0
        Sizes of the states, against which rounding is no motion.

    Returns
    -------
    seen : ndarray of shape (nw,)
        Inputs of the neurons; of those with twins the difference.
    x : ndarray of shape (nx,)
        The state; nan if it still moves after some thousand samples.
    """
    lure, still = loop.lure, np.zeros((LONG, loop.lure.nu))
    with np.errstate(all="ignore"):  # a loop may diverge
        X = simulate(lure, still, np.zeros(lure.nx), np.inf)
        width = np.abs(X).max(axis=0) + extent
        rests = np.all(np.abs(X[-1] - X[-2]) <= STILL * width)
        x = X[-1] if rests else np.full(lure.nx, np.nan)
        return seen_at(lure, x, loop.twins), x


def from_rest(loop, n_free):
    """Return the loop as deviations from rest, from its first inputs to y.

    Parameters
    ----------
    loop : WholeLoop
        The loop.
    n_free : int
        Inputs that are free; the others are zero.

    Returns
    -------
    form : Lure
        Form with the neurons of ``loop.lure``, as differences where they have twins.
    """
    lure, ny = differences(loop.lure, loop.twins), len(loop.design[2])
    return part(lure, np.arange(lure.nw), ny, n_free)


def from_design(loop, n_free, error=None):
    """Return the loop as deviations from its design, from its first inputs to y - y_d.

    Parameters
    ----------
    loop : WholeLoop
        The loop; its channels are [y; u], and what corrects the estimate.
    n_free : int
        Inputs that are free; the others are zero, or made by the error of the model.
    error : ndarray of shape (ny, nv) or None, default=None
        Gain from every u to what the plant adds to every output of the model, which
        the sensors then see; None means none.

    Returns
    -------
    form : Lure
        Form with the states [X - X_d; X_d], and neurons of the error at the end.
    """
    lure, (A, B, C, D) = differences(loop.lure, loop.twins), loop.design
    nx, nu, nw, ny = lure.nx, lure.nu, lure.nw, len(C)
    added = np.zeros((0, 2)) if error is None else np.argwhere(error > 0)
    X, Z, seen = np.split(lure.Theta, [nx, nx + lure.nz])
    noise, u = nx + nu - ny, Z[ny:]
    rows = np.vstack([X, Z[:ny], seen, *(u[[j]] for _, j in added)])
    # what the plant adds comes where the noise of a sensor does, and counts in y
    by_error = rows[:, [noise + i for i, _ in added]].reshape(len(rows), -1)
    for k, (i, _) in enumerate(added):
        by_error[nx + i, k] += 1.0
    at_x, at_r, at_w, one = np.split(rows, [nx, nx + nu, nx + nu + nw], axis=1)
    Theta = np.hstack([at_x, at_x, at_r[:, :n_free], at_w, by_error, one])
    design = np.zeros((nx + ny, Theta.shape[1]))
    design[:, nx : 2 * nx] = np.vstack([A, C])
    design[:, 2 * nx : 2 * nx + n_free] = np.vstack([B, D])[:, :n_free]
    Theta[: nx + ny] -= design
    Theta = np.insert(Theta, [nx] * nx, design[:nx], axis=0)
    sigma = lure.sigma + lure.sigma[:1] * len(added)  # only their slopes count
    return Lure(Theta, 2 * nx, n_free, nw + len(added), sigma)


def corrections(loop):
    """Return what corrects the estimate, as weights of deviations and of neurons.

    Parameters
    ----------
    loop : WholeLoop
        The loop, with an observer.

    Returns
    -------
    rows : ndarray of shape (ny, nx + nw)
        Weights of dX and dw.
    """
    lure, ny = differences(loop.lure, loop.twins), len(loop.design[2])
    rows = lure.rows_z[-ny:]
    return np.hstack([rows[:, : lure.nx], rows[:, lure.nx + lure.nu : -1]])


def with_error(sectors, error):
    """Return the sectors of all neurons of `from_design`.

    Parameters
    ----------
    sectors : ndarray of shape (2, nw)
        Those of the loop.
    error : ndarray of shape (ny, nv) or None
        See `from_design`.

    Returns
    -------
    sectors : ndarray of shape (2, nw + n_added)
        With those of the error behind them.
    """
    size = np.zeros(0) if error is None else error[error > 0]
    return np.hstack([sectors, [-size, size]])


def level_of(form, P, sectors, reach, watched=None, gate=None):
    """Return the level of V = dX'P dX up to which the sectors hold (eq. basin).

    Parameters
    ----------
    form : Lure
        The loop as deviations from rest.
    P : ndarray of shape (nx, nx)
        Lyapunov matrix.
    sectors : ndarray of shape (2, nw)
        Least and largest chord of every neuron.
    reach : ndarray of shape (nw,)
        How far from rest the input of every neuron may be; inf where nothing limits it.
    watched : ndarray of shape (k, nx + nw) or None, default=None
        Further signals, as weights of dX and dw.
    gate : ndarray of shape (k,) or None, default=None
        Largest moduli that these may have.

    Returns
    -------
    level : float
        The level; inf if nothing limits it, 0 if no level is proved.
    """
    nx, nw = form.nx, form.nw
    middle, half = sectors.mean(axis=0), np.ptp(sectors, axis=0) / 2
    # dnu = V dX + E rho, with dw = middle dnu + rho and |rho| <= half |dnu|
    rows = np.linalg.solve(
        np.eye(nw) - form.E * middle, np.hstack([form.V[:, :nx], form.E])
    )
    root = np.linalg.inv(cholesky(P))  # |V dX| <= |V root| sqrt(level)
    couple = np.abs(rows[:, nx:]) * half
    if nw and np.abs(np.linalg.eigvals(couple)).max() >= 1:
        return 0.0
    per_root = np.linalg.norm(rows[:, :nx] @ root, axis=1)
    per_root = np.linalg.solve(np.eye(nw) - couple, per_root)
    limits = [reach / np.maximum(per_root, np.finfo(float).tiny)]
    if watched is not None:
        by_x, by_w = watched[:, :nx], watched[:, nx:]
        both = (by_w * middle) @ rows
        size = np.linalg.norm((by_x + both[:, :nx]) @ root, axis=1)
        size += (np.abs(both[:, nx:] + by_w) * half) @ per_root
        limits.append(gate / np.maximum(size, np.finfo(float).tiny))
    return float(np.min(np.concatenate(limits), initial=np.inf)) ** 2


@dataclass(frozen=True, eq=False)
class LoopProof:
    """Hold what the inequalities of a loop are made of.

    Parameters
    ----------
    loop : WholeLoop
        The loop.
    sectors : ndarray of shape (2, nw)
        Least and largest chord of every neuron over the region.
    reach : ndarray of shape (nw,)
        How far from rest they hold.
    n_free : int
        Inputs that are references or measured disturbances.
    gate : ndarray of shape (ny,) or None
        Largest correction of the estimate, of an observer that has a gate.
    n_plant : int
        States of the plant.
    x_rest : ndarray of shape (nX,)
        Where the loop rests without inputs.
    """

    loop: WholeLoop
    sectors: np.ndarray
    reach: np.ndarray
    n_free: int
    gate: np.ndarray | None
    n_plant: int
    x_rest: np.ndarray

    @classmethod
    def of(cls, loop, local, controller):
        """Return the proof of a loop over the region of a local certificate.

        Parameters
        ----------
        loop : WholeLoop
            The loop.
        local : LocalCertificate
            Certificate that holds.
        controller : LinearizingController
            Controller of the loop.

        Returns
        -------
        proof : LoopProof or str
            The proof, or why there is none.
        """
        own = controller.own
        rest, x = at_rest(loop, local.x_high - local.x_low)
        if np.isnan(x).any():
            return "Without inputs the loop does not come to rest."
        paired = loop.twins >= 0
        others = np.abs(rest[loop.twins[paired]])
        if np.any(np.abs(rest[paired]) > ALIKE * (1 + others)):
            return "Without inputs the loop rests at a limit of an actuator."
        sectors, reach = local.proof.sectors(loop.lure.sigma, rest)
        gate = None
        if loop.watches:
            gate = getattr(controller.observer, "largest_innovation", None)
        nr = own.ny if controller.tracks else own.nv
        return cls(loop, sectors, reach, nr + own.nd, gate, own.nx, x)

    def is_of(self, local):
        """Return whether the sectors are those of a region.

        Parameters
        ----------
        local : LocalCertificate
            Certificate of the region.

        Returns
        -------
        is_of : bool
            Whether they follow from it.
        """
        extent = local.x_high - local.x_low
        rest, x = at_rest(self.loop, extent)
        sectors, reach = local.proof.sectors(self.loop.lure.sigma, rest)
        # the last digits are those of a machine
        return (
            bool(np.all(np.abs(x - self.x_rest) <= SAME * (np.abs(x) + extent)))
            and np.allclose(sectors, self.sectors, rtol=SAME, atol=SAME)
            and np.allclose(reach, self.reach, rtol=SAME, atol=SAME)
        )

    def distance(self, error=None):
        """Return the form from references to y - y_design, and its sectors.

        Parameters
        ----------
        error : ndarray of shape (ny, nv) or None, default=None
            Error of the model.

        Returns
        -------
        form : Lure
            The form.
        sectors : ndarray
            Sectors of its neurons.
        """
        form = from_design(self.loop, self.n_free, error)
        return form, with_error(self.sectors, error)

    def deviations(self):
        """Return the form of the deviations from rest, and its sectors.

        Returns
        -------
        form : Lure
            The form.
        sectors : ndarray
            Sectors of its neurons.
        """
        return from_rest(self.loop, self.n_free), self.sectors

    def basin(self, P):
        """Return the ellipsoid of states of the plant from which the loop rests.

        Parameters
        ----------
        P : ndarray of shape (nX, nX)
            Lyapunov matrix of the loop.

        Returns
        -------
        basin : ndarray of shape (nx, nx)
            See `LoopCertificate`.
        """
        form, n = self.deviations()[0], self.n_plant
        watched = None if self.gate is None else corrections(self.loop)
        level = level_of(form, P, self.sectors, self.reach, watched, self.gate)
        if level <= 0:
            return np.full((n, n), np.nan)
        start = np.zeros((form.nx, n))
        start[:n] = np.eye(n)
        if self.loop.watches:
            start[n : 2 * n] = np.eye(n)
        return start.T @ P @ start / level
