"""Simulated plants with their true model, and measured benchmark records."""

from ._measured import fetch_wiener_hammerstein
from ._record import Record
from ._simulated import make_wiener_hammerstein

__all__ = ["Record", "fetch_wiener_hammerstein", "make_wiener_hammerstein"]
