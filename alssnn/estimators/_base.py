"""What all estimators share: the data, the fit, what it sets."""

from abc import ABCMeta, abstractmethod
from functools import partial
from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from scipy.optimize import OptimizeResult
from sklearn.base import BaseEstimator, _fit_context
from sklearn.utils import Bunch
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.validation import (
    check_consistent_length,
    validate_data,
)

from ..containers import Container
from ..criterion import Criterion
from ..delays import estimate_delays
from ..experiments import check_inputs, split_experiments
from ..mapping import Held
from ..optimizers import single_threaded
from ..orders import SAMPLES as ORDER_SAMPLES
from ..orders import compare_orders
from ..scaling import Scaling
from ..stability import hold_off
from ..subspace import TRIAL_SAMPLES, simulation_error
from ..training import Validation
from ..watch import BY_OBSERVER, OUT_OF_TIME, Watch, late_fall
from ._ahead import AheadMixin
from ._callbacks import Callbacks, CallbackSupportMixin, with_callbacks
from ._control import ControlMixin
from ._files import FilesMixin
from ._integrators import IntegratorsMixin
from ._linearity import LinearityMixin
from ._progress import Progress
from ._remote import RemoteMixin
from ._report import ReportMixin
from ._simulation import DATA, SimulationMixin, join_records
from ._sklearn import ScikitLearnMixin
from ._start import check_bounds, given_model, portable
from ._uncertainty import UncertaintyMixin
from ._validation import ValidationMixin
from ._warn import warn_of_training

POSITIVE = Interval(Integral, 1, None, closed="left")
COUNT = Interval(Integral, 0, None, closed="left")
WEIGHT = Interval(Real, 0, None, closed="left")
TOO_FAR = 3.0  # error of a training record over that from the fitted initial state
NOTABLE = 0.1  # relative to the output, from which that is worth a warning
DELAY_SAMPLES = 20_000  # of experiments on a cluster, that tell of their delays


class StateSpaceModel(
    CallbackSupportMixin,
    SimulationMixin,
    AheadMixin,
    LinearityMixin,
    ControlMixin,
    ValidationMixin,
    UncertaintyMixin,
    FilesMixin,
    ReportMixin,
    RemoteMixin,
    IntegratorsMixin,
    ScikitLearnMixin,
    BaseEstimator,
    metaclass=ABCMeta,
):
    """Share what a fit does in all models; the mixins share what follows from it."""

    _container = Container()  # of the y of `fit`: that of the y of `predict`

    _for_control = True  # whether (A, B, C) is meant for the design of a controller

    _parameter_constraints: ClassVar[dict] = {
        "nx": [POSITIVE, StrOptions({"auto"}), range, "array-like"],
        "operating_point": [StrOptions({"mean", "zero"}), tuple],
        "initial_state": [StrOptions({"estimate", "rest"})],
        "dt": [Interval(Real, 0, None, closed="neither")],
        "input_delay": [COUNT, "array-like", StrOptions({"auto"})],
        "output_weight": ["array-like", None],
        "linear_start": "no_validation",
        "bounds": [dict, None],
        "integrators": [COUNT, StrOptions({"auto"})],
        "max_iter": [POSITIVE],
        "tol": [Interval(Real, 0, None, closed="neither")],
        "max_time": [Interval(Real, 0, None, closed="neither"), None],
        "n_init_samples": [POSITIVE],
        "verbose": ["verbose"],
    }

    def __getstate__(self):
        """Return what is pickled: systems of python-control as their matrices."""
        state = dict(super().__getstate__())
        if "linear_start" in state:
            state["linear_start"] = portable(state["linear_start"])
        return state

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
        self._nx_choices()
        if isinstance(self.operating_point, tuple) and len(self.operating_point) != 2:
            raise ValueError(
                "`operating_point` must be 'mean', 'zero' or a pair (u_e, y_e), got "
                f"a tuple of {len(self.operating_point)}."
            )
        u, y, experiment = join_records(u, y, experiment)
        container = Container.of(y)
        u, y = self._validate(u, y, reset=True)
        with single_threaded():  # small matrices: more threads only get in the way
            self._fit_checked(u, y, experiment, validation, container, watch)
        return self

    def _fit_checked(self, u, y, experiment, validation, container, watch):
        """Scale the data, then fit."""
        columns = y.reshape(len(y), -1)
        warm = self._continues(u.shape[1], columns.shape[1])
        if not warm:
            self._scaling = Scaling.from_data(u, columns, self.operating_point)
            self._x_scale = np.ones(1)
            self.integrators_ = 0
            self.__dict__.pop("_decay", None)
        parts, self.experiments_ = split_experiments(len(u), experiment)
        self.input_delay_ = np.zeros(u.shape[1], dtype=int)
        self._set_delay(Held(self._experiments(u, y, parts)), u.shape[1])
        self._y_ndim = y.ndim
        self._container = container
        self.output_names_ = container.output_names
        experiments, held_out = self._hold_out(u, y, parts, validation)
        watch.observe = Callbacks.of(self, u, y, experiment)
        if not warm and self._find_integrators(experiments, watch):
            experiments, held_out = self._hold_out(u, y, parts, validation)
        self._complete(experiments, watch, held_out, warm)
        if watch.observe is not None:
            watch.observe.end()

    def _continues(self, nu, ny):
        """Tell whether a fit continues from the last one, of as many signals."""
        if not getattr(self, "warm_start", False) or not hasattr(self, "_theta"):
            return False
        if self.integrators not in ("auto", self.integrators_):
            return False
        return len(self._scaling.u_offset) == nu and len(self._scaling.y_offset) == ny

    def _hold_out(self, u, y, parts, validation):
        """Return scaled experiments to fit, and those that judge the fit, if any."""
        return self._experiments(u, y, parts), None

    def _complete(self, experiments, watch, held_out, warm):
        """Identify a model from scaled experiments and set what a fit sets."""
        experiments = Held.of(experiments)
        previous = (self._structure, self._theta) if warm else None
        self._structure, self._theta, result = self._identify(
            experiments, previous, watch, held_out
        )
        self._publish(result, watch)
        for name in ("_orders", "_curve"):  # the first holds the record
            self.__dict__.pop(name, None)
        self._region = self._training_region(experiments)
        self._score_training(experiments)
        if watch.interrupt is not None:
            raise watch.interrupt
        self._warn_if_unstable()
        if not self.converged_ and watch.reason != BY_OBSERVER:
            reason = f"before the cost settled to tol={self.tol}. Increase `max_iter`"
            if watch.reason == OUT_OF_TIME:
                reason = "because max_time is over. Increase `max_time`"
            fall, n_steps = late_fall(self.history_)
            settled = (
                f" Its last {n_steps} steps lowered the cost by {100 * fall:.2g} %."
            )
            warn_of_training(
                f"{type(self).__name__} stopped after {self.n_iter_} trial steps "
                f"{reason} or `tol`, or continue with `warm_start=True`."
                f"{settled if np.isfinite(fall) else ''}",
            )

    def _own_judge(self, experiments):
        """Return what judges a model on its own record, by the policy of `score`."""
        ny = len(self._scaling.y_offset)
        return Validation(experiments, np.ones(ny), self.n_init_samples)

    def _score_training(self, experiments):
        """Set `train_score_`; warn of a model that needs one exact initial state."""
        self.train_score_ = float("nan")
        if not experiments.is_here:
            return
        structure, theta = self._structure, self._theta
        noise = min(self.cost_, 1.0)
        rmse = self._own_judge(experiments).rmse(structure, theta, noise)
        self.train_score_ = float(1.0 - rmse**2)
        criterion = Criterion(structure, experiments)
        ny = structure.sizes["y"]
        fitted = criterion.norm(criterion.join(theta, self.x0_ / self._x_scale))
        if rmse > TOO_FAR * fitted / np.sqrt(ny) and rmse > NOTABLE:
            warn_of_training(
                f"{type(self).__name__} simulates its own training record with a "
                f"relative error of {rmse:.2g} from an estimated initial state, and of "
                f"{fitted / np.sqrt(ny):.2g} from the fitted one: it hangs on an exact "
                "initial state. Take stability='contractive', a smaller `nx`, or a "
                "longer record.",
            )

    def _set_delay(self, experiments, nu):
        """Set `input_delay_`, the delay of every input in samples."""
        if isinstance(self.input_delay, str):
            self.input_delay_ = estimate_delays(
                list(experiments)
                if experiments.is_here
                else experiments.stretch(DELAY_SAMPLES),
                self._nx_choices() or "auto",
                feedthrough=getattr(self, "feedthrough", False),
            )
            return
        delay = np.asarray(self.input_delay)
        shortest = min(experiments.lengths)
        if (
            delay.shape not in [(), (nu,)]
            or not np.issubdtype(delay.dtype, np.integer)
            or delay.min() < 0
            or delay.max() >= shortest
        ):
            raise ValueError(
                f"`input_delay` must be 'auto' or one integer per input ({nu}) between "
                f"0 and the length of the shortest experiment ({shortest}), got "
                f"{self.input_delay!r}. It counts samples."
            )
        self.input_delay_ = np.broadcast_to(delay, nu).copy()

    def _output_weight(self, ny):
        """Return the weight of every output."""
        if self.output_weight is None:
            return np.ones(ny)
        weight = np.asarray(self.output_weight, dtype=float)
        valid = np.isfinite(weight) & (weight >= 0)
        if weight.shape != (ny,) or not valid.all() or not weight.any():
            raise ValueError(
                f"`output_weight` must be one nonnegative number per output ({ny}), "
                f"not all zero, got {self.output_weight!r}. Errors are weighed "
                "relative to the standard deviation of their output."
            )
        return weight

    def _near(self, experiments):
        """Return experiments from which a linear start is made in this process."""
        if experiments.is_here:
            return list(experiments)
        wanted = getattr(self, "coarse_samples", None) or 0
        return experiments.stretch(max(wanted, TRIAL_SAMPLES))

    def _linear_model(self, experiments, watch):
        """Return the linear start, given or identified, and set the state scales."""
        feedthrough = getattr(self, "feedthrough", False)
        if self.linear_start is not None:
            model, self._x_scale = given_model(
                self.linear_start, self._scaling, experiments, self.dt, feedthrough
            )
            if not self._allows(len(model.A)):
                raise ValueError(
                    f"`nx` must be 'auto' or the order of `linear_start`, "
                    f"{len(model.A)}, got {self.nx}."
                )
            self._check_given_integrators(model.A, len(model.C))
        else:
            model = self._identified_linear(experiments, watch)
            if self.integrators_ == 0:
                model = self._reproducing(model, experiments)
            self._x_scale = np.ones(len(model.A))
        self.singular_values_ = model.singular_values
        return model

    def _reproducing(self, model, experiments):
        """Return a linear model that simulates its record no worse than the mean."""
        judge = self._own_judge(experiments)
        if all(np.isnan(y[:]).all() for _, y in judge.scored):
            return model  # nothing is measured behind the first samples
        noise = min(simulation_error(experiments, model) ** 2, 1.0)
        return hold_off(model, experiments, partial(judge.rmse, noise=noise))

    def _nx_choices(self):
        """Return the orders that the user allows; None where all are."""
        if isinstance(self.nx, str):
            return None
        orders = np.atleast_1d(self.nx)
        valid = orders.ndim == 1 and np.issubdtype(orders.dtype, np.integer)
        if not valid or orders.size == 0 or orders.min() < 1:
            raise ValueError(
                "`nx` must be 'auto', a positive integer or several of them, got "
                f"{self.nx!r}. Give the orders to compare, such as range(1, 5)."
            )
        return sorted({int(nx) for nx in orders})

    def _allows(self, nx):
        """Tell whether a model may have an order."""
        choices = self._nx_choices()
        return choices is None or nx in choices

    def _choose_order(self, experiments, watch):
        """Return the order of the linear model; keep how others compare."""
        self._orders = compare_orders(
            Held.of(experiments).stretch(ORDER_SAMPLES),
            self._nx_choices(),
            feedthrough=getattr(self, "feedthrough", False),
            watch=watch,
        )
        return self._orders.nx

    def _shapes_linear(self):
        """Tell whether the user shapes the linear model beyond its identification."""
        shapes = (self.linear_start, self.output_weight)
        shaped = bool(self.bounds) or any(shape is not None for shape in shapes)
        return shaped or self._at_rest

    def _scaled_bounds(self, structure, contractive=False):
        bounds = check_bounds(
            self.bounds,
            structure,
            self._units(),
            own_basis=self.linear_start is not None,
            contractive=contractive,
        )
        return self._with_integrators(bounds, structure)

    def _warn_if_unstable(self):
        radius = np.abs(np.linalg.eigvals(self._regular(self.A_))).max(initial=0.0)
        if radius < 1 or not self._for_control:
            return
        # a kind of failed training: filtered with its other warnings
        warn_of_training(
            f"The linear part of {type(self).__name__} is unstable, spectral radius "
            f"{radius:.6g}: with h cancelled the loop diverges unless a controller "
            "stabilizes it. Unless the plant is unstable itself, try gamma_h=1e-4, "
            "another `nx`, or `AlSsnn` with stability='contractive'.",
        )

    @abstractmethod
    def _identify(self, experiments, previous, watch, held_out):
        """Return structure, theta and result for scaled experiments."""

    def _criterion_terms(self, structure):
        """Return the structure with its penalized channels, and all weights."""
        weight = self._output_weight(structure.sizes["y"])
        return structure, {"output_weight": weight}

    def _snapshot(self, structure, step, point):
        """Return the attributes of a model fitted with what a search has reached."""
        shown = object.__new__(type(self))
        shown.__dict__.update(vars(self))
        theta, x0 = np.split(point, [structure.n_params])
        shown._structure, shown._theta = structure, theta
        result = OptimizeResult(
            x0=x0.reshape(-1, structure.n_x0),
            cost=step.cost,
            nfev=step.iteration + 1,
            success=False,
            message="in training",
        )
        shown._publish(result, Watch())
        ours = vars(self)
        return {k: v for k, v in vars(shown).items() if ours.get(k) is not v}

    def _publish(self, result, watch):
        """Set the fitted attributes, in the user's units."""
        self._publish_parameters()
        self.x0_ = result.x0 * self._x_scale
        self.cost_ = float(result.cost)
        self.n_iter_ = int(result.nfev)
        self.converged_ = bool(result.success)
        self.message_ = str(result.message) + self._note()
        self.history_ = watch.history
        self.orders_ = {}
        if self._orders is not None:
            self.orders_["linear"] = self._orders.curve

    def _publish_parameters(self):
        """Set the attributes that follow from structure, theta and scales."""
        scaling, structure = self._scaling, self._structure
        p = {**structure.constants, **structure.split(self._theta)}
        p = structure.rescale(p, self._units())
        for name, (low, high) in (self.bounds or {}).items():
            p[name] = np.clip(p[name], low, high)  # units round, bounds do not
        self.params_ = Bunch(**p)
        self.A_, self.B_, self.C_ = p["A"], p["B"], p["C"]
        self.D_ = p.get("D", np.zeros((len(self.C_), self.B_.shape[1])))
        self.nx_ = len(self.A_)
        self.u_offset_, self.y_offset_ = scaling.u_offset, scaling.y_offset

    def _units(self):
        """Return the user's units over those of the fit, by axis."""
        scaling = self._scaling
        return {"u": scaling.u_scale, "y": scaling.y_scale, "x": self._x_scale}

    def _validate(self, u, y, reset):
        check_u = {**DATA, "ensure_min_samples": 2 if reset else 1}
        check_y = {**DATA, "ensure_2d": False}
        u, y = validate_data(
            self, u, y, reset=reset, validate_separately=(check_u, check_y)
        )
        check_consistent_length(u, y)
        check_inputs(u)
        return u, y

    def _experiments(self, u, y, parts):
        """Return scaled deviations of every experiment."""
        y = y.reshape(len(y), -1)
        return [
            (
                self._scaling.scale_u(u[part], self.input_delay_),
                self._scaling.scale_y(y[part]),
            )
            for part in parts
        ]

    def _watch(self):
        """Return what follows the fit: its clock, its history, its progress."""
        if not self.verbose:
            return Watch(max_time=self.max_time)
        progress = Progress(type(self).__name__, every_step=self.verbose > 1)
        return Watch(
            max_time=self.max_time, report=progress.step, report_end=progress.end
        )
