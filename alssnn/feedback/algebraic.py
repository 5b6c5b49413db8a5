"""Loops around a plant with direct feedthrough: u of a sample depends on its own y.

For given states of all blocks and given r, one way around the loop

    u -> plant -> y -> observer -> x_hat -> controller -> v -> law -> F(u)

ends where it began: u = F(u).  Where nothing behind y acts on u at once, F is constant
and one way around is enough; else Newton's method solves for u, from the operating
point.  The loop is well-posed if I - F' is regular.  Interconnections of python-control
go round a fixed number of times instead, which is one too few even for a constant F.
"""

import control
import numpy as np

SOLVED = 1e-11  # |u - F(u)|, in standard deviations of u
ROUNDING = 1e-7  # the same where it stalls: large offsets and gains leave no digits
MAX_ITER = 50
STEP = 1e-4  # of finite differences, in standard deviations: F may be the user's
REGULAR = 1e-7  # smallest singular value, relative, of I - F'
HALVINGS = 12  # of a step of Newton's method that makes |u - F(u)| no smaller
N_PROBES = 4  # states at which a plant is asked for feedthrough


def feeds_through(plant, u, u_scale):
    """Return whether the output of a system depends on the input of the same sample.

    Parameters
    ----------
    plant : control.NonlinearIOSystem
        The system.
    u : ndarray of shape (nu,)
        Operating point of the inputs.
    u_scale : ndarray of shape (nu,)
        Size of the inputs.

    Returns
    -------
    depends : bool
        Exact for linear systems; others are asked at a few states and inputs.
    """
    if isinstance(plant, control.StateSpace):
        return bool(np.any(plant.D))
    rng = np.random.default_rng(0)
    states = [np.zeros(plant.nstates), *rng.standard_normal((N_PROBES, plant.nstates))]
    with np.errstate(all="ignore"):
        return not all(
            np.array_equal(
                plant.output(0.0, x, u), plant.output(0.0, x, other), equal_nan=True
            )
            for x in states
            for other in u + np.vstack([np.diag(u_scale), -np.diag(u_scale)])
        )


class AlgebraicLoop:
    """Connect blocks by the names of their signals, and solve for u at every sample.

    Parameters
    ----------
    blocks : list of control.NonlinearIOSystem
        Plant, observer (if there is one), controller and law, such that every block
        needs only u, r and the outputs of those before it. What else it has among its
        inputs must not act on its output at once.
    r, u : list of str
        Names of what comes from outside, references first, and of the inputs of the
        plant that the loop moves.
    shown : list of str
        Names of the outputs of the loop.
    u_start, u_scale : ndarray of shape (nu,)
        Operating point of u, from which the solution starts, and its size.
    """

    def __init__(self, blocks, r, u, shown, u_start, u_scale):
        self.blocks, self.r, self.u, self.shown = blocks, r, u, shown
        self.u_start, self.u_scale = u_start, u_scale
        self._ends = np.cumsum([block.nstates for block in blocks])[:-1]

    def check(self, r):
        """Refuse a loop that is not well-posed at rest.

        Parameters
        ----------
        r : ndarray of shape (nr,)
            References at rest.

        Raises
        ------
        ValueError
            If u = F(u) does not determine u there.
        """
        x = np.zeros(sum(block.nstates for block in self.blocks))
        with np.errstate(all="ignore"):
            slope = self._slope(0.0, x, r, self.u_start)
        if np.isfinite(slope).all():
            values = np.linalg.svd(slope, compute_uv=False)
            if values[-1] < REGULAR * max(values[0], 1.0):
                raise ValueError(_ILL_POSED.format("u - F(u) does not move with u"))

    def signals(self, t, x, r):
        """Return all signals of a sample.

        Parameters
        ----------
        t : float
            Time, in seconds.
        x : ndarray of shape (n_states,)
            States of all blocks.
        r : ndarray of shape (nr,)
            References.

        Returns
        -------
        signals : dict of str to float
            Signals by name.

        Raises
        ------
        ValueError
            If there is no solution u = F(u) within reach.
        """
        u = self.u_start
        signals, error = self._around(t, x, r, u)
        for _ in range(MAX_ITER):
            # "not >": a loop that diverges is no algebraic matter
            if not _size(error) > SOLVED * (1 + _size(u / self.u_scale)):
                return signals
            following = u - self.u_scale * error  # F(u): the solution of a constant F
            signals, last = self._around(t, x, r, following)
            if not _size(last) > SOLVED * (1 + _size(following / self.u_scale)):
                return signals
            slope = self._slope(t, x, r, u)
            if not np.isfinite(slope).all():
                return signals
            step = self.u_scale * np.linalg.lstsq(slope, error)[0]
            for share in 0.5 ** np.arange(HALVINGS):  # limits make F bend
                signals, last = self._around(t, x, r, u - share * step)
                if _size(last) < _size(error):
                    break
            else:
                if _size(error) < ROUNDING * (1 + _size(u / self.u_scale)):
                    return self._around(t, x, r, u)[0]
            u, error = u - share * step, last
        if _size(error) < ROUNDING * (1 + _size(u / self.u_scale)):
            return signals
        raise ValueError(_ILL_POSED.format(f"no solution in {MAX_ITER} iterations"))

    def update(self, t, x, r, params):
        """Return the next states, for python-control.

        Parameters
        ----------
        t : float
            Time, in seconds.
        x : ndarray of shape (n_states,)
            States of all blocks.
        r : ndarray of shape (nr,)
            References.
        params : dict
            Not used.

        Returns
        -------
        x_next : ndarray of shape (n_states,)
            States one sample later.
        """
        signals, states = self.signals(t, x, r), np.split(x, self._ends)
        return np.concatenate(
            [
                block.dynamics(t, state, [signals[name] for name in block.input_labels])
                for block, state in zip(self.blocks, states, strict=True)
                if block.nstates
            ]
        )

    def output(self, t, x, r, params):
        """Return the outputs, for python-control.

        Parameters
        ----------
        t : float
            Time, in seconds.
        x : ndarray of shape (n_states,)
            States of all blocks.
        r : ndarray of shape (nr,)
            References.
        params : dict
            Not used.

        Returns
        -------
        outputs : ndarray of shape (n_outputs,)
            Signals that are shown.
        """
        signals = self.signals(t, x, r)
        return np.array([signals[name] for name in self.shown])

    def _around(self, t, x, r, u):
        """Return the signals of one way around, and the scaled error u - F(u)."""
        signals = dict(zip(self.r, r, strict=True)) | dict(zip(self.u, u, strict=True))
        for block, state in zip(self.blocks, np.split(x, self._ends), strict=True):
            inputs = [signals.get(name, 0.0) for name in block.input_labels]
            values = np.ravel(block.output(t, state, inputs))
            signals |= dict(zip(block.output_labels, values, strict=True))
        around = np.array([signals[name] for name in self.u])
        return signals, (u - around) / self.u_scale

    def _slope(self, t, x, r, u):
        """Return I - F', scaled, by central differences."""
        columns = []
        for step in STEP * np.diag(self.u_scale):
            ahead, behind = (self._around(t, x, r, u + s)[1] for s in (step, -step))
            columns.append((ahead - behind) / (2 * STEP))
        return np.transpose(columns)


def _size(vector):
    return np.abs(vector).max()


_ILL_POSED = (
    "`plant` must make a well-posed loop, got an algebraic loop of its feedthrough and "
    "what acts on u at once: {}. Let the plant be strictly proper, or the controller: "
    "add a delay of one sample."
)
