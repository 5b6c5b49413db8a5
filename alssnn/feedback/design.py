"""Gains for the linear part (A, B, C), by python-control.

The law u = v - h(s) leaves x+ = A x + B dv, y = C x + D dv + y_offset with dv = v -
u_offset and D mostly zero, for which these functions compute v = ... - K x_hat.  All
matrices are in the user's units.  They check what python-control would only fail on:
that v reaches every state that must be moved (the test of Popov, Belevitch and Hautus).

`balanced_weights` weighs every signal by its size in the training data (Bryson's rule),
so that weights of one are a fair start whatever the units.
"""

import control
import numpy as np

from ..plants import as_plant
from .checks import check_weight

SEMIDEFINITE = 1e-9  # negative eigenvalue, relative, that counts as rounding
CONTROLLABLE = 1e-9  # smallest singular value, relative, of [A - lambda I, B]


def lqr(model, Q, R, N=None):
    """Return the gain of the linear-quadratic regulator.

    It minimizes the sum of x' Q x + v' R v + 2 x' N v by v = -K x (deviations).

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    Q : array_like of shape (nx, nx)
        Weight of the states; ``C_.T @ Qy @ C_`` weighs the outputs of a model without
        feedthrough, `weigh_outputs` those of any.
    R : array_like of shape (nu, nu)
        Weight of the inputs v.
    N : array_like of shape (nx, nu) or None, default=None
        Weight of states times inputs; None means zero.

    Returns
    -------
    K : ndarray of shape (nu, nx)
        Gain; give it to `closed_loop`.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If a weight, or all of them as [Q N; N' R], is not positive (semi)definite or
        has the wrong size, or (A, B) has an uncontrollable unstable mode.

    See Also
    --------
    lqi : The same with integrators, for references without offset.
    weigh_outputs : Weights for y instead of x.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.feedback import lqr
    >>> K = lqr(model, model.C_.T @ model.C_, np.eye(1))
    >>> K.shape, bool(abs(np.linalg.eigvals(model.A_ - model.B_ @ K)).max() < 1)
    ((1, 4), True)
    """
    plant = as_plant(model).late()
    A, B, _, _ = plant.linear()
    return _regulator(A, B, Q, R, N, plant.x_scale)


def weigh_outputs(model, Q, R):
    """Return the weights of `lqr` that weigh outputs, feedthrough included.

    With y = C x + D v, y' Q y + v' R v has cross terms,

        x' C'Q C x + v' (R + D'Q D) v + 2 x' C'Q D v.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    Q : array_like of shape (ny, ny)
        Weight of the outputs.
    R : array_like of shape (nu, nu)
        Weight of the inputs v.

    Returns
    -------
    Q : ndarray of shape (nx, nx)
        Weight of the states.
    R : ndarray of shape (nu, nu)
        Weight of the inputs.
    N : ndarray of shape (nx, nu)
        Weight of states times inputs, zero without D. The cost of `lqi` has the same
        ones in the rows and columns of its states.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If a weight is not positive (semi)definite or has the wrong size.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.feedback import lqr, weigh_outputs
    >>> lqr(model, *weigh_outputs(model, np.eye(1), np.eye(1))).shape
    (1, 4)
    """
    _, B, C, D = as_plant(model).late().linear()
    Q = check_weight("Q", Q, len(C))
    R = check_weight("R", R, B.shape[1], definite=True)
    return C.T @ Q @ C, R + D.T @ Q @ D, C.T @ Q @ D


def lqi(model, Q, R, N=None):
    """Return the gain of the linear-quadratic regulator with integrators.

    The state x is augmented by z+ = z + y - r with y = C x + D v, the sum of the
    tracking error, so that y settles at a constant reference without offset;
    v = -K [x; z].

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    Q : array_like of shape (nx + ny, nx + ny)
        Weight of the states and of the integrators (in the units of y).
    R : array_like of shape (nu, nu)
        Weight of the inputs v.
    N : array_like of shape (nx + ny, nu) or None, default=None
        Weight of states and integrators times inputs, as for `lqr`.

    Returns
    -------
    K : ndarray of shape (nu, nx + ny)
        Gain of states and integrators; give it to `closed_loop`.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If a weight, or all of them as [Q N; N' R], is not positive (semi)definite or
        has the wrong size, or v cannot move every output to a constant reference.

    See Also
    --------
    lqr : The same without integrators.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.feedback import lqi
    >>> lqi(model, np.eye(5), np.eye(1)).shape  # four states, one integrator
    (1, 5)
    """
    plant = as_plant(model).late()
    A, B, C, D = plant.linear()
    nx, (ny, nu) = len(A), D.shape
    if ny > nu:
        raise ValueError(
            f"`model` must have at most as many outputs as inputs, got {ny} outputs "
            f"and {nu} inputs. Identify a model of the outputs that have a reference."
        )
    A, B = np.block([[A, np.zeros((nx, ny))], [C, np.eye(ny)]]), np.vstack([B, D])
    return _regulator(A, B, Q, R, N, np.append(plant.x_scale, plant.y_scale))


def place(model, poles):
    """Return the gain that places the poles of the linear loop.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    poles : array_like of shape (nx,)
        Eigenvalues of A - B K, complex ones in conjugate pairs; stable inside the
        unit circle. None may occur more than nu times.

    Returns
    -------
    K : ndarray of shape (nu, nx)
        Gain; give it to `closed_loop`.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If the number of poles is wrong, they are repeated too often or not in
        conjugate pairs, or (A, B) is not controllable.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.feedback import place
    >>> K = place(model, [0.5, 0.6, 0.7, 0.8])
    >>> np.sort(np.linalg.eigvals(model.A_ - model.B_ @ K).real).round(6)
    array([0.5, 0.6, 0.7, 0.8])
    """
    plant = as_plant(model).late()
    A, B, _, _ = plant.linear()
    poles = np.asarray(poles)
    if poles.shape != (len(A),):
        raise ValueError(
            f"`poles` must have shape ({len(A)},), got {poles.shape}. Give one pole "
            "per state."
        )
    x_scale, v_scale = plant.x_scale, plant.v_scale
    _check_controllable(A, B, x_scale, radius=0.0)
    if not np.isfinite(poles).all():
        raise ValueError(f"`poles` must be finite, got {poles}. Give numbers.")
    A, B = A * x_scale / x_scale[:, None], B * v_scale / x_scale[:, None]
    try:  # in units in which all signals are of one size
        return v_scale[:, None] * np.asarray(control.place(A, B, poles)) / x_scale
    except ValueError as error:
        raise ValueError(
            "`poles` must come in conjugate pairs, none more often than nu = "
            f"{B.shape[1]} times, got {poles}. Move them apart."
        ) from error


def balanced_weights(model, *, state=0.0, output=1.0, integral=0.01, control=1.0):
    """Return weights of `lqi` for signals of the size of the training data.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    state : float, default=0.0
        Weight of the states, each scaled to the variance one that it had at the linear
        start.
    output : float, default=1.0
        Weight of the outputs, each over its standard deviation.
    integral : float, default=0.01
        Weight of the integrators, sums over samples of scaled outputs. Larger is
        faster.
    control : float, default=1.0
        Weight of v, over the standard deviation of u. Smaller is faster.

    Returns
    -------
    Q : ndarray of shape (nx + ny, nx + ny)
        Weight of states and integrators, in the user's units.
    R : ndarray of shape (nu, nu)
        Weight of v.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If a weight is negative or not finite, or that of the integrators or of v is
        zero.

    See Also
    --------
    lqi : The gain for these weights.
    weigh_outputs : Weights of outputs of a model with feedthrough.

    Notes
    -----
    The outputs are weighed by C'C: of y = C x + D v only what the states make of it
    counts. With a large D give `lqi` the cross terms of `weigh_outputs` instead.

    Examples
    --------
    >>> from alssnn.feedback import balanced_weights, lqi
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(record.u, record.y)
    >>> lqi(model, *balanced_weights(model)).shape
    (1, 5)
    """
    weights = {
        "state": state,
        "output": output,
        "integral": integral,
        "control": control,
    }
    for name, weight in weights.items():
        needed = name in ("integral", "control")
        if not (np.isfinite(weight) and (weight > 0 if needed else weight >= 0)):
            sign = "positive" if needed else "nonnegative"
            raise ValueError(
                f"`{name}` must be {sign} and finite, got {weight}. One weighs a "
                "signal of its usual size."
            )
    plant = as_plant(model).late()
    C = plant.linear()[2]
    nx, ny = plant.nx, plant.ny
    Q = np.zeros((nx + ny, nx + ny))
    weighted = np.sqrt(output) * C / plant.y_scale[:, None]
    Q[:nx, :nx] = weighted.T @ weighted
    own = np.arange(nx - plant.n_late)  # the past of late inputs is weighed as v is
    Q[own, own] += state / plant.x_scale[own] ** 2
    Q[nx:, nx:] = np.diag(integral / plant.y_scale**2)
    return Q, np.diag(control / plant.v_scale**2)


def _regulator(A, B, Q, R, N, x_size):
    """Return the gain for x+ = A x + B v, of states of given sizes."""
    Q = check_weight("Q", Q, len(A))
    R = check_weight("R", R, B.shape[1], definite=True)
    N = np.zeros(B.shape) if N is None else _check_cross(Q, R, N)
    _check_controllable(A, B, x_size, radius=1.0)
    # in units that give R a diagonal near one: those of u do not matter
    size = 2.0 ** np.round(np.log2(np.diag(R)) / 2)
    try:
        K, _, _ = control.dlqr(A, B / size, Q, R / np.outer(size, size), N / size)
    except np.linalg.LinAlgError as error:
        raise ValueError(
            "`Q` and `R` must give a stable loop, got a Riccati equation without "
            "solution. Weigh every state in `Q`, or make the weights more alike."
        ) from error
    return np.asarray(K) / size[:, None]


def _check_cross(Q, R, N):
    """Return the weight of states times inputs."""
    shape, N = (len(Q), len(R)), np.asarray(N, dtype=float)
    if N.shape != shape or not np.isfinite(N).all():
        raise ValueError(
            f"`N` must be finite and have shape {shape}, got shape {N.shape}. Use "
            "`weigh_outputs`."
        )
    # in units that make R the identity
    root = np.linalg.inv(np.linalg.cholesky(R))
    rest = Q - (N @ root.T) @ (N @ root.T).T
    size = max(np.abs(Q).max(), np.finfo(float).tiny)
    if np.linalg.eigvalsh(rest).min() < -SEMIDEFINITE * size:
        raise ValueError(
            "`N` must leave [Q N; N' R] positive semidefinite, got a cost that falls "
            "without limit. Use `weigh_outputs`, or a smaller one."
        )
    return N


def _check_controllable(A, B, x_size, radius):
    """Refuse modes from a radius on that B does not reach; states have given sizes."""
    A, B = A * x_size / x_size[:, None], B / x_size[:, None]
    size = np.linalg.norm(B, axis=0)
    B = B / np.where(size > 0, size, 1.0)  # the units of u do not matter
    for mode in np.linalg.eigvals(A):
        if abs(mode) < radius - CONTROLLABLE:
            continue
        pencil = np.hstack([A - mode * np.eye(len(A)), B])
        values = np.linalg.svd(pencil, compute_uv=False)
        if values[-1] <= CONTROLLABLE * values[0]:
            raise ValueError(
                "`model` must have a controllable pair (A, B), got a mode "
                f"{mode:.6g} that v does not reach. Lower `nx`, or leave out the "
                "outputs that the inputs do not move."
            )
