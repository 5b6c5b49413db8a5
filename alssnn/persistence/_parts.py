"""What other languages need of a model: matrices, networks, law, observer, gain.

`Parts` states the model by plain equations in the units of the user (eq. model), with
du the inputs that have arrived, as deviations from u_offset:

    x+ = A x + B (du + h(s)) + g(x, du),    y - y_offset = C x + D du + k(x, du)

where s = y - y_offset or s = x.  Input i arrives delay[i] samples late; its last values
stand behind x, oldest first, in the state that observer and gain refer to.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..activations import ACTIVATIONS
from ..networks import Perceptron


def shipped_name(activation):
    """Return the name under which a file refers to an activation.

    Parameters
    ----------
    activation : Activation
        The activation.

    Returns
    -------
    name : str
        Its name.

    Raises
    ------
    ValueError
        If it is not one that is shipped.
    """
    if activation not in ACTIVATIONS.values():
        names = ", ".join(map(repr, ACTIVATIONS))
        raise ValueError(
            f"`activation` must be one of {names} for a file, got your own "
            f"{activation.name!r}: a file holds no code. Pickle the model, or fit it "
            "with an activation that is shipped."
        )
    return activation.name


@dataclass(frozen=True, eq=False)
class Parts:
    """Hold the numbers of a model and of what closes its loop.

    Parameters
    ----------
    name : str
        Name of the estimator.
    dt : float
        Sampling time, in seconds.
    A, B, C, D : ndarray
        Linear part.
    nets : dict of str to Perceptron
        Networks h, g, k that the model has; g and k see [x; u].
    feedback : {"output", "state"}
        What h and the law see: s = y, or s = x.
    delay : ndarray of int of shape (nu,)
        Samples by which every input arrives late.
    u_offset, y_offset : ndarray
        Operating point.
    inputs, outputs : list of str
        Names of the signals.
    law : LinearizingLaw or None
        Law; None if it is ill-posed.
    no_law : str
        Why there is no law.
    M : ndarray of shape (nx + sum(delay), ny) or None
        Gain of the observer; None without one.
    K_x, K_z : ndarray or None
        Gains of states and integrators; None without a controller.
    """

    name: str
    dt: float
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    nets: dict
    feedback: str
    delay: np.ndarray
    u_offset: np.ndarray
    y_offset: np.ndarray
    inputs: list
    outputs: list
    law: Any
    no_law: str
    M: np.ndarray | None
    K_x: np.ndarray | None
    K_z: np.ndarray | None

    @property
    def n_late(self):
        """Return the number of past inputs in the state."""
        return int(self.delay.sum())

    @property
    def has_linear_output(self):
        """Return whether y = C x + y_offset."""
        return "k" not in self.nets and not np.any(self.D)

    @property
    def integrates(self):
        """Return whether the controller has integrators."""
        return self.K_z is not None and self.K_z.size > 0

    @classmethod
    def of(cls, model, law=None, observer=None, gain=None):
        """Return the parts of a fitted model.

        Parameters
        ----------
        model : estimator
            Fitted model.
        law : LinearizingLaw or None, default=None
            Law, for example with limits; None takes ``model.linearizing_law()``, or
            leaves it out where it is ill-posed.
        observer : Observer, None or False, default=None
            Observer with constant gain; None takes ``model.observer()``, False leaves
            it out.
        gain : array_like of shape (nu, nx) or (nu, nx + ny) or None, default=None
            Gain of a controller, as for `feedback.closed_loop`.

        Returns
        -------
        parts : Parts
            The parts.

        Raises
        ------
        NotFittedError
            If the model is not fitted.
        TypeError
            If `law` or `observer` is of another type.
        ValueError
            If an activation is the user's, sizes do not fit, the observer has no
            constant gain, or a controller lacks its law or observer.
        """
        from ..feedback import split_gain

        check_is_fitted(model)
        plant, structure = model.plant_.late(), model._structure
        nets = {}
        for net in "hgk":
            sigma = structure.activations.get(f"w_{net}")
            if sigma is not None:
                shipped_name(sigma)
                nets[net] = Perceptron.of(net, model.params_, sigma)
        law, no_law = _law(model, law, required=gain is not None)
        K_x, K_z = (None, None) if gain is None else split_gain(gain, plant)
        parts = cls(
            name=type(model).__name__,
            dt=float(model.dt),
            A=model.A_,
            B=model.B_,
            C=model.C_,
            D=model.D_,
            nets=nets,
            feedback="state" if "W_s" in model.params_ else "output",
            delay=model.input_delay_,
            u_offset=model.u_offset_,
            y_offset=model.y_offset_,
            inputs=plant.inputs,
            outputs=plant.outputs,
            law=law,
            no_law=no_law,
            M=_observer_gain(model, observer),
            K_x=K_x,
            K_z=K_z,
        )
        if gain is not None and parts.M is None:
            raise ValueError(
                "`observer` must not be False with a `gain`, which acts on the "
                "estimated state. Leave it out for the default one."
            )
        if gain is not None and not parts.has_linear_output:
            raise ValueError(
                "`gain` must be None for a model whose y depends on u of the same "
                "sample, through D or k: the estimated state would wait for u, and u "
                "for the state. Fit without `feedthrough` and `n_k`."
            )
        return parts


def _law(model, law, required):
    """Return the law, or None and why there is none."""
    from ..feedback import LinearizingLaw

    if law is None:
        try:
            return LinearizingLaw(model), ""
        except ValueError as error:
            if required:
                raise
            return None, str(error)
    if not isinstance(law, LinearizingLaw):
        raise TypeError(
            f"`law` must be a LinearizingLaw, got {type(law).__name__}. Use "
            "`model.linearizing_law`."
        )
    if _numbers(law) != _numbers(LinearizingLaw(model)):
        raise ValueError(
            "`law` must be one of this model, got one of another model. Use "
            "`model.linearizing_law`."
        )
    return law, ""


def _numbers(law):
    """Return what tells laws apart, limits left out."""
    plant = law.plant
    return plant.feedback, plant.y_offset.tolist(), plant.law_form.Theta.tolist()


def _observer_gain(model, observer):
    """Return the constant gain of an observer, or None."""
    from ..feedback import Observer

    if observer is False:
        return None
    observer = Observer(model) if observer is None else observer
    if not isinstance(observer, Observer):
        raise TypeError(
            f"`observer` must be an Observer, None or False, got "
            f"{type(observer).__name__}. Use `model.observer`."
        )
    if observer.kind != "kalman":
        raise ValueError(
            f"`observer` must have a constant gain, kind='kalman', got "
            f"{observer.kind!r}. Use `model.observer`."
        )
    expected = model.nx_ + int(model.input_delay_.sum()), len(model.C_)
    if observer.gain.shape != expected:
        raise ValueError(
            "`observer` must estimate the states of this model alone, with a gain of "
            f"shape {expected}, got {observer.gain.shape}. Use `model.observer`."
        )
    return observer.gain
