"""What stands for a plant: a `Plant`, or a fitted model that has one."""

from .plant import Plant


def is_model(candidate):
    """Tell whether something is a plant, or an estimator that has one.

    Parameters
    ----------
    candidate : object
        Anything.

    Returns
    -------
    is_model : bool
        Whether `as_plant` knows what to do with it.
    """
    return isinstance(candidate, Plant) or hasattr(type(candidate), "plant_")


def as_plant(model):
    """Return the plant of a fitted model; a plant is returned as it is.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.

    Returns
    -------
    plant : Plant
        The plant.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    TypeError
        If it is neither.
    """
    if isinstance(model, Plant):
        return model
    if not is_model(model):
        raise TypeError(
            f"`model` must be a fitted model or a Plant, got {type(model).__name__}."
        )
    return model.plant_
