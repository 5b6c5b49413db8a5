"""Cost against time of a training, for the benchmarks."""

import time
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Curve:
    """Hold what a training reported: labels, times and costs of accepted steps."""

    labels: list
    times: np.ndarray
    costs: np.ndarray
    seconds: float

    def stage(self, label):
        """Return times and costs of the steps under one label."""
        here = np.array([name == label for name in self.labels])
        return self.times[here], self.costs[here]

    def drift(self):
        """Return the relative fall of the cost in the last fifth of the last stage."""
        _, costs = self.stage(self.labels[-1])
        return costs[int(0.8 * (len(costs) - 1))] / costs[-1] - 1.0


def cost_curve(model, u, y):
    """Fit a model and return the curve of its training."""
    start = time.perf_counter()
    model.fit(u, y)
    seconds = time.perf_counter() - start
    labels = [step.label for step in model.history_]
    times = np.array([step.seconds for step in model.history_])
    costs = np.array([step.cost for step in model.history_])
    return Curve(labels, times, costs, seconds)
