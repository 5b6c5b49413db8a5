"""Systems of python-control from plants, with the names of the user's signals."""

import control
import numpy as np

from ..names import signal_names
from ..plants import as_plant, is_model
from .checks import check_dt, check_point


def to_statespace(A, B, C, D, dt, *, inputs=None, outputs=None, name=None):
    """Return a `control.StateSpace` with named signals.

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix.
    B : ndarray of shape (nx, nu)
        Input matrix.
    C : ndarray of shape (ny, nx)
        Output matrix.
    D : ndarray of shape (ny, nu)
        Feedthrough matrix.
    dt : float
        Sampling time, in seconds; 0 of continuous time.
    inputs, outputs : sequence of str or None, default=None
        Names of the signals.
    name : str or None, default=None
        Name of the system.

    Returns
    -------
    sys : control.StateSpace
        The system.
    """
    return control.ss(
        A,
        B,
        C,
        D,
        dt,
        inputs=signal_names(inputs, "u", B.shape[1]),
        outputs=signal_names(outputs, "y", C.shape[0]),
        states=signal_names(None, "x", A.shape[0]),
        name=name,
    )


class Block:
    """Hold a plant as the functions that python-control calls; can be pickled.

    Parameters
    ----------
    plant : Plant
        The plant, without delays (`Plant.late`).
    with_state : bool, default=False
        Whether the state follows the outputs, for loops that feed it back.
    """

    def __init__(self, plant, with_state=False):
        self.plant, self.with_state = plant, with_state

    def __repr__(self):
        """Return its plant in short; systems of python-control print it."""
        return f"Block({self.plant!r})"

    def update(self, t, x, u, params):
        """Return the next state.

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        x : ndarray of shape (nx,)
            State.
        u : ndarray of shape (nu,)
            Input, in the user's units.
        params : dict
            Not used.

        Returns
        -------
        x_next : ndarray of shape (nx,)
            State one sample later.
        """
        return self.plant.step(x, u)

    def output(self, t, x, u, params):
        """Return the output, and the state if asked for.

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        x : ndarray of shape (nx,)
            State.
        u : ndarray of shape (nu,)
            Input, in the user's units.
        params : dict
            Not used.

        Returns
        -------
        y : ndarray of shape (ny,) or (ny + nx,)
            Output in the user's units, then the state.
        """
        y = self.plant.output(x, u)
        return np.concatenate([y, x]) if self.with_state else y


def to_nlsys(model):
    """Return a plant as a system of python-control.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`; the past of late inputs becomes further states.

    Returns
    -------
    sys : control.NonlinearIOSystem
        Discrete-time system from u to y in the user's units, operating point included,
        with the names of the columns of the training data. From the same initial state
        it responds as `predict` does.
    """
    plant = as_plant(model).late()
    signals = plant.inputs, plant.outputs, signal_names(None, "x", plant.nx)
    return as_system(Block(plant), *signals, plant.dt, plant.name)


def as_system(block, inputs, outputs, states, dt, name):
    """Return an object with `update` and `output` as a system of python-control.

    Parameters
    ----------
    block : object
        The object.
    inputs, outputs : list of str
        Names of the signals.
    states : list of str or int
        Names of the states, or how many there are.
    dt : float
        Sampling time, in seconds.
    name : str
        Name of the system.

    Returns
    -------
    sys : control.NonlinearIOSystem
        Discrete-time system.
    """
    return control.nlsys(
        block.update,
        block.output,
        inputs=inputs,
        outputs=outputs,
        states=states,
        dt=dt,
        name=name,
    )


def check_plant(plant, own):
    """Return a plant as a system that fits a model, from u to y.

    Parameters
    ----------
    plant : estimator, Plant or system of python-control
        A fitted model or a discrete-time system.
    own : Plant
        Model that the controller of this plant is made from.

    Returns
    -------
    plant : control.NonlinearIOSystem
        The plant.

    Raises
    ------
    TypeError
        If it is neither a model nor a system.
    ValueError
        If sizes or sampling times do not fit, or it is continuous in time.
    """
    if is_model(plant):
        plant = to_nlsys(plant)
    if isinstance(plant, control.TransferFunction):
        plant = control.ss(plant)
    if not isinstance(plant, control.NonlinearIOSystem):
        raise TypeError(
            "`plant` must be a fitted model or a system of python-control, got "
            f"{type(plant).__name__}. Wrap it in control.nlsys."
        )
    check_dt("plant", plant, own.dt)
    sizes = plant.ninputs, plant.noutputs
    expected = own.nu, own.ny
    if sizes != expected:
        raise ValueError(
            "`plant` must have as many inputs and outputs as the model, "
            f"{expected}, got {sizes}. Identify a model of this plant."
        )
    return plant


def linearize(plant, x=None, u=None):
    """Return the linearization of a whole plant at an operating point.

    Parameters
    ----------
    plant : Plant
        The plant; the past of late inputs becomes further states.
    x : array_like of shape (nx,) or None, default=None
        State; None means the operating point of the fit, zero.
    u : array_like of shape (nu,) or None, default=None
        Deviation of the input from its operating point; None means zero.

    Returns
    -------
    sys : control.StateSpace
        Discrete-time system of deviations from (x, u).

    Raises
    ------
    ValueError
        If `x` or `u` has the wrong size.
    """
    plant = plant.late()
    x, u = check_point("x", x, plant.nx), check_point("u", u, plant.nu)
    A, B, C, D = plant.jacobian(x, plant.u_offset + u)
    names = {"inputs": plant.inputs, "outputs": plant.outputs, "name": plant.name}
    return to_statespace(A, B, C, D, plant.dt, **names)
