"""Limits of actuators: where a signal may be, and how fast it may move.

A signal is made of a shape s without units.  What has a spectrum is scaled as a whole,

    u = u_0 + a s,    a = the largest one with low <= u <= high and |du/dt| <= rate,

the same a for all realizations and experiments: the best linear approximation depends
on the power of the input, which therefore must not change from one to the next.  What
has levels moves between them as fast as it may (`slew`).
"""

from dataclasses import dataclass

import numpy as np

from ..checks import numbers_of_shape
from ..names import signal_names

ROUNDS = 10_000  # periods until a signal of limited rate repeats itself, at most


@dataclass(frozen=True)
class Limits:
    """Hold the limits of all inputs.

    Parameters
    ----------
    low, high, operating_point : ndarray of shape (nu,)
        Limits, and the value around which the plant is excited.
    rate : ndarray of shape (nu,)
        Largest change per second; inf without a limit.
    """

    low: np.ndarray
    high: np.ndarray
    operating_point: np.ndarray
    rate: np.ndarray

    @classmethod
    def of(cls, nu, low, high, operating_point, rate):
        """Check limits and give them one entry per input.

        Parameters
        ----------
        nu : int
            Number of inputs.
        low, high : float or array_like of shape (nu,)
            Limits.
        operating_point : float, array_like of shape (nu,) or None
            Value around which the plant is excited; None means the middle.
        rate : float, array_like of shape (nu,) or None
            Largest change per second; None means any.

        Returns
        -------
        limits : Limits
            The limits.

        Raises
        ------
        ValueError
            If they have the wrong size, are not finite, or contradict each other.
        """
        low, high = vector("low", low, nu), vector("high", high, nu)
        if not np.all(low < high):
            raise ValueError(
                f"`low` must be below `high`, got {low.tolist()} and {high.tolist()}. "
                "Give the lowest value that the actuator may take first."
            )
        if operating_point is None:
            point = (low + high) / 2
        else:
            point = vector("operating_point", operating_point, nu)
        if not np.all((low < point) & (point < high)):
            raise ValueError(
                f"`operating_point` must lie between `low` and `high`, got "
                f"{point.tolist()} for {low.tolist()} to {high.tolist()}. There must "
                "be room to both sides of it."
            )
        limit = np.full(nu, np.inf) if rate is None else vector("rate", rate, nu)
        if not np.all(limit > 0):
            raise ValueError(
                f"`rate` must be positive, got {limit.tolist()}. Give the largest "
                "change in units per second, or None."
            )
        return cls(low, high, point, limit)

    def scale(self, s, dt, n_periods):
        """Return a shape as large as it may be.

        Parameters
        ----------
        s : ndarray of shape (..., period, nu)
            One period of a shape around zero, of all experiments.
        dt : float
            Sampling time, in seconds.
        n_periods : int
            How often it will be repeated; from 2 on, the way back to its beginning
            counts as well.

        Returns
        -------
        u : ndarray of shape (..., period, nu)
            Inputs; the scale of an input is one for all experiments.
        """
        flat = s.reshape(-1, *s.shape[-2:])
        top, bottom = flat.max(axis=(0, 1)), -flat.min(axis=(0, 1))
        back = flat[:, : min(n_periods - 1, 1)]
        step = np.abs(np.diff(flat, axis=1, append=back)).max(axis=(0, 1))
        tiny = np.finfo(float).tiny
        a = np.minimum.reduce(
            [
                (self.high - self.operating_point) / np.maximum(top, tiny),
                (self.operating_point - self.low) / np.maximum(bottom, tiny),
                self.rate * dt / np.maximum(step, tiny),
            ]
        )
        # rounding must not leave the limits
        return np.clip(self.operating_point + a * s, self.low, self.high)

    def slew(self, u, dt, n_periods):
        """Let levels be approached no faster than the rate.

        Parameters
        ----------
        u : ndarray of shape (..., period, nu)
            Inputs of one period.
        dt : float
            Sampling time, in seconds.
        n_periods : int
            How often it will be repeated; from 2 on, it begins where it ends.

        Returns
        -------
        u : ndarray of shape (..., period, nu)
            Inputs that change by no more than the rate.
        """
        if np.all(np.isinf(self.rate)):
            return u
        step, slow = self.rate * dt, np.array(u)
        before = u[..., 0 if n_periods == 1 else -1, :]
        # Round by round until it begins where it ends: where a slow signal starts moves
        # in one direction, until the signal reaches one of its levels.
        for _ in range(1 if n_periods == 1 else ROUNDS):
            start = before
            for k in range(u.shape[-2]):
                before = before + np.clip(u[..., k, :] - before, -step, step)
                slow[..., k, :] = before
            if np.allclose(before, start, rtol=0, atol=1e-12 * np.max(step)):
                break
        return slow


def vector(name, value, size):
    """Return finite numbers, one per input.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : float or array_like of shape (size,)
        Numbers; one is taken for all inputs.
    size : int
        Number of inputs.

    Returns
    -------
    numbers : ndarray of shape (size,)
        The numbers.

    Raises
    ------
    ValueError
        If there are more or fewer, or one is not finite.
    """
    numbers = numbers_of_shape(value, size)
    if not np.isfinite(numbers).all():
        raise ValueError(
            f"`{name}` must be a finite number or {size} of them, one per input, got "
            f"{value!r}."
        )
    return numbers


def input_names(names, nu):
    """Return names of inputs.

    Parameters
    ----------
    names : sequence of str or None
        Names; None means u[0], u[1], ...
    nu : int
        Number of inputs.

    Returns
    -------
    names : tuple of str
        The names.

    Raises
    ------
    ValueError
        If there are more or fewer than inputs, or two are equal.
    """
    if names is None:
        return tuple(signal_names(None, "u", nu))
    names = (names,) if isinstance(names, str) else tuple(map(str, names))
    if len(names) != nu or len({*names, "time", "experiment"}) != nu + 2:
        raise ValueError(
            f"`names` must be {nu} different names, one per input, none of them time "
            f"or experiment, got {list(names)}."
        )
    return names


def frequency_band(band, dt, highest):
    """Return a band of frequencies.

    Parameters
    ----------
    band : tuple of float or None
        Lowest and highest frequency, in Hz; None means up to `highest`.
    dt : float
        Sampling time, in seconds.
    highest : float
        Share of the Nyquist frequency that None stands for.

    Returns
    -------
    low, high : float
        The band, in Hz.

    Raises
    ------
    ValueError
        If it is no increasing pair, or not below the Nyquist frequency.
    """
    nyquist = 0.5 / dt
    if band is None:
        return 0.0, highest * nyquist
    try:
        low, high = (float(f) for f in band)
    except (TypeError, ValueError):
        low, high = np.nan, np.nan
    if not 0 <= low < high:
        raise ValueError(
            f"`band` must be a pair of frequencies in Hz that increase, got {band!r}."
        )
    if high >= nyquist:
        raise ValueError(
            f"`band` must end below the Nyquist frequency, {nyquist:g} Hz at "
            f"dt = {dt:g} s, got {high:g} Hz. Sample faster, or excite a lower band."
        )
    return low, high
