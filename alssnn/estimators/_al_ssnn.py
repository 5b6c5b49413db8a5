"""AL-SSNN: linear but for a residual that is penalized."""

import numpy as np

from ..descent import ALONE, FADING, RIVALLING
from ._networks import Networks
from ._noise import is_predicting
from ._options import estimator
from ._ssnn import Ssnn


@estimator
class AlSsnn(Networks, Ssnn):
    r"""Approximately feedback-linearizable state-space neural network.

    .. math::

        x_{k+1} = A x_k + B (u_k + h(s_k)) + g(x_k, u_k), \qquad
        y_k = C x_k + D u_k + k(x_k, u_k)

    h sees s, the state x or the output y. The control law u = v - h(s) leaves the
    linear system (A, B, C) with input v, disturbed by g; the cost penalizes with weight
    `gamma` what g adds to the output (eq. penalty). h and g have one hidden layer of
    tanh neurons unless told otherwise (eq. model), g vanishes at the operating point,
    and C keeps the value of the linear start. D and k are zero unless asked for; with
    them a law of the output is ill-posed, one of the state is not.

    The form of the paper [1]_ is ``AlSsnn(feedback="output", penalty="state",
    gamma=1.0, stability=None)``.

    Attributes
    ----------
    params_ : Bunch
        All parameters by name (A, B, C, W_h, b_h, W_y, b_y or W_s, b_s, W_g, W_x,
        W_u, b_x, and L if a linear part was moved to A, eq. best), in the user's
        units.

    See Also
    --------
    FlSsnn : The same without g, exactly linearizable.
    GrSsnn : The same without h and with g free, often more accurate.

    Notes
    -----
    One trial step costs one simulation, one accepted step a pass over the
    sensitivities: about 15 microseconds per sample for nx=6, n_h=n_g=10.

    References
    ----------
    .. [1] M. Thieffry, A. Hache, M. Yagoubi and P. Chevrel, "Identification for
       control based on neural networks: approximately linearizable models".

    Examples
    --------
    >>> record = alssnn.datasets.make_pendulum(500, noise=0.01, random_state=0)
    >>> sizes = {"nx": 2, "n_h": 4, "n_g": 2, "n_init": 1}
    >>> model = alssnn.AlSsnn(**sizes, dt=record.dt, random_state=0)
    >>> model = model.fit(record.u, record.y)
    >>> bool(model.score(record.u, record.y) > 0.99)
    True
    """

    def _descents(self):
        if is_predicting(self):
            return super()._descents()
        return (RIVALLING, FADING) if np.any(self.n_g) else (ALONE,)
