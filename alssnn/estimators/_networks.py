"""The options of networks, from which the models choose theirs."""

from numbers import Integral
from typing import Any

from sklearn.utils._param_validation import StrOptions

from ..activations import ACTIVATIONS, Activation
from ._noise import MEASURED, PREDICTED
from ._options import menu, option
from ._records import COUNT, WEIGHT
from ._split import BEST, TRAINED

SIZES = [COUNT, tuple]
FEEDBACK = StrOptions({"output", "state"})
ACTIVATION = [StrOptions(set(ACTIVATIONS)), Activation, dict]
H_INPUTS = ["array-like", str, Integral, None]
G_INPUTS = ["array-like", None]  # a dict is one, for scikit-learn
# options that tell a structure which networks it has
DECLARED = ("n_h", "n_g", "n_k", "feedback", "input_map", "activation", "odd")


@menu
class Networks:
    """Describe what the models of the family can be told about their networks.

    Parameters
    ----------
    n_h : int or tuple of int, default=10
        Hidden neurons of h, by layer; 0 leaves h out.
    n_g : int or tuple of int, default=10
        Hidden neurons of g, by layer; 0 leaves g out.
    gamma : float, default=0.01
        Weight of the mean of ``|e|^2``, with ``penalty="state"`` of ``|g|^2``, relative
        to that of the output error, with outputs scaled to unit variance. A weight of
        ``|g|^2`` that is meant for unscaled outputs is divided by var(y).
    n_k : int or tuple of int, default=0
        Hidden neurons of k in the output, by layer; 0 leaves k out.
    gamma_k : float, default=1.0
        Weight of the mean of ``|k|^2`` relative to that of the output error.
    gamma_h : float, default=0.0
        Weight of the mean of ``|h|^2``, with inputs scaled to unit variance: a small
        one makes A the best linear fit and h only what is left of it (eq. split), where
        `linear_part` does not. Strongly nonlinear plants want 1e-4, mildly nonlinear
        ones more.
    linear_part : {"best", "trained"}, default="best"
        What (A, B, C) is of the many that are the same model (eq. split). "best": the
        best linear fit along the training data, with an h that has no linear part left
        and is as small as it can be (eq. best); `params_` then has a matrix L, and h
        the term -L s. Where g is not zero, A, h and g are trained on instead if the
        loop of the law goes far from its design or from the training data (eq. kept);
        the simulation stays nearly the same. "trained": as the training has left it. So
        it is, too, in continuous time, with D, a drift, late inputs or a monotone map,
        and without g also with integrators, bounds of A or stability="contractive", and
        where h sees a y that is more than C x.
    feedback : {"output", "state"}, default="state"
        What h sees: the state x, which needs an observer in the loop but linearizes
        more plants, or the output y (the paper).
    penalty : {"state", "output"}, default="output"
        What gamma weighs: ``|e|^2``, what g adds to the output (eq. gauge), which no
        state basis can hide, or ``|g|^2`` in state coordinates (the paper).
    input_map : {"identity", "monotone"}, default="identity"
        What the linear part answers to: v = u + h(s), the paper's; or v = phi(u, s)
        with phi increasing in u (eq. monotone), for actuators and gains that are not
        linear, such as valves, fans and magnets. The law then solves v = phi(u, s) for
        u. The activation of h must not decrease.
    h_sees : {"auto", "measured", "predicted"}, default="auto"
        Of ``noise="innovations"`` with ``feedback="output"``: whether the h of the
        predictor sees the outputs as measured, as they act through noise of the
        process, or as predicted, as without it. "auto" fits both and keeps the more
        likely one (eq. deviance).
    feedthrough : bool, default=False
        Whether D is identified; else it is zero.
    h_inputs : array_like of int or str, or None, default=None
        Which outputs h sees, by number from 0 or by name, or with `feedback="state"`
        which states, by number, of a `linear_start`; None means all. Its weights for
        the others are held at zero.
    g_inputs : dict of str to array_like, or None, default=None
        Which states and inputs g (f of GR-SSNN) sees, ``{"x": ..., "u": ...}``: numbers
        from 0, names of inputs, or "all"; a letter that is left out is not seen.
        Numbers of states are those of a `linear_start`. None means everything.
    activation : str, Activation or dict, default="tanh"
        "tanh", "sigmoid", "relu", "identity", "sin" or an `Activation` of one's own,
        for all networks or by network, ``{"h": ..., "g": ..., "k": ...}``; the network
        f of GR-SSNN is "g" there.
    odd : bool, default=False
        Whether h has no biases, so that h(-s) = -h(s).
    continuation : int, default=0
        Number of preparatory fits with a larger gamma, if `alpha` is a number; each
        gamma is a factor 10**0.5 below the one before. Take 4 for small weights, and
        for ``penalty="output"``. Each fit may take `max_iter` trial steps. With "auto"
        there are none: it goes down a path of alphas instead.
    """

    n_h: Any = option(10, SIZES, kw_only=False)
    n_g: Any = option(10, SIZES, kw_only=False)
    gamma: float = option(0.01, [WEIGHT], kw_only=False)
    n_k: Any = option(0, SIZES)
    gamma_k: float = option(1.0, [WEIGHT])
    gamma_h: Any = option(0.0, [WEIGHT])
    linear_part: str = option("best", [StrOptions({BEST, TRAINED})])
    feedback: str = option("state", [FEEDBACK])
    h_sees: str = option("auto", [StrOptions({"auto", PREDICTED, MEASURED})])
    penalty: str = option("output", [StrOptions({"state", "output"})])
    input_map: str = option("identity", [StrOptions({"identity", "monotone"})])
    feedthrough: bool = option(False, ["boolean"])
    h_inputs: Any = option(None, H_INPUTS)
    g_inputs: Any = option(None, G_INPUTS)
    activation: Any = option("tanh", ACTIVATION)
    odd: bool = option(False, ["boolean"])
    continuation: int = option(0, [COUNT])
