"""The linear part of a model: singular values, poles."""

import numpy as np
from matplotlib.patches import Circle
from sklearn.utils.validation import check_is_fitted

from ..certificates import full_gain
from ..plants import as_plant
from ._axes import Display, color, finish, grid_of_axes, spelled


class SingularValuesDisplay(Display):
    """Show the singular values of the subspace step of a model.

    Parameters
    ----------
    singular_values : ndarray of shape (n,)
        Singular values of the subspace step, falling.
    nx : int
        Chosen order.

    Attributes
    ----------
    ax_ : matplotlib.axes.Axes
        The axes.
    figure_ : matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from alssnn.plotting import SingularValuesDisplay
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(tol=1e-3).fit(*record)
    >>> display = SingularValuesDisplay.from_estimator(model)
    >>> display.figure_.savefig("order.png")  # doctest: +SKIP
    """

    def __init__(self, singular_values, nx):
        self.singular_values, self.nx = singular_values, nx

    @classmethod
    def from_estimator(cls, model, *, ax=None, **kwargs):
        """Draw the singular values of a fitted model.

        Parameters
        ----------
        model : estimator
            Fitted model.
        ax : matplotlib.axes.Axes or None, default=None
            Where to draw; None makes a figure.
        **kwargs : dict
            Options of the curve.

        Returns
        -------
        display : SingularValuesDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If the model was not identified by the subspace method.
        """
        check_is_fitted(model)
        if not len(model.singular_values_):
            raise ValueError(
                "`model` must have singular values, got none: its linear start was "
                "given. Fit with linear_start=None."
            )
        return cls(np.asarray(model.singular_values_), model.nx_).plot(ax, **kwargs)

    def plot(self, ax=None, **kwargs):
        """Draw singular values on a logarithmic axis.

        Parameters
        ----------
        ax : matplotlib.axes.Axes or None, default=None
            Where to draw; None makes a figure.
        **kwargs : dict
            Options of the curve.

        Returns
        -------
        display : SingularValuesDisplay
            Itself.
        """
        ((axes,),) = grid_of_axes(ax, (1, 1), size=(6.0, 3.5))
        order = np.arange(1, len(self.singular_values) + 1)
        style = {
            "color": color(0),
            "marker": "o",
            "markersize": 4,
            **spelled(kwargs),
        }
        axes.semilogy(order, self.singular_values, label="singular values", **style)
        axes.axvline(
            self.nx + 0.5, color="0.4", linestyle="--", label=f"order {self.nx}"
        )
        axes.set_xlabel("number of states")
        axes.set_ylabel("singular value")
        finish(axes)
        return self._drawn(axes)


class PoleDisplay(Display):
    """Show poles in the plane of z, beside the unit circle.

    Parameters
    ----------
    poles : dict of str to ndarray of complex
        Poles by name.

    Attributes
    ----------
    ax_ : matplotlib.axes.Axes
        The axes.
    figure_ : matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from alssnn.plotting import PoleDisplay
    >>> display = PoleDisplay({"design": np.array([0.9, 0.5])}).plot()
    >>> display.ax_.get_xlabel()
    'real part of z'
    """

    def __init__(self, poles):
        self.poles = poles

    @classmethod
    def from_estimator(cls, model, *, K=None, ax=None, **kwargs):
        """Draw the poles of a fitted model.

        Parameters
        ----------
        model : estimator
            Fitted model.
        K : array_like of shape (nu, nx) or None, default=None
            State feedback v = r - K x: the poles of A - B K are drawn as well.
        ax : matplotlib.axes.Axes or None, default=None
            Where to draw; None makes a figure.
        **kwargs : dict
            Options of the markers.

        Returns
        -------
        display : PoleDisplay
            The display, drawn: the poles of A, which u = v - h leaves, and of the
            whole model linearized at its operating point, where h and g count.

        Raises
        ------
        ValueError
            If `K` has the wrong shape.
        """
        check_is_fitted(model)
        arrived = as_plant(model).arrived()
        poles = {
            "A, once h is cancelled": np.linalg.eigvals(arrived.linear()[0]),
            "model at its operating point": model.to_statespace("local").poles(),
        }
        if K is not None:
            plant = as_plant(model).late()
            A, B, _, _ = plant.linear()
            poles["A - B K"] = np.linalg.eigvals(A - B @ full_gain(plant, K))
        return cls(poles).plot(ax, **kwargs)

    def plot(self, ax=None, **kwargs):
        """Draw poles and the unit circle.

        Parameters
        ----------
        ax : matplotlib.axes.Axes or None, default=None
            Where to draw; None makes a figure.
        **kwargs : dict
            Options of the markers.

        Returns
        -------
        display : PoleDisplay
            Itself.
        """
        ((axes,),) = grid_of_axes(ax, (1, 1), size=(5.0, 4.5))
        axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color="0.6"))
        for i, (name, poles) in enumerate(self.poles.items()):
            radius = np.abs(poles).max(initial=0.0)
            style = {"color": color(i), "marker": "x+1234"[i % 6], "linestyle": ""}
            label = f"{name}, radius {radius:.4g}"
            style |= {"markersize": 9, "label": label, **spelled(kwargs)}
            axes.plot(np.real(poles), np.imag(poles), **style)
        reach = 1.1 * np.abs(np.hstack([1.0, *self.poles.values()])).max()
        axes.set_xlim(-reach, reach)
        axes.set_ylim(-reach, reach)
        axes.set_aspect("equal")
        axes.set_xlabel("real part of z")
        axes.set_ylabel("imaginary part of z")
        finish(axes, legend="below")
        return self._drawn(axes)
