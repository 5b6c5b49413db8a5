"""Calls in parallel processes, of which none may take the others with it."""

from concurrent.futures.process import BrokenProcessPool

from joblib import Parallel, delayed

from .warn import warn_user


def finished(function, calls, n_jobs=None):
    """Yield the values of independent calls as they finish.

    A process that dies, such as one that the system kills for want of memory, takes the
    pool of joblib with it. What was finished by then has been yielded; the rest is done
    in this process, one call after the other, which needs the least memory.

    Parameters
    ----------
    function : callable
        Function; it can be pickled.
    calls : sequence of tuple
        Its arguments.
    n_jobs : int or None, default=None
        Calls in parallel, as in joblib.

    Yields
    ------
    i : int
        Index of a call.
    value : object
        Its value.

    Warns
    -----
    UserWarning
        If a process died.
    """
    tasks = [delayed(_numbered)(i, function, call) for i, call in enumerate(calls)]
    try:
        parallel = Parallel(n_jobs=n_jobs, return_as="generator_unordered")
    except ValueError:  # a backend that only returns everything at once
        parallel = Parallel(n_jobs=n_jobs)
    left = dict(enumerate(calls))
    try:
        for i, value in parallel(tasks):
            del left[i]
            yield i, value
    except BrokenProcessPool:
        warn_user(
            "A worker process died, or was killed by the system, which does so when "
            f"memory is short: {len(left)} of {len(calls)} tasks go on in this process."
            " Set a smaller `n_jobs`.",
            UserWarning,
        )
        for i, call in left.items():
            yield i, function(*call)


def _numbered(i, function, call):
    return i, function(*call)
