"""The linear estimator: N4SID, then refinement."""

from typing import ClassVar

from ..training import train
from ._base import StateSpaceModel


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
    operating_point : {"mean", "zero"} or tuple, default="mean"
        Origin of the deviations; a pair (u_e, y_e) in the units of the data.
    initial_state : {"estimate", "rest"}, default="estimate"
        Initial state of the training experiments: estimated with the parameters, or
        held at `operating_point`, which must be where the records begin.
    dt : float, default=1.0
        Sampling time, in seconds.
    max_iter : int, default=100
        Largest number of trial steps of the refinement.
    tol : float, default=1e-8
        Relative change of cost or parameters that ends the refinement.
    max_time : float or None, default=None
        Seconds after which the fit stops at its next trial step, with the best
        parameters so far; None means no limit.
    feedthrough : bool, default=False
        Whether D is identified; else it is zero.
    input_delay : int, array_like of int of shape (nu,) or "auto", default=0
        Samples by which each input arrives late; "auto" takes the largest delay that
        costs neither prediction nor simulation of a linear model (eq. delay).
    output_weight : array_like of shape (ny,) or None, default=None
        Weight of the squared error of every output, outputs scaled to unit variance.
    linear_start : tuple, control.StateSpace, fitted model or None, default=None
        Linear model to start from instead of N4SID, (A, B, C) or (A, B, C, D) in the
        units of the data. It sets `nx` and the basis of the states.
    bounds : dict of str to tuple or None, default=None
        Bounds ``{"D": (low, high)}`` of entries of D, and with `linear_start` of A, B
        and C, in the units of the data; equal ones hold an entry.
    integrators : int or "auto", default="auto"
        Number of poles held at 1 (eq. integrate): of outputs that are integrals, such
        as positions and levels. No network sees their states. "auto" finds them. The
        mean of u gives way to the input at which they rest.
    n_init_samples : int, default=50
        First samples of an experiment from which `score` estimates its initial
        state, at most a quarter of the experiment.
    verbose : int, default=0
        1 prints a line per stage of the training, 2 every step.

    Attributes
    ----------
    A_, B_, C_, D_ : ndarray
        Matrices in the user's units (deviations).
    x0_ : ndarray of shape (n_experiments, nx)
        Initial states of the training experiments.
    params_ : Bunch
        All parameters by name, in the user's units.
    singular_values_ : ndarray
        Singular values of the subspace step, descending.
    nx_ : int
        Number of states.
    orders_ : dict
        How orders compare: root mean square error on hidden samples by `nx`, outputs of
        unit variance, under "linear" (if `nx` was chosen).
    integrators_ : int
        Number of last states that are integrators.
    input_delay_ : ndarray of int of shape (nu,)
        Samples by which each input arrives late.
    cost_ : float
        Final cost (eq. cost), outputs scaled to unit variance.
    train_score_ : float
        R2 of the simulation of the training record, initial states estimated as in
        `score`; nan if the record stays on a cluster.
    n_iter_ : int
        Trial steps of the training.
    converged_ : bool
        Whether a tolerance was reached.
    message_ : str
        Why the training stopped.
    history_ : list of Step
        Accepted steps of all searches: ``label`` of the stage, ``iteration``,
        ``cost``, ``seconds`` since the fit began, ``validation_rmse``.
    u_offset_, y_offset_ : ndarray
        Operating point, in the units of the data.
    experiments_ : list
        Labels of the training experiments; ``[None]`` without labels.
    output_names_ : list of str or None
        Names of the outputs, if `y` had any.
    n_features_in_ : int
        Number of inputs.
    feature_names_in_ : ndarray of str
        Names of the inputs, if `u` had any.

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

    _parameter_constraints: ClassVar[dict] = {
        **StateSpaceModel._parameter_constraints,
        "feedthrough": ["boolean"],
    }

    def __init__(
        self,
        nx="auto",
        *,
        operating_point="mean",
        initial_state="estimate",
        dt=1.0,
        max_iter=100,
        tol=1e-8,
        max_time=None,
        feedthrough=False,
        input_delay=0,
        output_weight=None,
        linear_start=None,
        bounds=None,
        integrators="auto",
        n_init_samples=50,
        verbose=0,
    ):
        self.nx = nx
        self.operating_point = operating_point
        self.initial_state = initial_state
        self.dt = dt
        self.max_iter = max_iter
        self.tol = tol
        self.max_time = max_time
        self.feedthrough = feedthrough
        self.input_delay = input_delay
        self.output_weight = output_weight
        self.linear_start = linear_start
        self.bounds = bounds
        self.integrators = integrators
        self.n_init_samples = n_init_samples
        self.verbose = verbose

    def _refinement(self):
        """Return the options of the search where it is the whole fit."""
        if self._shapes_linear():
            return {}
        return {"max_iter": self.max_iter, "tol": self.tol}

    def _identify(self, experiments, previous, watch, held_out):
        near = self._near(experiments)
        if not self._shapes_linear() and experiments.is_here:
            return self._linear_model(near, watch).as_fit()
        linear = self._linear_model(near, watch)
        structure, theta, _ = linear.as_fit()
        result = train(
            structure,
            experiments,
            [theta],
            weights={"y": self._output_weight(len(linear.C))},
            bounds=self._scaled_bounds(structure),
            at_rest=self._at_rest,
            max_iter=self.max_iter,
            tol=self.tol,
            watch=watch,
        )
        return structure, result.theta, result
