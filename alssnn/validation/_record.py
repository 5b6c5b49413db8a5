"""What a validation reports: checks with a number and a sentence each."""

import textwrap
from dataclasses import dataclass, field

import numpy as np

from ..linearizability import Linearizability
from ..rows import Rows
from ._ahead import AheadFit
from ._feedback import FeedbackTests
from ._residuals import ResidualTests

WIDTH, INDENT = 88, 6  # of the table, and of its sentences


@dataclass(frozen=True)
class Check:
    """Hold the outcome of one check.

    Parameters
    ----------
    name : str
        Name of the check.
    passed : bool
        Whether it passed.
    value : float
        The number that it rests on.
    quantity : str
        What `value` is, such as "p-value".
    decides : bool
        Whether the verdict depends on it; a check that does not is reported only.
    sentence : str
        What the outcome means and what to do about it.
    undecided : bool, default=False
        Whether the record is too short to tell; the check has then not passed.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> check = model.validate(*record, n_lags=10)["whiteness"]
    >>> check.name, check.decides
    ('whiteness', False)
    """

    name: str
    passed: bool
    value: float
    quantity: str
    decides: bool
    sentence: str
    undecided: bool = False

    @property
    def outcome(self):
        """Return "pass", "FAIL", "open" if undecided, or "note" if none decides."""
        if self.passed:
            return "pass"
        if not self.decides:
            return "note"
        return "open" if self.undecided else "FAIL"


@dataclass(frozen=True, eq=False, repr=False)
class Validation(Rows):
    """Hold the checks of a model on a record.

    ``validation["independence"]`` is one check, and it iterates over all of them.

    Parameters
    ----------
    checks : tuple of Check
        The checks.
    residuals : ResidualTests or None
        Correlations, bands and p-values behind the checks of residuals; None if the
        simulation diverges.
    ahead : AheadFit or None
        Fit of k-step predictions; None if the model has no observer.
    linearizability : Linearizability
        How linear the model is on this record.
    name : str
        Name of the model.
    feedback : FeedbackTests or None
        Whether noise moved the inputs; None if there is no residual, or the record is
        too short.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> validation = model.validate(*record, n_lags=10)
    >>> validation.passed, validation["cubes"].passed
    (False, False)
    """

    _rows = "checks"

    checks: tuple[Check, ...]
    residuals: ResidualTests | None = field(repr=False)
    ahead: AheadFit | None = field(repr=False)
    linearizability: Linearizability = field(repr=False)
    name: str = "model"
    feedback: FeedbackTests | None = field(default=None, repr=False)

    @property
    def passed(self):
        """Return whether all checks passed that decide."""
        return all(check.passed for check in self.checks if check.decides)

    def __repr__(self):
        """Return a table, a sentence below each line, and the verdict."""
        lines = []
        for check in self.checks:
            number = f"{check.quantity} {check.value:.3g}"
            if np.isnan(check.value) and check.undecided:
                number = "too short"
            lines.append(f"{check.outcome}  {check.name:<18s}{number}")
            wrapped = textwrap.wrap(check.sentence, WIDTH - INDENT)
            lines += [" " * INDENT + line for line in wrapped]
        return "\n".join([*lines, f"{self.name} {self.verdict}."])

    @property
    def verdict(self):
        """Return "passes", or what fails, or else what is undecided, in words."""
        for outcome, word in (("FAIL", "fails"), ("open", "is undecided")):
            names = [check.name for check in self.checks if check.outcome == outcome]
            if names:
                return f"{word}: {', '.join(names)}"
        return "passes"

    def to_frame(self):
        """Return the checks as a pandas DataFrame.

        Returns
        -------
        frame : pandas.DataFrame
            One row per check, indexed by its name, with the columns `passed`,
            `value`, `quantity`, `decides` and `sentence`.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        columns = ("passed", "value", "quantity", "decides", "sentence")
        data = {name: [getattr(check, name) for check in self] for name in columns}
        return self.frame(data, "check")
