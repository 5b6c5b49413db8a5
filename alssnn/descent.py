"""Descents: along which weights of the decay a search for networks goes.

A start has networks of random inner weights and zero output, so that it is the linear
model.  The decay alpha |theta_net - start|^2 (eq. decay) is lowered along a path, each
optimum the start of the next: a large alpha leaves the linear model, a middle one fits
the outputs of random networks, a small one moves them freely.  A path is a continuation
and a choice of complexity in one.

A decay towards zero makes functions smooth where the record says little, but takes the
inner weights first, and with them every gradient: the linear model is a saddle.  It
must begin small.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

ALPHAS = np.append(10.0 ** np.arange(1, -9, -1), 0.0)
# Of the alphas, those by which orders are compared: 0.1, 1e-3, 1e-5. With 10, 0.1, 1e-3
# models of more states had not come down yet: of the plant "brief dead zone" of
# `benchmarks.short_records`, which has two, one state was taken.
SCREEN = (2, 7, 2)
STAGES = 25  # a stage of a path has this share of the trial steps of a fit
ENOUGH = 1e-4  # the largest alpha at which a path may end
# Largest network weight over that of the start, below which a decay to zero has taken
# the networks away. It would not give them back: the linear model is a saddle.
GONE = 1e-2


@dataclass(frozen=True)
class Descent:
    """Say along which weights of the decay a path goes.

    Parameters
    ----------
    alphas : sequence of float, default=`ALPHAS`
        Weights of the decay, not rising.
    screen : tuple of int, default=(2, 7, 2)
        First, end and step of those by which orders are compared. Those behind the end
        follow for orders that come near the best.
    stages : int, default=25
        A stage has this share of the trial steps of a fit.
    center : {"start", "zero"}, default="start"
        What the decay leads to.
    enough : float, default=1e-4
        Largest alpha at which a path may end.
    contends : float, default=1.0
        Of a long record, starts with at most so many times the least root mean square
        error there go on.
    finalists : int, default=1
        Of a short record, so many paths go on at their alpha before one is chosen, if
        the lowest loses what it had.
    of_long : Descent or None, default=None
        What takes its place for a long record, whose steps bend; None is itself.

    Examples
    --------
    >>> from alssnn.descent import Descent
    >>> descent = Descent((1.0, 0.1, 0.01), screen=(0, 2, 1), stages=10, enough=0.1)
    >>> descent.steps(500), descent.first, descent.screened
    (50, (1.0, 0.1), ((1.0, 0.1), (0.01,)))
    """

    alphas: Sequence[float] = tuple(ALPHAS)
    screen: tuple = SCREEN
    stages: int = STAGES
    center: str = "start"
    enough: float = ENOUGH
    contends: float = 1.0
    finalists: int = 1
    of_long: "Descent | None" = None

    def times(self, scale):
        """Return the descent along weights that are so many times as large.

        Parameters
        ----------
        scale : float
            Factor.

        Returns
        -------
        descent : Descent
            A new one.
        """
        alphas = tuple(scale * alpha for alpha in self.alphas)
        return replace(self, alphas=alphas, enough=scale * self.enough)

    def steps(self, max_iter):
        """Return the trial steps of a stage.

        Parameters
        ----------
        max_iter : int
            Those of a whole fit.

        Returns
        -------
        steps : int
            At least 2.
        """
        return max(2, max_iter // self.stages)

    @property
    def first(self):
        """Return the alphas down to the first at which a path may end."""
        return tuple(alpha for alpha in self.alphas if alpha >= self.enough)

    @property
    def screened(self):
        """Return the alphas by which orders are compared, and those that follow."""
        return self.alphas[slice(*self.screen)], self.alphas[self.screen[1] :]


USUAL = Descent()
# Of long records, where g or f is free: fewer weights (`python -m benchmarks.constants
# SMOOTH --cases loop "slow and fast"`), and no other descent beside it (the same with
# RIVALLING). FL-SSNN ends no lower along it, and takes longer.
LONG = Descent((1e-4, 1e-6, 1e-8), (0, 3, 1), stages=9, center="zero")
# With the usual one instead, GR-SSNN has larger test errors on six plants: 3.3 and 1.9
# times for a servo, 2.5 for a robot joint, 1.3 to 1.8 for the others, medians of two
# seeds (`python -m benchmarks.constants SMOOTH`).
SMOOTH = replace(LONG, alphas=(1e-4, 1e-5, 1e-6, 1e-7, 1e-8), stages=6, of_long=LONG)
# Of AL-SSNN, whose lowest path is often one of several that reach nearly the same
# (`python -m benchmarks.constants RIVALLING`).
RIVALLING = replace(USUAL, finalists=3, of_long=LONG)
# Of the same without g, whose errors are compared with those of the one with g.
ALONE = replace(USUAL, of_long=LONG)
# Beside the usual one, for AL-SSNN (`python -m benchmarks.field --models al`).
FADING = replace(SMOOTH, alphas=(1e-2, 1e-3, *SMOOTH.alphas))


def is_gone(structure, theta, start):
    """Tell whether a decay to zero has taken the networks away.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Parameters.
    start : ndarray of shape (n_params,)
        Those of the random start.

    Returns
    -------
    is_gone : bool
        Whether its largest network weight is less than a hundredth of that of the
        start. Biases do not count: that of the output stays where no neuron is left.
    """
    now, was = (
        max(
            abs(p[name]).max(initial=0.0)
            for name in structure.network_parameters
            if p[name].ndim > 1
        )
        for p in (structure.split(point) for point in (theta, start))
    )
    return bool(now < GONE * was)
