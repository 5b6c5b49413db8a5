"""Behind a training with g: the loop of the law is brought back to the data (eq. kept).

What g does along the record is small, for the cost asks for that.  In the loop of the
law u differs, and may go where no g was asked for.  Where it does, h and g are trained
on: they keep the simulation of the record, forwards and backwards, and e along the loop
counts, too.
"""

from functools import partial

import numpy as np

from ..criterion import DIVERGED_NORM, Criterion
from ..excursions import LARGER, Excursion, settling
from ..initial_states import WINDOW, estimate_x0
from ..joined import Joined
from ..limits import Limits
from ..looped import LOOP, looped
from ..mapping import Held
from ..region import Region
from ..simulation import outputs, runs, simulate
from ..training import LEAST_MOVE
from ..watch import INTERRUPTED
from ._noise import is_predicting
from ._split import BEST, TRAINED

GAMMAS = (1e-7, 1e-5, 1e-4)  # of h, on the record and in the loop
SHARES = (0.0, 1.0)  # of g, that act on the states of the loop
BACK = (1e-5, 1e-7)  # the same on the way back from where each of them has led
STEPS = 60  # trial steps for each of them
# Mean square by which the error on the record may rise, and by which simulations may
# change, over that error.
RISE = 0.2
ASTRAY = 0.1  # how far a loop strays (eq. strays) that is to be brought back
ENOUGH = 0.05  # the same that is near the data
FAR = 0.2  # the same that is worth the way back
LESS = 2 / 3  # of how far it strayed before, at most

KEPT = "trained on, to bring the loop of the law nearer to the data"
LEFT = (
    "the loop of the law is far from its design or from the data, see "
    "`linearizability`; `gamma_h` makes the law smaller"
)


def settled_loop(estimator, structure, theta, result, experiments, held_out, watch):
    """Return parameters of nearly the same simulation, whose loop stays near the data.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    structure : Structure
        What was fitted.
    theta : ndarray of shape (n_params,)
        Its parameters.
    result : OptimizeResult
        Outcome of the training. Its ``x0``, ``cost`` and ``message`` change, too.
    experiments : Held or Remote
        Experiments of the fit, as the training saw them.
    held_out : Validation or None
        Data that judge the fit. What is best for them is kept.
    watch : Watch
        May end it.

    Returns
    -------
    theta : ndarray of shape (n_params,)
        Parameters; the same ones where the loop is near the data, or has to be left
        where it is.
    """
    is_asked = _is_asked(estimator, structure, theta, experiments, watch)
    if not is_asked or held_out is not None:
        return theta
    try:
        loop = _Loop(estimator, structure, (theta, result.x0), experiments, watch)
        if loop.strayed <= ASTRAY:
            return theta
        after = loop.brought_back()
    except KeyboardInterrupt as interrupt:  # between two searches
        watch.stop(INTERRUPTED, interrupt)
        return theta
    if after is None:
        if watch.reason is None:  # else there was no time to find it
            result.message += f"; {LEFT}"
        return theta
    theta, result.x0 = after
    result.cost = loop.cost(after)
    result.message += f"; {KEPT}"
    return theta


def _is_asked(estimator, structure, theta, experiments, watch):
    """Tell whether there is a loop that g disturbs, which can be trained."""
    p, options = structure.split(theta), structure.options
    if getattr(estimator, "linear_part", TRAINED) != BEST or is_predicting(estimator):
        return False
    # of h alone the loop is linear wherever it goes
    if not (np.any(p.get("W_h", 0.0)) and np.any(p.get("W_g", 0.0))):
        return False
    if structure.sampling is not None or not estimator.gamma > 0:
        return False
    is_sum = options["input_map"] == "identity" and not options["n_k"]
    late = np.delete(estimator.input_delay_, structure.given).any()
    is_usual = estimator.initial_state != "periodic" and estimator.horizon == 1
    is_plain = is_sum and is_usual and not (late or options["feedthrough"])
    return bool(is_plain) and experiments.is_here and watch.reason is None


class _Loop:
    """Train a model and its loop, and judge both.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    structure : Structure
        What was fitted.
    point : tuple of ndarray
        Parameters and initial states that the training has reached.
    experiments : Held
        Experiments of the fit.
    watch : Watch
        May end it.

    Attributes
    ----------
    before : tuple of ndarray
        That point.
    strayed : float
        How far its loop strays.
    """

    def __init__(self, estimator, structure, point, experiments, watch):
        self.structure, self.plain = structure, structure.observe(structure.measured)
        self.both = looped(structure)
        self.penalized, self.weights = estimator._criterion_terms(structure)
        self.before, self.record = point, experiments
        decay = estimator._decay or {"alpha": estimator.alpha}
        self.decay = {"alpha": decay["alpha"], "center": decay.get("center")}
        # A search of a short record ends where hidden samples allow; further steps
        # towards noisy outputs would fit their noise.
        self.goes_on = decay.get("bends", True)
        known = estimator._training(structure)
        limits = partial(Limits, structure, known["phi"], known["bounds"])
        self.limits = limits(known["at_rest"], known["radius"])
        self.of_stretch = limits(False, known["radius"])  # it begins anywhere
        self.n, self.polish_iter = estimator.coarse_samples, estimator.polish_iter
        self.n_steps = min(STEPS, estimator.max_iter)
        self.integrates = bool(estimator.integrators_)
        self.how = {"method": estimator.method, "tol": estimator.tol}
        self.how |= {"watch": watch.fork(), "xtol": LEAST_MOVE}
        # its steps are of another cost than those that an observer has heard of
        self.how["watch"].observe = self.how["watch"].floor = None
        self.how["bends"] = True  # the valleys along which h and g change are curved
        self.error = self._error(point, experiments)
        self.strayed = self.strays(point, experiments)
        # No sample of it was measured. It is another path through the same region.
        rests = self.limits.at_rest
        self.ends = np.zeros_like(point[1]) if rests else self._ends()
        self.backwards = self._simulated(
            [u[:][::-1] for u, _ in experiments], self.ends
        )

    def _simulated(self, inputs, starts):
        """Return inputs with what the training has reached makes of them."""
        lure = self.plain.lure(self.before[0])
        made = [
            (u, outputs(lure, u[:], self.plain.initial_state(start)))
            for u, start in zip(inputs, starts, strict=True)
        ]
        return Held(made, self.record.n_jobs)

    def _ends(self):
        """Return the states in which the simulations of the record end."""
        (theta, x0), n = self.before, self.plain.n_x0
        lure = self.plain.lure(theta)
        pairs = zip(self.record, x0, strict=True)
        starts = [(u[:], self.plain.initial_state(start)) for (u, _), start in pairs]
        return np.array([simulate(lure, u, start)[-1, :n] for u, start in starts])

    # -- training ----------------------------------------------------------------------

    def brought_back(self):
        """Return the point whose loop strays least of those that are as good models.

        None if there is none.
        """
        before, forwards = self.before, self.record
        if not self.goes_on:
            forwards = self._simulated([u for u, _ in forwards], before[1])
        is_long = self.n is not None and self.n < self.record.n_samples
        limits = self.of_stretch if is_long else self.limits
        parts, starts = [forwards, self.backwards], [before[1], self.ends]
        if is_long:
            parts = [Held(part.stretch(self.n)) for part in parts]
            starts = [self._starts(before[0], part) for part in parts]
        found, n = [], len(self.record)
        for i, (gamma, at) in enumerate(self._outcomes(parts, starts, limits), 1):
            theta, (x0, ends) = at[0], np.split(at[1], [n])
            if self._is_kept(theta, x0, ends, parts, starts):
                strayed = self.strays((theta, x0), parts[0])
                found.append((strayed, gamma, (theta, x0, ends)))
            least = min((strayed for strayed, *_ in found), default=np.inf)
            near = ENOUGH if i < len(GAMMAS) else FAR
            if least <= near or self.how["watch"].reason is not None:
                break
        for _, gamma, own in sorted(found, key=lambda each: each[0]):
            point = self._of_all(gamma, own[0]) if is_long else own
            if self._is_better(*point):
                return point[:2]
        return None

    def _outcomes(self, parts, starts, limits):
        """Yield points that may be taken, each with its weight of h."""
        reached = []
        for gamma in GAMMAS:
            at = self.before[0], np.vstack(starts)
            for share in SHARES:
                at = self._descend(at, parts, limits, gamma, share, self.n_steps)
            reached.append(at)
            yield gamma, at
        for at in reached:
            for gamma in BACK:
                at = self._descend(at, parts, limits, gamma, SHARES[-1], self.n_steps)
                yield gamma, at

    def _of_all(self, gamma, theta):
        """Return what parameters from a stretch become on all samples."""
        parts = self.record, self.backwards
        starts = [self._starts(theta, part) for part in parts]
        if self.limits.at_rest:
            starts = [self.before[1], self.ends]
        near = self._is_kept(theta, *starts)
        if near and self.strays((theta, starts[0]), self.record) <= ENOUGH:
            return theta, *starts
        n, at = len(self.record), (theta, np.vstack(starts))
        how = self.limits, gamma, SHARES[-1], self.polish_iter
        theta, x0 = self._descend(at, parts, *how)
        return theta, *np.split(x0, [n])

    def _descend(self, point, parts, limits, gamma, share, n_steps):
        """Return the point behind so many steps, at most (eq. kept).

        Its initial states are those of the record, and those backwards.
        """
        weights = {**self.weights, "h": self.weights.get("h", 0.0) + gamma}
        others = list(weights)[1:]
        weights |= {f"{name}{LOOP}": weights[name] for name in others}
        both = looped(self.structure, share).observe(*weights)
        record, backwards = parts
        of_record = Criterion(both, record, weights=weights, **self.decay)
        criterion = Joined(of_record, self._criterion(backwards))
        free = np.concatenate([point[0], np.ravel(point[1])])
        if not criterion.norm(free) < DIVERGED_NORM:  # the loop does
            return point
        how = {**self.how, "max_iter": n_steps, "label": f"loop, gamma_h {gamma:g}"}
        result = limits.minimize(criterion, free, **how)
        theta, x0 = np.split(result.x, [len(point[0])])
        return theta, x0.reshape(point[1].shape)

    def _starts(self, theta, experiments):
        """Return initial states of experiments that begin elsewhere."""
        how = {"window": WINDOW, "noise": self.error}
        return estimate_x0(self.plain, theta, experiments, **how)

    # -- judging -----------------------------------------------------------------------

    def strays(self, point, experiments):
        """Return how far a loop strays from its design and the data (eq. strays)."""
        both = self.both.observe("y", f"y{LOOP}", f"e{LOOP}", f"u{LOOP}")
        lure, ny = both.lure(point[0]), both.sizes["y"]
        x, x_loop = both.cols["x"], both.cols[f"x{LOOP}"]
        parts = []
        for (u, _), start in zip(experiments, point[1], strict=True):
            for _, u_part, X, Z in runs(lure, u, both.initial_state(start)):
                Y, Y_loop, E, U_loop = np.split(Z, [ny, 2 * ny, 3 * ny], axis=1)
                record, of_loop = (X[:, x], u_part, Y), (X[:, x_loop], U_loop, Y_loop)
                parts.append((*record, *of_loop, E))
        every = [np.vstack(column) for column in zip(*parts, strict=True)]
        if not all(np.isfinite(z).all() for z in every):
            return 2.0
        outside = float(Region.of(*every[:3]).outside(*every[3:6]).mean())
        Y_loop, E = every[5:]
        designed = np.linalg.norm(Y_loop - E)
        missed = np.linalg.norm(E) / designed if designed > 0 else 1.0
        return min(float(missed), 1.0) + outside

    def _is_better(self, theta, x0, ends):
        """Tell whether a point has the better loop, and is as good a model."""
        after = theta, x0
        if self.strays(after, self.record) > LESS * self.strayed:
            return False
        if not self._is_kept(theta, x0, ends):
            return False
        if self.integrates:  # held inputs say nothing
            return True
        ny, nu = self.plain.sizes["y"], self.plain.sizes["u"]
        n_held = settling(self.structure.split(theta)["A"])
        larger = np.full((nu, 2), LARGER)
        excursion = Excursion(list(self.record), n_held, np.zeros(ny), larger)
        leads, led = (
            excursion.leads(self.plain, *point) for point in (after, self.before)
        )
        return led or not leads

    def _is_kept(self, theta, x0, ends, parts=None, before=None):
        """Tell whether the simulation is nearly the same, forwards and backwards.

        Where it is nearer to the record than before, it has to differ.  Then it may
        differ backwards by as much as along the record, and `RISE` (eq. kept).
        """
        record, backwards = parts or (self.record, self.backwards)
        x0_before, ends_before = before or (self.before[1], self.ends)
        was = self.before[0], x0_before
        made = self._simulated([u for u, _ in record], x0_before)
        rise, changed, elsewhere = (
            self._error(after, part) - self._error(at, part)
            for after, at, part in (
                ((theta, x0), was, record),
                ((theta, x0), was, made),
                ((theta, ends), (self.before[0], ends_before), backwards),
            )
        )
        allowed = RISE * self.error
        return bool(
            rise <= allowed and elsewhere <= allowed + (changed if rise <= 0 else 0.0)
        )

    def cost(self, point):
        """Return the cost of the training at a point."""
        options = {"weights": self.weights, **self.decay}
        criterion = Criterion(self.penalized, self.record, **options)
        return criterion.norm(criterion.join(*point)) ** 2

    def _criterion(self, experiments):
        """Return the criterion of a simulation alone."""
        y = self.plain.measured
        return Criterion(self.plain, experiments, weights={y: self.weights[y]})

    def _error(self, point, experiments):
        """Return the weighted mean square error of a simulation."""
        criterion = self._criterion(experiments)
        return criterion.norm(criterion.join(*point)) ** 2
