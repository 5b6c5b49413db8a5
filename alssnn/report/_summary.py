"""What a fitted model is, on half a page: for a terminal and for a notebook."""

from dataclasses import dataclass
from html import escape

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..metrics import missed_percent, nrmse, rmse
from ..shown import percent
from ..validation import column_names
from ._sections import in_words

MOST_POLES = 8


@dataclass(frozen=True, eq=False)
class Summary:
    """Hold what a fitted model is, line by line.

    Parameters
    ----------
    name : str
        Class of the model.
    lines : tuple of tuple of str
        Pairs of what and its value.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> print(str(model.summary()).splitlines()[1])
    equation     x+ = A x + B du
    """

    name: str
    lines: tuple

    def __repr__(self):
        """Return the lines as aligned plain text."""
        width = max(len(what) for what, _ in self.lines)
        shown = [f"{what.ljust(width)}  {value}" for what, value in self.lines]
        return "\n".join([self.name, *shown])

    def to_html(self):
        """Return the lines as a table, as a notebook shows them.

        Returns
        -------
        html : str
            HTML.
        """
        rows = "".join(
            f'<tr><th style="text-align:left">{escape(what)}</th>'
            f'<td style="text-align:left">{escape(value)}</td></tr>'
            for what, value in self.lines
        )
        return f"<table><caption>{escape(self.name)}</caption>{rows}</table>"

    _repr_html_ = to_html


def summarize(model, u=None, y=None, experiment=None):
    """Say what a fitted model is, and how well it does.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), list of them or None, default=None
        Inputs of a record that did not train the model; None leaves out what only a
        record can tell: the error of a test, and how linear the model is.
    y : array_like of shape (N,) or (N, ny), list of them or None, default=None
        Outputs.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.

    Returns
    -------
    summary : Summary
        Equations, sizes, sampling time, errors in training and test, linearization
        errors e / y in the open and in the closed loop (eq. gauge), poles, and why the
        training stopped.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If only one of `u` and `y` is given, or the data do not fit the model.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> train, test = record.split(0.5)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*train)
    >>> [what for what, _ in model.summary(*test).lines][-4:]
    ['e / y', '|poles|', 'initial', 'training']
    """
    check_is_fitted(model)
    if (u is None) != (y is None):
        raise ValueError(
            "`u` and `y` must be given together, or both left out, got one of them."
        )
    fitted, (inputs, outputs) = model.fitted_, column_names(model)
    lines = [("equation" if not i else "", z) for i, z in enumerate(in_words(model))]
    free = int(fitted.free.sum())
    lines += [
        ("states", str(model.nx_)),
        ("inputs", ", ".join(inputs)),
        ("outputs", ", ".join(outputs)),
        ("parameters", str(free)),
        ("dt", f"{model.dt:g} s"),
    ]
    if np.isfinite(model.train_score_):
        missed = missed_percent(model.train_score_)
        lines.append(("train", f"misses {percent(missed, 3)} of the output"))
    if u is None:
        lines.append(("test, e / y", "unknown; a record tells: summary(u, y)"))
    else:
        lines += _of_record(model, outputs, u, y, experiment)
    n, settled = model.n_init_samples, "" if model.converged_ else "not settled: "
    lines += [
        ("|poles|", _poles(model)),
        ("initial", f"states estimated from {n} samples, which are not scored"),
        ("training", f"{settled}{model.message_}"),
    ]
    return Summary(type(model).__name__, tuple(lines))


def _of_record(model, outputs, u, y, experiment):
    """Return what a record tells of a model."""
    pair = model.simulate_test(u, y, experiment)
    values = ["diverges"] * len(outputs)
    if np.isfinite(pair[1]).all():
        errors = rmse(*pair, multioutput="raw_values")
        shares = 100 * nrmse(*pair, multioutput="raw_values")
        values = [
            f"{error:.3g}, {percent(share, 3)} of the output"
            for error, share in zip(errors, shares, strict=True)
        ]
    of = [f"{name}: " if len(outputs) > 1 else "" for name in outputs]
    lines = [
        ("test RMSE" if not i else "", f"{name}{value}")
        for i, (name, value) in enumerate(zip(of, values, strict=True))
    ]
    record = model.linearizability(u, y, experiment, in_loop=False)
    for i, name in enumerate(of):
        error = record.linearization_error[i]
        closed = np.broadcast_to(record.closed_linearization_error, len(of))[i]
        loop = (
            "no law" if np.isnan(closed) else f"{percent(100 * closed, 3)} in the loop"
        )
        what = f"{name}{percent(100 * error, 3)} along the record, {loop}"
        lines.append(("e / y" if not i else "", what))
    return lines


def _poles(model):
    """Return the moduli of the poles of the sampled linear part, largest first."""
    poles = np.linalg.eigvals(model.to_statespace(dt=model.plant_.dt).A)
    sizes = np.sort(np.abs(poles))[::-1]
    more = ", ..." if len(sizes) > MOST_POLES else ""
    if model.fitted_.structure.sampling is not None:
        more += ", of the sampled A"
    return ", ".join(f"{size:.4g}" for size in sizes[:MOST_POLES]) + more
