"""A linear system that the user gives, in whatever form, as what can be kept.

Matrices, a system of python-control or a fitted model all say the same: A, B, C, D and
a sampling time.  Systems of python-control cannot be pickled, and neither fits into a
file; this record can and does.
"""

from dataclasses import dataclass

import numpy as np

from .inputs import join_inputs

LINEAR = ("A", "B", "C", "D")
FITTED = ("A_", "B_", "C_", "D_")


@dataclass(frozen=True, eq=False)
class GivenSystem:
    """Hold a discrete-time linear system in the units of the user.

    Parameters
    ----------
    A, B, C, D : ndarray
        Matrices; their sizes are not checked.
    dt : float, bool or None
        Sampling time, in seconds, as python-control has it; True stands for one that
        is not known, 0 for continuous time.
    inputs, outputs : tuple of str or None, default=None
        Names of the signals, if it has any.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    dt: float | bool | None = True
    inputs: tuple | None = None
    outputs: tuple | None = None

    @classmethod
    def of(cls, start):
        """Return a system in whatever form.

        Parameters
        ----------
        start : tuple of array_like, control.StateSpace, estimator or GivenSystem
            Matrices (A, B, C) or (A, B, C, D), or what has them.

        Returns
        -------
        system : GivenSystem
            The system; matrices alone have no sampling time.

        Raises
        ------
        ValueError
            If it is of another type.
        """
        if isinstance(start, tuple | list) and len(start) in (3, 4):
            A, B, C = (np.atleast_2d(np.array(M, dtype=float)) for M in start[:3])
            D = np.zeros((len(C), B.shape[1])) if len(start) == 3 else start[3]
            return cls(A, B, C, np.atleast_2d(np.array(D, dtype=float)))
        for names in (FITTED, LINEAR):
            if all(hasattr(start, name) for name in names):
                A, B, C, D = (np.array(getattr(start, n), dtype=float) for n in names)
                if names is FITTED:  # B and D of all inputs alike
                    given = start.disturbances_
                    B, D = (
                        join_inputs(*pair, given)
                        for pair in ((B, start.G_), (D, start.H_))
                    )
                is_continuous = getattr(start, "time", None) == "continuous"
                dt = 0.0 if is_continuous else getattr(start, "dt", True)
                return cls(A, B, C, D, dt, *_signals(start))
        raise ValueError(
            "`linear_start` must be a tuple (A, B, C) or (A, B, C, D), a discrete-time "
            f"`control.StateSpace` or a fitted model, got {type(start).__name__}. If "
            "the model was fitted, `clone` undid it: pass "
            "`sklearn.frozen.FrozenEstimator(model)`."
        )


def _signals(start):
    """Return the names of inputs and outputs; None for those that nobody gave."""
    given = (
        (getattr(start, "feature_names_in_", None), "u"),
        (getattr(start, "output_names_", None), "y"),
    )
    if hasattr(start, "input_labels"):
        given = (start.input_labels, "u"), (start.output_labels, "y")
    return tuple(
        None
        if names is None or list(names) == [f"{letter}[{i}]" for i in range(len(names))]
        else tuple(map(str, names))
        for names, letter in given
    )
