"""Simulated plants with their true model, and measured benchmark records."""

from ._measured import fetch_wiener_hammerstein
from ._oscillators import make_duffing, make_pendulum
from ._populations import make_prey_predator
from ._record import Record
from ._simulated import make_wiener_hammerstein

__all__ = [
    "Record",
    "fetch_wiener_hammerstein",
    "make_duffing",
    "make_pendulum",
    "make_prey_predator",
    "make_wiener_hammerstein",
]
