"""What all estimators share: the data, the fit, what it sets."""

from abc import ABCMeta, abstractmethod
from contextlib import contextmanager
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin, _fit_context
from sklearn.utils.metadata_routing import UNUSED
from sklearn.utils.validation import check_is_fitted

from ..containers import Container, as_columns
from ..deferred import deferred
from ..drift import centered
from ..experiments import check_inputs, join_records, split_experiments
from ..innovations import free_run, predictor
from ..mapping import Held
from ..optimizers import single_threaded
from ..plant import Plant
from ..scaling import Scaling
from ..split import as_trained
from ..structures import Structure
from ..subspace import SUBSPACE_SAMPLES
from ..watch import BY_OBSERVER, Watch
from ._callbacks import Callbacks, CallbackSupportMixin, with_callbacks
from ._checks import input_delays, order_choices, output_weights
from ._data import check_lengths, check_rows, check_u, check_y
from ._disturbances import check_disturbances
from ._doubts import warn_if_exchanged, warn_of_time
from ._first_states import from_free, has_fixed_start, told_states, whole_states
from ._fitted import as_fitted, fitted_model, publish_parameters
from ._floor import floor_of, least_cost
from ._integrators import find_integrators, note, with_integrators
from ._judge import (
    training_score,
    warn_if_gone,
    warn_if_unsettled,
    warn_if_unstable,
)
from ._loop import settled_loop
from ._noise import check_noise, is_predicting, noise_covariance
from ._options import estimator
from ._periodic import came_round, check_periodic, is_periodic, settled
from ._plant import make_plant
from ._progress import Bar, Progress
from ._records import Records
from ._remote import training_region
from ._sklearn import manual_page, with_tags
from ._split import settled_split
from ._start import check_bounds, linear_start, portable
from ._time import check_time, trained
from ._warm_start import same_point


@estimator
class StateSpaceModel(
    Records, CallbackSupportMixin, RegressorMixin, BaseEstimator, metaclass=ABCMeta
):
    """Share what a fit does in all models, and what follows from it.

    Attributes
    ----------
    A_, B_, C_, D_ : ndarray
        Linear part in the user's units (deviations), A and B per second in continuous
        time; B and D have a column for every input that is moved.
    G_, H_ : ndarray of shape (nx, nd), (ny, nd)
        What measured disturbances add to the states and to the outputs.
    disturbances_ : ndarray of int of shape (nd,)
        Columns of u that are measured disturbances.
    K_ : ndarray of shape (nx, ny)
        Gain of the innovations; zero for ``noise="output"``.
    K_b_ : ndarray of shape (nb, ny)
        Gain of the innovations on a random walk, see `drift`; no rows without one.
    noise_covariance_ : ndarray of shape (ny, ny)
        Covariance of the training errors, one sample ahead or of the simulation.
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
        1 less the mean square error of the simulation of the training record, outputs
        of unit variance, initial states estimated as in `score`; nan if the record
        stays on a cluster. The R2 of `score` takes the variance of the samples that it
        scores, and every output alike, and differs where these or gaps do.
    n_iter_ : int
        Trial steps of the training.
    converged_ : bool
        Whether the training ended by itself, and not by a limit of steps or time.
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
    """

    # not annotated: no options
    _container = Container()  # of the y of `fit`: that of the y of `predict`

    _phi = _radius = property(lambda _: None)  # A is free
    _for_control = True  # whether (A, B, C) is meant for the design of a controller

    # labels go where records go, without set_fit_request by the user
    __metadata_request__fit: ClassVar[dict] = {"u": UNUSED, "experiment": True}
    __metadata_request__predict: ClassVar[dict] = {"u": UNUSED, "experiment": True}
    __metadata_request__score: ClassVar[dict] = {"u": UNUSED, "experiment": True}
    _doc_link_module = "alssnn"

    if TYPE_CHECKING:  # what a fit keeps; annotated at run time, they were options
        _structure: Structure
        _theta: np.ndarray  # in scaled deviations
        _scaling: Scaling
        _x_scale: np.ndarray  # states of the user over states of the fit
        _made: Plant | None
        _decay: dict | None

    _made = None  # the plant, made when it is asked for
    _orders = None  # of a fit that goes on: how linear models of several orders compare
    _decay = None  # of the networks, as a search chose it
    _curve = None  # of the networks, by order

    # what others do with a model, and describe
    restore = deferred("estimators._fitted", "restore")
    predict = deferred("estimators._simulation", "predict")
    simulate = deferred("estimators._simulation", "simulate")
    estimate_x0 = deferred("estimators._simulation", "estimate_x0")
    prepare_records = deferred("estimators._simulation", "prepare_records")
    score = deferred("estimators._simulation", "score")
    simulate_test = deferred("estimators._simulation", "simulate_test")
    linearizability = deferred("estimators._plant", "linearizability")
    to_statespace = deferred("estimators._control", "to_statespace")
    iss_certificate = deferred("estimators._control", "iss_certificate")
    gain_certificate = deferred("certificates", "certify_gain")
    local_certificate = deferred("certificates", "certify_local")
    tube = deferred("certificates", "tube")
    to_nlsys = deferred("feedback", "to_nlsys")
    linearizing_law = deferred("feedback", "LinearizingLaw")
    observer = deferred("feedback", "Observer")
    controller = deferred("feedback", "LinearizingController")
    mpc = deferred("mpc", "LinearizingMPC")
    predict_ahead = deferred("estimators._ahead", "predict_ahead")
    parameter_covariance = deferred("estimators._uncertainty", "parameter_covariance")
    aic = deferred("estimators._uncertainty", "aic")
    bic = deferred("estimators._uncertainty", "bic")
    next_input = deferred("estimators._next_input", "next_input")
    sample_models = deferred("estimators._uncertainty", "sample_models")
    fit_remote = deferred("estimators._remote", "fit_remote")
    validate = deferred("validation", "validate")
    save = deferred("persistence", "save")
    to_mat = deferred("persistence", "to_mat")
    to_c = deferred("persistence", "to_c")
    to_casadi = deferred("persistence", "to_casadi")
    to_fmu = deferred("persistence", "to_fmu")
    to_modelica = deferred("persistence", "to_modelica")
    to_onnx = deferred("persistence", "to_onnx")
    to_simulink = deferred("persistence", "to_simulink")
    to_st = deferred("persistence", "to_st")
    report = deferred("report", "write_report")
    summary = deferred("report", "summarize")

    def _html_repr(self):
        """Return what a notebook shows: the diagram, and what a fit found above it."""
        diagram = super()._html_repr()
        return self.summary().to_html() + diagram if hasattr(self, "A_") else diagram

    @property
    def plant_(self):
        """Return the fitted model as an immutable value, in the user's units."""
        check_is_fitted(self)
        if self._made is None:
            self._made = make_plant(as_fitted(self))
        return self._made

    @property
    def fitted_(self):
        """Return what the fit found, an immutable value in scaled deviations."""
        return fitted_model(self)

    @property
    def _at_rest(self):
        """Whether the training experiments begin at the operating point."""
        return self.initial_state == "rest"

    @property
    def _doc_link_template(self):
        """Page of the class in the manual; empty unless the package names a manual."""
        return manual_page(type(self).__name__)

    def __sklearn_tags__(self):
        """Return the tags."""
        return with_tags(super().__sklearn_tags__())

    def __getstate__(self):
        """Return what is pickled: systems of python-control as their matrices."""
        return portable(super().__getstate__())

    @_fit_context(prefer_skip_nested_validation=True)
    @with_callbacks
    def fit(self, u, y, experiment=None):
        """Identify the model from records.

        Parameters
        ----------
        u : array_like of shape (N, nu), or list of them
            Inputs; time runs down the rows. A list has one array per experiment.
        y : array_like of shape (N,) or (N, ny), or list of them
            Outputs; nan where an output was not measured.
        experiment : array_like of shape (N,) or (N, 2), or None, default=None
            Label of the experiment of every sample; the samples of one experiment
            are contiguous. With sample numbers in a second column (`seam_labels`), a
            jump in them starts an experiment. None means one experiment.

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
            estimator is then fitted with the best parameters so far.
        """
        return self._fit(u, y, experiment)

    def _fit(self, u, y, experiment, validation=None):
        """Check and scale the data, then fit."""
        watch = self._watch()
        order_choices(self.nx)
        check_noise(self)
        check_time(self)
        check_periodic(self)
        if isinstance(self.operating_point, tuple) and len(self.operating_point) != 2:
            raise ValueError(
                "`operating_point` must be 'mean', 'zero' or a pair (u_e, y_e), got "
                f"a tuple of {len(self.operating_point)}."
            )
        u, y, experiment = join_records(as_columns(u), y, experiment)
        warn_of_time(u, self.dt, experiment)
        container = Container.of(y)
        with self._undone_unless(watch):
            u, y = self._validate(u, y, reset=True)
            self.disturbances_ = check_disturbances(self, u.shape[1])
            # more threads only get in the way of small matrices
            with single_threaded():
                self._fit_checked(u, y, experiment, validation, container, watch)
        return self

    @contextmanager
    def _undone_unless(self, watch):
        """Leave the estimator as it was unless a fit has come to a result."""
        before = dict(vars(self))
        try:
            yield
        except BaseException:
            if not watch.has_result:
                self._reset(before)
            raise

    def _reset(self, attributes):
        """Have these attributes, and no others."""
        self.__dict__.clear()
        self.__dict__.update(attributes)

    def _fit_checked(self, u, y, experiment, validation, container, watch):
        """Scale the data, then fit."""
        parts, self.experiments_ = split_experiments(len(u), experiment)
        floor = floor_of(self, u, y, experiment)
        u, y, parts, lost = settled(self, u, y, parts)
        columns = y.reshape(len(y), -1)
        warm = self._continues(u.shape[1], columns.shape[1])
        if not warm:
            self._scaling = Scaling.from_data(u, columns, self.operating_point)
            self._x_scale = np.ones(1)
            self.integrators_ = 0
            self.__dict__.pop("_decay", None)
        if floor is not None:
            weight = self._output_weight(columns.shape[1])
            watch.floor = least_cost(floor, lost, weight, self._scaling.y_scale)
        self.input_delay_ = np.zeros(u.shape[1], dtype=int)
        self.input_delay_ = self._delays(Held(self._experiments(u, y, parts)))
        self._y_ndim = y.ndim
        self._container = container
        self.output_names_ = container.output_names
        experiments, held_out = self._hold_out(u, y, parts, validation)
        if is_periodic(self):
            experiment = np.repeat(range(len(parts)), [p.stop - p.start for p in parts])
        watch.observe = Callbacks.of(self, u, y, experiment)
        returns = is_periodic(self)  # what integrates would not
        measured = from_free(self, experiments)
        if not (warm or returns) and find_integrators(self, measured, watch):
            experiments, held_out = self._hold_out(u, y, parts, validation)
        self._complete(experiments, watch, held_out, warm, lost)
        warn_if_exchanged(self, u, columns, parts)
        if watch.observe is not None:
            watch.observe.end()

    def _continues(self, nu, ny):
        """Tell whether a fit continues from the last one, of as many signals."""
        if not getattr(self, "warm_start", False) or not hasattr(self, "_theta"):
            return False
        if self.integrators not in ("auto", self.integrators_):
            return False
        if not same_point(self.operating_point, self._options["operating_point"]):
            return False
        return len(self._scaling.u_offset) == nu and len(self._scaling.y_offset) == ny

    def _hold_out(self, u, y, parts, validation):
        """Return scaled experiments to fit, and those that judge the fit, if any."""
        return self._experiments(u, y, parts, is_periodic(self)), None

    def _complete(self, experiments, watch, held_out, warm, lost=0.0):
        """Identify a model from scaled experiments and set what a fit sets."""
        previous = None
        if warm:
            structure, theta = as_trained(self._structure, self._theta)
            previous = predictor(structure), theta
        self._options = portable(self.get_params(deep=False))
        seen, fitted, self._theta, result = trained(
            self, from_free(self, experiments), previous, watch, held_out
        )
        x0 = told_states(result, seen)
        if not self._at_rest:  # else the walk is known where it begins
            self._theta, x0 = centered(fitted, self._theta, x0, seen)
        result.x0 = x0
        judged = seen, held_out, watch
        self._theta = settled_loop(self, fitted, self._theta, result, *judged)
        x0 = result.x0
        fitted, self._theta = settled_split(self, fitted, self._theta, x0, seen)
        self._structure = free_run(fitted)
        self._region, self._made = training_region(self, fitted, x0, seen), None
        result.x0 = whole_states(self, fitted, result, experiments)
        self._publish(result, watch)
        watch.has_result = True
        for name in ("_orders", "_curve"):  # the first holds the record
            self.__dict__.pop(name, None)
        self.noise_covariance_ = noise_covariance(self, fitted, x0, seen) + lost
        whole = Held.of(experiments), result.x0
        scored = whole if is_predicting(self) else (seen, x0)
        self.train_score_ = training_score(self, *scored)
        if watch.interrupt is not None:
            raise watch.interrupt
        if self._for_control:
            warn_if_unstable(self)
        warn_if_gone(self)
        if watch.reason != BY_OBSERVER:
            warn_if_unsettled(self, watch)

    def _delays(self, experiments):
        """Return the delay of every input in samples."""
        feedthrough = getattr(self, "feedthrough", False)
        options = {"nx": self.nx, "feedthrough": feedthrough}
        nu = self.n_features_in_
        return input_delays(self.input_delay, experiments, nu, **options)

    def _output_weight(self, ny):
        """Return the weight of every output."""
        return output_weights(self.output_weight, ny)

    def _near(self, experiments):
        """Return experiments from which a linear start is made in this process."""
        if experiments.is_here:
            return list(experiments)
        wanted = getattr(self, "coarse_samples", None) or 0
        return experiments.stretch(max(wanted, SUBSPACE_SAMPLES))

    def _linear_start(self, experiments, watch):
        """Return the linear model from which the fit starts, and keep its scales."""
        model, self._x_scale = linear_start(self, experiments, watch)
        self.singular_values_ = model.singular_values
        return model

    def _allows(self, nx):
        """Tell whether a model may have an order."""
        choices = order_choices(self.nx)
        return choices is None or nx in choices

    def _shapes_linear(self):
        """Tell whether the user shapes the linear model beyond its identification."""
        shapes = (self.linear_start, self.output_weight)
        shaped = bool(self.bounds) or any(shape is not None for shape in shapes)
        return shaped or has_fixed_start(self) or self.horizon > 1

    def _scaled_bounds(self, structure, contractive=False):
        bounds = check_bounds(
            self.bounds,
            structure,
            self._units(),
            own_basis=self.linear_start is not None,
            contractive=contractive,
        )
        return with_integrators(self, bounds, structure)

    def _training(self, structure, held=()):
        """Return the options that all trainings of a structure have in common."""
        bounds = self._scaled_bounds(structure, contractive=self._phi is not None)
        return {
            "phi": self._phi,
            "radius": self._radius,
            "bounds": bounds | dict(held),
            "at_rest": self._at_rest,
            "periodic": is_periodic(self),
            "max_iter": self.max_iter,
            "tol": self.tol,
        }

    def _refinement(self):
        """Return the options of the search for the linear model."""
        return {}

    @abstractmethod
    def _identify(self, experiments, previous, watch, held_out):
        """Return structure, theta and result for scaled experiments."""

    def _criterion_terms(self, structure):
        """Return the structure with its penalized channels, and their weights."""
        weight = self._output_weight(structure.sizes["y"])
        return structure, {"y": weight}

    def _publish(self, result, watch):
        """Set the fitted attributes, in the user's units."""
        publish_parameters(self)
        self.x0_ = result.x0 * self._x_scale
        self.cost_ = float(result.cost)
        self.n_iter_ = int(result.nfev)
        self.converged_ = bool(result.success)
        self.message_ = str(result.message) + note(self)
        self.history_ = watch.history
        self.orders_ = {}
        if self._orders is not None:
            self.orders_["linear"] = self._orders.curve

    def _units(self):
        """Return the user's units over those of the fit, of u, y and x."""
        scaling = self._scaling
        return {"u": scaling.u_scale, "y": scaling.y_scale, "x": self._x_scale}

    def _validate(self, u, y, reset):
        check_rows(u, y)
        u = check_u(self, u, reset=reset, least=2 if reset else 1)
        y = check_y(self, y)
        check_lengths(u, y)
        check_inputs(u)
        return u, y

    def _experiments(self, u, y, parts, periodic=False):
        """Return scaled deviations of every experiment."""
        y = y.reshape(len(y), -1)
        delay, parts = self.input_delay_, list(parts)
        inputs = [u[part] for part in parts]
        if periodic:
            inputs = [came_round(one, delay) for one in inputs]
            delay = 0 * delay
        return [
            (self._scaling.scale_u(one, delay), self._scaling.scale_y(y[part]))
            for one, part in zip(inputs, parts, strict=True)
        ]

    def _watch(self):
        """Return what follows the fit: its clock, its history, its progress."""
        if not self.verbose:
            return Watch(max_time=self.max_time)
        name = type(self).__name__
        progress: Bar | Progress
        if self.verbose == "bar":
            progress = Bar(name, self.max_iter)
        else:
            progress = Progress(name, every_step=self.verbose > 1)
        return Watch(max_time=self.max_time, report=progress)
