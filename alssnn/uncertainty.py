r"""How far the parameters of a fitted model can be trusted: what noise does to them.

To first order, noise e at the outputs moves the optimum (eq. sandwich) by

    delta = -H^+ sum_k F_k' e_k,     H = J'J of the cost,     F = d yhat / d(theta, x0),

F weighted, so that the covariance of (theta, x0) is the sandwich

    P = H^+ (sum_k,l F_k' Gamma(k-l) F_l) H^+,          Gamma(k-l) = E[e_k e_l']

with the covariance function Gamma of the residuals of the training data, as that of an
autoregression (`noise`), and scaled for what the parameters took out of them.  White
noise is the case Gamma(l) = 0 but for l = 0.  H holds the penalties of the training,
whose bias P does not tell; without them, in white noise, P is the inverse of the
information.  The state basis is not identifiable: H is singular along changes of it, ^+
is the pseudo-inverse, and entries of A, B, C alone have no standard error worth the
name.  What does not depend on the basis has one: the frequency response, by

    dG = C R dA R B + C R dB + dC R B + dD,      R = (z I - A)^-1

and the poles, by d lambda_i = l_i dA r_i / (l_i r_i) with left and right eigenvectors.

The effective number of parameters (eq. effective) is tr(H^+ J_y'J_y), the rank of the
Gauss-Newton matrix where nothing is penalized.

It takes the noise for added to the output and independent of u, the model structure for
right and the deviation for small.  Noise that is correlated over time and reaches u by
feedback biases the simulation error: P tells nothing of that.  It is tested (eq.
weighting) and said, and the covariance is P + b b' with the bias b that shows.  If b is
too large for noise by far, no interval around the fit is shown.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eig, eigh
from scipy.special import chdtri, ndtri
from sklearn.utils import check_random_state

from .checks import probability
from .noise import Noise
from .shown import short_repr

N_FREQUENCIES = 200  # of a frequency response, by default


@dataclass(frozen=True, eq=False)
class FrequencyBand:
    """Hold a frequency response and its uncertainty.

    Parameters
    ----------
    omega : ndarray of shape (n_frequencies,)
        Frequencies, in rad/s.
    response : ndarray of complex of shape (n_frequencies, ny, nv)
        G from every input to every output, in units of y per unit of u.
    covariance : ndarray of shape (n_frequencies, ny, nv, 2, 2)
        Covariance of (Re G, Im G).
    holds : bool, default=True
        Whether intervals of this width cover the truth; see `ParameterCovariance`.
        If not, limits are nan.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> u, e = rng.standard_normal((2, 500))
    >>> y = np.convolve(u, [0, 1, 0.8, 0.64])[:500] + 0.1 * e
    >>> model = alssnn.LinearStateSpace(nx=3).fit(u[:, None], y)
    >>> band = model.parameter_covariance(u[:, None], y).frequency_response()
    >>> low, high = band.magnitude_band(0.95)
    >>> bool(np.all(low <= abs(band.response))), bool(band.covers(band.response).all())
    (True, True)
    """

    __repr__ = short_repr

    omega: np.ndarray
    response: np.ndarray
    covariance: np.ndarray
    holds: bool = True

    @property
    def magnitude_std(self):
        """Return the standard error of the magnitude, shape (n_frequencies, ny, nv)."""
        return _modulus_std(self.response, self.covariance)

    @property
    def phase_std(self):
        """Return the standard error of the phase in rad, (n_frequencies, ny, nv)."""
        square = np.maximum(np.abs(self.response) ** 2, np.finfo(float).tiny)
        across = np.stack([-self.response.imag, self.response.real], -1)
        return _spread(across / square[..., None], self.covariance)

    def magnitude_band(self, level=0.95):
        """Return pointwise confidence limits of the magnitude.

        Parameters
        ----------
        level : float, default=0.95
            Probability that the band covers the magnitude at one frequency.

        Returns
        -------
        low, high : ndarray of shape (n_frequencies, ny, nv)
            Limits; none is negative. Nan where there is no such band (`holds`).

        Raises
        ------
        ValueError
            If `level` is not between 0 and 1.
        """
        half = ndtri((1 + probability(level)) / 2) * self.magnitude_std
        half = half if self.holds else np.full_like(half, np.nan)
        size = np.abs(self.response)
        return np.maximum(size - half, 0.0), size + half

    def covers(self, response, level=0.95):
        """Tell where confidence ellipses in the complex plane cover a response.

        Parameters
        ----------
        response : ndarray of complex of shape (n_frequencies, ny, nv)
            Response at the same frequencies, such as the true one.
        level : float, default=0.95
            Probability of every ellipse.

        Returns
        -------
        covered : ndarray of bool of shape (n_frequencies, ny, nv)
            Whether the response is inside; nowhere if there is no such ellipse
            (`holds`).

        Raises
        ------
        ValueError
            If `level` is not between 0 and 1.
        """
        error = np.asarray(response) - self.response
        d = np.stack([error.real, error.imag], -1)
        weighted = np.linalg.pinv(self.covariance, hermitian=True) @ d[..., None]
        # chi2 of two degrees of freedom
        square = (d[..., None, :] @ weighted)[..., 0, 0]
        return self.holds & (square <= chdtri(2, 1 - probability(level)))


@dataclass(frozen=True, eq=False)
class PoleRegions:
    """Hold the poles of the linear part and their uncertainty.

    Parameters
    ----------
    poles : ndarray of complex of shape (nx,)
        Eigenvalues of A.
    covariance : ndarray of shape (nx, 2, 2)
        Covariance of (Re, Im) of every pole; that of a real pole is singular. Large
        for poles that almost coincide, where the first order says little.
    holds : bool, default=True
        Whether regions of this size cover the truth; see `ParameterCovariance`. If
        not, their boundaries are nan.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> u, e = rng.standard_normal((2, 500))
    >>> y = np.convolve(u, [0, 1, 0.8, 0.64])[:500] + 0.1 * e
    >>> model = alssnn.LinearStateSpace(nx=3).fit(u[:, None], y)
    >>> regions = model.parameter_covariance(u[:, None], y).poles()
    >>> regions.modulus_std.shape, regions.ellipses(n_points=16).shape
    ((3,), (3, 16))
    """

    __repr__ = short_repr

    poles: np.ndarray
    covariance: np.ndarray
    holds: bool = True

    @property
    def modulus_std(self):
        """Return the standard error of the modulus of every pole, shape (nx,)."""
        return _modulus_std(self.poles, self.covariance)

    def ellipses(self, level=0.95, n_points=64):
        """Return the boundaries of the confidence regions.

        Parameters
        ----------
        level : float, default=0.95
            Probability of every region.
        n_points : int, default=64
            Points on every boundary.

        Returns
        -------
        points : ndarray of complex of shape (nx, n_points)
            Closed curves in the complex plane; for a real pole an interval. Nan if
            there is no such region (`holds`).

        Raises
        ------
        ValueError
            If `level` is not between 0 and 1.
        """
        angle = np.linspace(0, 2 * np.pi, n_points)
        circle = np.stack([np.cos(angle), np.sin(angle)])
        values, Q = np.linalg.eigh(self.covariance)
        real = np.abs(self.poles.imag) <= 1e-12 * np.abs(self.poles)
        # one degree of freedom for a real pole, two for a complex one
        radius = np.sqrt(chdtri(np.where(real, 1, 2), 1 - probability(level)))
        axes = Q * (np.sqrt(np.maximum(values, 0.0)) * radius[:, None])[:, None, :]
        points = axes @ circle
        points = points if self.holds else np.full_like(points, np.nan)
        return self.poles[:, None] + points[:, 0] + 1j * points[:, 1]


@dataclass(frozen=True, eq=False)
class ParameterCovariance:
    """Hold the first-order uncertainty of a fitted model.

    Parameters
    ----------
    theta : ndarray of shape (n_params,)
        Fitted parameters, of scaled deviations.
    covariance : ndarray of shape (n_params, n_params)
        Their covariance: a pseudo-inverse, since the state basis is free. Only what
        does not depend on the basis has meaning on its own.
    noise_covariance : ndarray of shape (ny, ny)
        Covariance of the output noise, in the units of y.
    n_effective : float
        Effective number of parameters, initial states included.
    rank : int
        Rank of the Gauss-Newton matrix of the simulation error.
    n_samples : int
        Number of samples.
    structure : Structure
        Structure of the model.
    units : dict
        Units of the user over those of the fit, of u, y and x.
    dt : float
        Sampling time, in seconds.
    input_delay : ndarray of int of shape (nu,)
        Samples by which each input arrives late.
    noise : Noise
        Correlation of the output noise over time, in the units of y.
    p_weighting : float
        How likely the fit moves as it does when the noise is weighed by its color, if
        the model is right and u does not depend on the noise (eq. weighting).
    bias : ndarray of shape (n_params,)
        How far the fit moves then, where noise is unlikely to explain it: `covariance`
        has its square, too (eq. bias). Zero elsewhere.
    pull : ndarray of shape (n_params,)
        Step from the fit to the optimum of its cost without `alpha` and active bounds,
        to first order: `covariance` has its square, too (eq. pull).
    reason : str
        Why no interval around the fit covers the truth; "" if one does.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> u, e = rng.standard_normal((2, 500))
    >>> y = np.convolve(u, [0, 1, 0.8, 0.64])[:500] + 0.1 * e
    >>> model = alssnn.LinearStateSpace(nx=3).fit(u[:, None], y)
    >>> covariance = model.parameter_covariance(u[:, None], y)
    >>> covariance.poles().poles.shape, covariance.noise_covariance.shape
    ((3,), (1, 1))
    """

    theta: np.ndarray
    covariance: np.ndarray
    noise_covariance: np.ndarray
    n_effective: float
    rank: int
    n_samples: int
    structure: Any
    units: dict
    dt: float
    input_delay: np.ndarray
    noise: Noise
    p_weighting: float
    bias: np.ndarray
    pull: np.ndarray
    reason: str

    def __repr__(self):
        """Return the figures in one line."""
        return (
            f"ParameterCovariance(n_params={len(self.theta)}, rank={self.rank}, "
            f"n_effective={self.n_effective:.4g}, n_samples={self.n_samples}, "
            f"holds={self.holds})"
        )

    @property
    def holds(self):
        """Return whether intervals of this width cover the truth; see `reason`."""
        return not self.reason

    def _linear(self):
        """Return (A, B, C, D) of scaled deviations."""
        structure = self.structure
        p = {**structure.constants, **structure.split(self.theta)}
        D = p.get("D", np.zeros((len(p["C"]), p["B"].shape[1])))
        return p["A"], p["B"], p["C"], D

    def frequency_response(self, omega=None):
        """Return the frequency response of the linear part with its uncertainty.

        Parameters
        ----------
        omega : array_like of shape (n_frequencies,) or None, default=None
            Frequencies, in rad/s; None means 200 from a thousandth of the Nyquist
            frequency up to it.

        Returns
        -------
        band : FrequencyBand
            Response of (A, B, C, D), which does not depend on the state basis; from
            the inputs that are moved.

        Raises
        ------
        ValueError
            If frequencies are not a vector, not finite, or the response has a pole at
            one.
        """
        nyquist = np.pi / self.dt
        if omega is None:
            omega = np.geomspace(1e-3 * nyquist, nyquist, N_FREQUENCIES)
        omega = np.atleast_1d(np.asarray(omega, dtype=float))
        if omega.ndim != 1 or len(omega) == 0 or not np.isfinite(omega).all():
            raise ValueError(
                "`omega` must be a vector of finite frequencies in rad/s, at least "
                f"one, got {omega.tolist()}."
            )
        A, B, C, D = self._linear()
        s = 1j * omega * self.dt
        z = np.exp(s)
        point = z if self.structure.sampling is None else s
        try:
            R = np.linalg.inv(point[:, None, None] * np.eye(len(A)) - A)
        except np.linalg.LinAlgError:
            raise ValueError(
                "`omega` must not hold the frequency of an undamped pole, got "
                f"{omega.tolist()}. Move it a little."
            ) from None
        CR, RB = C @ R, R @ B
        delay = np.delete(self.input_delay, self.structure.given)
        late = z[:, None] ** -delay  # (F, nv)
        units = self.structure.by_axis(self.units)
        scale = late[:, None, :] * units["y"][:, None] / units["moved"]  # (F, ny, nv)
        ny, nv = D.shape
        dG = np.zeros((len(omega), ny, nv, len(self.theta)), dtype=complex)
        eye_u, eye_y = np.eye(nv), np.eye(ny)
        # dG_ij / dM_kl = (what is left of M)_ik (what is right of it)_lj
        parts = {
            "A": np.einsum("fik,flj->fijkl", CR, RB),
            "B": np.einsum("fik,lj->fijkl", CR, eye_u),
            "C": np.einsum("ik,flj->fijkl", eye_y, RB),
            "D": np.einsum("ik,lj->ijkl", eye_y, eye_u)[None],
        }
        for name, where in self.structure.slices.items():
            if name in parts:
                part = parts[name]
                dG[..., where] = part.reshape(len(part), ny, nv, -1)
        dG *= scale[..., None]
        jacobian = np.stack([dG.real, dG.imag], axis=-2)
        covariance = jacobian @ self.covariance @ np.swapaxes(jacobian, -1, -2)
        return FrequencyBand(omega, (CR @ B + D) * scale, covariance, self.holds)

    def poles(self):
        """Return the poles of the linear part with their uncertainty.

        Returns
        -------
        regions : PoleRegions
            Eigenvalues of A, which do not depend on the state basis; in continuous time
            in rad/s.
        """
        A, *_ = self._linear()
        rate = 1.0 if self.structure.sampling is None else 1.0 / self.dt
        poles, left, right = eig(A, left=True, right=True)
        left = left.conj() / np.sum(left.conj() * right, axis=0)  # l_i r_i = 1
        where = self.structure.slices["A"]
        d = np.einsum("ki,li->ikl", left, right).reshape(len(poles), -1)
        jacobian = np.stack([d.real, d.imag], axis=1)
        P = self.covariance[where, where]
        covariance = jacobian @ P @ np.swapaxes(jacobian, 1, 2)
        return PoleRegions(rate * poles, rate**2 * covariance, self.holds)

    def sample(self, n_models=1, random_state=None):
        """Draw parameters from their normal approximation.

        Of no use along directions that the data hardly determine: see `data` of
        ``sample_models``.

        Parameters
        ----------
        n_models : int, default=1
            Number of draws.
        random_state : int, RandomState instance or None, default=None
            Source of the draws.

        Returns
        -------
        theta : ndarray of shape (n_models, n_params)
            Parameters of scaled deviations, in the basis of the fit.
        """
        values, Q = eigh(self.covariance)
        draws = check_random_state(random_state).standard_normal(
            (n_models, len(self.theta))
        )
        return self.theta + draws * np.sqrt(np.maximum(values, 0.0)) @ Q.T


def _modulus_std(z, covariance):
    """Return the standard errors of the modulus of complex numbers."""
    size = np.maximum(np.abs(z), np.finfo(float).tiny)
    return _spread(np.stack([z.real, z.imag], -1) / size[..., None], covariance)


def _spread(gradient, covariance):
    """Return the standard errors of functions of (Re, Im) with given gradients."""
    square = gradient[..., None, :] @ covariance @ gradient[..., None]
    return np.sqrt(np.maximum(square[..., 0, 0], 0.0))
