"""Simulated plants with their true model, and measured benchmark records."""

from ._benchmarks import fetch_cascaded_tanks, fetch_coupled_drives, fetch_silverbox
from ._classics import fetch_classics
from ._drone import fetch_quarter_drone
from ._measured import fetch_wiener_hammerstein
from ._mirror import fetch_fine_steering_mirror
from ._oscillators import make_duffing, make_pendulum
from ._populations import make_prey_predator
from ._record import Record
from ._simulated import make_wiener_hammerstein

__all__ = [
    "Record",
    "fetch_cascaded_tanks",
    "fetch_classics",
    "fetch_coupled_drives",
    "fetch_fine_steering_mirror",
    "fetch_quarter_drone",
    "fetch_silverbox",
    "fetch_wiener_hammerstein",
    "make_duffing",
    "make_pendulum",
    "make_prey_predator",
    "make_wiener_hammerstein",
]
