"""Put the sections of a report together."""

import sys
from datetime import datetime

from sklearn.utils.validation import check_is_fitted

from ..checks import noise_levels
from ..linearizability import is_unstable, judge
from ..whole_files import replace_file
from . import _control, _sections
from ._page import REFUSED, attempt, page, paragraph


def write_report(
    model,
    path,
    u,
    y,
    experiment=None,
    *,
    train=None,
    noise_floor=None,
    law_dt=None,
    ahead=False,
    name=None,
    source=None,
):
    """Write one self-contained HTML page about a fitted model.

    It begins with the verdict. Accuracy, validation, linearizability, certificates and
    a proposal for a controller follow, with figures to zoom into, and the equations
    with their numbers. The page is one file and needs no network, and what cannot be
    computed is said with its reason. It costs about a dozen simulations of the record
    and one semidefinite program.

    Parameters
    ----------
    model : estimator
        Fitted model.
    path : str or path-like
        File; one that exists is replaced.
    u : array_like of shape (N, nu), or list of them
        Inputs of a record that the model was not trained on.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs; nan where not measured.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    train : tuple, Record or None, default=None
        Training data, (u, y) or (u, y, experiment); None leaves them out.
    noise_floor : float, array_like of shape (ny,), or object or None, default=None
        Errors that no model goes below, see `validate`.
    law_dt : float or None, default=None
        Sampling time at which the law will run, in seconds, see `linearizability`.
    ahead : bool, default=False
        Whether the law looks half a sample ahead (eq. middle).
    name : str or None, default=None
        Name of the plant, for the title; None takes the class of the model.
    source : str or None, default=None
        Where model and record come from, such as the names of their files, for the
        line below the title. The date and the version of the package stand there, too.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    OSError
        If the file cannot be written.
    ValueError
        If the data do not fit the model.
    """
    check_is_fitted(model)
    test = (u, y, experiment)
    if train is not None:
        train = tuple(train)
        if len(train) not in (2, 3):
            raise ValueError(
                "`train` must be a Record, (u, y) or (u, y, experiment), got "
                f"{len(train)} items. Use None to leave training data out."
            )
    floor = noise_levels(noise_floor, len(model.y_offset_))
    data = model.prepare_records(*test)  # a wrong one ends here, not in a section
    validation, reason, law = None, "", {"law_dt": law_dt, "ahead": ahead}
    try:
        validation = model.validate(*test, noise_floor=floor, **law)
        record = validation.linearizability
    except REFUSED as error:
        reason = str(error)
        record = model.linearizability(*test, **law)
    doubt = _doubt(validation, record)
    verdict = _sections.summary(model, data, test, validation, reason)
    sections = [
        ("summary", "Summary", verdict),
        ("accuracy", "Accuracy", _sections.accuracy(model, test, train, floor)),
        ("validation", "Validation", _sections.checks(validation, reason)),
        (
            "linearizability",
            "Linearizability" + _of_law(law_dt, ahead),
            _control.linearity(model, test, record, _other_law(model, **law)),
        ),
        (
            "certificates",
            "Certificates",
            _other_law(model, **law) + _control.certificates(model, test, doubt),
        ),
        (
            "control",
            "Control",
            _other_law(model, **law)
            + attempt(lambda: _control.controller(model, doubt), "Design"),
        ),
        ("equations", "Equations", _sections.equations(model)),
    ]
    text = page(f"{name or type(model).__name__}: report", _origin(source), sections)
    replace_file(path, text)


def _origin(source):
    """Say where a page comes from, and when."""
    # not imported, for the package itself imports what is above this module
    version = sys.modules[__name__.partition(".")[0]].__version__
    today = datetime.now().astimezone().isoformat(" ", "minutes")
    made = f"Written by alssnn {version} on {today}."
    return made if source is None else f"{source}. {made}"


def _of_law(law_dt, ahead):
    """Say which law was judged, where it is not that of the record."""
    rate = "" if law_dt is None else f", law at {law_dt:g} s"
    return rate + ", half a sample ahead" * bool(ahead)


def _other_law(model, law_dt, ahead):
    """Say which law a section is about, where another one was judged."""
    dt = model.plant_.dt
    if not ahead and law_dt in (None, dt):
        return ""
    other = f"{law_dt or dt:g}, ahead=True" if ahead else f"{law_dt:g}"
    return paragraph(
        f"Of the law at the sampling time of the record, {dt:g} s, and not of the law "
        f"that was judged above. Of that one: take model.plant_.at({other}).",
        "note",
    )


def _doubt(validation, record):
    """Say why a design on the model is not to be trusted; empty if nothing speaks."""
    if validation is None:
        passed, sentence = judge(record)
        if passed:
            return "The model was not validated: see above."
        return f"The model was not validated, and it is not linear. {sentence}"
    linear = validation["linearizability"]
    if not validation.passed:
        words = f"The model {validation.verdict}."
    elif is_unstable(record):  # no free run tells
        words = "How linear the model is was not judged."
    elif not linear.passed:  # a model that was not made for control
        words = "The model is not linearizable."
    else:
        return ""
    return words if linear.passed else f"{words} {linear.sentence}"
