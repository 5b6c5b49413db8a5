"""What a fitted model hands to control: systems, law, observer, certificates."""

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..checks import check_option


def to_statespace(
    model, which="linear", x=None, u=None, *, disturbances=False, dt=None
):
    """Return a linear system (A, B, C, D, dt) for python-control.

    Parameters
    ----------
    model : estimator
        Fitted model.
    which : {"linear", "local"}, default="linear"
        The linear part, which for a linearizable model is what the input v of
        u = v - h(s) sees, with one input for every input that is moved; or the
        linearization of the whole model at (x, u), h and g included.
    x : array_like of shape (nx,) or None, default=None
        State of the linearization, for "local"; None means zero.
    u : array_like of shape (nu,) or None, default=None
        Its input as a deviation from `u_offset_`, for "local"; None means zero.
    disturbances : bool, default=False
        Whether the linear part has measured disturbances as further inputs, behind
        those of v; "local" always has all inputs of the record, in its order, as a
        `linear_start` must.
    dt : float or None, default=None
        Sampling time of a model in continuous time, in seconds, with inputs that are
        held; None means the linear part itself, of continuous time. A discrete model
        has its own.

    Returns
    -------
    sys : control.StateSpace
        System of deviations from the operating point, or from
        (x, u), in the user's units, with the names of the columns of the training
        data. Inputs that arrive late (`input_delay_`) carry their past as further
        states of discrete time. A local linearization is of discrete time.

    Raises
    ------
    ValueError
        If `which` is unknown, `x` or `u` has the wrong size or is given for the linear
        part, a discrete model has another `dt`, or one in continuous time has late
        inputs and no `dt`.
    """
    from ..feedback import linearize, to_statespace

    check_is_fitted(model)
    check_option("which", which, ("linear", "local"))
    plant = model.plant_ if dt is None else model.plant_.at(dt)
    if which == "local":
        return linearize(plant, x, u)
    if x is not None or u is not None:
        raise ValueError(
            "`x` and `u` must be None for the linear part, which is the same "
            "everywhere, got values. Use which='local'."
        )
    is_discrete = model.fitted_.structure.sampling is None or dt is not None
    if is_discrete:
        plant = plant.late()
        (A, B, C, D), given = plant.linear(), plant.disturbed_by()
    elif np.any(plant.delay):
        raise ValueError(
            "`dt` must be given for a system of this model, whose inputs arrive late "
            f"by {plant.delay.tolist()} samples, got None. Take dt={plant.dt:g}."
        )
    else:
        A, B, C, D = model.A_, model.B_, model.C_, model.D_
        given = model.G_, model.H_
    inputs = list(plant.moved)
    if disturbances:
        B, D = (np.hstack(z) for z in zip((B, D), given, strict=True))
        inputs += plant.given
    return to_statespace(
        A,
        B,
        C,
        D,
        plant.dt if is_discrete else 0,
        inputs=[plant.inputs[i] for i in inputs],
        outputs=plant.outputs,
        name=plant.name,
    )


def iss_certificate(
    model,
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
    model : estimator
        Fitted model.
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
        same way, with a number by its supremum. Where these suprema are zero, the law
        is exact, and "data" takes them, too.
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
        records = model.prepare_records(u, y, experiment)
    options = {"phi": phi, "objective": objective, "method": method}
    return certify_iss(model.plant_, records, K=K, eps=eps, **options)
