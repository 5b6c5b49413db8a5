"""What a fitted model hands to control: systems, law, observer, certificates."""

from sklearn.utils.validation import check_is_fitted

from ._fitted import Fitted


class ControlMixin(Fitted):
    """Share the way from a fitted model to a closed loop.

    All methods take `plant_`; what does the work is imported when it is called, so
    that identification needs no package for control.
    """

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
            data. Inputs that arrive late (`input_delay_`) carry their past as further
            states.

        Raises
        ------
        ValueError
            If `which` is unknown, or `x` or `u` has the wrong size or is given for
            the linear part.
        """
        from ..feedback import linearize, to_statespace

        check_is_fitted(self)
        if which not in ("linear", "local"):
            raise ValueError(f"`which` must be 'linear' or 'local', got {which!r}.")
        if which == "local":
            return linearize(self.plant_, x, u)
        if x is not None or u is not None:
            raise ValueError(
                "`x` and `u` must be None for the linear part, which is the same "
                "everywhere, got values. Use which='local'."
            )
        plant = self.plant_.late()
        A, B, C, D = plant.linear()
        return to_statespace(
            A,
            B,
            C,
            D,
            plant.dt,
            inputs=plant.inputs,
            outputs=plant.outputs,
            name=plant.name,
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
        from ..feedback import to_nlsys

        return to_nlsys(self.plant_)

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

        return LinearizingLaw(self.plant_, u_min, u_max)

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

        return Observer(self.plant_, Q, R, kind)

    def mpc(self, horizon=20, Q=None, R=None, **options):
        """Return a predictive controller of the linearized loop (eq. mpc).

        Parameters
        ----------
        horizon : int, default=20
            Number of samples that are planned.
        Q : array_like of shape (nx, nx) or None, default=None
            Weight of the states; None weighs the outputs.
        R : array_like of shape (nu, nu) or None, default=None
            Weight of v.
        **options : dict
            Limits and other options of `mpc.LinearizingMPC`, such as ``u_min``.

        Returns
        -------
        mpc : LinearizingMPC
            The controller, at the operating point.

        Raises
        ------
        ValueError
            If an option is out of range, or v does not reach an unstable mode.
        """
        from ..mpc import LinearizingMPC

        return LinearizingMPC(self.plant_, horizon, Q, R, **options)

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

        The loop is u = v - h, with v = r - K x if `K` is given,
        x+ = (A - B K) x + B r + omega, y = (C - D K) x + D r + eta (eq. eta). Past
        values of late inputs are states behind those of `A_`.

        Parameters
        ----------
        u : array_like of shape (N, nu) or None, default=None
            Inputs of the records that bound omega and eta; needed for eps="data".
        y : array_like of shape (N,) or (N, ny) or None, default=None
            Outputs; they set the initial states.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        K : array_like of shape (nu, nx) or None, default=None
            State feedback, in the basis of `A_` and the units of u; with late inputs
            also of shape (nu, nx + n_late), else it does not act on past inputs.
        phi : float or None, default=None
            Rate, between 0 and 1; None searches it.
        objective : {"peak", "feasible", "volume"}, default="peak"
            What the search of phi minimizes, see `certificates.iss_certificate`.
        eps : {"data", "global"} or float, default="data"
            Bound on ``|omega|``: the largest value along the records, in the open loop
            and in the closed one with the recorded input as r; the supremum over all
            states and inputs, which tanh bounds; or a number. eta is bounded in the
            same way, with a number by its supremum.
        method : {"lyapunov", "sdp"}, default="lyapunov"
            How P is found for each phi.

        Returns
        -------
        certificate : IssCertificate
            The certificate, in the basis of `A_`; one that does not hold says why.

        Raises
        ------
        ValueError
            If an argument is out of range, the records are missing, or u = v - h is no
            law of this model (`plant_.no_law`).
        RuntimeError
            If the solver of the semidefinite program breaks down.
        """
        from ..certificates import certify_iss

        records = None
        if u is not None and y is not None:
            records = self.prepare_records(u, y, experiment)
        options = {"phi": phi, "objective": objective, "method": method}
        return certify_iss(self.plant_, records, K=K, eps=eps, **options)

    def gain_certificate(self, K=None):
        """Certify the incremental l2 gain of the linearized loop (eq. slopes).

        The loop is u = v - h, with v = r - K x if `K` is given; the gain is that from
        v, or r, to y.

        Parameters
        ----------
        K : array_like of shape (nu, nx) or None, default=None
            State feedback, in the basis of `A_` and the units of u; with late inputs
            also of shape (nu, nx + n_late), else it does not act on past inputs.

        Returns
        -------
        certificate : GainCertificate
            The smallest gain that slope multipliers prove, in units of y per unit of
            u; one that does not hold says why.

        Raises
        ------
        ValueError
            If `K` has the wrong shape, or u = v - h is no law of this model.
        """
        from ..certificates import certify_gain

        return certify_gain(self.plant_, K)
