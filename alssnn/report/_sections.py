"""The sections of a report: what each says about a model on a record."""

import numpy as np

from ..metrics import fit_percent, nrmse, rmse
from ..networks import Perceptron
from ..validation import column_names, deviations
from ._page import (
    figure,
    heading,
    matrix,
    number,
    paragraph,
    python_code,
    table,
)

# The program of the gain grows with the cube of its neurons and more.
MAX_NEURONS = 100
# What a part of a report may fail on without the rest: its reason is the content.
REFUSED = (ValueError, RuntimeError, np.linalg.LinAlgError)

LINEARITY = (
    ("|g| / |Ax+Bu|, mean", "ratio_g_mean", "closed_ratio_mean"),
    ("|g| / |Ax+Bu|, max", "ratio_g_max", "closed_ratio_max"),
    ("|h| / |Ax+Bu|, mean", "ratio_h_mean", None),
    ("|h| / |Ax+Bu|, max", "ratio_h_max", None),
    ("|Ax+Bu|, mean", None, "closed_linear_mean"),
    ("|Ax+Bu|, max", None, "closed_linear_max"),
    ("|g|, mean", None, "closed_omega_mean"),
    ("|g|, max", None, "closed_omega_max"),
    ("share outside the training region", "outside", "closed_outside"),
    ("spectral radius of A", "spectral_radius", None),
    ("peak of |A^k|", "peak_gain", None),
)


def attempt(make, what):
    """Return the content that `make` returns, or why there is none.

    Parameters
    ----------
    make : callable
        Function without arguments that returns HTML.
    what : str
        What it is, in a few words.

    Returns
    -------
    html : str
        HTML.
    """
    try:
        return make()
    except REFUSED as error:
        return paragraph(f"{what}: not available. {error}", "note")


def summary(model, data, validation):
    """Return what the model is and the verdict.

    Parameters
    ----------
    model : estimator
        Fitted model.
    data : list of tuple of ndarray
        Tuples (u, y, x0) of every experiment.
    validation : Validation or None
        Checks on the record; None if there are none.

    Returns
    -------
    html : str
        HTML.
    """
    inputs, outputs = column_names(model)
    y = np.vstack([y for _, y, _ in data])
    rows = [
        ("model", type(model).__name__),
        ("inputs", ", ".join(inputs)),
        ("outputs", ", ".join(outputs)),
        ("states", str(model.nx_)),
        ("sampling time", f"{model.dt:.10g} s"),
        ("trained parameters", str(len(model._theta))),
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
            paragraph("The law leaves the linear system (A, B, C) from v.", "note"),
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
        sigma = model._structure.activations[f"w_{net}"]
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
    lengths = [len(y) for _, y, _ in deviations(model, *test)]
    if len(lengths) > 1:
        caption += f", in the first of {len(lengths)} experiments alone"
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
        "All checks passed that decide."
        if validation.passed
        else "At least one check failed that decides."
    )
    content = paragraph(verdict, "pass" if validation.passed else "fail")
    content += table(("", "check", "value", "quantity", "meaning"), rows, "checks")
    if validation.residuals is not None:
        content += attempt(lambda: _residuals(validation), "Figure of the residuals")
    return content


def _residuals(validation):
    from ..plotting import ResidualDisplay

    drawn = ResidualDisplay(validation.residuals).plot().figure_
    return figure(drawn, "Correlations of the residual: those with u should stay in.")


def linearity(model, test, record):
    """Return how linear the model is once h is cancelled.

    Parameters
    ----------
    model : estimator
        Fitted model.
    test : tuple
        The record, (u, y, experiment).
    record : Linearizability
        What was measured.

    Returns
    -------
    html : str
        HTML.
    """
    _, outputs = column_names(model)
    rows = [
        (f"linearization error of {name}, %", 100 * a, 100 * b)
        for name, a, b in zip(
            outputs,
            record.linearization_error,
            record.closed_linearization_error,
            strict=True,
        )
    ]
    rows += [
        (text, *(_field(record, name) for name in names)) for text, *names in LINEARITY
    ]
    rows += [
        (f"H2 gain from g to {name}", gain, "")
        for name, gain in zip(outputs, record.h2_gain, strict=True)
    ]
    bands = record.bands
    header = ["band, Hz"]
    for name in outputs:
        header += [f"e of {name}, %", f"{name}, %"]
    limits = zip(bands.edges[:-1], bands.edges[1:], strict=True)
    by_band = [
        (f"{low:g}\u00a0to\u00a0{high:g}", *(100 * np.column_stack([e, y]).ravel()))
        for (low, high), e, y in zip(limits, bands.error, bands.output, strict=True)
    ]
    parts = [
        paragraph(
            "The linearization error is the share of the output that is not the "
            "response of (A, B, C) once h is cancelled, rms(e) / rms(y). It does not "
            "depend on the state basis; ratios and gains do. Closed loop: u = v - h, "
            "with the recorded input as v."
        ),
        table(("", "open loop", "closed loop"), rows),
        heading("By frequency"),
        paragraph(
            "e and the output itself in frequency bands: rms in the band, in % of "
            "rms(y) over all frequencies."
        ),
        table(header, by_band),
    ]
    if "W_h" in model.params_:
        parts.append(attempt(lambda: _law(model, test), "Figure of h"))
    if "W_g" in model.params_:
        parts.append(attempt(lambda: _rest(model, test), "Figure of the rest"))
    return "".join(parts)


def _field(record, name):
    return "" if name is None else getattr(record, name)


def _law(model, test):
    from ..plotting import NonlinearityDisplay

    drawn = NonlinearityDisplay.from_estimator(model, *test).figure_
    return figure(drawn, "What the law cancels: h, with the density of the data.")


def _rest(model, test):
    from ..plotting import ResidualNonlinearityDisplay

    drawn = ResidualNonlinearityDisplay.from_estimator(model, *test).figure_
    return figure(drawn, "What g leaves at the output.")


def certificates(model, test):
    """Return what is proved of the linearized loop.

    Parameters
    ----------
    model : estimator
        Fitted model.
    test : tuple
        The record, (u, y, experiment).

    Returns
    -------
    html : str
        HTML.
    """
    return (
        heading("Input-to-state stability")
        + attempt(lambda: _iss(model, test), "Certificate")
        + heading("Incremental gain")
        + attempt(lambda: _gain(model), "Certificate")
    )


def _iss(model, test):
    certificate = model.iss_certificate(*test)
    if not certificate.holds:
        return paragraph(f"Does not hold. {certificate.reason}", "fail")
    rows = [
        ("margin, recomputed", certificate.verify()),
        ("rate phi", certificate.phi),
        ("gain psi", certificate.psi),
        ("largest |g| on the record, eps", certificate.eps),
        ("level of the invariant set", certificate.level),
    ]
    _, outputs = column_names(model)
    rows += [
        (f"bound of the distance of {name} from its linear response", bound)
        for name, bound in zip(outputs, certificate.output_bounds, strict=True)
    ]
    return (
        paragraph("Holds.", "pass")
        + paragraph(
            "Proved for the model and g as large as on this record, in the loop "
            f"u = v - h. {certificate.reason}",
            "note",
        )
        + table(("", "value"), rows)
    )


def _gain(model):
    lure, _ = model._plant()
    if lure.nw > MAX_NEURONS:
        return paragraph(
            f"Left out: the program of {lure.nw} neurons takes long. Call "
            "model.gain_certificate() for it.",
            "note",
        )
    certificate = model.gain_certificate()
    if not certificate.holds:
        return paragraph(f"Does not hold. {certificate.reason}", "fail")
    rows = [
        ("bound of the l2 gain from v to y", certificate.gamma),
        ("margin, recomputed", certificate.verify()),
    ]
    return paragraph("Holds.", "pass") + table(("", "value"), rows)


def controller(model):
    """Return what a control engineer takes along: (A, B, C) and a first design.

    Parameters
    ----------
    model : estimator
        Fitted model.

    Returns
    -------
    html : str
        HTML.
    """
    from ..feedback import balanced_weights, linear_part, lqi, lqr

    intro = paragraph(
        "Under the law the plant is nearly (A, B, C) of the equations, from v to y. "
        "A proposal to begin with: weights of one for every signal over its standard "
        "deviation in the training data, 0.01 for integrators."
    )
    nx = len(linear_part(model)[0])
    Q, R = balanced_weights(model)
    try:
        K = lqi(model, Q, R)
    except ValueError as error:
        refused = paragraph(f"With integrators: not available. {error}", "note")
        K = lqr(model, Q[:nx, :nx], R)
        words = "LQR, v = r - K x"
    else:
        refused, words = "", "LQI, v = u_e - K [x; z], z+ = z + y - r"
    content = intro + refused + heading(words) + matrix("K", K) + _poles(model, K)
    content += python_code("Copy the gain as Python", {"K": K})
    if not refused:
        content += attempt(lambda: _step(model, K), "Step response")
    return content


def _poles(model, K):
    from ..feedback import designed_loop

    poles = sorted(designed_loop(model, K).poles(), key=abs, reverse=True)
    rows = [(z.real, z.imag, abs(z)) for z in np.round(poles, 12) + 0.0]
    return table(("design poles: real part", "imaginary part", "modulus"), rows)


def _step(model, K):
    from ..feedback import step_comparison
    from ..plotting import LoopDisplay

    drawn = LoopDisplay.from_steps(model, step_comparison(model, K)).figure_
    caption = (
        "Step of all references by one standard deviation of the training data: the "
        "design, and the whole model under its law. u is what the plant gets, over its "
        "range in the training data."
    )
    return figure(drawn, caption)
