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
    labels, points, start = [], [], time.perf_counter()
    cls = type(model)
    reporter = cls._reporter

    def record_points(self):
        def report(label, iteration, cost):
            labels.append(label)
            points.append((time.perf_counter() - start, cost))

        return report

    cls._reporter = record_points
    try:
        model.fit(u, y)
    finally:
        cls._reporter = reporter
    times, costs = np.array(points).T
    return Curve(labels, times, costs, time.perf_counter() - start)
