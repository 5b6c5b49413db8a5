"""The options of every model: what the record is, and how long to search."""

from numbers import Integral, Real
from typing import Any

from sklearn.utils._param_validation import Interval, StrOptions

from ..continuous import HOLDS
from ._noise import INNOVATIONS
from ._options import menu, option
from ._time import CONTINUOUS

POSITIVE = Interval(Integral, 1, None, closed="left")
COUNT = Interval(Integral, 0, None, closed="left")
WEIGHT = Interval(Real, 0, None, closed="left")


@menu
class Records:
    """Describe what the models can be told about records, noise and the search.

    Parameters
    ----------
    nx : int, "auto" or array_like of int, default="auto"
        Number of states. "auto" compares linear models of order 1, 2, ... on hidden
        samples until three larger orders bring no gain; a range or a list compares the
        orders that it names (eq. holdout). See `orders_`.
    input_delay : int, array_like of int of shape (nu,) or "auto", default=0
        Samples by which each input arrives late; "auto" takes the largest delay that
        costs neither prediction nor simulation of a linear model (eq. delay).
    output_weight : array_like of shape (ny,) or None, default=None
        Weight of the squared error of every output, outputs scaled to unit variance.
    linear_start : tuple, control.StateSpace, fitted model or None, default=None
        Linear model to start from instead of N4SID, (A, B, C) or (A, B, C, D) in the
        units of the data. It sets `nx` and the basis of the states.
    bounds : dict of str to tuple or None, default=None
        Bounds ``{"D": (low, high)}`` of entries of D and H, and with `linear_start` of
        A, B, C and G, in the units of the data; equal ones hold an entry.
    integrators : int or "auto", default="auto"
        Number of poles held at 1, or at 0 in continuous time (eq. integrate): of
        outputs that are integrals, such as positions and levels. No network sees
        their states. "auto" finds them. The mean of u gives way to the input at
        which they rest.
    operating_point : {"mean", "zero"} or tuple, default="mean"
        Origin of the deviations; a pair (u_e, y_e) in the units of the data.
    initial_state : {"estimate", "rest", "periodic"}, default="estimate"
        Initial state of the training experiments: estimated with the parameters, held
        at `operating_point`, which must be where the records begin, or "periodic": the
        fit takes the mean over the periods of every experiment, and the state at its
        end is that at its beginning (eq. steady). For settled records of periodic
        inputs, of noise of the sensors, in discrete time.
    period : int or None, default=None
        Of ``initial_state="periodic"``: samples of a period, such as the `period` of an
        `excitation.Excitation`. Of several periods the first is left out, while the
        plant settles (eq. settled). None means that every experiment is one settled
        period.
    disturbances : array_like of int or str, or None, default=None
        Inputs that are measured but not moved by a controller, by number from 0 or by
        name: loads, ambient temperatures, flows (eq. disturbance). B and the law leave
        them to G, and h sees them. None means that all inputs are moved. Wherever d is
        given, its columns are in the order of the record.
    noise : {"output", "innovations"}, default="output"
        What the model leaves unexplained: noise of the sensors alone, by the error of a
        simulation; or noise of the process, too, by the error one sample ahead with a
        gain K (eq. innovations): for records with disturbances that nobody measured,
        of a loop that was closed, or of an unstable plant.
    horizon : int, default=1
        Of ``noise="innovations"``: number k of samples over which predictions are
        trained, y_t to y_t+k-1 from what was measured before t (eq. horizon). One is
        the likelihood; where the model is too simple for the plant, more samples trade
        it for better predictions further ahead. A trial step takes about eight times as
        long for five samples, 25 times for ten.
    time : {"discrete", "continuous"}, default="discrete"
        Whether the equations give the next sample or the derivatives (eq. derivative):
        A, B, G and g then have the unit of time in seconds, and one model serves every
        sampling time. The states go from sample to sample by steps of Runge and Kutta
        (eq. rk4).
    hold : {"zoh", "linear", "cubic"}, default="zoh"
        Of ``time="continuous"``: what u does between samples. "zoh" holds it, as a
        computer does; measured signals go on along a line or, if they are smooth, a
        cubic spline.
    substeps : int, default=1
        Of ``time="continuous"``: steps of Runge and Kutta per sample, raised with a
        warning where a pole is too fast for them.
    drift : {"output", "input"} or None, default=None
        A disturbance that nobody measured and that drifts, of ``noise="innovations"``:
        a random walk b+ = b + K_b eps (eq. drift), one per output behind the plant, or
        one per input that is moved, before it, such as loads. Simulation and law leave
        it out, of some networks all but its mean (eq. center); observer and predictive
        control estimate it. None declares none.
    dt : float, default=1.0
        Sampling time, in seconds; ``time="continuous"`` asks for it.
    max_iter : int, default=100
        Largest number of trial steps of the refinement.
    tol : float, default=1e-8
        Relative change of cost or parameters that ends the refinement.
    max_time : float or None, default=None
        Seconds after which the fit stops at its next trial step, with the best
        parameters so far; None means no limit. To judge what there is may take some
        seconds more.
    noise_floor : float, array_like of shape (ny,), object, True or None, default=None
        Noise of the outputs, root mean squares in their units, or what `look` or
        `nonparametric.best_linear_approximation` say of a periodic record; True takes
        it from the record, by its `period` or, without one, by experiments that had the
        same input. A stage of the training ends
        as soon as its cost, penalties included, is within 5 % of that of the noise:
        what follows would fit the noise. Of ``noise="output"``. None trains on.
    n_init_samples : int, default=50
        First samples of an experiment from which `score` estimates its initial
        state, at most a quarter of the experiment. They count from the first measured
        one, and what comes before it is not scored.
    verbose : int or "bar", default=0
        1 prints a line per stage of the training, and one every ten seconds in long
        ones; 2 every step. "bar" shows a bar, in terminals and notebooks, with the time
        left at most; it needs tqdm.
    """

    nx: Any = option(
        "auto", [POSITIVE, StrOptions({"auto"}), range, "array-like"], kw_only=False
    )
    input_delay: Any = option(0, [COUNT, "array-like", StrOptions({"auto"})])
    output_weight: Any = option(None, ["array-like", None])
    linear_start: Any = option(None, "no_validation")
    bounds: Any = option(None, [dict, None])
    integrators: Any = option("auto", [COUNT, StrOptions({"auto"})])
    operating_point: Any = option("mean", [StrOptions({"mean", "zero"}), tuple])
    initial_state: str = option(
        "estimate", [StrOptions({"estimate", "rest", "periodic"})]
    )
    period: int | None = option(None, [POSITIVE, None])
    disturbances: Any = option(None, ["array-like", str, Integral, None])
    noise: str = option("output", [StrOptions({"output", INNOVATIONS})])
    horizon: int = option(1, [POSITIVE])
    time: str = option("discrete", [StrOptions({"discrete", CONTINUOUS})])
    hold: str = option("zoh", [StrOptions(set(HOLDS))])
    substeps: int = option(1, [POSITIVE])
    drift: Any = option(None, [StrOptions({"output", "input"}), None])
    dt: float = option(1.0, [Interval(Real, 0, None, closed="neither")])
    max_iter: int = option(100, [POSITIVE])
    tol: float = option(1e-8, [Interval(Real, 0, None, closed="neither")])
    max_time: float | None = option(
        None, [Interval(Real, 0, None, closed="neither"), None]
    )
    noise_floor: Any = option(None, "no_validation")
    n_init_samples: int = option(50, [POSITIVE])
    verbose: Any = option(0, ["verbose", StrOptions({"bar"})])
