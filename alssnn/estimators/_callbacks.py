"""Callbacks of scikit-learn: progress bars, scores of every step, early stops.

Since version 1.9 scikit-learn has a protocol for objects that follow a fit.  It is
experimental, so that this module alone knows it.  An accepted step of a search is a
task named "iteration" below the fit; a callback that returns true at its end ends the
fit.  From the training on, callbacks are handed a fitted estimator; the searches of
the linear start only show that they go on.

Older versions have no callbacks: `set_callbacks` does not exist there.
"""

import numpy as np
from scipy.optimize import OptimizeResult

from ..innovations import free_run
from ..watch import Watch

try:
    from sklearn.callback import CallbackSupportMixin, with_callbacks
except ImportError:  # scikit-learn < 1.9

    class CallbackSupportMixin:  # type: ignore[no-redef]
        """Stand in for what older versions lack."""

    def with_callbacks(method):
        """Return the method, which has no callbacks to manage."""
        return method


__all__ = ["CallbackSupportMixin", "Callbacks", "snapshot", "with_callbacks"]


def snapshot(model, structure, step, point):
    """Return the attributes of a model fitted with what a search has reached.

    Parameters
    ----------
    model : estimator
        Estimator in its fit.
    structure : Structure
        Structure of the search.
    step : Step
        What the search has just done.
    point : ndarray of shape (n,)
        Its parameters, then the initial states.

    Returns
    -------
    attributes : dict
        What differs from those of the estimator.
    """
    shown = object.__new__(type(model))
    shown.__dict__.update(vars(model))
    theta, x0 = np.split(point, [structure.n_params])
    shown._structure, shown._theta = free_run(structure), theta
    result = OptimizeResult(
        x0=x0.reshape(-1, structure.n_x0)[:, : structure.sizes["x"]],
        cost=step.cost,
        nfev=step.iteration + 1,
        success=False,
        message="in training",
    )
    shown._publish(result, Watch())
    ours = vars(model)
    return {k: v for k, v in vars(shown).items() if ours.get(k) is not v}


class Callbacks:
    """Tell the callbacks of an estimator about its fit.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator, with callbacks.
    u, y : ndarray
        Training data, for callbacks that score.
    experiment : array_like or None
        Label of the experiment of every sample.
    """

    def __init__(self, estimator, u, y, experiment):
        self.estimator = estimator
        metadata = None if experiment is None else {"experiment": experiment}
        self.data = {"X": u, "y": y, "metadata": metadata}
        self.attributes = None  # (step, point) -> attributes of a fitted estimator
        # how many steps a fit takes is not known before
        self.root = estimator._init_callback_context(max_subtasks=None)
        self.root.call_on_fit_task_begin(estimator=estimator, **self.data)

    @classmethod
    def of(cls, estimator, u, y, experiment):
        """Return the callbacks of an estimator, None if it has none.

        Parameters
        ----------
        estimator : StateSpaceModel
            Estimator.
        u, y : ndarray
            Training data.
        experiment : array_like or None
            Label of the experiment of every sample.

        Returns
        -------
        callbacks : Callbacks or None
            What a `Watch` observes by.
        """
        # a search over estimators may have sent some, or wait for our context
        asked = ("_skl_callbacks", "_parent_callback_ctx")
        if not any(hasattr(estimator, name) for name in asked):
            return None
        return cls(estimator, u, y, experiment)

    def __call__(self, step, point):
        """Return whether a callback wants the fit to end after an accepted step."""
        task = self.root.subcontext(task_name="iteration")
        task.call_on_fit_task_begin(estimator=self.estimator, **self.data)
        return task.call_on_fit_task_end(
            estimator=self.estimator,
            reconstruction_attributes=self.attributes
            and (lambda: self.attributes(step, point)),
            **self.data,
        )

    def end(self):
        """Tell that the fit has ended."""
        self.root.call_on_fit_task_end(
            estimator=self.estimator,
            # a copy of the fitted estimator needs nothing else
            reconstruction_attributes=dict,
            **self.data,
        )
