"""Sections that say what a model is, and what a record says about it."""

import numpy as np

from ..metrics import fit_percent, nrmse, rmse
from ..networks import Perceptron
from ..plant import as_plant
from ..validation import column_names
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


def summary(model, data, validation):
    """Return what the model is and the verdict.

    Parameters
    ----------
    model : estimator
        Fitted model.
    data : list of PreparedRecord
        The experiments.
    validation : Validation or None
        Checks on the record; None if there are none.

    Returns
    -------
    html : str
        HTML.
    """
    inputs, outputs = column_names(model)
    y = np.vstack([record.y for record in data])
    rows = [
        ("model", type(model).__name__),
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
        words = ", ".join(f"{name} {share:.3g} %" for name, share in shares)
        rows.append(("not measured", words))
    if validation is None:
        rows.append(("validation", "not available, see below"))
    else:
        failed = [c.name for c in validation if c.decides and not c.passed]
        rows.append(("validation", "pass" if not failed else "FAIL"))
        if failed:
            rows.append(("failed checks", ", ".join(failed)))
    settings = [
        (name, "default" if value is None else str(value))
        for name, value in sorted(model.get_params(deep=False).items())
        if np.ndim(value) == 0
    ]
    return (
        table((), rows)
        + f"<details><summary>Settings</summary>{table((), settings)}</details>"
    )


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
    p = model.params_
    nets = {net: f"W_{net}" in p for net in "hgk"}
    s = "x" if "W_s" in p else "y - y_e"
    state = "x+ = A x + B " + (f"(du + h({s}))" if nets["h"] else "du")
    state += " + g(x, du)" if nets["g"] else ""
    output = "y - y_e = C x" + (" + D du" if np.any(model.D_) else "")
    output += " + k(x, du)" if nets["k"] else ""
    parts = [
        paragraph(state, "equation"),
        paragraph(output, "equation"),
        paragraph(f"du = u - u_e, {_delay_words(model)}", "note"),
    ]
    if nets["h"]:
        parts += [
            paragraph(f"u = v - h({s})", "equation"),
            paragraph(
                as_plant(model).no_law
                or "The law leaves (A, B, C) from v"
                + (" and g." if nets["g"] else ", as far as the model is the plant."),
                "note",
            ),
        ]
    arrays = {
        "A": model.A_,
        "B": model.B_,
        "C": model.C_,
        "D": model.D_,
        "u_e": model.u_offset_,
        "y_e": model.y_offset_,
    }
    inputs, outputs = column_names(model)
    words = {
        "u_e": f"operating point of {', '.join(inputs)}",
        "y_e": f"operating point of {', '.join(outputs)}",
    }
    parts += [
        matrix(name, values, words.get(name, ""))
        for name, values in arrays.items()
        if name != "D" or np.any(values)
    ]
    for net in (name for name, there in nets.items() if there):
        sigma = model.fitted_.structure.activations[f"w_{net}"]
        network = Perceptron.of(net, p, sigma)
        size = len(network.layers)
        see = f"s = {s}" if net == "h" else "[x; du]"
        parts += [
            heading(f"Network {net}"),
            paragraph(
                f"{size} layers on {see}: z <- {sigma.name}(W z + b), the last layer "
                "linear."
            ),
        ]
        layers = ""
        for i, (W, b) in enumerate(network.layers, 1):
            arrays |= {f"W_{net}_{i}": W, f"b_{net}_{i}": b}
            layers += matrix(f"W{i}", W) + matrix(f"b{i}", b)
        parts.append(f"<details><summary>Weights of {net}</summary>{layers}</details>")
    parts.append(python_code("Copy all numbers as Python", arrays))
    return "".join(parts)


def _delay_words(model):
    if not np.any(model.input_delay_):
        return "x+ is x one sample later"
    inputs, _ = column_names(model)
    late = ", ".join(
        f"{name} arrives {delay} {'sample' if delay == 1 else 'samples'} late"
        for name, delay in zip(inputs, model.input_delay_, strict=True)
        if delay
    )
    return f"x+ is x one sample later; {late}"


def accuracy(model, test, train):
    """Return errors of the free run on every record, and the simulation.

    Parameters
    ----------
    model : estimator
        Fitted model.
    test : tuple
        The record, (u, y, experiment).
    train : tuple or None
        Training data, (u, y, experiment).

    Returns
    -------
    html : str
        HTML.
    """
    _, outputs = column_names(model)
    rows = []
    for name, data in (("training", train), ("this record", test)):
        if data is None:
            continue
        y_true, y_pred = model.simulate_test(*data)
        if not np.isfinite(y_pred).all():
            rows += [(name, y, np.inf, np.inf, -np.inf) for y in outputs]
            continue
        errors = (
            measure(y_true, y_pred, multioutput="raw_values")
            for measure in (rmse, nrmse, fit_percent)
        )
        rows += [(name, *row) for row in zip(outputs, *errors, strict=True)]
    parts = [
        paragraph(
            "Errors of the free-run simulation; the first samples set the initial "
            "state and are not scored. RMSE has the unit of the output, NRMSE is "
            "relative to its standard deviation."
        ),
        table(("data", "output", "RMSE", "NRMSE", "fit, %"), rows),
        attempt(lambda: _simulation(model, test), "Figure of the simulation"),
    ]
    return "".join(parts)


def _simulation(model, test):
    from ..plotting import SimulationDisplay

    drawn = SimulationDisplay.from_estimator(model, *test).figure_
    caption = "Measured and simulated output, and their difference"
    n = len(model.prepare_records(*test))
    if n > 1:
        caption += f", in the first of {n} experiments alone"
    return figure(drawn, f"{caption}.")


def checks(model, validation, reason):
    """Return the verdicts of validation and the correlations of the residual.

    Parameters
    ----------
    model : estimator
        Fitted model.
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
            "pass" if check.passed else "FAIL" if check.decides else "note",
            check.name,
            number(check.value, 3),
            check.quantity.strip(","),
            check.sentence,
        )
        for check in validation
    ]
    verdict = (
        "Passed: all required checks."
        if validation.passed
        else "Failed: see the checks marked FAIL."
    )
    content = paragraph(verdict, "pass" if validation.passed else "fail")
    content += table(("", "check", "value", "quantity", "meaning"), rows, "checks")
    if validation.residuals is not None:
        content += attempt(lambda: _residuals(validation), "Figure of the residuals")
    return content


def _residuals(validation):
    from ..plotting import ResidualDisplay

    drawn = ResidualDisplay(validation.residuals).plot().figure_
    return figure(
        drawn, "Correlations of the residual: those with u should stay in their band."
    )
