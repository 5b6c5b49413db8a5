"""Excitation: signals to record a plant with, within the limits of its actuators.

All signals are made around an operating point, within ``low`` and ``high`` and no
faster than ``rate``, as values of one class, `Excitation`, which writes itself to a CSV
file and draws itself.

    multisine      lines of a spectrum that is asked for, with random phases: for
                   `nonparametric.best_linear_approximation`, and for models
    steps          random heights and lengths: for models that have to hold over the
                   whole range, settling included
    prbs           two levels: most power within the limits, for linear plants alone
    swept_sine     one frequency after another, at full amplitude
    menu           different ones of the same length, to choose from

A multisine tells noise, even and odd nonlinearities apart (eq. bla); a plant that is
meant to be modelled over its range wants steps, or several levels of a multisine.
"""

from ._excitation import Excitation
from ._menu import menu
from ._multisine import multisine
from ._signals import prbs, steps, swept_sine

__all__ = ["Excitation", "menu", "multisine", "prbs", "steps", "swept_sine"]
