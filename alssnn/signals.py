"""Signals of a plant: their units, names, places and noise, and who moves them.

Inputs u are those of a record, in its order.  A controller moves some of them, which
are as many as the virtual inputs v; the others are measured disturbances d, inputs that
it sees and cannot move (eq. disturbance).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .inputs import join_inputs, split_inputs
from .shown import short_repr


@dataclass(frozen=True, eq=False, kw_only=True)
class Signals:
    """Hold what others must know of the signals of a plant, in the user's units.

    Parameters
    ----------
    u_offset : ndarray of shape (nu,)
        Operating point of the inputs, in the units of u.
    y_offset : ndarray of shape (ny,)
        Operating point of the outputs, in the units of y.
    u_scale, y_scale, x_scale : ndarray
        Standard deviations of the training data, and of the states at the start of
        the training.
    dt : float
        Sampling time, in seconds.
    inputs, outputs : list of str
        Names of the signals.
    name : str
        Name of the model.
    delay : ndarray of int of shape (nu,)
        Samples by which every input arrives late; zero where its past is a state.
    n_late : int, default=0
        Number of last states that are past inputs.
    given : tuple of int, default=()
        Inputs that are measured disturbances: nobody moves them.
    K : ndarray of shape (nx, ny) or None, default=None
        What measured outputs do to the next state at the operating point, in the
        user's units: the gain of innovations (eq. innovations), and h where it sees
        what was measured. None where no gain was identified.
    drift : {"output", "input"} or None, default=None
        What an identified random walk is added to (eq. drift); None without one.
    K_b : ndarray of shape (nb, ny) or None, default=None
        Gain of the innovations on that walk, in the units of y or u over those of y.
    noise : float, default=0.0
        Mean squared error of the fit over the variance of y.
    noise_covariance : ndarray of shape (ny, ny) or None, default=None
        Covariance of what the fit left of y, one sample ahead with K.
    hidden_error : float or None, default=None
        Root mean square error of the fits that chose the model, on samples hidden from
        them, outputs of unit variance (eq. holdout); None if nothing was hidden.
    """

    __repr__ = short_repr

    u_offset: np.ndarray
    y_offset: np.ndarray
    u_scale: np.ndarray
    y_scale: np.ndarray
    x_scale: np.ndarray
    dt: float
    inputs: list
    outputs: list
    name: str
    delay: np.ndarray
    n_late: int = 0
    given: tuple = ()
    K: np.ndarray | None = None
    drift: str | None = None
    K_b: np.ndarray | None = None
    noise: float = 0.0
    noise_covariance: np.ndarray | None = None
    hidden_error: float | None = None

    def gain_with(self, kind):
        """Return the identified gain of an observer that estimates a disturbance.

        Parameters
        ----------
        kind : {"output", "input"}
            What the disturbance is added to.

        Returns
        -------
        K : ndarray of shape (nx + nb, ny) or None
            Gains of the states and of a random walk (eq. drift); None where no walk of
            this kind was identified, or one of inputs that arrive late.
        """
        if self.K is None or self.K_b is None or kind != self.drift:
            return None
        if kind == "input" and self.n_late:
            return None
        return np.vstack([self.K, self.K_b])

    @property
    def nu(self):
        """Return the number of inputs, measured disturbances among them."""
        return len(self.u_offset)

    @property
    def ny(self):
        """Return the number of outputs."""
        return len(self.y_offset)

    @cached_property
    def moved(self):
        """Return the inputs that a controller moves, as an array of numbers."""
        return split_inputs(self.nu, self.given)[0]

    @property
    def nv(self):
        """Return the number of virtual inputs, one for every input that is moved."""
        return len(self.moved)

    @property
    def nd(self):
        """Return the number of measured disturbances."""
        return len(self.given)

    @property
    def v_offset(self):
        """Return the operating point of the inputs that are moved, shape (nv,)."""
        return self.u_offset[self.moved]

    @property
    def v_scale(self):
        """Return the standard deviations of the inputs that are moved, shape (nv,)."""
        return self.u_scale[self.moved]

    @property
    def d_offset(self):
        """Return the operating point of the measured disturbances, shape (nd,)."""
        return self.u_offset[list(self.given)]

    def every_input(self, m, d=None):
        """Return all inputs, of those that are moved and those that are given.

        Parameters
        ----------
        m : ndarray of shape (nv,) or (N, nv)
            Inputs that are moved, or v in their place.
        d : ndarray of shape (nd,) or (N, nd) or None, default=None
            Measured disturbances, in the same units; needed if there are any.

        Returns
        -------
        u : ndarray of shape (nu,) or (N, nu)
            Inputs in the order of a record.

        Raises
        ------
        ValueError
            If disturbances are missing, or given where there are none.
        """
        d = self.check_disturbances(d)
        return join_inputs(m, d, self.given) if self.given else m

    def check_disturbances(self, d):
        """Return measured disturbances, or refuse that they are missing.

        Parameters
        ----------
        d : ndarray of shape (nd,) or (N, nd) or None
            Measured disturbances, in the user's units.

        Returns
        -------
        d : ndarray of shape (nd,) or (N, nd)
            The same; empty for a plant that has none.

        Raises
        ------
        ValueError
            If they are missing, or others than those of the plant.
        """
        n = 0 if d is None else d.shape[-1]
        if n != self.nd:
            names = ", ".join(self.inputs[i] for i in self.given) or "none"
            raise ValueError(
                f"`d` must have the {self.nd} measured disturbances of this plant "
                f"({names}), got {n}. The law feeds them forward."
            )
        return np.empty(0) if d is None else d
