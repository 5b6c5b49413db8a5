"""Save and load fitted models, exactly and without pickle.

A file holds what a fit leaves behind, and nothing that follows from it:

    class, params             the estimator as it was constructed
    structure                 sizes and options for `models.state_space`
    parameter.A, .B, ...      theta by name, and C where it is a constant
    center.W_h, ...           the random start, where the decay is centered at it
    u_offset ... x_scale      units of the fit
    x0, input_delay, region   and the other results of `fit`

Names, not places, identify the parameters, so that a later release may order theta in
another way.  Everything is checked before a model is made of it: the file may come from
elsewhere.
"""

from dataclasses import asdict
from numbers import Real
from types import SimpleNamespace

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..activations import shipped_name
from ..containers import Container
from ..continuous import derivative, sampled
from ..given_system import GivenSystem
from ..inputs import split_inputs
from ..models import state_space
from ..region import Region
from ..scaling import Scaling
from ..split import NAME as LINEAR
from ..split import with_linear
from ..watch import Step
from ._archive import decode, encode, read, release, write

PARAMETER = "parameter."
CENTER = "center."
REGION = ("low", "high", "center", "whiten", "radius", "points", "reach", "doubt")
NEAREST = ("points", "reach", "doubt")  # of the region, not in older files
SCALING = ("u_offset", "y_offset", "u_scale", "y_scale")
RESULTS = ("x0_", "input_delay_", "singular_values_")
LONGEST = 300  # characters of a reason for which a file is refused
# What contradictions in a file raise, besides those that are looked for.
ALTERED = (
    KeyError,
    TypeError,
    AttributeError,
    IndexError,
    ValueError,
    OverflowError,
    RecursionError,
)


def save(model, path):
    """Write a fitted model to a file.

    Parameters
    ----------
    model : estimator
        Fitted model.
    path : str or path-like
        File; one that exists is replaced.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    OSError
        If the file cannot be written.
    ValueError
        If the model has what no file can hold: an activation of the user's, a
        `RandomState`, labels that are neither numbers nor strings, or values that
        are not finite.

    See Also
    --------
    alssnn.load : Load it.

    Notes
    -----
    A `linear_start` that is a model or a system is kept as its matrices and sampling
    time.
    """
    check_is_fitted(model)
    fitted = model.fitted_
    structure, container = fitted.structure, fitted.container
    sampling, equations = structure.sampling, derivative(structure)
    params = {k: _encode_param(k, v) for k, v in model.get_params(False).items()}
    used = fitted.options.items()  # a fit that is over needs no random state
    used = {k: _encode_param(k, v) for k, v in used if k != "random_state"}
    document = {
        "alssnn": release(),
        "class": type(model).__name__,
        "params": params,
        "structure": {
            "sizes": [structure.sizes["x"], equations.nu, structure.sizes["y"]],
            "sampling": sampling and [sampling.hold, sampling.substeps, sampling.dt],
            "constants": list(structure.constants),
            "given": [int(i) for i in structure.given],
            "options": {k: _encode_param(k, v) for k, v in structure.options.items()},
        },
        "fit": {
            "cost": _finite("cost_", model.cost_),
            "n_iter": model.n_iter_,
            "converged": model.converged_,
            "message": model.message_,
            "history": [_encode_step(step) for step in model.history_],
            "train_score": encode(model.train_score_),
            "orders": encode(model.orders_),
            "alpha": encode(getattr(model, "alpha_", None)),
            "predictor": encode(fitted.predictor),
            "options": {k: v for k, v in used.items() if v != params[k]},
            "y_ndim": fitted.y_ndim,
            "integrators": model.integrators_,
            "container": {
                "library": container.library,
                "is_series": container.is_series,
                "names": [_encode_label(name) for name in container.names],
            },
            "experiments": [_encode_label(label) for label in model.experiments_],
            "input_names": _names(getattr(model, "feature_names_in_", None)),
            "output_names": _names(model.output_names_),
        },
    }
    p = {**structure.constants, **structure.split(fitted.theta)}
    arrays = {PARAMETER + name: value for name, value in p.items()}
    arrays |= {name: getattr(fitted.scaling, name) for name in SCALING}
    arrays["x_scale"] = np.array(fitted.x_scale)
    arrays |= {name.rstrip("_"): getattr(model, name) for name in RESULTS}
    arrays["noise_covariance"] = model.noise_covariance_
    arrays |= {f"region.{k}": np.asarray(getattr(fitted.region, k)) for k in REGION}
    decay = fitted.decay or {}
    if "center" in decay:
        center = structure.split(decay["center"])
        arrays |= {CENTER + name: value for name, value in center.items()}
    for name, value in arrays.items():
        _finite(name, value)
    write(path, document, arrays)


def load(path, classes):
    """Read a fitted model from a file.

    Parameters
    ----------
    path : str or path-like
        File that `save` wrote.
    classes : dict of str to type
        Estimators by name.

    Returns
    -------
    model : estimator
        The fitted model.

    Raises
    ------
    OSError
        If the file cannot be opened.
    ValueError
        If the file is of another type or version, damaged, or contradicts itself.
    """
    document, arrays = read(path)
    name = str(document.get("class"))
    if name not in classes:
        raise ValueError(
            f"`path` must hold one of {', '.join(classes)}, got {name[:LONGEST]!r}: "
            f"{path}. Upgrade alssnn if the model is new."
        )
    try:
        with np.errstate(all="ignore"):  # what overflows is refused
            model = _restore(classes[name], document, arrays)
            _check_model(model)
        return model
    except ALTERED as error:
        reason = f"no {error}" if isinstance(error, KeyError) else str(error)
        reason = reason if len(reason) <= LONGEST else f"{reason[:LONGEST]} ..."
        raise ValueError(
            f"`path` must be a file as `model.save` wrote it, got an altered one: "
            f"{path}: {reason.rstrip('.')}. Save the model again."
        ) from error


def _restore(cls, document, arrays):
    """Return the model of a document and its arrays; all sizes are checked."""
    fit, params = document["fit"], document["params"]
    model, used = (
        cls(**{name: _decode_param(name, value) for name, value in options.items()})
        for options in (params, {**params, **fit.get("options", {})})
    )
    structure = _structure(used, document["structure"], arrays)
    _add_what_older_files_lack(arrays, fit)
    _check_arrays(arrays, _shapes(structure, arrays, len(fit["experiments"])))
    results, decay = _results(used, fit, arrays)
    if _is_centered(arrays):
        center = {name: arrays[CENTER + name] for name in structure.shapes}
        decay = {"alpha": results["alpha_"], "center": structure.join(center)}
    region = {name: arrays[f"region.{name}"] for name in REGION}
    container = fit.get("container", {})  # files without it are of arrays
    fitted = SimpleNamespace(
        structure=structure,
        theta=structure.join({k: arrays[PARAMETER + k] for k in structure.shapes}),
        scaling=Scaling(*(arrays[name] for name in SCALING)),
        x_scale=arrays["x_scale"],
        region=Region(**{k: z if z.ndim else z[()] for k, z in region.items()}),
        container=Container(
            container.get("library"),
            container.get("is_series", False),
            tuple(map(_decode_label, container.get("names", ()))),
        ),
        y_ndim=fit["y_ndim"],
        decay=decay,
        predictor=_predictor(decode(fit.get("predictor"))),
        options=used.get_params(deep=False),
    )
    _check_fit(fitted, results, derivative(structure).nu, structure.sizes["y"])
    return model.restore(fitted, results)


def _structure(model, described, arrays):
    """Return the structure of a model, which a class of its own declares itself."""
    nx, nu, ny = described["sizes"]
    options = {k: decode(v) for k, v in described["options"].items()}
    for penalty in ("penalty", "penalize_h"):  # of older files: what a fit penalized
        options.pop(penalty, None)
    C = arrays[PARAMETER + "C"] if "C" in described["constants"] else None
    if options.keys() - {"disturbances"}:
        structure = state_space(nx, nu, ny, C=C, **options)
        if LINEAR in described["constants"]:
            structure = with_linear(structure, arrays[PARAMETER + LINEAR])
    else:
        model.disturbances_ = split_inputs(nu, described.get("given", ()))[1]
        structure = model.declare(nx, nu, ny, C)
    sampling = described.get("sampling")
    return sampled(structure, *sampling) if sampling else structure


def _add_what_older_files_lack(arrays, fit):
    """Add arrays that files had not from the beginning."""
    if "noise_covariance" not in arrays:
        variances = arrays["y_scale"] ** 2
        arrays["noise_covariance"] = np.diag(fit["cost"] / len(variances) * variances)
    if not any(f"region.{name}" in arrays for name in NEAREST):
        points = np.empty((0, np.shape(arrays["region.whiten"])[-1]))
        nearest = zip(NEAREST, (points, np.zeros(()), np.zeros(())), strict=True)
        arrays |= {f"region.{name}": value for name, value in nearest}


def _is_centered(arrays):
    """Tell whether the weight decay pulls towards a start that is in the file."""
    return any(name.startswith(CENTER) for name in arrays)


def _shapes(structure, arrays, n_experiments):
    """Return the shapes that arrays must have, by name; several if any is right."""
    nu = derivative(structure).nu
    nx, ny = structure.sizes["x"], structure.sizes["y"]
    excited = np.shape(arrays["region.whiten"])[-1]
    n_points = len(np.atleast_1d(arrays.get("region.points", ())))
    n_region = nx if np.shape(arrays["region.center"]) == (nx,) else nx + nu  # [x; u]
    shapes = {
        **{PARAMETER + name: shape for name, shape in structure.shapes.items()},
        **{PARAMETER + name: np.shape(z) for name, z in structure.constants.items()},
        **({PARAMETER + "C": (ny, nx)} if "C" in structure.constants else {}),
        **dict.fromkeys(("u_offset", "u_scale", "input_delay"), (nu,)),
        **dict.fromkeys(("y_offset", "y_scale"), (ny,)),
        "x_scale": ((1,), (nx,)),
        "x0": (n_experiments, nx),
        "region.low": (nu + ny,),
        "region.high": (nu + ny,),
        "region.center": ((nx,), (nx + nu,)),  # of older files: x alone
        "region.whiten": (n_region, excited),
        "region.points": (n_points, excited),
        **dict.fromkeys(("region.radius", "region.reach", "region.doubt"), ()),
        "noise_covariance": (ny, ny),
        "singular_values": np.shape(arrays["singular_values"])[:1],
    }
    if _is_centered(arrays):
        shapes |= {CENTER + name: shape for name, shape in structure.shapes.items()}
    return shapes


def _predictor(kept):
    """Return what the training of a predictor goes on with, as numbers."""
    if kept is None:
        return None
    names = ("forgets", "linear_cost")
    return {name: float(_finite(name, kept[name])) for name in names}


def _results(model, fit, arrays):
    """Return published results by name, and the decay; older files do not tell all."""
    orders = decode(fit.get("orders", {"dict": []}))
    if any(errors.keys() != {int(nx) for nx in errors} for errors in orders.values()):
        raise ValueError(f"orders {orders} are not integers")
    results = {
        **{name: arrays[name.rstrip("_")] for name in RESULTS},
        "noise_covariance_": arrays["noise_covariance"],
        "integrators_": int(fit.get("integrators", 0)),
        "cost_": float(_finite("cost", fit["cost"])),
        "n_iter_": int(fit["n_iter"]),
        "converged_": bool(fit["converged"]),
        "message_": str(fit.get("message", "")),
        "history_": [_decode_step(step) for step in fit.get("history", ())],
        "train_score_": float(decode(fit.get("train_score", {"float": "nan"}))),
        "orders_": {
            str(kind): {nx: float(error) for nx, error in errors.items()}
            for kind, errors in orders.items()
        },
        "experiments_": list(map(_decode_label, fit["experiments"])),
        "n_features_in_": len(arrays["u_offset"]),
        "output_names_": fit["output_names"],
    }
    if fit["input_names"] is not None:
        results["feature_names_in_"] = np.array(fit["input_names"], dtype=object)
    decay = None
    if hasattr(model, "alpha"):
        alpha = decode(fit.get("alpha"))
        given = 0.0 if model.alpha == "auto" else model.alpha
        results["alpha_"] = float(given if alpha is None else alpha)
        decay = {"alpha": results["alpha_"]} if model.alpha == "auto" else None
    return results, decay


def _check_arrays(arrays, shapes):
    """Refuse arrays that are missing, of another shape or type, or not finite."""
    if missing := sorted(set(shapes) - set(arrays)):
        raise ValueError(f"no {', '.join(missing)}")
    if strange := sorted(set(arrays) - set(shapes)):
        raise ValueError(f"unknown {', '.join(strange)}")
    for name, shape in shapes.items():
        value, choices = arrays[name], shape if np.ndim(shape) == 2 else (shape,)
        if value.shape not in choices:
            raise ValueError(f"{name} has shape {value.shape} instead of {choices[-1]}")
        if value.dtype != (int if name == "input_delay" else float):
            raise ValueError(f"{name} is of type {value.dtype}")
        _finite(name, value)
        if name.endswith("_scale"):
            square = value * np.abs(value)
            if not np.all((square > 0) & np.isfinite(square)):
                raise ValueError(f"{name} is not positive, or its square no number")
    if np.any(arrays["input_delay"] < 0):
        raise ValueError("input_delay is negative")


def _check_model(model):
    """Refuse a model whose options contradict its parameters, or that overflows."""
    for name, value in model.get_params(deep=False).items():
        _encode_param(name, value)  # what was loaded can be saved
    for name, value in {**model.params_, "x0": model.x0_}.items():
        _finite(name, value)
    _finite("theta", model.fitted_.theta)


def _check_fit(fitted, results, nu, ny):
    """Refuse names and labels that do not fit the sizes."""
    for names, size in (
        (results.get("feature_names_in_"), nu),
        (results["output_names_"], ny),
    ):
        strings = names is None or all(isinstance(name, str) for name in names)
        if not strings or (names is not None and len(names) != size):
            raise ValueError(f"{size} signals are named {names}")
    labels = results["experiments_"]
    if not labels or not all(map(_is_label, labels)):
        raise ValueError(f"the experiments are labeled {labels}")
    container = fitted.container
    if container.library not in (None, "pandas", "polars"):
        raise ValueError(f"the outputs are of the library {container.library!r}")
    if len(container.names) != (0 if container.library is None else ny):
        raise ValueError(f"{ny} outputs are labeled {container.names}")
    if fitted.y_ndim not in (1, 2) or (fitted.y_ndim == 1 and ny > 1):
        raise ValueError(f"{ny} outputs have {fitted.y_ndim} dimensions")


def _finite(name, value):
    if not np.isfinite(value).all():
        raise ValueError(
            f"`{name}` of the model must be finite, got NaN or infinity. Fit it again "
            "with fewer states or stronger penalties."
        )
    return value


def _encode_step(step):
    # JSON has no nan (no error on validation data), and no inf (it diverged there)
    return [None if value != value else encode(value) for value in step]


def _decode_step(values):
    label, iteration, *numbers = values
    numbers = [np.nan if z is None else float(decode(z)) for z in numbers]
    return Step(str(label), int(iteration), *numbers)


def _names(names):
    return None if names is None else [str(name) for name in names]


def _is_plain(label):
    return label is None or isinstance(label, str | Real)


def _is_label(label):
    if isinstance(label, tuple):  # of `seam_labels`: a label and a sample number
        return len(label) == 2 and all(map(_is_plain, label))
    return _is_plain(label)


def _encode_label(label):
    if isinstance(label, tuple):
        return [_encode_label(part) for part in label]
    encoded = encode(label) if _is_plain(label) else {}
    if isinstance(encoded, dict):
        raise ValueError(
            f"Labels in `experiment` must be finite numbers or strings for a file, got "
            f"{label!r}. Fit with such labels."
        )
    return encoded


def _decode_label(encoded):
    return tuple(encoded) if isinstance(encoded, list) else encoded


def _encode_param(name, value):
    """Return a parameter of an estimator or a structure as JSON knows it."""
    if name == "activation":
        if isinstance(value, dict):
            value = {net: _activation_name(v) for net, v in value.items()}
        else:
            value = _activation_name(value)
    elif name == "linear_start" and not isinstance(value, tuple | list | None):
        value = asdict(GivenSystem.of(value))
    elif name == "noise_floor":  # of what a look or a response says, the numbers
        value = getattr(value, "noise_rms", value)
    try:
        return encode(value)
    except TypeError as error:
        remedy = "Give numbers, strings, arrays, or tuples and dicts of them"
        if name == "random_state":
            remedy = "Replace it: model.set_params(random_state=0) keeps the fit"
        raise ValueError(
            f"`{name}` must be made of numbers and strings for a file, got {error}. "
            f"{remedy}."
        ) from error


def _decode_param(name, encoded):
    """Return a parameter of an estimator; a system has its fields in a dict."""
    value = decode(encoded)
    if name == "linear_start" and isinstance(value, dict):
        return GivenSystem(**value)
    return value


def _activation_name(activation):
    return activation if isinstance(activation, str) else shipped_name(activation)
