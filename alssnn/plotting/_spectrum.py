"""Amplitude spectra of signals, in their own unit."""

import numpy as np
from scipy import signal

SEGMENT = 1024  # samples of a Welch segment


def amplitude_spectrum(z, dt):
    """Return the root of the Welch spectrum, Hann window, without its zero frequency.

    Parameters
    ----------
    z : ndarray of shape (N,)
        Signal.
    dt : float
        Sampling time, in seconds.

    Returns
    -------
    f : ndarray of shape (n,)
        Frequencies, in Hz.
    amplitude : ndarray of shape (n,)
        A sine of amplitude a shows as a / sqrt(2), in the unit of the signal.
    """
    f, power = signal.welch(
        z, fs=1 / dt, nperseg=min(SEGMENT, len(z)), scaling="spectrum"
    )
    return f[1:], np.sqrt(power[1:])  # no zero on logarithmic axes
