"""Linear models in scaled deviations: their error, their stability, their basis.

A predictor is a linear model, too: with the measured outputs as further inputs it is
x+ = (A - K C) x + (B - K D) u + K y_m, y = C x + D u, stable whatever A is (eq.
innovations).  Only by its names, for structures, it becomes A, B, C, D and K.
"""

import warnings
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import eigh, lstsq, solve_discrete_lyapunov
from scipy.optimize import OptimizeResult

from .criterion import Criterion, Restricted
from .innovations import predictor
from .inputs import join_inputs, split_inputs
from .models import state_space
from .simulation import trajectory

LEAST_VARIANCE = 1e-12  # of a state, relative to the largest, that counts as moving
RADIUS_LIMIT = 0.999  # spectral radius of a stabilized start
FORGOTTEN = 1.1  # error from an unknown start over that from a known one, at most
SMALL_ERROR = 1e-3  # that needs no such comparison, outputs of unit variance


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Hold a linear model of scaled deviations.

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
    x0 : ndarray of shape (n_experiments, nx)
        Initial states.
    feedthrough : bool
        Whether D is free; else it is zero.
    singular_values : ndarray
        Singular values behind the choice of the order, descending.
    result : OptimizeResult or None
        Outcome of the refinement.
    n_measured : int
        Number of last inputs that are the measured outputs of a predictor.
    radius : float
        Largest modulus of a pole that a search may reach.
    drift : {"output", "input"} or None
        What a random walk of a predictor is added to (eq. drift).
    K_b, b0 : ndarray of shape (nb, ny), (n_experiments, nb)
        Its gain, and where it starts; nb is ny, or nu with zeros for inputs that are
        measured disturbances.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    x0: np.ndarray
    feedthrough: bool = False
    singular_values: np.ndarray = field(default_factory=lambda: np.empty(0))
    result: OptimizeResult | None = None
    n_measured: int = 0
    radius: float = 1.0
    drift: str | None = None
    K_b: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    b0: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def nu(self):
        """Return the number of inputs, without measured outputs."""
        return self.B.shape[1] - self.n_measured

    @property
    def structure(self):
        """Return the linear structure with free C, which moves all inputs alike."""
        (nx, nu), ny = self.B.shape, len(self.C)
        return state_space(nx, nu, ny, feedthrough=self.feedthrough)

    def in_basis(self, T, T_inv):
        """Return the same model with the states T x.

        Parameters
        ----------
        T, T_inv : ndarray of shape (nx, nx)
            The new basis, and its inverse.

        Returns
        -------
        model : LinearModel
            The model in this basis.
        """
        A, B, C = T @ self.A @ T_inv, T @ self.B, self.C @ T_inv
        return replace(self, A=A, B=B, C=C, x0=self.x0 @ T.T)

    def starts(self, given=()):
        """Return the initial states as `as_fit` has them.

        Parameters
        ----------
        given : sequence of int, default=()
            Columns of u that are measured disturbances.

        Returns
        -------
        x0 : ndarray of shape (n_experiments, n_x0)
            Those of the states, then those of a random walk.
        """
        if self.drift is None:
            return self.x0
        return np.hstack([self.x0, self.b0[:, self._drifting(given)]])

    def whole(self):
        """Return the same predictor, a random walk among its states.

        Returns
        -------
        model : LinearModel
            Model of [x; b] (eq. drift); the model itself if nothing drifts.
        """
        if self.drift is None:
            return self
        D, K_b, eye = self.D[:, : self.nu], self.K_b, np.eye(len(self.K_b))
        by_u, K = np.split(self.B, [self.nu], axis=1)
        to_x, to_y = (-K, eye) if self.drift == "output" else (by_u, D)
        return replace(
            self,
            A=np.block([[self.A, to_x], [-K_b @ self.C, eye - K_b @ to_y]]),
            B=np.vstack([self.B, np.hstack([-K_b @ D, K_b])]),
            C=np.hstack([self.C, to_y]),
            x0=np.hstack([self.x0, self.b0]),
            drift=None,
        )

    def _drifting(self, given):
        """Return the entries of a random walk that a structure has."""
        if self.drift == "output":
            return slice(None)
        return split_inputs(self.nu, [i for i in given if i < self.nu])[0]

    def by_name(self, given=()):
        """Return the matrices by the names that they have in `models.state_space`.

        Parameters
        ----------
        given : sequence of int, default=()
            Columns of u that are measured disturbances.

        Returns
        -------
        matrices : dict of str to ndarray
            A, B, C, D, G and H for the columns that are given, and K of a predictor.
        """
        nu = self.nu
        moved, given = split_inputs(nu, [i for i in given if i < nu])
        A, (B, K), D = self.A, np.split(self.B, [nu], axis=1), self.D[:, :nu]
        matrices = {"C": self.C, "D": D[:, moved]}
        if self.n_measured:
            matrices["K"], A, B = K, A + K @ self.C, B + K @ D
        if self.drift is not None:
            matrices["K_b"] = self.K_b[self._drifting(given)]
        if len(given):
            matrices |= {"G": B[:, given], "H": D[:, given]}
        return {**matrices, "A": A, "B": B[:, moved]}

    def with_matrices(self, p, given, **changes):
        """Return the model with other matrices.

        Parameters
        ----------
        p : dict of str to ndarray
            Matrices A, B, C, D, G, H and K, as of `by_name`; D and H may be missing.
        given : sequence of int
            Columns of u that are measured disturbances.
        **changes : dict
            Other fields that change.

        Returns
        -------
        model : LinearModel
            The model.
        """
        given = [i for i in given if i < self.nu]
        (nx, nv), ny, nd = p["B"].shape, len(p["C"]), len(given)
        D, H = p.get("D", np.zeros((ny, nv))), p.get("H", np.zeros((ny, nd)))
        A, B = p["A"], join_inputs(p["B"], p.get("G", np.zeros((nx, nd))), given)
        D = join_inputs(D, H, given)
        if self.n_measured:
            K = p["K"]
            A, B = A - K @ p["C"], np.hstack([B - K @ D, K])
            D = np.hstack([D, np.zeros((ny, self.n_measured))])
        return replace(self, A=A, B=B, C=p["C"], D=D, **changes)

    def as_fit(self, given=()):
        """Return the model as a fitted structure.

        Parameters
        ----------
        given : sequence of int, default=()
            Columns of u that are measured disturbances.

        Returns
        -------
        structure : Structure
            Linear structure with free C, that of its predictor if it is one.
        theta : ndarray of shape (n_params,)
            Its parameters.
        result : OptimizeResult
            Outcome of the refinement, with `x0` in the basis of this model.
        """
        noise = "innovations" if self.n_measured else "output"
        structure = predictor(
            state_space(
                len(self.A),
                self.nu,
                len(self.C),
                feedthrough=self.feedthrough,
                disturbances=given,
                noise=noise,
                drift=self.drift,
            )
        )
        result = OptimizeResult({**(self.result or {}), "x0": self.starts(given)})
        return structure, structure.join(self.by_name(given)), result


class AllEntries(Criterion):
    """Evaluate |r|, J'r and J'J of a linear model by the entries of its matrices.

    Parameters
    ----------
    experiments : sequence of tuple of array, or Held
        Pairs (u, y) of scaled deviations.
    model : LinearModel
        Where the search starts.

    Attributes
    ----------
    start : ndarray of shape (n,)
        Free vector of the model.
    """

    def __init__(self, experiments, model):
        structure = model.structure
        super().__init__(structure, experiments)
        self.start = self.join(structure.join(vars(model)), model.x0)
        self.held = np.zeros(self.n, dtype=bool)
        if model.feedthrough and model.n_measured:  # no output is told to itself
            shape = structure.shapes["D"]
            place = np.arange(model.D.size).reshape(shape)[:, model.nu :]
            self.held[structure.slices["D"].start + place.ravel()] = True

    def normal_equations(self, free):
        """Return J'J, J'r and |r|, where nothing moves what is held.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        JJ : ndarray of shape (n, n)
            Gauss-Newton matrix.
        Jr : ndarray of shape (n,)
            Half the gradient of |r|^2.
        norm : float
            Norm of the residual.
        """
        JJ, Jr, norm = super().normal_equations(free)
        JJ[self.held], JJ[:, self.held], Jr[self.held] = 0.0, 0.0, 0.0
        return JJ, Jr, norm

    def matrices(self, free):
        """Return the model of a free vector.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        matrices : dict of str to ndarray
            A, B, C, D (if it is free) and x0.
        """
        theta, x0 = self.split(free)
        return {**self.structure.split(theta), "x0": x0}

    def solved(self):
        """Return the model of the start with the best B, D and x0.

        Returns
        -------
        matrices : dict of str to ndarray
            A, B, C, D (if it is free) and x0.
        """
        is_linear = ~self.held
        for name in ("A", "C"):
            is_linear[self.structure.slices[name]] = False
        part = Restricted(self, self.start, is_linear)
        # the residual is linear in (B, D, x0): one Gauss-Newton step solves
        try:
            JJ, Jr, _ = part.normal_equations(self.start[is_linear])
        except FloatingPointError:  # they overflow: the start is left as it is
            return self.matrices(self.start)
        return self.matrices(part.to_free(self.start[is_linear] - lstsq(JJ, Jr)[0]))


def stabilize(A, limit=RADIUS_LIMIT):
    """Move eigenvalues of a matrix into a disc.

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix.
    limit : float, default=0.999
        Largest modulus allowed.

    Returns
    -------
    A : ndarray of shape (nx, nx)
        The matrix itself if its spectral radius is at most `limit`; else one with
        eigenvalues reflected at the unit circle and cut to the limit.
    """
    eigenvalues, vectors = np.linalg.eig(A)
    modulus = np.abs(eigenvalues)
    if modulus.max() <= limit:
        return A
    if np.linalg.cond(vectors) > 1e8:  # nearly defective: shrink the matrix
        return A * (limit / modulus.max())
    safe = np.maximum(modulus, 1e-300)
    target = np.minimum(np.where(modulus > 1, 1 / safe, modulus), limit)
    return np.real(vectors * (eigenvalues * target / safe) @ np.linalg.inv(vectors))


def forgets(experiments, model):
    """Tell whether a predictor forgets where it started.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    model : LinearModel
        Predictor.

    Returns
    -------
    forgets : bool
        Whether the error behind the first tenth of the experiments is about the same
        from the fitted initial states and from the operating point.
    """
    later = []
    for u, y in experiments:
        y = np.array(y[:])
        y[: len(y) // 10] = np.nan
        later.append((u, y))
    at_rest = replace(model, x0=np.zeros_like(model.x0))
    known, unknown = (simulation_error(later, one) for one in (model, at_rest))
    return bool(unknown <= FORGOTTEN * known + SMALL_ERROR)


def simulation_error(experiments, model):
    """Return the simulation error of a linear model.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    model : LinearModel
        Model, with an initial state for every experiment.

    Returns
    -------
    error : float
        Norm of the residual over the measured outputs (eq. cost).
    """
    problem = AllEntries(experiments, model.whole())
    return problem.norm(problem.start)


def normalize(model, experiments):
    """Scale the states to unit variance over the record.

    Parameters
    ----------
    model : LinearModel
        Model.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.

    Returns
    -------
    model : LinearModel
        The model with scaled states.
    std : ndarray of shape (nx,)
        States before over states after.
    """
    variance = np.diag(_state_covariance(model, experiments))
    std = np.sqrt(np.maximum(variance, 0.0))  # rounding goes below
    std = np.where((std > 0) & np.isfinite(std), std, 1.0)
    scaled = replace(
        model,
        A=model.A * std / std[:, None],
        B=model.B / std[:, None],
        C=model.C * std,
        x0=model.x0 / std,
    )
    return scaled, std


def decorrelate(model, experiments):
    """Bring a model into the basis of uncorrelated states of unit variance.

    Among these bases, the one whose states contribute to later outputs one by one and
    in falling order: a balanced realization for the spectrum of the record. States of
    two poles close to each other would else be nearly the same, and a network that
    sees them would see one; a white input makes A a contraction.

    Parameters
    ----------
    model : LinearModel
        Stable model.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.

    Returns
    -------
    model : LinearModel
        The model in this basis; as it is where a state does not move.
    """
    model, _ = normalize(model, experiments)
    covariance = _state_covariance(model, experiments)
    if not np.isfinite(covariance).all():
        return model
    variance, V = eigh(covariance)
    radius = np.abs(np.linalg.eigvals(model.A)).max()
    if not variance[0] > LEAST_VARIANCE * variance[-1] or not radius < 1:
        return model
    T = (V / np.sqrt(variance)).T  # T cov T' = I
    T_inv = V * np.sqrt(variance)
    A, C = T @ model.A @ T_inv, model.C @ T_inv
    with warnings.catch_warnings():  # any order of the states is one
        warnings.simplefilter("ignore", RuntimeWarning)  # of a pole next to the circle
        energy, U = eigh(solve_discrete_lyapunov(A.T, C.T @ C))
    U = U[:, np.argsort(-energy)]
    # an eigenvector has no sign of its own: rounding is not to choose the basis
    seen = C @ U
    U = U * np.where(seen[np.abs(seen).argmax(axis=0), range(len(A))] < 0, -1.0, 1.0)
    return model.in_basis(U.T @ T, T_inv @ U)


@np.errstate(over="ignore", invalid="ignore")
def _state_covariance(model, experiments):
    """Return the covariance of the simulated states, not finite if they diverge."""
    nx, model = len(model.A), model.whole()
    structure = model.structure
    lure = structure.lure(structure.join(vars(model)))
    count, total, square = 0, 0.0, 0.0
    for (u, _), x0 in zip(experiments, model.x0, strict=True):
        for _, _, X in trajectory(lure, u, x0, size=np.inf):
            count += len(X) - 1
            total = total + X[:-1].sum(axis=0)
            square = square + X[:-1].T @ X[:-1]
    mean = total / count
    return (square / count - np.outer(mean, mean))[:nx, :nx]
