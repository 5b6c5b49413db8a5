"""An observer that also estimates a constant disturbance, for control without offset.

A constant d is added to the output or to the input of the whole model,

    x+ = f(x, u),  y = C x + d        or        x+ = f(x, u + d),  y = C x

with d+ = d, and estimated together with x: what is left at rest between model and plant
ends up in d, so that a controller that takes d into account settles at its reference.

A model that was fitted with a `drift` has identified d, and the gain that belongs to it
(eq. drift).
"""

import numpy as np
from scipy.linalg import block_diag

from ..checks import check_option
from .checks import check_weight
from .observer import Observer, process_noise

RANK = 1e-9  # smallest singular value, relative, of what must have full rank


class DisturbanceObserver(Observer):
    """Estimate state and constant disturbance of an identified model.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    Q : array_like of shape (nx, nx) or None, default=None
        Covariance of the process noise per sample, as for `Observer`.
    R : array_like of shape (ny, ny) or None, default=None
        Covariance of the measurement noise, as for `Observer`.
    disturbance : {"output", "input"} or None, default=None
        Whether d is added to y or to u. None means the `drift` that the model was
        fitted with. Without one it is "output", and "input" where the outputs do not
        tell that from the state, as in a model that integrates.
    Q_d : array_like of shape (nd, nd) or None, default=None
        Covariance of the change of d per sample, in the units of y or u squared. None
        means that d drifts by a hundredth of the standard deviation of the training
        data per sample; or, where a drift of this kind was identified, that of K_b eps,
        and with `Q` and `R` left out the gain is the identified one.
    gate : float or None, default=None
        Largest innovation that corrects the estimate in full, as for `Observer`.

    Attributes
    ----------
    disturbance : str
        Kind of disturbance.
    x_hat : ndarray of shape (nx + nd,)
        Current estimate of [x; d].

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If `disturbance` is unknown, a covariance is not one of the right size, or the
        outputs do not tell the disturbance from the state.

    See Also
    --------
    Observer : The same without disturbance.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(record.u, record.y)
    >>> alssnn.feedback.DisturbanceObserver(model).filter(record.u, record.y).shape
    (1500, 5)
    """

    def __init__(self, model, Q=None, R=None, disturbance=None, Q_d=None, gate=None):
        super().__init__(model, Q, R, gate=gate)
        is_free = Q is None and R is None and Q_d is None
        if disturbance is None:
            output = self.plant.with_disturbance("output")
            disturbance = self.plant.drift or ("output" if _tells(output) else "input")
        remedy = "Use 'input' if the model integrates."
        check_option("disturbance", disturbance, ("output", "input"), remedy)
        self.disturbance = disturbance
        K_b = self.plant.K_b
        self.plant = plant = self.plant.with_disturbance(disturbance)
        scale = plant.y_scale if disturbance == "output" else plant.v_scale
        if Q_d is None:
            Q_d = process_noise(plant, None if plant.K is None else K_b, scale)
        Q_d = check_weight("Q_d", Q_d, len(scale), definite=True)
        self.Q = block_diag(self.Q, Q_d)
        self._start = block_diag(self._start, np.diag(scale**2))
        if not _tells(plant):
            raise ValueError(
                "`disturbance` must be visible at rest in the outputs, got a model "
                "that does not tell it from the state. If the model integrates, use "
                "'input'; if it has more inputs than outputs, use 'output'."
            )
        self._set_gain(plant.K if is_free else None)


def _tells(plant):
    """Tell whether outputs show all states at rest: the test of Hautus at 1."""
    A, _, C, _ = plant.jacobian(np.zeros(plant.nx), plant.u_offset)
    size = plant.x_scale
    A, C = A * size / size[:, None], C * size / plant.y_scale[:, None]
    values = np.linalg.svd(np.vstack([A - np.eye(len(A)), C]), compute_uv=False)
    return len(values) == len(A) and values[-1] >= RANK * values[0]
