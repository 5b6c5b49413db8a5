"""GR-SSNN: linear but for a residual that is free."""

from typing import Any

from ..descent import SMOOTH
from ._networks import SIZES, Networks
from ._noise import is_predicting
from ._options import estimator, option, take
from ._ssnn import Ssnn


@estimator
class GrSsnn(Ssnn):
    r"""Generalized residual state-space neural network.

    .. math::

        x_{k+1} = A x_k + B u_k + f(x_k, u_k), \qquad y_k = C x_k

    f is free, without a structure for control: often the most accurate of the models.
    It has one hidden layer of tanh neurons and a free output bias (eq. model), and C
    keeps the value of the linear start.

    Parameters
    ----------
    n_f : int or tuple of int, default=15
        Hidden neurons of f; 0 leaves f out.

    Attributes
    ----------
    params_ : Bunch
        All parameters by name (A, B, C, W_g, W_x, W_u, b_x, b_g; the net f is the g
        of the model family), in the user's units.

    See Also
    --------
    AlSsnn : Nonlinear model whose nonlinearity is cancelled by feedback.

    References
    ----------
    .. [1] M. Schoukens, "Improved initialization of state-space artificial neural
       networks", European Control Conference, 2021, pp. 1913-1918.

    Examples
    --------
    >>> record = alssnn.datasets.make_pendulum(1000, noise=0.01, random_state=0)
    >>> model = alssnn.GrSsnn(nx=2, n_f=4, n_init=1, dt=record.dt, random_state=0)
    >>> model = model.fit(record.u, record.y)
    >>> bool(model.score(record.u, record.y) > 0.99)
    True
    """

    n_f: Any = option(15, SIZES, kw_only=False)
    n_k: Any = take(Networks, "n_k")
    feedthrough: bool = take(Networks, "feedthrough")
    g_inputs: Any = take(Networks, "g_inputs")
    activation: Any = take(Networks, "activation")

    def _networks(self):
        return {**super()._networks(), "n_g": self.n_f, "tied_bias": False}

    def _descents(self):
        # a network that nothing penalizes is held by the decay alone
        return super()._descents() if is_predicting(self) else (SMOOTH,)
