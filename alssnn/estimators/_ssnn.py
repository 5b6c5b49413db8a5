"""The training that all estimators with networks share."""

from dataclasses import replace
from functools import partial
from numbers import Integral, Real
from typing import Any

import numpy as np
from sklearn.base import _fit_context
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import Interval, StrOptions

from ..descent import USUAL
from ..integrators import decouple
from ..limits import Limits
from ..linear_model import simulation_error, stabilize
from ..mapping import Held
from ..models import state_space
from ..predictions import likeliest
from ..search import Recipe, search
from ..stability import NEAREST, SLOWEST, contractive_basis
from ..starts import initial_theta
from ..watch import INTERRUPTED
from ._base import StateSpaceModel
from ._callbacks import snapshot, with_callbacks
from ._candidates import candidates
from ._disturbances import checked
from ._held_out import hold_out
from ._horizon import trained
from ._input_map import as_large_as_u, stages_of_search
from ._inputs import check_inputs, held_columns, seen
from ._integrators import regular
from ._left_linear import left_linear
from ._networks import DECLARED
from ._noise import fitted_view, is_predicting, least_gamma_h, walk
from ._options import estimator, option
from ._records import POSITIVE, WEIGHT
from ._residual import (
    H_ALONE,
    completed,
    idle_g,
    is_enough,
    is_worthwhile,
    searched,
)
from ._safe import safely_trained
from ._time import is_continuous, stages
from ._warm_start import forms, goes_on

SETTLED = "as many steps as hidden samples allow"


@estimator
class Ssnn(StateSpaceModel):
    """Share the training of models with networks.

    A model declares its options; ``_networks`` returns those of its networks. One of
    another family declares its structure in ``_declare``.

    Parameters
    ----------
    nx : int, "auto" or array_like of int, default="auto"
        Number of states. "auto" compares linear models of order 1, 2, ... on hidden
        samples until three larger orders bring no gain; a range or a list compares the
        orders that it names (eq. holdout). With ``alpha="auto"`` networks then choose
        among the same orders, with "auto" up to one more than the best linear one and
        in any case up to three, and beyond as long as each is clearly better, but
        without smaller ones of twice its error (eq. fewer). Of a short record a larger
        order is also taken that explains much more of what it sees (eq. explained).
        With `integrators`, "auto" tries the orders from their number up to one more
        than the best linear one, or three. See `orders_`.
    max_iter : int, default=300
        Largest number of trial steps of one start, for every weight that it goes along
        (`alpha`, `continuation`). `n_iter_` counts them, and those of the stages that
        follow on a record longer than `coarse_samples` (`polish_iter`). Not counted is
        the search of ``alpha="auto"``: a stage, one alpha of one start, takes a 25th of
        it, three 25ths with ``input_map="monotone"``, and a sixth for `GrSsnn` and for
        the second kind of paths of `AlSsnn`, both with ``noise="output"``.
    tol : float, default=1e-4
        Relative change of cost or parameters that ends a stage.
    bounds : dict of str to tuple or None, default=None
        Bounds ``{"D": (low, high)}`` of entries of D and H, and with `linear_start` of
        A, B and G, in the units of the data; equal ones hold an entry.
    stability : {"auto", "contractive", "schur"} or None, default="auto"
        "contractive" keeps ``A'A <= (1 - phi) I`` throughout (eq. contract): networks
        of tanh or sigmoid then have bounded simulations for every bounded input, as
        with "schur", which keeps the poles of A inside the same circle, in whatever
        basis. None leaves A free. "auto" trains as "contractive" does, but `A_` may be
        another matrix (`linear_part`); with a `linear_start`, whose basis of the states
        it would change, it is None.
    phi : float, default=1e-5
        Rate of decay if A is a contraction, per sample: ``|x|^2`` of the linear part
        falls by at least the share phi in every step; with "schur" poles have at most
        the modulus ``sqrt(1 - phi)``, as those of exp(A dt) in continuous time.
    alpha : float or "auto", default="auto"
        Weight of the squared network parameters (eq. cost). "auto" chooses it, and with
        it the random start, by the simulation error on hidden quarters of the record
        (eq. holdout). It pulls the networks back to their start, so that a large weight
        leaves the linear model. (Those of `GrSsnn` are pulled to zero.) If no networks
        beat the linear model on the hidden quarters, the fit returns it, with a
        ConvergenceWarning. `AlSsnn` tries h alone, too, and holds g at zero where that
        does nearly as well (eq. enough); in discrete time `message_` says so.
        Training on all samples may make the simulation worse than that of the linear
        model, or take it far from the record (eq. escape, latch). It is then repeated
        with up to 30 times the weight; if none is better than the model of the search,
        the fit returns that one, with such a warning, too. A number pulls towards zero
        and hides no samples. One above 1e-4 that takes the networks away is tried
        again, behind 1e-4.
    n_init : int, default=3
        Number of random starts. With ``alpha="auto"`` the best on hidden samples goes
        on, with a number the one of least cost on the coarse stage.
    validation_fraction : float or None, default=None
        Share of every experiment, its end, that is not fitted but judges the
        training, see `validation` of `fit`; None fits everything.
    n_iter_no_change : int, default=10
        Accepted steps without a new least validation error after which a stage ends.
    coarse_samples : int or None, default=8000
        On longer records the search and the first stages of the training take so many
        samples, the stretch in which u and y deviate most from the operating point;
        None takes all samples at once.
    polish_iter : int, default=15
        Largest number of trial steps on all samples after the coarse stages, of which
        a long record has a second one, on three times the samples.
    method : {"lm", "trf"}, default="lm"
        Method of `scipy.optimize.least_squares`. Steps of "lm" are bent (eq. geodesic),
        except on short records with ``alpha="auto"``.
    warm_start : bool, default=False
        Whether a repeated `fit` continues from the last parameters and scaling, if
        they still fit the signals and the other options.
    n_jobs : int or None, default=None
        Random starts and orders trained in parallel, or experiments in threads if there
        is one start, as in joblib. The result does not depend on it.
    random_state : int, RandomState instance or None, default=None
        Source of the initial inner weights.

    Attributes
    ----------
    orders_ : dict
        How orders compare: root mean square error on hidden samples by `nx`, outputs of
        unit variance, under "linear" (if `nx` was chosen) and, with ``alpha="auto"``,
        "networks".
    h_sees_ : {"measured", "predicted"}
        What h sees in the predictor of ``noise="innovations"``.
    alpha_ : float
        Weight of the squared network parameters that was given or found; inf if
        networks do not help and the linear model was returned.
    n_iter_ : int
        Trial steps of the training, all stages of the best start together; linear
        start and search are excluded.
    converged_ : bool
        Whether the training ended by itself: a tolerance was reached, validation or
        the number of steps that hidden samples allow ended the last stage, or the
        linear model, or that of the search, was returned (see `alpha`); false where
        `max_iter`, `max_time`, a callback or the user ended it, or `polish_iter` the
        last stage of a record longer than `coarse_samples`. True does not say that the
        cost has settled.
    """

    max_iter: int = option(300, [POSITIVE])
    tol: float = option(1e-4, [Interval(Real, 0, None, closed="neither")])
    stability: Any = option(
        "auto", [StrOptions({"auto", "contractive", "schur"}), None]
    )
    phi: float = option(1e-5, [Interval(Real, 0, 1, closed="left")])
    alpha: Any = option("auto", [WEIGHT, StrOptions({"auto"})])
    n_init: int = option(3, [POSITIVE])
    validation_fraction: float | None = option(
        None, [Interval(Real, 0, 1, closed="neither"), None]
    )
    n_iter_no_change: int = option(10, [POSITIVE])
    coarse_samples: int | None = option(8_000, [POSITIVE, None])
    polish_iter: int = option(15, [POSITIVE])
    method: str = option("lm", [StrOptions({"lm", "trf"})])
    warm_start: bool = option(False, ["boolean"])
    n_jobs: Any = option(None, [Integral, None])
    random_state: Any = option(None, ["random_state"])

    # What a model fixes unless it is one of its options; not annotated: no options.
    gamma = gamma_k = gamma_h = 0.0
    feedthrough = False
    h_inputs = g_inputs = None
    continuation = 0
    feedback = "output"
    penalty = ""
    _forgets = 0.0  # least rate of decay of a predictor
    _linear_cost = 0.0  # of the linear model that a fit began with

    def _networks(self):
        """Return the sizes and kinds of networks, for `_declare`."""
        own = self._parameter_constraints
        return {name: getattr(self, name) for name in DECLARED if name in own}

    def _declare(self, nx, nu, ny, **networks):
        """Return the structure; models of another family declare their own."""
        if len(self.disturbances_):
            networks["disturbances"] = tuple(map(int, self.disturbances_))
        if is_predicting(self):
            networks |= walk(self) | {"noise": self.noise, "h_sees": self.h_sees_}
        return state_space(nx, nu, ny, **networks)

    def declare(self, nx, nu, ny, C):
        """Return the structure that the options ask for.

        Parameters
        ----------
        nx, nu, ny : int
            Number of states, inputs and outputs.
        C : ndarray of shape (ny, nx)
            Output matrix.

        Returns
        -------
        structure : Structure
            The structure that is fitted: a predictor, of a model with innovations.
        """
        networks = {**self._networks(), "feedthrough": self.feedthrough}
        structure = self._declare(nx, nu, ny, C=C, **networks)
        return fitted_view(self, checked(structure, self.disturbances_))

    @_fit_context(prefer_skip_nested_validation=True)
    @with_callbacks
    def fit(self, u, y, experiment=None, *, validation=None):
        """Identify the model from records.

        Parameters
        ----------
        u : array_like of shape (N, nu), or list of them
            Inputs; time runs down the rows. A list has one array per experiment.
        y : array_like of shape (N,) or (N, ny), or list of them
            Outputs; nan where an output was not measured.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample; the samples of one experiment
            are contiguous. None means one experiment.
        validation : tuple of array_like or None, default=None
            Other records (u, y) or (u, y, experiment): the training keeps the
            parameters of least simulation error on them, and a stage ends after
            `n_iter_no_change` steps without a new least error. Their initial states
            are estimated from their first `n_init_samples` samples (at most a
            quarter of them), which do not count, as in `score`. None takes the share
            `validation_fraction` from the end of every training experiment, if any.

        Returns
        -------
        self : object
            The fitted model.

        Raises
        ------
        ValueError
            If lengths differ, values are not finite, an input is constant, an output
            was never measured, labels are not contiguous, or the record is too short
            for the order.
        KeyboardInterrupt
            If the user interrupts. From the refinement of the linear start on, the
            estimator is then fitted with the best parameters so far;
            ``warm_start=True`` continues from them.
        """
        return self._fit(u, y, experiment, validation)

    def _hold_out(self, u, y, parts, validation):
        check_inputs(self)
        return hold_out(self, u, y, parts, validation)

    def _scaled_bounds(self, structure, contractive=False):
        """Return the user's bounds, and those of what the networks do not see."""
        bounds = super()._scaled_bounds(structure, contractive)
        return {**bounds, **self._held_weights(structure)}

    def _held_weights(self, structure):
        """Return bounds that hold at zero what the networks do not see."""
        return held_columns(structure, seen(self, structure.sizes))

    def _identify(self, experiments, previous, watch, held_out):
        outcomes, before = [], dict(vars(self))
        before.pop("h_sees_", None)
        for form in forms(self, previous):
            told = {"h_sees_": form} if is_predicting(self) else {}
            self._reset({**before, **told})
            outcome = self._train(experiments, previous, watch, held_out)
            outcomes.append((outcome, dict(vars(self))))
        outcome, after = likeliest(outcomes, experiments)
        self._reset(after)
        return outcome

    def _linear_start(self, experiments, watch):
        linear = super()._linear_start(experiments, watch)
        for name in ("_forgets", "_linear_cost"):
            self.__dict__.pop(name, None)
        if is_predicting(self):
            # half as far from the circle as its poles, which then may stay
            self._forgets = 1.0 - (0.5 + linear.radius / 2) ** 2
            self._linear_cost = float(simulation_error(experiments, linear) ** 2)
        if self._phi is not None:
            self._x_scale = np.ones(1)  # a basis of its own
        return linear

    def _train(self, experiments, previous, watch, held_out):
        check_inputs(self)
        max_iter, is_auto = self.max_iter, self.alpha == "auto"
        chosen, continues = self._decay or {"alpha": 0.0}, goes_on(self, previous)
        held: dict = {}
        fallback = self._decay = None
        if continues:
            plain, starts, decay, held = self._continued(previous, chosen)
        else:
            near = self._near(experiments)
            linear, plain = self._declared(self._linear_start(near, watch))
            is_linear = plain.nw == 0 and not self._phi and not self._shapes_linear()
            if is_linear and held_out is None and experiments.is_here:
                return linear.as_fit(self.disturbances_)  # nothing more to train
            rng = check_random_state(self.random_state)
            seeds = rng.randint(np.iinfo(np.int32).max, size=self.n_init)
            fallback = self._start(plain, linear, near, seeds[0])
            if is_auto and plain.nw > 0:
                # a stretch of a stretch would not be that of the training
                far = near if self.coarse_samples is None else experiments
                own, found = self._found(far, linear, seeds, watch)
                if found is None or not found.helps:
                    return left_linear(self, linear, near, experiments, watch)
                plain, theta, decay, held = completed(
                    self, own, found, linear, near, seeds[0], watch
                )
                starts, max_iter = [theta], min(max_iter, found.refit_iter)
                fallback = fallback if plain.sizes["x"] == len(linear.A) else None
            else:
                starts = [self._start(plain, linear, near, seed) for seed in seeds]
                decay = {"alpha": 0.0 if is_auto else self.alpha, "bends": not is_auto}
        self._decay = decay if is_auto else None
        penalized, weights = self._criterion_terms(plain)
        if watch.observe is not None:
            watch.observe.attributes = partial(snapshot, self, plain)
        if self._phi is not None:
            self._x_scale = np.ones(plain.sizes["x"])
        options = {**self._training(plain, held), "weights": weights, **stages(self)}
        options |= {"validation": held_out, "max_iter": max_iter, "watch": watch}
        if not is_auto:
            options |= {"continuation": self.continuation, "rises": not continues}

        def train(decay):
            how = {**options, **decay, "fallback": fallback}
            result = trained(self, penalized, experiments, starts, **how)
            if max_iter < self.max_iter and result.status == 0:
                result.update(success=True, message=SETTLED)
            return result

        if continues or not is_auto:
            result = train(decay)
        else:
            result, self._decay = safely_trained(
                self, plain, train, decay, starts[0], linear, experiments, watch
            )
            if result is None:
                return left_linear(self, linear, near, experiments, watch, refused=True)
        if held and not continues and self.input_map == "identity":
            result.message += f"; {H_ALONE}"
        theta = as_large_as_u(self, plain, result.theta, result.x0, experiments)
        return plain, theta, result

    def _continued(self, previous, chosen):
        """Return structure, start, decay and held weights of a fit that goes on."""
        plain, theta = previous[0], previous[1]
        if self.alpha != "auto":
            return plain, [theta], {"alpha": self.alpha, "bends": True}, {}
        # with what the fit that is continued has chosen
        return plain, [theta], chosen, idle_g(plain, theta)

    def _publish(self, result, watch):
        super()._publish(result, watch)
        given = 0.0 if self.alpha == "auto" else self.alpha
        self.alpha_ = float(self._decay["alpha"] if self._decay else given)
        if self._curve:
            self.orders_["networks"] = self._curve

    @property
    def _phi(self):
        """Return the rate of contraction; None where A is free."""
        is_auto = self.stability == "auto" and self.linear_start is None
        is_contractive = is_auto or self.stability == "contractive"
        return max(self.phi, self._forgets) if is_contractive else None

    @property
    def _radius(self):
        """Return the largest modulus of a pole of a free A; None where all may be."""
        phi = max(self.phi, self._forgets)
        return np.sqrt(1.0 - phi) if self.stability == "schur" else None

    def _declared(self, linear, radius=1.0):
        """Return a linear model in the basis of the training, and the structure."""
        if self._phi is not None:
            n = self.integrators_
            linear = contractive_basis(decouple(linear, n), self._phi, n, radius)
        elif self._radius is not None:
            A = linear.A.copy()
            inside = min(self._radius - NEAREST, radius)
            regular(self, A)[:] = stabilize(regular(self, A), inside)
            linear = replace(linear, A=A)
        return linear, self.declare(len(linear.A), linear.nu, len(linear.C), linear.C)

    def _start(self, plain, linear, experiments, seed, **options):
        """Return the linear model with networks of random inner weights."""
        held = self._held_weights(plain)
        rng = np.random.default_rng(seed)
        return initial_theta(plain, linear, experiments, rng, held, **options)

    def _descents(self):
        """Return the weights of the decay along which the search goes."""
        return (USUAL,)

    def _found(self, experiments, linear, seeds, watch):
        """Return the model to train, this one or the same without g, and its search."""
        own, *others = searched(self)
        found = self._search(own, experiments, linear, seeds, watch)
        asks = is_worthwhile(self, watch) and not is_continuous(self)
        for other in others:
            if found is None or watch.reason is not None or (found.helps and not asks):
                break
            # what h alone explains, the model with g explains with as many states
            nx = found.structure.sizes["x"] if found.helps else None
            alone = self._search(other, experiments, linear, seeds, watch, nx)
            # one that was ended may be better than it looks
            ended = alone is None or (found.helps and watch.reason is not None)
            if not ended and is_enough(alone, found, is_predicting(self)):
                self._curve = alone.curve if nx is None else found.curve
                return other, alone
        if found is not None:
            self._curve = found.curve
        return own, found

    def _search(self, own, experiments, linear, seeds, watch, nx=None):
        """Return order, start and decay by hidden samples; None if interrupted.

        They are those of `own`, which is this model or the same without g. An order
        that is given is not chosen.
        """
        if self.coarse_samples is not None:
            experiments = Held.of(experiments).stretch(self.coarse_samples)

        # at the limit of stability the search would hardly move; and a pole slower
        # than the record is no better known than one of its length
        radius = 1.0 - SLOWEST / max(len(u) for u, _ in experiments)

        def declare(model):
            linear, plain = own._declared(model, max(radius, 0.5))
            return linear, plain, *own._criterion_terms(plain)

        def limits(plain):
            bounds = own._scaled_bounds(plain, contractive=self._phi is not None)
            return Limits(plain, self._phi, bounds, self._at_rest, self._radius)

        orders, among, largest = candidates(self, experiments, linear, watch, nx)
        try:
            found = search(
                Recipe(declare, own._start, limits),
                orders,
                among,
                seeds,
                largest=largest,
                **stages_of_search(own),
                method=self.method,
                n_jobs=self.n_jobs,
                output_weight=self._output_weight(experiments[0][1].shape[1]),
                watch=watch,
                is_predictor=is_predicting(self),
            )
        except KeyboardInterrupt as interrupt:  # between two stages, or in a worker
            watch.stop(INTERRUPTED, interrupt)
            return None
        return found

    def _criterion_terms(self, plain):
        weights = {"y": self._output_weight(plain.sizes["y"])}
        gammas = {"h": max(self.gamma_h, least_gamma_h(self))}
        if self.penalty:
            residual = "g" if self.penalty == "state" else "e"
            gammas = {residual: self.gamma, "k": self.gamma_k, **gammas}
        for channel, gamma in gammas.items():
            if gamma > 0 and channel in plain.signals:
                weights[channel] = gamma
        return plain.observe(*weights), weights
