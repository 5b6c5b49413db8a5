"""What is found in a record, and how it is said."""

import textwrap
from dataclasses import dataclass, field

import numpy as np

from ..rows import Rows
from ._recommend import Recommendation

WIDTH = 79  # characters of a line


@dataclass(frozen=True)
class Finding:
    """Hold one answer about a record.

    Parameters
    ----------
    name : str
        What was asked.
    value : float
        The number behind the sentence; nan if it could not be told.
    sentence : str
        The answer, with what to do if something is to be done.
    attention : bool
        Whether something is to be done, or known before a fit.
    """

    name: str
    value: float
    sentence: str
    attention: bool


@dataclass(frozen=True, repr=False)
class FirstLook(Rows):
    """Hold what was found in a record; printed, it is a page in words.

    Parameters
    ----------
    findings : tuple of Finding
        Answers, in the order in which they matter.
    noise_rms : ndarray of shape (ny,) or None, default=None
        Root mean squares of the noise, below which no model goes; None unless periods
        or experiments with the same input tell it.
    recommendation : Recommendation or None, default=None
        Estimator to begin with, its options, and why; None if not asked for.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> u = rng.standard_normal((600, 1))
    >>> y = np.convolve(u[:, 0], [0, 0, 0, 1.0, 0.5])[:600]
    >>> y = y + 0.05 * rng.standard_normal(600)
    >>> page = alssnn.look(u, y)
    >>> page["delay"].value, page["nonlinearity"].attention
    (2.0, False)
    >>> print(page["gaps"].sentence)
    All outputs were measured at all samples.
    """

    _rows = "findings"

    findings: tuple[Finding, ...]
    noise_rms: np.ndarray | None = field(default=None, compare=False)
    recommendation: Recommendation | None = None

    def __repr__(self):
        """Return the names of what needs attention."""
        names = [one.name for one in self.findings if one.attention]
        return f"FirstLook(attention={names})"

    def __str__(self):
        """Return the page; an exclamation mark stands where attention is due."""
        lines = []
        for one in self.findings:
            mark = "!" if one.attention else " "
            head = f"{mark} {one.name:14s}"
            lines += textwrap.wrap(
                one.sentence, WIDTH, initial_indent=head, subsequent_indent=" " * 16
            )
        return "\n".join(lines)
