"""What a fitted model has: the contract between `StateSpaceModel` and its mixins."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from sklearn.utils import Bunch
from sklearn.utils.validation import check_is_fitted

from ..containers import Container
from ..orders import Orders
from ..plant import Plant
from ..region import Region
from ..scaling import Scaling
from ..structures import Structure
from ..watch import Step
from ._uncertainty import free_entries


@dataclass(frozen=True, eq=False)
class FittedModel:
    """Hold what a fit found, as training knows it: in scaled deviations.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Parameters.
    free : ndarray of bool of shape (n_params,)
        Which parameters nothing held.
    scaling : Scaling
        The user's units of u and y.
    x_scale : ndarray of shape (nx,)
        States of the user over states of the fit.
    x0 : ndarray of shape (n_experiments, nx)
        Initial states of the training.
    cost : float
        Mean squared error of the fit, relative to the variance of y.
    at_rest : bool
        Whether the training experiments began at the operating point.
    for_control : bool
        Whether (A, B, C) is meant for the design of a controller.
    """

    structure: Structure
    theta: np.ndarray
    free: np.ndarray
    scaling: Scaling
    x_scale: np.ndarray
    x0: np.ndarray
    cost: float
    at_rest: bool
    for_control: bool


class Fitted:
    """Declare the attributes that `fit` sets and the helpers that mixins share."""

    dt: float
    initial_state: str
    n_features_in_: int

    # The fit in scaled deviations; the public attributes are made from it.
    _structure: Structure
    _theta: np.ndarray
    _scaling: Scaling
    _region: Region
    _y_ndim: int
    integrators_: int
    _orders: Orders | None = None  # of the fit that goes on
    _decay: dict | None = None  # of the networks, as a search chose it
    _curve: dict | None = None  # of the networks, by order
    _x_scale: np.ndarray  # states of the user over states of the fit

    _made: Plant | None = None  # of `plant_`, made when it is asked for
    _make_plant: Callable
    params_: Bunch
    A_: np.ndarray
    B_: np.ndarray
    C_: np.ndarray
    D_: np.ndarray
    x0_: np.ndarray
    nx_: int
    cost_: float
    train_score_: float
    orders_: dict
    n_iter_: int
    converged_: bool
    message_: str
    history_: list[Step]
    input_delay_: np.ndarray
    output_names_: list | None
    experiments_: list
    _container: Container
    u_offset_: np.ndarray
    y_offset_: np.ndarray

    _test_data: Callable  # checked (u, y) and the samples of every experiment
    _labeled_data: Callable  # the same, and the labels of the experiments
    _check_x0: Callable  # one initial state per experiment, in the user's units
    _simulate: Callable  # outputs of one experiment, in the user's units
    _experiments: Callable  # scaled deviations of every experiment
    _initial_state: Callable  # of one scaled experiment, in the user's units
    _for_control: bool
    prepare_records: Callable
    _units: Callable  # the user's units over those of the fit, by axis
    _scaled_bounds: Callable  # bounds of parameters, scaled
    _publish_parameters: Callable  # what follows from structure, theta and scales
    _criterion_terms: Callable  # structure with its penalties, and their weights
    _publish: Callable  # sets the public attributes from theta and a result

    @property
    def plant_(self):
        """Return the fitted model as an immutable value, in the user's units."""
        check_is_fitted(self)
        if self._made is None:
            self._made = self._make_plant()
        return self._made

    @property
    def fitted_(self):
        """Return what the fit found, an immutable value in scaled deviations."""
        check_is_fitted(self)
        return FittedModel(
            structure=self._structure,
            theta=self._theta,
            free=free_entries(self, self._structure.n_params),
            scaling=self._scaling,
            x_scale=np.broadcast_to(self._x_scale, self.nx_),
            x0=self.x0_ / self._x_scale,
            cost=self.cost_,
            at_rest=self._at_rest,
            for_control=self._for_control,
        )

    @property
    def _at_rest(self):
        """Whether the training experiments begin at the operating point."""
        return self.initial_state == "rest"
