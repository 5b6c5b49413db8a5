"""A model on one figure: what it misses, and what its networks are."""

from matplotlib.figure import Figure
from sklearn.utils.validation import check_is_fitted

from ..linearizability import words_left
from ._nonlinearity import NonlinearityDisplay, ResidualNonlinearityDisplay
from ._residuals import ResidualDisplay
from ._simulation import SimulationDisplay

PARTS: dict[str, tuple] = {  # display, network
    "simulation": (SimulationDisplay, ""),
    "residual": (ResidualDisplay, ""),
    "h": (NonlinearityDisplay, "W_h"),
    "g": (ResidualNonlinearityDisplay, "W_g"),
}
OPTIONS: dict[str, dict] = {  # of the axes of a part
    "simulation": {"sharex": "col", "height_ratios": (2, 1)},
    "h": {"sharey": "row"},
}
ROW = 2.1  # inches


def plot_model(model, u, y, experiment=None, *, parts=None):
    """Draw what a fitted model misses of a record, and what its networks are.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), or list of them
        Inputs of a record, best one that the model was not trained on.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs; nan where not measured.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample; the first one is simulated on the
        figure.
    parts : sequence of str or None, default=None
        Some of "simulation", "residual", "h" and "g"; None takes all that the model
        has.

    Returns
    -------
    figure : matplotlib.figure.Figure
        The parts below each other, each as its display draws it.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If a part is unknown or not in the model, or the record is too short.

    Examples
    --------
    >>> from alssnn.plotting import plot_model
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=6, dt=record.dt).fit(*record)
    >>> len(plot_model(model, *record).axes)  # output and residual, two correlations
    4
    """
    check_is_fitted(model)
    there = [z for z, (*_, name) in PARTS.items() if not name or name in model.params_]
    if not model.plant_.cancels:  # a network that became the linear model
        there = [z for z in there if z != "h"]
    parts = there if parts is None else list(parts)
    for part in parts:
        if part not in there:
            raise ValueError(
                f"`parts` must be some of {', '.join(there)} for this model, got "
                f"{part!r}. A linear model has neither h nor g."
            )
    if not parts:
        raise ValueError("`parts` must name at least one part, got none.")
    displays = [PARTS[z][0].from_estimator(model, u, y, experiment) for z in parts]
    # once more on axes of one figure: how many they are, the displays alone know
    shapes = [display.axes_.shape for display in displays]
    heights = [ROW * rows + 0.4 for rows, _ in shapes]
    titles = _titles(model.plant_)
    width = max(display.figure_.get_size_inches()[0] for display in displays)
    figure = Figure(figsize=(width, sum(heights)), layout="constrained")
    frames = figure.subfigures(len(parts), 1, squeeze=False, height_ratios=heights)
    for part, display, shape, frame in zip(
        parts, displays, shapes, frames[:, 0], strict=True
    ):
        options = OPTIONS.get(part, {})
        if getattr(display, "n_inputs", 0):  # phi is not of the size of h
            options = {}
        axes = frame.subplots(*shape, squeeze=False, **options)
        display.plot(axes)
        frame.suptitle(titles[part], x=0.02, ha="left", weight="bold")
    return figure


def _titles(plant):
    """Return the titles of all parts."""
    return {
        "simulation": "Measured and simulated",
        "residual": "Correlations of the residual",
        "h": f"h, which {'no' if plant.no_law else 'the'} law cancels",
        "g": words_left(plant),
    }
