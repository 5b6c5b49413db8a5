"""Amplitudes of bounded inputs: checked, and in words."""

import numpy as np

from ..checks import as_numbers
from ._peaks import TooSlow, peaks


def sizes_in_words(sizes, labels=()):
    """Return amplitudes as a text.

    Parameters
    ----------
    sizes : ndarray of shape (nr,)
        Amplitudes.
    labels : sequence of str, default=()
        Names of the inputs.

    Returns
    -------
    text : str
        The text.
    """
    if not labels:
        return "|r| <= " + ", ".join(f"{size:.4g}" for size in sizes)
    pairs = zip(labels, sizes, strict=True)
    return ", ".join(f"|{label}| <= {size:.4g}" for label, size in pairs)


def checked_sizes(name, value, n, *, zero=False):
    """Return amplitudes, one per input.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : float or array_like of shape (n,)
        One number for all, or one per input.
    n : int
        Number of inputs.
    zero : bool, default=False
        Whether zero is allowed.

    Returns
    -------
    sizes : ndarray of shape (n,)
        The amplitudes.

    Raises
    ------
    ValueError
        If they are no numbers, of another shape, negative or not finite.
    """
    sizes = as_numbers(name, value)
    is_good = sizes.shape in ((), (n,)) and np.isfinite(sizes).all()
    if not is_good or np.any(sizes < 0) or not (zero or np.all(sizes > 0)):
        raise ValueError(
            f"`{name}` must be {'at least 0' if zero else 'positive'}, one number or "
            f"one per signal ({n}), got {value!r}. Give the largest modulus of each."
        )
    return np.broadcast_to(sizes, n).copy()


def peaks_of(design, amplitude):
    """Return the largest outputs of a linear design, and how long it remembers.

    Parameters
    ----------
    design : tuple of ndarray
        (A, B, C, D).
    amplitude : ndarray of shape (nr,)
        Largest modulus of every input.

    Returns
    -------
    peak : ndarray of shape (ny,)
        Largest modulus of every output.
    length : int
        Samples after which the response is over; a sentence, in place of both, if
        there is no such number.
    """
    try:
        found = peaks(*design)
    except TooSlow as problem:
        return str(problem)
    return found.gain @ amplitude, found.n_terms


def record_box(plant):
    """Return the largest moduli of the training record.

    Parameters
    ----------
    plant : Plant
        The plant.

    Returns
    -------
    box : ndarray of shape (nu + ny,)
        Of inputs and outputs, around the operating point; nan if nothing is known.
    """
    if plant.region is None:
        return np.full(plant.nu + plant.ny, np.nan)
    return np.maximum(np.abs(plant.region.low), np.abs(plant.region.high))


def within_record(plant, design, sizes, amplitude, chosen):
    """Return amplitudes: given ones, or those that keep the design within the record.

    Parameters
    ----------
    plant : Plant
        The plant, whose record it is.
    design : tuple of ndarray
        (A, B, C, D) of the linear design.
    sizes : ndarray of shape (nr,)
        Amplitudes of all inputs on the record.
    amplitude : float, array_like or None
        Amplitude of the chosen inputs; None reduces theirs until the worst linear
        response stays within the outputs of the record.
    chosen : ndarray of int
        Inputs that the user may choose.

    Returns
    -------
    sizes : ndarray of shape (nr,)
        The amplitudes.

    Raises
    ------
    ValueError
        If `amplitude` is none, or missing for a plant without a record.
    """
    sizes = sizes.copy()
    if amplitude is not None:
        sizes[chosen] = checked_sizes("amplitude", amplitude, len(chosen))
    if not np.isfinite(sizes).all():
        raise ValueError(
            "`amplitude` must be given for a plant without a region of its training "
            "data, and measured disturbances need that region. Give the largest "
            "modulus of every input, or fit the model anew."
        )
    linear = peaks_of(design, sizes)
    if amplitude is None and not isinstance(linear, str):
        share = record_box(plant)[plant.nu :] / np.maximum(linear[0], 1e-300)
        sizes[chosen] *= min(1.0, float(np.min(share)))
    return sizes
