"""What a fit prints of its progress: a line per stage, or per step."""

import time

PATIENCE = 10.0  # seconds without a line in a long stage


class Progress:
    """Print how far a fit has come, on the standard output.

    A line at the end of every search says what it reached; in a long one a line every
    ten seconds says that it goes on.

    Parameters
    ----------
    name : str
        Name of the model.
    every_step : bool, default=False
        Whether to print every accepted step instead.
    """

    def __init__(self, name, every_step=False):
        self.name, self.every_step = name, every_step
        self.start = self.printed = time.time()
        self.first = float("nan")  # cost at the start of the search

    def step(self, label, iteration, cost):
        """Hear of an accepted step.

        Parameters
        ----------
        label : str
            Stage of the fit.
        iteration : int
            Number of the step within its stage; 0 is the start.
        cost : float
            Cost that it reached.
        """
        if iteration == 0:
            self.first = cost
        if self.every_step or time.time() - self.printed > PATIENCE:
            self._print(label, f"step {iteration}: cost {cost:.4g}")

    def end(self, label, n_accepted, cost):
        """Hear of the end of a search.

        Parameters
        ----------
        label : str
            Stage of the fit.
        n_accepted : int
            Points that the search accepted, its start among them.
        cost : float
            Cost that it ends with.
        """
        if not self.every_step:
            costs = f"cost {self.first:.4g} to {cost:.4g}"
            self._print(label, f"{costs} in {n_accepted - 1} steps")

    def _print(self, label, text):
        self.printed = time.time()
        seconds = self.printed - self.start
        print(f"{self.name:16s} {seconds:7.1f} s  {label}: {text}", flush=True)
