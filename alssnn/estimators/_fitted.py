"""What a fitted model has: the contract between `StateSpaceModel` and its mixins."""

from collections.abc import Callable

import numpy as np
from sklearn.utils import Bunch

from ..containers import Container
from ..linearizability import Region
from ..orders import Orders
from ..scaling import Scaling
from ..structures import Structure
from ..watch import Step


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

    _plant: Callable  # Lur'e form in the user's units, and (K, k) of h = K w + k
    _h: Callable  # the network h in the user's units
    _test_data: Callable  # checked (u, y) and the samples of every experiment
    _labeled_data: Callable  # the same, and the labels of the experiments
    _check_x0: Callable  # one initial state per experiment, in the user's units
    _simulate: Callable  # outputs of one experiment, in the user's units
    _experiments: Callable  # scaled deviations of every experiment
    _initial_state: Callable  # of one scaled experiment, in the user's units
    _window: Callable  # samples of an experiment spent on its initial state
    _units: Callable  # the user's units over those of the fit, by axis
    _scaled_bounds: Callable  # bounds of parameters, scaled
    _publish_parameters: Callable  # what follows from structure, theta and scales
    _criterion_terms: Callable  # structure with its penalties, and their weights
    _publish: Callable  # sets the public attributes from theta and a result

    @property
    def _at_rest(self):
        """Whether the training experiments begin at the operating point."""
        return self.initial_state == "rest"
