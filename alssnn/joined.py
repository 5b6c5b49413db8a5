"""Two criteria of the same parameters, added: other experiments, other channels."""

import numpy as np

from .criterion import LeastSquares


class Joined(LeastSquares):
    """Add a criterion of further experiments to a criterion.

    Parameters
    ----------
    first, second : Criterion
        Criteria whose structures have the same parameters. A free vector has these,
        the initial states of the first, and those of the second.

    Examples
    --------
    >>> import numpy as np
    >>> from alssnn.criterion import Criterion
    >>> from alssnn.joined import Joined
    >>> from alssnn.models import state_space
    >>> structure, u = state_space(1, 1, 1), np.ones((20, 1))
    >>> one, other = (Criterion(structure, [(u, level * u)]) for level in (1.0, 2.0))
    >>> both = Joined(one, other)
    >>> free = np.array([0.5, 0.1, 1.0, 0.0, 0.0])
    >>> square = one.norm(free[:4]) ** 2 + other.norm(free[[0, 1, 2, 4]]) ** 2
    >>> bool(np.isclose(both.norm(free) ** 2, square))
    True
    """

    def __init__(self, first, second):
        self.structure, self.parts = first.structure, (first, second)
        n = first.structure.n_params
        self.n = first.n + second.n - n
        states = np.arange(n, self.n)
        theirs = np.split(states, [first.n - n])
        self.places = [np.concatenate([np.arange(n), own]) for own in theirs]

    def holding(self, held):  # numpydoc ignore=PR01,RT01
        """Return the same criterion without derivatives by some parameters."""
        return Joined(*(part.holding(held) for part in self.parts))

    def _each(self, free):
        """Return every criterion with its own free vector and the place of that."""
        pairs = zip(self.parts, self.places, strict=True)
        return [(part, free[place], place) for part, place in pairs]

    def norm(self, free):  # numpydoc ignore=PR01,RT01
        """Return |r|."""
        return float(np.hypot(*(part.norm(own) for part, own, _ in self._each(free))))

    def normal_equations(self, free):  # numpydoc ignore=PR01,RT01
        """Return J'J, J'r and |r|."""
        JJ, Jr, norms = np.zeros((self.n, self.n)), np.zeros(self.n), []
        for part, own, place in self._each(free):
            its_JJ, its_Jr, norm = part.normal_equations(own)
            JJ[np.ix_(place, place)] += its_JJ
            Jr[place] += its_Jr
            norms.append(norm)
        return JJ, Jr, float(np.hypot(*norms))

    def pulled(self, at, after):  # numpydoc ignore=PR01,RT01
        """Return J'(r_2 - r_1) for the residuals at two points."""
        pulled = np.zeros(self.n)
        for (part, own, place), (_, moved, _) in zip(
            self._each(at), self._each(after), strict=True
        ):
            pulled[place] += part.pulled(own, moved)
        return pulled
