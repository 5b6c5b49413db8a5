"""Watching a fit: what its searches reach, and who may end them.

A fit is a sequence of searches (`optimizers.minimize`): the linear start, the stages
of the training, several starts.  One `Watch` sees all of them.  It keeps their
history, and it ends them for one of two kinds of reasons:

* the *fit* ends: its time is over, an observer said so, the user interrupted it.  The
  search under way returns the best parameters it has seen, and every search that
  follows returns its start at once, so that the steps between them, which put a model
  into shape, still run: whatever ends a fit, a fitted model is left.
* one *search* ends: the validation error no longer falls, or the error is down to
  the noise.  The next stage goes on.

MINPACK cannot be told to stop.  It can only be left, by an exception in the function
that it evaluates: `Stop`, which never leaves `optimizers`.
"""

import time
from typing import NamedTuple

OUT_OF_TIME = "max_time is over"
INTERRUPTED = "interrupted"
BY_OBSERVER = "stopped by a callback"
NO_PROGRESS = "the validation error no longer falls"
AT_FLOOR = "the error has come down to the noise floor"
TOO_SLOW = "further steps hardly lower the cost"


class Step(NamedTuple):
    """One accepted step of a search.

    Parameters
    ----------
    label : str
        Stage of the fit.
    iteration : int
        Number of the step within its stage; 0 is the start.
    cost : float
        Cost (eq. cost) of the stage.
    seconds : float
        Time since the fit began, in seconds.
    validation_rmse : float
        Root-mean-square error on validation data, outputs scaled to unit variance;
        nan without such data.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> step = model.history_[-1]
    >>> step.label, bool(step.cost <= model.history_[0].cost)
    ('linear', True)
    """

    label: str
    iteration: int
    cost: float
    seconds: float
    validation_rmse: float


class Stop(Exception):
    """End a search from inside the functions that it evaluates."""


class Silent:
    """Hear of the progress of a fit, and show nothing of it."""

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

    def search(self, done, of, share):
        """Hear of the search for order, start and decay.

        Parameters
        ----------
        done, of : int
            Stages done, and how many there are at most.
        share : float
            Least error on hidden samples over that of the linear model.
        """

    def starts(self, done, of, cost):
        """Hear of starts that compete in other processes.

        Parameters
        ----------
        done, of : int
            Starts done, and how many there are.
        cost : float
            Least cost of those; nan of none.
        """


class Watch:
    """Keep the history of the searches of one fit, and end them.

    Parameters
    ----------
    max_time : float or None, default=None
        Seconds after which the fit ends, counted from now.
    report : Silent or None, default=None
        What shows the progress; None shows none.
    observe : callable or None, default=None
        Called as ``observe(step, point)`` with a `Step` and the free vector that the
        search has reached; the fit ends if it returns true. Stays in its process.

    Attributes
    ----------
    history : list of Step
        Accepted steps, in order.
    floor : tuple of float and ndarray of shape (ny,), or None
        Cost, and mean squares of the outputs, at which a search ends: those of the
        noise alone; None if it is unknown.
    reason : str or None
        Why the fit ends; None as long as it goes on.
    interrupt : KeyboardInterrupt or None
        What ended the fit, if the user did.
    """

    def __init__(self, *, max_time=None, report=None, observe=None):
        # not a monotonic clock: workers on other machines share this one
        self.start = time.time()
        self.max_time = max_time
        self.report = report or Silent()
        self.observe = observe
        self.history = []
        self.floor = None
        self.reason = None
        self.has_result = False  # whether the estimator is a fitted one by now
        self.interrupt = None
        self.parent = None

    def fork(self):
        """Return a watch with a history of its own that ends with this one.

        Returns
        -------
        watch : Watch
            Watch of one of several starts, in this process or another.
        """
        fork = Watch(max_time=self.max_time, report=self.report, observe=self.observe)
        fork.start, fork.reason, fork.parent = self.start, self.reason, self
        fork.floor = self.floor
        return fork

    def quiet(self):
        """Return a watch that ends with this one, and tells nobody of its steps.

        Returns
        -------
        watch : Watch
            Watch of searches that prepare the fit: of no stage of it.
        """
        quiet = self.fork()
        quiet.report, quiet.observe, quiet.floor = Silent(), None, None
        return quiet

    def __getstate__(self):
        """Leave behind what belongs to this process."""
        return {**vars(self), "observe": None, "parent": None}

    def stop(self, reason, interrupt=None):
        """End the fit.

        Parameters
        ----------
        reason : str
            Why, for `message_`.
        interrupt : KeyboardInterrupt or None, default=None
            What the user sent.
        """
        self.reason = self.reason or reason
        self.interrupt = self.interrupt or interrupt
        if self.parent is not None:
            self.parent.stop(reason, interrupt)

    def check(self):
        """Raise `Stop` if the fit is to end; called at every trial step.

        Raises
        ------
        Stop
            If time is over, or somebody ended the fit.
        """
        ended = self.reason or (self.parent is not None and self.parent.reason)
        if not ended and self.max_time is not None:
            if time.time() - self.start >= self.max_time:
                self.stop(OUT_OF_TIME)
        self.reason = self.reason or ended or None
        if self.reason is not None:
            raise Stop(self.reason)

    def step(self, label, iteration, cost, rmse, point):
        """Keep an accepted step, and tell those who watch.

        Parameters
        ----------
        label : str
            Stage of the fit.
        iteration : int
            Number of the step within its stage.
        cost : float
            Cost that it reached.
        rmse : float
            Error on validation data, nan without.
        point : ndarray of shape (n,)
            Free vector that it reached.
        """
        seconds = time.time() - self.start
        step = Step(label, iteration, float(cost), seconds, float(rmse))
        self.history.append(step)
        self.report.step(label, iteration, cost)
        if self.observe is not None and self.observe(step, point):
            self.stop(BY_OBSERVER)

    @property
    def used(self):
        """Return the share of `max_time` that is over; zero without a limit."""
        if self.max_time is None:
            return 0.0
        return (time.time() - self.start) / max(self.max_time, 1e-9)

    def searched(self, done, of, share):
        """Tell how far the search for order, start and decay has come.

        Parameters
        ----------
        done, of : int
            Stages done, and how many there are at most.
        share : float
            Least error on hidden samples over that of the linear model.
        """
        self.report.search(done, of, share)

    def competed(self, done, of, cost):
        """Tell how many of the starts in other processes are done.

        Parameters
        ----------
        done, of : int
            Starts done, and how many there are.
        cost : float
            Least cost of those; nan of none.
        """
        self.report.starts(done, of, cost)

    def end(self, label, n_accepted, cost):
        """Tell that a search is over.

        Parameters
        ----------
        label : str
            Stage of the fit.
        n_accepted : int
            Points that the search accepted, its start among them.
        cost : float
            Cost that it ends with.
        """
        if n_accepted:
            self.report.end(label, n_accepted, cost)


def late_fall(history):
    """Return how much the cost still fell in the second half of the last search.

    Parameters
    ----------
    history : list of Step
        Accepted steps of a fit, in order.

    Returns
    -------
    fall : float
        Share of the cost in the middle that is gone at the end; nan where the search
        has too few steps to tell.
    n_steps : int
        Steps from the middle to the end.
    """
    starts = [i for i, step in enumerate(history) if step.iteration == 0]
    costs = [step.cost for step in history[starts[-1] if starts else 0 :]]
    n_steps = len(costs) // 2
    if n_steps == 0 or not costs[-1 - n_steps] > 0:
        return float("nan"), n_steps
    return 1 - min(costs[-n_steps:]) / costs[-1 - n_steps], n_steps


class Patience:
    """Keep the point of least validation error, and give up on a search.

    Parameters
    ----------
    rmse : callable
        Error on validation data of a free vector; not finite where it diverges.
    n_iter_no_change : int
        Accepted steps without a new least error after which a search ends.
    """

    def __init__(self, rmse, n_iter_no_change):
        self.rmse = rmse
        self.n_iter_no_change = n_iter_no_change
        self.best = None
        self.least = float("inf")
        self.waited = 0

    def look(self, point):
        """Return the validation error of a point, and remember the least.

        Parameters
        ----------
        point : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        rmse : float
            Its error.
        """
        rmse = self.rmse(point)
        if self.best is None or rmse < self.least:
            self.best, self.least, self.waited = point.copy(), rmse, 0
        else:
            self.waited += 1
        return rmse

    @property
    def is_over(self):
        """Return whether the error has not fallen for too long."""
        return self.waited >= self.n_iter_no_change
