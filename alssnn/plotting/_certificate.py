"""The invariant set of a certificate, with trajectories of the loop."""

import numpy as np

from ..checks import check_option
from ..shown import percent
from ..validation import column_names, loop_deviation
from ._axes import Display, color, few_ticks, finish, grid_of_axes, spelled

POINTS = 200  # of an ellipse
ROUNDING = 1e-12  # deviations over states that are those of a linear loop


class CertificateDisplay(Display):
    """Show the invariant set of a certificate in a plane, with trajectories.

    The set holds the deviation zeta of the loop u = v - h from the linear one (eq.
    lmi), whatever v is, as long as omega stays below the bound of the certificate.

    Parameters
    ----------
    certificate : IssCertificate
        Certificate that holds.
    T : ndarray of shape (2, nx)
        Plane to project on: two states, or two rows of C.
    labels : sequence of str
        Names of the two coordinates.
    trajectories : sequence of ndarray of shape (N, nx), default=()
        Deviations zeta along trajectories.

    Attributes
    ----------
    ax_ : matplotlib.axes.Axes
        The axes.
    figure_ : matplotlib.figure.Figure
        The figure.
    inside_ : float or None
        Share of the samples of the trajectories in the set; None without trajectories.

    Raises
    ------
    ValueError
        If the certificate does not hold, or the plane has the wrong shape.

    Examples
    --------
    >>> from alssnn.certificates import iss_certificate
    >>> from alssnn.plotting import CertificateDisplay
    >>> certificate = iss_certificate([[0.9, 0.2], [0.0, 0.8]], eps=0.1)
    >>> display = CertificateDisplay(certificate, np.eye(2), ["x0", "x1"])
    >>> bool(np.allclose(display.boundary()[0], display.boundary()[-1]))  # closed
    True
    """

    def __init__(self, certificate, T, labels, trajectories=()):
        T = np.asarray(T, dtype=float)
        if T.shape != (2, len(certificate.A)):
            raise ValueError(
                f"`T` must have shape (2, {len(certificate.A)}), got {T.shape}. Take "
                "two rows of the identity or of `C_`."
            )
        if not (certificate.holds and np.isfinite(certificate.level)):
            raise ValueError(
                "`certificate` must hold with a finite level, got none: "
                f"{certificate.reason}"
            )
        self.certificate, self.T, self.labels = certificate, T, labels
        self.trajectories = trajectories

    @classmethod
    def from_estimator(
        cls,
        model,
        certificate,
        u,
        y,
        experiment=None,
        *,
        pair=(0, 1),
        of="states",
        K=None,
        ax=None,
        **kwargs,
    ):
        """Draw the set of a certificate and the loop along records.

        Parameters
        ----------
        model : estimator
            Fitted model.
        certificate : IssCertificate
            What ``model.iss_certificate`` returns, for the same `K`.
        u : array_like of shape (N, nu), or list of them
            Inputs of the loop, v, or r with `K`.
        y : array_like of shape (N,) or (N, ny), or list of them
            Outputs; they set the initial states.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        pair : tuple of int, default=(0, 1)
            Two states or outputs.
        of : {"states", "outputs"}, default="states"
            What `pair` counts: states, past inputs behind those of `A_`; or outputs,
            of which C zeta is drawn.
        K : array_like of shape (nu, nx) or None, default=None
            State feedback v = r - K x.
        ax : matplotlib.axes.Axes or None, default=None
            Where to draw; None makes a figure.
        **kwargs : dict
            Options of the boundary.

        Returns
        -------
        display : CertificateDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If the certificate does not hold, `pair` is not two of the states or
            outputs, or `K` has the wrong shape.
        """
        check_option("of", of, ("states", "outputs"))
        names = [f"x{i}" for i in range(len(certificate.A))]
        rows, through = np.eye(len(names)), ""
        if of == "outputs":
            rows, names = certificate.C, column_names(model)[1]
            through = " by the states" if np.any(certificate.eta) else ""
        pair = tuple(pair)
        if len(set(pair)) != 2 or not all(0 <= i < len(rows) for i in pair):
            raise ValueError(
                f"`pair` must be two different {of} below {len(rows)}, got {pair}."
            )
        runs = loop_deviation(model, u, y, experiment, K=K)
        labels = [f"deviation of {names[i]}{through}" for i in pair]
        trajectories = [_without_rounding(run) for run in runs]
        display = cls(certificate, rows[list(pair)], labels, trajectories)
        return display.plot(ax, **kwargs)

    def boundary(self):
        """Return the boundary of the projected set.

        Returns
        -------
        points : ndarray of shape (n, 2)
            Points of the ellipse.
        """
        certificate = self.certificate
        shape = self.T @ np.linalg.solve(certificate.P, self.T.T)
        squares, axes = np.linalg.eigh(certificate.level * shape)
        t = np.linspace(0, 2 * np.pi, POINTS)
        circle = np.column_stack([np.cos(t), np.sin(t)])
        return circle @ (axes * np.sqrt(np.maximum(squares, 0.0))).T

    def plot(self, ax=None, **kwargs):
        """Draw the ellipse and the trajectories.

        Parameters
        ----------
        ax : matplotlib.axes.Axes or None, default=None
            Where to draw; None makes a figure.
        **kwargs : dict
            Options of the boundary.

        Returns
        -------
        display : CertificateDisplay
            Itself.
        """
        ((axes,),) = grid_of_axes(ax, (1, 1), size=(5.5, 4.5))
        style = {"color": color(2), "linewidth": 1.6, "label": "invariant set"}
        if self.certificate.level == 0:  # a point: the loop is linear
            style |= {"marker": "o"}
        axes.plot(*self.boundary().T, **{**style, **spelled(kwargs)})
        self.inside_ = None
        if len(self.trajectories):
            Z = np.vstack(self.trajectories)
            inside = np.zeros(len(Z), dtype=bool)
            finite = np.isfinite(Z).all(axis=1)
            inside[finite] = self.certificate.contains(Z[finite])
            self.inside_ = float(inside.mean())
            label = f"loop along the record, {percent(100 * self.inside_, 4)} inside"
            for i, run in enumerate(self.trajectories):
                axes.plot(
                    *(run @ self.T.T).T,
                    color=color(0),
                    linewidth=0.8,
                    label=label if i == 0 else None,
                )
        axes.set_xlabel(self.labels[0])
        axes.set_ylabel(self.labels[1])
        few_ticks(axes.xaxis)  # that of y would stand where the legend is
        finish(axes, legend="above")
        return self._drawn(axes)


def _without_rounding(run):
    """Return the deviations of a loop, zero where they are rounding errors alone."""
    size = np.max(np.abs(run.X), axis=0, where=np.isfinite(run.X), initial=0.0)
    return np.where(np.abs(run.Z) <= ROUNDING * size, 0.0, run.Z)
