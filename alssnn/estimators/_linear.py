"""The linear estimator: N4SID, then refinement."""

from ._base import StateSpaceModel
from ._horizon import trained
from ._networks import Networks
from ._options import estimator, take


@estimator
class LinearStateSpace(StateSpaceModel):
    r"""Linear state-space model by N4SID and simulation-error refinement.

    .. math:: x_{k+1} = A x_k + B u_k, \qquad y_k = C x_k + D u_k

    The subspace estimate (N4SID, stabilized) starts a Levenberg-Marquardt search for
    the matrices and initial states of least free-run simulation error, the role of
    `ssest` after `n4sid`.

    Parameters
    ----------
    nx : int, "auto" or array_like of int, default="auto"
        Number of states. "auto" compares linear models of order 1, 2, ... on hidden
        samples until three larger orders bring no gain; a range or a list compares the
        orders that it names (eq. holdout). See `orders_`.
    max_iter : int, default=100
        Largest number of trial steps of the refinement.
    tol : float, default=1e-8
        Relative change of cost or parameters that ends the refinement.
    feedthrough : bool, default=False
        Whether D is identified; else it is zero.
    bounds : dict of str to tuple or None, default=None
        Bounds ``{"D": (low, high)}`` of entries of D and H, and with `linear_start` of
        A, B, C and G, in the units of the data; equal ones hold an entry.

    Attributes
    ----------
    A_, B_, C_, D_ : ndarray
        Matrices in the user's units (deviations); A and B per second in continuous
        time.
    params_ : Bunch
        All parameters by name, in the user's units.
    orders_ : dict
        How orders compare: root mean square error on hidden samples by `nx`, outputs of
        unit variance, under "linear" (if `nx` was chosen).
    n_iter_ : int
        Trial steps of the training.
    converged_ : bool
        Whether the training ended by itself, and not by a limit of steps or time.

    See Also
    --------
    AlSsnn : Nonlinear model whose nonlinearity is cancelled by feedback.

    References
    ----------
    .. [1] P. Van Overschee and B. De Moor, "N4SID: Subspace algorithms for the
       identification of combined deterministic-stochastic systems", Automatica
       30(1), 1994.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> u = rng.standard_normal((200, 1))
    >>> y = np.zeros(200)
    >>> for k in range(199):
    ...     y[k + 1] = 0.8 * y[k] + 0.5 * u[k, 0]
    >>> model = alssnn.LinearStateSpace(nx=1, operating_point="zero").fit(u, y)
    >>> round(float(model.A_[0, 0]), 6)
    0.8
    """

    feedthrough: bool = take(Networks, "feedthrough")

    def _refinement(self):
        """Return the options of the search where it is the whole fit."""
        if self._shapes_linear():
            return {}
        return {"max_iter": self.max_iter, "tol": self.tol}

    def _identify(self, experiments, previous, watch, held_out):
        near = self._near(experiments)
        if not self._shapes_linear() and experiments.is_here:
            return self._linear_start(near, watch).as_fit(self.disturbances_)
        linear = self._linear_start(near, watch)
        structure, theta, _ = linear.as_fit(self.disturbances_)
        radius = linear.radius if self.horizon > 1 else None
        result = trained(
            self,
            structure,
            experiments,
            [theta],
            weights={"y": self._output_weight(len(linear.C))},
            watch=watch,
            **self._training(structure) | {"radius": radius},
        )
        return structure, result.theta, result
