"""Numbers in sentences have no exponents."""

import re
from pathlib import Path

import numpy as np
import pytest

import alssnn
from alssnn.shown import percent, times


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 2, "0 %"),
        (6.5e-15, 2, "0 %"),
        (2e-5, 2, "less than 0.001 %"),
        (0.00123, 2, "0.0012 %"),
        (12.34, 2, "12 %"),
        (12.34, 3, "12.3 %"),
        (99.6, 2, "100 %"),
        (-1234.5, 3, "-1,234 %"),
        (5e17, 2, "more than 1,000,000 %"),
        (-5e17, 2, "less than -1,000,000 %"),
    ],
)
def test_percentages(value, digits, text):
    assert percent(value, digits) == text


@pytest.mark.parametrize(
    ("ratio", "text"),
    [
        (1.24, "1.2"),
        (99.6, "100"),
        (12345.0, "12,345"),
        (5.5e16, "more than a million"),
    ],
)
def test_ratios(ratio, text):
    assert times(ratio) == text


def test_no_percentage_has_an_exponent(rng):
    for value in 10 ** rng.uniform(-20, 20, 200):
        for digits in (2, 3):
            said = percent(value, digits)
            assert re.fullmatch(r"((more|less) than )?[0-9,]+(\.[0-9]+)? %", said), said
    assert percent(np.float64(50.0)) == "50 %"


def test_sentences_take_them_from_one_place():
    """A format such as {share:.2g} before a % writes "1e+02 %" at 99.6."""
    for path in Path(alssnn.__file__).parent.rglob("*.py"):
        if path.name != "shown.py":
            assert not re.search(r":\.\d?g\} %", path.read_text("utf-8")), path
