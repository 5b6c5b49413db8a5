"""Sections that say what a model is, and what a record says about it."""

import reprlib
from numbers import Number

import numpy as np

from ..metrics import free_run_errors, missed_percent, nrmse
from ..shown import percent
from ..validation import column_names
from ..walk import static_map, walk
from ._page import (
    attempt,
    figure,
    heading,
    matrix,
    number,
    paragraph,
    python_code,
    table,
)


def summary(model, data, test, validation, reason=""):
    """Return the verdict, how accurate and how linear the model is, and what it is.

    Parameters
    ----------
    model : estimator
        Fitted model.
    data : list of PreparedRecord
        The experiments.
    test : tuple
        The record, (u, y, experiment).
    validation : Validation or None
        Checks on the record; None if there are none.
    reason : str, default=""
        Why there is no validation.

    Returns
    -------
    html : str
        HTML.
    """
    inputs, outputs = column_names(model)
    y = np.vstack([record.y for record in data])
    rows = [
        ("model", type(model).__name__),
        *(("equations" if not i else "", z) for i, z in enumerate(in_words(model))),
        ("inputs", ", ".join(inputs)),
        ("outputs", ", ".join(outputs)),
        ("states", str(model.nx_)),
        ("sampling time", f"{model.dt:.10g} s"),
        ("trained parameters", str(model.fitted_.free.sum())),
        ("end of the training", f"{model.n_iter_} trial steps: {model.message_}"),
        ("samples of this record", str(len(y))),
        ("experiments of this record", str(len(data))),
    ]
    if np.isnan(y).any():
        missing = 100 * np.isnan(y).mean(axis=0)
        shares = zip(outputs, missing, strict=True)
        words = ", ".join(f"{name} {percent(share, 3)}" for name, share in shares)
        rows.append(("not measured", words))
    settings = [
        (name, "not set" if value is None else _in_words(value))
        for name, value in sorted(model.get_params(deep=False).items())
    ]
    return (
        _verdict(model, outputs, test, validation, reason)
        + table((), rows)
        + f"<details><summary>Settings</summary>{table((), settings)}</details>"
    )


def _in_words(value):
    """Return the value of a setting: whole, if it is short."""
    return str(value) if isinstance(value, str | Number) else reprlib.repr(value)


def _verdict(model, outputs, test, validation, reason):
    """Return whether the model passed, and the two numbers that matter most."""
    parts = [paragraph(f"Not validated. {reason}", "verdict fail")]
    if validation is not None:
        parts = [_passed(validation, "verdict ")]
    y_true, y_pred = model.simulate_test(*test)
    said = "The simulation of this record diverges."
    if np.isfinite(y_pred).all():
        shares = 100 * nrmse(y_true, y_pred, multioutput="raw_values")
        missed = ", ".join(
            f"{percent(share)} of {name}"
            for name, share in zip(outputs, shares, strict=True)
        )
        said = f"On this record the simulation misses {missed}."
    if np.isfinite(model.train_score_):
        share = missed_percent(model.train_score_)
        said += f" In training it missed {percent(share)} of the output."
    parts.append(paragraph(f"Accuracy: {said}"))
    if validation is not None:
        linear = validation["linearizability"].sentence
        parts.append(paragraph(f"Linearizability: {linear}"))
    return "".join(parts)


def _passed(validation, kind=""):
    """Return whether all checks passed that decide."""
    if validation.passed:
        return paragraph("Passed: all required checks.", f"{kind}pass")
    words = f"The model {validation.verdict}. See the checks below."
    return paragraph(words, f"{kind}fail")


def equations(model):
    """Return the equations of the model with their numbers.

    Parameters
    ----------
    model : estimator
        Fitted model.

    Returns
    -------
    html : str
        HTML.
    """
    plant = model.plant_
    inputs, outputs = column_names(model)
    is_continuous = model.fitted_.structure.sampling is not None
    per_second = "per second" if is_continuous else ""
    linear = {
        "A": (model.A_, per_second),
        "B": (model.B_, per_second),
        "C": (model.C_, ""),
        "D": (model.D_, ""),
        "G": (model.G_, f"of {_disturbances(model)} {per_second}".rstrip()),
        "H": (model.H_, f"of {_disturbances(model)}"),
        "u_e": (plant.u_offset, f"operating point of {', '.join(inputs)}"),
        "y_e": (plant.y_offset, f"operating point of {', '.join(outputs)}"),
    }
    shown = {
        name: (z, words)
        for name, (z, words) in linear.items()
        if name not in ("D", "G", "H") or np.any(z)
    }
    steps, arrays = model_steps(plant)
    numbers = "".join(matrix(name, values) for name, values in arrays.items())
    lines = "".join(paragraph(line, "equation") for line in steps)
    arrays = {name: values for name, (values, _) in linear.items()} | arrays
    return "".join(
        [
            *(paragraph(line, "equation") for line in in_words(model)),
            paragraph(f"du = u - u_e, {_delay_words(model)}", "note"),
            *_disturbance_words(model),
            *_law_words(plant),
            *(matrix(name, values, words) for name, (values, words) in shown.items()),
            *([paragraph(_pole_words(model), "note")] if is_continuous else []),
            heading("Step by step"),
            lines or paragraph("The model is linear.", "note"),
            f"<details><summary>Numbers of these steps</summary>{numbers}</details>",
            python_code("Copy all numbers as Python", arrays),
        ]
    )


def _pole_words(model):
    """Return the poles of A in continuous time, those of a pair once."""
    poles = np.linalg.eigvals(model.A_)
    words = [
        f"{abs(s) / (2 * np.pi):.3g} Hz with a damping ratio of {-s.real / abs(s):.2g}"
        if s.imag
        else f"{s.real:.3g} per second"
        for s in sorted(poles[poles.imag >= 0], key=abs)
    ]
    steps = "The steps below are from sample to sample, and hold their inputs"
    if model.fitted_.structure.sampling.hold != "zoh":
        steps += ", unlike the simulation of this record"
    return f"Poles of A: {', '.join(words)}. {steps}."


def in_words(model):
    """Return the equations of a model of the family.

    Parameters
    ----------
    model : estimator
        Fitted model.

    Returns
    -------
    lines : list of str
        Plain text; none for other structures, which have their steps.
    """
    options = model.fitted_.structure.options
    if "n_h" not in options:
        return []
    # networks that a search has left, or a decay taken away, are none
    g, k = (any(options[f"n_{z}"]) and np.any(model.params_[f"W_{z}"]) for z in "gk")
    h = model.plant_.cancels
    nd = len(model.disturbances_)
    du = "dm" if nd else "du"
    s = "x" if options["feedback"] == "state" else "y - y_e"
    s += ", dd" if nd else ""
    of_v = f"({du} + h({s}))" if h else du
    if not model.plant_.is_explicit:
        of_v = f"phi({du}, {s})"
    x_next = "x+" if model.fitted_.structure.sampling is None else "x'"
    state = f"{x_next} = A x + B {of_v}" + (" + G dd" if nd else "")
    output = "y - y_e = C x" + (f" + D {du}" if np.any(model.D_) else "")
    output += " + H dd" if np.any(model.H_) else ""
    return [
        state + (" + g(x, du)" if g else ""),
        output + (" + k(x, du)" if k else ""),
    ]


def _disturbances(model):
    """Return the names of measured disturbances."""
    inputs, _ = column_names(model)
    return ", ".join(inputs[i] for i in model.disturbances_)


def _disturbance_words(model):
    """Say which part of du is measured but not moved, where there is any."""
    if not len(model.disturbances_):
        return []
    words = (
        f"dd are the columns of du of the measured disturbances: {_disturbances(model)}"
        ". dm are the others, which a controller moves."
    )
    return [paragraph(words, "note")]


def _law_words(plant):
    """Return what the law leaves, where there is something to cancel."""
    if not plant.cancels:
        return []
    s = "x" if plant.feedback == "state" else "y"
    s += ", d" if plant.nd else ""
    of_d = " and G dd" if plant.nd else ""
    left = f"The law leaves (A, B, C) from v{of_d}, as far as the model is the plant."
    if not plant.no_law and np.any(plant.observed.rows_z[plant.ny + plant.nv :]):
        left = f"The law leaves (A, B, C) from v{of_d}, and what it does not cancel."
    return [
        paragraph(
            f"u = v - h({s})"
            if plant.is_explicit
            else f"v = phi(u, {s}), solved for u: phi increases with u",
            "equation",
        ),
        paragraph(plant.no_law or left, "note"),
    ]


def model_steps(plant):
    """Return what one sample of a nonlinear model computes, as formulas.

    Parameters
    ----------
    plant : Plant
        The model; its inputs are those that have arrived.

    Returns
    -------
    lines : list of str
        Formulas in the order of evaluation, of deviations: layers of neurons, ``x+``,
        ``y - y_e`` and, where there is a law, ``v - u_e``. None for a linear model.
    arrays : dict of str to ndarray
        The numbers in them, by name.
    """
    if not plant.form.nw:
        return [], {}
    nx, ny = plant.nx, plant.ny
    model = {"x": nx, "du": plant.nu}
    law = {"s": plant.law_form.nu - plant.nu, "dd": plant.nd, "du": plant.nv}
    if plant.nd:
        law["dm"] = law.pop("du")
    else:
        del law["dd"]
    maps = {
        "x+": ("f", static_map(plant.form, slice(0, nx)), model),
        "y - y_e": ("c", static_map(plant.form, slice(nx, nx + ny)), model),
    }
    if plant.cancels:
        maps["v - u_e"] = ("v", plant.law_form, law)
    steps = _Steps()
    for value, (prefix, lure, signals) in maps.items():
        steps.prefix = prefix
        walk(lure, signals, steps, value)
    return steps.lines, steps.arrays


class _Steps:
    """Write static maps as lines of text, for `walk`."""

    def __init__(self):
        self.prefix, self.lines, self.arrays = "", [], {}

    def affine(self, value, terms, constant):
        """Add a sum of products."""
        value = f"{self.prefix}_{value}" if value.startswith("w") else value
        parts = [(f"{self.prefix}_{name}", z, signal) for name, z, signal in terms]
        self.arrays |= {name: z for name, z, _ in parts}
        words = [f"{name} {signal}" for name, _, signal in parts]
        name, vector = constant
        if np.any(vector):
            self.arrays[f"{self.prefix}_{name}"] = vector
            words.append(f"{self.prefix}_{name}")
        self.lines.append(f"{value} = {' + '.join(words) or 0}")
        return value

    def activate(self, value, size, sigma):
        """Put the last line into an activation."""
        left, _, right = self.lines[-1].partition(" = ")
        self.lines[-1] = f"{left} = {sigma.name}({right})"
        return value


def _delay_words(model):
    said = "x+ is x one sample later"
    if model.fitted_.structure.sampling is not None:
        said = f"x' is the derivative of x by the time in seconds, {said}"
    if not np.any(model.input_delay_):
        return said
    inputs, _ = column_names(model)
    late = ", ".join(
        f"{name} arrives {delay} {'sample' if delay == 1 else 'samples'} late"
        for name, delay in zip(inputs, model.input_delay_, strict=True)
        if delay
    )
    return f"{said}; {late}"


def accuracy(model, test, train, floor=None):
    """Return errors of the free run on every record, and the simulation.

    Parameters
    ----------
    model : estimator
        Fitted model.
    test : tuple
        The record, (u, y, experiment).
    train : tuple or None
        Training data, (u, y, experiment).
    floor : ndarray of shape (ny,) or None, default=None
        Errors that no model goes below; None if they are not known.

    Returns
    -------
    html : str
        HTML.
    """
    _, outputs = column_names(model)
    rows: list[tuple] = []
    for name, data in (("training", train), ("this record", test)):
        if data is None:
            continue
        error, fit = free_run_errors(*model.simulate_test(*data))
        errors = error, 1 - fit / 100, fit
        rows += [(name, *row) for row in zip(outputs, *errors, strict=True)]
    header: tuple[str, ...] = ("data", "output", "RMSE", "NRMSE", "fit, %")
    if floor is not None:
        header = (*header, "RMSE / noise floor")
        ratios = [row[2] / floor[outputs.index(row[1])] for row in rows]
        rows = [(*row, ratio) for row, ratio in zip(rows, ratios, strict=True)]
    parts = [
        paragraph(
            "Errors of the free-run simulation; the first samples set the initial "
            "state and are not scored. RMSE has the unit of the output, NRMSE is "
            "relative to its standard deviation."
            + " On a fresh record the best that a model can do is about the noise "
            "floor, a ratio of 1. In training it may go below, and by chance elsewhere."
            * (floor is not None)
        ),
        table(header, rows),
        attempt(lambda: _simulation(model, test), "Figure of the simulation"),
    ]
    return "".join(parts)


def _simulation(model, test):
    from ..plotting import SimulationDisplay

    caption = "Measured and simulated output, and their difference"
    n = len(model.prepare_records(*test))
    if n > 1:
        caption += f", in the first of {n} experiments alone"
    return figure(SimulationDisplay.from_estimator(model, *test), f"{caption}.")


def checks(validation, reason):
    """Return the verdicts of validation and the correlations of the residual.

    Parameters
    ----------
    validation : Validation or None
        Checks on the record; None if there are none.
    reason : str
        Why there is no validation.

    Returns
    -------
    html : str
        HTML.
    """
    if validation is None:
        return paragraph(f"Validation: not available. {reason}", "note")
    rows = [
        (
            check.outcome,
            check.name,
            number(check.value, 3),
            check.quantity.strip(","),
            check.sentence,
        )
        for check in validation
    ]
    content = _passed(validation)
    content += table(("", "check", "value", "quantity", "meaning"), rows, "checks")
    if validation.residuals is not None:
        content += attempt(lambda: _residuals(validation), "Figure of the residuals")
    return content


def _residuals(validation):
    from ..plotting import ResidualDisplay

    words = (
        "Correlations of the residual: those with u should stay in their band. The "
        "checks take all lags together and allow for errors of the parameters; the "
        "bands, of one lag each, do not."
    )
    if validation.residuals.ahead:
        words = (
            "Correlations of the errors one sample ahead: those with themselves "
            "and with past u should stay in their band."
        )
    return figure(ResidualDisplay(validation.residuals).plot(), words)
