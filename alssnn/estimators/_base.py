"""What all estimators share: data, simulation, scores, exports."""

import time
import warnings
from abc import ABCMeta, abstractmethod
from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin, _fit_context
from sklearn.exceptions import ConvergenceWarning
from sklearn.metrics import r2_score
from sklearn.utils import Bunch
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.validation import check_is_fitted, validate_data

from ..experiments import Scaling, split_experiments
from ..linearizability import Region, measure
from ..lure import Lure
from ..simulation import channels, simulate
from ..structures import Structure
from ..training import estimate_x0

POSITIVE = Interval(Integral, 1, None, closed="left")
WEIGHT = Interval(Real, 0, None, closed="left")


class StateSpaceModel(
    MultiOutputMixin, RegressorMixin, BaseEstimator, metaclass=ABCMeta
):
    """Share data handling, simulation, scores and exports of all models."""

    # The fit in scaled deviations; the public attributes are made from it.
    _structure: Structure
    _theta: np.ndarray
    _scaling: Scaling
    _region: Region
    converged_: bool
    n_iter_: int
    _for_control = True  # whether (A, B, C) is meant for the design of a controller

    _parameter_constraints: ClassVar[dict] = {
        "nx": [POSITIVE, StrOptions({"auto"})],
        "operating_point": [StrOptions({"mean", "zero"}), tuple],
        "dt": [Interval(Real, 0, None, closed="neither")],
        "max_iter": [POSITIVE],
        "tol": [Interval(Real, 0, None, closed="neither")],
        "n_init_samples": [POSITIVE],
        "verbose": ["verbose"],
    }

    # -- fit -------------------------------------------------------------------------

    @_fit_context(prefer_skip_nested_validation=True)
    def fit(self, u, y, experiment=None):
        """Identify the model from records.

        Parameters
        ----------
        u : array_like of shape (N, nu)
            Inputs; time runs down the rows.
        y : array_like of shape (N,) or (N, ny)
            Outputs.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample; the samples of one experiment
            are contiguous. None means one experiment.

        Returns
        -------
        self : object
            The fitted model.

        Raises
        ------
        ValueError
            If lengths differ, values are not finite, an input is constant, labels
            are not contiguous, or the record is too short for the order.
        """
        if isinstance(self.operating_point, tuple) and len(self.operating_point) != 2:
            raise ValueError(
                "`operating_point` must be 'mean', 'zero' or a pair (u_e, y_e), got "
                f"a tuple of {len(self.operating_point)}."
            )
        y_names = getattr(y, "columns", None)
        if y_names is None and getattr(y, "name", None) is not None:
            y_names = [y.name]
        u, y = self._validate(u, y, reset=True)
        warm = getattr(self, "warm_start", False) and hasattr(self, "_theta")
        if not warm:
            columns = y.reshape(len(y), -1)
            self._scaling = Scaling.from_data(u, columns, self.operating_point)
        parts, self.experiments_ = split_experiments(len(u), experiment)
        experiments = self._experiments(u, y, parts)
        self._y_ndim = y.ndim
        self.output_names_ = None if y_names is None else [str(n) for n in y_names]
        previous = (self._structure, self._theta) if warm else None
        self._structure, self._theta, result = self._identify(experiments, previous)
        self._publish(result)
        self._region = self._training_region(experiments)
        self._warn_if_unstable()
        if not self.converged_:
            warnings.warn(
                f"{type(self).__name__} stopped after {self.n_iter_} trial steps "
                f"before the cost settled to tol={self.tol}. Increase `max_iter` or "
                "`tol`, or continue with `warm_start=True`.",
                ConvergenceWarning,
                stacklevel=2,
            )
        return self

    def _warn_if_unstable(self):
        radius = np.abs(np.linalg.eigvals(self.A_)).max()
        if radius < 1 or not self._for_control:
            return
        # a kind of failed training: filtered with its other warnings
        warnings.warn(
            f"The linear part of {type(self).__name__} is unstable, spectral radius "
            f"{radius:.6g}: with h cancelled the loop diverges unless a controller "
            "stabilizes it. Unless the plant is unstable itself, try gamma_h=1e-4, "
            "another `nx`, or `AlSsnn` with stability='contractive'.",
            ConvergenceWarning,
            stacklevel=4,
        )

    @abstractmethod
    def _identify(self, experiments, previous):
        """Return structure, theta and result for scaled experiments."""

    def _publish(self, result):
        """Set the fitted attributes, in the user's units."""
        scaling, structure = self._scaling, self._structure
        p = {**structure.constants, **structure.split(self._theta)}
        p = structure.rescale(p, {"u": scaling.u_scale, "y": scaling.y_scale})
        self.params_ = Bunch(**p)
        self.A_, self.B_, self.C_ = p["A"], p["B"], p["C"]
        self.D_ = np.zeros((len(self.C_), self.B_.shape[1]))
        self.nx_ = len(self.A_)
        self.x0_ = result.x0
        self.cost_ = float(result.cost)
        self.n_iter_ = int(result.nfev)
        self.converged_ = bool(result.success)
        self.u_offset_, self.y_offset_ = scaling.u_offset, scaling.y_offset

    def _validate(self, u, y, reset):
        return validate_data(
            self,
            u,
            y,
            reset=reset,
            dtype=np.float64,
            multi_output=True,
            y_numeric=True,
            ensure_min_samples=2 if reset else 1,
        )

    def _experiments(self, u, y, parts):
        """Return scaled deviations of every experiment."""
        u = self._scaling.scale_u(u)
        y = self._scaling.scale_y(y.reshape(len(y), -1))
        return [(u[part], y[part]) for part in parts]

    def _reporter(self):
        """Return the progress callback: every tenth step, or each if verbose > 1."""
        if not self.verbose:
            return None
        start, name = time.perf_counter(), type(self).__name__

        def report(label, iteration, cost):
            if self.verbose > 1 or iteration % 10 == 0:
                seconds = time.perf_counter() - start
                print(
                    f"{name:16s} {label:12s} {iteration:5d}  cost {cost:.6e} "
                    f"{seconds:7.1f} s",
                    flush=True,
                )

        return report

    # -- simulation ------------------------------------------------------------------

    def predict(self, u, experiment=None, x0=None):
        """Simulate the output, free-run.

        Parameters
        ----------
        u : array_like of shape (N, nu)
            Inputs.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        x0 : array_like of shape (nx,) or (n_experiments, nx) or None, default=None
            Initial states, as `estimate_x0` returns them; None starts at the
            operating point, x0 = 0.

        Returns
        -------
        y : ndarray of shape (N,) or (N, ny)
            Simulated outputs, with as many dimensions as the `y` of `fit`. Not
            finite where the simulation diverges, with a warning.

        Raises
        ------
        ValueError
            If `u` or `x0` has the wrong size.
        """
        check_is_fitted(self)
        u = validate_data(self, u, reset=False, dtype=np.float64)
        parts, _ = split_experiments(len(u), experiment)
        u_s = self._scaling.scale_u(u)
        lure = self._structure.lure(self._theta)
        y = np.empty((len(u), len(self.C_)))
        for part, start in zip(parts, self._check_x0(x0, len(parts)), strict=True):
            X = simulate(lure, u_s[part], start)
            y[part] = _outputs(lure, X, u_s[part], y.shape[1])
        if not np.isfinite(y).all():
            bad = int(np.argmin(np.isfinite(y).all(axis=1)))
            warnings.warn(
                f"The simulation diverges before sample {bad + 1}. Keep `u` in the "
                "range of the training data or fit a more strongly penalized model.",
                RuntimeWarning,
                stacklevel=2,
            )
        y = y * self._scaling.y_scale + self._scaling.y_offset
        return y[:, 0] if self._y_ndim == 1 else y

    def _check_x0(self, x0, n_experiments):
        if x0 is None:
            return np.zeros((n_experiments, self.nx_))
        x0 = np.asarray(x0, dtype=float)
        if x0.shape not in [(self.nx_,), (n_experiments, self.nx_)]:
            raise ValueError(
                f"`x0` must have shape ({self.nx_},) or ({n_experiments}, {self.nx_})"
                f", got {x0.shape}. Use `estimate_x0`."
            )
        return np.broadcast_to(x0, (n_experiments, self.nx_))

    def estimate_x0(self, u, y, experiment=None, n_samples=None):
        """Estimate the initial state of every experiment from its first samples.

        Parameters
        ----------
        u : array_like of shape (N, nu)
            Inputs.
        y : array_like of shape (N,) or (N, ny)
            Outputs.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        n_samples : int or None, default=None
            Number of first samples to use; None means the parameter
            `n_init_samples`.

        Returns
        -------
        x0 : ndarray of shape (n_experiments, nx)
            States at the first sample of every experiment: least squares, with
            states of unit variance as prior where the samples say little.
        """
        check_is_fitted(self)
        u, y = self._validate(u, y, reset=False)
        parts, _ = split_experiments(len(u), experiment)
        return np.vstack(
            [
                self._initial_state(u_s, y_s, n_samples or self.n_init_samples)
                for u_s, y_s in self._experiments(u, y, parts)
            ]
        )

    def _initial_state(self, u_s, y_s, window):
        """Return the state at the first sample of one scaled experiment."""
        noise = self.cost_  # outputs are scaled to unit variance, as states are
        return estimate_x0(
            self._structure, self._theta, [(u_s, y_s)], window=window, noise=noise
        )[0]

    def _window(self, u_s):
        """Return how many samples of an experiment are spent on its initial state."""
        return min(self.n_init_samples, len(u_s) // 4)

    def score(self, u, y, experiment=None):
        """Return R2 of the free-run simulation.

        The initial state of every experiment is estimated from its first
        `n_init_samples` samples (at most a quarter of it), which are not scored.

        Parameters
        ----------
        u : array_like of shape (N, nu)
            Inputs.
        y : array_like of shape (N,) or (N, ny)
            Outputs.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.

        Returns
        -------
        score : float
            Coefficient of determination, averaged over the outputs; -inf if the
            simulation diverges.
        """
        y_true, y_pred = self.simulate_test(u, y, experiment)
        if not np.isfinite(y_pred).all():
            return -np.inf
        return float(r2_score(y_true, y_pred))

    def simulate_test(self, u, y, experiment=None):
        """Return measured and simulated outputs under the scoring policy.

        Parameters
        ----------
        u : array_like of shape (N, nu)
            Inputs.
        y : array_like of shape (N,) or (N, ny)
            Outputs.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.

        Returns
        -------
        y_true : ndarray of shape (n_scored, ny)
            Measured outputs without the samples that estimate the initial states.
        y_pred : ndarray of shape (n_scored, ny)
            Simulated outputs at the same samples.
        """
        check_is_fitted(self)
        u, y = self._validate(u, y, reset=False)
        parts, _ = split_experiments(len(u), experiment)
        lure = self._structure.lure(self._theta)
        y_true, y_pred = [], []
        for u_s, y_s in self._experiments(u, y, parts):
            window = self._window(u_s)
            x0 = self._initial_state(u_s, y_s, window)
            y_hat = _outputs(lure, simulate(lure, u_s, x0), u_s, y_s.shape[1])
            y_true.append(y_s[window:])
            y_pred.append(y_hat[window:])
        scale, offset = self._scaling.y_scale, self._scaling.y_offset
        return tuple(np.vstack(z) * scale + offset for z in (y_true, y_pred))

    # -- linearity and exports ---------------------------------------------------------

    def linearizability(self, u, y, experiment=None):
        """Measure how linear the model is once h is cancelled.

        Parameters
        ----------
        u : array_like of shape (N, nu)
            Inputs.
        y : array_like of shape (N,) or (N, ny)
            Outputs; they set the initial states and the size of the output.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.

        Returns
        -------
        record : Linearizability
            The output-referred linearization error (eq. gauge), in all and in
            frequency bands, the paper's ratios, both of the model and of the closed
            loop u = v - h with the recorded input as v, the gains of A, and the share
            of samples outside the region of the training data. It prints as a table.

        Notes
        -----
        The initial state of every experiment is estimated from its first
        `n_init_samples` samples (at most a quarter of it), which are measured as well.
        Costs four simulations.
        """
        check_is_fitted(self)
        u, y = self._validate(u, y, reset=False)
        parts, _ = split_experiments(len(u), experiment)
        lure, feedback = self._plant()
        experiments = [
            (
                u_s * self._scaling.u_scale,
                y_s * self._scaling.y_scale,
                self._initial_state(u_s, y_s, self._window(u_s)),
            )
            for u_s, y_s in self._experiments(u, y, parts)
        ]
        return measure(
            lure,
            (self.A_, self.B_, self.C_),
            feedback,
            experiments,
            dt=self.dt,
            region=self._region,
            output_names=self.output_names_,
        )

    def _plant(self):
        """Return the Lur'e form with the states x alone, and (K, k) of h = K w + k.

        Both are in the user's units; the only channel is y.
        """
        structure, scaling = self._structure, self._scaling
        full = structure.lure(self._theta)
        nx, nu, nw = structure.n_x0, full.nu, full.nw
        neurons = slice(full.nx + full.nz, len(full.Theta))
        rows = np.r_[structure.rows["x"], structure.rows["y"], neurons]
        cols = np.r_[structure.cols["x"], slice(full.nx, full.Theta.shape[1])]
        Theta = full.Theta[np.ix_(rows, cols)]
        Theta[:, nx : nx + nu] /= scaling.u_scale
        Theta[nx : nx + len(self.C_)] *= scaling.y_scale[:, None]
        K, k = np.zeros((nu, nw)), np.zeros(nu)
        if "W_h" in self.params_:
            _, axis = structure.parameters["W_h"]
            first = structure.cols["u"].stop
            where = structure.cols[axis]
            K[:, where.start - first : where.stop - first] = self.params_["W_h"]
            k = self.params_["b_h"]
        return Lure(Theta, nx, nu, nw), (K, k)

    def _training_region(self, experiments):
        """Return the region that simulations of the scaled experiments cover."""
        lure, _ = self._plant()
        u_scale, y_scale = self._scaling.u_scale, self._scaling.y_scale
        u = np.vstack([u_s for u_s, _ in experiments]) * u_scale
        y = np.vstack([y_s for _, y_s in experiments]) * y_scale
        X = np.vstack(
            [
                simulate(lure, u_s * u_scale, x0)[:-1]
                for (u_s, _), x0 in zip(experiments, self.x0_, strict=True)
            ]
        )
        return Region.of(X, u, X @ self.C_.T, y)

    def to_statespace(self, which="linear", x=None, u=None):
        """Return a linear system (A, B, C, D, dt) for python-control.

        Parameters
        ----------
        which : {"linear", "local"}, default="linear"
            The linear part, which for a linearizable model is what the input v of
            u = v - h(s) sees; or the linearization of the whole model at (x, u),
            h and g included.
        x : array_like of shape (nx,) or None, default=None
            State of the linearization, for "local"; None means zero.
        u : array_like of shape (nu,) or None, default=None
            Its input as a deviation from `u_offset_`, for "local"; None means zero.

        Returns
        -------
        sys : control.StateSpace
            Discrete-time system of deviations from the operating point, or from
            (x, u), in the user's units, with the names of the columns of the training
            data.

        Raises
        ------
        ValueError
            If `which` is unknown, or `x` or `u` has the wrong size or is given for
            the linear part.
        """
        from ..feedback import Dynamics, to_statespace

        check_is_fitted(self)
        if which not in ("linear", "local"):
            raise ValueError(f"`which` must be 'linear' or 'local', got {which!r}.")
        if which == "local":
            return Dynamics.of(self).linearize(x, u)
        if x is not None or u is not None:
            raise ValueError(
                "`x` and `u` must be None for the linear part, which is the same "
                "everywhere, got values. Use which='local'."
            )
        return to_statespace(
            self.A_,
            self.B_,
            self.C_,
            self.D_,
            self.dt,
            inputs=getattr(self, "feature_names_in_", None),
            outputs=self.output_names_,
            name=type(self).__name__,
        )

    def to_nlsys(self):
        """Return the whole model for python-control.

        Returns
        -------
        sys : control.NonlinearIOSystem
            Discrete-time system from u to y in the user's units, operating point
            included, with the names of the columns of the training data. From the
            same initial state it responds as `predict` does.
        """
        from ..feedback import Dynamics

        return Dynamics.of(self).to_nlsys()

    def linearizing_law(self, u_min=None, u_max=None):
        """Return the law u = v - h(s) that leaves the linear part.

        Parameters
        ----------
        u_min : float, array_like of shape (nu,) or None, default=None
            Lower limits of the actuators, in the units of u; None means no limit.
        u_max : float, array_like of shape (nu,) or None, default=None
            Upper limits of the actuators, in the units of u.

        Returns
        -------
        law : LinearizingLaw
            Callable ``law(v, s)``; s is the measured y with output feedback, the
            estimated state with state feedback. The identity for a model without h.
        """
        from ..feedback import LinearizingLaw

        return LinearizingLaw(self, u_min, u_max)

    def observer(self, Q=None, R=None, kind="kalman"):
        """Return an observer of the state.

        Parameters
        ----------
        Q : array_like of shape (nx, nx) or None, default=None
            Covariance of the process noise per sample; None means 1e-4 times the
            identity.
        R : array_like of shape (ny, ny) or None, default=None
            Covariance of the measurement noise, in the units of y; None takes the
            variance that the fit leaves.
        kind : {"kalman", "ekf"}, default="kalman"
            Constant gain, or extended Kalman filter; both predict by the whole model.

        Returns
        -------
        observer : Observer
            The observer, at the operating point.
        """
        from ..feedback import Observer

        return Observer(self, Q, R, kind)

    # -- certificates ----------------------------------------------------------------

    def iss_certificate(
        self,
        u=None,
        y=None,
        experiment=None,
        *,
        K=None,
        phi=None,
        objective="peak",
        eps="data",
        method="lyapunov",
    ):
        """Certify input-to-state stability of the linearized loop (eq. lmi).

        The loop is u = v - h, with v = r - K x if `K` is given. Its states obey
        x+ = (A - B K) x + B r + omega, omega = g(x, u).

        Parameters
        ----------
        u : array_like of shape (N, nu) or None, default=None
            Inputs of the records that bound omega; needed for eps="data".
        y : array_like of shape (N,) or (N, ny) or None, default=None
            Outputs; they set the initial states.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        K : array_like of shape (nu, nx) or None, default=None
            State feedback, in the basis of `A_` and the units of u.
        phi : float or None, default=None
            Rate, between 0 and 1; None searches it.
        objective : {"peak", "feasible", "volume"}, default="peak"
            What the search of phi minimizes, see `certificates.iss_certificate`.
        eps : {"data", "global"} or float, default="data"
            Bound on ``|omega|``: the largest value along the records, in the open loop
            and in the closed one with the recorded input as r; the supremum over all
            states and inputs, which tanh bounds; or a number.
        method : {"lyapunov", "sdp"}, default="lyapunov"
            How P is found for each phi.

        Returns
        -------
        certificate : IssCertificate
            The certificate, in the basis of `A_`; one that does not hold says why.

        Raises
        ------
        ValueError
            If an argument is out of range or the records are missing.
        RuntimeError
            If the solver of the semidefinite program breaks down.
        """
        from ..certificates import data_bound, global_bound, iss_certificate

        check_is_fitted(self)
        K = self._check_gain(K)
        A = self.A_ if K is None else self.A_ - self.B_ @ K
        if isinstance(eps, str):
            lure, feedback = self._plant()
            if eps == "global":
                eps = global_bound(lure, self.B_, feedback)
            elif eps == "data":
                records = self._records(u, y, experiment)
                eps = data_bound(lure, self.B_, feedback, records, K)
            else:
                raise ValueError(
                    f"`eps` must be 'data', 'global' or a number, got {eps!r}. "
                    "Choose one."
                )
        return iss_certificate(
            A, self.C_, eps=eps, phi=phi, objective=objective, method=method
        )

    def gain_certificate(self, K=None):
        """Certify the incremental l2 gain of the linearized loop (eq. slopes).

        The loop is u = v - h, with v = r - K x if `K` is given; the gain is that from
        v, or r, to y.

        Parameters
        ----------
        K : array_like of shape (nu, nx) or None, default=None
            State feedback, in the basis of `A_` and the units of u.

        Returns
        -------
        certificate : GainCertificate
            The smallest gain that slope multipliers prove, in units of y per unit of
            u; one that does not hold says why.

        Raises
        ------
        ValueError
            If `K` has the wrong shape.
        RuntimeError
            If the solver breaks down.
        """
        from ..certificates import gain_certificate, state_feedback

        check_is_fitted(self)
        K = self._check_gain(K)
        lure, feedback = self._plant()
        loop = lure.close(*feedback)
        return gain_certificate(loop if K is None else state_feedback(loop, K))

    def _check_gain(self, K):
        if K is None:
            return None
        K = np.asarray(K, dtype=float)
        if K.shape != self.B_.T.shape or not np.isfinite(K).all():
            raise ValueError(
                f"`K` must be a finite matrix of shape {self.B_.T.shape}, got shape "
                f"{K.shape}. It acts on the states of `A_`."
            )
        return K

    def _records(self, u, y, experiment):
        """Return (u, x0) of every experiment, in the user's units."""
        if u is None or y is None:
            raise ValueError(
                "`u` and `y` must be given for eps='data', got None. Pass records, or "
                "eps='global'."
            )
        u, y = self._validate(u, y, reset=False)
        parts, _ = split_experiments(len(u), experiment)
        return [
            (
                u_s * self._scaling.u_scale,
                self._initial_state(u_s, y_s, self._window(u_s)),
            )
            for u_s, y_s in self._experiments(u, y, parts)
        ]

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        # a strictly proper dynamical system cannot fit shuffled static data
        tags.regressor_tags.poor_score = True
        tags.non_deterministic = False
        return tags


def _outputs(lure, X, u, ny):
    """Return y of simulated states; not finite where they diverged."""
    with np.errstate(over="ignore", invalid="ignore"):
        return channels(lure, X, u)[:, :ny]
