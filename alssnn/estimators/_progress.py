"""What a fit shows of its progress: a line per stage, or per step, or a bar."""

import time

from ..shown import percent
from ..watch import Silent

PATIENCE = 10.0  # seconds without a line in a long stage


class Progress(Silent):
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
        if iteration == 0:
            self.first = cost
        if self.every_step or time.time() - self.printed > PATIENCE:
            self._print(label, f"step {iteration}: cost {cost:.4g}")

    def end(self, label, n_accepted, cost):
        if not self.every_step:
            costs = f"cost {self.first:.4g} to {cost:.4g}"
            self._print(label, f"{costs} in {n_accepted - 1} steps")

    def search(self, done, of, share):
        if self.every_step or time.time() - self.printed > PATIENCE:
            self._print("search", f"stage {done} of at most {of}, {hidden(share)}")

    def _print(self, label, text):
        self.printed = time.time()
        seconds = self.printed - self.start
        print(f"{self.name:16s} {seconds:7.1f} s  {label}: {text}", flush=True)


def hidden(share):
    """Return in words what a search has reached.

    Parameters
    ----------
    share : float
        Error on hidden samples over that of the linear model.

    Returns
    -------
    text : str
        The words.
    """
    return f"{percent(100 * share, 3)} of the error of the linear model"


class Bar(Silent):
    """Show how far a fit has come as a bar of tqdm, in a terminal or a notebook.

    It has one bar for the search and one for every stage of the training, each with the
    time that is left at most: searches may end before all of their steps.

    Parameters
    ----------
    name : str
        Name of the model.
    max_iter : int
        Trial steps of a stage, at most.

    Raises
    ------
    ImportError
        If tqdm is not installed.
    """

    def __init__(self, name, max_iter):
        try:
            from tqdm.auto import tqdm
        except ImportError as error:
            raise ImportError(
                '`verbose="bar"` needs tqdm: pip install "alssnn[progress]". Lines '
                "instead of a bar need nothing: verbose=1."
            ) from error
        self.name, self.max_iter = name, max_iter
        self.make, self.bar, self.label = tqdm, None, ""
        self.linear = float("nan")  # cost that the linear model ends with

    def __getstate__(self):
        """Leave the bar in its process: those of workers would write over it."""
        return {**vars(self), "make": None, "bar": None}

    def search(self, done, of, share):
        self._show("search", done, of, hidden(share))

    def step(self, label, iteration, cost):
        if iteration == 0:
            self._close()
        self._show(label, iteration, self.max_iter, self._reached(cost))

    def starts(self, done, of, cost):
        said = f"least {self._reached(cost)}" if done else "in other processes"
        self._show("starts", done, of, said)
        if done == of:
            self._close()

    def _reached(self, cost):
        """Return a cost in words."""
        said = f"cost {cost:.3g}"
        if self.linear > 0:
            said += f", {percent(100 * cost / self.linear, 3)} of the linear model"
        return said

    def end(self, label, n_accepted, cost):
        if label == "linear":
            self.linear = cost
        self._close()

    def _show(self, label, done, of, said):
        """Move the bar of a stage; make it if it is a new one."""
        if self.make is None:
            return
        if self.bar is None or label != self.label:
            self._close()
            self.label = label
            self.bar = self.make(total=of, desc=f"{self.name}, {label}")
        self.bar.set_postfix_str(said, refresh=False)
        self.bar.update(done - self.bar.n)

    def _close(self):
        if self.bar is not None:
            self.bar.close()
            self.bar = None
