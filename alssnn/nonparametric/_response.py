"""The value that both methods return."""

from dataclasses import dataclass
from importlib import import_module

import numpy as np
from scipy.special import stdtrit

from ..checks import probability
from ..shown import percent


@dataclass(frozen=True, eq=False, repr=False)
class BestLinearApproximation:
    """Hold a measured frequency response, its uncertainty, and levels of disturbances.

    Levels are root mean square values, in units of y, of what lies in one line of the
    spectrum, as wide as `resolution`: their squares add up to a mean square over time.
    A level that the record or the method cannot tell is nan.

    Parameters
    ----------
    frequencies : ndarray of shape (n_freq,)
        Frequencies, in Hz.
    G : ndarray of complex of shape (n_freq, ny, nu)
        Frequency response, in units of y per unit of u.
    covariance : ndarray of complex of shape (n_freq, ny * nu, ny * nu)
        Covariance E[d d^H] of the errors d of ``G[k].ravel()``, by noise and by
        nonlinear distortions, which are circular complex.
    noise_covariance : ndarray of complex of shape (n_freq, ny * nu, ny * nu)
        The part of noise.
    dof : int
        Complex degrees of freedom of `covariance`.
    output : ndarray of shape (n_freq, ny)
        Level of the output.
    noise : ndarray of shape (n_freq, ny)
        Level of the noise in one period.
    distortion : ndarray of shape (n_freq, ny)
        Level of the nonlinear distortions at the lines of G.
    even, odd : ndarray of shape (n_freq, ny)
        Levels of even and odd distortions, from lines beside those of G that were not
        excited.
    total : ndarray of shape (n_freq, ny)
        Level of all that no linear model explains.
    noise_rms, total_rms : ndarray of shape (ny,)
        Noise, and all that no linear model explains, over all frequencies but zero.
    output_rms : ndarray of shape (ny,)
        Output without its mean.
    p_linear : float
        How likely a linear plant shows as much distortion as this; small values speak
        against a linear plant. Nan if it was not tested.
    method : {"robust", "fast", "local"}
        Where the covariance comes from.
    resolution : float
        Distance of two lines, in Hz.
    dt : float
        Sampling time, in seconds.
    input_names, output_names : tuple of str
        Names of the signals.

    Examples
    --------
    >>> from alssnn.excitation import multisine
    >>> from alssnn.nonparametric import best_linear_approximation
    >>> excitation = multisine(256, random_state=0)
    >>> u = excitation.u[:, 0]
    >>> noise = 0.01 * np.random.default_rng(0).standard_normal(len(u))
    >>> bla = best_linear_approximation(excitation, 2 * u + 0.1 * u**3 + noise)
    >>> bla
    BestLinearApproximation('robust', n_freq=102, ny=1, nu=1, noise 1.6 %, nonlinear)
    >>> low, high = bla.band(0.95)
    >>> low.shape, bool(bla.p_linear < 1e-6)
    ((102, 1, 1), True)
    """

    frequencies: np.ndarray
    G: np.ndarray
    covariance: np.ndarray
    noise_covariance: np.ndarray
    dof: int
    output: np.ndarray
    noise: np.ndarray
    distortion: np.ndarray
    even: np.ndarray
    odd: np.ndarray
    total: np.ndarray
    noise_rms: np.ndarray
    total_rms: np.ndarray
    output_rms: np.ndarray
    p_linear: float
    method: str
    resolution: float
    dt: float
    input_names: tuple
    output_names: tuple

    def __repr__(self):
        """Return one line with sizes and findings."""
        n, ny, nu = self.G.shape
        size = np.where(self.output_rms > 0, self.output_rms, 1.0)
        name, level = "noise", self.noise_rms
        if np.isnan(level).any():
            name, level = "not linear or noise", self.total_rms
        share = 100 * np.max(level / size)
        text = f"n_freq={n}, ny={ny}, nu={nu}, {name} {percent(share)}"
        if np.isfinite(self.p_linear):
            text += ", nonlinear" if self.p_linear < 0.05 else ", no distortion seen"
        return f"BestLinearApproximation({self.method!r}, {text})"

    @property
    def std(self):
        """Return the standard error of G, root of E|d|^2, shape (n_freq, ny, nu)."""
        return _std(self.covariance, self.G.shape)

    @property
    def noise_std(self):
        """Return the part of the noise in `std`, shape (n_freq, ny, nu)."""
        return _std(self.noise_covariance, self.G.shape)

    def radius(self, level=0.95):
        """Return the radii of confidence circles around G (eq. circle).

        Parameters
        ----------
        level : float, default=0.95
            Probability that the true response is within the circle, at one frequency.

        Returns
        -------
        radius : ndarray of shape (n_freq, ny, nu)
            Radii; the variance counts as estimated, with `dof` degrees of freedom.

        Raises
        ------
        ValueError
            If `level` is not between 0 and 1.
        """
        level = probability(level)
        # (eq. circle): the quantile of F with 2 and 2 dof degrees of freedom
        quantile = self.dof * ((1 - level) ** (-1 / self.dof) - 1)
        return np.sqrt(quantile) * self.std

    def covers(self, G, level=0.95):
        """Tell where confidence circles cover a response.

        Parameters
        ----------
        G : array_like of complex of shape (n_freq, ny, nu)
            Response at `frequencies`, such as that of a model.
        level : float, default=0.95
            Probability of every circle.

        Returns
        -------
        covered : ndarray of bool of shape (n_freq, ny, nu)
            Whether it is inside.

        Raises
        ------
        ValueError
            If the shape is another one, or `level` is not between 0 and 1.
        """
        G = np.asarray(G)
        if G.shape != self.G.shape:
            raise ValueError(
                f"`G` must have shape {self.G.shape}, got {G.shape}. Evaluate it at "
                "`frequencies`."
            )
        return np.abs(G - self.G) <= self.radius(level)

    def band(self, level=0.95):
        """Return pointwise confidence limits of the magnitude of G.

        Parameters
        ----------
        level : float, default=0.95
            Probability that the limits cover the magnitude, at one frequency.

        Returns
        -------
        low, high : ndarray of shape (n_freq, ny, nu)
            Limits; none is negative.

        Raises
        ------
        ValueError
            If `level` is not between 0 and 1.

        Notes
        -----
        To first order, as the magnitude moves by the part of the error along G.
        `covers` also holds where the error is as large as G.
        """
        quantile = stdtrit(2 * self.dof, (1 + probability(level)) / 2)
        half = quantile * self.std / np.sqrt(2)
        size = np.abs(self.G)
        return np.maximum(size - half, 0.0), size + half

    def to_frd(self):
        """Return the response as a system of python-control.

        Returns
        -------
        sys : control.FrequencyResponseData
            Response at ``2 pi frequencies``, in rad/s, with the sampling time and the
            names of the signals. Frequencies without a response are left out.
        """
        import control  # here, so that looking at a record stays light

        known = np.isfinite(self.G).all(axis=(1, 2))
        return control.FrequencyResponseData(
            np.moveaxis(self.G[known], 0, -1),
            2 * np.pi * self.frequencies[known],
            self.dt,
            inputs=list(self.input_names),
            outputs=list(self.output_names),
        )

    def plot(self, ax=None, **kwargs):
        """Draw the response with its standard errors, and the levels of the output.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One axes per output and input, and one more per output; None makes a figure.
        **kwargs : dict
            Options of the response.

        Returns
        -------
        display : ApproximationDisplay
            The display of :mod:`alssnn.plotting`, drawn.
        """
        # by name: figures lie above what is drawn, and matplotlib loads when asked for
        plotting = import_module("alssnn.plotting")
        return plotting.ApproximationDisplay(self).plot(ax, **kwargs)


def _std(covariance, shape):
    """Return the roots of the diagonals, in the shape of G."""
    diagonal = np.diagonal(covariance, axis1=1, axis2=2).real
    return np.sqrt(np.maximum(diagonal, 0.0)).reshape(shape)


def error_covariance(C, W):
    """Return the covariance of the entries of G = Y W, row by row.

    Parameters
    ----------
    C : ndarray of complex of shape (n_freq, ny, ny)
        Covariance of an output spectrum.
    W : ndarray of complex of shape (n_freq, n, nu)
        What multiplies n independent ones.

    Returns
    -------
    covariance : ndarray of complex of shape (n_freq, ny * nu, ny * nu)
        Kronecker products of C and W'W*.
    """
    WW = np.swapaxes(W, 1, 2) @ W.conj()
    n, ny, nu = len(C), C.shape[1], WW.shape[1]
    return np.einsum("kil,kjm->kijlm", C, WW).reshape(n, ny * nu, ny * nu)
