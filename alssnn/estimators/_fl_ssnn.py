"""FL-SSNN: linear but for what a feedback cancels."""

from typing import ClassVar

from ._base import WEIGHT
from ._ssnn import ACTIVATION, FEEDBACK, H_INPUTS, SIZES, Ssnn


class FlSsnn(Ssnn):
    r"""Exactly feedback-linearizable state-space neural network.

    .. math::

        x_{k+1} = A x_k + B (u_k + h(s_k)), \qquad y_k = C x_k

    h sees s, the state x or the output y. The control law u = v - h(s) leaves exactly
    the linear system (A, B, C) with input v. h has hidden layers of neurons (eq.
    model), and C keeps the value of the linear start.

    Parameters
    ----------
    nx : int, "auto" or array_like of int, default="auto"
        Number of states. "auto" compares linear models of order 1, 2, ... on hidden
        samples until three larger orders bring no gain; a range or a list compares the
        orders that it names (eq. holdout). With ``alpha="auto"`` networks then choose
        among the same orders, with "auto" up to one more than the best linear one. See
        `orders_`.
    n_h : int or tuple of int, default=10
        Hidden neurons of h, by layer; 0 leaves h out.
    feedback : {"output", "state"}, default="state"
        What h sees: the state x (needs an observer in the loop), or the output y.
    gamma_h : float, default=0.0
        Weight of the mean of ``|h|^2``, with inputs scaled to unit variance: a small
        one makes A the best linear fit and h only what is left of it (eq. split). With
        0 the training leaves that split to chance. Strongly nonlinear plants want 1e-4,
        mildly nonlinear ones more.
    h_inputs : array_like of int or str, or None, default=None
        Which outputs h sees, by number from 0 or by name, or with `feedback="state"`
        which states, by number, of a `linear_start`; None means all. Its weights for
        the others are held at zero.
    activation : str, Activation or dict, default="tanh"
        "tanh", "sigmoid", "relu", "identity", "sin" or an `Activation` of one's own,
        for all networks or by network, ``{"h": ...}``.
    odd : bool, default=False
        Whether h has no biases, so that h(-s) = -h(s).
    stability : {"auto", "contractive", "schur"} or None, default="auto"
        "contractive" keeps ``A'A <= (1 - phi) I`` throughout (eq. contract): networks
        of tanh or sigmoid then have bounded simulations for every bounded input, as
        with "schur", which keeps the poles of A inside the same circle, in whatever
        basis. None leaves A free. "auto" is "contractive" unless there is a
        `linear_start`, whose basis of the states it would change.
    phi : float, default=1e-5
        Rate of decay if A is a contraction, per sample: ``|x|^2`` of the linear part
        falls by at least the share phi in every step; with "schur" poles have at most
        the modulus ``sqrt(1 - phi)``.
    alpha : float or "auto", default="auto"
        Weight of the squared network parameters (eq. cost). "auto" chooses it, and with
        it the random start, by the simulation error on hidden quarters of the record
        (eq. holdout). It pulls the networks back to their start, so that a large weight
        leaves the linear model; if no networks beat that model on the hidden quarters,
        the fit returns it, with a ConvergenceWarning. A number is used as it is, pulls
        towards zero, and hides no samples.
    input_delay : int, array_like of int of shape (nu,) or "auto", default=0
        Samples by which each input arrives late; "auto" takes the largest delay that
        costs neither prediction nor simulation of a linear model (eq. delay).
    output_weight : array_like of shape (ny,) or None, default=None
        Weight of the squared error of every output, outputs scaled to unit variance.
    linear_start : tuple, control.StateSpace, fitted model or None, default=None
        Linear model to start from instead of N4SID, (A, B, C) or (A, B, C, D) in the
        units of the data. It sets `nx` and the basis of the states.
    bounds : dict of str to tuple or None, default=None
        Bounds ``{"D": (low, high)}`` of entries of D, and with `linear_start` of A and
        B, in the units of the data; equal ones hold an entry.
    integrators : int or "auto", default="auto"
        Number of poles held at 1 (eq. integrate): of outputs that are integrals, such
        as positions and levels. No network sees their states. "auto" finds them. The
        mean of u gives way to the input at which they rest.
    operating_point : {"mean", "zero"} or tuple, default="mean"
        Origin of the deviations; a pair (u_e, y_e) in the units of the data.
    initial_state : {"estimate", "rest"}, default="estimate"
        Initial state of the training experiments: estimated with the parameters, or
        held at `operating_point`, which must be where the records begin.
    dt : float, default=1.0
        Sampling time, in seconds.
    n_init : int, default=3
        Number of random starts. With ``alpha="auto"`` the best on hidden samples goes
        on, with a number the one of least cost on the coarse stage.
    max_iter : int, default=300
        Largest number of trial steps of the coarse stage, or of the only one. A stage
        of the search of ``alpha="auto"``, one alpha of one start, takes a 25th of it.
    tol : float, default=1e-4
        Relative change of cost or parameters that ends a stage.
    max_time : float or None, default=None
        Seconds after which the fit stops at its next trial step, with the best
        parameters so far; None means no limit.
    validation_fraction : float or None, default=None
        Share of every experiment, its end, that is not fitted but judges the
        training, see `validation` of `fit`; None fits everything.
    n_iter_no_change : int, default=10
        Accepted steps without a new least validation error after which a stage ends.
    coarse_samples : int or None, default=8000
        On longer records the search and the first stages of the training take so many
        samples, the liveliest stretch; None takes all samples at once.
    polish_iter : int, default=15
        Largest number of trial steps on all samples after the coarse stages, of which
        a long record has a second one, on three times the samples.
    method : {"lm", "trf"}, default="lm"
        Method of `scipy.optimize.least_squares`.
    n_init_samples : int, default=50
        First samples of an experiment from which `score` estimates its initial
        state, at most a quarter of the experiment.
    warm_start : bool, default=False
        Whether a repeated `fit` continues from the last parameters and scaling, if
        they still fit the signals and the other options.
    n_jobs : int or None, default=None
        Random starts trained in parallel, or experiments in threads if there is one
        start, as in joblib. The result does not depend on it.
    random_state : int, RandomState instance or None, default=None
        Source of the initial inner weights.
    verbose : int, default=0
        1 prints a line per stage of the training, 2 every step.

    Attributes
    ----------
    A_, B_, C_, D_ : ndarray
        Linear part in the user's units (deviations).
    x0_ : ndarray of shape (n_experiments, nx)
        Initial states of the training experiments.
    params_ : Bunch
        All parameters by name (A, B, C, W_h, b_h, W_y, b_y or W_s, b_s), in the
        user's units.
    singular_values_ : ndarray
        Singular values of the subspace step, descending.
    nx_ : int
        Number of states.
    orders_ : dict
        How orders compare: root mean square error on hidden samples by `nx`, outputs of
        unit variance, under "linear" (if `nx` was chosen) and, with ``alpha="auto"``,
        "networks".
    alpha_ : float
        Weight of the squared network parameters that was given or found; inf if
        networks do not help and the linear model was returned.
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
        Trial steps of the training, linear start excluded.
    converged_ : bool
        Whether the training ended by itself: a tolerance was reached, validation or
        the number of steps that hidden samples allow ended the last stage, or the
        linear model was returned. It does not say that the cost has settled.
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
    AlSsnn : The same with a penalized residual g.

    References
    ----------
    .. [1] A. Hache, M. Thieffry, M. Yagoubi and P. Chevrel, "Control-oriented neural
       state-space models for state-feedback linearization and pole placement",
       ICSC 2022, pp. 429-434.

    Examples
    --------
    >>> record = alssnn.datasets.make_pendulum(1000, noise=0.01, random_state=0)
    >>> model = alssnn.FlSsnn(nx=2, n_h=4, n_init=1, random_state=0)
    >>> model = model.fit(record.u, record.y)
    >>> bool(model.score(record.u, record.y) > 0.99)
    True
    """

    _parameter_constraints: ClassVar[dict] = {
        **Ssnn._parameter_constraints,
        "n_h": SIZES,
        "feedback": [FEEDBACK],
        "gamma_h": [WEIGHT],
        "h_inputs": H_INPUTS,
        "activation": ACTIVATION,
        "odd": ["boolean"],
    }

    def __init__(
        self,
        nx="auto",
        n_h=10,
        *,
        feedback="state",
        gamma_h=0.0,
        h_inputs=None,
        activation="tanh",
        odd=False,
        stability="auto",
        phi=1e-5,
        alpha="auto",
        input_delay=0,
        output_weight=None,
        linear_start=None,
        bounds=None,
        integrators="auto",
        operating_point="mean",
        initial_state="estimate",
        dt=1.0,
        n_init=3,
        max_iter=300,
        tol=1e-4,
        max_time=None,
        validation_fraction=None,
        n_iter_no_change=10,
        coarse_samples=8_000,
        polish_iter=15,
        method="lm",
        n_init_samples=50,
        warm_start=False,
        n_jobs=None,
        random_state=None,
        verbose=0,
    ):
        self.nx = nx
        self.n_h = n_h
        self.feedback = feedback
        self.gamma_h = gamma_h
        self.h_inputs = h_inputs
        self.activation = activation
        self.odd = odd
        self.stability = stability
        self.phi = phi
        self.alpha = alpha
        self.input_delay = input_delay
        self.output_weight = output_weight
        self.linear_start = linear_start
        self.bounds = bounds
        self.integrators = integrators
        self.operating_point = operating_point
        self.initial_state = initial_state
        self.dt = dt
        self.n_init = n_init
        self.max_iter = max_iter
        self.tol = tol
        self.max_time = max_time
        self.validation_fraction = validation_fraction
        self.n_iter_no_change = n_iter_no_change
        self.coarse_samples = coarse_samples
        self.polish_iter = polish_iter
        self.method = method
        self.n_init_samples = n_init_samples
        self.warm_start = warm_start
        self.n_jobs = n_jobs
        self.random_state = random_state
        self.verbose = verbose

    def _networks(self):
        return {
            "n_h": self.n_h,
            "feedback": self.feedback,
            "activation": self.activation,
            "odd": self.odd,
        }
