"""FL-SSNN: linear but for what a feedback cancels."""

from typing import Any

from ._networks import Networks
from ._options import estimator, take
from ._ssnn import Ssnn


@estimator
class FlSsnn(Ssnn):
    r"""Exactly feedback-linearizable state-space neural network.

    .. math::

        x_{k+1} = A x_k + B (u_k + h(s_k)), \qquad y_k = C x_k

    h sees s, the state x or the output y. The control law u = v - h(s) leaves exactly
    the linear system (A, B, C) with input v. h has hidden layers of neurons (eq.
    model), and C keeps the value of the linear start.

    Attributes
    ----------
    params_ : Bunch
        All parameters by name (A, B, C, W_h, b_h, W_y, b_y or W_s, b_s, and L
        if a linear part was moved to A, eq. best), in the user's units.

    See Also
    --------
    AlSsnn : The same with a penalized residual g.

    References
    ----------
    .. [1] A. Hache, M. Thieffry, M. Yagoubi and P. Chevrel, "Control-oriented neural
       state-space models for state-feedback linearization and pole placement",
       ICSC 2022, pp. 429-434.

    Examples
    --------
    >>> record = alssnn.datasets.make_pendulum(1000, noise=0.01, random_state=0)
    >>> model = alssnn.FlSsnn(nx=2, n_h=4, n_init=1, dt=record.dt, random_state=0)
    >>> model = model.fit(record.u, record.y)
    >>> bool(model.score(record.u, record.y) > 0.99)
    True
    """

    n_h: Any = take(Networks, "n_h", kw_only=False)
    feedback: str = take(Networks, "feedback")
    h_sees: str = take(Networks, "h_sees")
    gamma_h: Any = take(Networks, "gamma_h")
    linear_part: str = take(Networks, "linear_part")
    input_map: str = take(Networks, "input_map")
    h_inputs: Any = take(Networks, "h_inputs")
    activation: Any = take(Networks, "activation")
    odd: bool = take(Networks, "odd")
