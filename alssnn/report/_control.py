"""Sections that say what to expect of a loop: how linear, what is proved, a design."""

import numpy as np

from ..linearizability import OMEGA, words_left
from ..plants import as_plant
from ..validation import column_names, moved_names
from ._page import (
    REFUSED,
    attempt,
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

LINEARITY = (
    ("|{rest}| / {linear}, mean", "ratio_g_mean", "closed_ratio_mean"),
    ("|{rest}| / {linear}, max", "ratio_g_max", "closed_ratio_max"),
    ("|h| / {linear}, mean", "ratio_h_mean", None),
    ("|h| / {linear}, max", "ratio_h_max", None),
    ("{linear}, mean", None, "closed_linear_mean"),
    ("{linear}, max", None, "closed_linear_max"),
    ("|{rest}|, mean", None, "closed_omega_mean"),
    ("|{rest}|, max", None, "closed_omega_max"),
    ("share outside the training region", "outside", "closed_outside"),
    ("{radius}", "spectral_radius", None),
    ("peak of |A^k|", "peak_gain", None),
)


def linearity(model, test, record, other=""):
    """Return how linear the model is once h is cancelled.

    Parameters
    ----------
    model : estimator
        Fitted model.
    test : tuple
        The record, (u, y, experiment).
    record : Linearizability
        What was measured.
    other : str, default=""
        Says of which law the last figure is where another one was judged, as HTML;
        empty if none was.

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
    rows += _sizes(record)
    rows += [
        (f"plant from its design, {name}", "", record.carried_words(i))
        for i, name in enumerate(outputs)
    ]
    rows += [
        (f"H2 gain from {record.words_rest} to {name}", gain, "")
        for name, gain in zip(outputs, record.h2_gain, strict=True)
        if record.ratio_g_max  # else there is none
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
            "The linearization error is rms(e) / std(y): the share of the output that "
            "is not the response of (A, B, C) once h is cancelled. It does not depend "
            "on the state basis. Ratios and gains do. "
            + (
                record.no_law
                or f"Closed loop: u = v - h, where v is {record.words_v}. Its "
                "linearization error is relative to the linear response to v, "
                "rms(e) / std(y_lin)."
            )
            + f" {OMEGA[0].upper()}{OMEGA[1:]}." * record.is_sampled
        ),
        table(("", "open loop", "closed loop"), rows),
        heading("By frequency"),
        paragraph(
            "e and the output itself in frequency bands: rms in the band, in % of "
            "std(y) over all frequencies."
        ),
        table(header, by_band),
    ]
    if as_plant(model).cancels:  # a search may have returned the linear model
        parts.append(attempt(lambda: _law(model, test), "Figure of h"))
    if "W_g" in model.params_:
        rest = attempt(lambda: _rest(model, test), "Figure of the rest")
        parts.append(other + rest)
    return "".join(parts)


def _sizes(record):
    """Return the rows of numbers that belong to no single output."""
    words = {
        "linear": record.words_linear,
        "radius": record.words_radius,
        "rest": record.words_rest,
    }
    return [
        (
            text.format(**words),
            *("" if name is None else getattr(record, name) for name in names),
        )
        for text, *names in LINEARITY
    ]


def _law(model, test):
    from ..plotting import NonlinearityDisplay

    what = as_plant(model).no_law or "What the law cancels:"
    words = f"{what} h, with the density of the data."
    return figure(NonlinearityDisplay.from_estimator(model, *test), words)


def _rest(model, test):
    from ..plotting import ResidualNonlinearityDisplay

    display = ResidualNonlinearityDisplay.from_estimator(model, *test)
    return figure(display, f"{words_left(as_plant(model))}.")


def certificates(model, test, doubt=""):
    """Return what is proved of the linearized loop.

    Parameters
    ----------
    model : estimator
        Fitted model.
    test : tuple
        The record, (u, y, experiment).
    doubt : str, default=""
        Why the model is not to be trusted; empty if it is.

    Returns
    -------
    html : str
        HTML.
    """
    return (
        heading("Distance from the linear response, for every input")
        + attempt(lambda: _local(model, doubt), "Certificate")
        + heading("Input-to-state stability")
        + attempt(lambda: _iss(model, test, doubt), "Certificate")
        + heading("Incremental gain")
        + attempt(lambda: _gain(model, doubt), "Certificate")
    )


def _local(model, doubt):
    certificate = model.local_certificate()
    if not certificate.holds:
        return _unproved(certificate)
    (inputs, outputs), given = column_names(model), model.plant_.given
    rows = [
        (
            f"largest {'disturbance' if i in given else 'input for'} {name}, around "
            "the operating point",
            size,
        )
        for i, (name, size) in enumerate(
            zip(inputs, certificate.amplitude, strict=True)
        )
    ]
    of_d = ", with measured disturbances within theirs" if len(given) else ""
    numbers = zip(
        outputs,
        certificate.design_peak,
        certificate.output_bounds,
        certificate.lower_bounds,
        strict=True,
    )
    for name, peak, proved, found in numbers:
        rows += [
            (f"what the linear response of {name} may reach", peak),
            (f"proved distance of {name} from it", proved),
            (f"distance of {name} that an input was found to make", found),
        ]
    return paragraph(
        f"For every input v of this size{of_d}, from rest, in the loop u = v - h "
        "without a gain. A gain K lowers the distance: call "
        "model.local_certificate(K=K). It is proved of the model, not of the plant. "
        f"{doubt}",
        "note" if doubt else "pass",
    ) + table(("", "value"), rows)


def _iss(model, test, doubt):
    certificate = model.iss_certificate(*test)
    if not certificate.holds:
        return _unproved(certificate)
    _, outputs = column_names(model)
    rows = [
        ("margin, recomputed", certificate.verify()),
        ("rate phi", certificate.phi),
        ("gain psi", certificate.psi),
        ("largest |omega| on the record, eps", certificate.eps),
        *(
            (f"largest |eta| of {name} on the record", eta)
            for name, eta in zip(outputs, certificate.eta, strict=True)
            if eta > 0
        ),
        ("level of the invariant set", certificate.level),
    ]
    rows += [
        (f"bound of the distance of {name} from its linear response", bound)
        for name, bound in zip(outputs, certificate.output_bounds, strict=True)
    ]
    return paragraph(
        "Conditional: holds while |omega|, what the linear part lacks of the next "
        "state, stays below what the data showed, for the model, in the loop u = v - "
        "h. Nothing proves that it stays there. "
        + (f"{doubt} " if doubt else "")
        + certificate.reason,
        "note",
    ) + table(("", "value"), rows)


def _gain(model, doubt):
    nw = as_plant(model).form.nw
    if nw > MAX_NEURONS:
        return paragraph(
            f"Left out: the program of {nw} neurons takes long. Call "
            "model.gain_certificate() for it.",
            "note",
        )
    certificate = model.gain_certificate()
    if not certificate.holds:
        return _unproved(certificate)
    rows = [
        ("bound of the l2 gain from v to y", certificate.gamma),
        ("margin, recomputed", certificate.verify()),
    ]
    words = paragraph(f"Holds for the model, not for the plant. {doubt}", "note")
    if not doubt:
        words = paragraph("Holds for the model.", "pass")
    return words + table(("", "value"), rows)


def _unproved(certificate):
    """Say that nothing is proved; a solver that failed decides nothing."""
    if certificate.verdict == "undecided":
        reason = certificate.reason
        return paragraph(f"Undecided. {reason} Nothing is known either way.", "note")
    return paragraph(f"Does not hold. {certificate.reason}", "fail")


def controller(model, doubt=""):
    """Return what a control engineer takes along: (A, B, C) and a first design.

    Parameters
    ----------
    model : estimator
        Fitted model.
    doubt : str, default=""
        Why the model is not to be trusted; empty if it is.

    Returns
    -------
    html : str
        HTML.
    """
    from ..feedback import balanced_weights, lqi, lqr

    weights = (
        "Weights of one for every signal over its standard deviation in the training "
        "data, 0.01 for integrators."
    )
    if doubt:
        intro = paragraph(f"Do not use this design on the plant. {doubt}", "fail")
        intro += paragraph(f"It shows what (A, B, C) would give. {weights}")
        shown = "Show the design all the same"
    else:
        intro = paragraph(
            "The model passed on this record. With its law it is nearly (A, B, C), "
            "from v to y. This is a proposal to begin with. " + weights
        )
    nx, n_late = model.plant_.late().nx, model.plant_.late().n_late
    Q, R = balanced_weights(model)
    try:
        K = lqi(model, Q, R)
    except ValueError as error:
        refused = paragraph(f"With integrators: not available. {error}", "note")
        K = lqr(model, Q[:nx, :nx], R)
        words = "LQR, v = r - K x"
    else:
        refused, words = "", "LQI, v = u_e - K [x; z], z+ = z + y - r"
    words += "; x with the last inputs behind it, oldest first" * bool(n_late)
    beyond, step = ("", "") if refused else _step(model, K)
    content = refused + beyond + heading(words) + matrix("K", K) + _poles(model, K)
    content += python_code("Copy the gain as Python", {"K": K}) + step
    if doubt:
        content = f"<details><summary>{shown}</summary>{content}</details>"
    return intro + content


def _poles(model, K):
    from ..feedback import designed_loop

    poles = sorted(designed_loop(model, K).poles(), key=abs, reverse=True)
    rows = [(z.real, z.imag, abs(z)) for z in np.round(poles, 12) + 0.0]
    return table(("design poles: real part", "imaginary part", "modulus"), rows)


def _step(model, K):
    """Return what a step response warns of, and its figure."""
    from ..feedback import step_comparison
    from ..plotting import LoopDisplay

    caption = (
        "Step of all references by one standard deviation of the training data: the "
        "design, and the whole model under its law. u is what the plant gets, over its "
        "range in the training data."
    )
    try:
        responses = step_comparison(model, K)
        drawn = figure(LoopDisplay.from_steps(model, responses), caption)
    except REFUSED as error:
        return "", paragraph(f"Step response: not available. {error}", "note")
    return _beyond(model, responses), drawn


def _beyond(model, responses):
    """Say which inputs leave the range of their training data in a step."""
    from ..feedback import input_range
    from ..feedback.law import leaves_range

    low, high = input_range(model)
    moved = moved_names(model)
    u = responses["model"].outputs[-len(moved) :]
    said = [
        f"{name} goes from {number(np.min(z), 3)} to {number(np.max(z), 3)}, but the "
        f"training data end at {number(a, 3)} and {number(b, 3)}."
        for name, z, a, b, leaves in zip(
            moved, u, low, high, leaves_range(model, u), strict=True
        )
        if leaves
    ]
    if not said:
        return ""
    said = ["In the step below,", *said, "There the model is a guess."]
    return paragraph(" ".join(said), "fail")
