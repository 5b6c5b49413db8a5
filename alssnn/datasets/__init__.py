"""Simulated plants with their true model, and measured benchmark records."""

from ._arms import make_fan_arm, make_two_input_arm
from ._benchmarks import fetch_cascaded_tanks, fetch_coupled_drives, fetch_silverbox
from ._classics import fetch_classics
from ._drone import fetch_quarter_drone
from ._inverted_pendulum import make_inverted_pendulum
from ._levitation import make_magnetic_levitation
from ._measured import fetch_wiener_hammerstein
from ._mirror import fetch_fine_steering_mirror
from ._oscillators import make_duffing, make_pendulum
from ._populations import make_prey_predator
from ._processes import make_heat_exchanger, make_valve_tank
from ._record import Record
from ._simulated import make_wiener_hammerstein
from ._stamps import on_grid

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
    "make_fan_arm",
    "make_heat_exchanger",
    "make_inverted_pendulum",
    "make_magnetic_levitation",
    "make_pendulum",
    "make_prey_predator",
    "make_two_input_arm",
    "make_valve_tank",
    "make_wiener_hammerstein",
    "on_grid",
]
